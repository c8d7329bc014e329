//! The unrolled body: the plane region that is meshed.

use crate::design::Body;
use crate::geom::surface::wrap_angle;
use crate::geom::vector::{Point2, Point3};
use std::f64::consts::TAU;

/// A body that can be unrolled: points are (around, z) on a cylinder, (x, y) elsewhere, in m.
#[derive(Debug, Clone)]
pub(super) struct Domain {
    shape: Shape,
}

#[derive(Debug, Clone, Copy)]
enum Shape {
    Cylinder { radius: f64, length: f64 },
    Disk { radius: f64 },
    Rectangle { width: f64, height: f64 },
}

/// A closed curve of the body's edge, by arc length.
#[derive(Debug, Clone)]
pub(super) struct Edge {
    shape: Shape,
    /// z of a cylinder's rim.
    z: f64,
    pub length: f64,
    /// Arc lengths of the corners of the curve.
    pub corners: Vec<f64>,
}

impl Domain {
    /// The unrolled body; `None` for a mesh file.
    pub(super) fn new(body: &Body) -> Option<Self> {
        let shape = match *body {
            Body::Cylinder { length_m, diameter_m } => Shape::Cylinder { radius: diameter_m / 2.0, length: length_m },
            Body::Disk { diameter_m } => Shape::Disk { radius: diameter_m / 2.0 },
            Body::Rectangle { width_m, height_m } => Shape::Rectangle { width: width_m, height: height_m },
            Body::Mesh { .. } => return None,
        };
        Some(Domain { shape })
    }

    /// The circumference, if the region is periodic along its first axis.
    pub(super) fn period(&self) -> Option<f64> {
        match self.shape {
            Shape::Cylinder { radius, .. } => Some(TAU * radius),
            _ => None,
        }
    }

    /// The region's bounding box.
    pub(super) fn bounds(&self) -> (Point2, Point2) {
        match self.shape {
            Shape::Cylinder { radius, length } => ([0.0, 0.0], [TAU * radius, length]),
            Shape::Disk { radius } => ([-radius; 2], [radius; 2]),
            Shape::Rectangle { width, height } => ([0.0; 2], [width, height]),
        }
    }

    /// The region's area.
    pub(super) fn area(&self) -> f64 {
        match self.shape {
            Shape::Cylinder { radius, length } => TAU * radius * length,
            Shape::Disk { radius } => TAU * radius * radius / 2.0,
            Shape::Rectangle { width, height } => width * height,
        }
    }

    /// Unrolls a point of the body.
    pub(super) fn unroll(&self, point: Point3) -> Point2 {
        match self.shape {
            Shape::Cylinder { radius, .. } => [radius * wrap_angle(point[1].atan2(point[0])), point[2]],
            _ => [point[0], point[1]],
        }
    }

    /// The point on the body of an unrolled point.
    pub(super) fn roll(&self, point: Point2) -> Point3 {
        match self.shape {
            Shape::Cylinder { radius, .. } => {
                let (sin, cos) = (point[0] / radius).sin_cos();
                [radius * cos, radius * sin, point[1]]
            }
            _ => [point[0], point[1], 0.0],
        }
    }

    /// `point` reduced to one period.
    pub(super) fn wrap(&self, point: Point2) -> Point2 {
        match self.period() {
            Some(period) => {
                let round = point[0].rem_euclid(period);
                [if round < period { round } else { 0.0 }, point[1]]
            }
            None => point,
        }
    }

    /// `to - from`, the shorter way around.
    pub(super) fn offset(&self, from: Point2, to: Point2) -> Point2 {
        let mut round = to[0] - from[0];
        if let Some(period) = self.period() {
            round -= period * (round / period).round();
        }
        [round, to[1] - from[1]]
    }

    /// The distance between two points, the shorter way around.
    pub(super) fn distance(&self, from: Point2, to: Point2) -> f64 {
        let [x, y] = self.offset(from, to);
        x.hypot(y)
    }

    /// The distance to the edge, negative outside.
    pub(super) fn depth(&self, point: Point2) -> f64 {
        match self.shape {
            Shape::Cylinder { length, .. } => point[1].min(length - point[1]),
            Shape::Disk { radius } => radius - point[0].hypot(point[1]),
            Shape::Rectangle { width, height } => point[0].min(width - point[0]).min(point[1]).min(height - point[1]),
        }
    }

    /// The closed curves that bound the region.
    pub(super) fn edges(&self) -> Vec<Edge> {
        let edge = |z: f64, length: f64, corners: Vec<f64>| Edge { shape: self.shape, z, length, corners };
        match self.shape {
            Shape::Cylinder { radius, length } => {
                vec![edge(0.0, TAU * radius, vec![]), edge(length, TAU * radius, vec![])]
            }
            Shape::Disk { radius } => vec![edge(0.0, TAU * radius, vec![])],
            Shape::Rectangle { width, height } => {
                vec![edge(0.0, 2.0 * (width + height), vec![0.0, width, width + height, 2.0 * width + height])]
            }
        }
    }
}

impl Edge {
    /// The point at an arc length, which may exceed one turn.
    pub(super) fn point(&self, s: f64) -> Point2 {
        let s = s.rem_euclid(self.length);
        match self.shape {
            Shape::Cylinder { .. } => [if s < self.length { s } else { 0.0 }, self.z],
            Shape::Disk { radius } => {
                let (sin, cos) = (s / radius).sin_cos();
                [radius * cos, radius * sin]
            }
            Shape::Rectangle { width, height } => match s {
                s if s <= width => [s, 0.0],
                // The far corner exactly: with a rounding error above its side it would be joined to the side's far end
                // by a triangle without area.
                s if s == width + height => [width, height],
                s if s <= width + height => [width, s - width],
                s if s <= 2.0 * width + height => [2.0 * width + height - s, height],
                s => [0.0, 2.0 * (width + height) - s],
            },
        }
    }

    /// The arc length of the point nearest to `point`, and the distance to it.
    pub(super) fn nearest(&self, point: Point2) -> (f64, f64) {
        match self.shape {
            Shape::Cylinder { .. } => (point[0].rem_euclid(self.length), (point[1] - self.z).abs()),
            Shape::Disk { radius } => {
                (radius * wrap_angle(point[1].atan2(point[0])), (radius - point[0].hypot(point[1])).abs())
            }
            Shape::Rectangle { width, height } => {
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
            let domain = Domain::new(&Body::Rectangle { width_m, height_m }).unwrap();
            let edge = &domain.edges()[0];
            let corners: Vec<Point2> = edge.corners.iter().map(|&s| edge.point(s)).collect();
            assert_eq!(corners, [[0.0, 0.0], [width_m, 0.0], [width_m, height_m], [0.0, height_m]]);
        }
    }
}
