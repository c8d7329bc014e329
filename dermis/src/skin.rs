//! A skin prepared for computing: design, mesh, forward model and pixels, computed once and shared.
//!
//! ```
//! use dermis::skin::Skin;
//!
//! let skin = Skin::load("tank16")?;
//! let untouched = skin.untouched()?; // ohm
//! assert_eq!(untouched.len(), skin.design().protocol.channel_count());
//! # Ok::<(), dermis::Error>(())
//! ```

use crate::Result;
use crate::design::SkinDesign;
use crate::finding::{Finding, FindingKind};
use crate::forward::ForwardModel;
use crate::frame::Frame;
use crate::geom::PlaceLimits;
use crate::image::PixelSpace;
use crate::linalg::dot;
use crate::mesh::Mesh;
use crate::reconstruct::Linearised;
use std::fmt;
use std::sync::{Arc, OnceLock};

/// Places farther apart than this part of the body's diagonal are far from each other.
const FAR: f64 = 0.15;
/// Places that are compared with all others.
const TRIED: usize = 40;
/// Least cosine of the changes by touches that no noise of an instrument tells apart.
const ALIKE: f64 = 0.99;

/// A skin prepared for computing. A clone shares all data with the original.
#[derive(Clone)]
pub struct Skin {
    parts: Arc<Parts>,
}

struct Parts {
    design: SkinDesign,
    design_text: Option<String>,
    forward: ForwardModel,
    pixels: Arc<PixelSpace>,
    untouched: OnceLock<Frame>,
    linearised: OnceLock<Linearised>,
}

impl fmt::Debug for Skin {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Skin").field("design", &self.parts.design.name).finish_non_exhaustive()
    }
}

impl Skin {
    /// Prepares the skin of a design: a shipped name (see [`SkinDesign::SHIPPED`]) or the path of a TOML file.
    ///
    /// # Errors
    /// A design that cannot be read, meshed or solved.
    pub fn load(name_or_path: &str) -> Result<Self> {
        Self::parse(&SkinDesign::text_of(name_or_path)?, name_or_path)
    }

