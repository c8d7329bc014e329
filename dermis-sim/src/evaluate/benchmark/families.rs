//! A method on objects of other forms than a ball, on skins that differ in everything that lies under them.

use super::Benchmark;
use crate::evaluate::match_contacts;
use crate::experiment::{Family, Presses, record};
use crate::random::{log_uniform, sample_rng, uniform};
use crate::touch::TouchError;
use crate::twin::{Foam, Indentation, Press, TouchOptions, Twin, TwinOptions};
use dermis::contact::{Contact, REGION_95_SD};
use dermis::detect::Detector;
use dermis::frame::{Frame, mean};
use dermis::geom::Surface;
use dermis::stats::Summary;
use rand::RngExt;
use serde::Serialize;

/// The random stream of the skins.
const SKIN_STREAM: u64 = (1 << 61) + 2;

/// What a skin of a benchmark of families was drawn with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DrawnSkin {
    /// Pitch of the patches, m; `None` for a coat that conducts better under pressure.
    pub patches_m: Option<f64>,
    /// Thickness of the foam, m.
    pub foam_m: f64,
    /// Standard deviation of the coat's conductance over its mean.
    pub coat_rms: f64,
    /// Root mean square of the displacements of the electrodes, m.
    pub displacement_rms_m: f64,
    /// Signal-to-noise ratio of a frame, dB.
    pub snr_db: f64,
}

/// The scores of a method on one skin.
#[derive(Debug, Clone, Serialize)]
pub struct FamiliesResult {
    /// The seed of the skin.
    pub seed: u64,
    /// The skin.
    pub skin: DrawnSkin,
    /// A score for each family.
    pub families: Vec<FamilyScore>,
}

/// The score of one family of objects.
#[derive(Debug, Clone, Serialize)]
pub struct FamilyScore {
    /// The family.
    pub family: Family,
    /// Number of objects.
    pub objects: usize,
    /// Objects without a contact within the gate.
    pub misses: usize,
    /// Contacts without an object within the gate.
    pub false_positives: usize,
    /// Distances of the centres along the surface, m.
    pub localisation_m: Summary,
    /// Fraction of the matched objects in the 95 % region of their contact.
    pub covered: f64,
    /// Mean of the half lengths of the contacts over those of their objects; `NaN` (in JSON `null`) for balls.
    pub length_ratio: f64,
}

impl Benchmark<'_> {
    /// Draws a skin from a seed and scores the method on some frames of each family. The options of the twin are those of the
    /// instrument, of drift and temperature; patches, foam, coat, electrodes and noise are drawn. On a body known only by its
    /// mesh, touches are Gaussian changes of the coat.
    ///
    /// # Errors
    /// A twin that cannot be drawn or pressed; a method that fails.
    pub fn families(&self, seed: u64, count: usize, on_step: impl Fn(usize) + Sync) -> crate::Result<FamiliesResult> {
        let (options, skin) = self.drawn(seed);
        let twin = Twin::new(self.design, &options, seed)?;
        let presses = Presses::new(self.design, self.mesh, self.pixels, options.press, seed);
        let mut next_index = 0;
        let mut families = Vec::with_capacity(Family::ALL.len());
        for family in Family::ALL {
            // Gaussian touches that lower the conductance have no limit; a sheet has: presses beyond it are left out.
            let is_possible = |presses: &[Press]| {
                !matches!(twin.strength_m2(presses), Err(crate::Error::Touch(TouchError::TooStrong { .. })))
            };
            let objects = presses.of_family(family, count).into_iter().filter(|objects| is_possible(&objects.presses));
            let (pressed, truths): (Vec<_>, Vec<_>) = objects.map(|objects| (objects.presses, objects.truth)).unzip();
            let recording = record(&twin, &pressed, next_index, || on_step(1))?;
            next_index = recording.next_index;
            let rest = mean(&recording.untouched).expect("there are untouched frames");
            let untouched: Vec<Frame> = recording.untouched.iter().map(|frame| frame - &rest).collect();
            let detector = Detector::new(self.method.detection()).with_noise(self.noise(&untouched)?);
            let contacts = self.seen(&recording, &detector)?.contacts;
            families.push(FamilyScore::new(family, &self.design.body.surface(), &contacts, &truths));
        }
        Ok(FamiliesResult { seed, skin, families })
    }

    /// A twin with drawn physics.
    fn drawn(&self, seed: u64) -> (TwinOptions, DrawnSkin) {
        let mut rng = sample_rng(seed, SKIN_STREAM);
        let mut options = self.options.clone();
        let is_patched = rng.random::<f64>() < 0.75;
        let pitch_m = log_uniform(&mut rng, [4e-3, 20e-3]);
        // No tip of the families is pressed through such a foam.
        let foam = Foam {
            thickness_m: uniform(&mut rng, [1.5e-3, 4e-3]),
            modulus_pa: log_uniform(&mut rng, [1.5e5, 4e5]),
            indentation: Indentation::Foundation,
        };
        let name = if is_patched { "lab" } else { "lab-c" };
        options.touch = TwinOptions::shipped(name).expect("a shipped twin").touch;
        let mut patches_m = None;
        match &mut options.touch {
            TouchOptions::Patches(patches) => {
                if let Some(size) = self.design.body.chart().map(|chart| chart.size_m()) {
                    let [columns, rows] = size.map(|size_m| (size_m / pitch_m).round().max(1.0));
                    (patches.rows, patches.columns) = (rows as usize, columns as usize);
                    patches_m = Some(pitch_m);
                }
                patches.foam = foam;
            }
            TouchOptions::Layer(layer) => layer.foam = foam,
            TouchOptions::Gaussian(_) => {}
        }
        options.coat.rms = uniform(&mut rng, [0.0, 0.3]);
        options.coat.correlation_m = log_uniform(&mut rng, [20e-3, 80e-3]);
        options.electrodes.displacement_rms_m = uniform(&mut rng, [0.0, 1.5e-3]);
        let snr_db = uniform(&mut rng, [40.0, 90.0]);
        options.electronics.snr_db = Some(snr_db);
        options.electronics.adc = None;
        let skin = DrawnSkin {
            patches_m,
            foam_m: foam.thickness_m,
            coat_rms: options.coat.rms,
            displacement_rms_m: options.electrodes.displacement_rms_m,
            snr_db,
        };
        (options, skin)
    }
}

impl FamilyScore {
    fn new(family: Family, surface: &Surface, contacts: &[Vec<Contact>], truths: &[Vec<Contact>]) -> Self {
        let (mut misses, mut false_positives, mut inside) = (0, 0, 0);
        let (mut distances, mut lengths) = (Vec::new(), Vec::new());
        for (contacts, objects) in contacts.iter().zip(truths) {
            let found = match_contacts(objects, contacts, surface);
            misses += found.missed.len();
            false_positives += found.false_positives.len();
            distances.extend(found.pairs.iter().map(|pair| pair.2));
            let is_inside = |pair: &&(usize, usize, f64)| pair.2 <= REGION_95_SD * contacts[pair.1].sd_m;
            inside += found.pairs.iter().filter(is_inside).count();
            let ratio = |&(object, contact, _): &(usize, usize, f64)| {
                contacts[contact].half_length_m / objects[object].half_length_m
            };
            lengths.extend(found.pairs.iter().map(ratio).filter(|ratio| ratio.is_finite()));
        }
        FamilyScore {
            family,
            objects: truths.iter().map(Vec::len).sum(),
            misses,
            false_positives,
            localisation_m: Summary::of(&distances),
            covered: inside as f64 / distances.len() as f64,
            length_ratio: dermis::stats::mean(&lengths),
        }
    }
}
