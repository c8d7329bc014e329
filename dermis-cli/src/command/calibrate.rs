//! `dermis calibrate`: a real skin calibrated with measured presses.

use crate::console::{Progress, print, print_json, warn, warn_of};
use crate::failure::{Failure, Outcome};
use crate::fitted;
use crate::frames::{CurrentArguments, FrameArguments, Incomplete, PAIRED_HELP, Recorded};
use crate::guided::GuidedArguments;
use crate::range::count;
use crate::rows::Rows;
use crate::skin;
use clap::{ArgGroup, Args};
use dermis::finding::FindingKind;
use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::method::Methods;
use dermis::skin::Skin;
use dermis_calibrate::checks::{Recording, check_forces, check_recording};
use dermis_calibrate::{
    Alternatives, Calibration, Fitted, Label, LabelFrame, LearningPoint, Presses, expected_error_m, learning_curve,
};
use dermis_plot::report::Table;
use serde::Serialize;
use std::path::PathBuf;

/// The arguments of `dermis calibrate`.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("rest").args(["baseline", "difference", "live"]).required(true).multiple(true))]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Frames, one press in each row (CSV, NPY or NPZ; ohm, or see --unit).
    #[arg(long, value_name = "FILE", required_unless_present = "live")]
    frames: Option<PathBuf>,
    /// Untouched frames, one per row; their mean is the baseline.
    #[arg(long, value_name = "FILE", conflicts_with = "difference")]
    baseline: Option<PathBuf>,
    /// The frames are differences from the untouched skin.
    #[arg(long)]
    difference: bool,
    #[arg(long, requires = "baseline", help = PAIRED_HELP)]
    paired: bool,
    #[command(flatten)]
    currents: CurrentArguments,
    /// Measured presses, one per frame and in the order of recording: with a header (frame,x_m,y_m on a flat skin,
    /// frame,z_m,theta_rad on a cylinder; optionally force_n), or x,y,z (m; optionally the force, N) without a header
    /// in the frame of reference of the robot that pressed.
    #[arg(long, value_name = "FILE", required_unless_present = "live")]
    truth: Option<PathBuf>,
    /// Rows of the presses to calibrate with, as in 0..500 (row 500 not included) [default: all].
    #[arg(long, value_name = "ROWS")]
    labels: Option<Rows>,
    /// Also use the frames after the last label, without their positions. Helps with fewer than 300 labels.
    #[arg(long)]
    unlabelled: bool,
    /// What to calibrate: forward-map learns the skin from the presses alone; the name or folder of a method (spots,
    /// noser) corrects the positions and forces of that method. Corrections need positions on the skin [default: whichever
    /// locates the labels better, of the forward map and the default method of the skin; with --suggest: forward-map]
    #[arg(long, value_name = "METHOD")]
    method: Option<String>,
    /// Name the N positions whose presses would help a forward map most, and print its error against the number of
    /// labels.
    #[arg(long, value_name = "N", conflicts_with = "live", value_parser = count(1..=1000u64))]
    suggest: Option<u64>,
    /// Folder to write: the method for --method.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Go on with frames that do not fit their baseline, and write a calibration that is worse than none.
    #[arg(long)]
    force: bool,
    /// Print JSON (SI units) instead of a table.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    guided: GuidedArguments,
}

impl Arguments {
    /// Fits the calibration and writes it.
    pub fn run(self) -> Outcome {
        Fitted::check_folder(&self.output)?;
        let (Some(frames), Some(truth)) = (&self.frames, &self.truth) else {
            return self.guided.run(&self.design, &self.output, self.difference, self.json);
        };
        self.guided.check_unused()?;
        let method = self.method()?;
        let skin = skin::load(&self.design)?;
        let frames = FrameArguments {
            frames: frames.clone(),
            baseline: self.baseline.clone(),
            difference: self.difference,
            paired: self.paired,
            force: self.force,
            currents: self.currents.clone(),
        };
        let recorded = frames.read_recorded(&skin, &[], Incomplete::LeftOut)?;
        frames.check(&skin, &recorded, &[], false)?;
        let presses = Presses::read(truth, &skin, recorded.used.count)?.of_rows(&recorded.used.rows);
        warn_of_faults(&skin, &recorded, &presses)?;
        let labels = presses.labels(&recorded.used.chosen(self.labels.as_ref(), "--labels")?);
        if let Some(found) = check_forces(&labels) {
            warn_of(&found);
        }
        let mut used = recorded.into_differences();
        if !self.unlabelled {
            used.frames.truncate(labels.last().map_or(0, |label| label.row) + 1);
        }
        let (fitted, alternatives) = fitted::fit(&skin, &used, &labels, presses.frame(), method)?;
        let outlook = self.outlook(&skin, &used.frames, &labels, presses.frame(), &fitted)?;
        if let Some(reason) = alternatives.reason(&fitted) {
            let fix = Alternatives::FIX;
            if !self.force {
                // Where to press next is asked while there are too few presses.
                if let Some(outlook) = outlook.as_ref().filter(|_| !self.json) {
                    print(&format!("{}\n", outlook.to_text()))?;
                }
                return Err(Failure::given(reason, Some(&format!("{fix}; --force writes it all the same"))));
            }
            warn(&format!("{reason}; {fix}"));
        }
        fitted.doubts(&skin, &labels).iter().for_each(|doubt| warn(doubt));
        fitted.save(&self.output, skin.design())?;
        if self.json {
            let mut json = fitted::to_json(&fitted, &skin.design().name, &labels);
            json["outlook"] = serde_json::json!(outlook);
            json["alternatives"] = serde_json::json!(alternatives);
            return print_json(&json);
        }
        let outlook = outlook.map_or(String::new(), |outlook| outlook.to_text());
        print(&format!(
            "{}\n{outlook}written to {}\n",
            fitted::summary(&fitted, &labels, Some(&alternatives)).to_text(),
            self.output.display()
        ))
    }

