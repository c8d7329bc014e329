//! Is what was built what was designed? Faults of a skin and its reader, from its untouched frame.
//!
//! The frame is explained by a sound skin, whose coat is uneven, whose electrodes are displaced and whose contacts differ
//! ([`identify`](dermis::identify)), and by the same skin with faults. Faults of wires and contacts are changes of low
//! rank of the network between the electrodes, a cut is one of the coat. Each explanation is fitted; a fault is named if
//! the probability of the frame (the evidence, which also counts how much a fault could explain anyway) rises clearly.
//!
//! ```
//! use dermis::skin::Skin;
//! use dermis_calibrate::build::{BuildChecker, Fault};
//!
//! let mut design = dermis::design::SkinDesign::shipped("tank16").expect("a shipped design");
//! design.mesh = design.mesh.scaled(2.0);
//! let skin = Skin::new(design).map_err(|error| error.to_string())?;
//! let network = skin.forward().network(skin.forward().rest_conductivity()).map_err(|error| error.to_string())?;
//! let built = network.scaled(1.7).exchanged([3, 9]); // another sheet resistance, and two wires exchanged
//! let untouched = built.frame(&skin.design().protocol); // ohm
//! let checker = BuildChecker::new(&skin).map_err(|error| error.to_string())?;
//! let check = checker.check(&[untouched]).map_err(|error| error.to_string())?;
//! assert_eq!(check.faults, [Fault::ExchangedWires { electrodes: [3, 9] }]);
//! # Ok::<(), String>(())
//! ```

mod cut;
mod data;
mod fault;
mod finding;
mod fit;
mod screen;

pub use fault::{Cut, Fault};

use crate::calibration::{LabelFrame, check_frames};
use crate::checks::{Recording, check_recording};
use crate::error::CalibrateError;
use cut::remaining;
use data::Data;
use dermis::finding::{Finding, FindingKind, is_sound};
use dermis::frame::{Frame, mean};
use dermis::identify::IdentifyOptions;
use dermis::plausibility::Plausibility;
use dermis::skin::Skin;
use fit::{Fit, Model};
use serde::Serialize;

/// Gain of the logarithm of the evidence from which a fault is named.
const MIN_GAIN: f64 = 20.0;
/// A frame with a smaller misfit is explained: no further gross fault or cut is looked for. (Right explanations leave 0.3 to
/// 0.8 on digital twins.)
const EXPLAINED: f64 = 1.2;
/// A frame with a larger misfit is not explained by the faults that were found.
const UNEXPLAINED: f64 = 2.0;
/// Faults that leave more than this part of the misfit of the sound skin are not named where the order or the signs of the
/// channels are wrong.
const MAX_LEFT: f64 = 0.7;
/// Gain of a small fault, to first order, from which it is fitted.
const SMALL_GAIN: f64 = 15.0;
/// Most searches for the place of a cut, each about the skin that the last one left.
const CUT_ROUNDS: usize = 4;
/// Most faults that are named.
const MAX_FAULTS: usize = 4;
/// The frame determines a contact impedance whose standard deviation is at most this share of its prior.
const DETERMINED: f64 = 0.5;

/// Standard deviations of what a builder varies: the logarithms of the sheet resistance and of the contact impedance, a factor of
/// three; the radius of the electrodes and the body's length over its diameter, relative.
const SCALE_SD: f64 = 1.098_6;
const RADIUS_SD: f64 = 0.08;
const LENGTH_SD: f64 = 0.007;
/// Contact impedances are taken from a frame within these factors of the design's.
const CONTACT_FACTORS: [f64; 2] = [0.03, 30.0];

/// What was found on a built skin.
#[derive(Debug, Clone, Serialize)]
pub struct BuildCheck {
    /// The findings: faults first, then notes. Empty for a sound skin.
    pub findings: Vec<Finding>,
    /// The faults of the network and of the coat among them.
    pub faults: Vec<Fault>,
    /// All resistances of the skin over those of the design: a factor on the sheet resistance, or on the reference
    /// resistor of all drives.
    pub resistance_factor: f64,
    /// Standard deviation of the logarithm of the coat's conductance.
    pub unevenness: f64,
    /// Conductance of the coat over its mean, a value per cell of the skin's mesh.
    pub conductance: Vec<f64>,
    /// The contact of each electrode.
    pub contacts: Vec<BuiltContact>,
    /// Root mean square of what is left of the frame over what noise and workmanship explain.
    pub misfit: f64,
    /// The same for the skin without faults.
    pub sound_misfit: f64,
    /// Noise of one frame in the channels without and with a driven electrode
    /// ([`ChannelNoise`](dermis::estimate::noise::ChannelNoise)), ohm.
    pub noise_ohm: [f64; 2],
    /// Number of frames.
    pub frames: usize,
}

