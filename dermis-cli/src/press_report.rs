//! The presses of an evaluation: a table with a row for each, and a picture.

use crate::failure::{Failure, Outcome};
use crate::picture::PictureFormat;
use clap::Args;
use dermis::contact::Contact;
use dermis::frame::write_whole;
use dermis::geom::{Point3, Surface};
use dermis::skin::Skin;
use dermis::stats::{Summary, sorted};
use dermis::text::counted;
use dermis_calibrate::Pose;
use dermis_plot::chart::Cumulative;
use dermis_plot::{Drawing, Picture, PressError, View};
use dermis_sim::evaluate::match_contacts;
use std::io::Write;
use std::path::{Path, PathBuf};

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

/// A press of an evaluation.
#[derive(Debug, Clone)]
pub struct EvaluatedPress {
    /// The row of its frame.
    pub row: usize,
    /// The press.
    pub truth: Contact,
    /// Its estimate; `None` if it was missed.
    pub estimate: Option<Estimate>,
}

/// The estimate of a press.
#[derive(Debug, Clone)]
pub struct Estimate {
    /// The contact that was found.
    pub contact: Contact,
    /// Its distance from the press, m.
    pub error_m: f64,
    /// Residual of a forward map; `NaN` for other methods.
    pub misfit: f64,
    /// Whether the frame is unlike all labelled ones; `None` for other methods than a forward map.
    pub unlike: Option<bool>,
}

impl Estimate {
    /// The estimate of a method that states nothing of the frame.
    pub fn new(contact: Contact, error_m: f64) -> Self {
        Estimate { contact, error_m, misfit: f64::NAN, unlike: None }
    }
}

/// The presses of a frame, matched with its contacts.
pub fn matched(row: usize, touches: &[Contact], contacts: &[Contact], surface: &Surface) -> Vec<EvaluatedPress> {
    let pairs = match_contacts(touches, contacts, surface).pairs;
    let press = |(touch, truth): (usize, &Contact)| {
        let pair = pairs.iter().find(|pair| pair.0 == touch);
        let estimate = pair.map(|&(_, contact, error_m)| Estimate::new(contacts[contact], error_m));
        EvaluatedPress { row, truth: *truth, estimate }
    };
    touches.iter().enumerate().map(press).collect()
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
        self.picture.as_deref().map_or(Ok(()), |path| PictureFormat::of(path).map(drop))
    }

    /// Writes the files that were asked for.
    pub fn write(&self, report: &PressReport<'_>) -> Outcome {
        if let Some(path) = &self.output {
            report.write_csv(path)?;
        }
        match &self.picture {
            Some(path) => PictureFormat::of(path)?.save(&report.picture()?, path),
            None => Ok(()),
        }
    }
}

/// The columns of the table.
const COLUMNS: &str = "frame,true_x_m,true_y_m,true_z_m,x_m,y_m,z_m,error_m,sd_m,confidence,true_force_n,force_n,force_sd_n,\
    misfit,unlike,true_theta_rad,theta_rad";

impl PressReport<'_> {
    fn write_csv(&self, path: &Path) -> Outcome {
        let surface = self.skin.design().body.surface();
        Ok(write_whole(path, |out| {
            writeln!(out, "{COLUMNS}")?;
            self.presses.iter().try_for_each(|press| write_row(out, press, &surface))
        })?)
    }

    /// The presses on the skin, and the cumulative distribution of the error.
    fn picture(&self) -> Outcome<Picture> {
        let design = self.skin.design();
        let errors_mm = sorted(self.estimates().map(|estimate| 1e3 * estimate.error_m));
        let Summary { mean, median, p95, .. } = Summary::of(&errors_mm);
        let (total, missed) = (self.presses.len(), self.presses.len() - errors_mm.len());
        let presses: Vec<PressError> = self.presses.iter().map(|press| self.on_skin(press)).collect();
        let scene = Drawing::new(design, self.skin.mesh())
            .errors(&presses)
            .titled(format!("{}: errors of {}", design.name, counted(total, "press")), self.method);
        let skin = View::Flat.draw(&scene, design).map_err(|error| Failure::Ours(error.to_string()))?;
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

    fn estimates(&self) -> impl Iterator<Item = &Estimate> {
        self.presses.iter().filter_map(|press| press.estimate.as_ref())
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

/// A row of the table; unknown values are empty.
fn write_row(out: &mut dyn Write, press: &EvaluatedPress, surface: &Surface) -> std::io::Result<()> {
    let EvaluatedPress { row, truth, estimate } = press;
    let none = Estimate::new(
        Contact { confidence: f64::NAN, ..Contact::truth([f64::NAN; 3], [f64::NAN; 3], f64::NAN) },
        f64::NAN,
    );
    let Estimate { contact, error_m, misfit, unlike } = estimate.as_ref().unwrap_or(&none);
    let theta_rad = |position_m: Point3| surface.theta_rad(position_m).unwrap_or(f64::NAN);
    let ([x, y, z], [u, v, w]) = (truth.position_m, contact.position_m);
    let forces_n = [truth.force_n, contact.force_n, contact.force_sd_n];
    let found = [u, v, w, *error_m, contact.sd_m, contact.confidence];
    let known = |value: f64| if value.is_finite() { format!("{value:?}") } else { String::new() };
    let list = |values: &[f64]| values.iter().map(|value| known(*value)).collect::<Vec<_>>().join(",");
    let unlike = unlike.map_or(String::new(), |unlike| u8::from(unlike).to_string());
    let angles = list(&[theta_rad(truth.position_m), theta_rad(contact.position_m)]);
    let values = [list(&[x, y, z]), list(&found), list(&forces_n), known(*misfit), unlike, angles];
    writeln!(out, "{row},{}", values.join(","))
}
