//! The chart of a body: the plane in which its surface lies unrolled.

use super::surface::Surface;
use super::vector::{Point2, Point3};
use std::array::from_fn;
use std::f64::consts::TAU;
use std::marker::PhantomData;

/// The elementary functions of a chart. Those of the system's C library differ between systems in the last bit; a
/// simulation brings functions that do not.
pub trait Elementary: Copy {
    /// The angle of the vector `(x, y)`.
    fn atan2(y: f64, x: f64) -> f64;
    /// The sine and the cosine of an angle.
    fn sin_cos(angle_rad: f64) -> (f64, f64);
    /// The length of the vector `(x, y)`.
    fn hypot(x: f64, y: f64) -> f64;
}

/// The elementary functions of the system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct System;

impl Elementary for System {
    fn atan2(y: f64, x: f64) -> f64 {
        y.atan2(x)
    }

    fn sin_cos(angle_rad: f64) -> (f64, f64) {
        angle_rad.sin_cos()
    }

    fn hypot(x: f64, y: f64) -> f64 {
        x.hypot(y)
    }
}

/// The shape of an unrolled body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// The wall of a cylinder, cut open at the seam.
    Wall {
        /// Radius of the cylinder, m.
        radius_m: f64,
        /// Length along the axis, m.
        length_m: f64,
    },
    /// A disk around the origin.
    Disk {
        /// Radius, m.
        radius_m: f64,
    },
    /// A rectangle from the origin to (width, height).
    Rectangle {
        /// Width, m.
        width_m: f64,
        /// Height, m.
        height_m: f64,
    },
    /// The whole plane: the edges are not known.
    Plane,
}

/// The chart of a body, in which distances along the surface are straight-line distances.
///
/// A place in the chart is (arc from theta = 0, z) on the wall of a cylinder and (x, y) elsewhere, m. The wall is cut open
/// at the seam: the arc of an unrolled point is from the seam on, up to one turn.
///
/// ```
/// use dermis::geom::{Chart, Surface};
///
/// let wall = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
/// let chart = Chart::of(&wall);
/// let [here, there] = [-0.1, 0.1].map(|theta_rad| chart.unroll(wall.at(0.1, theta_rad).unwrap()));
/// let [around_m, along_m] = chart.difference(here, there);
/// assert!((around_m - 0.01).abs() < 1e-15 && along_m == 0.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chart<F = System> {
    shape: Shape,
    seam_rad: f64,
    functions: PhantomData<F>,
}

impl Chart {
    /// The chart of a shape, with the seam of a wall at theta = 0.
    pub fn new(shape: Shape) -> Self {
        Chart { shape, seam_rad: 0.0, functions: PhantomData }
    }

    /// The chart of a surface; that of a plane has no edges, and on a `Free` surface it is the projection on (x, y).
    pub fn of(surface: &Surface) -> Self {
        match *surface {
            Surface::Cylinder { radius_m, length_m } => Chart::new(Shape::Wall { radius_m, length_m }),
            Surface::Plane | Surface::Free => Chart::new(Shape::Plane),
        }
    }
}

impl<F: Elementary> Chart<F> {
    /// The chart with the seam at another angle.
    pub fn with_seam(self, seam_rad: f64) -> Self {
        Chart { seam_rad, ..self }
    }

    /// The chart computed by other elementary functions.
    pub fn with_functions<G: Elementary>(self) -> Chart<G> {
        Chart { shape: self.shape, seam_rad: self.seam_rad, functions: PhantomData }
    }

    /// The shape of the unrolled body.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// The circumference of a wall, by which its places repeat.
    pub fn period_m(&self) -> Option<f64> {
        match self.shape {
            Shape::Wall { radius_m, .. } => Some(TAU * radius_m),
            _ => None,
        }
    }

    /// Width and height of the shape; infinite without edges.
    pub fn size_m(&self) -> Point2 {
        match self.shape {
            Shape::Wall { radius_m, length_m } => [TAU * radius_m, length_m],
            Shape::Disk { radius_m } => [2.0 * radius_m; 2],
            Shape::Rectangle { width_m, height_m } => [width_m, height_m],
            Shape::Plane => [f64::INFINITY; 2],
        }
    }

    /// The lower and the upper corner of the bounding box of the shape.
    pub fn bounds_m(&self) -> [Point2; 2] {
        let low_m = match self.shape {
            Shape::Wall { radius_m, .. } => [radius_m * self.seam_rad, 0.0],
            Shape::Disk { radius_m } => [-radius_m; 2],
            Shape::Rectangle { .. } => [0.0; 2],
            Shape::Plane => return [[f64::NEG_INFINITY; 2], [f64::INFINITY; 2]],
        };
        [low_m, from_fn(|axis| low_m[axis] + self.size_m()[axis])]
    }

    /// The area of the shape.
    pub fn area_m2(&self) -> f64 {
        match self.shape {
            Shape::Disk { radius_m } => TAU * radius_m * radius_m / 2.0,
            _ => self.size_m().iter().product(),
        }
    }

