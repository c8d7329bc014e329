//! The form of a touch: the density of its change of conductance along the surface.
//!
//! A touch is a capsule: a segment of half length `l`, smeared by a Gaussian of variance `v`. With `x` along
//! and `y` across the segment its density is
//!
//! `rho = N(y; v) (Phi((x + l) / sqrt v) - Phi((x - l) / sqrt v)) / (2 l)`,
//!
//! and its variances are `v + l^2 / 3` along and `v` across. The unknowns are chosen so that a round touch is no special
//! case: the logarithm of a width `w`, and a vector `q` whose angle is twice that of the segment (half a turn gives the same
//! touch) and whose length `r` gives `l^2 = r^2 + 2 r w_0`. With
//!
//! `v = w^2 - (l^2 / 6) / (1 + l^2 / (3 w^2))`
//!
//! the mean of both variances is `w^2` to first order in `r`, so that the density is smooth in `q` at zero. A long touch is
//! `w / sqrt 2` wide.

use crate::geom::Point2;
use std::f64::consts::{FRAC_2_SQRT_PI, PI, SQRT_2};

/// Below this half length over the width, the density is a Gaussian of the same variances; what is left out is a fourth
/// moment of 5e-5.
const ROUND: f64 = 0.3;
/// Standard deviations beyond which a touch is truncated: `exp(-8)`.
const REACH: f64 = 4.0;

/// A form as unknowns of a fit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Form {
    /// The logarithm of the width over the usual one.
    pub log_width: f64,
    /// The vector of the segment, m: its angle is twice that of the segment in the axes of the place.
    pub oblong_m: Point2,
}

/// The density of a form and its derivatives, in the axes of a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Density {
    /// Half length of the segment, m.
    pub half_length_m: f64,
    /// Variance across the segment, m2.
    pub variance_m2: f64,
    /// Cosine and sine of the angle of the segment.
    pub axis: Point2,
    /// Cosine and sine of twice that angle, and the length of the vector, m.
    double: Point2,
    radius_m: f64,
    usual_m: f64,
    square_width_m2: f64,
}

impl Form {
    /// The form of a segment.
    pub(super) fn of_segment(half: Point2, usual_m: f64) -> Self {
        let length = half[0].hypot(half[1]);
        let radius = length.hypot(usual_m) - usual_m;
        let angle = 2.0 * half[1].atan2(half[0]);
        Form { log_width: 0.0, oblong_m: [radius * angle.cos(), radius * angle.sin()] }
    }

    /// The same form in axes that are turned by an angle, given by its cosine and sine.
    pub(super) fn turned(self, [cosine, sine]: Point2) -> Self {
        let (c, s) = (cosine * cosine - sine * sine, 2.0 * sine * cosine);
        let [x, y] = self.oblong_m;
        Form { oblong_m: [c * x + s * y, c * y - s * x], ..self }
    }
}

impl Density {
    /// The density of a form; `usual_m` is the width `w_0`.
    pub(super) fn new(form: &Form, usual_m: f64) -> Self {
        let [x, y] = form.oblong_m;
        let radius_m = x.hypot(y);
        let double = if radius_m > 0.0 { [x / radius_m, y / radius_m] } else { [1.0, 0.0] };
        let angle = 0.5 * double[1].atan2(double[0]);
        let square_width_m2 = usual_m * usual_m * (2.0 * form.log_width).exp();
        let square_length = radius_m * (radius_m + 2.0 * usual_m);
        Density {
            half_length_m: square_length.sqrt(),
            variance_m2: square_width_m2 * (1.0 - 0.5 * square_length / (3.0 * square_width_m2 + square_length)),
            axis: [angle.cos(), angle.sin()],
            double,
            radius_m,
            usual_m,
            square_width_m2,
        }
    }

    /// Distance from the centre beyond which the density is left out, m.
    pub(super) fn reach_m(&self) -> f64 {
        self.half_length_m + REACH * self.variance_m2.sqrt()
    }

