//! A method on a twin: the paper's experiment scored, and the smallest force that is found.

use super::statistics::{Summary, mean_and_sd};
use super::{Score, match_contacts, resolves_two, score};
use crate::contact::Contact;
use crate::design::SkinDesign;
use crate::detect::{DetectOptions, Detector, GATE_M, ImageNoise};
use crate::experiment::{PaperExperiment, Recording, Sizes, truth};
use crate::frame::{Frame, mean};
use crate::geom::{Point3, Surface};
use crate::image::{Image, PixelSpace};
use crate::mesh::Mesh;
use crate::reconstruct::Reconstruct;
use crate::twin::{Press, Twin, TwinOptions};
use rayon::prelude::*;
use serde::Serialize;

/// One false contact an hour at 120 frames a second.
pub const FALSE_CONTACTS_A_FRAME: f64 = 1.0 / (3600.0 * 120.0);
/// The part of the untouched frames, those with the highest peaks, whose tail is continued.
const TAIL: f64 = 0.01;
/// A contact whose peak lies this many standard deviations above the threshold is found 90 % of the time (the 90 % quantile
/// of a normal deviate).
const FOUND_SD: f64 = 1.281_551_565_544_6;
/// Forces between which the smallest one is sought, N; halvings of their ratio.
const FORCES_N: [f64; 2] = [1e-3, 7.0];
const HALVINGS: usize = 12;
/// A rim is this wide, and a seam reaches this far to both sides, m.
const RIM_M: f64 = 0.02;
const SEAM_M: f64 = 0.015;

/// How large an assessment is.
#[derive(Debug, Clone, PartialEq)]
pub struct AssessOptions {
    /// The experiment.
    pub sizes: Sizes,
    /// Untouched frames from whose peaks the threshold follows.
    pub untouched: usize,
    /// The smallest force is sought at every so manyth pixel.
    pub force_step: usize,
}

impl Default for AssessOptions {
    fn default() -> Self {
        AssessOptions { sizes: Sizes::default(), untouched: 20_000, force_step: 1 }
    }
}

/// How a method does on one twin.
#[derive(Debug, Clone, Serialize)]
pub struct Assessment {
    /// The twin's seed.
    pub seed: u64,
    /// Presses on the grid.
    pub grid: Score,
    /// Presses at random places, the patches shifted.
    pub random: Score,
    /// Localisation within 20 mm of an end or 15 mm of the seam, both sets together, m.
    pub rim_and_seam_m: Summary,
    /// For each distance of two touches: the distance (m) and the part that was resolved.
    pub two_resolved: Vec<(f64, f64)>,
    /// Four touches.
    pub four: FourScore,
    /// Standard deviations of noise above which a peak is taken for a contact once an hour on the untouched skin.
    pub noise_factor: f64,
    /// Its standard error, from continuing the tail.
    pub noise_factor_error: f64,
    /// Smallest force that is found 90 % of the time at that threshold, for each pixel at which it was sought, N; `NaN`
    /// where no force up to the greatest sought is.
    pub least_forces_n: Vec<f64>,
}

/// Four touches at once.
#[derive(Debug, Clone, Serialize)]
pub struct FourScore {
    /// Frames.
    pub frames: usize,
    /// Part of the frames in which all four were found, each within 15 mm, and nothing else.
    pub all_found: f64,
    /// Distances of the touches that were found, m.
    pub localisation_m: Summary,
    /// Touches that were missed, of four a frame.
    pub misses: usize,
    /// Contacts where nothing touched.
    pub ghosts: usize,
}

/// A method, the skin that it reconstructs, and the twin's file: what assessments share.
#[derive(Clone, Copy)]
pub struct Assessor<'a> {
    /// The skin as designed; the method knows no other.
    pub design: &'a SkinDesign,
    /// Its mesh, to draw places from.
    pub mesh: &'a Mesh,
    /// The pixels of the images.
    pub pixels: &'a PixelSpace,
    /// What twins are drawn from.
    pub options: &'a TwinOptions,
    /// The method.
    pub method: &'a dyn Reconstruct,
    /// Its alpha, where it has one.
    pub alpha: Option<f64>,
}

