//! Registration of a flat skin with a robot's frame.

use crate::evaluate::EvaluateError;
use dermis::geom::Point2;
use dermis::geom::vector::Point3;
use serde::Serialize;

/// The pose of a flat skin in the x-y plane of a robot's frame, and the scale of its estimates:
/// `p = centre + scale R(rotation) M e`, where M reverses y if the skin is mirrored.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Alignment {
    /// The skin's origin in the robot's frame, m.
    pub centre_m: Point2,
    /// Angle from the robot's x to the skin's x, from -pi to pi.
    pub rotation_rad: f64,
    /// Whether the skin's y axis is reversed (its handedness).
    pub mirrored: bool,
    /// Scale factor of the estimates.
    pub scale: f64,
    /// Mean distance of the presses used for the fit, m.
    pub residual_m: f64,
}

/// Iterations of reweighting; after about twenty the mean distance changes by less than a micrometre.
const ROUNDS: usize = 40;
/// Distances below this have equal weights: far below the resolution of any skin, m.
const SMALLEST_DISTANCE_M: f64 = 1e-4;

/// Complex numbers represent points of the plane.
type Complex = [f64; 2];

fn times(a: Complex, b: Complex) -> Complex {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

impl Alignment {
    /// The alignment of the smallest mean distance between estimates and presses.
    ///
    /// The mean distance is used instead of its square, so that single presses with large errors do not affect the
    /// alignment: iteratively reweighted least squares with weights of one over the distance (Weiszfeld 1937), for each
    /// handedness.
    ///
    /// # Errors
    /// Fewer than three different presses (two do not determine the handedness), estimates that are all at one
    /// position.
    ///
    /// # Panics
    /// If the numbers of estimates and presses differ.
    pub fn fit(estimates: &[Point2], presses: &[Point2]) -> Result<Self, EvaluateError> {
        assert_eq!(estimates.len(), presses.len(), "an estimate for each press");
        let mut places: Vec<[u64; 2]> = presses.iter().map(|press| press.map(f64::to_bits)).collect();
        places.sort_unstable();
        places.dedup();
        if places.len() < 3 {
            return Err(EvaluateError::TooFewPresses { presses: presses.len(), places: places.len() });
        }
        let straight = Self::fit_handed(estimates, presses, false)?;
        let mirrored = Self::fit_handed(estimates, presses, true)?;
        Ok(if mirrored.residual_m < straight.residual_m { mirrored } else { straight })
    }

    fn fit_handed(estimates: &[Point2], presses: &[Point2], mirrored: bool) -> Result<Self, EvaluateError> {
        let seen: Vec<Complex> = estimates.iter().map(|&[x, y]| [x, if mirrored { -y } else { y }]).collect();
        let mut weights = vec![1.0; seen.len()];
        let mut best: Option<Self> = None;
        for _ in 0..ROUNDS {
            let (factor, centre_m) = least_squares(&seen, presses, &weights).ok_or(EvaluateError::NoScale)?;
            let scale = factor[0].hypot(factor[1]);
            let rotation_rad = factor[1].atan2(factor[0]);
            let mut fitted = Alignment { centre_m, rotation_rad, mirrored, scale, residual_m: 0.0 };
            let distances: Vec<f64> =
                estimates.iter().zip(presses).map(|(&e, &p)| distance(fitted.apply(e), p)).collect();
            fitted.residual_m = distances.iter().sum::<f64>() / distances.len() as f64;
            if best.is_none_or(|best| fitted.residual_m < best.residual_m) {
                best = Some(fitted);
            }
            weights = distances.iter().map(|distance| 1.0 / distance.max(SMALLEST_DISTANCE_M)).collect();
        }
        best.ok_or(EvaluateError::NoScale)
    }

    /// A position on the skin, in the robot's frame.
    pub fn apply(&self, estimate: Point2) -> Point2 {
        let seen = [estimate[0], if self.mirrored { -estimate[1] } else { estimate[1] }];
        let turned = times([self.scale * self.rotation_rad.cos(), self.scale * self.rotation_rad.sin()], seen);
        [self.centre_m[0] + turned[0], self.centre_m[1] + turned[1]]
    }

    /// The same for a point in space, at z = 0.
    pub(super) fn apply_to_point(&self, point: Point3) -> Point3 {
        let [x, y] = self.apply([point[0], point[1]]);
        [x, y, 0.0]
    }
}

/// The distance of two points of the plane.
pub(super) fn distance(a: Point2, b: Point2) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The complex factor f and the offset c that minimise `sum w |p - c - f e|^2`; `None` if all estimates are one point.
fn least_squares(estimates: &[Complex], presses: &[Complex], weights: &[f64]) -> Option<(Complex, Complex)> {
    let total: f64 = weights.iter().sum();
    let mean = |points: &[Complex]| {
        let sum = points.iter().zip(weights).fold([0.0; 2], |sum, (p, w)| [sum[0] + w * p[0], sum[1] + w * p[1]]);
        [sum[0] / total, sum[1] / total]
    };
    let (middle, target) = (mean(estimates), mean(presses));
    let (mut cross, mut square) = ([0.0; 2], 0.0);
    for ((e, p), w) in estimates.iter().zip(presses).zip(weights) {
        let e = [e[0] - middle[0], e[1] - middle[1]];
        let product = times([e[0], -e[1]], [p[0] - target[0], p[1] - target[1]]);
        cross = [cross[0] + w * product[0], cross[1] + w * product[1]];
        square += w * (e[0] * e[0] + e[1] * e[1]);
    }
    if square <= 1e-24 * total {
        return None;
    }
    let factor = [cross[0] / square, cross[1] / square];
    let moved = times(factor, middle);
    Some((factor, [target[0] - moved[0], target[1] - moved[1]]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places() -> Vec<Point2> {
        (0..30).map(|k| [0.03 * (1.3 * k as f64).cos(), 0.02 * (2.1 * k as f64).sin()]).collect()
    }

    #[test]
    fn a_known_placement_is_found_in_spite_of_wild_estimates() {
        for mirrored in [false, true] {
            let centre_m = [0.4, -0.2];
            let truth = Alignment { centre_m, rotation_rad: 2.5, mirrored, scale: 1.3, residual_m: 0.0 };
            let presses: Vec<Point2> = places().into_iter().map(|place| truth.apply(place)).collect();
            let mut estimates = places();
            // A fifth of the estimates is random.
            for k in (0..30).step_by(5) {
                estimates[k] = [-estimates[k][1], 0.03];
            }
            let found = Alignment::fit(&estimates, &presses).unwrap();
            assert_eq!(found.mirrored, mirrored);
            assert!(distance(found.centre_m, centre_m) < 1e-4, "{found:?}");
            assert!((found.rotation_rad - 2.5).abs() < 2e-3 && (found.scale - 1.3).abs() < 3e-3, "{found:?}");
        }
    }

    #[test]
    fn too_little_to_align_by_is_an_error() {
        let presses = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.0]];
        assert_eq!(
            Alignment::fit(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], &presses),
            Err(EvaluateError::TooFewPresses { presses: 3, places: 2 })
        );
        let presses = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.2]];
        assert_eq!(Alignment::fit(&[[1.0, 1.0]; 3], &presses), Err(EvaluateError::NoScale));
    }
}
