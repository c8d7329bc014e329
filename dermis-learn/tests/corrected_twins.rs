//! Correction of the shipped network `spots` by presses on digital twins of the paper's skin.
//!
//! `cargo test --release -p dermis-learn --test integration corrected_twins:: -- --ignored --nocapture` prints the table of
//! `docs/calibration.md`. The presses that are scored are never labels.

use dermis::contact::Contact;
use dermis::detect::Detector;
use dermis::frame::Frame;
use dermis::image::PixelSpace;
use dermis::method::{Method, MethodOptions};
use dermis::skin::Skin;
use dermis_calibrate::{Correction, Label};
use dermis_sim::evaluate::{Score, resolves_two, score_contacts};
use dermis_sim::experiment::{PaperExperiment, PressSet, Recording, Sets, Sizes, truth};
use dermis_sim::twin::TwinOptions;
use rayon::prelude::*;

/// Presses that are scored.
const SCORED: usize = 500;
/// The electrode whose channels are left out for one column.
const DEAD: usize = 12;
/// The squared distance in standard deviations within which two normal variables lie with 95 %.
const SQUARE_95: f64 = 5.991_464_547;

/// Frames and the true touches of each.
struct Frames {
    differences: Vec<Frame>,
    truth: Vec<Vec<Contact>>,
}

/// A twin's presses at random places, two and four at a time.
struct Experiment {
    random: Frames,
    two: Frames,
    four: Frames,
    untouched: Vec<Frame>,
}

fn experiment(skin: &Skin, twin: &str, seed: u64, labels: usize) -> Experiment {
    let sizes = Sizes {
        grid_step: 100,
        random: labels + SCORED,
        separations_m: vec![0.05],
        pairs: 100,
        fours: 100,
        ..Sizes::default()
    };
    let options = TwinOptions::shipped(twin).unwrap();
    let drawn = PaperExperiment::draw(skin.design(), skin.mesh(), skin.pixels(), &options, seed, &sizes).unwrap();
    let Sets { random, two, four, .. } = drawn.record(|| ()).unwrap();
    let surface = skin.design().body.surface();
    let frames = |recording: &Recording, set: &PressSet| Frames {
        differences: recording.frames.iter().map(|frame| frame - &recording.baseline).collect(),
        truth: set.presses.iter().map(|presses| truth(&surface, presses)).collect(),
    };
    Experiment {
        untouched: random.untouched.iter().map(|frame| frame - &random.baseline).collect(),
        random: frames(&random, &drawn.sets.random),
        two: frames(&two, &drawn.sets.two),
        four: frames(&four, &drawn.sets.four),
    }
}

/// The network with the correction by some presses; alone without any.
fn method(skin: &Skin, detector: &Detector, presses: &Frames, labels: usize) -> Method {
    let methods = dermis_learn::methods();
    let best = methods.method(skin, "spots", &MethodOptions::default()).unwrap();
    if labels == 0 {
        return best;
    }
    let label = |row: usize| {
        let Contact { position_m, force_n, .. } = presses.truth[row][0];
        Label { row, position_m, force_n }
    };
    let labels: Vec<Label> = (0..labels).map(label).collect();
    let correction = Correction::fit(skin.pixels(), &best, detector, &presses.differences, &labels).unwrap();
    let folder = tempfile::tempdir().unwrap();
    correction.save(folder.path(), skin.design()).unwrap();
    methods.method(skin, folder.path().to_str().unwrap(), &MethodOptions::default()).unwrap()
}

/// The contacts of each frame.
fn contacts(method: &Method, detector: &Detector, frames: &[Frame]) -> Vec<Vec<Contact>> {
    frames.par_iter().map(|frame| method.contacts(frame, detector).unwrap()).collect()
}

fn scored(method: &Method, detector: &Detector, frames: &Frames, from: usize) -> (Score, Vec<Vec<Contact>>) {
    let (differences, truth) = (&frames.differences[from..], &frames.truth[from..]);
    let found = contacts(method, detector, differences);
    let images: Vec<_> = differences.iter().map(|frame| method.image(frame).unwrap()).collect();
    (score_contacts(&images, &found, truth, method.label(), None).unwrap(), found)
}

