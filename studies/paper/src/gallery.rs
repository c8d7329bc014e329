//! The data of the pictures: one twin pressed on the grid, four simultaneous touches, a training sample.

use crate::bench::{Bench, Pressed};
use crate::scale::{REPORTED_SEED, Scale};
use dermis::contact::Contact;
use dermis::image::Image;
use dermis::stats::upper_median;
use dermis_sim::dataset::{GaussianTouches, Generator, Recipe, SampleTouch, Skins, Touch};
use dermis_sim::experiment::Recording;
use dermis_sim::twin::Press;
use dermis_study::comparison::{Named, Shown};
use dermis_study::plots::four_touches;
use dermis_study::{Error, Result};
use std::sync::Arc;
use std::time::Instant;

/// Force of each of the four touches, N.
const FOUR_FORCE_N: f64 = 2.0;
/// Number of frames for the median processing time.
const TIMED_FRAMES: usize = 200;
/// Seed of the training sample, and its number: the first one with the same number of touches as in the paper's Fig. 2.
const SAMPLE_SEED: u64 = 1;
const SAMPLE_TOUCHES: usize = 3;

/// The data of the pictures.
pub(crate) struct Gallery {
    /// The first reported twin, pressed on the grid.
    pub pressed: Pressed,
    /// The results of each method.
    pub shown: Vec<Shown>,
    /// Four simultaneous touches and the results of each method; `None` on a body that is not a cylinder.
    pub four: Option<(Vec<Contact>, Vec<Shown>)>,
    /// A training sample.
    pub sample: TrainingSample,
    /// Median time from a difference to contacts for each method, frame by frame on one thread, s.
    pub seconds_a_frame: Vec<f64>,
}

/// A training sample.
pub(crate) struct TrainingSample {
    /// The frame minus the untouched one, ohm.
    pub difference: Vec<f64>,
    /// The relative change of conductance.
    pub image: Image,
    /// The touches.
    pub touches: Vec<Contact>,
}

impl Gallery {
    /// Presses the first reported twin.
    pub(crate) fn make(bench: &Bench<'_>, methods: &[Named], scale: Scale) -> Result<Self> {
        let mut presses = bench.presses(REPORTED_SEED).on_grid(scale.grid_step()).presses;
        let tip_radius_m = bench.twin.press.tip_radius_m;
        let press = |touch: &Contact| Press { centre_m: touch.position_m, force_n: touch.force_n, tip_radius_m };
        let four = four_touches(bench.skin.design(), FOUR_FORCE_N);
        presses.extend(four.iter().map(|touches| touches.iter().map(press).collect::<Vec<Press>>()));
        let task = bench.progress.begin("pressing the first twin", presses.len());
        let mut pressed = bench.press(REPORTED_SEED, &presses, scale.untouched(), &*task)?;
        drop(task);
        let four = match four {
            None => None,
            Some(_) => {
                let last = "the four touches were pressed last";
                let (rest, four) = pressed.recording.split_last().expect(last);
                pressed.recording = rest;
                Some((four, pressed.truth.pop().expect(last)))
            }
        };
        let detectors = methods
            .iter()
            .map(|method| Ok(method.method.detector(&pressed.untouched, &bench.skin.design().protocol)?))
            .collect::<Result<Vec<_>>>()?;
        let both = || methods.iter().zip(&detectors);
        let shown = both()
            .map(|(method, detector)| Shown::of(method, &pressed.recording, &pressed.truth, detector, bench.progress));
        let shown = shown.collect::<Result<_>>()?;
        let four = match four {
            None => None,
            Some((recording, truth)) => {
                let truth = [truth];
                let shown =
                    both().map(|(method, detector)| Shown::of(method, &recording, &truth, detector, bench.progress));
                let shown = shown.collect::<Result<_>>()?;
                let [truth] = truth;
                Some((truth, shown))
            }
        };
        let seconds = |(method, detector)| seconds_a_frame(method, detector, &pressed.recording);
        let seconds_a_frame = both().map(seconds).collect::<Result<_>>()?;
        Ok(Gallery { sample: TrainingSample::make(bench)?, pressed, shown, four, seconds_a_frame })
    }
}

fn seconds_a_frame(method: &Named, detector: &dermis::detect::Detector, recording: &Recording) -> Result<f64> {
    let frames = recording.frames.iter().cycle().take(TIMED_FRAMES);
    let time = |frame| {
        let difference = frame - &recording.baseline;
        let begun = Instant::now();
        std::hint::black_box(detector.detect(&method.method.reconstruct().reconstruct(&difference)?));
        Ok(begun.elapsed().as_secs_f64())
    };
    let seconds: Vec<f64> = frames.map(time).collect::<Result<_>>()?;
    Ok(upper_median(&seconds).unwrap_or(f64::NAN))
}

impl TrainingSample {
    fn make(bench: &Bench<'_>) -> Result<Self> {
        let touch = Touch::Gaussian(GaussianTouches::for_effect(bench.skin.design().sheet.touch));
        let recipe = Recipe { samples: 1, seed: SAMPLE_SEED, touch, skins: Skins::Even };
        let generator = Generator::new(bench.skin.design(), bench.skin.forward(), &recipe)?;
        let wanted = (0..).find(|&index| generator.touches(index).len() == SAMPLE_TOUCHES).unwrap_or(0);
        let sample = generator.stream(wanted).next().ok_or_else(|| Error::Internal("no sample came".into()))??;
        let surface = bench.skin.design().body.surface();
        let touch = |touch: &SampleTouch| {
            let at = touch.centre_m.map(f64::from);
            Contact::truth(at, surface.normal(at).unwrap_or([f64::NAN; 3]), f64::NAN)
        };
        Ok(TrainingSample {
            difference: sample.frame.iter().zip(&sample.rest).map(|(a, b)| f64::from(a - b)).collect(),
            touches: sample.touches.iter().map(touch).collect(),
            image: Image {
                space: Arc::clone(bench.skin.pixels()),
                values: sample.image.iter().map(|&value| f64::from(value)).collect(),
            },
        })
    }
}