/// The contact of an electrode.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BuiltContact {
    /// Contact impedance, ohm m2 (ohm m of an arc).
    pub contact_impedance: f64,
    /// Whether the frame determines it; if not, it is what the other contacts and the design say.
    pub is_determined: bool,
    /// Displacement from its place in the chart of the surface, m.
    pub displacement_m: [f64; 2],
    /// Whether a fault was found at it.
    pub is_faulty: bool,
}

/// The checks of one design.
#[derive(Debug)]
pub struct BuildChecker {
    model: Model,
    skin: Skin,
}

impl BuildChecker {
    /// Prepares the checks of a skin.
    ///
    /// # Errors
    /// A design that cannot be solved.
    pub fn new(skin: &Skin) -> Result<Self, CalibrateError> {
        BuildChecker::of_sizes(skin, [0.0; 2])
    }

    fn of_sizes(skin: &Skin, [radius_sd, length_sd]: [f64; 2]) -> Result<Self, CalibrateError> {
        let options = IdentifyOptions { scale_sd: SCALE_SD, radius_sd, length_sd, ..IdentifyOptions::default() };
        Ok(BuildChecker { model: Model::new(skin, options)?, skin: skin.clone() })
    }

    /// Checks the skin by frames of it untouched, ohm.
    ///
    /// # Errors
    /// No frame; frames of another number of channels; values that are not finite.
    pub fn check(&self, frames: &[Frame]) -> Result<BuildCheck, CalibrateError> {
        let mean = mean_of(frames, self.model.protocol.channel_count())?;
        let model = &self.model;
        let designed = Frame(model.frame.clone());
        let unlike = Plausibility::new(&model.protocol, &designed, &[]).of_baseline(&mean);
        if let Some(found) = unlike.filter(|found| found.is_fault() && found.kind != FindingKind::UnlikeModel) {
            return Ok(self.unlike(frames.len(), vec![found]));
        }
        let own = self.check_workmanship(frames, &mean)?;
        if own.misfit <= EXPLAINED && own.faults.is_empty() {
            return Ok(own);
        }
        // Sizes and contacts explain a part of any fault: they count where they explain all of the frame.
        let varied = self.varied(frames)?.check_workmanship(frames, &mean)?;
        let is_simpler = own.misfit > UNEXPLAINED || varied.faults.len() < own.faults.len();
        Ok(if varied.misfit <= EXPLAINED && is_simpler { varied } else { own })
    }

    /// The checks of the design with other sizes and with the contact impedance of some frames: a frame is not linear in it.
    fn varied(&self, frames: &[Frame]) -> Result<BuildChecker, CalibrateError> {
        let model = &self.model;
        let data = Data::new(&model.protocol, frames, &model.frame, &model.discretisation);
        let factor = data.map_or(1.0, |data| model.contact_factor(&data));
        let factor = if factor.is_nan() { 1.0 } else { factor.clamp(CONTACT_FACTORS[0], CONTACT_FACTORS[1]) };
        let mut design = self.skin.design().clone();
        design.electrodes.iter_mut().for_each(|electrode| electrode.contact_impedance *= factor);
        BuildChecker::of_sizes(&Skin::new(design)?, [RADIUS_SD, LENGTH_SD])
    }

    /// Checks frames of a skin of about these sizes and contacts.
    fn check_workmanship(&self, frames: &[Frame], mean: &Frame) -> Result<BuildCheck, CalibrateError> {
        let model = &self.model;
        let even = vec![0.0; model.identifier.unknown_count()];
        let data = Data::new(&model.protocol, frames, &model.frame, &model.discretisation);
        let fit = data.as_ref().and_then(|data| model.fit(data, &[], &even, f64::INFINITY));
        let (Some(data), Some(mut fit)) = (data, fit) else {
            return Ok(self.unlike(frames.len(), self.recorded(mean)?));
        };
        let sound_misfit = fit.misfit;
        let mut gains = Vec::new();
        // A cut on the mesh is coarse: what it leaves would be named as other faults.
        while fit.faults.len() < MAX_FAULTS && !has_cut(&fit.faults) {
            let Some((better, gain)) = self.better(&data, &fit) else { break };
            gains.push(gain);
            fit = self.pruned(&data, better, &mut gains);
        }
        if is_unexplained(&fit, sound_misfit) && fit.misfit > MAX_LEFT * sound_misfit {
            let recorded = self.recorded(mean)?;
            if !is_sound(&recorded) {
                return Ok(BuildCheck { misfit: fit.misfit, sound_misfit, ..self.unlike(frames.len(), recorded) });
            }
        }
        Ok(self.found(&data, fit, &gains, sound_misfit, frames.len()))
    }

