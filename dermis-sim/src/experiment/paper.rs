//! The indentation experiment of the paper's section IV, and what goes beyond it.

use super::{PressSet, Presses, Recording, record};
use crate::random::sample_rng;
use crate::twin::{TouchOptions, Twin, TwinOptions};
use dermis::design::SkinDesign;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use rand::RngExt;

/// The random stream of the patches' phase; presses have low ones, twins the last ones.
const PHASE_STREAM: u64 = 1 << 61;

/// How many frames of each kind an experiment has.
#[derive(Debug, Clone, PartialEq)]
pub struct Sizes {
    /// Every so manyth pixel of the grid is pressed.
    pub grid_step: usize,
    /// Single presses at random places.
    pub random: usize,
    /// Distances of two touches, m.
    pub separations_m: Vec<f64>,
    /// Pairs at each distance.
    pub pairs: usize,
    /// Frames of four touches, each at least [`FOUR_APART_M`] from the others.
    pub fours: usize,
}

/// Least distance of four touches from each other, m.
pub const FOUR_APART_M: f64 = 0.06;

impl Default for Sizes {
    /// The whole grid, as many presses at random as the paper's grid has (900), 200 pairs at every 5 mm from 10 to 80 mm,
    /// and 500 times four.
    fn default() -> Self {
        let separations_m = (2..=16).map(|step| f64::from(step) * 0.005).collect();
        Sizes { grid_step: 1, random: 900, separations_m, pairs: 200, fours: 500 }
    }
}

/// The sets of one experiment, and the twins that they are pressed on.
#[derive(Debug)]
pub struct PaperExperiment {
    /// The twin.
    pub twin: Twin,
    /// The same skin with its patches shifted by a random part of their pitch, for the presses at random places.
    pub shifted: Twin,
    /// The presses: grid, random, two, four.
    pub sets: [PressSet; 4],
}

impl PaperExperiment {
    /// Draws the twins and the presses; all of it depends on the seed alone.
    ///
    /// # Errors
    /// As [`Twin::new`].
    pub fn draw(
        design: &SkinDesign,
        mesh: &Mesh,
        pixels: &PixelSpace,
        options: &TwinOptions,
        seed: u64,
        sizes: &Sizes,
    ) -> crate::Result<Self> {
        let presses = Presses::new(design, mesh, pixels, options.press, seed);
        let sets = [
            presses.on_grid(sizes.grid_step),
            presses.at_random(sizes.random),
            presses.in_pairs(&sizes.separations_m, sizes.pairs),
            presses.apart(4, FOUR_APART_M, sizes.fours),
        ];
        let mut shifted = options.clone();
        if let TouchOptions::Patches(patches) = &mut shifted.touch {
            let pitch_m = patches.on_body(&design.body)?.pitch_m();
            let mut rng = sample_rng(seed, PHASE_STREAM);
            patches.offset_m = pitch_m.map(|pitch| pitch * rng.random::<f64>());
        }
        let (twin, shifted) = (Twin::new(design, options, seed)?, Twin::new(design, &shifted, seed)?);
        Ok(PaperExperiment { twin, shifted, sets })
    }

    /// Number of frames with a press.
    pub fn frame_count(&self) -> usize {
        self.sets.iter().map(|set| set.presses.len()).sum()
    }

    /// Records all sets, one after the other. `on_frame` is called after every frame, from several threads.
    ///
    /// # Errors
    /// As [`record`].
    pub fn record(&self, on_frame: impl Fn() + Sync) -> crate::Result<[Recording; 4]> {
        let mut next_index = 0;
        let mut one = |number: usize| {
            let twin = if self.sets[number].name == "random" { &self.shifted } else { &self.twin };
            let recording = record(twin, &self.sets[number].presses, next_index, &on_frame)?;
            next_index = recording.next_index;
            Ok::<Recording, crate::Error>(recording)
        };
        Ok([one(0)?, one(1)?, one(2)?, one(3)?])
    }
}
