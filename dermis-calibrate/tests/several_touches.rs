//! Several touches and forces from a calibration with single presses, on digital twins of a membrane.
//!
//! `cargo test --release -p dermis-calibrate --test integration several_touches:: -- --ignored --nocapture` prints the table of
//! `docs/calibration.md`. The touches that are scored are never labels.

use dermis::contact::{Contact, REGION_95_SD};
use dermis::detect::Detector;
use dermis::frame::Frame;
use dermis::method::{Method, MethodOptions, Methods};
use dermis::skin::Skin;
use dermis_calibrate::{Calibration, Calibrations, Label, LabelFrame};
use dermis_sim::evaluate::{Score, match_contacts, resolves_two, score_contacts};
use dermis_sim::experiment::{PressSet, Presses, record, truth};
use dermis_sim::twin::{Twin, TwinOptions};
use rayon::prelude::*;

/// Single presses that are scored.
const SCORED: usize = 300;
/// Frames of several touches.
const SEVERAL: usize = 200;
/// Distance of two touches, and least distance of four, m.
const PAIR_M: f64 = 0.035;
const FOUR_APART_M: f64 = 0.028;

/// Frames and the true touches of each.
struct Frames {
    differences: Vec<Frame>,
    truth: Vec<Vec<Contact>>,
}

impl Frames {
    fn record(skin: &Skin, twin: &Twin, set: &PressSet, first: u64) -> (Self, u64) {
        let recording = record(twin, &set.presses, first, || ()).unwrap();
        let surface = skin.design().body.surface();
        let differences = recording.frames.iter().map(|frame| frame - &recording.baseline).collect();
        let truth = set.presses.iter().map(|presses| truth(&surface, presses)).collect();
        (Frames { differences, truth }, recording.next_index)
    }
}

/// Single presses, pairs and fours on one twin.
struct Experiment {
    untouched: Vec<Frame>,
    single: Frames,
    two: Frames,
    four: Frames,
}

fn experiment(skin: &Skin, twin: &str, seed: u64, singles: usize) -> Experiment {
    let options = TwinOptions::shipped(twin).unwrap();
    let presses = Presses::new(skin.design(), skin.mesh(), skin.pixels(), options.press, seed);
    let twin = Twin::new(skin.design(), &options, seed).unwrap();
    let before = record(&twin, &[], 0, || ()).unwrap();
    let untouched = before.untouched.iter().map(|frame| frame - &before.baseline).collect();
    let (single, next) = Frames::record(skin, &twin, &presses.at_random(singles), before.next_index);
    let (two, next) = Frames::record(skin, &twin, &presses.in_pairs(&[PAIR_M], SEVERAL), next);
    let (four, _) = Frames::record(skin, &twin, &presses.apart(4, FOUR_APART_M, SEVERAL), next);
    Experiment { untouched, single, two, four }
}

/// A calibration with some presses, with their forces or without.
fn calibrated(skin: &Skin, presses: &Frames, labels: usize, forces: bool) -> Method {
    let label = |row: usize| {
        let Contact { position_m, force_n, .. } = presses.truth[row][0];
        Label { row, position_m, force_n: if forces { force_n } else { f64::NAN } }
    };
    let labels: Vec<Label> = (0..labels).map(label).collect();
    let calibration = Calibration::fit(skin, &presses.differences[..labels.len()], &labels, LabelFrame::Skin).unwrap();
    let folder = tempfile::tempdir().unwrap();
    calibration.save(folder.path(), skin.design()).unwrap();
    let methods = Methods::linear().with(Calibrations::of(Methods::linear()));
    methods.method(skin, folder.path().to_str().unwrap(), &MethodOptions::default()).unwrap()
}

struct Scored {
    score: Score,
    found: Vec<Vec<Contact>>,
    frame_ms: f64,
}

fn scored(method: &Method, detector: &Detector, frames: &Frames, from: usize) -> Scored {
    let (differences, truth) = (&frames.differences[from..], &frames.truth[from..]);
    let started = std::time::Instant::now();
    let found: Vec<Vec<Contact>> = differences.iter().map(|frame| method.contacts(frame, detector).unwrap()).collect();
    let frame_ms = 1e3 * started.elapsed().as_secs_f64() / differences.len() as f64;
    let images: Vec<_> = differences.par_iter().map(|frame| method.image(frame).unwrap()).collect();
    let score = score_contacts(&images, &found, truth, method.label(), None).unwrap();
    Scored { score, found, frame_ms }
}

