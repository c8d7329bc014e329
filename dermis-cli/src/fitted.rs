//! Figures of a calibration as a table and as JSON.

use crate::console::Progress;
use crate::failure::{Failure, Outcome};
use dermis::contact::GATE_M;
use dermis::frame::Differences;
use dermis::method::MethodError;
use dermis::skin::Skin;
use dermis::text::ranges;
use dermis_calibrate::{
    Alternatives, CalibrateError, Calibration, Correction, CorrectionQuality, Fitted, Label, LabelFrame, Quality,
};
use dermis_plot::report::Table;
use serde_json::json;
use std::collections::BTreeSet;

/// Fits a calibration; without a method whichever is better. Returns what it has to be better than, too. Shows that the program
/// works.
pub fn fit(
    skin: &Skin,
    differences: &Differences,
    labels: &[Label],
    frame: LabelFrame,
    method: Option<&str>,
) -> Outcome<(Fitted, Alternatives)> {
    let _waiting = Progress::waiting("fitting the calibration");
    Fitted::fit(&dermis_learn::methods(), skin, differences, labels, frame, method).map_err(|error| match error {
        CalibrateError::Method(error) => match *error {
            MethodError::Dermis(error) => error.into(),
            error => {
                let message = format!("--method {}: {error}", method.unwrap_or_default());
                Failure::given(message, Some("or give --method forward-map"))
            }
        },
        error => error.into(),
    })
}

/// Its figures as JSON, SI units.
pub fn to_json(fitted: &Fitted, design: &str, labels: &[Label]) -> serde_json::Value {
    let mut json = match fitted {
        Fitted::ForwardMap(map) => json!({
            "skin": design,
            "method": Fitted::FORWARD_MAP,
            "quality": map.quality(),
            "lags": map.lags(),
            "pose": map.pose(),
        }),
        Fitted::Correction(correction) => json!({
            "skin": design,
            "method": correction.method(),
            "quality": correction.quality(),
        }),
    };
    json["unused_forces"] = json!(unused_forces(fitted, labels));
    json
}

/// Its figures as a table, beside what it has to be better than.
pub fn summary(fitted: &Fitted, labels: &[Label], alternatives: Option<&Alternatives>) -> Table {
    let mut table = match fitted {
        Fitted::ForwardMap(map) => map_summary(map),
        Fitted::Correction(correction) => correction_summary(correction),
    };
    if let Some(Alternatives { guess_m, uncalibrated }) = alternatives {
        if let Some((name, before_m)) = uncalibrated.as_ref().filter(|_| matches!(fitted, Fitted::ForwardMap(_))) {
            table.pair(&format!("the same of {name}, uncalibrated"), format!("{:.2} mm", 1e3 * before_m));
        }
        table.pair("the same of a guess of one place", format!("{:.2} mm", 1e3 * guess_m));
    }
    if let Some(reason) = unused_forces(fitted, labels) {
        table.pair("forces", format!("not used: {reason}"));
    }
    table
}

/// Why the forces of the labels are not used, in words.
fn unused_forces(fitted: &Fitted, labels: &[Label]) -> Option<String> {
    fitted.unused_forces(labels).map(|reason| reason.to_string())
}

fn correction_summary(correction: &Correction) -> Table {
    let quality = *correction.quality();
    let CorrectionQuality { labels, found, mean_error_before_m, mean_error_m, force_error, force_spread, .. } = quality;
    let mut table = Table::new(&["figure", "value"]);
    table.pair("corrected method", correction.method());
    table.pair("labelled presses", format!("{labels}, of which it finds {found}"));
    table.pair("mean error before", format!("{:.2} mm", 1e3 * mean_error_before_m));
    if let Some(shift_m) = quality.common_shift_m {
        table.pair("of which all labels alike", format!("{:.2} mm", 1e3 * shift_m));
    }
    table.pair("mean error, cross-validated", format!("{:.2} mm", 1e3 * mean_error_m));
    if let Some([_, after_m]) = quality.with_misses_m.filter(|_| found < labels) {
        let name = format!("of all, where one not found counts as {:.0} mm", 1e3 * GATE_M);
        table.pair(&name, format!("{:.2} mm", 1e3 * after_m));
    }
    force_row(&mut table, force_error, force_spread);
    table
}

/// The error of forces, where they are known.
fn force_row(table: &mut Table, error: Option<f64>, spread: Option<f64>) {
    if let (Some(error), Some(spread)) = (error, spread) {
        table.pair("error of the force, cross-validated", format!("{:.0} %, spread {spread:.2}", 1e2 * error));
    }
}

fn map_summary(calibration: &Calibration) -> Table {
    let Quality { labels, unlabelled, mean_error_m, force_error, force_spread, .. } = *calibration.quality();
    let mut table = Table::new(&["figure", "value"]);
    table.pair("labelled presses", labels);
    table.pair("unlabelled presses used", unlabelled);
    table.pair("mean error, cross-validated", format!("{:.2} mm", 1e3 * mean_error_m));
    force_row(&mut table, force_error, force_spread);
    table.pair("channels that are rows late", late_channels(calibration.lags()));
    if let Some(pose) = calibration.pose() {
        let [x, y, _] = pose.centre_m.map(|value| 1e3 * value);
        let seen = if pose.mirrored { ", mirrored" } else { "" };
        table.pair(
            "pose of the skin",
            format!("x {x:.1} mm, y {y:.1} mm, {:.0} degrees{seen}", pose.rotation_rad.to_degrees()),
        );
    }
    table
}

/// The channels that are late, by the number of rows.
fn late_channels(lags: &[i32]) -> String {
    let late: BTreeSet<i32> = lags.iter().copied().filter(|lag| *lag != 0).collect();
    let channels = |lag: i32| (0..lags.len()).filter(|&channel| lags[channel] == lag).collect::<Vec<_>>();
    let texts: Vec<String> = late.iter().map(|&lag| format!("{} by {lag}", ranges(&channels(lag)))).collect();
    if texts.is_empty() { "none".into() } else { texts.join("; ") }
}
