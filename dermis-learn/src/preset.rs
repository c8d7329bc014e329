//! Training presets: architecture, inputs, target, augmentation and schedule of each network by name.

use crate::card::{Card, DataRecord, SkinRecord, TrainingRecord};
use crate::input::Input;
use crate::network::{Architecture, LayerSpec};
use crate::samples::{DomainRandomization, Noise, Target};
use crate::symmetry::Symmetries;
use crate::train::{Schedule, TrainOptions};
use dermis::design::SkinDesign;
use dermis::detect::DetectOptions;
use dermis::geom::Surface;
use dermis::image::PixelSpace;
use dermis::protocol::Protocol;
use dermis_sim::dataset::Dataset;

/// Channels of the pictures that the best network's convolutions take and make.
const CHANNELS: [usize; 6] = [4, 16, 16, 16, 16, 1];
/// Standard deviation of the Gaussians that its touches become, m: a pixel of the paper's skin.
const TOUCH_WIDTH_M: f64 = 0.010;

/// Values of each hidden layer of the network of shapes.
const HIDDEN: usize = 256;

// Settled on twins with the seeds 2001 and 2002, which are never reported.
/// The lowest peak beside the highest in the paper's network's images: they have hardly a side lobe.
const PAPER_PEAK_FRACTION: f64 = 0.15;
/// The same of spots, whose squares tell forces: a touch of a sixteenth of the strongest one's force is found beside it.
const SPOT_PEAK_FRACTION: f64 = 0.06;
// Noise in a network's images is next to nothing as long as nothing touches, and then, once an hour at 120 frames a second, many
// of its standard deviations high: 84 in the paper's, 32 in touches.
/// A contact's least height in images of the change of conductance, in standard deviations.
const PAPER_NOISE_FACTOR: f64 = 100.0;
/// The same in images of touches.
const TOUCH_NOISE_FACTOR: f64 = 50.0;

/// Parts of the best network that the paper's lacks, to be left out one by one in an ablation study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ablation {
    /// Readings that are the same by reciprocity are averaged; without it each is an input.
    Reciprocity,
    /// Convolutions make the image of pictures; without them the paper's dense layers make it.
    Refinement,
    /// The target is touches; without it the change of conductance, as the paper's, and no symmetries, which move touches.
    Touches,
    /// Samples are moved by the skin's symmetries; without it they stay where they are.
    Symmetries,
    /// Noise varies, coat and contacts drift; without it noise is white and as it was measured.
    Disturbance,
}

/// Everything that is settled before training begins, beside the samples.
#[derive(Debug, Clone)]
pub struct TrainingPreset {
    /// For tables and cards.
    pub name: &'static str,
    /// The network.
    pub plan: Architecture,
    /// What it takes.
    pub input: Input,
    /// What it makes.
    pub target: Target,
    /// What disturbs it.
    pub noise: Noise,
    /// By what movements samples are multiplied.
    pub symmetries: Option<Symmetries>,
    /// How contacts are found in its images.
    pub detection: DetectOptions,
    /// How it is trained.
    pub options: TrainOptions,
}

impl TrainingPreset {
    /// The card of the network that came of it.
    pub fn card(&self, skin: SkinRecord, input: &Input, data: &[Dataset], training: TrainingRecord) -> Card {
        let record = |dataset: &Dataset| DataRecord {
            identity: dataset.manifest().identity.clone(),
            recipe: dataset.manifest().record.recipe.clone(),
        };
        Card {
            format: Card::FORMAT.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            name: self.name.into(),
            skin,
            plan: self.plan.clone(),
            input: input.clone(),
            target: self.target,
            noise: self.noise.clone(),
            symmetries: self.symmetries.as_ref().map_or(1, Symmetries::len),
            detection: self.detection.clone(),
            data: data.iter().map(record).collect(),
            training,
        }
    }

    /// The paper's: four dense layers, the image of the change of conductance, white noise as it was measured.
    pub fn paper(protocol: &Protocol, pixels: &PixelSpace, noise_ohm: Vec<f32>) -> Self {
        TrainingPreset {
            name: "paper",
            plan: Architecture::paper(protocol.channel_count(), pixels.len()),
            input: Input::each(protocol),
            target: Target::Conductance,
            noise: Noise::white(noise_ohm),
            symmetries: None,
            detection: conductance_detection(),
            options: TrainOptions::default(),
        }
    }

