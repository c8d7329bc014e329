//! A skin ready for computing: its design, mesh, forward model and pixels.

use crate::console::Progress;
use crate::failure::{Failure, Outcome};
use clap::ValueEnum;
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::frame::read_conductivities;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use std::path::Path;
use std::sync::Arc;

/// What an image has a value for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Per {
    /// Each pixel of the design's image.
    Pixel,
    /// Each cell of the mesh.
    Cell,
}

/// A skin ready for computing.
#[derive(Debug)]
pub struct Skin {
    pub design: SkinDesign,
    pub forward: ForwardModel,
}

impl Skin {
    /// The skin of a design, by name or by path.
    pub fn load(design: &str) -> Outcome<Self> {
        let design = SkinDesign::load(design)?;
        let _waiting = Progress::waiting("meshing");
        let forward = ForwardModel::new(&design, &Mesh::generate(&design)?)?;
        Ok(Skin { design, forward })
    }

    /// Its pixels, or its cells as pixels.
    pub fn pixels(&self, per: Per) -> Outcome<Arc<PixelSpace>> {
        let mesh = self.forward.mesh();
        Ok(Arc::new(match per {
            Per::Pixel => PixelSpace::for_design(&self.design, mesh)?,
            Per::Cell => PixelSpace::cells(mesh, self.design.body.surface()),
        }))
    }

    /// Maps of conductivity from a file, or the untouched skin without one.
    pub fn conductivities(&self, path: Option<&Path>) -> Outcome<Vec<Vec<f64>>> {
        match path {
            Some(path) => Ok(read_conductivities(path, self.forward.mesh().cell_count())?),
            None => Ok(vec![self.forward.rest_conductivity().to_vec()]),
        }
    }

    /// One map of conductivity, where a command can use no more.
    pub fn conductivity(&self, path: Option<&Path>) -> Outcome<Vec<f64>> {
        let mut maps = self.conductivities(path)?;
        if maps.len() > 1 {
            let message = format!("{} maps of conductivity, but a Jacobian belongs to one", maps.len());
            return Err(Failure::given(message, Some("give a file with one row")));
        }
        Ok(maps.remove(0))
    }
}
