//! Calibration of two real membranes (16 electrodes, 2,500 presses by a robot each) with their own presses.
//!
//! `cargo test --release -p dermis-calibrate --test integration real_presses:: -- --ignored --nocapture` prints the table of
//! `docs/calibration.md`. Skipped where the recordings are not there.

use dermis::frame::{Frame, Truth, read_frames, read_truth};
use dermis::geom::vector::distance;
use dermis::geom::{PlaceLimits, Point3, Surface};
use dermis::method::{Method, MethodOptions, MethodSet, Methods};
use dermis::pipeline::{FrameInput, Pipeline, PipelineFrame, Settings, Timestamp, Validity};
use dermis::skin::Skin;
use dermis_calibrate::checks::realigned;
use dermis_calibrate::{Calibration, Calibrations, Correction, Label, LabelFrame, Pose};
use dermis_sim::random::{sample_rng, standard_normal};
use std::ops::Range;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The presses that are scored; never labels.
const SCORED: Range<usize> = 2000..2500;

struct Recording {
    skin: Skin,
    frames: Vec<Frame>,
    presses: Vec<Point3>,
}

/// The recording of a membrane; `None` where it is not there.
fn recording(name: &str) -> Option<Recording> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
    let folder = PathBuf::from(std::env::var("DERMIS_DATA").unwrap_or(default.into())).join("skins_real");
    if !folder.is_dir() {
        println!("skipped: there is no {} (DERMIS_DATA names the folder above it)", folder.display());
        return None;
    }
    let skin = Skin::load("skin16").unwrap();
    let frames = read_frames(&folder.join(format!("inp_{name}.csv")), &skin.design().protocol).unwrap();
    let limits = PlaceLimits::of_box(Surface::Plane, [[0.0; 3]], 0.04);
    let truth = read_truth(&folder.join(format!("out_{name}.csv")), &limits, frames.len()).unwrap();
    let Truth::Elsewhere { positions_m: presses, .. } = truth else { panic!("presses in a robot's frame") };
    Some(Recording { skin, frames, presses })
}

struct Scored {
    mean_m: f64,
    covered: f64,
    fit_s: f64,
    frame_ms: f64,
    calibration: Calibration,
}

/// Which presses calibrate, and which are scored.
struct Split {
    /// Rows of the labels, ascending.
    labels: Vec<usize>,
    /// Rows whose frames may be used.
    frames: Range<usize>,
    scored: Vec<usize>,
}

impl Split {
    /// Contiguous labels before the last 500 presses, which are scored. Frames after the labels are not used.
    fn before(rows: Range<usize>) -> Self {
        Split { frames: 0..rows.end, labels: rows.collect(), scored: SCORED.collect() }
    }

    /// Labels and 500 scored presses at random. All frames are used.
    fn random(labels: usize, count: usize) -> Self {
        let mut rows: Vec<usize> = (0..count).collect();
        let mut state = 1_u64;
        for last in (1..count).rev() {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            rows.swap(last, (state >> 33) as usize % (last + 1));
        }
        let mut labels = rows[..labels].to_vec();
        labels.sort_unstable();
        Split { labels, frames: 0..count, scored: rows[count - SCORED.len()..].to_vec() }
    }
}

/// Calibrates with some presses and scores others.
fn calibrate(recording: &Recording, split: &Split) -> Scored {
    let Recording { skin, frames, presses } = recording;
    let labels: Vec<Label> =
        split.labels.iter().map(|&row| Label { row, position_m: presses[row], force_n: f64::NAN }).collect();
    let started = Instant::now();
    let calibration = Calibration::fit(skin, &frames[split.frames.clone()], &labels, LabelFrame::Robot).unwrap();
    let fit_s = started.elapsed().as_secs_f64();
    let started = Instant::now();
    let located = calibration.locate(frames, 0).unwrap();
    let frame_ms = 1e3 * started.elapsed().as_secs_f64() / frames.len() as f64;
    let scored = || split.scored.iter();
    let count = split.scored.len() as f64;
    let mean_m = scored().map(|&row| distance(located[row].position_m, presses[row])).sum::<f64>() / count;
    let covered = scored().filter(|&&row| located[row].region_contains(presses[row])).count() as f64 / count;
    Scored { mean_m, covered, fit_s, frame_ms, calibration }
}

