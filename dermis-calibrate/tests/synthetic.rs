//! Calibration of an invented skin whose responses are known functions, and input that is refused.

use dermis::design::SkinDesign;
use dermis::frame::{Frame, read_array, write_array};
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::method::{MethodOptions, Methods};
use dermis::skin::Skin;
use dermis_calibrate::{
    CalibrateError, Calibration, Calibrations, Label, LabelFrame, expected_error_m, learning_curve,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::LazyLock;

const PRESSES: usize = 160;

fn skin() -> Skin {
    Skin::load("skin16").unwrap()
}

/// Presses at random positions of a disk of 70 mm, and the change of each channel: a smooth function of the position
/// that no model of a skin contains, a part of the press before, and noise.
fn presses(seed: u64, count: usize) -> (Vec<Frame>, Vec<Label>) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut at = || loop {
        let position = [0.07 * (rng.random::<f64>() - 0.5), 0.07 * (rng.random::<f64>() - 0.5), 0.0];
        if distance(position, [0.0; 3]) <= 0.035 {
            return position;
        }
    };
    let positions: Vec<Point3> = (0..count).map(|_| at()).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(seed + 1);
    let value = |position: Point3, channel: usize| {
        let angle = channel as f64 * 2.4;
        let along = position[0] * angle.cos() + position[1] * angle.sin();
        (along / 0.03 + channel as f64).sin() + 0.5 * (position[0] * position[1] / 4e-4 + angle).cos()
    };
    let frame = |row: usize| {
        let noise = |rng: &mut ChaCha8Rng| 0.03 * (0..12).map(|_| rng.random::<f64>() - 0.5).sum::<f64>();
        let before = |channel: usize| if row > 0 { 0.15 * value(positions[row - 1], channel) } else { 0.0 };
        Frame((0..192).map(|channel| value(positions[row], channel) + before(channel) + noise(&mut rng)).collect())
    };
    let frames = (0..count).map(frame).collect();
    let labels =
        positions.iter().enumerate().map(|(row, &position_m)| Label { row, position_m, force_n: f64::NAN }).collect();
    (frames, labels)
}

/// A calibration with the first [`LABELS`] presses of a recording.
struct Calibrated {
    skin: Skin,
    frames: Vec<Frame>,
    labels: Vec<Label>,
    calibration: Calibration,
}

const LABELS: usize = 100;

/// Of tests that only read it: a fit takes seconds.
static CALIBRATED: LazyLock<Calibrated> = LazyLock::new(|| {
    let (skin, (frames, labels)) = (skin(), presses(1, PRESSES));
    let calibration = Calibration::fit(&skin, &frames[..LABELS], &labels[..LABELS], LabelFrame::Skin).unwrap();
    Calibrated { skin, frames, labels, calibration }
});

#[test]
fn positions_are_found_and_survive_the_folder() {
    let Calibrated { skin, frames, labels, calibration } = &*CALIBRATED;
    assert!(calibration.lags().iter().all(|lag| *lag == 0), "{:?}", calibration.lags());
    let located = calibration.locate(frames, 0).unwrap();
    let errors = labels[LABELS..].iter().map(|label| distance(located[label.row].position_m, label.position_m));
    let mean_m = errors.sum::<f64>() / (PRESSES - LABELS) as f64;
    assert!(mean_m < 1e-3, "{mean_m} m");
    let folder = tempfile::tempdir().unwrap();
    calibration.save(folder.path(), skin.design()).unwrap();
    let again = Calibration::load(folder.path(), skin.design()).unwrap().locate(frames, 0).unwrap();
    let moved = located.iter().zip(&again).map(|(a, b)| distance(a.position_m, b.position_m)).fold(0.0, f64::max);
    assert!(moved < 1e-9, "{moved} m");
    // As a method: a contact for a press, none for an untouched frame.
    let name = format!("{}/", folder.path().display());
    let method = Methods::linear()
        .with(Calibrations::of(Methods::linear()))
        .method(skin, &name, &MethodOptions::default())
        .unwrap();
    let detector = method.detector(&[], &skin.design().protocol).unwrap();
    let contacts = method.contacts(&frames[120], &detector).unwrap();
    assert!(contacts.len() == 1 && distance(contacts[0].position_m, labels[120].position_m) < 0.005, "{contacts:?}");
    assert_eq!(located[120].covariance_m2[2][2], 0.0, "positions lie on the skin");
    let mut not_finite = frames[120].clone();
    not_finite.0[3] = f64::NAN;
    let error = method.contacts(&not_finite, &detector).unwrap_err().to_string();
    assert!(error.contains("channel 3"), "{error}");
    let error = method.contacts(&Frame(vec![0.0; 191]), &detector).unwrap_err().to_string();
    assert!(error.contains("191 values") && error.contains("192"), "{error}");
}

