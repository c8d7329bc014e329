//! `dermis contacts`: frames to contacts.

use crate::console::print;
use crate::failure::{Failure, Outcome};
use crate::frames::FrameArguments;
use crate::method::{DetectArguments, MethodArguments};
use crate::skin;
use clap::{Args, ValueEnum};
use dermis::contact::{ConductanceChange, Contact, Field, FieldKind};
use dermis::estimate::noise::ChannelNoise;
use dermis::frame::write_whole;
use dermis::geom::Surface;
use dermis::method::Method;
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_calibrate::{Calibration, Pose};
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

/// A frame as a line of JSON.
#[derive(Serialize)]
struct FrameContacts<'a> {
    frame: usize,
    contacts: &'a [Contact],
}

impl Arguments {
    /// Detects the contacts and writes them.
    pub fn run(self) -> Outcome {
        let is_table = self.is_table()?;
        let skin = skin::load(&self.design)?;
        let differences = self.frames.read(&skin, &self.method)?;
        let method = self.method.prepare(&skin, &differences)?;
        let pose = self.pose(&skin, &method)?;
        let detector = self.detect.detector(&skin, &method, &differences)?;
        let frames = &differences.frames;
        let mut contacts = self.detect.in_each(&method, &detector, frames, |_, contacts| contacts)?;
        if let Some(pose) = pose {
            contacts.iter_mut().flatten().for_each(|contact| to_robot(contact, &pose));
        }
        let surface = skin.design().body.surface();
        write_whole(&self.output, |out| match is_table {
            true => write_csv(out, &contacts, &surface, self.detect.both_signs()),
            false => write_jsonl(out, &contacts),
        })?;
        let count: usize = contacts.iter().map(Vec::len).sum();
        let (contacts, frames) = (counted(count, "contact"), counted(contacts.len(), "frame"));
        let noise = ChannelNoise::of_differences(&differences, &skin.design().protocol);
        let noise = noise.map(|noise| format!("{noise}\n")).unwrap_or_default();
        print(&format!("{}: {contacts} in {frames} ({})\n{noise}", self.output.display(), method.description()))
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

    /// Whether a table is written, and not lines of JSON.
    fn is_table(&self) -> Outcome<bool> {
        match self.output.extension().and_then(|extension| extension.to_str()) {
            Some("csv") => Ok(true),
            Some("jsonl") => Ok(false),
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

/// A row for each contact; its sign is last, where contacts of both signs were looked for.
fn write_csv(out: &mut dyn Write, frames: &[Vec<Contact>], surface: &Surface, both_signs: bool) -> std::io::Result<()> {
    let is_sign = |field: &&Field<Contact>| field.kind == FieldKind::Change;
    let fields = Contact::FIELDS.iter().filter(|field| !is_sign(field));
    let signs = Contact::FIELDS.iter().filter(|field| both_signs && is_sign(field));
    let columns = |field: &Field<Contact>| field.columns.join(",");
    let header = fields.clone().map(columns).chain(["theta_rad".into()]).chain(signs.clone().map(columns));
    writeln!(out, "frame,{}", header.collect::<Vec<String>>().join(","))?;
    for (frame, contact) in frames.iter().enumerate().flat_map(|(frame, found)| found.iter().map(move |of| (frame, of)))
    {
        let cells = |field: &Field<Contact>| match field.kind {
            FieldKind::Count => field.numbers(contact).map(|count| count.to_string()).collect(),
            FieldKind::Change => contact.conductance.map_or("", ConductanceChange::name).into(),
            _ => field.numbers(contact).map(known).collect::<Vec<String>>().join(","),
        };
        let theta_rad = surface.theta_rad(contact.position_m).map_or_else(String::new, known);
        let row = fields.clone().map(cells).chain([theta_rad]).chain(signs.clone().map(cells));
        writeln!(out, "{frame},{}", row.collect::<Vec<String>>().join(","))?;
    }
    Ok(())
}

/// A number; empty if unknown.
fn known(value: f64) -> String {
    if value.is_finite() { format!("{value:?}") } else { String::new() }
}

/// A line of JSON for each frame.
fn write_jsonl(out: &mut dyn Write, frames: &[Vec<Contact>]) -> std::io::Result<()> {
    for (frame, contacts) in frames.iter().enumerate() {
        serde_json::to_writer(&mut *out, &FrameContacts { frame, contacts })?;
        out.write_all(b"\n")?;
    }
    Ok(())
}