    /// Prepares a skin from the text of its design file. `name` is its path: errors contain it, and relative paths in
    /// the design start from its folder.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn parse(text: &str, name: &str) -> Result<Self> {
        let text = SkinDesign::with_files(text, name)?;
        let design = SkinDesign::parse(&text, name)?;
        let mesh = Mesh::generate(&design)?;
        Self::assemble(design, Some(text), &mesh)
    }

    /// Prepares the skin of a design that was built by a program.
    ///
    /// # Errors
    /// A design that cannot be meshed or solved.
    pub fn new(design: SkinDesign) -> Result<Self> {
        let mesh = Mesh::generate(&design)?;
        Self::with_mesh(design, &mesh)
    }

    /// Prepares the skin of a design on a given mesh.
    ///
    /// # Errors
    /// A mesh that does not fit the design, or that cannot be solved.
    pub fn with_mesh(design: SkinDesign, mesh: &Mesh) -> Result<Self> {
        Self::assemble(design, None, mesh)
    }

    fn assemble(design: SkinDesign, design_text: Option<String>, mesh: &Mesh) -> Result<Self> {
        let forward = ForwardModel::new(&design, mesh)?;
        let pixels = Arc::new(PixelSpace::for_design(&design, forward.mesh())?);
        Ok(Self::of(design, design_text, forward, pixels))
    }

    /// The same skin with one pixel per mesh cell in place of the design's pixels.
    #[must_use]
    pub fn with_cells_as_pixels(&self) -> Self {
        let Parts { design, design_text, forward, .. } = &*self.parts;
        let pixels = Arc::new(PixelSpace::cells(forward.mesh(), design.body.surface()));
        let (design, design_text, forward) = (design.clone(), design_text.clone(), forward.clone());
        Self::of(design, design_text, forward, pixels)
    }

    fn of(design: SkinDesign, design_text: Option<String>, forward: ForwardModel, pixels: Arc<PixelSpace>) -> Self {
        let (untouched, linearised) = Default::default();
        Skin { parts: Arc::new(Parts { design, design_text, forward, pixels, untouched, linearised }) }
    }

    /// The design.
    pub fn design(&self) -> &SkinDesign {
        &self.parts.design
    }

    /// The text of the design's file, with the files that it names inside; `None` for a design that was built by a program.
    pub fn design_text(&self) -> Option<&str> {
        self.parts.design_text.as_deref()
    }

    /// The forward model.
    pub fn forward(&self) -> &ForwardModel {
        &self.parts.forward
    }

    /// The mesh of the forward model.
    pub fn mesh(&self) -> &Mesh {
        self.parts.forward.mesh()
    }

    /// The pixels of its images.
    pub fn pixels(&self) -> &Arc<PixelSpace> {
        &self.parts.pixels
    }

    /// The possible positions of touches.
    pub fn place_limits(&self) -> PlaceLimits {
        self.mesh().place_limits(self.design().body.surface())
    }

    /// The untouched frame of the model, ohm, with its signs. Computed in the first call.
    ///
    /// # Errors
    /// A forward problem that cannot be solved.
    pub fn untouched(&self) -> Result<&Frame> {
        if let Some(untouched) = self.parts.untouched.get() {
            return Ok(untouched);
        }
        let untouched = self.forward().solve(self.forward().rest_conductivity())?;
        Ok(self.parts.untouched.get_or_init(|| untouched))
    }

    /// The forward model linearised about the untouched skin. Computed in the first call (one Jacobian).
    ///
    /// # Errors
    /// A forward problem that cannot be solved.
    pub fn linearised(&self) -> Result<&Linearised> {
        if let Some(linearised) = self.parts.linearised.get() {
            return Ok(linearised);
        }
        let linearised = Linearised::about(self.forward(), self.pixels(), self.untouched()?.clone())?;
        Ok(self.parts.linearised.get_or_init(|| linearised))
    }

    /// Whether the protocol cannot tell apart places that are far from each other, as opposite drives with opposite measurements
    /// on a symmetric body: a touch at one of them changes a frame as a touch at the other does. `None` if it can.
    ///
    /// # Errors
    /// A forward problem that cannot be solved.
    pub fn ambiguity(&self) -> Result<Option<Finding>> {
        let (jacobian, pixels) = (&self.linearised()?.jacobian, self.pixels());
        let columns = jacobian.transposed();
        let size_m = pixels.box_m().map(|[low, high]| high - low);
        let far_m = FAR * size_m.iter().map(|side| side * side).sum::<f64>().sqrt();
        let norm = |pixel: usize| dot(columns.row(pixel), columns.row(pixel)).sqrt();
        let tried: Vec<usize> = (0..pixels.len()).step_by(pixels.len().div_ceil(TRIED)).collect();
        let twin = |&pixel: &usize| {
            let distance_m = |other: usize| pixels.surface.distance_m(pixels.centres_m[pixel], pixels.centres_m[other]);
            let cosine =
                |other: usize| (dot(columns.row(pixel), columns.row(other)) / (norm(pixel) * norm(other))).abs();
            let far = (0..pixels.len()).filter(|&other| distance_m(other) > far_m);
            far.map(|other| (cosine(other), pixel, other))
                .filter(|found| found.0.is_finite())
                .max_by(|a, b| a.0.total_cmp(&b.0))
        };
        let mut alike: Vec<(f64, usize, usize)> =
            tried.iter().filter_map(twin).filter(|(cosine, ..)| *cosine >= ALIKE).collect();
        alike.sort_by(|a, b| b.0.total_cmp(&a.0));
        let Some(&(cosine, a, b)) = alike.first().filter(|_| 2 * alike.len() > tried.len()) else { return Ok(None) };
        let [a, b] = [a, b].map(|pixel| {
            let [x, y, z] = pixels.centres_m[pixel].map(|value| 1e3 * value);
            format!("({x:.0}, {y:.0}, {z:.0}) mm")
        });
        let evidence = format!(
            "the protocol cannot tell most places from others far away: a touch at {a} changes a frame as one at {b} does \
             (cosine {cosine:.4}). Contacts appear at both"
        );
        let fix = "measure or drive other pairs too, as the patterns adjacent and opposite do";
        Ok(Some(Finding::new(FindingKind::Ambiguous, cosine, evidence, fix)))
    }

    /// Channels that drive or measure at an electrode.
    pub fn channels_of(&self, electrode: usize) -> impl Iterator<Item = usize> {
        let channels = self.design().protocol.channels().iter().enumerate();
        channels.filter(move |(_, channel)| channel.uses(electrode)).map(|(index, _)| index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::{Channel, Protocol};

    #[test]
    fn a_clone_shares_the_linearised_model() {
        let skin = Skin::load("tank16").unwrap();
        let clone = skin.clone();
        assert!(std::ptr::eq(skin.linearised().unwrap(), clone.linearised().unwrap()));
        assert_eq!(skin.design_text(), SkinDesign::shipped_text("tank16"));
    }

    #[test]
    fn opposite_drives_and_measurements_are_ambiguous_and_shipped_protocols_are_not() {
        for name in SkinDesign::SHIPPED {
            assert_eq!(Skin::load(name).unwrap().ambiguity().unwrap(), None, "{name}");
        }
        let mut design = SkinDesign::shipped("tank16").unwrap();
        let pairs = (0..8).map(|first| [first, first + 8]);
        let channels = pairs.clone().flat_map(|drive| {
            pairs.clone().filter(move |measure| *measure != drive).map(move |measure| Channel { drive, measure })
        });
        design.protocol = Protocol::new(16, channels.collect()).unwrap();
        let found = Skin::new(design).unwrap().ambiguity().unwrap().expect("an ambiguous protocol");
        assert!(found.kind == FindingKind::Ambiguous && found.value > 0.999, "{}", found.evidence);
    }

    #[test]
    fn cells_can_be_pixels() {
        let skin = Skin::load("tank16").unwrap().with_cells_as_pixels();
        assert_eq!(skin.pixels().len(), skin.mesh().cell_count());
        assert_eq!(skin.linearised().unwrap().pixel_count(), skin.mesh().cell_count());
    }

    #[test]
    fn an_electrode_has_the_channels_that_name_it() {
        let skin = Skin::load("cylinder30").unwrap();
        let protocol = &skin.design().protocol;
        for channel in skin.channels_of(7) {
            let channel = protocol.channels()[channel];
            assert!(channel.uses(7));
        }
        // Two drives of 29 channels each, and two channels of each of the other 28 drives.
        assert_eq!(skin.channels_of(7).count(), 2 * 29 + 28 * 2);
    }
}
