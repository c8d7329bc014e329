//! Real presses on real skins, where the files are there.

use dermis::frame::{Frame, Truth, read_frames, read_truth};
use dermis::geom::vector::distance;
use dermis::skin::Skin;
use dermis_calibrate::{Calibration, Label, LabelFrame};
use std::path::PathBuf;
use std::time::Instant;

fn data() -> Option<PathBuf> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
    let folder = PathBuf::from(std::env::var("DERMIS_DATA").unwrap_or(default.into())).join("skins_real");
    folder.is_dir().then_some(folder)
}

fn run(name: &str, labels: usize) -> f64 {
    let folder = data().unwrap();
    let skin = Skin::load("skin16").unwrap();
    let frames: Vec<Frame> = read_frames(&folder.join(format!("inp_{name}.csv")), &skin.design().protocol).unwrap();
    let limits = dermis::geom::PlaceLimits::of_box(dermis::geom::Surface::Plane, [[0.0; 3]], 1.0);
    let Truth::Elsewhere(presses) = read_truth(&folder.join(format!("out_{name}.csv")), &limits, frames.len()).unwrap()
    else {
        panic!()
    };
    let rows: Vec<Label> = (2000 - labels..2000).map(|row| Label { row, position_m: presses[row] }).collect();
    let started = Instant::now();
    let calibration = Calibration::fit(&skin, &frames[..2000], &rows, LabelFrame::Robot).unwrap();
    let fit_s = started.elapsed().as_secs_f64();
    let started = Instant::now();
    let located = calibration.locate(&frames[1990..], 1990).unwrap();
    let frame_ms = started.elapsed().as_secs_f64() * 1e3 / located.len() as f64;
    let errors: Vec<f64> = (2000..2500).map(|row| distance(located[row - 1990].position_m, presses[row])).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let covered = (2000..2500)
        .filter(|&row| {
            let l = &located[row - 1990];
            let [a, b, c] = [l.covariance_m2[0][0], l.covariance_m2[0][1], l.covariance_m2[1][1]];
            let [x, y] = [presses[row][0] - l.position_m[0], presses[row][1] - l.position_m[1]];
            (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b) <= 5.991
        })
        .count() as f64
        / 500.0;
    let late = calibration.lags().iter().filter(|lag| **lag != 0).count();
    println!(
        "{name} {labels}: {:.2} mm, fit {fit_s:.1} s, {frame_ms:.2} ms a frame, {late} late, covered {:.3}, {:?} {:?}",
        1e3 * mean,
        covered,
        calibration.quality(),
        calibration.pose()
    );
    mean
}

#[test]
fn study() {
    if data().is_none() {
        return;
    }
    for name in ["noPattern", "parallel"] {
        for labels in [20, 100, 500, 2000] {
            run(name, labels);
        }
    }
}