    /// The distance of a place from the nearest edge, negative off the body.
    pub fn depth_m(&self, [x, y]: Point2) -> f64 {
        match self.shape {
            Shape::Wall { length_m, .. } => y.min(length_m - y),
            Shape::Disk { radius_m } => radius_m - F::hypot(x, y),
            Shape::Rectangle { width_m, height_m } => x.min(width_m - x).min(y).min(height_m - y),
            Shape::Plane => f64::INFINITY,
        }
    }

    /// The place on the body nearest to a place.
    pub fn nearest(&self, [x, y]: Point2) -> Point2 {
        match self.shape {
            Shape::Wall { length_m, .. } => [x, y.clamp(0.0, length_m)],
            Shape::Disk { radius_m } => {
                let part = (radius_m / F::hypot(x, y)).min(1.0);
                [x * part, y * part]
            }
            Shape::Rectangle { width_m, height_m } => [x.clamp(0.0, width_m), y.clamp(0.0, height_m)],
            Shape::Plane => [x, y],
        }
    }

    /// The place of a point of the surface.
    pub fn unroll(&self, point_m: Point3) -> Point2 {
        let [x, y, _] = self.unroll_in_space(point_m);
        [x, y]
    }

    /// The place of a point with the coordinate that the chart leaves out, for distances in space: z of a point of a
    /// plane or of a `Free` surface, 0 on a wall.
    pub fn unroll_in_space(&self, point_m: Point3) -> Point3 {
        match self.shape {
            Shape::Wall { radius_m, .. } => {
                let mut theta_rad = F::atan2(point_m[1], point_m[0]);
                // A point on the seam keeps its side of it.
                if !(self.seam_rad..=self.seam_rad + TAU).contains(&theta_rad) {
                    theta_rad = wrapped(theta_rad, self.seam_rad, TAU);
                }
                [radius_m * theta_rad, point_m[2], 0.0]
            }
            _ => point_m,
        }
    }

    /// The place of a point next to a place, which may be beyond the seam: that of the shorter way around.
    pub fn unroll_beside(&self, place: Point2, point_m: Point3) -> Point2 {
        let [x, y] = self.unroll(point_m);
        match self.period_m() {
            Some(period_m) => [x + period_m * ((place[0] - x) / period_m).round(), y],
            None => [x, y],
        }
    }

    /// The point of the surface at a place.
    pub fn roll(&self, [x, y]: Point2) -> Point3 {
        match self.shape {
            Shape::Wall { radius_m, .. } => on_wall::<F>(radius_m, x / radius_m, y),
            _ => [x, y, 0.0],
        }
    }

    /// The point reached from a point by a step along the surface.
    pub fn walk(&self, [x, y, z]: Point3, [across, along]: Point2) -> Point3 {
        match self.shape {
            Shape::Wall { radius_m, .. } => on_wall::<F>(radius_m, F::atan2(y, x) + across / radius_m, z + along),
            _ => [x + across, y + along, z],
        }
    }

    /// A place within one turn from the seam on.
    pub fn wrap(&self, place: Point2) -> Point2 {
        match self.period_m() {
            Some(period_m) => [wrapped(place[0], self.bounds_m()[0][0], period_m), place[1]],
            None => place,
        }
    }

    /// The step from a place to another, the shorter way around.
    #[inline]
    pub fn difference<const N: usize>(&self, from: [f64; N], to: [f64; N]) -> [f64; N] {
        let mut step: [f64; N] = from_fn(|axis| to[axis] - from[axis]);
        if let Some(period_m) = self.period_m() {
            let turns = step[0] / period_m;
            // Most steps are shorter than half a turn.
            if turns.abs() >= 0.5 {
                step[0] -= period_m * turns.round();
            }
        }
        step
    }

    /// The distance of two places, the shorter way around.
    pub fn distance_m(&self, a: Point2, b: Point2) -> f64 {
        let [x, y] = self.difference(a, b);
        F::hypot(x, y)
    }

    /// The square of the distance of two places at most one and a half turns apart, the shorter way around.
    #[inline]
    pub fn squared_distance_m2<const N: usize>(&self, a: [f64; N], b: [f64; N]) -> f64 {
        let mut step: [f64; N] = from_fn(|axis| a[axis] - b[axis]);
        if let Some(period_m) = self.period_m() {
            // The square does not depend on the sign.
            step[0] = step[0].abs().min(period_m - step[0].abs());
        }
        step.iter().map(|along| along * along).sum()
    }

    /// A place; on a wall also its copies one turn away, each if it is within a reach of the unrolled wall.
    pub fn copies_within(&self, place: Point2, reach_m: f64) -> impl Iterator<Item = Point2> + use<F> {
        let (turns, [low_m, high_m]) = match self.period_m() {
            Some(_) => (-1..=1, self.bounds_m().map(|[x, _]| x)),
            None => (0..=0, [f64::NEG_INFINITY, f64::INFINITY]),
        };
        let period_m = self.period_m().unwrap_or_default();
        let copies = turns.map(move |turn| [place[0] + f64::from(turn) * period_m, place[1]]);
        copies.filter(move |[x, _]| *x > low_m - reach_m && *x < high_m + reach_m)
    }
}

