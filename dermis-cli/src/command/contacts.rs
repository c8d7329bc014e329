//! `dermis contacts`: frames to contacts.

use crate::console::{Progress, print};
use crate::failure::{Failure, Outcome};
use crate::frames::FrameArguments;
use crate::method::{DetectArguments, MethodArguments};
use crate::skin;
use clap::{Args, ValueEnum};
use dermis::contact::{ConductanceChange, Contact};
use dermis::frame::write_whole;
use dermis::geom::Surface;
use dermis::method::Method;
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_calibrate::{Calibration, Pose};
use rayon::prelude::*;
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;

/// The arguments of `dermis contacts`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    frames: FrameArguments,
    #[command(flatten)]
    method: MethodArguments,
    #[command(flatten)]
    detect: DetectArguments,
    /// Frame of reference of positions and normals: the skin's own, or that of the robot that pressed the labels of a
    /// calibration.
    #[arg(long, value_enum, default_value_t = Coordinates::Skin)]
    coordinates: Coordinates,
    /// File to write: a table with a row per contact (.csv; theta_rad on cylinders alone, conductance with
    /// --both-signs), or a line of JSON per frame (.jsonl).
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

/// A frame of reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Coordinates {
    /// The skin's own.
    Skin,
    /// The robot's.
    Robot,
}

/// Writes the contacts of frames on a surface.
type Format = fn(&mut dyn Write, &[Vec<Contact>], &Surface) -> std::io::Result<()>;

/// A frame as a line of JSON.
#[derive(Serialize)]
struct FrameContacts<'a> {
    frame: usize,
    contacts: &'a [Contact],
}

impl Arguments {
    /// Detects the contacts and writes them.
    pub fn run(self) -> Outcome {
        let write = self.format()?;
        let skin = skin::load(&self.design)?;
        let differences = self.frames.read(&skin, self.method.left_out())?;
        let method = self.method.prepare(&skin, &differences)?;
        let pose = self.pose(&skin, &method)?;
        let detector = self.detect.detector(&skin, &method, &differences.untouched)?;
        let progress = Progress::new("reconstructing", differences.frames.len());
        let contacts = differences.frames.par_iter().map(|difference| {
            let contacts = method.contacts(difference, &detector);
            progress.step();
            contacts
        });
        let mut contacts = contacts.collect::<Result<Vec<Vec<Contact>>, _>>()?;
        drop(progress);
        if let Some(pose) = pose {
            contacts.iter_mut().flatten().for_each(|contact| to_robot(contact, &pose));
        }
        let surface = skin.design().body.surface();
        write_whole(&self.output, |out| write(out, &contacts, &surface))?;
        let count: usize = contacts.iter().map(Vec::len).sum();
        let (contacts, frames) = (counted(count, "contact"), counted(contacts.len(), "frame"));
        print(&format!("{}: {contacts} in {frames} ({})\n", self.output.display(), method.description()))
    }

    /// The pose of the skin where contacts are wanted in the robot's frame; `None` for the skin's own.
    fn pose(&self, skin: &Skin, method: &Method) -> Outcome<Option<Pose>> {
        if self.coordinates == Coordinates::Skin {
            return Ok(None);
        }
        let pose = match self.method.calibration() {
            Some(folder) => Calibration::load(folder, skin.design())?.pose().copied(),
            None => None,
        };
        let unknown = || {
            let message = format!("--coordinates robot: {} does not know the pose of the skin", method.label());
            let fix = "calibrate with labels in the robot's frame (x,y,z without a header), or leave --coordinates out";
            Failure::given(message, Some(fix))
        };
        pose.map(Some).ok_or_else(unknown)
    }

    fn format(&self) -> Outcome<Format> {
        match self.output.extension().and_then(|extension| extension.to_str()) {
            Some("csv") if self.detect.both_signs() => Ok(write_csv_of_both_signs),
            Some("csv") => Ok(write_csv),
            Some("jsonl") => Ok(write_jsonl),
            _ => {
                let message = format!("{}: contacts are written as .csv or .jsonl", self.output.display());
                Err(Failure::given(message, Some("choose one of these endings")))
            }
        }
    }
}

/// Moves a contact from the skin's frame to the robot's.
fn to_robot(contact: &mut Contact, pose: &Pose) {
    contact.position_m = pose.to_robot(contact.position_m);
    contact.normal = pose.direction_to_robot(contact.normal);
}

/// A row for each contact.
fn write_csv(out: &mut dyn Write, frames: &[Vec<Contact>], surface: &Surface) -> std::io::Result<()> {
    write_rows(out, frames, surface, "", |_| String::new())
}

/// A row for each contact, with the sign of its change of conductance.
fn write_csv_of_both_signs(out: &mut dyn Write, frames: &[Vec<Contact>], surface: &Surface) -> std::io::Result<()> {
    let sign = |contact: &Contact| format!(",{}", contact.conductance.map_or("", ConductanceChange::name));
    write_rows(out, frames, surface, ",conductance", sign)
}

fn write_rows(
    out: &mut dyn Write,
    frames: &[Vec<Contact>],
    surface: &Surface,
    last_column: &str,
    last: impl Fn(&Contact) -> String,
) -> std::io::Result<()> {
    writeln!(out, "frame,{},theta_rad{last_column}", Contact::COLUMNS.join(","))?;
    for (frame, contacts) in frames.iter().enumerate() {
        for contact in contacts {
            let known = |value: f64| if value.is_finite() { format!("{value:?}") } else { String::new() };
            let theta_rad = surface.theta_rad(contact.position_m).map_or_else(String::new, known);
            let values: Vec<String> = contact.values().into_iter().map(known).collect();
            writeln!(out, "{frame},{},{},{theta_rad}{}", contact.id, values.join(","), last(contact))?;
        }
    }
    Ok(())
}

/// A line of JSON for each frame.
fn write_jsonl(out: &mut dyn Write, frames: &[Vec<Contact>], _: &Surface) -> std::io::Result<()> {
    for (frame, contacts) in frames.iter().enumerate() {
        serde_json::to_writer(&mut *out, &FrameContacts { frame, contacts })?;
        out.write_all(b"\n")?;
    }
    Ok(())
}
