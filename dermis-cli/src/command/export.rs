//! `dermis export`: a trained network as ONNX.

use crate::failure::Outcome;
use crate::skin;
use clap::Args;
use dermis::frame::write_whole;
use dermis_learn::Model;
use std::path::PathBuf;

/// The arguments of `dermis export`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Network: a shipped name (spots or paper for cylinder30, shapes for skin16), or the folder of a trained network,
    /// as in ./my-model.
    #[arg(long, value_name = "NAME|FOLDER")]
    method: String,
    /// ONNX file to write. Input: differences, ohm; output: images.
    #[arg(long, value_name = "FILE")]
    onnx: PathBuf,
}

impl Arguments {
    /// Writes the file.
    pub fn run(self) -> Outcome {
        let skin = skin::load(&self.design)?;
        let model = Model::named(&self.method, &skin)?;
        write_whole(&self.onnx, |out| out.write_all(&model.to_onnx()))?;
        Ok(())
    }
}
