//! The unrolled surface: coordinates in which distances along the surface are straight-line distances.
//!
//! On a cylinder they are (around, along): the arc from theta = 0 and z, and the first is periodic. On any other
//! surface they are the coordinates in space. The arithmetic is that of [`Surface`], by functions with the same bits on
//! every system, for numbers drawn from a seed.
//!
//! ```
//! use dermis::geom::Surface;
//! use dermis_sim::unrolled::Unrolled;
//!
//! let surface = Unrolled::of(&Surface::Cylinder { radius_m: 0.05, length_m: 0.3 });
//! let here = surface.place([0.05, 0.0, 0.1]);
//! let there = surface.place(surface.walk([0.05, 0.0, 0.1], [-0.03, 0.04]));
//! assert!((surface.distance_m(here, there) - 0.05).abs() < 1e-12);
//! ```

use crate::elementary::{atan2, sin_cos};
use dermis::geom::vector::sub;
use dermis::geom::{Point2, Point3, Surface};
use std::f64::consts::TAU;

/// A surface, unrolled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unrolled {
    /// Of a cylinder, m.
    radius_m: Option<f64>,
}

impl Unrolled {
    /// Unrolls a surface.
    pub fn of(surface: &Surface) -> Self {
        match surface {
            Surface::Cylinder { radius_m, .. } => Unrolled { radius_m: Some(*radius_m) },
            Surface::Plane | Surface::Free => Unrolled { radius_m: None },
        }
    }

    /// The period of the first coordinate, m.
    pub fn period_m(&self) -> Option<f64> {
        self.radius_m.map(|radius_m| TAU * radius_m)
    }

    /// A point in unrolled coordinates, m; the first is between minus and plus half a period if it is periodic.
    pub fn place(&self, point_m: Point3) -> Point3 {
        self.radius_m.map_or(point_m, |radius_m| [radius_m * atan2(point_m[1], point_m[0]), point_m[2], 0.0])
    }

    /// The step between two positions, the shorter way around, m.
    pub fn step(&self, from: Point3, to: Point3) -> Point3 {
        let mut step = sub(to, from);
        if let Some(period_m) = self.period_m() {
            let periods = step[0] / period_m;
            // Most steps are shorter than half a period.
            if periods.abs() >= 0.5 {
                step[0] -= period_m * periods.round();
            }
        }
        step
    }

    /// The first two unrolled coordinates of a point, (around, along) on a cylinder, m.
    pub fn chart(&self, point_m: Point3) -> Point2 {
        let [round, along, _] = self.place(point_m);
        [round, along]
    }

    /// The step between two positions given by these, the shorter way around, m.
    pub fn chart_step(&self, from: Point2, to: Point2) -> Point2 {
        let [round, along, _] = self.step([from[0], from[1], 0.0], [to[0], to[1], 0.0]);
        [round, along]
    }

    /// The square of the distance of two positions, m2.
    #[inline]
    pub fn squared_distance_m2(&self, a: Point3, b: Point3) -> f64 {
        let [mut round, along, up] = sub(a, b);
        if let Some(period_m) = self.period_m() {
            // Correct for positions up to one and a half periods apart: the square does not depend on the sign.
            round = round.abs().min(period_m - round.abs());
        }
        round * round + along * along + up * up
    }

    /// The distance of two positions, m.
    #[inline]
    pub fn distance_m(&self, a: Point3, b: Point3) -> f64 {
        self.squared_distance_m2(a, b).sqrt()
    }

    /// The point reached from a point by a step along the surface, m.
    pub fn walk(&self, [x, y, z]: Point3, [round, along]: [f64; 2]) -> Point3 {
        match self.radius_m {
            Some(radius_m) => {
                let (sine, cosine) = sin_cos(atan2(y, x) + round / radius_m);
                [radius_m * cosine, radius_m * sine, z + along]
            }
            None => [x + round, y + along, z],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_and_steps_are_those_of_the_surface() {
        for surface in [Surface::Cylinder { radius_m: 0.05, length_m: 0.3 }, Surface::Plane] {
            let unrolled = Unrolled::of(&surface);
            let origin = [0.03, -0.04, 0.0];
            for k in 0..40 {
                let step_m = [0.02 * (f64::from(k) - 20.0) / 3.0, 0.001 * f64::from(k)];
                let (own, other) = (unrolled.walk(origin, step_m), surface.walk(origin, step_m));
                assert!((0..3).all(|axis| (own[axis] - other[axis]).abs() < 1e-15));
                let (a, b) = (unrolled.place(origin), unrolled.place(own));
                assert!((unrolled.distance_m(a, b) - surface.distance_m(origin, own)).abs() < 1e-15);
                let back = unrolled.step(a, b);
                let chart = surface.chart(origin, own);
                assert!((0..2).all(|axis| (back[axis] - chart[axis]).abs() < 1e-15), "{back:?} {chart:?}");
            }
        }
    }
}