/// The share of regions of 95 % that contain the true position of the only press.
fn covered(pixels: &PixelSpace, found: &[Vec<Contact>], truth: &[Vec<Contact>]) -> f64 {
    let single = found.iter().zip(truth).filter_map(|(found, truth)| Some((found.first()?, truth[0])));
    let inside = single.map(|(contact, truth)| {
        let off_m = pixels.surface.distance_m(contact.position_m, truth.position_m);
        f64::from(u8::from((off_m / contact.sd_m).powi(2) <= SQUARE_95))
    });
    dermis::stats::mean(&inside.collect::<Vec<f64>>())
}

fn row(skin: &Skin, experiment: &Experiment, detector: &Detector, labels: usize) -> String {
    let Experiment { random, two, four, .. } = experiment;
    let method = method(skin, detector, random, labels);
    let first = random.truth.len() - SCORED;
    let (single, found) = scored(&method, detector, random, first);
    let force = single.force.expect("forces are known");
    let surface = &skin.pixels().surface;
    let pairs = contacts(&method, detector, &two.differences);
    let resolved =
        pairs.iter().zip(&two.truth).filter(|(found, truth)| resolves_two(&[truth[0], truth[1]], found, surface));
    let (fours, _) = scored(&method, detector, four, 0);
    let dead: Vec<usize> = skin.channels_of(DEAD).collect();
    let (without, _) = scored(&method.without_channels(skin, &dead).unwrap(), detector, random, first);
    format!(
        "{:.2} | {} | {:.1} % | {:.0} % | {:.2} | {} % | {:.2}, {} missed | {:.2}, {} missed, {} false",
        1e3 * single.localisation_m.mean,
        single.misses,
        1e2 * covered(skin.pixels(), &found, &random.truth[first..]),
        1e2 * force.error,
        force.spread,
        resolved.count(),
        1e3 * fours.localisation_m.mean,
        fours.misses,
        1e3 * without.localisation_m.mean,
        without.misses,
        without.false_positives,
    )
}

#[test]
fn two_hundred_presses_correct_the_forces() {
    let skin = Skin::load("cylinder30").unwrap();
    let experiment = experiment(&skin, "lab", 3003, 200);
    let best = dermis_learn::methods().method(&skin, "spots", &MethodOptions::default()).unwrap();
    let detector = best.detector(&experiment.untouched, &skin.design().protocol).unwrap();
    let score =
        |labels| scored(&method(&skin, &detector, &experiment.random, labels), &detector, &experiment.random, 200).0;
    let (before, after) = (score(0), score(200));
    let (before_force, after_force) = (before.force.unwrap(), after.force.unwrap());
    assert!(after_force.error < 0.6 * before_force.error, "{before_force:?}, {after_force:?}");
    assert!(after.localisation_m.mean < before.localisation_m.mean, "{before:?}, {after:?}");
    assert!(after.misses <= before.misses && after.false_positives <= before.false_positives);
}

#[test]
#[ignore = "slow: three minutes; prints a table"]
fn the_error_by_the_number_of_presses_that_correct_the_network() {
    let skin = Skin::load("cylinder30").unwrap();
    println!(
        "| twin, seed | presses | error, mm | missed of {SCORED} | 95 % regions hold | force error | force spread | pairs at 50 mm \
         resolved | four: error, mm | electrode {DEAD} dead: error, mm |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for (twin, seed) in [("lab", 3001), ("lab", 3002), ("harsh", 3001), ("harsh", 3002)] {
        let experiment = experiment(&skin, twin, seed, 900);
        let best = dermis_learn::methods().method(&skin, "spots", &MethodOptions::default()).unwrap();
        let detector = best.detector(&experiment.untouched, &skin.design().protocol).unwrap();
        for labels in [0, 50, 200, 900] {
            println!("| `{twin}`, {seed} | {labels} | {} |", row(&skin, &experiment, &detector, labels));
        }
    }
}
