//! `dermis new`: a commented design file, or that of a robot.

use crate::console::print;
use crate::failure::{Failure, Outcome};
use crate::range::{count, number};
use clap::{Args, ValueEnum};
use dermis::design::FOREARM_STL;
use dermis::frame::write_whole;
use dermis_robot::{Shape, Sleeve, SleeveOptions, link_triangles};
use std::path::{Path, PathBuf};

/// The arguments of `dermis new`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// What the file describes.
    body: BodyKind,
    /// Of a skin on a link: the robot description (URDF).
    #[arg(value_name = "URDF")]
    description: Option<PathBuf>,
    /// Of a skin on a link: the name of the link.
    link: Option<String>,
    /// File to write [default: BODY.toml, arm.toml]
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Electrodes on the rim of a disk [default: 16], or on a link [default: 30]
    #[arg(long, value_name = "N", value_parser = count(4..=256usize))]
    electrodes: Option<usize>,
    /// Of a skin on a link: from where to where along an axis of the link, AXIS:FROM..TO in metres, as in z:0.08..0.34
    /// [default: the middle four fifths along the longest axis]
    #[arg(long, value_name = "PART", value_parser = along, requires = "link")]
    along: Option<(usize, [f64; 2])>,
    /// Of a skin on a link: from which angle about that axis to which, FROM..TO in degrees, as in 10..350 for a slit, or 0..180 and
    /// 180..360 for halves [default: 0..360]
    #[arg(long, value_name = "ANGLES", value_parser = around, requires = "link", allow_hyphen_values = true)]
    around: Option<[f64; 2]>,
    /// Of a skin on a link: distance of the skin from the link, m; its printed wall is between them.
    #[arg(long, value_name = "DISTANCE", value_parser = number(0.0005..=0.05), requires = "link")]
    offset: Option<f64>,
    /// Of a skin on a link: the meshes for pictures, in place of those for collisions.
    #[arg(long, requires = "link")]
    visual: bool,
    /// Of a skin on a link: a mesh of the link in its frame, in metres (STL, OBJ, PLY), in place of those of the description.
    #[arg(long, value_name = "FILE", requires = "link", conflicts_with = "visual")]
    mesh: Option<PathBuf>,
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
    /// A skin around a link of a robot: URDF LINK; the mesh of its body is written next to the design.
    Link,
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
            BodyKind::Link => ("link", include_str!("new/mesh.toml")),
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
        let name = self.link.as_deref().unwrap_or(name);
        let path = self.output.clone().unwrap_or_else(|| format!("{name}.toml").into());
        let (text, sleeve) = match (self.body, self.electrodes) {
            (BodyKind::Link, _) => {
                let sleeve = self.sleeve(&path)?;
                (link_design(text, &sleeve, &path), Some(sleeve))
            }
            (_, _) if self.description.is_some() => {
                let fix = "a skin on a link: dermis new link URDF LINK";
                return Err(Failure::given("a robot description is for links", Some(fix)));
            }
            (body, Some(count)) => (body.with_electrodes(text, count)?, None),
            (_, None) => (text.to_string(), None),
        };
        let stl = sleeve.as_ref().map(Sleeve::stl).unwrap_or_default();
        let mut files = vec![(path.clone(), text.as_bytes())];
        let beside = |name: &str| path.with_file_name(name);
        match self.body {
            BodyKind::Link => files.push((path.with_extension("stl"), &stl)),
            BodyKind::Mesh => files.push((beside("forearm.stl"), FOREARM_STL)),
            BodyKind::Robot => files.push((beside("arm.urdf"), include_bytes!("new/arm.urdf"))),
            BodyKind::Cylinder | BodyKind::Disk | BodyKind::Rectangle => {}
        }
        if let Some((there, _)) = files.iter().find(|(path, _)| !self.force && path.is_file()) {
            let message = format!("{} exists already", there.display());
            return Err(Failure::given(message, Some("give another path with -o, or replace it with --force")));
        }
        for (path, content) in &files {
            write_whole(path, |writer| writer.write_all(content))?;
        }
        let written: Vec<String> = files.iter().map(|(path, _)| path.display().to_string()).collect();
        let written = written.join(" and ");
        let shown = sleeve.map(|sleeve| described(&sleeve)).unwrap_or_default();
        let path = path.display();
        let next = match (self.body, &self.link) {
            (BodyKind::Robot, _) => format!("dermis robot check {path}"),
            (BodyKind::Link, Some(link)) => format!(
                "dermis plot {path} -o skin.svg; in the file of the robot (dermis new robot):\n\n[[skin]]\nname = \"{link}\"\n\
                 design = \"{path}\"\nlink = \"{link}\"\nsource = \"serial:/dev/ttyACM0\""
            ),
            _ => format!("dermis plot {path} -o skin.svg"),
        };
        print(&format!("{shown}wrote {written}\nnext: {next}\n"))
    }

    /// The body of a skin on a link.
    fn sleeve(&self, path: &Path) -> Outcome<Sleeve> {
        let (Some(description), Some(link)) = (&self.description, &self.link) else {
            let fix = "dermis new link ROBOT.urdf LINK; `dermis robot links ROBOT.urdf` lists the links";
            return Err(Failure::given("a skin on a link needs a robot description and the link", Some(fix)));
        };
        let shape = if self.visual { Shape::Visual } else { Shape::Collision };
        let (triangles, files) = match &self.mesh {
            Some(mesh) => (dermis::mesh::import::load_triangles(mesh, 1.0)?, vec![mesh.clone()]),
            None => link_triangles(description, link, shape)?,
        };
        if path.extension().is_none_or(|ending| ending != "toml") {
            let message = format!("{}: a design ends in .toml", path.display());
            return Err(Failure::given(message, Some("the mesh of its body is written next to it, with .stl")));
        }
        let body = path.with_extension("stl").canonicalize().ok();
        if body.is_some() && files.iter().any(|file| file.canonicalize().ok() == body) {
            let message = format!("{} is a mesh of the link itself", path.with_extension("stl").display());
            return Err(Failure::given(message, Some("give the design another name with -o")));
        }
        let options = SleeveOptions::default();
        let options = SleeveOptions {
            axis: self.along.map(|(axis, _)| axis),
            along_m: self.along.map(|(_, along)| along),
            around_rad: self.around.map_or(options.around_rad, |around| around.map(f64::to_radians)),
            offset_m: self.offset.unwrap_or(options.offset_m),
            electrodes: self.electrodes.unwrap_or(options.electrodes),
        };
        Ok(Sleeve::around(&triangles, &options)?)
    }
}

