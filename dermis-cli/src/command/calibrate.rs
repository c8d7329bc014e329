//! `dermis calibrate`: a real skin calibrated with measured presses.

use crate::calibrated::{Presses, late_channels};
use crate::console::{Progress, print, print_json, warn};
use crate::failure::{Failure, Outcome};
use crate::frames::FrameArguments;
use crate::rows::Rows;
use crate::skin;
use clap::Args;
use dermis::frame::Frame;
use dermis::geom::vector::distance;
use dermis::method::MethodOptions;
use dermis::skin::Skin;
use dermis::stats::mean;
use dermis_calibrate::{Calibration, Label, LabelFrame, Quality};
use dermis_study::report::Table;
use rayon::prelude::*;
use serde_json::json;
use std::path::PathBuf;

/// The arguments of `dermis calibrate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    frames: FrameArguments,
    /// Measured presses, one per frame and in the order of recording: with a header as for `dermis evaluate`, or x,y,z (m) without a
    /// header in the frame of the robot that pressed.
    #[arg(long, value_name = "FILE")]
    truth: PathBuf,
    /// Rows of the presses to calibrate with, as in 0..500 (row 500 not included) [default: all].
    #[arg(long, value_name = "ROWS")]
    labels: Option<Rows>,
    /// Use the frames after the last label, too, without their positions. Helps with fewer than 300 labels.
    #[arg(long)]
    unlabelled: bool,
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
        let frames = self.frames.read(&skin, &[])?.frames;
        let presses = Presses::read(&self.truth, &skin, frames.len())?;
        let labels = presses.labels(self.labels.as_ref())?;
        let last = labels.last().map_or(0, |label| label.row);
        let used = if self.unlabelled { &frames[..] } else { &frames[..=last] };
        let progress = Progress::waiting("fitting the forward map");
        let calibration = Calibration::fit(&skin, used, &labels, presses.frame())?;
        calibration.save(&self.output, &skin.design().name)?;
        drop(progress);
        if presses.frame() == LabelFrame::Skin {
            warn_of_better_method(&skin, &frames, &labels, calibration.quality())?;
        }
        if self.json {
            return print_json(&json!({
                "skin": skin.design().name,
                "quality": calibration.quality(),
                "lags": calibration.lags(),
                "pose": calibration.pose(),
            }));
        }
        print(&format!("{}\nwritten to {}\n", summary(&calibration).to_text(), self.output.display()))
    }
}

/// Warns where the method that needs no calibration locates the labelled presses better.
fn warn_of_better_method(skin: &Skin, frames: &[Frame], labels: &[Label], quality: &Quality) -> Outcome {
    let method = dermis_learn::methods().method(skin, "", &MethodOptions::default())?;
    let detector = method.detector(&[])?;
    let error_m = |label: &Label| -> Outcome<Option<f64>> {
        let contacts = method.contacts(&frames[label.row], &detector)?;
        Ok(contacts.first().map(|contact| distance(contact.position_m, label.position_m)))
    };
    let errors_m: Vec<Option<f64>> = labels.par_iter().map(error_m).collect::<Outcome<_>>()?;
    let found: Vec<f64> = errors_m.into_iter().flatten().collect();
    let mean_m = mean(&found);
    if found.len() == labels.len() && mean_m < quality.mean_error_m {
        warn(&format!(
            "{} locates the same presses within {:.2} mm without a calibration: use it, or calibrate with more presses",
            method.label(),
            1e3 * mean_m
        ));
    }
    Ok(())
}

fn summary(calibration: &Calibration) -> Table {
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
