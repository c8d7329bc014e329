//! The indentation experiment of the paper's section IV, and extensions of it.

use super::{PressSet, Presses, Recording, record};
use crate::random::sample_rng;
use crate::twin::{TouchOptions, Twin, TwinOptions};
use dermis::design::SkinDesign;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use rand::RngExt;

/// The random stream of the patches' phase; presses have low ones, twins the last ones.
const PHASE_STREAM: u64 = 1 << 61;

/// The number of frames of each kind in an experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Sizes {
    /// Every n-th pixel of the grid is pressed; 0: none.
    pub grid_step: usize,
    /// Number of single presses at random positions.
    pub random: usize,
    /// Distances of two touches, m.
    pub separations_m: Vec<f64>,
    /// Number of pairs at each distance.
    pub pairs: usize,
    /// Number of frames of several touches.
    pub fours: usize,
    /// Touches of each of these frames.
    pub touches: usize,
    /// Minimum distance of these touches from each other, m.
    pub apart_m: f64,
}

impl Default for Sizes {
    /// The whole grid, as many random presses as the paper's grid has (900), 200 pairs at every 5 mm from 10 to 80 mm,
    /// and 500 sets of four at least 60 mm apart.
    fn default() -> Self {
        let separations_m = (2..=16).map(|step| f64::from(step) * 0.005).collect();
        Sizes { grid_step: 1, random: 900, separations_m, pairs: 200, fours: 500, touches: 4, apart_m: 0.06 }
    }
}

/// The sets of one experiment, and their twins.
#[derive(Debug)]
pub struct PaperExperiment {
    /// The twin.
    pub twin: Twin,
    /// The same skin with its patches shifted by a random fraction of their pitch, for the presses at random positions.
    pub(crate) shifted: Twin,
    /// The presses.
    pub sets: Sets<PressSet>,
}

/// One value for each set of presses.
#[derive(Debug, Clone, PartialEq)]
pub struct Sets<T> {
    /// For single presses at the pixel centres.
    pub grid: T,
    /// For single presses at random positions, with shifted patches.
    pub random: T,
    /// For two simultaneous presses.
    pub two: T,
    /// For several simultaneous presses, four as given.
    pub four: T,
}

impl<T> Sets<T> {
    /// All of them, in the order of time.
    pub fn iter(&self) -> impl Iterator<Item = &T> {
        [&self.grid, &self.random, &self.two, &self.four].into_iter()
    }

    /// The results of a function for each of them.
    pub(crate) fn map<'a, U>(&'a self, mut function: impl FnMut(&'a T) -> U) -> Sets<U> {
        let Ok(sets) = self.try_map(|one| Ok::<U, std::convert::Infallible>(function(one)));
        sets
    }

    /// The results of a function for each of them, in the order of time.
    ///
    /// # Errors
    /// The errors of the function.
    pub(crate) fn try_map<'a, U, E>(&'a self, mut function: impl FnMut(&'a T) -> Result<U, E>) -> Result<Sets<U>, E> {
        let Sets { grid, random, two, four } = self;
        Ok(Sets { grid: function(grid)?, random: function(random)?, two: function(two)?, four: function(four)? })
    }
}

impl PaperExperiment {
    /// Draws the twins and the presses; they depend only on the seed.
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
        let sets = Sets {
            grid: presses.on_grid(sizes.grid_step),
            random: presses.at_random(sizes.random),
            two: presses.in_pairs(&sizes.separations_m, sizes.pairs),
            four: presses.apart(sizes.touches, sizes.apart_m, sizes.fours),
        };
        let twin = Twin::new(design, options, seed)?;
        let mut shifted = twin.options().clone();
        if let TouchOptions::Patches(patches) = &mut shifted.touch {
            let pitch_m = patches.on_body(&design.body)?.pitch_m();
            let mut rng = sample_rng(seed, PHASE_STREAM);
            patches.offset_m = pitch_m.map(|pitch| pitch * rng.random::<f64>());
        }
        let shifted = Twin::new(design, &shifted, seed)?;
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
    pub fn record(&self, on_frame: impl Fn() + Sync) -> crate::Result<Sets<Recording>> {
        let mut next_index = 0;
        self.sets.try_map(|set| {
            let twin = if std::ptr::eq(set, &self.sets.random) { &self.shifted } else { &self.twin };
            let recording = record(twin, &set.presses, next_index, &on_frame)?;
            next_index = recording.next_index;
            Ok(recording)
        })
    }
}