fn resolved(skin: &Skin, found: &[Vec<Contact>], truth: &[Vec<Contact>]) -> f64 {
    let surface = &skin.pixels().surface;
    let pairs = found.iter().zip(truth);
    let resolved = pairs.filter(|(found, truth)| resolves_two(&[truth[0], truth[1]], found, surface)).count();
    resolved as f64 / truth.len() as f64
}

/// The share of the regions of 95 % that contain the true position, of the contacts that were found.
fn covered(skin: &Skin, found: &[Vec<Contact>], truth: &[Vec<Contact>]) -> f64 {
    let surface = &skin.pixels().surface;
    let regions = found.iter().zip(truth).flat_map(|(found, truth)| {
        let pairs = match_contacts(truth, found, surface).pairs;
        let inside = |(_, contact, off_m): (usize, usize, f64)| off_m / found[contact].sd_m <= REGION_95_SD;
        pairs.into_iter().map(inside).collect::<Vec<bool>>()
    });
    let regions: Vec<f64> = regions.map(|inside| f64::from(u8::from(inside))).collect();
    dermis::stats::mean(&regions)
}

fn row(skin: &Skin, experiment: &Experiment, method: &Method, detector: &Detector, first: usize) -> String {
    let Experiment { single, two, four, .. } = experiment;
    let [one, pairs, fours] =
        [(single, first), (two, 0), (four, 0)].map(|(frames, from)| scored(method, detector, frames, from));
    let force = one.score.force.map_or("-".into(), |force| format!("{:.0} %, {:.2}", 1e2 * force.error, force.spread));
    let several = |scored: &Scored| {
        let Score { localisation_m, misses, false_positives, .. } = &scored.score;
        format!("{:.2}, {misses} missed, {false_positives} false", 1e3 * localisation_m.mean)
    };
    format!(
        "{} | {force} | {:.0} % | {} | {:.0} % | {} | {:.1}, {:.1}, {:.1}",
        several(&one),
        1e2 * resolved(skin, &pairs.found, &two.truth),
        several(&pairs),
        1e2 * covered(skin, &pairs.found, &two.truth),
        several(&fours),
        one.frame_ms,
        pairs.frame_ms,
        fours.frame_ms
    )
}

#[test]
fn pairs_are_told_from_single_presses() {
    let skin = Skin::load("skin16").unwrap();
    let experiment = experiment(&skin, "lab", 4101, 350);
    let method = calibrated(&skin, &experiment.single, 250, true);
    let detector = method.detector(&experiment.untouched, &skin.design().protocol).unwrap();
    let single = scored(&method, &detector, &experiment.single, 250);
    let two = scored(&method, &detector, &experiment.two, 0);
    let share = resolved(&skin, &two.found, &experiment.two.truth);
    // A linear method with the Laplace prior resolves 28 % of such pairs.
    assert!(share > 0.7, "{share} of the pairs resolved");
    assert!(single.score.false_positives <= 2, "{:?}", single.score);
    // With a third touch wherever the density gains enough, one pair in seven has a false contact.
    let pairs = experiment.two.truth.len();
    assert!(20 * two.score.false_positives <= 3 * pairs, "{:?}", two.score);
    assert!(single.score.force.unwrap().error < 0.25, "{:?}", single.score);
}

#[test]
#[ignore = "slow: three minutes; prints a table"]
fn several_touches_by_the_number_of_presses() {
    let skin = Skin::load("skin16").unwrap();
    println!(
        "| twin, seed | method | single: error, mm | force error, spread | pairs resolved | two: error, mm | 95 % regions of two hold | four: error, mm | \
         frame of one, two, four, ms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (twin, seed) in [("lab", 4001), ("lab", 4002), ("harsh", 4001), ("harsh", 4002)] {
        let experiment = experiment(&skin, twin, seed, 500 + SCORED);
        let methods = Methods::linear();
        for name in ["noser", "laplace"] {
            let method = methods.method(&skin, name, &MethodOptions::default()).unwrap();
            let detector = method.detector(&experiment.untouched, &skin.design().protocol).unwrap();
            println!("| `{twin}`, {seed} | {name} | {} |", row(&skin, &experiment, &method, &detector, 500));
        }
        for (labels, forces) in [(100, false), (100, true), (500, false), (500, true)] {
            let method = calibrated(&skin, &experiment.single, labels, forces);
            let detector = method.detector(&experiment.untouched, &skin.design().protocol).unwrap();
            let with = if forces { "with forces" } else { "without forces" };
            println!(
                "| `{twin}`, {seed} | {labels} presses, {with} | {} |",
                row(&skin, &experiment, &method, &detector, 500)
            );
        }
    }
}
