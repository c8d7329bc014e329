//! `dermis new`: a commented design file, or that of a robot.

use crate::console::print;
use crate::failure::{Failure, Outcome};
use crate::range::count;
use clap::{Args, ValueEnum};
use dermis::design::FOREARM_STL;
use dermis::frame::write_whole;
use std::path::PathBuf;

/// The arguments of `dermis new`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// What the file describes.
    body: BodyKind,
    /// File to write [default: BODY.toml, arm.toml]
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Electrodes on the rim of a disk [default: 16]
    #[arg(long, value_name = "N", value_parser = count(4..=256usize))]
    electrodes: Option<usize>,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

/// The body of a new design.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum BodyKind {
    /// A cylinder.
    Cylinder,
    /// A flat disk.
    Disk,
    /// A flat rectangle.
    Rectangle,
    /// A body from a mesh file: a forearm; its file is written next to the design.
    Mesh,
    /// A robot with two skins, for `dermis robot`; its description is written next to the file.
    Robot,
}

impl BodyKind {
    fn template(self) -> (&'static str, &'static str) {
        match self {
            BodyKind::Cylinder => ("cylinder", include_str!("new/cylinder.toml")),
            BodyKind::Disk => ("disk", include_str!("new/disk.toml")),
            BodyKind::Rectangle => ("rectangle", include_str!("new/rectangle.toml")),
            BodyKind::Mesh => ("mesh", include_str!("new/mesh.toml")),
            BodyKind::Robot => ("arm", include_str!("new/arm.toml")),
        }
    }
}

impl BodyKind {
    /// The template with some electrodes on the rim, none of them longer than 0.4 of their spacing.
    fn with_electrodes(self, text: &str, count: usize) -> Outcome<String> {
        let BodyKind::Disk = self else {
            let fix = "edit [electrodes.layout] in the file that this command writes";
            return Err(Failure::given("--electrodes is for disks", Some(fix)));
        };
        let spacing_m = std::f64::consts::PI * DISK_DIAMETER_M / count as f64;
        let length_m = (0.4 * spacing_m).min(DISK_ARC_M);
        let text = text.replace("\ncount = 16\n", &format!("\ncount = {count}\n"));
        Ok(text.replace("length_m = 0.004 ", &format!("length_m = {length_m:.4} ")))
    }
}

/// Diameter of the disk of the template, and length of its electrodes, m.
const DISK_DIAMETER_M: f64 = 0.080;
const DISK_ARC_M: f64 = 0.004;

impl Arguments {
    /// Writes the file.
    pub fn run(self) -> Outcome {
        let (name, text) = self.body.template();
        let text = match self.electrodes {
            Some(count) => self.body.with_electrodes(text, count)?,
            None => text.to_string(),
        };
        let path = self.output.unwrap_or_else(|| format!("{name}.toml").into());
        let mut files = vec![(path.clone(), text.as_bytes())];
        match self.body {
            BodyKind::Mesh => files.push((path.with_file_name("forearm.stl"), FOREARM_STL)),
            BodyKind::Robot => files.push((path.with_file_name("arm.urdf"), include_bytes!("new/arm.urdf"))),
            BodyKind::Cylinder | BodyKind::Disk | BodyKind::Rectangle => {}
        }
        if let Some((there, _)) = files.iter().find(|(path, _)| !self.force && path.is_file()) {
            let message = format!("{} exists already", there.display());
            return Err(Failure::given(message, Some("give another path with -o, or replace it with --force")));
        }
        for (path, content) in files {
            write_whole(&path, |writer| writer.write_all(content))?;
        }
        let path = path.display();
        let next = match self.body {
            BodyKind::Robot => format!("dermis robot check {path}"),
            _ => format!("dermis plot {path} -o skin.svg"),
        };
        print(&format!("wrote {path}\nnext: {next}\n"))
    }
}
