//! `dermis reconstruct`: frames to images.

use crate::console::known;
use crate::failure::Outcome;
use crate::frames::{FrameArguments, of_each};
use crate::method::MethodArguments;
use crate::output::{Output, json_line, to_standard_output};
use crate::skin::{self, Per};
use clap::Args;
use dermis::image::Image;
use dermis::mesh::export::{CellField, save_cell_fields};
use dermis::skin::Skin;
use serde::Serialize;
use std::path::Path;

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
    /// Images to write: NPY or NPZ, frames x rows x columns (NaN outside the body) or frames x cells; CSV, one image
    /// per row; VTU (ParaView), the mesh with a field per image. `-` prints CSV.
    #[arg(short, long, value_name = "FILE", required_unless_present = "json")]
    output: Option<Output>,
    /// Print a line of JSON per image; `null` outside the body.
    #[arg(long, conflicts_with = "output")]
    json: bool,
}

impl Arguments {
    /// Reconstructs the images and writes them.
    pub fn run(self) -> Outcome {
        let skin = match (skin::load(&self.design)?, self.per) {
            (skin, Per::Pixel) => skin,
            (skin, Per::Cell) => skin.with_cells_as_pixels(),
        };
        let output = self.output()?;
        let differences = self.frames.read(&skin, &self.method)?;
        let method = self.method.prepare(&skin, &differences)?;
        let images = of_each(&differences.frames, |difference| method.image(difference))?;
        let size = match output {
            None => return print_lines(&skin, &images),
            Some(output) => match output.file().filter(|_| output.ending() == "vtu") {
                Some(file) => write_cells(file, &skin, &images)?,
                None => write_array(output, &skin, &images)?,
            },
        };
        output.map_or(Ok(()), |output| output.say(&format!("{size} ({})", method.description())))
    }

    /// Where the images go; `None`: printed as lines of JSON. Refuses unknown endings.
    fn output(&self) -> Outcome<Option<&Output>> {
        match &self.output {
            Some(output) if !["vtu", "npy", "npz", "csv"].contains(&output.ending().as_str()) => {
                Err(output.unknown_ending("images", ".npy, .npz, .csv or .vtu"))
            }
            output => Ok(output.as_ref()),
        }
    }
}

/// An image as a line of JSON.
#[derive(Serialize)]
struct ImageLine {
    frame: usize,
    image: Vec<Option<f64>>,
}

/// The values of an image: of the pixels of a grid, or of the cells of the mesh.
fn values(skin: &Skin, image: &Image) -> Vec<f64> {
    if skin.pixels().grid.is_some() { image.to_grid() } else { image.to_cells(skin.mesh().cell_count()) }
}

/// Prints a line of JSON for each image.
fn print_lines(skin: &Skin, images: &[Image]) -> Outcome {
    to_standard_output(|out| {
        images.iter().enumerate().try_for_each(|(frame, image)| {
            json_line(out, &ImageLine { frame, image: values(skin, image).into_iter().map(known).collect() })
        })
    })
}

/// Writes a field of cell values for each frame; its size in words.
fn write_cells(file: &Path, skin: &Skin, images: &[Image]) -> Outcome<String> {
    let cell_count = skin.mesh().cell_count();
    let field = |(frame, image): (usize, &Image)| CellField {
        name: format!("frame {frame}"),
        values: image.to_cells(cell_count),
    };
    let fields: Vec<CellField> = images.iter().enumerate().map(field).collect();
    save_cell_fields(skin.mesh(), file, &fields)?;
    Ok(format!("{} x {cell_count} cells", fields.len()))
}

/// Writes the images as an array, of the pixels of a grid or of the cells of the mesh; its shape in words.
fn write_array(output: &Output, skin: &Skin, images: &[Image]) -> Outcome<String> {
    let shape = match skin.pixels().grid {
        Some([rows, columns]) => vec![images.len(), rows, columns],
        None => vec![images.len(), skin.mesh().cell_count()],
    };
    let values: Vec<f64> = images.iter().flat_map(|image| values(skin, image)).collect();
    output.write_array("images", &shape, &values)?;
    Ok(shape.iter().map(usize::to_string).collect::<Vec<_>>().join(" x "))
}
