//! The presses of the search and the instrument.

use super::information::Instrument;
use super::places::{Places, farthest_points};
use super::touch::{Response, Touches};
use crate::bound::BoundOptions;
use crate::elementary::powf;
use crate::twin::{TouchOptions, TwinError, TwinOptions};
use dermis::design::SkinDesign;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use rayon::prelude::*;

/// Places of presses in the search.
const PRESSES: usize = 900;
/// Cells of the mesh of the fields, about.
const CELLS: f64 = 40_000.0;
/// Point electrodes with which the answers of presses are computed.
const PROBES: usize = 64;

/// The presses of the search and the instrument.
#[derive(Debug)]
pub(super) struct Presses {
    pub(super) responses: Vec<Response>,
    /// Edge of the mesh of the fields, m.
    pub(super) edge_m: f64,
    pub(super) instrument: Instrument,
}

impl Presses {
    pub(super) fn new(
        design: &SkinDesign,
        places: &Places,
        twin: &TwinOptions,
        bound: &BoundOptions,
    ) -> crate::Result<Self> {
        let edge_m = (0.5 * bound.tip_radius_m).max((2.0 * places.area_m2 / CELLS).sqrt());
        let pixels = PixelSpace::for_design(design, &Mesh::generate(design)?)?;
        let spread = farthest_points(places.surface, &pixels.centres_m, PRESSES, 0.0);
        let radius_m = (2.0 * touch_radius_m(twin, bound)).max(2.0 * edge_m);
        let touches = Touches::new(design, &places.spread(PROBES, 0.0), twin, bound, radius_m)?;
        let press = |pixel: usize| touches.response(pixels.centres_m[pixel], pixels.normals[pixel]);
        let responses = spread.into_par_iter().map(press).collect::<crate::Result<_>>()?;
        let snr_db = twin.electronics.snr_db.ok_or_else(|| TwinError::OutOfRange {
            field: "electronics.snr_db",
            value: f64::INFINITY,
            must: "finite".into(),
            fix: "without noise every bound is zero; give the noise of the instrument".into(),
        })?;
        let instrument = Instrument {
            signal_to_noise: powf(10.0, snr_db / 20.0),
            reference_ohm: twin.electronics.reference_ohm,
            known: touches.known(),
        };
        Ok(Presses { responses, edge_m, instrument })
    }
}

/// The extent of a press, m.
fn touch_radius_m(twin: &TwinOptions, bound: &BoundOptions) -> f64 {
    match &twin.touch {
        TouchOptions::Gaussian(gaussian) => gaussian.width_m,
        _ => bound.tip_radius_m,
    }
}