#[test]
fn late_channels_are_found_and_moved() {
    let (skin, (mut frames, labels)) = (skin(), presses(2, 400));
    for row in (1..400).rev() {
        for channel in 0..24 {
            frames[row].0[channel] = frames[row - 1].0[channel];
        }
    }
    let calibration = Calibration::fit(&skin, &frames, &labels[..100], LabelFrame::Skin).unwrap();
    let late: Vec<usize> = (0..192).filter(|&channel| calibration.lags()[channel] == 1).collect();
    assert_eq!(late, (0..24).collect::<Vec<_>>());
    assert_eq!(calibration.lags().iter().filter(|lag| **lag != 0).count(), 24);
}

#[test]
fn frames_unlike_the_labels_are_marked() {
    let Calibrated { frames, calibration, .. } = &*CALIBRATED;
    let mut frames = frames.clone();
    for channel in (0..192).step_by(2) {
        frames[130].0[channel] *= -1.0;
    }
    let located = calibration.locate(&frames, 0).unwrap();
    assert!(calibration.is_unlike(&located[130]));
    let marked = (100..130).filter(|&row| calibration.is_unlike(&located[row])).count();
    assert!(marked <= 1, "{marked} of 30 sound frames");
}

#[test]
fn labels_that_determine_nothing_are_refused() {
    let (skin, (frames, labels)) = (skin(), presses(4, PRESSES));
    let fit = |labels: &[Label]| Calibration::fit(&skin, &frames, labels, LabelFrame::Skin).unwrap_err();
    assert!(matches!(fit(&labels[..5]), CalibrateError::TooFewLabels { given: 5, .. }));
    let one_place: Vec<Label> =
        (0..50).map(|row| Label { row, position_m: [0.01, 0.0, 0.0], force_n: f64::NAN }).collect();
    assert!(matches!(fit(&one_place), CalibrateError::TooFewLabels { places: 1, .. }));
    let beyond = [&labels[..20], &[Label { row: 900, position_m: [0.0; 3], force_n: f64::NAN }]].concat();
    assert!(fit(&beyond).to_string().contains("frame 900"));
    let far = [&labels[..20], &[Label { row: 30, position_m: [1.0, 0.0, 0.0], force_n: f64::NAN }]].concat();
    assert!(fit(&far).to_string().contains("off the body"), "{}", fit(&far));
    let mut not_finite = frames.clone();
    not_finite[7].0[3] = f64::NAN;
    let error = Calibration::fit(&skin, &not_finite, &labels, LabelFrame::Skin).unwrap_err().to_string();
    assert!(error.contains("frame 7, channel 3"), "{error}");
    let short = [Frame(vec![0.0; 208])];
    let error = Calibration::fit(&skin, &short, &labels[..1], LabelFrame::Skin).unwrap_err();
    assert!(matches!(error, CalibrateError::Channels { got: 208, expected: 192 }), "{error}");
    let cylinder = Skin::load("cylinder30").unwrap();
    let frames: Vec<Frame> = (0..10).map(|k| Frame(vec![f64::from(k); 870])).collect();
    let error = Calibration::fit(&cylinder, &frames, &labels[..10], LabelFrame::Robot).unwrap_err().to_string();
    assert!(error.contains("flat skins only"), "{error}");
}

