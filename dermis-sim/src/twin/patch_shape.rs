//! Shapes of patches, and the lattices in which they lie.

use crate::elementary::{hypot, sin, sin_cos};
use crate::quadrature::gauss_legendre;
use dermis::geom::{Point2, polygon};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Sides of the polygon that stands for a round patch. It has the disk's area; its second moment is 3e-5 too large.
const ROUND_SIDES: usize = 24;
/// Points in each direction from the middle of a patch at which the pressure is evaluated, and the number of directions:
/// the conductance of a bell-shaped contact of 2 mm anywhere on a disk of 9.6 mm is correct to 2e-5.
const POINTS_OUTWARDS: usize = 5;
const DIRECTIONS: usize = 48;

/// Shape of the patches.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PatchShape {
    /// Rectangles: as long and as wide as the pitch, less the gap.
    #[default]
    Square,
    /// Disks, whose diameter is the smallest distance between neighbours, less the gap.
    Round,
    /// Regular hexagons with two sides along the axis of the body, as large as their neighbours and the gap permit.
    Hexagonal,
}

/// Arrangement of the patches.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PatchLattice {
    /// Straight rows and columns.
    #[default]
    Rectangular,
    /// Every other row is shifted by half a pitch. With a pitch of the rows of `sqrt(3) / 2` of that of the columns this
    /// is the hexagonal lattice.
    Staggered,
}

/// Whether a field has its default value, with which it is left out of files.
pub(super) fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl PatchLattice {
    /// The steps from a patch to its nearest neighbours [around, along], one of each opposite pair, m.
    fn neighbours_m(self, [along_m, round_m]: [f64; 2]) -> Vec<Point2> {
        match self {
            PatchLattice::Rectangular => vec![[round_m, 0.0], [0.0, along_m]],
            PatchLattice::Staggered => vec![[round_m, 0.0], [0.5 * round_m, along_m], [0.0, 2.0 * along_m]],
        }
    }
}

impl PatchShape {
    /// The corners of a patch relative to its middle, counter-clockwise, m, in a lattice of a pitch [along, around];
    /// `None` for rectangles. A width that is not positive has no meaning.
    pub(super) fn corners_m(self, lattice: PatchLattice, pitch_m: [f64; 2], gap_m: f64) -> Option<Vec<Point2>> {
        let width_m = self.widest_m(lattice, pitch_m) - gap_m;
        match self {
            PatchShape::Square => None,
            PatchShape::Round => Some(round_corners_m(0.5 * width_m, ROUND_SIDES)),
            PatchShape::Hexagonal => Some(corners(6, width_m / 3f64.sqrt(), PI / 6.0)),
        }
    }

    /// The width at which neighbours without a gap touch, m.
    ///
    /// Two equal shapes of width `w` that are symmetric about their middles overlap if the step between them is shorter
    /// than `w` in the norm whose unit ball they are: `|d|` for disks, the largest of `|d . n|` over the three normals
    /// `n` of the sides for hexagons.
    pub(super) fn widest_m(self, lattice: PatchLattice, pitch_m: [f64; 2]) -> f64 {
        let norm = |&[round, along]: &Point2| match self {
            PatchShape::Square => round.abs().max(along.abs()),
            PatchShape::Round => hypot(round, along),
            PatchShape::Hexagonal => {
                let across = |k: usize| {
                    let (sine, cosine) = sin_cos(PI / 3.0 * k as f64);
                    (round * cosine + along * sine).abs()
                };
                (0..3).map(across).fold(0.0, f64::max)
            }
        };
        lattice.neighbours_m(pitch_m).iter().map(norm).fold(f64::INFINITY, f64::min)
    }
}

/// A regular polygon with the area of a disk.
fn round_corners_m(radius_m: f64, sides: usize) -> Vec<Point2> {
    let angle = TAU / sides as f64;
    corners(sides, radius_m * (angle / sin(angle)).sqrt(), 0.0)
}

/// The corners of a regular polygon, the first at an angle.
fn corners(sides: usize, radius_m: f64, first_rad: f64) -> Vec<Point2> {
    let corner = |k: usize| {
        let (sine, cosine) = sin_cos(first_rad + TAU * k as f64 / sides as f64);
        [radius_m * cosine, radius_m * sine]
    };
    (0..sides).map(corner).collect()
}

