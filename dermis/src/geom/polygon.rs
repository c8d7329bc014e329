//! Polygons in the plane: area, centroid, clipping.

use crate::geom::vector::Point2;

/// The signed area, positive for corners in counter-clockwise order.
pub fn signed_area(corners: &[Point2]) -> f64 {
    let Some(&last) = corners.last() else { return 0.0 };
    let mut twice = 0.0;
    let mut previous = last;
    for &corner in corners {
        twice += previous[0] * corner[1] - corner[0] * previous[1];
        previous = corner;
    }
    0.5 * twice
}

/// The part of a polygon on the side `normal . x <= offset` of a line (Sutherland and Hodgman, 1974,
/// DOI 10.1145/360767.360802). Exact for convex polygons.
pub fn clip_half_plane(corners: &[Point2], normal: Point2, offset: f64) -> Vec<Point2> {
    let mut kept = Vec::with_capacity(corners.len() + 1);
    clip_half_plane_into(corners, normal, offset, &mut kept);
    kept
}

fn clip_half_plane_into(corners: &[Point2], normal: Point2, offset: f64, kept: &mut Vec<Point2>) {
    let side = |p: Point2| normal[0] * p[0] + normal[1] * p[1] - offset;
    kept.clear();
    let Some(&last) = corners.last() else { return };
    let mut previous = last;
    for &corner in corners {
        let (from, to) = (side(previous), side(corner));
        if (from > 0.0) != (to > 0.0) {
            let t = from / (from - to);
            kept.push([previous[0] + t * (corner[0] - previous[0]), previous[1] + t * (corner[1] - previous[1])]);
        }
        if to <= 0.0 {
            kept.push(corner);
        }
        previous = corner;
    }
}

/// The part of a convex polygon inside an axis-aligned box, in the caller's memory: the result is in the first list.
pub fn clip_box_in(corners: &[Point2], low: Point2, high: Point2, [kept, other]: &mut [Vec<Point2>; 2]) {
    kept.clear();
    kept.extend_from_slice(corners);
    let sides = [([1.0, 0.0], high[0]), ([-1.0, 0.0], -low[0]), ([0.0, 1.0], high[1]), ([0.0, -1.0], -low[1])];
    for (normal, offset) in sides {
        // Most sides cut nothing off.
        if kept.iter().any(|corner| normal[0] * corner[0] + normal[1] * corner[1] > offset) {
            clip_half_plane_into(kept, normal, offset, other);
            std::mem::swap(kept, other);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_clipped_by_a_box_keeps_the_overlap() {
        let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
        let mut memory = [Vec::new(), Vec::new()];
        clip_box_in(&square, [1.0, -1.0], [3.0, 0.5], &mut memory);
        assert!((signed_area(&memory[0]) - 0.5).abs() < 1e-15);
        clip_box_in(&square, [3.0, 3.0], [4.0, 4.0], &mut memory);
        assert!(memory[0].is_empty());
    }
}
