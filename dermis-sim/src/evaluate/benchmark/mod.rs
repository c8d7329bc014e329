//! Benchmark of a method on a digital twin: scores of the paper's experiment, and the smallest force that is detected.

mod bound;
mod coverage;
mod edges;
mod families;
mod force;
mod least_force;
mod separation;
mod summary;

pub use bound::BenchmarkBound;
pub use coverage::Covered;
pub use families::{DrawnSkin, FamiliesResult, FamilyScore};
pub use force::{FORCES_PER_POSITION, ForceScore};
pub use summary::{BenchmarkSummary, FamiliesSummary, benchmark, benchmark_families};

use crate::evaluate::score::score_contacts;
use crate::evaluate::{EvaluateError, Score};
use crate::experiment::{PaperExperiment, Presses, Recording, Sets, Sizes, truth};
use crate::random::sample_rng;
use crate::twin::TwinOptions;
use dermis::contact::Contact;
use dermis::design::SkinDesign;
use dermis::detect::{Detector, ImageNoise};
use dermis::forward::ForwardModel;
use dermis::frame::{Differences, Frame, broken_channels};
use dermis::geom::Point3;
use dermis::image::{Image, PixelSpace};
use dermis::mesh::Mesh;
use dermis::reconstruct::{Linearised, Reconstruct, WithoutChannels, image_noise};
use dermis::stats::Summary;
use least_force::{Finder, untouched_differences};
use rand::RngExt;
use rayon::prelude::*;
use serde::Serialize;

/// The random stream of the dead electrodes, separate from those of the twin.
const DEAD_STREAM: u64 = (1 << 61) + 1;

/// The extent of a benchmark.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchmarkOptions {
    /// The experiment.
    pub sizes: Sizes,
    /// Number of untouched frames from whose peaks the threshold follows.
    pub untouched: usize,
    /// The smallest force is determined at every n-th pixel.
    pub force_step: usize,
    /// Number of positions that are pressed with each force in turn.
    pub places: usize,
    /// Number of disconnected electrodes of each twin, drawn from its seed.
    pub dead_electrodes: usize,
}

impl Default for BenchmarkOptions {
    fn default() -> Self {
        BenchmarkOptions { sizes: Sizes::default(), untouched: 20_000, force_step: 1, places: 50, dead_electrodes: 0 }
    }
}

impl BenchmarkOptions {
    /// A tenth of the frames.
    pub fn quick() -> Self {
        // 7 has no common divisor with the image sizes of the shipped skins, so that all columns are used.
        let sizes = Sizes { grid_step: 7, random: 90, pairs: 20, fours: 50, ..Sizes::default() };
        BenchmarkOptions { sizes, untouched: 2000, force_step: 7, places: 10, dead_electrodes: 0 }
    }
}

/// The results of a method on one twin.
#[derive(Debug, Clone, Serialize)]
pub struct BenchmarkResult {
    /// The twin's seed.
    pub seed: u64,
    /// Presses on the grid.
    pub grid: Score,
    /// Presses at random positions, with shifted patches.
    pub random: Score,
    /// Localisation in both sets together, m.
    pub single_m: Summary,
    /// Localisation within 20 mm of an end or 15 mm of the seam, both sets together, m.
    pub rim_and_seam_m: Summary,
    /// Coverage of the stated standard deviations of positions.
    pub covered: Covered,
    /// Dependence of peaks on forces.
    pub force: ForceScore,
    /// For each distance of two touches: the distance (m) and the fraction that was resolved.
    pub two_resolved: Vec<(f64, f64)>,
    /// Four touches.
    pub four: FourScore,
    /// Standard deviations of noise that a peak exceeds once per hour on the untouched skin.
    pub noise_factor: f64,
    /// Its standard error due to the extrapolation of the tail.
    pub noise_factor_error: f64,
    /// Smallest force that is detected 90 % of the time at that threshold, for each pixel of the search, N; `NaN` if no
    /// force up to the maximum is.
    pub least_forces_n: Vec<f64>,
}

