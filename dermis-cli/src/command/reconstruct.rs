//! `dermis reconstruct`: frames to images.

use crate::console::print;
use crate::failure::Outcome;
use crate::frames::{FrameArguments, images};
use crate::method::MethodArguments;
use crate::skin::{self, Per};
use clap::Args;
use dermis::frame::write_array;
use std::path::PathBuf;

/// The arguments of `dermis reconstruct`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    frames: FrameArguments,
    #[command(flatten)]
    method: MethodArguments,
    /// Elements of an image.
    #[arg(long, value_enum, default_value_t = Per::Pixel)]
    per: Per,
    /// Images to write: NPY or NPZ, frames x rows x columns (NaN outside the body) or frames x cells; CSV, one image per row.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

impl Arguments {
    /// Reconstructs the images and writes them.
    pub fn run(self) -> Outcome {
        let skin = match (skin::load(&self.design)?, self.per) {
            (skin, Per::Pixel) => skin,
            (skin, Per::Cell) => skin.with_cells_as_pixels(),
        };
        let differences = self.frames.read(&skin.design().protocol)?;
        let method = self.method.prepare(&skin, &differences)?;
        let images = images(&method, &differences.frames)?;
        let space = method.reconstruct().pixels();
        let mut shape = vec![images.len()];
        match space.grid {
            Some([rows, columns]) => shape.extend([rows, columns]),
            None => shape.push(space.len()),
        }
        let values: Vec<f64> = images.iter().flat_map(|image| image.to_grid()).collect();
        write_array(&self.output, "images", &shape, &values)?;
        let sizes: Vec<String> = shape.iter().map(usize::to_string).collect();
        print(&format!("{}: {} ({})\n", self.output.display(), sizes.join(" x "), method.description()))
    }
}
