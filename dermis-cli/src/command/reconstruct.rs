//! `dermis reconstruct`: frames to images.

use crate::console::print;
use crate::failure::{Failure, Outcome};
use crate::frames::{FrameArguments, of_each};
use crate::method::MethodArguments;
use crate::skin::{self, Per};
use clap::Args;
use dermis::frame::write_array;
use dermis::image::Image;
use dermis::mesh::export::{CellField, save_cell_fields};
use dermis::skin::Skin;
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
    /// Images to write: NPY or NPZ, frames x rows x columns (NaN outside the body) or frames x cells; CSV, one image
    /// per row; VTU (ParaView), the mesh with a field per image.
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
        let is_mesh_file = self.is_mesh_file()?;
        let differences = self.frames.read(&skin, &self.method)?;
        let method = self.method.prepare(&skin, &differences)?;
        let images = of_each(&differences.frames, |difference| method.image(difference))?;
        let size = if is_mesh_file { self.write_cells(&skin, &images)? } else { self.write_array(&skin, &images)? };
        print(&format!("{}: {size} ({})\n", self.output.display(), method.description()))
    }

    /// Whether the images are written on the mesh; refuses unknown extensions.
    fn is_mesh_file(&self) -> Outcome<bool> {
        let extension = self.output.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("vtu") => Ok(true),
            Some("npy" | "npz" | "csv") => Ok(false),
            _ => {
                let message = format!("{}: images are written as .npy, .npz, .csv or .vtu", self.output.display());
                Err(Failure::given(message, Some("choose one of these endings")))
            }
        }
    }

    /// Writes a field of cell values for each frame; its size in words.
    fn write_cells(&self, skin: &Skin, images: &[Image]) -> Outcome<String> {
        let cell_count = skin.mesh().cell_count();
        let field = |(frame, image): (usize, &Image)| CellField {
            name: format!("frame {frame}"),
            values: image.to_cells(cell_count),
        };
        let fields: Vec<CellField> = images.iter().enumerate().map(field).collect();
        save_cell_fields(skin.mesh(), &self.output, &fields)?;
        Ok(format!("{} x {cell_count} cells", fields.len()))
    }

    /// Writes the images as an array, of the pixels of a grid or of the cells of the mesh; its shape in words.
    fn write_array(&self, skin: &Skin, images: &[Image]) -> Outcome<String> {
        let (grid, cell_count) = (skin.pixels().grid, skin.mesh().cell_count());
        let shape = match grid {
            Some([rows, columns]) => vec![images.len(), rows, columns],
            None => vec![images.len(), cell_count],
        };
        let picture = |image: &Image| if grid.is_some() { image.to_grid() } else { image.to_cells(cell_count) };
        let values: Vec<f64> = images.iter().flat_map(picture).collect();
        write_array(&self.output, "images", &shape, &values)?;
        Ok(shape.iter().map(usize::to_string).collect::<Vec<_>>().join(" x "))
    }
}