/// The point of a wall at an angle and a height.
pub(super) fn on_wall<F: Elementary>(radius_m: f64, theta_rad: f64, z_m: f64) -> Point3 {
    let (sine, cosine) = F::sin_cos(theta_rad);
    [radius_m * cosine, radius_m * sine, z_m]
}

/// A number reduced by whole periods to `[low, low + period)`; one in this range keeps its bits.
pub(super) fn wrapped(value: f64, low: f64, period: f64) -> f64 {
    if (low..low + period).contains(&value) {
        return value;
    }
    let wrapped = low + (value - low).rem_euclid(period);
    if wrapped < low + period { wrapped } else { low }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::vector::distance;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    const WALL: Surface = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
    const PERIOD_M: f64 = TAU * 0.05;
    /// A few roundings of an angle of two turns, times the radius.
    const ROUNDING_M: f64 = 1e-15;

    proptest! {
        #[test]
        fn a_place_rolls_and_unrolls_to_itself(turn in 0.0..1.0f64, along_m in 0.0..0.3, seam_rad in -TAU..TAU) {
            let chart = Chart::of(&WALL).with_seam(seam_rad);
            let [[low_m, _], [high_m, _]] = chart.bounds_m();
            let place = [low_m + turn * PERIOD_M, along_m];
            let back = chart.unroll(chart.roll(place));
            prop_assert!((low_m..=high_m).contains(&back[0]));
            let [across_m, up_m] = chart.difference(place, back);
            prop_assert!(across_m.abs() < ROUNDING_M && up_m == 0.0, "{place:?} {back:?}");
            let wrapped = chart.wrap([place[0] + PERIOD_M, along_m]);
            prop_assert!(chart.distance_m(wrapped, place) < ROUNDING_M, "{place:?} {wrapped:?}");
        }

        #[test]
        fn a_difference_goes_the_shorter_way_and_its_length_is_the_arc(
            a_rad in -PI..PI, b_rad in -PI..PI, a_m in 0.0..0.3, b_m in 0.0..0.3, seam_rad in -TAU..TAU
        ) {
            let chart = Chart::of(&WALL).with_seam(seam_rad);
            let points = [WALL.at(a_m, a_rad).unwrap(), WALL.at(b_m, b_rad).unwrap()];
            let [a, b] = points.map(|point| chart.unroll(point));
            let there = chart.difference(a, b);
            prop_assert_eq!(there, chart.difference(b, a).map(|step| -step));
            prop_assert!(there[0].abs() <= 0.5 * PERIOD_M * (1.0 + 1e-15));
            // The chord of an arc of length s on the radius R is 2 R sin(s / 2 R).
            let chord_m = (0.1 * (there[0] / 0.1).sin()).hypot(there[1]);
            prop_assert!((distance(points[0], points[1]) - chord_m).abs() < ROUNDING_M);
            prop_assert!((chart.distance_m(a, b) - chart.squared_distance_m2(a, b).sqrt()).abs() < ROUNDING_M);
            prop_assert!((WALL.distance_m(points[0], points[1]) - chart.distance_m(a, b)).abs() < ROUNDING_M);
            let [x, y] = WALL.chart(points[0], points[1]);
            prop_assert!((x.abs() - there[0].abs()).abs() < ROUNDING_M && y == there[1]);
            prop_assert!(distance(chart.walk(points[0], there), points[1]) < ROUNDING_M);
        }
    }

    #[test]
    fn places_near_the_seam_have_copies_beyond_it() {
        let chart = Chart::of(&WALL).with_seam(0.3);
        let low_m = 0.05 * 0.3;
        let copies = |from_seam_m: f64| chart.copies_within([low_m + from_seam_m, 0.1], 0.004).count();
        assert_eq!([copies(0.003), copies(0.005), copies(PERIOD_M - 0.003)], [2, 1, 2]);
        assert!(chart.copies_within([low_m + 0.003, 0.1], 0.004).any(|[x, _]| x > low_m + PERIOD_M));
        assert_eq!(Chart::new(Shape::Plane).copies_within([7.0, 8.0], 0.0).collect::<Vec<_>>(), [[7.0, 8.0]]);
    }

    #[test]
    fn depths_and_nearest_places_are_those_of_the_shape() {
        let rectangle = Chart::new(Shape::Rectangle { width_m: 0.2, height_m: 0.1 });
        let disk = Chart::new(Shape::Disk { radius_m: 0.05 });
        assert_eq!(rectangle.nearest([0.3, -0.1]), [0.2, 0.0]);
        assert!((disk.depth_m([0.03, 0.04])).abs() < 1e-17 && disk.depth_m([0.06, 0.0]) < 0.0);
        assert!(disk.depth_m(disk.nearest([0.3, 0.4])).abs() < 1e-17);
        assert_eq!(Chart::of(&WALL).nearest([1.0, 0.4]), [1.0, 0.3]);
        assert!((disk.area_m2() / (PI * 0.0025) - 1.0).abs() < 1e-15 && disk.size_m() == [0.1; 2]);
    }
}
