//! `dermis jacobian`: the derivative of a frame by the conductivity.

use crate::console::print;
use crate::failure::Outcome;
use crate::skin::{self, Per};
use clap::Args;
use dermis::frame::write_array;
use std::path::PathBuf;

/// The arguments of `dermis jacobian`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The design: a path, or a shipped name.
    design: String,
    /// Conductivity of every cell in the mesh's order, in one row; the untouched skin without it.
    #[arg(long, value_name = "FILE")]
    conductivity: Option<PathBuf>,
    /// What the columns stand for.
    #[arg(long, value_enum, default_value_t = Per::Pixel)]
    per: Per,
    /// The matrix to write, values x pixels (or cells): NPY, NPZ or CSV; ohm per S.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

impl Arguments {
    /// Computes and writes the matrix.
    pub fn run(self) -> Outcome {
        let skin = skin::load(&self.design)?;
        let conductivity = skin::conductivity(&skin, self.conductivity.as_deref())?;
        let matrix = match self.per {
            Per::Cell => skin.forward().jacobian(&conductivity)?,
            Per::Pixel => skin.forward().pixel_jacobian(&conductivity, skin.pixels())?,
        };
        write_array(&self.output, "jacobian", &[matrix.rows, matrix.columns], &matrix.values)?;
        print(&format!("{}: {} values x {} columns\n", self.output.display(), matrix.rows, matrix.columns))
    }
}
