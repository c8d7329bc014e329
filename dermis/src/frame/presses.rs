//! Presses with their estimates, and their table.

use crate::contact::Contact;
use crate::frame::{TableError, write_whole};
use crate::geom::{Point3, Surface};
use std::io::Write;
use std::path::Path;

/// A press and what a method finds of it.
#[derive(Debug, Clone)]
pub struct EvaluatedPress {
    /// The row of its frame.
    pub row: usize,
    /// The press.
    pub truth: Contact,
    /// Its estimate; `None` if it was missed.
    pub estimate: Option<PressEstimate>,
}

/// The estimate of a press.
#[derive(Debug, Clone)]
pub struct PressEstimate {
    /// The contact that was found.
    pub contact: Contact,
    /// Its distance from the press, m.
    pub error_m: f64,
    /// Residual of a forward map; `NaN` for other methods.
    pub misfit: f64,
    /// Whether the frame is unlike all labelled ones; `None` for other methods than a forward map.
    pub unlike: Option<bool>,
}

impl PressEstimate {
    /// The estimate of a method that states nothing of the frame.
    pub fn new(contact: Contact, error_m: f64) -> Self {
        PressEstimate { contact, error_m, misfit: f64::NAN, unlike: None }
    }
}

/// The columns of the table.
const COLUMNS: &str = "frame,true_x_m,true_y_m,true_z_m,x_m,y_m,z_m,error_m,sd_m,confidence,true_force_n,force_n,force_sd_n,\
    misfit,unlike,true_theta_rad,theta_rad";

/// Writes a row for each press (CSV): true and estimated position (m) and force (N), with their error and deviations.
///
/// # Errors
/// A file that cannot be written.
pub fn write_presses(path: &Path, surface: &Surface, presses: &[EvaluatedPress]) -> Result<(), TableError> {
    write_whole(path, |out| {
        writeln!(out, "{COLUMNS}")?;
        presses.iter().try_for_each(|press| write_row(out, press, surface))
    })
}

/// A row of the table; unknown values are empty.
fn write_row(out: &mut dyn Write, press: &EvaluatedPress, surface: &Surface) -> std::io::Result<()> {
    let EvaluatedPress { row, truth, estimate } = press;
    let nowhere = Contact { confidence: f64::NAN, ..Contact::truth([f64::NAN; 3], [f64::NAN; 3], f64::NAN) };
    let none = PressEstimate::new(nowhere, f64::NAN);
    let PressEstimate { contact, error_m, misfit, unlike } = estimate.as_ref().unwrap_or(&none);
    let theta_rad = |position_m: Point3| surface.theta_rad(position_m).unwrap_or(f64::NAN);
    let ([x, y, z], [u, v, w]) = (truth.position_m, contact.position_m);
    let known = |value: f64| if value.is_finite() { format!("{value:?}") } else { String::new() };
    let list = |values: &[f64]| values.iter().map(|value| known(*value)).collect::<Vec<_>>().join(",");
    let before = [x, y, z, u, v, w, *error_m, contact.sd_m, contact.confidence];
    let forces_n = [truth.force_n, contact.force_n, contact.force_sd_n];
    let unlike = unlike.map_or(String::new(), |unlike| u8::from(unlike).to_string());
    let angles = list(&[theta_rad(truth.position_m), theta_rad(contact.position_m)]);
    writeln!(out, "{row},{},{},{},{unlike},{angles}", list(&before), list(&forces_n), known(*misfit))
}
