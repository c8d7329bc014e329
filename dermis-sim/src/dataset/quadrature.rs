//! The mean of a Gaussian over a cell, with subdivision according to its width.

use crate::quadrature::{Weighted, eighths, quarters, tetrahedron_points, triangle_points};
use crate::touch::{TETRAHEDRON_EDGE_WIDTHS, TRIANGLE_EDGE_WIDTHS};
use dermis::geom::Point3;

/// The quadrature rule for a kind of cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rule {
    /// [`triangle_points`] on triangles that are split into quarters recursively.
    Triangle,
    /// [`tetrahedron_points`] on tetrahedra that are split into eighths recursively.
    Tetrahedron,
}

impl Rule {
    /// The subdivision level of a cell for a Gaussian of a given width.
    pub(super) fn level(self, longest_edge_m: f64, width_m: f64) -> usize {
        let enough = match self {
            Rule::Triangle => TRIANGLE_EDGE_WIDTHS,
            Rule::Tetrahedron => TETRAHEDRON_EDGE_WIDTHS,
        };
        let (mut edge_m, mut level) = (longest_edge_m, 0);
        while edge_m > enough * width_m {
            (edge_m, level) = (0.5 * edge_m, level + 1);
        }
        level
    }

    /// The weights of the points of one part; those of a cell repeat for each of its parts, divided by their number.
    pub(super) fn weights(self) -> Vec<f64> {
        let weights = |points: &[Weighted<1>]| points.iter().map(|point| point.1).collect();
        match self {
            Rule::Triangle => weights(&triangle_points(&[[0.0]; 3])),
            Rule::Tetrahedron => weights(&tetrahedron_points(&[[0.0]; 4])),
        }
    }

    /// Number of parts of a cell at a level.
    pub(super) fn part_count(self, level: usize) -> usize {
        match self {
            Rule::Triangle => 4usize.pow(level as u32),
            Rule::Tetrahedron => 8usize.pow(level as u32),
        }
    }

    /// The points of a cell at a level, part by part.
    ///
    /// # Panics
    /// If the number of corners of the cell differs from that of the rule.
    pub(super) fn points(self, corners: &[Point3], level: usize) -> Vec<Point3> {
        match self {
            Rule::Triangle => points(corners, level, quarters, triangle_points),
            Rule::Tetrahedron => points(corners, level, eighths, tetrahedron_points),
        }
    }
}

fn points<const CORNERS: usize, const PARTS: usize, const POINTS: usize>(
    corners: &[Point3],
    level: usize,
    divide: fn([Point3; CORNERS]) -> [[Point3; CORNERS]; PARTS],
    points_of: fn(&[Point3; CORNERS]) -> [Weighted<3>; POINTS],
) -> Vec<Point3> {
    let mut parts = vec![<[Point3; CORNERS]>::try_from(corners).expect("as many corners as the rule's cells have")];
    for _ in 0..level {
        parts = parts.into_iter().flat_map(divide).collect();
    }
    parts.iter().flat_map(points_of).map(|(point, _)| point).collect()
}
