//! The presses of an evaluation: a table with a row for each, and a picture.

use crate::failure::{Failure, Outcome};
use crate::picture::{is_png, save};
use clap::Args;
use dermis::contact::Contact;
use dermis::frame::{EvaluatedPress, write_presses};
use dermis::geom::Point3;
use dermis::skin::Skin;
use dermis::stats::{Summary, sorted};
use dermis::text::counted;
use dermis_calibrate::Pose;
use dermis_plot::chart::Cumulative;
use dermis_plot::{Drawing, Picture, PressError, View};
use std::path::PathBuf;

/// The files of an evaluation.
#[derive(Debug, Args)]
pub struct ReportArguments {
    /// Write a row for each press (CSV): its true and its estimated position, the error, the standard deviation, the
    /// confidence, the forces where they are known.
    #[arg(short, long, value_name = "FILE", conflicts_with = "draws")]
    output: Option<PathBuf>,
    /// Draw the errors (.svg or .png): the presses on the skin, coloured by the error, with a line to each estimate,
    /// and the cumulative distribution of the error.
    #[arg(long, value_name = "FILE", conflicts_with = "draws")]
    picture: Option<PathBuf>,
}

/// An evaluation to report.
pub struct PressReport<'a> {
    /// The skin.
    pub skin: &'a Skin,
    /// The name of the method.
    pub method: &'a str,
    /// The presses, in the order of their rows.
    pub presses: &'a [EvaluatedPress],
    /// The pose of the skin in the frame of reference of the positions; `None` for positions on the skin.
    pub pose: Option<Pose>,
}

impl ReportArguments {
    /// Refuses names of files before anything is computed.
    pub fn check(&self) -> Outcome {
        if let Some(path) = self.output.as_ref().filter(|path| path.extension().is_none_or(|ending| ending != "csv")) {
            let message = format!("--output {}: the presses are written as .csv", path.display());
            return Err(Failure::given(message, Some("choose this ending")));
        }
        self.picture.as_deref().map_or(Ok(()), |path| is_png(path).map(drop))
    }

    /// Writes the files that were asked for.
    pub fn write(&self, report: &PressReport<'_>) -> Outcome {
        if let Some(path) = &self.output {
            write_presses(path, &report.skin.design().body.surface(), report.presses)?;
        }
        match &self.picture {
            Some(path) => save(&report.picture()?, path),
            None => Ok(()),
        }
    }
}

impl PressReport<'_> {
    /// The presses on the skin, and the cumulative distribution of the error.
    fn picture(&self) -> Outcome<Picture> {
        let design = self.skin.design();
        let errors_mm = sorted(self.presses.iter().filter_map(|press| Some(1e3 * press.estimate.as_ref()?.error_m)));
        let Summary { mean, median, p95, .. } = Summary::of(&errors_mm);
        let (total, missed) = (self.presses.len(), self.presses.len() - errors_mm.len());
        let presses: Vec<PressError> = self.presses.iter().map(|press| self.on_skin(press)).collect();
        let scene = Drawing::new(design, self.skin.mesh())
            .errors(&presses)
            .titled(format!("{}: errors of {}", design.name, counted(total, "press")), self.method);
        let skin = View::Flat.draw(&scene, design)?;
        let missed = if missed > 0 { format!(", {missed} missed") } else { String::new() };
        let marks = [("median", median), ("95th percentile", p95)].into_iter().filter(|mark| mark.1.is_finite());
        let chart = Cumulative {
            title: "Cumulative distribution of the error",
            subtitle: &format!("mean {mean:.2} mm{missed}"),
            below: "error (mm)",
            left: "fraction of presses",
            values: &errors_mm,
            total,
            marks: marks.map(|(name, value)| (value, format!("{name} {value:.2} mm"))).collect(),
        };
        Ok(skin.beside(&chart.draw()))
    }

    fn on_skin(&self, press: &EvaluatedPress) -> PressError {
        let on_skin = |position_m: Point3| self.pose.map_or(position_m, |pose| pose.to_skin(position_m));
        let estimate = press.estimate.as_ref();
        PressError {
            truth: Contact { position_m: on_skin(press.truth.position_m), ..press.truth },
            estimate: estimate.map(|estimate| (on_skin(estimate.contact.position_m), estimate.error_m)),
        }
    }
}
