//! The networks that are trained by name, and what each is trained with.

use crate::card::{Card, DataRecord, SkinRecord, TrainingRecord};
use crate::input::Input;
use crate::network::Plan;
use crate::samples::{Noise, Target};
use crate::symmetry::Symmetries;
use crate::train::{Schedule, TrainOptions};
use dermis::dataset::Dataset;
use dermis::design::SkinDesign;
use dermis::detect::DetectOptions;
use dermis::geom::Surface;
use dermis::image::PixelSpace;
use dermis::protocol::Protocol;

/// Channels of the pictures that the best network's convolutions take and make.
const CHANNELS: [usize; 6] = [4, 16, 16, 16, 16, 1];
/// Standard deviation of the Gaussians that its touches become, m: a pixel of the paper's skin.
const TOUCH_WIDTH_M: f64 = 0.010;

// Settled on twins with the seeds 2001 and 2002, which are never reported.
/// The lowest peak beside the highest in the paper's network's images: they have hardly a side lobe.
const PAPER_PEAK_FRACTION: f64 = 0.15;
/// The same of spots, whose squares tell forces: a touch of a sixteenth of the strongest one's force is found beside it.
const SPOT_PEAK_FRACTION: f64 = 0.06;
/// Noise in spots is next to nothing as long as nothing touches, and then seldom far more: its standard deviation says
/// little of its highest peaks.
const SPOT_NOISE_FACTOR: f64 = 100.0;

/// Everything that is settled before training begins, beside the samples.
#[derive(Debug, Clone)]
pub struct Method {
    /// For tables and cards.
    pub name: &'static str,
    /// The network.
    pub plan: Plan,
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

impl Method {
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
        Method {
            name: "paper",
            plan: Plan::paper(protocol.channel_count(), pixels.len()),
            input: Input::each(protocol),
            target: Target::Conductance,
            noise: Noise::white(noise_ohm),
            symmetries: None,
            detection: DetectOptions { peak_fraction: PAPER_PEAK_FRACTION, ..DetectOptions::default() },
            options: TrainOptions::default(),
        }
    }

    /// Ours: reciprocal readings averaged, a linear layer to four pictures, convolutions that wrap; the touches themselves;
    /// noise from half to four times what was measured, drift of coat and contacts; all symmetries of the skin. Where pixels
    /// fill no rectangle, dense layers stand in for the convolutions.
    pub fn best(design: &SkinDesign, protocol: &Protocol, pixels: &PixelSpace, noise_ohm: Vec<f32>) -> Self {
        let input = Input::reciprocal(protocol);
        let is_ring = matches!(pixels.surface, Surface::Cylinder { .. });
        let plan = match pixels.grid.filter(|[rows, columns]| rows * columns == pixels.len()) {
            Some(grid) => Plan::refined(input.len(), grid, is_ring, &CHANNELS),
            None => Plan::paper(input.len(), pixels.len()),
        };
        Method {
            name: "best",
            plan,
            input,
            target: Target::Touches { width_m: TOUCH_WIDTH_M },
            noise: Noise { sd_ohm: noise_ohm, factor: [0.5, 4.0], coat_drift: 0.01, contact_drift: 0.1 },
            symmetries: Some(Symmetries::of(design, protocol)),
            detection: DetectOptions {
                noise_factor: SPOT_NOISE_FACTOR,
                peak_fraction: SPOT_PEAK_FRACTION,
                spot_width_m: Some(TOUCH_WIDTH_M),
                ..DetectOptions::default()
            },
            options: TrainOptions { epochs: 20, schedule: Schedule::Cosine, ..TrainOptions::default() },
        }
    }
}
