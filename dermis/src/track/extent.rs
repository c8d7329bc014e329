//! The extent of a body.

use crate::geom::vector::{add, distance, scale, sub};
use crate::geom::{Point3, Surface};
use crate::image::PixelSpace;
use serde::{Deserialize, Serialize};

/// The part of a surface that belongs to a body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum Extent {
    /// All of it, between the rims of a cylinder.
    Whole { length_m: Option<f64> },
    /// All points within a radius of the centre of some pixel.
    Pixels { centres_m: Vec<Point3>, reach_m: f64 },
}

impl Extent {
    pub(super) fn of_surface(surface: Surface) -> Self {
        match surface {
            Surface::Cylinder { length_m, .. } => Extent::Whole { length_m: Some(length_m) },
            Surface::Plane | Surface::Free => Extent::Whole { length_m: None },
        }
    }

    pub(super) fn of_pixels(pixels: &PixelSpace) -> Self {
        match pixels.surface {
            Surface::Cylinder { .. } => Self::of_surface(pixels.surface),
            _ => Extent::Pixels { centres_m: pixels.centres_m.clone(), reach_m: pixels.half_pixel_m() },
        }
    }

    /// The point on the body nearest to one that may be outside.
    pub(super) fn nearest(&self, place_m: Point3) -> Point3 {
        match self {
            Extent::Whole { length_m: None } => place_m,
            Extent::Whole { length_m: Some(length_m) } => [place_m[0], place_m[1], place_m[2].clamp(0.0, *length_m)],
            Extent::Pixels { centres_m, reach_m } => {
                let away_m = |centre_m: &Point3| distance(*centre_m, place_m);
                let nearest = centres_m.iter().min_by(|a, b| away_m(a).total_cmp(&away_m(b)));
                let Some(&centre_m) = nearest else { return place_m };
                // At a pixel's corner the body continues, or ends within a fraction of a pixel.
                let over = distance(centre_m, place_m) / reach_m;
                if over <= 1.0 { place_m } else { add(centre_m, scale(sub(place_m, centre_m), 1.0 / over)) }
            }
        }
    }
}
