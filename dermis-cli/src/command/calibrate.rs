//! `dermis calibrate`: a real skin calibrated with measured presses.

use crate::calibrated::{Presses, late_channels};
use crate::check_page::place;
use crate::console::{Progress, print, print_json, warn};
use crate::failure::{Failure, Outcome};
use crate::frames::{FrameArguments, Recorded};
use crate::rows::Rows;
use crate::skin;
use clap::Args;
use dermis::frame::Frame;
use dermis::method::MethodOptions;
use dermis::skin::Skin;
use dermis_calibrate::checks::{FindingKind, Recording, check_recording};
use dermis_calibrate::{Calibration, Correction, CorrectionQuality, Label, LabelFrame, Quality};
use dermis_study::report::Table;
use serde_json::json;
use std::path::{Path, PathBuf};

/// The arguments of `dermis calibrate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    frames: FrameArguments,
    /// Measured presses, one per frame and in the order of recording: with a header (frame,x_m,y_m on a flat skin, frame,z_m,theta_rad on a
    /// cylinder), or x,y,z (m) without a header in the frame of reference of the robot that pressed.
    #[arg(long, value_name = "FILE")]
    truth: PathBuf,
    /// Rows of the presses to calibrate with, as in 0..500 (row 500 not included) [default: all].
    #[arg(long, value_name = "ROWS")]
    labels: Option<Rows>,
    /// Also use the frames after the last label, without their positions. Helps with fewer than 300 labels.
    #[arg(long)]
    unlabelled: bool,
    /// What to calibrate: `forward-map` learns the skin from the presses alone; the name or folder of a method (best,
    /// noser) corrects the positions and forces of that method. Corrections need positions on the skin [default: whichever
    /// locates the labels better, of the forward map and the default method of the skin]
    #[arg(long, value_name = "METHOD")]
    method: Option<String>,
    /// Folder to write: the method for --method.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Print JSON (SI units) instead of a table.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Fits the calibration and writes it.
    pub fn run(self) -> Outcome {
        let skin = skin::load(&self.design)?;
        let recorded = self.frames.read_recorded(&skin.design().protocol)?;
        let presses = Presses::read(&self.truth, &skin, recorded.frames.len())?;
        warn_of_faults(&skin, &recorded, &presses)?;
        let frames = recorded.into_differences().frames;
        let labels = presses.labels(self.labels.as_ref())?;
        let last = labels.last().map_or(0, |label| label.row);
        let used = if self.unlabelled { &frames[..] } else { &frames[..=last] };
        let calibrated = self.fit(&skin, used, &labels, presses.frame())?;
        calibrated.save(&self.output, &skin.design().name)?;
        if self.json {
            return print_json(&calibrated.to_json(&skin.design().name));
        }
        print(&format!("{}\nwritten to {}\n", calibrated.summary().to_text(), self.output.display()))
    }

    fn fit(&self, skin: &Skin, frames: &[Frame], labels: &[Label], frame: LabelFrame) -> Outcome<Calibrated> {
        if let Some(name) = self.method.as_deref().filter(|name| *name != FORWARD_MAP) {
            if frame == LabelFrame::Robot {
                let message = format!("a correction of {name} needs labels on the skin, not in the frame of a robot");
                return Err(Failure::given(message, Some("name the columns of --truth in its first row")));
            }
            return Ok(Calibrated::Correction(correct(skin, frames, labels, name)?));
        }
        let map = {
            let _waiting = Progress::waiting("fitting the forward map");
            Calibration::fit(skin, frames, labels, frame)?
        };
        if self.method.is_some() || frame == LabelFrame::Robot {
            return Ok(Calibrated::ForwardMap(Box::new(map)));
        }
        Ok(match correct(skin, frames, labels, "") {
            Ok(correction) if is_better(&correction, &map) => Calibrated::Correction(correction),
            Ok(_) | Err(Failure::Given { .. }) => Calibrated::ForwardMap(Box::new(map)),
            Err(failure) => return Err(failure),
        })
    }
}

/// Warns of faults of the recording that the calibration does not mend itself.
fn warn_of_faults(skin: &Skin, recorded: &Recorded, presses: &Presses) -> Outcome {
    let Recorded { frames, untouched } = recorded;
    let recording = Recording { frames, untouched, positions_m: Some(presses.positions_m()) };
    let checked = {
        let _waiting = Progress::waiting("checking the recording");
        check_recording(skin, &recording)?
    };
    for fault in checked.faults().filter(|fault| fault.kind != FindingKind::Late) {
        let place = place(fault);
        warn(&format!("{} ({place}): {} = {:.3}; {}", fault.kind.name(), fault.evidence, fault.value, fault.fix));
    }
    Ok(())
}

/// The name of the forward map in `--method`.
const FORWARD_MAP: &str = "forward-map";

/// Corrects a method by the labels.
fn correct(skin: &Skin, frames: &[Frame], labels: &[Label], name: &str) -> Outcome<Correction> {
    let _waiting = Progress::waiting("correcting the default method");
    let method = dermis_learn::methods().method(skin, name, &MethodOptions::default())?;
    let detector = method.detector(&[])?;
    Ok(Correction::fit(skin.pixels(), &method, &detector, frames, labels)?)
}

/// Whether a correction finds all labels, and locates them better than the forward map.
fn is_better(correction: &Correction, map: &Calibration) -> bool {
    let CorrectionQuality { labels, found, mean_error_m, .. } = *correction.quality();
    found == labels && mean_error_m < map.quality().mean_error_m
}

/// What the presses gave.
enum Calibrated {
    ForwardMap(Box<Calibration>),
    Correction(Correction),
}

impl Calibrated {
    fn save(&self, folder: &Path, design: &str) -> Outcome {
        Ok(match self {
            Calibrated::ForwardMap(map) => map.save(folder, design)?,
            Calibrated::Correction(correction) => correction.save(folder, design)?,
        })
    }

    fn to_json(&self, design: &str) -> serde_json::Value {
        match self {
            Calibrated::ForwardMap(map) => json!({
                "skin": design,
                "method": FORWARD_MAP,
                "quality": map.quality(),
                "lags": map.lags(),
                "pose": map.pose(),
            }),
            Calibrated::Correction(correction) => json!({
                "skin": design,
                "method": correction.method(),
                "quality": correction.quality(),
            }),
        }
    }

    fn summary(&self) -> Table {
        match self {
            Calibrated::ForwardMap(map) => map_summary(map),
            Calibrated::Correction(correction) => correction_summary(correction),
        }
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
    if let (Some(error), Some(spread)) = (force_error, force_spread) {
        row("error of the force", format!("{:.0} %, spread {spread:.2}", 1e2 * error));
    }
    table
}

fn map_summary(calibration: &Calibration) -> Table {
    let Quality { labels, unlabelled, mean_error_m } = *calibration.quality();
    let mut table = Table::new(&["figure", "value"]);
    let mut row = |name: &str, value: String| table.row([name.to_string(), value]);
    row("labelled presses", labels.to_string());
    row("unlabelled presses used", unlabelled.to_string());
    row("mean error, cross-validated", format!("{:.2} mm", 1e3 * mean_error_m));
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

impl From<dermis_calibrate::CalibrateError> for Failure {
    fn from(error: dermis_calibrate::CalibrateError) -> Self {
        Failure::given(error, None)
    }
}
