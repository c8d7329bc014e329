//! Pixels on a surface, and images made of them.

use crate::geom::{Point3, Surface};
use std::sync::Arc;

/// The pixels of a skin's image: where they are, which are neighbours, and which part of each mesh cell they hold.
///
/// Only pixels that overlap the body exist here; `position_in_grid` places them in the picture.
#[derive(Debug, Clone)]
pub struct PixelSpace {
    /// The surface on which they lie.
    pub surface: Surface,
    /// Rows and columns of the picture; `None` where every cell is a pixel.
    pub grid: Option<[usize; 2]>,
    /// Index in the picture, row-major, of each pixel (the cell's index without a grid).
    pub position_in_grid: Vec<usize>,
    /// Centre of each pixel on the surface, m (of the part inside the body).
    pub centres_m: Vec<Point3>,
    /// Outward unit normals at the centres.
    pub normals: Vec<Point3>,
    /// Area of the part of each pixel inside the body, m2 (volume of a tetrahedron, m3).
    pub areas: Vec<f64>,
    /// Pixels that share an edge with each, by index in this list.
    pub neighbours: Vec<Vec<usize>>,
    /// For each pixel the cells it overlaps with the fraction of the cell's measure that lies in it. The fractions of
    /// one cell over all pixels add up to one.
    pub overlaps: Vec<Vec<(usize, f64)>>,
}

impl PixelSpace {
    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.centres_m.len()
    }

    /// Whether there is no pixel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// One image: a value for each pixel. A touch is positive, whichever way it turns the conductance; the values are
/// relative changes of conductance.
#[derive(Debug, Clone)]
pub struct Image {
    /// The pixels.
    pub space: Arc<PixelSpace>,
    /// A value for each pixel, in the order of the space.
    pub values: Vec<f64>,
}
