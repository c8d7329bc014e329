//! `dermis export`: a trained network for other programs.

use crate::failure::Outcome;
use crate::skin::{Per, Skin};
use clap::Args;
use dermis::frame::write_whole;
use dermis_learn::Model;
use std::path::PathBuf;

/// The arguments of `dermis export`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The design: a path, or a shipped name.
    design: String,
    /// The network: `paper` or `best`, which are shipped for the paper's skin, or the folder of a model of `dermis train`.
    #[arg(long, value_name = "MODEL")]
    model: String,
    /// The ONNX file to write: differences in ohm go in, images come out.
    #[arg(long, value_name = "FILE")]
    onnx: PathBuf,
}

impl Arguments {
    /// Writes the file.
    pub fn run(self) -> Outcome {
        let skin = Skin::load(&self.design)?;
        let model = Model::named(&self.model, &skin.forward, skin.pixels(Per::Pixel)?)?;
        write_whole(&self.onnx, |out| out.write_all(&model.to_onnx()))?;
        Ok(())
    }
}