impl Assessor<'_> {
    /// Draws a twin from a seed and assesses the method on it. `on_step` is called with the number of frames done since the
    /// last call, from several threads.
    ///
    /// # Errors
    /// A twin that cannot be drawn or pressed; a method that fails.
    pub fn assess(
        &self,
        seed: u64,
        options: &AssessOptions,
        on_step: impl Fn(usize) + Sync,
    ) -> crate::Result<Assessment> {
        let experiment =
            PaperExperiment::draw(self.design, self.mesh, self.pixels, self.options, seed, &options.sizes)?;
        let recordings = experiment.record(|| on_step(1))?;
        let surface = self.design.body.surface();
        let sets = experiment.sets.iter().zip(&recordings);
        let truths: Vec<Vec<Vec<Contact>>> =
            sets.clone().map(|(set, _)| set.presses.iter().map(|frame| truth(&surface, frame)).collect()).collect();
        let after = recordings[3].next_index;
        let untouched = untouched_differences(&experiment.twin, after, options.untouched, &on_step)?;
        let noise = self.noise(&untouched)?;
        let detector = Detector::new(self.method.detection()).with_noise(noise.clone());
        let images: Vec<Vec<Image>> = recordings.iter().map(|one| self.images(one)).collect::<crate::Result<_>>()?;
        let single = |set: usize| score(&images[set], &truths[set], &detector, &self.method.name(), self.alpha);
        let (noise_factor, noise_factor_error) = threshold(&self.peaks(&untouched, &noise)?);
        let least_forces_n = self.least_forces(&experiment.twin, &noise, noise_factor, options.force_step, &on_step)?;
        Ok(Assessment {
            seed,
            grid: single(0)?,
            random: single(1)?,
            rim_and_seam_m: rim_and_seam(self.design, &detector, &images[..2], &truths[..2]),
            two_resolved: two_resolved(&surface, &detector, &images[2], &truths[2], &experiment.sets[2].separations_m),
            four: four(&surface, &detector, &images[3], &truths[3]),
            noise_factor,
            noise_factor_error,
            least_forces_n,
        })
    }

    fn images(&self, recording: &Recording) -> crate::Result<Vec<Image>> {
        let image = |frame: &Frame| Ok(self.method.reconstruct(&(frame - &recording.baseline))?);
        recording.frames.par_iter().map(image).collect()
    }

    /// The noise of the images: by the method's matrix from that of each channel, or from images of untouched frames.
    fn noise(&self, untouched: &[Frame]) -> crate::Result<ImageNoise> {
        let few = &untouched[..untouched.len().min(1000)];
        match self.method.matrix() {
            Some(matrix) => {
                let square = |channel: usize| few.iter().map(|frame| frame[channel] * frame[channel]).sum::<f64>();
                let sd: Vec<f64> =
                    (0..matrix.columns).map(|channel| (square(channel) / few.len() as f64).sqrt()).collect();
                Ok(ImageNoise::from_matrix(matrix, &sd))
            }
            None => {
                let images = few.iter().map(|frame| self.method.reconstruct(frame)).collect::<Result<Vec<_>, _>>()?;
                Ok(ImageNoise::from_untouched(&images).expect("there are untouched frames"))
            }
        }
    }

    /// The highest peak of each difference that could be a contact, in standard deviations of its pixel's noise.
    fn peaks(&self, differences: &[Frame], noise: &ImageNoise) -> crate::Result<Vec<f64>> {
        let detection = self.method.detection();
        let highest = |frame: &Frame| Ok(in_sd(&self.method.reconstruct(frame)?, noise, &detection, |_| true));
        differences.par_iter().map(highest).collect()
    }

    /// The smallest force found 90 % of the time in the middle of every `step`-th pixel.
    fn least_forces(
        &self,
        twin: &Twin,
        noise: &ImageNoise,
        noise_factor: f64,
        step: usize,
        on_step: &(impl Fn(usize) + Sync),
    ) -> crate::Result<Vec<f64>> {
        let (rest, detection) = (twin.clean(&[])?, self.method.detection());
        let surface = self.design.body.surface();
        let places: Vec<Point3> = self.pixels.centres_m.iter().copied().step_by(step.max(1)).collect();
        let least = |&centre_m: &Point3| {
            let is_found = |force_n: f64| {
                let press = Press { centre_m, force_n, tip_radius_m: twin.options().press.tip_radius_m };
                let image = self.method.reconstruct(&(&twin.clean(&[press])? - &rest))?;
                let near = |pixel: usize| surface.distance_m(self.pixels.centres_m[pixel], centre_m) <= GATE_M;
                Ok::<bool, crate::Error>(in_sd(&image, noise, &detection, near) >= noise_factor + FOUND_SD)
            };
            let force_n = smallest(is_found)?;
            on_step(1);
            Ok(force_n)
        };
        places.par_iter().map(least).collect()
    }
}