/// The design of a skin on a link: that of a body from a mesh file, with its electrodes and sizes. Discs of an eighth of the
/// electrodes' distance, and a mesh with five edges between two electrodes: finer meshes do not locate better.
fn link_design(template: &str, sleeve: &Sleeve, path: &Path) -> String {
    let stl = path.with_extension("stl");
    let name = stl.file_name().unwrap_or_default().to_string_lossy();
    let places: String = sleeve
        .electrodes_m
        .iter()
        .map(|[x, y, z]| format!("    {{ x_m = {x:.5}, y_m = {y:.5}, z_m = {z:.5} }},\n"))
        .collect();
    let radius_m = (sleeve.spacing_m / 8.0).clamp(0.002, 0.005);
    let (before, rest) = template.split_once("positions = [\n").unwrap_or((template, ""));
    let (_, after) = rest.split_once("]\n").unwrap_or_default();
    let text = format!("{before}positions = [\n{places}]\n{after}");
    let text = text
        .replace("path = \"forearm.stl\"", &format!("path = \"{name}\""))
        .replace("radius_m = 0.004", &format!("radius_m = {radius_m:.4}"));
    let (text, _) = text.split_once("# [mesh]").unwrap_or((&text, ""));
    format!(
        "{text}[mesh]                       # how fine\nmax_edge_m = {:.4}         # no edge is longer\nelectrode_edge_m = {:.4}   # along the \
         electrodes' outlines\ngrowth = 0.6                 # of the edge length per length of distance from the nearest outline\n",
        sleeve.spacing_m / 5.0,
        radius_m / 1.6
    )
}

/// A sleeve in words.
fn described(sleeve: &Sleeve) -> String {
    let [nearest, farthest] = sleeve.clearance_m.map(|distance| 1e3 * distance);
    format!(
        "{} electrodes {:.0} mm apart, {nearest:.1} to {farthest:.1} mm from the link, in the link's frame\n",
        sleeve.electrodes_m.len(),
        1e3 * sleeve.spacing_m
    )
}

/// A part of a link, as in z:0.08..0.34: an axis, and from where to where.
fn along(text: &str) -> Result<(usize, [f64; 2]), String> {
    let parse = || {
        let (axis, part) = text.split_once(':')?;
        Some((["x", "y", "z"].iter().position(|name| *name == axis)?, interval(part)?))
    };
    parse().ok_or_else(|| format!("`{text}` is no part of a link: write AXIS:FROM..TO in metres, as in z:0.08..0.34"))
}

/// Angles, as in 10..350.
fn around(text: &str) -> Result<[f64; 2], String> {
    interval(text).ok_or_else(|| format!("`{text}` are no angles: write FROM..TO in degrees, as in 10..350"))
}

fn interval(text: &str) -> Option<[f64; 2]> {
    let (from, to) = text.split_once("..")?;
    let [from, to] = [from, to].map(|number| number.trim().parse::<f64>().ok().filter(|number| number.abs() < 1e4));
    Some([from?, to?]).filter(|[from, to]| from < to)
}
