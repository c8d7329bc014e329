//! A method whose contacts are refined on the skin that its untouched frames identify.

use crate::contact::Contact;
use crate::design::SkinDesign;
use crate::detect::{DetectOptions, Forces};
use crate::estimate::noise::{ChannelNoise, NoiseSource};
use crate::estimate::scale;
use crate::forward::{ForwardModel, Matrix};
use crate::frame::{Frame, broken_channels, contradicting_channels, disconnected_electrodes};
use crate::identify::{Identifier, IdentifyOptions};
use crate::image::PixelSpace;
use crate::reconstruct::{MIN_UNTOUCHED_FRAMES, Quantity, Reconstruct, ReconstructError};
use crate::refine::{RefineOptions, Refiner};
use crate::stats::rms;
use std::sync::{Arc, OnceLock};

/// The noise of a channel that uses a driven electrode is at least this many times that of the others: its converter
/// has a coarser step, in which the noise of a steady value may vanish.
const DRIVEN_NOISE: f64 = 2.0;
/// A skin whose misfit is larger than this is not one that the model describes: its contacts are not refined. The unit is
/// an unexplained 0.1 % of the values; a press changes them by 0.5 to 2 %. Skins of the twin `harsh` reach 2.2.
const MAX_MISFIT: f64 = 4.0;
/// The sign of an amplitude is that of the model's value where this is larger than this part of the root mean square.
const SIGN_IS_KNOWN: f64 = 0.05;
/// Part of a change that touches on the skin as designed do not explain: it has another coat than the skin.
const MISFIT_AS_DESIGNED: f64 = 0.3;
/// Force of a fitted strength, for methods that state forces: presses of 1 to 5 N on the twins `lab` with the seeds 2001
/// and 2002.
const FORCES: Forces = Forces { newtons_per_strength: 15_500.0, relative_sd: 0.33, most_n: Some(7.5) };

/// A method whose contacts are [refined](Refiner) on the skin that its untouched frames [identify](Identifier).
///
/// Before it is [adapted](Reconstruct::adapted) to untouched frames, and on a skin that the model does not describe, its
/// contacts are those of the method.
#[derive(Clone)]
pub struct Refined {
    method: Arc<dyn Reconstruct>,
    /// With the signs of the values, and its model.
    design: Arc<SkinDesign>,
    model: ForwardModel,
    /// Whether the instrument records signs.
    is_signed: bool,
    /// Prepared when it is first needed.
    identifier: Arc<OnceLock<Identifier>>,
    excluded: Vec<usize>,
    options: RefineOptions,
    refinement: Refinement,
}

#[derive(Clone)]
enum Refinement {
    /// The method has not been adapted to untouched frames.
    NotAdapted,
    /// With the factor of each channel from the instrument's values to those of the model.
    Prepared(Arc<Refiner>, Arc<[f64]>),
    /// The skin is not one that the model describes.
    Impossible { warning: String },
}

impl Refined {
    /// The refinement of a method's contacts on a skin, without some channels.
    ///
    /// # Errors
    /// A skin on which contacts cannot be refined: a volume.
    pub fn new(
        method: Arc<dyn Reconstruct>,
        design: &SkinDesign,
        model: &ForwardModel,
        excluded: Vec<usize>,
        options: RefineOptions,
    ) -> crate::Result<Self> {
        Refiner::check(model)?;
        let is_signed = !design.protocol.amplitude_only();
        // Amplitudes are given the signs of the model.
        let design = SkinDesign { protocol: design.protocol.clone().with_amplitude_only(false), ..design.clone() };
        let model = if is_signed { model.clone() } else { ForwardModel::new(&design, model.mesh())? };
        let (design, identifier) = (Arc::new(design), Arc::default());
        let refinement = Refinement::NotAdapted;
        Ok(Refined { method, design, model, identifier, is_signed, excluded, options, refinement })
    }

    fn identifier(&self) -> crate::Result<&Identifier> {
        if let Some(identifier) = self.identifier.get() {
            return Ok(identifier);
        }
        let identifier = Identifier::new(&self.design, &self.model, IdentifyOptions::default())?;
        Ok(self.identifier.get_or_init(|| identifier))
    }

    fn refinement(&self, rest: &Frame, untouched: &[Frame]) -> crate::Result<Refinement> {
        let [of_mean, sd_ohm] = self.noise_ohm(rest, untouched);
        if !self.is_signed {
            return self.of_amplitudes(rest, &sd_ohm);
        }
        let reason = match self.identifier()?.identify(rest, &of_mean) {
            Ok(skin) if skin.misfit <= MAX_MISFIT => {
                let refiner = Refiner::new(&self.design.body, skin.model(), &sd_ohm, self.options)?;
                return Ok(Refinement::Prepared(Arc::new(refiner), vec![1.0; rest.len()].into()));
            }
            Ok(skin) => format!("their misfit is {:.1}, the limit {MAX_MISFIT}", skin.misfit),
            // The search of a skin that explains other values leads to ones that cannot be solved.
            Err(error) => error.to_string(),
        };
        let warning =
            format!("contacts are not refined: no skin of the model explains the untouched frames ({reason})");
        Ok(Refinement::Impossible { warning })
    }