/// Four simultaneous touches.
#[derive(Debug, Clone, Serialize)]
pub struct FourScore {
    /// Number of frames.
    pub frames: usize,
    /// Fraction of the frames in which all four were detected, each within 15 mm, and no other contact.
    pub all_found: f64,
    /// Distances of the detected touches from their contacts, m.
    pub localisation_m: Summary,
    /// Number of missed touches, of four per frame.
    pub misses: usize,
    /// Number of contacts without a touch.
    pub false_positives: usize,
}

/// A method, the skin that it reconstructs, and the options of the twins, which are common to all runs.
#[derive(Clone, Copy)]
pub struct Benchmark<'a> {
    /// The skin as designed, for which the method was prepared.
    pub design: &'a SkinDesign,
    /// Its mesh, to draw positions from.
    pub mesh: &'a Mesh,
    /// The pixels of the images.
    pub pixels: &'a PixelSpace,
    /// The options of the twins.
    pub options: &'a TwinOptions,
    /// The method.
    pub method: &'a dyn Reconstruct,
    /// Its alpha, if it has one.
    pub alpha: Option<f64>,
}

impl Benchmark<'_> {
    /// Draws a twin from a seed and scores the method on it. `on_step` is called with the number of frames done since
    /// the last call, from several threads.
    ///
    /// # Errors
    /// A twin that cannot be drawn or pressed; a method that fails.
    pub fn run(
        &self,
        seed: u64,
        options: &BenchmarkOptions,
        on_step: impl Fn(usize) + Sync,
    ) -> crate::Result<BenchmarkResult> {
        let twin = self.with_dead_electrodes(seed, options.dead_electrodes)?;
        let experiment = PaperExperiment::draw(self.design, self.mesh, self.pixels, &twin, seed, &options.sizes)?;
        let recordings = experiment.record(|| on_step(1))?;
        let broken = broken_channels(&recordings.grid.untouched);
        if broken.is_empty() {
            return self.scored(seed, options, &experiment, &recordings, on_step);
        }
        let model = Linearised::new(&ForwardModel::new(self.design, self.mesh)?, self.pixels)?;
        let working = WithoutChannels::new(self.method, &model, broken)?;
        Benchmark { method: &working, ..*self }.scored(seed, options, &experiment, &recordings, on_step)
    }

    /// The results of the method for a recorded experiment.
    fn scored(
        &self,
        seed: u64,
        options: &BenchmarkOptions,
        experiment: &PaperExperiment,
        recordings: &Sets<Recording>,
        on_step: impl Fn(usize) + Sync,
    ) -> crate::Result<BenchmarkResult> {
        let surface = self.design.body.surface();
        let presses = Presses::new(self.design, self.mesh, self.pixels, self.options.press, seed);
        let fixed = presses.at_fixed_places(options.places, &force::FORCES_N);
        let (rank_correlations, peak_ratios, after) =
            force::at_fixed_places(&experiment.twin, self.method, &fixed, recordings.four.next_index, &on_step)?;
        let untouched = untouched_differences(&experiment.twin, after, options.untouched, &on_step)?;
        let noise = self.noise(&untouched)?;
        let finder = Finder { method: self.method, noise: &noise };
        let (noise_factor, noise_factor_error) = finder.threshold(&untouched)?;
        let places: Vec<Point3> = self.pixels.centres_m.iter().copied().step_by(options.force_step.max(1)).collect();
        let least_forces_n = finder.least_forces(&experiment.twin, noise_factor, &places, &on_step)?;
        let detector = Detector::new(self.method.detection()).with_noise(noise);
        let seen = recordings.try_map(|recording| self.seen(recording, &detector))?;
        let truths: Sets<Vec<Vec<Contact>>> =
            experiment.sets.map(|set| set.presses.iter().map(|frame| truth(&surface, frame)).collect());
        let scored = |seen: &Seen, truths: &[Vec<Contact>]| {
            score_contacts(&seen.images, &seen.contacts, truths, &self.method.name(), self.alpha)
        };
        let of_singles = || frames(&seen.grid, &truths.grid).chain(frames(&seen.random, &truths.random));
        let singles =
            |counts: &dyn Fn(Point3) -> bool| Summary::of(&edges::distances_m(&surface, of_singles(), counts));
        Ok(BenchmarkResult {
            seed,
            grid: scored(&seen.grid, &truths.grid)?,
            random: scored(&seen.random, &truths.random)?,
            single_m: singles(&|_| true),
            rim_and_seam_m: singles(&|place| edges::is_at_edge(&self.design.body, place)),
            covered: Covered {
                single: coverage::covered(&surface, of_singles(), 0),
                two: coverage::covered(&surface, frames(&seen.two, &truths.two), 0),
                two_as_one: coverage::covered(&surface, frames(&seen.two, &truths.two), 1),
                four: coverage::covered(&surface, frames(&seen.four, &truths.four), 0),
            },
            force: ForceScore {
                true_spread: [
                    force::true_spread(&experiment.twin, &experiment.sets.grid.presses)?,
                    force::true_spread(&experiment.shifted, &experiment.sets.random.presses)?,
                ],
                rank_correlations,
                peak_ratios,
            },
            two_resolved: separation::two_resolved(
                &surface,
                &seen.two.contacts,
                &truths.two,
                &experiment.sets.two.separations_m,
            ),
            four: separation::four(&surface, &seen.four.contacts, &truths.four),
            noise_factor,
            noise_factor_error,
            least_forces_n,
        })
    }

    /// The twin's options with some dead electrodes, drawn from a seed.
    fn with_dead_electrodes(&self, seed: u64, count: usize) -> crate::Result<TwinOptions> {
        let mut options = self.options.clone();
        let electrodes = self.design.electrodes.len();
        let dead = &mut options.faults.dead_electrodes;
        if dead.len() + count >= electrodes {
            return Err(EvaluateError::NoElectrodeLeft { dead: dead.len() + count, electrodes }.into());
        }
        let mut rng = sample_rng(seed, DEAD_STREAM);
        let most = dead.len() + count;
        while dead.len() < most {
            let electrode = rng.random_range(0..electrodes as u32) as usize;
            if !dead.contains(&electrode) {
                dead.push(electrode);
            }
        }
        Ok(options)
    }

    /// The images of a recording, and the contacts in them, by the method adapted to its untouched frames.
    fn seen(&self, recording: &Recording, detector: &Detector) -> crate::Result<Seen> {
        let Differences { frames, untouched, baseline, .. } =
            Differences::new(recording.frames.clone(), recording.untouched.clone());
        let adapted = baseline.map(|baseline| self.method.adapted(&baseline, &untouched)).transpose()?.flatten();
        let method = adapted.as_deref().unwrap_or(self.method);
        let seen = frames.par_iter().map(|difference| method.image_and_contacts(difference, detector));
        let (images, contacts) = seen.collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
        Ok(Seen { images, contacts })
    }

    /// The noise of the images: by the method's matrix from the noise of each channel, or from images of untouched
    /// frames.
    fn noise(&self, untouched: &[Frame]) -> crate::Result<ImageNoise> {
        let few = &untouched[..untouched.len().min(1000)];
        Ok(image_noise(self.method, few, &self.design.protocol)?.expect("there are untouched frames"))
    }
}

/// The results of a method for a recording.
struct Seen {
    images: Vec<Image>,
    contacts: Vec<Vec<Contact>>,
}

/// The contacts of each frame with its true touches.
fn frames<'a>(
    seen: &'a Seen,
    truths: &'a [Vec<Contact>],
) -> impl Iterator<Item = (&'a Vec<Contact>, &'a Vec<Contact>)> {
    seen.contacts.iter().zip(truths)
}

impl BenchmarkResult {
    /// The smallest distance such that at least 90 % of all pairs are resolved at this and every greater tested
    /// distance, m; `NaN` if there is none.
    pub fn resolved_from_m(&self) -> f64 {
        separation::resolved_from_m(&self.two_resolved)
    }

    /// The fraction of the pairs that was resolved at a tested distance (m), `NaN` at any other.
    pub fn resolved_at(&self, separation_m: f64) -> f64 {
        separation::resolved_at(&self.two_resolved, separation_m)
    }

    /// Median and 95th percentile over the positions of the smallest detected force, N; a position without one counts
    /// as infinite.
    pub fn least_force_n(&self) -> [f64; 2] {
        least_force::median_and_p95(&self.least_forces_n)
    }
}