    /// What the values alone show, and their order: of use where the model does not explain the frame.
    fn recorded(&self, mean: &Frame) -> Result<Vec<Finding>, CalibrateError> {
        let one = std::slice::from_ref(mean);
        let recording = Recording { frames: one, untouched: one, positions_m: None, label_frame: LabelFrame::Skin };
        let mut findings = check_recording(&self.skin, &recording)?.findings;
        let of_frame = [
            FindingKind::Order,
            FindingKind::UnlikeModel,
            FindingKind::SignTurned,
            FindingKind::SignLost,
            FindingKind::SignPresent,
            FindingKind::Magnitude,
        ];
        findings.retain(|finding| of_frame.contains(&finding.kind));
        Ok(findings)
    }

    /// A frame that is unlike the model.
    fn unlike(&self, frames: usize, mut findings: Vec<Finding>) -> BuildCheck {
        if findings.is_empty() {
            findings.push(finding::unexplained(f64::INFINITY));
        }
        BuildCheck {
            findings,
            faults: Vec::new(),
            resistance_factor: f64::NAN,
            unevenness: f64::NAN,
            conductance: Vec::new(),
            contacts: Vec::new(),
            misfit: f64::INFINITY,
            sound_misfit: f64::INFINITY,
            noise_ohm: [f64::NAN; 2],
            frames,
        }
    }

    /// The fit with the one more fault that explains the frame best, if it does so clearly.
    fn better(&self, data: &Data, fit: &Fit) -> Option<(Fit, f64)> {
        let model = &self.model;
        let small = screen::small(model, fit, &fit.impedance).into_iter();
        let mut candidates: Vec<Fault> = small.filter(|(gain, _)| *gain > SMALL_GAIN).map(|(_, fault)| fault).collect();
        if fit.misfit > EXPLAINED {
            candidates.extend(screen::gross(model, data, &fit.faults));
        }
        let even = vec![0.0; fit.x.len()];
        let with = |fault: Fault, least: f64| self.with(data, &fit.faults, fault, least);
        let mut least = fit.misfit;
        let mut fits: Vec<Fit> = Vec::new();
        for fault in candidates {
            let one = with(fault, least);
            least = one.as_ref().map_or(least, |one| least.min(one.misfit));
            fits.extend(one);
        }
        if least > EXPLAINED {
            // A sound skin adapts to a cut: its unknowns are far from those of the skin with it.
            let cut = cut::best_cut(model, data, &fit.faults, &even, None);
            let first = cut.and_then(|cut| Some((cut, with(Fault::Cut(cut), f64::INFINITY)?)));
            fits.extend(first.and_then(|(cut, first)| self.refined(data, &fit.faults, cut, first)));
        }
        let left = fits.iter().map(|one| one.misfit).fold(f64::INFINITY, f64::min).max(1.0);
        let best = fits.into_iter().max_by(|a, b| a.log_evidence_at(left).total_cmp(&b.log_evidence_at(left)))?;
        let gain = best.log_evidence_at(left) - fit.log_evidence_at(left);
        (gain > MIN_GAIN).then_some((best, gain))
    }

    /// The best fit with a cut near another beside some faults: place and skin are improved in turn.
    fn refined(&self, data: &Data, others: &[Fault], mut cut: Cut, mut best: Fit) -> Option<Fit> {
        for _ in 0..CUT_ROUNDS {
            cut = cut::best_cut(&self.model, data, others, &best.x, Some(cut))?;
            let next = self.with(data, others, Fault::Cut(cut), f64::INFINITY)?;
            let left = next.misfit.max(1.0);
            let gain = next.log_evidence_at(left) - best.log_evidence_at(left);
            if gain > 0.0 {
                best = next;
            }
            if gain < MIN_GAIN {
                break;
            }
        }
        Some(best)
    }

    /// A fit with one more fault, from the even skin.
    fn with(&self, data: &Data, others: &[Fault], fault: Fault, least: f64) -> Option<Fit> {
        let faults: Vec<Fault> = others.iter().copied().chain([fault]).collect();
        self.model.fit(data, &faults, &vec![0.0; self.model.identifier.unknown_count()], least)
    }

    /// A fit without the faults that its last one has made needless, and their gains.
    fn pruned(&self, data: &Data, mut fit: Fit, gains: &mut Vec<f64>) -> Fit {
        for at in (0..fit.faults.len().saturating_sub(1)).rev() {
            let mut others = fit.faults.clone();
            others.remove(at);
            let Some(last) = others.pop() else { break };
            let without = self.with(data, &others, last, f64::INFINITY);
            let without = match last {
                Fault::Cut(cut) => without.and_then(|one| self.refined(data, &others, cut, one)),
                _ => without,
            };
            let left = fit.misfit.max(1.0);
            let needless = |one: &Fit| fit.log_evidence_at(left) - one.log_evidence_at(left) < MIN_GAIN;
            if let Some(without) = without.filter(needless) {
                fit = without;
                gains.remove(at);
            }
        }
        fit
    }

