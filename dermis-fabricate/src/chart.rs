//! The unrolled coat: exact for a cylinder and for flat bodies.

use crate::outline::Outline;
use dermis::design::{Body, FabricationOptions};
use dermis::geom::surface::wrap_angle;
use dermis::geom::{Point2, Point3};
use std::f64::consts::{PI, TAU};

/// The flat layout of a coat as seen from outside, m: (arc length from the seam, z) on a cylinder, (x, y) on a flat body.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    body: Body,
    seam_rad: f64,
}

impl Chart {
    /// The chart of a body; `None` for a body from a mesh file.
    pub(crate) fn of(body: &Body, options: &FabricationOptions) -> Option<Self> {
        match body {
            Body::Mesh { .. } => None,
            body => Some(Chart { body: body.clone(), seam_rad: options.seam_theta_rad }),
        }
    }

    /// The place of a point of the surface. On a cylinder the arc length is in `[0, circumference)`.
    pub fn place_m(&self, [x, y, z]: Point3) -> Point2 {
        match self.body {
            Body::Cylinder { diameter_m, .. } => [0.5 * diameter_m * wrap_angle(y.atan2(x) - self.seam_rad), z],
            _ => [x, y],
        }
    }

    /// The point of the surface at a place.
    pub fn point_m(&self, [s, t]: Point2) -> Point3 {
        match self.body {
            Body::Cylinder { diameter_m, .. } => {
                let (sine, cosine) = (s / (0.5 * diameter_m) + self.seam_rad).sin_cos();
                [0.5 * diameter_m * cosine, 0.5 * diameter_m * sine, t]
            }
            _ => [s, t, 0.0],
        }
    }

    /// The outward unit normal at a point of the surface.
    pub(crate) fn normal(&self, point_m: Point3) -> Point3 {
        self.body.surface().normal(point_m).expect("a chart is of a known surface")
    }

    /// The circumference of a cylinder, at which the chart closes, m.
    pub fn around_m(&self) -> Option<f64> {
        match self.body {
            Body::Cylinder { diameter_m, .. } => Some(PI * diameter_m),
            _ => None,
        }
    }

    /// Places of a point with those beyond the seam, as far as a reach.
    pub(crate) fn places_within_m(&self, point_m: Point3, reach_m: f64) -> Vec<Point2> {
        let [s, t] = self.place_m(point_m);
        let Some(around_m) = self.around_m() else { return vec![[s, t]] };
        let copies = [s - around_m, s, s + around_m].into_iter();
        copies.filter(|s| *s > -reach_m && *s < around_m + reach_m).map(|s| [s, t]).collect()
    }

    /// The edge of the coat.
    pub(crate) fn coat(&self) -> Outline {
        match self.body {
            Body::Cylinder { length_m, diameter_m } => {
                Outline::rectangle([0.0, 0.0], [0.5 * diameter_m * TAU, length_m])
            }
            Body::Disk { diameter_m } => Outline::Circle { centre_m: [0.0; 2], radius_m: 0.5 * diameter_m },
            Body::Rectangle { width_m, height_m } => Outline::rectangle([0.0; 2], [width_m, height_m]),
            Body::Mesh { .. } => unreachable!("a body from a mesh file has no chart"),
        }
    }

    /// Lower corner and size of the box that the rows and columns of patches cover: (around or x, along or y).
    pub(crate) fn patch_box_m(&self) -> (Point2, Point2) {
        let [low, high] = self.coat().bounds_m();
        (low, [high[0] - low[0], high[1] - low[1]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::geom::vector::distance;

    #[test]
    fn a_cylinder_unrolls_and_back_with_its_distances() {
        let options = FabricationOptions { seam_theta_rad: 0.3, ..FabricationOptions::default() };
        let body = Body::Cylinder { length_m: 0.3, diameter_m: 0.1 };
        let chart = Chart::of(&body, &options).unwrap();
        let mut last = chart.point_m([0.0, 0.0]);
        for k in 1..1000 {
            let place = [k as f64 * 3e-4, k as f64 * 2e-4];
            let point = chart.point_m(place);
            let back = chart.place_m(point);
            assert!((back[0] - place[0]).abs() < 1e-15 && back[1] == place[1]);
            // The chord of an arc of length s on the radius R is 2 R sin(s / 2 R).
            let chord = (0.1 * (3e-4f64 / 0.1).sin()).hypot(2e-4);
            assert!((distance(point, last) - chord).abs() < 1e-15);
            last = point;
        }
    }
}
