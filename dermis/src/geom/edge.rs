//! The closed curves that bound a body, unrolled.

use super::chart::{Chart, Shape};
use super::surface::wrap_angle;
use super::vector::Point2;
use std::f64::consts::TAU;

/// A closed curve of the body's edge, by arc length.
#[derive(Debug, Clone)]
pub(crate) struct Edge {
    shape: Shape,
    /// z of a cylinder's rim.
    z: f64,
    /// Its length, m.
    pub length: f64,
    /// Arc lengths of the corners of the curve.
    pub corners: Vec<f64>,
}

impl Edge {
    /// The curves that bound a body.
    pub(crate) fn all(chart: &Chart) -> Vec<Edge> {
        let edge = |z: f64, length: f64, corners: Vec<f64>| Edge { shape: chart.shape(), z, length, corners };
        match chart.shape() {
            Shape::Wall { radius_m, length_m } => [0.0, length_m].map(|z| edge(z, TAU * radius_m, vec![])).to_vec(),
            Shape::Disk { radius_m } => vec![edge(0.0, TAU * radius_m, vec![])],
            Shape::Rectangle { width_m: width, height_m: height } => {
                vec![edge(0.0, 2.0 * (width + height), vec![0.0, width, width + height, 2.0 * width + height])]
            }
            Shape::Plane => Vec::new(),
        }
    }

    /// The point at an arc length, which may exceed one turn.
    pub(crate) fn point(&self, s: f64) -> Point2 {
        let s = s.rem_euclid(self.length);
        match self.shape {
            Shape::Wall { .. } => [if s < self.length { s } else { 0.0 }, self.z],
            Shape::Disk { radius_m: radius } => {
                let (sin, cos) = (s / radius).sin_cos();
                [radius * cos, radius * sin]
            }
            Shape::Rectangle { width_m: width, height_m: height } => match s {
                s if s <= width => [s, 0.0],
                // The far corner exactly: with a rounding error above its side it would be joined to the side's far end
                // by a triangle without area.
                s if s == width + height => [width, height],
                s if s <= width + height => [width, s - width],
                s if s <= 2.0 * width + height => [2.0 * width + height - s, height],
                s => [0.0, 2.0 * (width + height) - s],
            },
            Shape::Plane => unreachable!("a plane has no edge"),
        }
    }

    /// The shorter of the two ways along the curve between two arc lengths.
    pub(crate) fn arc_m(&self, from: f64, to: f64) -> f64 {
        let arc_m = (to - from).rem_euclid(self.length);
        arc_m.min(self.length - arc_m)
    }

    /// The arc length of the point nearest to `point`, and the distance to it.
    pub(crate) fn nearest(&self, point: Point2) -> (f64, f64) {
        match self.shape {
            Shape::Wall { .. } => (point[0].rem_euclid(self.length), (point[1] - self.z).abs()),
            Shape::Disk { radius_m: radius } => {
                (radius * wrap_angle(point[1].atan2(point[0])), (radius - point[0].hypot(point[1])).abs())
            }
            Shape::Rectangle { width_m: width, height_m: height } => {
                let (x, y) = (point[0].clamp(0.0, width), point[1].clamp(0.0, height));
                [
                    (x, point[1].abs()),
                    (width + y, (point[0] - width).abs()),
                    (2.0 * width + height - x, (point[1] - height).abs()),
                    ((2.0 * (width + height) - y).rem_euclid(self.length), point[0].abs()),
                ]
                .into_iter()
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .expect("four sides")
            }
            Shape::Plane => unreachable!("a plane has no edge"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_corners_of_a_rectangle_are_exact() {
        // (w + h) - w differs from h in floating point for a third of all sizes; for the first of these it is larger.
        for [width_m, height_m] in [[0.1 * std::f64::consts::PI, 0.3], [0.7, 0.1], [0.3, 0.1], [0.1, 0.06]] {
            let edge = &Edge::all(&Chart::new(Shape::Rectangle { width_m, height_m }))[0];
            let corners: Vec<Point2> = edge.corners.iter().map(|&s| edge.point(s)).collect();
            assert_eq!(corners, [[0.0, 0.0], [width_m, 0.0], [width_m, height_m], [0.0, height_m]]);
        }
    }
}