    /// The refinement of amplitudes, which do not identify a skin: on the skin as designed, which explains less of a change. They
    /// have the signs of the model's values, where these are known, and any unit.
    fn of_amplitudes(&self, rest: &Frame, sd_ohm: &[f64]) -> crate::Result<Refinement> {
        let model = self.model.solve(self.model.rest_conductivity())?;
        let sizes: Vec<f64> = model.iter().map(|value| value.abs()).collect();
        let least = SIGN_IS_KNOWN * rms(model.iter().copied());
        let is_known = |channel: usize| sizes[channel] > least;
        let scale = scale::robust(rest, &sizes, (0..sizes.len()).filter(|&channel| is_known(channel)));
        let factor = |channel: usize| if is_known(channel) { model[channel].signum() / scale } else { 0.0 };
        let factors: Vec<f64> = (0..sizes.len()).map(factor).collect();
        let sd_ohm: Vec<f64> = sd_ohm.iter().zip(&factors).map(|(sd, factor)| sd * factor.abs()).collect();
        let options = RefineOptions { misfit: self.options.misfit.max(MISFIT_AS_DESIGNED), ..self.options };
        let signed: Vec<f64> = rest.iter().zip(&factors).map(|(value, factor)| value * factor).collect();
        let refiner = Refiner::new(&self.design.body, &self.model, &sd_ohm, options)?.with_rest(&signed);
        Ok(Refinement::Prepared(Arc::new(refiner), factors.into()))
    }

    /// The standard deviation of each channel in the mean of the untouched frames, and in a difference from it, ohm; 0 for one that
    /// is left out, broken, constant though its noise should show, contradicts its reciprocal one, or uses a disconnected
    /// electrode, whose voltage does not settle. That of a channel at a driven electrode is at least a multiple of the others'.
    fn noise_ohm(&self, rest: &Frame, untouched: &[Frame]) -> [Vec<f64>; 2] {
        let protocol = &self.design.protocol;
        let broken = broken_channels(untouched);
        let varies = |channel: usize| untouched.iter().any(|frame| frame[channel] != 0.0);
        let may_be_used = |channel: usize| {
            let is_read = varies(channel) || rest[channel] != 0.0;
            is_read && !self.excluded.contains(&channel) && broken.binary_search(&channel).is_err()
        };
        let of = |is_used: &dyn Fn(usize) -> bool| {
            let noise = ChannelNoise::of_used(untouched, protocol, is_used);
            noise.filter(|noise| noise.source() == NoiseSource::Scatter)
        };
        let none = || vec![0.0; protocol.channel_count()];
        let Some(noise) = of(&may_be_used) else { return [none(), none()] };
        let is_used = |channel: usize| may_be_used(channel) && (varies(channel) || noise.is_hidden(channel));
        let disconnected = disconnected_electrodes(protocol, is_used);
        let contradicting = contradicting_channels(rest, untouched, protocol);
        let is_usable = |channel: usize| {
            is_used(channel)
                && contradicting.binary_search(&channel).is_err()
                && !disconnected.iter().any(|&electrode| protocol.channels()[channel].uses(electrode))
        };
        let Some(noise) = of(&is_usable) else { return [none(), none()] };
        let least = Some(DRIVEN_NOISE * noise.by_group_ohm()[0]).filter(|least| least.is_finite()).unwrap_or(0.0);
        [noise.sd_of_mean_ohm(), noise.sd_of_difference_ohm()].map(|list| {
            let sd = |(channel, sd): (usize, f64)| match protocol.channels()[channel].touches_driven() {
                _ if !sd.is_finite() => 0.0,
                true => sd * (least / noise.sd_ohm()[channel]).max(1.0),
                false => sd,
            };
            list.into_iter().enumerate().map(sd).collect()
        })
    }
}

impl Reconstruct for Refined {
    fn name(&self) -> String {
        format!("{}, refined", self.method.name())
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        self.method.pixels()
    }

    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        self.method.reconstruct_into(difference, values)
    }

    fn matrix(&self) -> Option<&Matrix> {
        self.method.matrix()
    }

    fn quantity(&self) -> Quantity {
        self.method.quantity()
    }

    fn correct(&self, difference: &[f64], contacts: &mut Vec<Contact>) {
        self.method.correct(difference, contacts);
        let Refinement::Prepared(refiner, factors) = &self.refinement else { return };
        let sign = self.design.sheet.touch.sign();
        let of_model = difference.iter().zip(factors.iter()).map(|(value, factor)| sign * value * factor);
        let edge_m = |place_m| self.pixels().edge_distance_m(place_m);
        refiner.refine_by_edges(&of_model.collect::<Vec<f64>>(), contacts, &edge_m);
        if self.method.detection().forces.is_some() {
            for contact in contacts.iter_mut().filter(|contact| contact.force_n.is_nan()) {
                [contact.force_n, contact.force_sd_n] = FORCES.of(contact.strength);
            }
        }
    }

    fn novelty(&self, difference: &[f64]) -> Option<f64> {
        self.method.novelty(difference)
    }

    fn detection(&self) -> DetectOptions {
        self.method.detection()
    }

    fn is_adaptable(&self) -> bool {
        true
    }

    fn adapted(&self, rest: &Frame, untouched: &[Frame]) -> Result<Option<Arc<dyn Reconstruct>>, ReconstructError> {
        if untouched.len() < MIN_UNTOUCHED_FRAMES {
            return Ok(None);
        }
        let refinement =
            self.refinement(rest, untouched).map_err(|error| ReconstructError::Singular(error.to_string()))?;
        Ok(Some(Arc::new(Refined { refinement, ..self.clone() })))
    }

    fn warning(&self) -> Option<&str> {
        match &self.refinement {
            Refinement::Impossible { warning } => Some(warning),
            Refinement::NotAdapted | Refinement::Prepared(..) => None,
        }
    }
}