    /// What is calibrated: with `--suggest` a forward map.
    fn method(&self) -> Outcome<Option<&str>> {
        match (self.suggest, self.method.as_deref().filter(|name| !Methods::is_default(name))) {
            (None, method) => Ok(method),
            (Some(_), None | Some(Fitted::FORWARD_MAP)) => Ok(Some(Fitted::FORWARD_MAP)),
            (Some(_), Some(method)) => {
                let message = format!("--suggest is for forward maps, not for a correction of {method}");
                Err(Failure::given(message, Some("give --method forward-map, or leave --suggest out")))
            }
        }
    }

    /// What more presses would give, where that is asked for.
    fn outlook(
        &self,
        skin: &Skin,
        frames: &[Frame],
        labels: &[Label],
        frame: LabelFrame,
        fitted: &Fitted,
    ) -> Outcome<Option<Outlook>> {
        match (self.suggest, fitted) {
            (Some(count), Fitted::ForwardMap(map)) => {
                Outlook::of(skin, frames, labels, frame, map, count as usize).map(Some)
            }
            _ => Ok(None),
        }
    }
}

/// What more presses would give.
#[derive(Debug, Serialize)]
struct Outlook {
    learning_curve: Vec<LearningPoint>,
    /// Expected error with twice as many labels, m.
    expected_error_m: Option<f64>,
    /// Where to press next, in the coordinates of the labels, m.
    suggested_m: Vec<Point3>,
}

impl Outlook {
    fn of(
        skin: &Skin,
        frames: &[Frame],
        labels: &[Label],
        frame: LabelFrame,
        map: &Calibration,
        count: usize,
    ) -> Outcome<Self> {
        let _waiting = Progress::waiting("fitting parts of the labels");
        let learning_curve = learning_curve(skin, frames, labels, frame, map)?;
        let expected_error_m = expected_error_m(&learning_curve);
        Ok(Outlook { learning_curve, expected_error_m, suggested_m: map.suggest(skin, count)? })
    }

    fn to_text(&self) -> String {
        let mut curve = Table::new(&["labels", "mean error, mm"]);
        for LearningPoint { labels, mean_error_m } in &self.learning_curve {
            curve.row([labels.to_string(), format!("{:.2}", 1e3 * mean_error_m)]);
        }
        if let (Some(error_m), Some(last)) = (self.expected_error_m, self.learning_curve.last()) {
            curve.row([format!("{} (expected)", 2 * last.labels), format!("{:.2}", 1e3 * error_m)]);
        }
        let mut places = Table::new(&["press next: x, mm", "y, mm", "z, mm"]);
        for position_m in &self.suggested_m {
            places.row(position_m.map(|value| format!("{:.1}", 1e3 * value)));
        }
        format!("{}\n{}\n", curve.to_text(), places.to_text())
    }
}

/// Warns of faults of the recording that the calibration does not mend itself.
fn warn_of_faults(skin: &Skin, recorded: &Recorded, presses: &Presses) -> Outcome {
    let Recorded { frames, untouched, used, .. } = recorded;
    let (positions_m, label_frame) = (Some(presses.positions_m()), presses.frame());
    let recording = Recording { frames, untouched, positions_m, label_frame };
    let checked = {
        let _waiting = Progress::waiting("checking the recording");
        check_recording(skin, &recording)?
    };
    for mut fault in checked.faults().filter(|fault| fault.kind != FindingKind::Late).cloned() {
        fault.rows = used.rows_of(&fault.rows);
        warn_of(&fault);
    }
    Ok(())
}
