//! `dermis calibrate`: a real skin calibrated with measured presses.

use crate::calibrated::Presses;
use crate::check_page::place;
use crate::console::{Progress, print, print_json, warn};
use crate::failure::Outcome;
use crate::fitted;
use crate::frames::{FrameArguments, Recorded};
use crate::guided::GuidedArguments;
use crate::rows::Rows;
use crate::skin;
use clap::Args;
use dermis::skin::Skin;
use dermis_calibrate::checks::{FindingKind, Recording, check_recording};
use std::path::PathBuf;

/// The arguments of `dermis calibrate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Frames, one press in each row (CSV, NPY or NPZ; ohm).
    #[arg(long, value_name = "FILE", required_unless_present = "live")]
    frames: Option<PathBuf>,
    /// Untouched frames, one per row; their mean is the baseline.
    #[arg(long, value_name = "FILE", required_unless_present_any = ["difference", "live"], conflicts_with = "difference")]
    baseline: Option<PathBuf>,
    /// The frames are differences from the untouched skin.
    #[arg(long)]
    difference: bool,
    /// Measured presses, one per frame and in the order of recording: with a header (frame,x_m,y_m on a flat skin, frame,z_m,theta_rad on a
    /// cylinder; optionally force_n), or x,y,z (m) without a header in the frame of reference of the robot that pressed.
    #[arg(long, value_name = "FILE", required_unless_present = "live")]
    truth: Option<PathBuf>,
    /// Rows of the presses to calibrate with, as in 0..500 (row 500 not included) [default: all].
    #[arg(long, value_name = "ROWS")]
    labels: Option<Rows>,
    /// Also use the frames after the last label, without their positions. Helps with fewer than 300 labels.
    #[arg(long)]
    unlabelled: bool,
    /// What to calibrate: forward-map learns the skin from the presses alone; the name or folder of a method (best,
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
    #[command(flatten)]
    guided: GuidedArguments,
}

impl Arguments {
    /// Fits the calibration and writes it.
    pub fn run(self) -> Outcome {
        let (Some(frames), Some(truth)) = (&self.frames, &self.truth) else {
            return self.guided.run(&self.design, &self.output, self.difference, self.json);
        };
        self.guided.check_unused()?;
        let skin = skin::load(&self.design)?;
        let (frames, baseline) = (frames.clone(), self.baseline.clone());
        let frames = FrameArguments { frames, baseline, difference: self.difference };
        let recorded = frames.read_recorded(&skin.design().protocol)?;
        let presses = Presses::read(truth, &skin, recorded.frames.len())?;
        warn_of_faults(&skin, &recorded, &presses)?;
        let frames = recorded.into_differences().frames;
        let labels = presses.labels(self.labels.as_ref())?;
        let last = labels.last().map_or(0, |label| label.row);
        let used = if self.unlabelled { &frames[..] } else { &frames[..=last] };
        let fitted = fitted::fit(&skin, used, &labels, presses.frame(), self.method.as_deref())?;
        fitted.save(&self.output, &skin.design().name)?;
        if self.json {
            return print_json(&fitted.to_json(&skin.design().name));
        }
        print(&format!("{}\nwritten to {}\n", fitted.summary().to_text(), self.output.display()))
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
