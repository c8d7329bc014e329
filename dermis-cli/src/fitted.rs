//! The calibration that presses give: a forward map, or the correction of a method.

use crate::calibrated::late_channels;
use crate::console::Progress;
use crate::failure::{Failure, Outcome};
use dermis::design::SkinDesign;
use dermis::frame::Frame;
use dermis::method::{MethodError, MethodOptions};
use dermis::skin::Skin;
use dermis_calibrate::{CalibrateError, Calibration, Correction, CorrectionQuality, Label, LabelFrame, Quality};
use dermis_study::report::Table;
use serde_json::json;
use std::path::Path;

/// The name of the forward map in `--method`.
pub const FORWARD_MAP: &str = "forward-map";

/// What presses gave.
pub enum Fitted {
    /// A forward map.
    ForwardMap(Box<Calibration>),
    /// The correction of a method.
    Correction(Box<Correction>),
}

/// Fits the forward map, or the correction of a method by its name; without a choice, whichever locates the labels
/// better, of the forward map and the correction of the skin's default method.
pub fn fit(
    skin: &Skin,
    frames: &[Frame],
    labels: &[Label],
    frame: LabelFrame,
    method: Option<&str>,
) -> Outcome<Fitted> {
    if let Some(name) = method.filter(|name| *name != FORWARD_MAP) {
        if frame == LabelFrame::Robot {
            let message = format!("a correction of {name} needs labels on the skin, not in the frame of a robot");
            return Err(Failure::given(message, Some("name the columns of --truth in its first row")));
        }
        return Ok(Fitted::Correction(Box::new(correct(skin, frames, labels, name)??)));
    }
    let map = {
        let _waiting = Progress::waiting("fitting the forward map");
        Calibration::fit(skin, frames, labels, frame)?
    };
    let better = match (method, frame) {
        (None, LabelFrame::Skin) => better_correction(skin, frames, labels, map.quality())?,
        _ => None,
    };
    Ok(match better {
        Some(correction) => Fitted::Correction(Box::new(correction)),
        None => Fitted::ForwardMap(Box::new(map)),
    })
}

/// The correction of the skin's default method, where it finds all labels and locates them better than a forward map.
pub fn better_correction(
    skin: &Skin,
    frames: &[Frame],
    labels: &[Label],
    map: &Quality,
) -> Outcome<Option<Correction>> {
    let correction = match correct(skin, frames, labels, "")? {
        Err(CalibrateError::TooFewFound { .. }) => return Ok(None),
        fitted => fitted?,
    };
    let CorrectionQuality { labels, found, mean_error_m, .. } = *correction.quality();
    Ok(Some(correction).filter(|_| found == labels && mean_error_m < map.mean_error_m))
}

/// Corrects a method by the labels.
fn correct(skin: &Skin, frames: &[Frame], labels: &[Label], name: &str) -> Outcome<Result<Correction, CalibrateError>> {
    let _waiting = Progress::waiting("fitting the correction of a method");
    let refused = |error: MethodError| match error {
        MethodError::Dermis(error) => error.into(),
        error => Failure::given(format!("--method {name}: {error}"), Some("or give --method forward-map")),
    };
    let method = dermis_learn::methods().method(skin, name, &MethodOptions::default()).map_err(refused)?;
    let detector = method.detector(&[])?;
    Ok(Correction::fit(skin.pixels(), &method, &detector, frames, labels))
}

impl Fitted {
    /// Writes it to a folder.
    pub fn save(&self, folder: &Path, design: &SkinDesign) -> Outcome {
        match self {
            Fitted::ForwardMap(map) => map.save(folder, design)?,
            Fitted::Correction(correction) => correction.save(folder, design)?,
        }
        Ok(())
    }

    /// Why the forces of its labels are not used; `None` where they are, or where none is known.
    fn unused_forces(&self, labels: &[Label]) -> Option<String> {
        let reason = match self {
            Fitted::ForwardMap(map) => map.unused_forces(labels),
            Fitted::Correction(correction) => correction.unused_forces(labels),
        };
        reason.map(|reason| reason.to_string())
    }

    /// Its figures as JSON, SI units.
    pub fn to_json(&self, design: &str, labels: &[Label]) -> serde_json::Value {
        let mut json = match self {
            Fitted::ForwardMap(map) => json!({
                "skin": design,
                "method": FORWARD_MAP,
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
        json["unused_forces"] = json!(self.unused_forces(labels));
        json
    }

    /// Its figures as a table.
    pub fn summary(&self, labels: &[Label]) -> Table {
        let mut table = match self {
            Fitted::ForwardMap(map) => map_summary(map),
            Fitted::Correction(correction) => correction_summary(correction),
        };
        if let Some(reason) = self.unused_forces(labels) {
            table.row(["forces".to_string(), format!("not used: {reason}")]);
        }
        table
    }
}

fn correction_summary(correction: &Correction) -> Table {
    let CorrectionQuality { labels, found, mean_error_before_m, mean_error_m, force_error, force_spread } =
        *correction.quality();
    let mut table = Table::new(&["figure", "value"]);
    let mut row = |name: &str, value: String| table.row([name.to_string(), value]);
    row("corrected method", correction.method().to_string());
    row("labelled presses", format!("{labels}, of which it finds {found}"));
    row("mean error before", format!("{:.2} mm", 1e3 * mean_error_before_m));
    row("mean error, cross-validated", format!("{:.2} mm", 1e3 * mean_error_m));
    force_row(&mut row, force_error, force_spread);
    table
}

/// The error of forces, where they are known.
fn force_row(row: &mut impl FnMut(&str, String), error: Option<f64>, spread: Option<f64>) {
    if let (Some(error), Some(spread)) = (error, spread) {
        row("error of the force, cross-validated", format!("{:.0} %, spread {spread:.2}", 1e2 * error));
    }
}

fn map_summary(calibration: &Calibration) -> Table {
    let Quality { labels, unlabelled, mean_error_m, force_error, force_spread } = *calibration.quality();
    let mut table = Table::new(&["figure", "value"]);
    let mut row = |name: &str, value: String| table.row([name.to_string(), value]);
    row("labelled presses", labels.to_string());
    row("unlabelled presses used", unlabelled.to_string());
    row("mean error, cross-validated", format!("{:.2} mm", 1e3 * mean_error_m));
    force_row(&mut row, force_error, force_spread);
    row("channels that are rows late", late_channels(calibration.lags()));
    if let Some(pose) = calibration.pose() {
        let [x, y, _] = pose.centre_m.map(|value| 1e3 * value);
        let seen = if pose.mirrored { ", mirrored" } else { "" };
        row(
            "pose of the skin",
            format!("x {x:.1} mm, y {y:.1} mm, {:.0} degrees{seen}", pose.rotation_rad.to_degrees()),
        );
    }
    table
}

impl From<CalibrateError> for Failure {
    fn from(error: CalibrateError) -> Self {
        Failure::given(error, None)
    }
}