/// The part of a triangle inside a convex polygon around a middle.
pub(super) fn clip(triangle: &[Point2], middle: Point2, corners_m: &[Point2]) -> Vec<Point2> {
    let mut part = triangle.to_vec();
    for (from, to) in sides(corners_m) {
        let normal = [to[1] - from[1], from[0] - to[0]];
        let offset = normal[0] * (middle[0] + from[0]) + normal[1] * (middle[1] + from[1]);
        part = polygon::clip_half_plane(&part, normal, offset);
        if part.is_empty() {
            break;
        }
    }
    part
}

/// Points of a convex polygon around the origin with their areas, m2: on the triangle from the origin to each side,
/// `u ((1 - v) from + v to)`, the product of Gauss's rules in `u`, from 0 to 1 with the weight `u`, and in `v`.
pub(super) fn points(corners_m: &[Point2]) -> Vec<(Point2, f64)> {
    rule(corners_m, POINTS_OUTWARDS, DIRECTIONS)
}

fn rule(corners_m: &[Point2], outwards: usize, directions: usize) -> Vec<(Point2, f64)> {
    let unit = |count: usize| gauss_legendre(count).into_iter().map(|(t, weight)| (0.5 * (1.0 + t), 0.5 * weight));
    let across: Vec<(f64, f64)> = unit(directions.div_ceil(corners_m.len())).collect();
    let outwards: Vec<(f64, f64)> = unit(outwards).collect();
    let mut points = Vec::with_capacity(corners_m.len() * across.len() * outwards.len());
    for (from, to) in sides(corners_m) {
        let twice_area = from[0] * to[1] - to[0] * from[1];
        for (&(v, of_v), &(u, of_u)) in across.iter().flat_map(|v| outwards.iter().map(move |u| (v, u))) {
            let at = |axis: usize| u * ((1.0 - v) * from[axis] + v * to[axis]);
            points.push(([at(0), at(1)], twice_area * u * of_u * of_v));
        }
    }
    points
}

