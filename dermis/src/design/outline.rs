//! A flat body of any outline, as the triangles between its corners.

use crate::design::check::{LARGEST_BODY_M, SMALLEST_BODY_M};
use crate::geom::Point2;
use crate::geom::polygon::signed_area;
use crate::geom::vector::bounding_box;
use spade::{ConstrainedDelaunayTriangulation, Point2 as SpadePoint, Triangulation};
use std::fmt::Write;

/// Maximum number of corners: a side of 1 mm on an outline of 1 m.
const MAX_CORNERS: usize = 1000;

/// The outline of a flat body in the plane z = 0.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Outline {
    /// Its corners, counter-clockwise, the first as in the design.
    pub corners_m: Vec<Point2>,
    /// The triangles between them.
    triangles: Vec<[usize; 3]>,
}

/// What is wrong, and the fix.
type Wrong = (String, &'static str);

impl Outline {
    /// The outline with these corners in either direction.
    pub(super) fn new(corners_m: &[Point2]) -> Result<Self, Wrong> {
        sizes(corners_m)?;
        let mut corners_m = corners_m.to_vec();
        let is_clockwise = signed_area(&corners_m) < 0.0;
        if is_clockwise {
            corners_m[1..].reverse();
        }
        let given = |corner: usize| if is_clockwise && corner > 0 { corners_m.len() - corner } else { corner };
        let triangles = triangles(&corners_m, given)?;
        Ok(Outline { corners_m, triangles })
    }

    /// The triangles as an OBJ file, m.
    pub(super) fn to_obj(&self) -> String {
        let mut text = String::new();
        for [x, y] in &self.corners_m {
            let _ = writeln!(text, "v {x:?} {y:?} 0");
        }
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|corner| corner + 1);
            let _ = writeln!(text, "f {a} {b} {c}");
        }
        text
    }
}

/// Checks the number of corners and the size of the body.
fn sizes(corners_m: &[Point2]) -> Result<(), Wrong> {
    let count = corners_m.len();
    if !(3..=MAX_CORNERS).contains(&count) {
        let message = format!("an outline of {count} corners: it has 3 to {MAX_CORNERS}");
        return Err((message, "list its corners in order, as [[x, y], [x, y], ...]"));
    }
    if let Some(corner) = corners_m.iter().position(|corner| corner.iter().any(|value| !value.is_finite())) {
        return Err((format!("corner {corner} is at {:?}: it must be finite", corners_m[corner]), "give a number"));
    }
    let [low_m, high_m] = bounding_box(corners_m.iter().copied());
    let size_m = (high_m[0] - low_m[0]).max(high_m[1] - low_m[1]);
    if !(SMALLEST_BODY_M..=LARGEST_BODY_M).contains(&size_m) {
        let message =
            format!("the outline is {size_m} m long: a skin has from {SMALLEST_BODY_M} to {LARGEST_BODY_M} m");
        return Err((message, "lengths are in metres"));
    }
    for (j, b) in corners_m.iter().enumerate() {
        if let Some(i) = corners_m[..j].iter().position(|a| a == b) {
            let message = format!("corners {i} and {j} are at the same place");
            return Err((message, "list each corner once: the outline closes itself"));
        }
    }
    Ok(())
}

/// The triangles between corners in counter-clockwise order; `given` is the number of a corner in the design.
fn triangles(corners_m: &[Point2], given: impl Fn(usize) -> usize) -> Result<Vec<[usize; 3]>, Wrong> {
    let count = corners_m.len();
    let mut triangulation = ConstrainedDelaunayTriangulation::<SpadePoint<f64>>::new();
    let mut placed = Vec::with_capacity(count);
    for (corner, &[x, y]) in corners_m.iter().enumerate() {
        let cannot = |error| (format!("corner {} cannot be placed: {error}", given(corner)), "lengths are in metres");
        placed.push(triangulation.insert(SpadePoint::new(x, y)).map_err(cannot)?);
    }
    for corner in 0..count {
        let next = (corner + 1) % count;
        let is_free = triangulation.can_add_constraint(placed[corner], placed[next]);
        // A side through another corner becomes two.
        if !is_free
            || !triangulation.add_constraint(placed[corner], placed[next])
            || triangulation.num_constraints() > corner + 1
        {
            let message = format!("the side between corners {} and {} meets another side", given(corner), given(next));
            return Err((message, "list the corners in their order along the outline, which may not cross itself"));
        }
    }
    let corners = triangulation.inner_faces().map(|face| face.vertices().map(|vertex| vertex.fix().index()));
    let middle = |triangle: &[usize; 3]| {
        [0, 1].map(|axis| triangle.iter().map(|&corner| corners_m[corner][axis]).sum::<f64>() / 3.0)
    };
    let is_inside = |triangle: &[usize; 3]| holds(corners_m, middle(triangle));
    let inside: Vec<[usize; 3]> = corners.filter(is_inside).collect();
    match inside.is_empty() {
        true => Err(("the outline has no area".into(), "its corners may not lie on one line")),
        false => Ok(inside),
    }
}

/// Whether a point is inside an outline: a ray from it crosses the sides an odd number of times.
fn holds(corners_m: &[Point2], [x, y]: Point2) -> bool {
    let next = corners_m.iter().cycle().skip(1);
    let crosses =
        |(a, b): &(&Point2, &Point2)| (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1]);
    corners_m.iter().zip(next).filter(crosses).count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An L: a square of 0.2 m without a quarter.
    const CORNER: [Point2; 6] = [[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.1, 0.1], [0.1, 0.2], [0.0, 0.2]];

    fn area_m2(outline: &Outline) -> f64 {
        outline.triangles.iter().map(|triangle| signed_area(&triangle.map(|corner| outline.corners_m[corner]))).sum()
    }

    #[test]
    fn the_triangles_cover_the_outline_once_in_either_direction() {
        let mut clockwise = CORNER;
        clockwise[1..].reverse();
        for corners in [CORNER, clockwise] {
            let outline = Outline::new(&corners).unwrap();
            assert_eq!(outline.corners_m, CORNER);
            assert!((area_m2(&outline) - 0.03).abs() < 1e-15 && outline.triangles.len() == 4);
        }
        // Corners on a straight side are corners of triangles.
        let on_side = [[0.0, 0.0], [0.05, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]];
        assert!((area_m2(&Outline::new(&on_side).unwrap()) - 0.01).abs() < 1e-15);
    }

    #[test]
    fn what_is_no_outline_is_named() {
        let wrong = |corners: &[Point2]| Outline::new(corners).unwrap_err().0;
        assert!(wrong(&CORNER[..2]).contains("an outline of 2 corners: it has 3 to 1000"));
        assert!(wrong(&[CORNER[0], CORNER[1], CORNER[3], CORNER[0]]).contains("corners 0 and 3 are at the same place"));
        assert!(wrong(&[[0.0, 0.0], [0.1, 0.1], [0.1, 0.0], [0.0, 0.1]]).contains("meets another side"));
        assert!(wrong(&[[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.1, 0.0]]).contains("meets another side"));
        assert!(wrong(&[[0.0, 0.0], [200.0, 0.0], [0.0, 100.0]]).contains("the outline is 200 m long"));
        assert!(wrong(&[[0.0, 0.0], [0.1, 0.0], [f64::NAN, 0.1]]).contains("corner 2 is at"));
        assert!(!wrong(&[[0.0, 0.0], [0.1, 0.0], [0.2, 0.0]]).is_empty());
    }
}
