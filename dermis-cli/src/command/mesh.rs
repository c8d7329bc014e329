//! `dermis mesh`: the mesh of a design and its quality.

use crate::console::{Progress, print, print_json, warn};
use crate::failure::Outcome;
use clap::Args;
use dermis::design::{Body, SkinDesign};
use dermis::mesh::quality::MeshReport;
use dermis::mesh::{ElectrodePatch, Mesh, export, import};
use dermis::text::counted;
use serde_json::json;
use std::path::PathBuf;

/// The arguments of `dermis mesh`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Mesh file to write: .vtu (ParaView), .msh (Gmsh) or .stl.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print JSON (SI units) instead of a table (mm).
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Generates the mesh, writes it and prints the report.
    pub fn run(self) -> Outcome {
        let design = SkinDesign::load(&self.design)?;
        let waiting = Progress::waiting("meshing");
        let mesh = Mesh::generate(&design)?;
        mesh.check_fits(&design)?;
        drop(waiting);
        if let Some(path) = &self.output {
            export::save(&mesh, path, None)?;
        }
        if let Body::Mesh { file, unit_m } = &design.body {
            match import::reordered_cells(file, *unit_m)? {
                0 => {}
                count => {
                    warn(&format!("{}: the nodes of {} were reordered", file.path.display(), counted(count, "cell")))
                }
            }
        }
        let report = MeshReport::new(&design, &mesh);
        warn_of_coarse_ends(&report);
        warn_of_holes(&design, &report);
        if self.json { print_json(&as_json(&mesh, &report)) } else { print(&table(&design.name, &mesh, &report)) }
    }
}

/// Voltages should be this accurate, relative; a mesh that is not gets a warning.
const ACCURACY: f64 = 0.01;

fn warn_of_coarse_ends(report: &MeshReport) {
    if let Some((electrode, ends)) = report.least_accurate_arc().filter(|(_, ends)| ends.voltage_error > ACCURACY) {
        warn(&format!(
            "electrode {electrode}: edges of {:.3} mm at its ends are long for its {:.3} mm; voltages while it is driven \
             have an error of about {:.1} %: make the mesh finer at the ends of electrodes",
            ends.edge_m * 1e3,
            report.electrodes[electrode].size * 1e3,
            ends.voltage_error * 1e2
        ));
    }
}

/// A sleeve has two rims, a glove without fingertips six: a surface with more has holes. A rim of a surface of n triangles has
/// about the root of n edges; holes that meet at a node are one curve with many.
const MAX_RIMS: usize = 6;

fn warn_of_holes(design: &SkinDesign, report: &MeshReport) {
    let ([curves, edges], Body::Mesh { file, .. }) = (report.open_curves, &design.body) else { return };
    if curves > MAX_RIMS || edges as f64 > MAX_RIMS as f64 * (report.cell_count as f64).sqrt() {
        warn(&format!(
            "{}: the surface has {curves} rims and holes with {}, round which the current must flow: if the body has no such holes, the file lacks \
             triangles; repair it in the program that wrote it",
            file.path.display(),
            counted(edges, "open edge"),
        ));
    }
}

fn as_json(mesh: &Mesh, report: &MeshReport) -> serde_json::Value {
    let electrodes: Vec<serde_json::Value> = report
        .electrodes
        .iter()
        .map(|electrode| {
            let ends = electrode.ends.map(|ends| json!({ "edge_m": ends.edge_m, "voltage_error": ends.voltage_error }));
            json!({ "size": electrode.size, "designed_size": electrode.designed_size, "ends": ends })
        })
        .collect();
    json!({
        "nodes": report.node_count,
        "cells": report.cell_count,
        "smallest_angle_rad": report.smallest_angle_rad,
        "shortest_edge_m": report.shortest_edge_m,
        "longest_edge_m": report.longest_edge_m,
        "open_curves": report.open_curves[0],
        "open_edges": report.open_curves[1],
        "hash": mesh.hash(),
        "electrodes": electrodes,
    })
}

/// The report as text.
fn table(name: &str, mesh: &Mesh, report: &MeshReport) -> String {
    let mut text = format!(
        "{name}: {} nodes, {} cells\n  smallest angle  {:.1} degrees\n  edges           {:.3} to {:.3} mm\n  \
         hash            {}\n  electrode   on the mesh       designed\n",
        report.node_count,
        report.cell_count,
        report.smallest_angle_rad.to_degrees(),
        report.shortest_edge_m * 1e3,
        report.longest_edge_m * 1e3,
        mesh.hash(),
    );
    for (index, (electrode, patch)) in report.electrodes.iter().zip(&mesh.electrodes).enumerate() {
        let (unit, per_si) = match patch {
            ElectrodePatch::Cells(_) | ElectrodePatch::Faces(_) => ("mm2", 1e6),
            ElectrodePatch::Edges(_) => ("mm", 1e3),
            ElectrodePatch::Node(_) => {
                text += &format!("  {index:>9}         a point\n");
                continue;
            }
        };
        // Rounded, so that no negative zero is printed.
        let percent = |ratio: f64| (1e4 * (ratio - 1.0)).round() / 1e2 + 0.0;
        let designed = match (electrode.designed_size, electrode.ratio()) {
            (Some(size), Some(ratio)) => format!("{:.3} {unit} ({:+.2} %)", size * per_si, percent(ratio)),
            _ => "as the mesh".into(),
        };
        let size = format!("{:.3} {unit}", electrode.size * per_si);
        text += &format!("  {index:>9}  {size:>12}   {designed:>14}\n");
    }
    text
}
