//! `dermis mesh`: the mesh of a design, and a report of it.

use crate::console::print;
use crate::failure::Outcome;
use crate::skin;
use clap::Args;
use dermis::design::SkinDesign;
use dermis::mesh::export;
use std::path::PathBuf;

/// The arguments of `dermis mesh`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The design: a path, or a shipped name.
    design: String,
    /// The file to write: .vtu (ParaView), .msh (Gmsh) or .stl.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl Arguments {
    /// Makes the mesh, writes it and reports on it.
    pub fn run(self) -> Outcome {
        let design = SkinDesign::load(&self.design)?;
        let mesh = skin::mesh(&design)?;
        if let Some(path) = &self.output {
            export::save(&mesh, path, None)?;
        }
        print(&format!("{}: {} nodes, {} cells\n", design.name, mesh.node_count(), mesh.cell_count()))
    }
}