    /// The paper's by its other reading: [`Architecture::paper_otherwise`].
    pub fn paper_otherwise(protocol: &Protocol, pixels: &PixelSpace, noise_ohm: Vec<f32>) -> Self {
        let plan = Architecture::paper_otherwise(protocol.channel_count(), pixels.len());
        TrainingPreset { name: "paper-otherwise", plan, ..Self::paper(protocol, pixels, noise_ohm) }
    }

    /// Ours: reciprocal readings averaged, a linear layer to four pictures, convolutions that wrap; the touches themselves;
    /// noise from half to four times what was measured, drift of coat and contacts; all symmetries of the skin. Where pixels
    /// fill no rectangle, dense layers stand in for the convolutions.
    pub fn best(design: &SkinDesign, protocol: &Protocol, pixels: &PixelSpace, noise_ohm: Vec<f32>) -> Self {
        Self::best_without(&[], design, protocol, pixels, noise_ohm)
    }

    /// The same with some of what sets it apart left out.
    pub fn best_without(
        without: &[Ablation],
        design: &SkinDesign,
        protocol: &Protocol,
        pixels: &PixelSpace,
        noise_ohm: Vec<f32>,
    ) -> Self {
        let with = |ablation| !without.contains(&ablation);
        let input = if with(Ablation::Reciprocity) { Input::reciprocal(protocol) } else { Input::each(protocol) };
        let is_ring = matches!(pixels.surface, Surface::Cylinder { .. });
        let picture = pixels.grid.filter(|[rows, columns]| rows * columns == pixels.len());
        let plan = match picture.filter(|_| with(Ablation::Refinement)) {
            Some(grid) => Architecture::refined(input.len(), grid, is_ring, &CHANNELS),
            None => Architecture::paper(input.len(), pixels.len()),
        };
        let (target, detection) = match with(Ablation::Touches) {
            true => (Target::Touches { width_m: TOUCH_WIDTH_M }, touch_detection()),
            false => (Target::Conductance, conductance_detection()),
        };
        let noise = match with(Ablation::Disturbance) {
            true => Noise { sd_ohm: noise_ohm, factor: [0.5, 4.0], coat_drift: 0.01, contact_drift: 0.1, misfit: None },
            false => Noise::white(noise_ohm),
        };
        TrainingPreset {
            name: "best",
            plan,
            input,
            target,
            noise,
            // They move touches, not images of conductance.
            symmetries: (with(Ablation::Symmetries) && with(Ablation::Touches))
                .then(|| Symmetries::of(design, protocol)),
            detection,
            options: TrainOptions { epochs: 20, schedule: Schedule::Cosine, ..TrainOptions::default() },
        }
    }

    /// For skins of which neither the instrument's unit nor its noise nor the membrane's physics is known: the shape of a
    /// frame alone, twins averaged; small dense layers; touches of which only the shares are learned; in place of an
    /// instrument's noise what the simulation misses, generously ([`DomainRandomization::usual`]).
    pub fn shapes(protocol: &Protocol, pixels: &PixelSpace) -> Self {
        let input = Input::shapes(protocol);
        let layer = |inputs, outputs, relu| LayerSpec::Dense { inputs, outputs, relu };
        let trunk =
            vec![layer(input.len(), HIDDEN, true), layer(HIDDEN, HIDDEN, true), layer(HIDDEN, pixels.len(), false)];
        let none = Noise::white(vec![0.0; protocol.channel_count()]);
        TrainingPreset {
            name: "shapes",
            plan: Architecture { trunk, refinement: None },
            input,
            target: Target::Touches { width_m: TOUCH_WIDTH_M },
            noise: Noise { misfit: Some(DomainRandomization::usual()), ..none },
            symmetries: None,
            detection: DetectOptions::default(),
            options: TrainOptions { epochs: 8, schedule: Schedule::Cosine, ..TrainOptions::default() },
        }
    }
}

/// How contacts are found in images of the change of conductance.
fn conductance_detection() -> DetectOptions {
    DetectOptions { noise_factor: PAPER_NOISE_FACTOR, peak_fraction: PAPER_PEAK_FRACTION, ..DetectOptions::default() }
}

/// How contacts are found in images of touches.
fn touch_detection() -> DetectOptions {
    DetectOptions {
        noise_factor: TOUCH_NOISE_FACTOR,
        peak_fraction: SPOT_PEAK_FRACTION,
        spot_width_m: Some(TOUCH_WIDTH_M),
        ..DetectOptions::default()
    }
}