/// The smallest force for which something holds, by halving the ratio of two; `NaN` where it holds for none.
fn smallest(holds: impl Fn(f64) -> crate::Result<bool>) -> crate::Result<f64> {
    let [mut low, mut high] = FORCES_N;
    if !holds(high)? {
        return Ok(f64::NAN);
    }
    for _ in 0..HALVINGS {
        let middle = (low * high).sqrt();
        if holds(middle)? { high = middle } else { low = middle }
    }
    Ok(high)
}

/// The highest value of an image over its noise among some pixels that the detector's shares would let pass.
fn in_sd(image: &Image, noise: &ImageNoise, detection: &DetectOptions, counts: impl Fn(usize) -> bool) -> f64 {
    let highest = image.values.iter().copied().fold(0.0, f64::max);
    let least = detection.peak_fraction * highest;
    let pixels = image.values.iter().zip(noise.sd()).enumerate();
    pixels
        .filter(|(pixel, (value, _))| **value >= least && counts(*pixel))
        .map(|(_, (value, sd))| value / sd)
        .fold(0.0, f64::max)
}

/// Differences of untouched frames from the mean of the hundred before them.
fn untouched_differences(
    twin: &Twin,
    first_index: u64,
    count: usize,
    on_step: &(impl Fn(usize) + Sync),
) -> crate::Result<Vec<Frame>> {
    let before = crate::experiment::UNTOUCHED_FRAMES;
    let frame = |index: u64| {
        on_step(1);
        twin.frame(&[], first_index + index)
    };
    let frames = (0..before + count as u64).into_par_iter().map(frame).collect::<crate::Result<Vec<Frame>>>()?;
    let (first, rest) = frames.split_at(before as usize);
    let baseline = mean(first).expect("there are untouched frames");
    Ok(rest.iter().map(|frame| frame - &baseline).collect())
}

/// The peak that an untouched frame exceeds once an hour, and its standard error: beyond a high quantile the tail of a
/// distribution like this falls exponentially (peaks over threshold: Pickands, 1975, DOI 10.1214/aos/1176343003, with
/// shape 0, the limit of normal maxima, from which it deviates upwards).
fn threshold(peaks: &[f64]) -> (f64, f64) {
    let mut sorted = peaks.to_vec();
    sorted.sort_by(f64::total_cmp);
    let count = ((sorted.len() as f64 * TAIL).round() as usize).clamp(1, sorted.len());
    let begin = sorted[sorted.len() - count];
    let (excess, _) = mean_and_sd(&sorted[sorted.len() - count..].iter().map(|peak| peak - begin).collect::<Vec<_>>());
    let part = count as f64 / sorted.len() as f64;
    let further = (part / FALSE_CONTACTS_A_FRAME).ln().max(0.0);
    (begin + excess * further, excess * further / (count as f64).sqrt())
}

fn rim_and_seam(
    design: &SkinDesign,
    detector: &Detector,
    images: &[Vec<Image>],
    truths: &[Vec<Vec<Contact>>],
) -> Summary {
    let surface = design.body.surface();
    let is_at_edge = |place: Point3| {
        let at_seam = match (surface, surface.theta_rad(place)) {
            (Surface::Cylinder { radius_m, .. }, Some(theta)) => {
                radius_m * theta.min(std::f64::consts::TAU - theta) <= SEAM_M
            }
            _ => false,
        };
        at_seam || design.body.edge_distance_m(place).is_some_and(|distance_m| distance_m <= RIM_M)
    };
    let mut distances = Vec::new();
    for (image, touches) in images.iter().flatten().zip(truths.iter().flatten()) {
        if touches.iter().any(|touch| is_at_edge(touch.position_m)) {
            let found = match_contacts(touches, &detector.detect(image), &surface);
            distances.extend(found.pairs.iter().map(|pair| pair.2));
        }
    }
    Summary::of(&distances)
}

fn two_resolved(
    surface: &Surface,
    detector: &Detector,
    images: &[Image],
    truths: &[Vec<Contact>],
    separations_m: &[f64],
) -> Vec<(f64, f64)> {
    let mut steps: Vec<(f64, usize, usize)> = Vec::new();
    for ((image, touches), &separation_m) in images.iter().zip(truths).zip(separations_m) {
        let [a, b] = touches[..] else { continue };
        let resolved = usize::from(resolves_two(&[a, b], &detector.detect(image), surface));
        match steps.last_mut() {
            Some(step) if step.0 == separation_m => (step.1, step.2) = (step.1 + resolved, step.2 + 1),
            _ => steps.push((separation_m, resolved, 1)),
        }
    }
    steps.into_iter().map(|(separation_m, resolved, count)| (separation_m, resolved as f64 / count as f64)).collect()
}

