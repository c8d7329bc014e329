//! The exact bounds of a design, by which layouts and patterns are judged.

use super::Objective;
use crate::bound::{BoundOptions, Bounds};
use crate::elementary::ln;
use crate::twin::{Twin, TwinOptions};
use dermis::design::{Electrode, ElectrodeShape, SkinDesign};
use dermis::geom::Point3;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use rayon::prelude::*;
use serde::Serialize;

/// The bounds of the position at every pixel that no electrode covers: no current flows in the coat under a disc.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judgement {
    /// The largest, m; infinite where a place has none.
    pub worst_m: f64,
    /// The mean, m.
    pub mean_m: f64,
    /// Every pixel.
    pub places: Vec<PlaceBound>,
}

/// The bound of the position at a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PlaceBound {
    /// Its centre, m.
    pub position_m: Point3,
    /// The bound, m; infinite where there is none, NaN where an electrode covers the pixel.
    pub sd_m: f64,
}

impl Judgement {
    /// The value of an objective, m.
    pub(super) fn of(&self, objective: Objective) -> f64 {
        match objective {
            Objective::Worst => self.worst_m,
            Objective::Mean => self.mean_m,
        }
    }
}

/// The [`Bounds`] of a design at every pixel that no electrode covers.
pub(super) fn judge(design: &SkinDesign, twin: &TwinOptions, bound: &BoundOptions) -> crate::Result<Judgement> {
    // The pixels are those of the design, whatever the mesh.
    let pixels = PixelSpace::for_design(design, &Mesh::generate(design)?)?;
    let bounds = Bounds::new(design, twin, bound)?;
    let surface = design.body.surface();
    let is_covered = |place_m: Point3| {
        let covers = |electrode: &Electrode| match electrode.shape {
            ElectrodeShape::Disc { radius_m } => surface.distance_m(electrode.centre_m, place_m) < radius_m,
            _ => false,
        };
        design.electrodes.iter().any(covers)
    };
    let at = |pixel: usize| -> crate::Result<PlaceBound> {
        let position_m = pixels.centres_m[pixel];
        if is_covered(position_m) {
            return Ok(PlaceBound { position_m, sd_m: f64::NAN });
        }
        let bound = bounds.position(position_m, pixels.normals[pixel])?;
        Ok(PlaceBound { position_m, sd_m: bound.map_or(f64::INFINITY, |bound| bound.sd_m) })
    };
    let places: Vec<PlaceBound> = (0..pixels.len()).into_par_iter().map(at).collect::<crate::Result<_>>()?;
    let values: Vec<f64> = places.iter().map(|place| place.sd_m).filter(|value| !value.is_nan()).collect();
    Ok(Judgement {
        worst_m: values.iter().copied().fold(0.0, f64::max),
        mean_m: values.iter().sum::<f64>() / values.len() as f64,
        places,
    })
}

/// A twin whose noise on one design is that on another in ohm: an instrument that leaves readings out has the same noise
/// in the others.
pub(super) fn with_noise_of(
    twin: &TwinOptions,
    design: &SkinDesign,
    reference: &SkinDesign,
) -> crate::Result<TwinOptions> {
    let sound = twin.as_designed();
    let noise = |design: &SkinDesign| Ok::<_, crate::Error>(Twin::new(design, &sound, 0)?.noise());
    let mut same = twin.clone();
    if let (Some(own), Some(wanted), Some(snr_db)) = (noise(design)?, noise(reference)?, &mut same.electronics.snr_db) {
        *snr_db += 20.0 * ln(own.sd_ohm / wanted.sd_ohm) / std::f64::consts::LN_10;
    }
    Ok(same)
}
