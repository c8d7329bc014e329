//! `dermis jacobian`: the Jacobian of a frame with respect to conductivity.

use crate::failure::Outcome;
use crate::output::Output;
use crate::skin::{self, Per};
use clap::Args;
use std::path::PathBuf;

/// The arguments of `dermis jacobian`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Conductivity of every cell in mesh order, in one row [default: the untouched skin]
    #[arg(long, value_name = "FILE")]
    conductivity: Option<PathBuf>,
    /// Meaning of the columns.
    #[arg(long, value_enum, default_value_t = Per::Pixel)]
    per: Per,
    /// Matrix to write, channels x pixels (or cells): NPY, NPZ or CSV, or - for CSV on standard output; ohm per S.
    #[arg(short, long, value_name = "FILE")]
    output: Output,
}

impl Arguments {
    /// Computes and writes the matrix.
    pub fn run(self) -> Outcome {
        self.output.check_array("matrices")?;
        let skin = skin::load(&self.design)?;
        let conductivity = skin::conductivity(&skin, self.conductivity.as_deref())?;
        let matrix = match self.per {
            Per::Cell => skin.forward().jacobian(&conductivity)?,
            Per::Pixel => skin.forward().pixel_jacobian(&conductivity, skin.pixels())?,
        };
        self.output.write_array("jacobian", &[matrix.rows, matrix.columns], &matrix.values)?;
        self.output.say(&format!("{} values x {} columns", matrix.rows, matrix.columns))
    }
}
