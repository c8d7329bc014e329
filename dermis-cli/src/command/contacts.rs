//! `dermis contacts`: frames to contacts.

use crate::console::print;
use crate::failure::Outcome;
use crate::frames::FrameArguments;
use crate::method::MethodArguments;
use crate::skin::{Per, Skin};
use clap::Args;
use dermis::contact::Contact;
use dermis::frame::write_whole;
use dermis::geom::Surface;
use std::io::Write;
use std::path::PathBuf;

/// The columns of the table of contacts.
const COLUMNS: &str = "frame,id,x_m,y_m,z_m,theta_rad,nx,ny,nz,area_m2,strength,confidence,sd_m";

/// The arguments of `dermis contacts`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The design: a path, or a shipped name.
    design: String,
    #[command(flatten)]
    frames: FrameArguments,
    #[command(flatten)]
    method: MethodArguments,
    /// The table to write (CSV), a row per contact; theta is empty off cylinders.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

impl Arguments {
    /// Finds the contacts and writes them.
    pub fn run(self) -> Outcome {
        let skin = Skin::load(&self.design)?;
        let differences = self.frames.read(&skin.design.protocol)?;
        let method = self.method.prepare(&skin, Per::Pixel, &differences)?;
        let detector = method.detector(&differences)?;
        let images = method.images(&differences.frames)?;
        let contacts: Vec<Vec<Contact>> = images.iter().map(|image| detector.detect(image)).collect();
        let surface = skin.design.body.surface();
        write_whole(&self.output, |out| write(out, &contacts, &surface))?;
        let count: usize = contacts.iter().map(Vec::len).sum();
        print(&format!("{}: {count} contacts in {} frames\n", self.output.display(), contacts.len()))
    }
}

/// Writes contacts frame by frame.
fn write(out: &mut dyn Write, frames: &[Vec<Contact>], surface: &Surface) -> std::io::Result<()> {
    writeln!(out, "{COLUMNS}")?;
    for (frame, contacts) in frames.iter().enumerate() {
        for contact in contacts {
            let [x, y, z] = contact.position_m;
            let [nx, ny, nz] = contact.normal;
            let theta = surface.theta_rad(contact.position_m).map(|theta| format!("{theta:?}")).unwrap_or_default();
            let Contact { id, area_m2, strength, confidence, sd_m, .. } = contact;
            write!(out, "{frame},{id},{x:?},{y:?},{z:?},{theta},{nx:?},{ny:?},{nz:?},")?;
            writeln!(out, "{area_m2:?},{strength:?},{confidence:?},{sd_m:?}")?;
        }
    }
    Ok(())
}