/// A method that uses the model of the skin, with the pose and the late channels known from 2,000 presses.
struct Modelled {
    skin: Skin,
    method: Method,
    frames: Vec<Frame>,
    positions_m: Vec<Point3>,
}

impl Modelled {
    fn new(recording: &Recording, name: &str) -> Self {
        let known = calibrate(recording, &Split::before(0..2000)).calibration;
        let pose: &Pose = known.pose().unwrap();
        let skin = recording.skin.clone();
        let method = Methods::linear().method(&skin, name, &MethodOptions::default()).unwrap();
        let positions_m = recording.presses.iter().map(|&press| pose.to_skin(press)).collect();
        Modelled { skin, method, frames: realigned(&recording.frames, known.lags()).unwrap(), positions_m }
    }

    /// Mean error of the strongest contacts of the scored presses that have one, and the number of those without.
    fn score(&self, method: &Method) -> String {
        let detector = method.detector(&[], &self.skin.design().protocol).unwrap();
        let off_m: Vec<f64> = SCORED
            .filter_map(|row| {
                let contacts = method.contacts(&self.frames[row], &detector).unwrap();
                let strongest = contacts.iter().max_by(|a, b| a.strength.total_cmp(&b.strength))?;
                Some(distance(strongest.position_m, self.positions_m[row]))
            })
            .collect();
        format!("{:.2}, {} missed", 1e3 * dermis::stats::mean(&off_m), SCORED.len() - off_m.len())
    }

    /// The method corrected by the last presses before the scored ones.
    fn corrected(&self, labels: usize) -> Result<Method, String> {
        let label = |row: usize| Label { row, position_m: self.positions_m[row], force_n: f64::NAN };
        let labels: Vec<Label> = (SCORED.start - labels..SCORED.start).map(label).collect();
        let detector = self.method.detector(&[], &self.skin.design().protocol).unwrap();
        let fitted = Correction::fit(self.skin.pixels(), &self.method, &detector, &self.frames, &labels);
        let folder = tempfile::tempdir().unwrap();
        fitted.map_err(|error| error.to_string())?.save(folder.path(), self.skin.design()).unwrap();
        let methods = Methods::linear().with(Calibrations::of(Methods::linear()));
        let name = folder.path().display().to_string();
        Ok(methods.method(&self.skin, &name, &MethodOptions::default()).unwrap())
    }
}

#[test]
#[ignore = "slow: a minute; prints a table"]
fn the_error_with_the_model_of_the_skin_and_without() {
    println!("| skin | labels | forward map, mm | `laplace`, mm | `laplace` corrected, mm | `noser` corrected, mm |");
    println!("|---|---|---|---|---|---|");
    for name in ["noPattern", "parallel"] {
        let Some(recording) = recording(name) else { return };
        let [laplace, noser] = ["laplace", "noser"].map(|method| Modelled::new(&recording, method));
        let alone = laplace.score(&laplace.method);
        for labels in [10, 20, 50, 100, 200] {
            let map = 1e3 * calibrate(&recording, &Split::before(SCORED.start - labels..SCORED.start)).mean_m;
            let corrected = |modelled: &Modelled| match modelled.corrected(labels) {
                Ok(method) => modelled.score(&method),
                Err(_) => "too few labels".into(),
            };
            let [by_laplace, by_noser] = [corrected(&laplace), corrected(&noser)];
            println!("| `{name}` | {labels} | {map:.2} | {alone} | {by_laplace} | {by_noser} |");
        }
    }
}