fn four(surface: &Surface, detector: &Detector, images: &[Image], truths: &[Vec<Contact>]) -> FourScore {
    const NEAR_M: f64 = 0.015;
    let (mut all, mut misses, mut ghosts, mut distances) = (0, 0, 0, Vec::new());
    for (image, touches) in images.iter().zip(truths) {
        let found = match_contacts(touches, &detector.detect(image), surface);
        let near = found.pairs.len() == touches.len() && found.pairs.iter().all(|pair| pair.2 <= NEAR_M);
        all += usize::from(near && found.ghosts.is_empty());
        misses += found.missed.len();
        ghosts += found.ghosts.len();
        distances.extend(found.pairs.iter().map(|pair| pair.2));
    }
    let all_found = all as f64 / images.len().max(1) as f64;
    FourScore { frames: images.len(), all_found, localisation_m: Summary::of(&distances), misses, ghosts }
}

impl Assessment {
    /// The smallest distance from which on at least 90 % of all pairs are resolved, at this distance and every greater one
    /// that was tried, m; `NaN` without one.
    pub fn resolved_from_m(&self) -> f64 {
        let good = self.two_resolved.iter().rev().take_while(|(_, part)| *part >= 0.9);
        good.last().map_or(f64::NAN, |(separation_m, _)| *separation_m)
    }

    /// The part of the pairs that was resolved at a distance (m) that was tried, `NaN` at any other.
    pub fn resolved_at(&self, separation_m: f64) -> f64 {
        let tried = self.two_resolved.iter().find(|(tried_m, _)| (tried_m - separation_m).abs() < 1e-6);
        tried.map_or(f64::NAN, |(_, part)| *part)
    }

    /// Median and 95th percentile over the places of the smallest force found, N; a place where none is counts as infinite.
    pub fn least_force_n(&self) -> [f64; 2] {
        let mut forces: Vec<f64> =
            self.least_forces_n.iter().map(|force| if force.is_nan() { f64::INFINITY } else { *force }).collect();
        forces.sort_by(f64::total_cmp);
        // The smallest force that suffices at this part of the places: no mean of two, one of which may be infinite.
        let rank = |part: f64| (part * forces.len() as f64).ceil() as usize;
        [0.5, 0.95].map(|part| forces.get(rank(part).saturating_sub(1)).copied().unwrap_or(f64::NAN))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::touch::{sample_rng, standard_normal};

    #[test]
    fn the_threshold_is_exceeded_once_an_hour() {
        // Highest of 50 independent normal deviates: P(max > k) = 1 - Phi(k)^50 = 1 / 432,000 at k = 5.374
        // (Phi(-5.374) = 3.85e-8 and 50 times that 1 / 519,000; at 5.34 it is 1 / 430,000).
        let peak = |frame: u64| {
            let mut rng = sample_rng(3, frame);
            (0..50).map(|_| standard_normal(&mut rng)).fold(0.0, f64::max)
        };
        let (factor, error) = threshold(&(0..40_000).map(peak).collect::<Vec<f64>>());
        println!("threshold {factor:.2} +- {error:.2}, exactly 5.34");
        assert!(factor > 5.34 - 2.0 * error && factor < 5.34 + 0.35 + 2.0 * error, "{factor} +- {error}");
    }

    #[test]
    fn the_smallest_force_is_found_by_halving() {
        let found = smallest(|force| Ok(force >= 0.37)).expect("no error");
        assert!((found / 0.37 - 1.0).abs() < 3e-3 && found >= 0.37, "{found}");
        assert!(smallest(|_| Ok(false)).expect("no error").is_nan());
    }

    #[test]
    fn pairs_count_as_resolved_from_where_all_greater_distances_are() {
        let assessed = |parts: &[f64]| {
            let score = score(&[], &[], &Detector::default(), "none", None).expect("an empty score");
            let two_resolved = parts.iter().enumerate().map(|(k, part)| (0.01 * (k + 1) as f64, *part)).collect();
            let four = FourScore { frames: 0, all_found: 0.0, localisation_m: Summary::of(&[]), misses: 0, ghosts: 0 };
            Assessment {
                seed: 0,
                grid: score.clone(),
                random: score,
                rim_and_seam_m: Summary::of(&[]),
                two_resolved,
                four,
                noise_factor: 5.0,
                noise_factor_error: 0.0,
                least_forces_n: vec![0.1, 0.2, f64::NAN],
            }
        };
        assert!((assessed(&[0.95, 0.5, 0.9, 1.0]).resolved_from_m() - 0.03).abs() < 1e-12);
        assert!(assessed(&[1.0, 0.5]).resolved_from_m().is_nan());
        assert_eq!(assessed(&[]).least_force_n(), [0.2, f64::INFINITY]);
    }
}