    /// The place of a point in the axes of the segment.
    fn local(&self, [x, y]: Point2) -> Point2 {
        let [c, s] = self.axis;
        [c * x + s * y, c * y - s * x]
    }

    /// Whether a point is within reach of the segment.
    #[inline]
    pub(super) fn reaches(&self, offset: Point2) -> bool {
        let [x, y] = self.local(offset);
        let beyond = (x.abs() - self.half_length_m).max(0.0);
        beyond * beyond + y * y <= REACH * REACH * self.variance_m2
    }

    /// The density at an offset from the centre, 1/m2, and its derivatives by the centre (1/m3), by the logarithm of the
    /// width and by the vector of the segment (1/m3).
    pub(super) fn at(&self, offset: Point2) -> [f64; 6] {
        let ([x, y], v, l) = (self.local(offset), self.variance_m2, self.half_length_m);
        let across = (-0.5 * y * y / v).exp() / (2.0 * PI * v).sqrt();
        let square = l * l;
        // The density, its derivatives by x twice, by l^2, and by the double angle over the radius.
        let (rho, by_x, by_xx, by_square, by_turn);
        if l < ROUND * v.sqrt() {
            let u = v + square / 3.0;
            rho = across * (-0.5 * x * x / u).exp() / (2.0 * PI * u).sqrt();
            by_x = -x / u * rho;
            by_xx = (x * x / u - 1.0) / u * rho;
            by_square = by_xx / 6.0;
            by_turn = 0.5 * x * y * rho * (self.radius_m + 2.0 * self.usual_m) / (3.0 * u * v);
        } else {
            let sd = v.sqrt();
            let ends = [x + l, x - l].map(|end| end / sd);
            let [high, low] = ends.map(gaussian_and_integral);
            rho = across * (high.1 - low.1) / (2.0 * l);
            by_x = across * (high.0 - low.0) / (2.0 * l * sd);
            by_xx = across * (ends[1] * low.0 - ends[0] * high.0) / (2.0 * l * v);
            by_square = (across * (high.0 + low.0) / (2.0 * l * sd) - rho / l) / (2.0 * l);
            by_turn = 0.5 * (y * by_x + x * y / v * rho) / self.radius_m;
        }
        let by_y = -y / v * rho;
        let by_variance = 0.5 * (by_xx + (y * y / v - 1.0) / v * rho);
        let w2 = self.square_width_m2;
        let sum = 3.0 * w2 + square;
        let by_square = by_square - by_variance * 1.5 * w2 * w2 / (sum * sum);
        let by_radius = by_square * 2.0 * (self.radius_m + self.usual_m);
        let by_log_width = by_variance * (1.0 - 0.5 * square * square / (sum * sum)) * 2.0 * w2;
        let ([c, s], [c2, s2]) = (self.axis, self.double);
        [
            rho,
            // The centre moves against the offset.
            -(c * by_x - s * by_y),
            -(s * by_x + c * by_y),
            by_log_width,
            c2 * by_radius - s2 * by_turn,
            s2 * by_radius + c2 * by_turn,
        ]
    }

    /// Half the sides of a uniform rectangle with the same variances, along and across the segment, m.
    pub(super) fn half_extents_m(&self) -> Point2 {
        let square_length = self.half_length_m * self.half_length_m;
        [3.0 * self.variance_m2 + square_length, 3.0 * self.variance_m2].map(f64::sqrt)
    }
}

/// The standard normal density and its integral (Abramowitz and Stegun, 1964, 7.1.26, absolute error below 1e-7).
#[inline]
fn gaussian_and_integral(z: f64) -> (f64, f64) {
    let x = z.abs() / SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let terms = [0.254_829_592, -0.284_496_736, 1.421_413_741, -1.453_152_027, 1.061_405_429];
    let sum = terms.iter().rev().fold(0.0, |sum, term| (sum + term) * t);
    let exponential = (-x * x).exp();
    let tail = 0.5 * sum * exponential;
    let density = exponential * FRAC_2_SQRT_PI / (2.0 * SQRT_2);
    (density, if z > 0.0 { 1.0 - tail } else { tail })
}

