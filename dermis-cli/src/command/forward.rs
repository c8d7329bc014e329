//! `dermis forward`: conductivities to frames.

use crate::console::{Progress, print};
use crate::failure::Outcome;
use crate::skin::Skin;
use clap::Args;
use dermis::frame::{Frame, write_frames};
use rayon::prelude::*;
use std::path::PathBuf;

/// The arguments of `dermis forward`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The design: a path, or a shipped name.
    design: String,
    /// Conductivity of every cell in the mesh's order, a row per map (S on surfaces, S/m in volumes); the untouched
    /// skin without it.
    #[arg(long, value_name = "FILE")]
    conductivity: Option<PathBuf>,
    /// The frames to write, a row per map: CSV, NPY or NPZ; ohm.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

impl Arguments {
    /// Solves for every map.
    pub fn run(self) -> Outcome {
        let skin = Skin::load(&self.design)?;
        let maps = skin.conductivities(self.conductivity.as_deref())?;
        let progress = Progress::new("solving", maps.len());
        let channels = skin.design.protocol.channel_count();
        let solve = |solver: &mut dermis::forward::Solver, map: &Vec<f64>| {
            let mut frame = Frame(vec![0.0; channels]);
            solver.solve_into(map, &mut frame)?;
            progress.step();
            Ok::<Frame, dermis::forward::ForwardError>(frame)
        };
        let frames = maps.par_iter().map_init(|| skin.forward.solver(), solve).collect::<Result<Vec<_>, _>>()?;
        drop(progress);
        write_frames(&self.output, &frames)?;
        print(&format!("{}: {} frames of {channels} values\n", self.output.display(), frames.len()))
    }
}