fn sides(corners_m: &[Point2]) -> impl Iterator<Item = (Point2, Point2)> {
    corners_m.iter().copied().zip(corners_m.iter().copied().cycle().skip(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `integral of x^i y^j` by the points.
    fn integral(points: &[(Point2, f64)], i: i32, j: i32) -> f64 {
        points.iter().map(|([x, y], area)| area * x.powi(i) * y.powi(j)).sum()
    }

    #[test]
    fn the_points_of_a_hexagon_integrate_polynomials_exactly() {
        // A hexagon of circumradius 1: area 3 sqrt(3) / 2, second moment 5 sqrt(3) / 16 about each axis; the sides of
        // width sqrt(3) across x.
        let hexagon = PatchShape::Hexagonal.corners_m(PatchLattice::Rectangular, [2.0, 3f64.sqrt()], 0.0).unwrap();
        let points = points(&hexagon);
        assert!((integral(&points, 0, 0) - 1.5 * 3f64.sqrt()).abs() < 1e-13);
        for moment in [integral(&points, 2, 0), integral(&points, 0, 2)] {
            assert!((moment - 5.0 * 3f64.sqrt() / 16.0).abs() < 1e-13, "{moment}");
        }
        let [xy, x3] = [integral(&points, 1, 1), integral(&points, 3, 0)];
        assert!(xy.abs() < 1e-14 && x3.abs() < 1e-14);
        assert!((hexagon.iter().map(|corner| corner[0]).fold(0.0, f64::max) - 0.5 * 3f64.sqrt()).abs() < 1e-14);
    }

    /// The area is exact for every number of sides; the moments of a disk of radius `r`, `pi r^4 / 4` and `pi r^6 / 8`
    /// (of `x^2` and `x^4`), are approached with the fourth order.
    #[test]
    fn a_round_patch_has_the_area_of_its_disk_and_approaches_its_moments() {
        let radius: f64 = 0.0043;
        let exact = [PI * radius.powi(4) / 4.0, PI * radius.powi(6) / 8.0];
        let errors = [12, 24, 48].map(|sides| {
            let points = rule(&round_corners_m(radius, sides), 5, 4 * sides);
            assert!((integral(&points, 0, 0) / (PI * radius * radius) - 1.0).abs() < 1e-13);
            [2, 4].map(|power| integral(&points, power, 0) / exact[power as usize / 2 - 1] - 1.0)
        });
        for (moment, name) in ["second", "fourth"].into_iter().enumerate() {
            let errors = errors.map(|errors| errors[moment]);
            let rates = [0, 1].map(|k| (errors[k] / errors[k + 1]).log2());
            println!("{name} moment: error {:.1e} with 24 sides, rates {rates:.2?}", errors[1]);
            assert!(rates.iter().all(|rate| (rate - 4.0).abs() < 0.1), "{rates:?}");
        }
        assert!(errors[1][0] < 4e-5);
    }

    /// The integral of a bell-shaped contact of the width of a press through rubber, anywhere on a patch of `lab-b`.
    #[test]
    fn the_points_of_a_patch_are_fine_enough_for_a_press() {
        let radius: f64 = 0.0048;
        let corners_m = round_corners_m(radius, ROUND_SIDES);
        let (points, fine) = (points(&corners_m), rule(&corners_m, 40, 960));
        let bell = |points: &[(Point2, f64)], x: f64| {
            let value = |&([px, py], area): &(Point2, f64)| {
                area * (-0.5 * ((px - x).powi(2) + py * py) / 0.002f64.powi(2)).exp()
            };
            points.iter().map(value).sum::<f64>()
        };
        let errors = (0..=10).map(|k| 0.1 * k as f64 * radius).map(|x| bell(&points, x) / bell(&fine, x) - 1.0);
        let worst = errors.map(f64::abs).fold(0.0, f64::max);
        println!("{} points: error of the contact at most {worst:.1e}", points.len());
        assert!(worst < 1e-4, "{worst}");
    }

    /// Neighbours in every direction are at least a gap apart, and the nearest exactly.
    #[test]
    fn neighbours_are_a_gap_apart_and_never_overlap() {
        let gap_m = 0.0015;
        for shape in [PatchShape::Round, PatchShape::Hexagonal] {
            for (lattice, pitch_m) in [
                (PatchLattice::Rectangular, [0.010, 0.011]),
                (PatchLattice::Staggered, [0.01 * 0.75f64.sqrt(), 0.01]),
                (PatchLattice::Staggered, [0.004, 0.013]),
                (PatchLattice::Staggered, [0.02, 0.01]),
            ] {
                let corners_m = shape.corners_m(lattice, pitch_m, gap_m).unwrap();
                let wider = shape.corners_m(lattice, pitch_m, -1e-5).unwrap();
                let overlap = |corners_m: &[Point2], step: Point2| {
                    let moved: Vec<Point2> = corners_m.iter().map(|c| [c[0] + step[0], c[1] + step[1]]).collect();
                    polygon::signed_area(&clip(&moved, [0.0; 2], corners_m))
                };
                let mut most = 0.0f64;
                for (row, column) in (-3..=3).flat_map(|row| (-3..=3).map(move |column| (row, column))) {
                    let shift = if lattice == PatchLattice::Staggered { 0.5 * (row & 1) as f64 } else { 0.0 };
                    let step = [(column as f64 + shift) * pitch_m[1], row as f64 * pitch_m[0]];
                    if (row, column) != (0, 0) {
                        assert_eq!(overlap(&corners_m, step), 0.0, "{shape:?} {lattice:?} {step:?}");
                        most = most.max(overlap(&wider, step));
                    }
                }
                // The corners of the polygon of a round patch may be between those of its neighbour.
                assert!(most > 0.0 || shape == PatchShape::Round, "{shape:?} {lattice:?} {pitch_m:?}");
            }
        }
        let hexagonal = [0.01 * 0.75f64.sqrt(), 0.01];
        assert!((PatchShape::Hexagonal.widest_m(PatchLattice::Staggered, hexagonal) - 0.01).abs() < 1e-15);
        assert!((PatchShape::Round.widest_m(PatchLattice::Staggered, hexagonal) - 0.01).abs() < 1e-15);
    }
}
