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
mod fit;
mod screen;

pub use fault::{Cut, Fault};

use crate::error::CalibrateError;
use data::Data;
use dermis::frame::Frame;
use dermis::identify::IdentifyOptions;
use dermis::skin::Skin;
use fit::{Fit, Model};

/// Gain of the logarithm of the evidence from which a fault is named.
const LEAST_GAIN: f64 = 20.0;
/// A frame with a smaller misfit is explained: no further gross fault or cut is looked for.
const EXPLAINED: f64 = 1.2;
/// Gain of a small fault, to first order, from which it is fitted.
const SMALL_GAIN: f64 = 15.0;
/// Most faults that are named.
const MOST_FAULTS: usize = 4;

/// What was found.
#[derive(Debug, Clone)]
pub struct BuildCheck {
    /// The faults.
    pub faults: Vec<Fault>,
    /// Gain of the logarithm of the evidence by each fault.
    pub gains: Vec<f64>,
    /// Root mean square of what is left of the frame over what noise and workmanship explain.
    pub misfit: f64,
    /// That of a sound skin.
    pub sound_misfit: f64,
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
    /// A design without signs (`amplitude_only`), or that cannot be solved.
    pub fn new(skin: &Skin) -> Result<Self, CalibrateError> {
        let options = IdentifyOptions { scale_sd: 1.1, ..IdentifyOptions::default() };
        Ok(BuildChecker { model: Model::new(skin, options)?, skin: skin.clone() })
    }

    /// Checks the skin by frames of it untouched, ohm.
    pub fn check(&self, frames: &[Frame]) -> Result<BuildCheck, CalibrateError> {
        let data = Data::new(&self.model.protocol, frames, &self.model.frame).expect("scale");
        let start = vec![0.0; self.model.identifier.unknown_count()];
        let mut fit = self.model.fit(&data, &[], &start).expect("fit");
        let sound_misfit = fit.misfit;
        let mut gains = Vec::new();
        while fit.faults.len() < MOST_FAULTS {
            let Some((better, gain)) = self.better(&data, &fit) else { break };
            fit = better;
            gains.push(gain);
        }
        Ok(BuildCheck { faults: fit.faults, gains, misfit: fit.misfit, sound_misfit })
    }

    /// The fit with the one more fault that explains the frame best, if it does so clearly.
    fn better(&self, data: &Data, fit: &Fit) -> Option<(Fit, f64)> {
        let model = &self.model;
        let small = screen::small(model, data, fit, &fit.impedance).into_iter();
        let mut candidates: Vec<Fault> =
            small.filter(|(gain, _)| *gain > SMALL_GAIN).map(|(_, fault)| fault).collect();
        if fit.misfit > EXPLAINED {
            candidates.extend(screen::gross(model, data, &fit.faults));
        }
        let even = vec![0.0; fit.x.len()];
        let with = |fault: Fault| {
            let mut faults = fit.faults.clone();
            faults.push(fault);
            model.fit(data, &faults, &even)
        };
        let mut fits: Vec<Fit> = candidates.into_iter().filter_map(with).collect();
        let least = fits.iter().map(|one| one.misfit).fold(fit.misfit, f64::min);
        if least > EXPLAINED {
            let cut = cut::best_cut(model, data, fit);
            fits.extend(cut.and_then(|cut| with(Fault::Cut(cut))));
        }
        if std::env::var("DEBUG").is_ok() {
            eprintln!("base {:?} misfit {:.3} E {:.1}", fit.faults, fit.misfit, fit.log_evidence);
            for one in &fits {
                eprintln!("   {:?} misfit {:.3} gain {:.1}", one.faults.last(), one.misfit, one.log_evidence - fit.log_evidence);
            }
        }
        let best = fits.into_iter().max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))?;
        let gain = (best.log_evidence - fit.log_evidence) / best.misfit.max(1.0).powi(2);
        (gain > LEAST_GAIN).then_some((best, gain))
    }
}