#[test]
fn presses_of_a_real_skin_are_no_faults_of_the_instrument() {
    // Real presses differ from those of the model; the frames between them are noise of 2 % of their size.
    for name in ["noPattern", "parallel"] {
        let Some(recording) = recording(name) else { return };
        let methods = MethodSet::new(&Methods::linear(), recording.skin.clone(), Some("laplace")).unwrap();
        // Differences from the untouched skin.
        let settings = Settings { method: "laplace".into(), force_tare: true, ..Settings::default() };
        let mut pipeline = Pipeline::new(methods.into(), settings).unwrap();
        let presses = &recording.frames[1000..1060];
        let sd = 0.02 * dermis::stats::rms(presses.iter().flat_map(|frame| frame.iter().copied()));
        let mut rng = sample_rng(3, 0);
        let (mut number, mut found) = (0, 0);
        let mut process = |press: Option<&Frame>| {
            let noise = (0..presses[0].len()).map(|_| sd * standard_normal(&mut rng));
            let values_ohm =
                noise.enumerate().map(|(channel, noise)| noise + press.map_or(0.0, |press| press[channel]));
            let measured_at = Timestamp::default().after(Duration::from_millis(10 * number));
            number += 1;
            pipeline.process(FrameInput::new(number, measured_at, values_ohm.collect())).unwrap()
        };
        (0..100).for_each(|_| drop(process(None)));
        for press in presses {
            let frames: Vec<PipelineFrame> = (0..6).map(|_| process(Some(press))).collect();
            found += usize::from(!frames[5].contacts.is_empty());
            let after = (0..30).map(|_| process(None));
            assert!(frames.into_iter().chain(after).all(|frame| frame.validity == Validity::Ok), "{name}");
        }
        assert_eq!(found, presses.len(), "{name}");
    }
}

#[test]
fn five_hundred_presses_calibrate_a_real_skin() {
    // The authors' networks, trained on 2,000 presses, reach 2.28 and 3.13 mm.
    for (name, bound_m) in [("noPattern", 1.3e-3), ("parallel", 1.8e-3)] {
        let Some(recording) = recording(name) else { return };
        let scored = calibrate(&recording, &Split::before(1500..2000));
        assert!(scored.mean_m < bound_m, "{name}: {} m", scored.mean_m);
        assert!((0.93..=0.97).contains(&scored.covered), "{name}: {}", scored.covered);
        let promised_m = scored.calibration.quality().mean_error_m;
        assert!((scored.mean_m / promised_m - 1.0).abs() < 0.25, "{name}: {promised_m} by cross-validation");
        let late: Vec<usize> = (0..192).filter(|&channel| scored.calibration.lags()[channel] != 0).collect();
        // The first drive is a row late, the second measured while the robot moved, the third hardly affected.
        assert!(late.starts_with(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]), "{name}: {late:?}");
        assert!(late.len() <= 26 && late.iter().all(|&channel| channel < 36), "{name}: {late:?}");
    }
}

#[test]
#[ignore = "slow: two minutes; prints a table"]
fn the_error_by_the_number_of_labelled_presses() {
    println!(
        "| skin | labels | mean error, mm | 95 % regions hold | by cross-validation, mm | fit, s | one frame, ms |"
    );
    println!("|---|---|---|---|---|---|---|");
    for name in ["noPattern", "parallel"] {
        let Some(recording) = recording(name) else { return };
        let count = recording.presses.len();
        let last = [20, 50, 100, 200, 500, 2000].map(|labels| ("last", Split::before(2000 - labels..2000)));
        let first = [100, 500].map(|labels| ("first", Split::before(0..labels)));
        let random = [20, 100, 200, 500].map(|labels| ("random", Split::random(labels, count)));
        for (which, split) in last.into_iter().chain(first).chain(random) {
            let labels = split.labels.len();
            let Scored { mean_m, covered, fit_s, frame_ms, calibration } = calibrate(&recording, &split);
            println!(
                "| `{name}` | {which} {labels} | {:.2} | {:.1} % | {:.2} | {fit_s:.1} | {frame_ms:.2} |",
                1e3 * mean_m,
                100.0 * covered,
                1e3 * calibration.quality().mean_error_m,
            );
        }
    }
}