#[test]
fn folders_of_others_are_refused() {
    let Calibrated { skin, calibration, .. } = &*CALIBRATED;
    let folder = tempfile::tempdir().unwrap();
    calibration.save(folder.path(), skin.design()).unwrap();
    let error = |design: &SkinDesign| Calibration::load(folder.path(), design).unwrap_err().to_string();
    let cylinder = error(&SkinDesign::shipped("cylinder30").unwrap());
    assert!(cylinder.contains("made for the design `skin16`"), "{cylinder}");
    let mut moved = skin.design().clone();
    moved.electrodes[3].centre_m[0] += 0.002;
    assert!(error(&moved).contains("the electrodes or the channels"), "{}", error(&moved));
    let own = skin.design();
    let card = folder.path().join("calibration.json");
    let text = std::fs::read_to_string(&card).unwrap();
    std::fs::write(&card, text.replace("\"version\": 2", "\"version\": 7")).unwrap();
    assert!(error(own).contains("version is 7"), "{}", error(own));
    let damages = [
        ("\"position_variance\": ", "\"position_variance\": -"),
        ("\"temperature\": ", "\"temperature\": -"),
        ("\"radius_m\": ", "\"radius_m\": -"),
    ];
    for (from, to) in damages {
        std::fs::write(&card, text.replacen(from, to, 1)).unwrap();
        assert!(error(own).contains("do not belong together"), "{to}: {}", error(own));
    }
    std::fs::write(&card, text).unwrap();
    for name in ["weights", "whitening", "mean", "presses", "nodes", "variances"] {
        let path = folder.path().join(format!("{name}.npy"));
        let (shape, values) = read_array(&path, "array").unwrap();
        // Without its last row: a node, a press, a channel or a component that others need.
        let rows = shape[0] - 1;
        write_array(&path, "array", &[rows, shape[1]], &values[..rows * shape[1]]).unwrap();
        assert!(error(own).contains("do not belong together"), "{name}: {}", error(own));
        write_array(&path, "array", &shape, &values).unwrap();
    }
    std::fs::remove_file(folder.path().join("weights.npy")).unwrap();
    assert!(error(own).contains("weights.npy"), "{}", error(own));
}

#[test]
fn the_next_presses_are_where_there_were_none() {
    let (skin, (frames, labels)) = (skin(), presses(5, PRESSES));
    // Labels on the left half alone.
    let left: Vec<Label> = labels.iter().filter(|label| label.position_m[0] < 0.0).copied().take(50).collect();
    let calibration = Calibration::fit(&skin, &frames, &left, LabelFrame::Skin).unwrap();
    let next = calibration.suggest(&skin, 8).unwrap();
    assert_eq!(next.len(), 8);
    assert!(next[..4].iter().all(|position| position[0] > 0.0), "{next:?}");
    let apart = |a: usize, b: usize| distance(next[a], next[b]);
    let nearest =
        (0..8).flat_map(|a| (0..a).map(move |b| (a, b))).map(|(a, b)| apart(a, b)).fold(f64::INFINITY, f64::min);
    assert!(nearest > 0.005, "{nearest} m");
}

#[test]
fn the_error_falls_with_the_number_of_labels() {
    let (skin, (frames, labels)) = (skin(), presses(7, PRESSES));
    let calibration = Calibration::fit(&skin, &frames, &labels[..120], LabelFrame::Skin).unwrap();
    let curve = learning_curve(&skin, &frames[..120], &labels[..120], LabelFrame::Skin, &calibration).unwrap();
    let counts: Vec<usize> = curve.iter().map(|point| point.labels).collect();
    assert_eq!(counts, [30, 60, 120]);
    assert!(curve[0].mean_error_m > curve[2].mean_error_m, "{curve:?}");
    assert!(expected_error_m(&curve).unwrap() < curve[2].mean_error_m);
}