#[cfg(test)]
mod tests {
    use super::*;

    const USUAL_M: f64 = 4.5e-3;

    fn forms() -> [Form; 5] {
        [
            Form::default(),
            Form { log_width: 0.2, oblong_m: [1e-4, -2e-5] },
            Form { log_width: -0.1, oblong_m: [1e-3, 2e-3] },
            Form { log_width: 0.0, oblong_m: [-9e-3, 4e-3] },
            Form { log_width: 0.3, oblong_m: [2e-3, -18e-3] },
        ]
    }

    /// Over a fine grid the density has the integral 1 and the variances of a capsule.
    #[test]
    fn the_density_has_the_moments_of_a_capsule() {
        for form in forms() {
            let density = Density::new(&form, USUAL_M);
            let (step, count) = (2e-4, 320);
            let (mut sum, mut squares, mut product) = (0.0, [0.0; 2], 0.0);
            for k in 0..(2 * count + 1) * (2 * count + 1) {
                let at =
                    [k % (2 * count + 1), k / (2 * count + 1)].map(|i| step * (i as f64 - f64::from(count as u32)));
                let [x, y] = density.local(at);
                let part = density.at(at)[0] * step * step;
                sum += part;
                squares[0] += part * x * x;
                squares[1] += part * y * y;
                product += part * x * y;
            }
            let (l, v) = (density.half_length_m, density.variance_m2);
            assert!((sum - 1.0).abs() < 1e-5, "{form:?}: {sum}");
            assert!((squares[0] / (v + l * l / 3.0) - 1.0).abs() < 1e-4, "{form:?}: {squares:?}");
            assert!((squares[1] / v - 1.0).abs() < 1e-4 && product.abs() < 1e-3 * v, "{form:?}: {squares:?} {product}");
        }
    }

    #[test]
    fn the_derivatives_are_those_of_differences() {
        for form in forms() {
            for offset in [[1e-3, -2e-3], [-6e-3, 5e-3], [0.0, 9e-3]] {
                let at = |unknown: usize, by: f64| {
                    let mut moved = (form, offset);
                    match unknown {
                        0 | 1 => moved.1[unknown] -= by,
                        2 => moved.0.log_width += by,
                        _ => moved.0.oblong_m[unknown - 3] += by,
                    }
                    Density::new(&moved.0, USUAL_M).at(moved.1)[0]
                };
                let found = Density::new(&form, USUAL_M).at(offset);
                for (unknown, derivative) in found[1..].iter().enumerate() {
                    // Small steps would show the error of the integral of the Gaussian.
                    let step = if unknown == 2 { 1e-3 } else { 1e-5 };
                    let expected = (at(unknown, step) - at(unknown, -step)) / (2.0 * step);
                    let scale = found[0] / if unknown == 2 { 1.0 } else { USUAL_M };
                    assert!(
                        (derivative - expected).abs() < 5e-3 * scale,
                        "{form:?} {unknown}: {derivative} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_segment_is_found_again_in_turned_axes() {
        let density = Density::new(&Form::of_segment([0.012, 0.016], USUAL_M), USUAL_M);
        assert!((density.half_length_m - 0.02).abs() < 1e-12);
        assert!((density.axis[0] - 0.6).abs() < 1e-12 && (density.axis[1] - 0.8).abs() < 1e-12);
        let turned = Density::new(&Form::of_segment([0.012, 0.016], USUAL_M).turned([0.6, 0.8]), USUAL_M);
        assert!((turned.axis[0] - 1.0).abs() < 1e-12 && turned.axis[1].abs() < 1e-12);
        let [along, across] = density.half_extents_m();
        assert!((along / 0.02 - 1.0).abs() < 0.05 && across < 7e-3, "{along} {across}");
    }
}