    /// The result of a fit.
    fn found(&self, data: &Data, fit: Fit, gains: &[f64], sound_misfit: f64, frames: usize) -> BuildCheck {
        let model = &self.model;
        let faults: Vec<Fault> = fit.faults.iter().map(|fault| fault.scaled(data.scale)).collect();
        let (conductance, mean_log, unevenness) = self.coat(&fit);
        let resistance_factor = data.scale * (-mean_log).exp();
        let low = conductance.iter().copied().fold(f64::INFINITY, f64::min);
        let high = conductance.iter().copied().fold(0.0, f64::max);
        let named = faults.iter().zip(gains);
        let mut findings: Vec<Finding> =
            named.map(|(fault, &gain)| finding::of_fault(fault, gain, &model.protocol)).collect();
        if is_unexplained(&fit, sound_misfit) {
            findings.push(finding::unexplained(fit.misfit));
        }
        findings.extend(finding::of_resistance(resistance_factor));
        findings.extend(finding::of_coat(unevenness, [low, high]));
        let contacts = self.contacts(data, &fit, &findings);
        let conductance = self.with_cuts(conductance, &faults);
        BuildCheck {
            findings,
            faults,
            resistance_factor,
            unevenness,
            conductance,
            contacts,
            misfit: fit.misfit,
            sound_misfit,
            noise_ohm: data.noise.by_group_ohm(),
            frames,
        }
    }

    /// The conductance of the coat over its mean, without cuts; the mean of the logarithm of its factor from the design,
    /// and its standard deviation over the area.
    fn coat(&self, fit: &Fit) -> (Vec<f64>, f64, f64) {
        let designed = self.skin.forward().rest_conductivity();
        let Ok(built) = self.model.identifier.model_of(&fit.x) else {
            return (vec![1.0; designed.len()], 0.0, 0.0);
        };
        let logs: Vec<f64> =
            built.rest_conductivity().iter().zip(designed).map(|(built, designed)| (built / designed).ln()).collect();
        let areas = (0..designed.len()).map(|cell| self.skin.mesh().cell_measure(cell));
        let (sum, area) =
            areas.clone().zip(&logs).fold((0.0, 0.0), |(sum, all), (one, log)| (sum + one * log, all + one));
        let mean_log = sum / area;
        let variance = areas.zip(&logs).map(|(one, log)| one * (log - mean_log).powi(2)).sum::<f64>() / area;
        (logs.into_iter().map(|log| (log - mean_log).exp()).collect(), mean_log, variance.sqrt())
    }

    /// The conductance of a coat with its cuts.
    fn with_cuts(&self, mut conductance: Vec<f64>, faults: &[Fault]) -> Vec<f64> {
        for fault in faults {
            if let Fault::Cut(cut) = fault {
                let parts = remaining(self.skin.mesh(), &self.model.surface, cut);
                conductance.iter_mut().zip(parts).for_each(|(value, part)| *value *= part);
            }
        }
        conductance
    }

    fn contacts(&self, data: &Data, fit: &Fit, findings: &[Finding]) -> Vec<BuiltContact> {
        let identifier = &self.model.identifier;
        let built = identifier.model_of(&fit.x).ok();
        let count = self.model.protocol.electrode_count();
        let covariance = fit.linear.factor.inverse();
        let impedance =
            |electrode: usize| built.as_ref().map_or(f64::NAN, |built| built.contact_impedances()[electrode]);
        let sd = |electrode: usize| {
            let unknown = identifier.unknown_of_contact(electrode);
            covariance.at(unknown, unknown).sqrt()
        };
        let displacements_m = identifier.displacements_m(&fit.x);
        let contact = |electrode: usize| BuiltContact {
            contact_impedance: data.scale * impedance(electrode),
            is_determined: sd(electrode) <= DETERMINED,
            displacement_m: displacements_m[electrode],
            is_faulty: findings.iter().any(|finding| finding.electrodes.contains(&electrode)),
        };
        (0..count).map(contact).collect()
    }
}

fn has_cut(faults: &[Fault]) -> bool {
    faults.iter().any(|fault| matches!(fault, Fault::Cut(_)))
}

/// Whether a frame is not explained by a fit. A cut, which is coarse on the mesh, explains enough if it halves the misfit.
fn is_unexplained(fit: &Fit, sound_misfit: f64) -> bool {
    let enough = has_cut(&fit.faults) && fit.misfit < 0.5 * sound_misfit;
    fit.misfit > UNEXPLAINED && !enough
}

/// The mean of some frames.
fn mean_of(frames: &[Frame], channels: usize) -> Result<Frame, CalibrateError> {
    check_frames("frame", frames, channels)?;
    mean(frames).ok_or_else(|| CalibrateError::Label("there is no untouched frame".into()))
}
