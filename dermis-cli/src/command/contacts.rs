//! `dermis contacts`: frames to contacts.

use crate::failure::{Failure, Outcome};
use crate::frames::FrameArguments;
use crate::method::{DetectArguments, MethodArguments};
use crate::output::{Output, json_line};
use crate::skin;
use clap::{Args, ValueEnum};
use dermis::contact::{ConductanceChange, Contact, Field, FieldKind};
use dermis::estimate::noise::ChannelNoise;
use dermis::geom::Surface;
use dermis::method::Method;
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_calibrate::{Calibration, Pose};
use serde::Serialize;
use std::io::Write;

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
    /// --both-signs), or a line of JSON per frame (.jsonl). `-` prints the table.
    #[arg(short, long, value_name = "FILE", required_unless_present = "json")]
    output: Option<Output>,
    /// Print a line of JSON per frame.
    #[arg(long, conflicts_with = "output")]
    json: bool,
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
        let (output, is_table) = self.output()?;
        let skin = skin::load(&self.design)?;
        let (differences, used) = self.frames.read_complete(&skin, &self.method)?;
        let method = self.method.prepare(&skin, &differences)?;
        let pose = self.pose(&skin, &method)?;
        let detector = self.detect.detector(&skin, &method, &differences)?;
        let frames = &differences.frames;
        let contacts = self.detect.in_each(&method, &detector, frames, |_, contacts| contacts)?;
        let mut contacts: Vec<(usize, Vec<Contact>)> = used.rows.into_iter().zip(contacts).collect();
        if let Some(pose) = pose {
            contacts.iter_mut().flat_map(|(_, of)| of).for_each(|contact| to_robot(contact, &pose));
        }
        let surface = skin.design().body.surface();
        output.write(|out| match is_table {
            true => write_csv(out, &contacts, &surface, self.detect.both_signs()),
            false => write_jsonl(out, &contacts),
        })?;
        let count: usize = contacts.iter().map(|(_, of)| of.len()).sum();
        let (contacts, frames) = (counted(count, "contact"), counted(contacts.len(), "frame"));
        let noise = ChannelNoise::of_differences(&differences, &skin.design().protocol);
        let noise = noise.map(|noise| format!("\n{noise}")).unwrap_or_default();
        output.say(&format!("{contacts} in {frames} ({}){noise}", method.description()))
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

    /// Where the contacts go, and whether as a table and not as lines of JSON.
    fn output(&self) -> Outcome<(Output, bool)> {
        let Some(output) = &self.output else { return Ok((Output::standard(), false)) };
        match output.ending().as_str() {
            "csv" => Ok((output.clone(), true)),
            "jsonl" => Ok((output.clone(), false)),
            _ => Err(output.unknown_ending("contacts", ".csv or .jsonl")),
        }
    }
}

/// Moves a contact from the skin's frame to the robot's.
fn to_robot(contact: &mut Contact, pose: &Pose) {
    contact.position_m = pose.to_robot(contact.position_m);
    contact.normal = pose.direction_to_robot(contact.normal);
}

/// A row for each contact; its sign is last, where contacts of both signs were looked for.
fn write_csv(
    out: &mut dyn Write,
    frames: &[(usize, Vec<Contact>)],
    surface: &Surface,
    both_signs: bool,
) -> std::io::Result<()> {
    let is_sign = |field: &&Field<Contact>| field.kind == FieldKind::Change;
    let fields = Contact::FIELDS.iter().filter(|field| !is_sign(field));
    let signs = Contact::FIELDS.iter().filter(|field| both_signs && is_sign(field));
    let columns = |field: &Field<Contact>| field.columns.join(",");
    let header = fields.clone().map(columns).chain(["theta_rad".into()]).chain(signs.clone().map(columns));
    writeln!(out, "frame,{}", header.collect::<Vec<String>>().join(","))?;
    for (frame, contact) in frames.iter().flat_map(|(frame, found)| found.iter().map(move |of| (frame, of))) {
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
fn write_jsonl(out: &mut dyn Write, frames: &[(usize, Vec<Contact>)]) -> std::io::Result<()> {
    for (frame, contacts) in frames {
        json_line(out, &FrameContacts { frame: *frame, contacts })?;
    }
    Ok(())
}
