//! The distance at which two presses are told from one.

use super::precision::Whitened;
use super::{Bounds, LOG_RADIUS_SD};
use crate::elementary::{erf, exp};
use crate::twin::Press;
use dermis::geom::Point3;
use dermis::linalg::{Matrix, invert_spd};
use std::f64::consts::{PI, SQRT_2};

/// Two presses are told from one in this share of the cases...
const POWER: f64 = 0.9;
/// ... and one is taken for two in this share.
const FALSE_SPLITS: f64 = 0.01;
/// Distances between which the smallest is sought, m.
const DISTANCES_M: [f64; 2] = [0.002, 0.2];
/// Absolute accuracy of the distance, m.
const ACCURACY_M: f64 = 5e-4;
/// Most steps of the fit of one press, and the relative decrease at which it ends.
const STEPS: usize = 20;
const LEAST_DECREASE: f64 = 1e-3;

/// Parameters of one press: two of its place, the logarithms of its force and of its tip radius.
const PARAMETERS: usize = 4;

impl Bounds {
    /// The probability that two equal presses at a distance, symmetric about a place, are told from one, if one press is
    /// taken for two in 1 % of the cases.
    ///
    /// The generalised likelihood ratio (Kay, Detection Theory, 1998, section 6.5) compares two presses with one of any
    /// place, force and tip radius. The second press adds three parameters, its place and its force, so twice the
    /// logarithm of the ratio has a chi-square distribution with three degrees of freedom; its noncentrality is the misfit
    /// of the best single press.
    ///
    /// # Errors
    /// Presses that the twin cannot simulate; a body without a chart.
    pub fn resolved(&self, place_m: Point3, normal: Point3, distance_m: f64, direction_rad: f64) -> crate::Result<f64> {
        let misfit = self.misfit_of_one(place_m, normal, distance_m, direction_rad)?;
        Ok(1.0 - noncentral_chi_square_3(threshold(), misfit))
    }

    /// The smallest distance at which two equal presses are told from one in 90 % of the cases; `None` if 200 mm is not
    /// enough, or if no such presses lie on the skin.
    ///
    /// # Errors
    /// As [`resolved`](Self::resolved).
    pub fn separation_m(&self, place_m: Point3, normal: Point3, direction_rad: f64) -> crate::Result<Option<f64>> {
        let needed = needed_misfit();
        let [mut low, mut high] = DISTANCES_M;
        let is_resolved = |distance_m: f64| -> crate::Result<bool> {
            Ok(self.misfit_of_one(place_m, normal, distance_m, direction_rad)? >= needed)
        };
        while high > low && self.twin.clean(&self.pair(place_m, normal, high, direction_rad)).is_err() {
            high *= 0.8;
        }
        if high <= low || !is_resolved(high)? {
            return Ok(None);
        }
        while high > low + ACCURACY_M {
            let middle = 0.5 * (low + high);
            if is_resolved(middle)? { high = middle } else { low = middle }
        }
        Ok(Some(high))
    }

    fn pair(&self, place_m: Point3, normal: Point3, distance_m: f64, direction_rad: f64) -> [Press; 2] {
        let half = [0.5 * distance_m * direction_rad.cos(), 0.5 * distance_m * direction_rad.sin()];
        [half, half.map(|step| -step)].map(|step| self.press(self.moved(place_m, normal, step)))
    }

    /// The squared distance of the frame of two presses from that of the best single one, in units of the noise.
    fn misfit_of_one(
        &self,
        place_m: Point3,
        normal: Point3,
        distance_m: f64,
        direction_rad: f64,
    ) -> crate::Result<f64> {
        let pair = self.pair(place_m, normal, distance_m, direction_rad);
        let target = self.twin.clean(&pair)?.0;
        // From between both, and from each of them: one press may hide the other.
        let both = Press { force_n: 2.0 * self.options.force_n, ..self.press(place_m) };
        let starts = [both, pair[0], pair[1]];
        let fits = starts.into_iter().filter_map(|start| self.fit_one(&target, start, normal).transpose());
        let misfits = fits.collect::<crate::Result<Vec<f64>>>()?;
        Ok(misfits.into_iter().fold(f64::INFINITY, f64::min))
    }

    /// The smallest misfit of one press from a start, by Gauss-Newton steps with damping (Levenberg and Marquardt); `None`
    /// if the skin does not bear the start.
    fn fit_one(&self, target: &[f64], start: Press, normal: Point3) -> crate::Result<Option<f64>> {
        let misfit = |press: &Press| -> Option<(f64, Whitened)> {
            let frame = self.twin.clean(&[*press]).ok()?;
            let rest = self.precision.whiten(target.iter().zip(frame.iter()).map(|(a, b)| a - b).collect());
            let log_radius = (press.tip_radius_m / self.options.tip_radius_m).ln() / LOG_RADIUS_SD;
            Some((self.precision.inner(&rest, &rest) + log_radius * log_radius, rest))
        };
        let (mut press, mut damping) = (start, 1e-3);
        let Some((mut value, mut rest)) = misfit(&press) else { return Ok(None) };
        for _ in 0..STEPS {
            // A place at the edge has no differences.
            let Ok(columns) = self.derivatives(&press, normal) else { break };
            let log_radius = (press.tip_radius_m / self.options.tip_radius_m).ln();
            let mut slope: [f64; PARAMETERS] = std::array::from_fn(|i| self.precision.inner(&columns[i], &rest));
            slope[3] -= log_radius / LOG_RADIUS_SD.powi(2);
            let mut information = Matrix::zeros(PARAMETERS, PARAMETERS);
            for (i, a) in columns.iter().enumerate() {
                columns.iter().enumerate().for_each(|(j, b)| *information.at_mut(i, j) = self.precision.inner(a, b));
            }
            *information.at_mut(3, 3) += LOG_RADIUS_SD.powi(-2);
            let before = value;
            while damping < 1e9 {
                let mut damped = information.clone();
                (0..PARAMETERS).for_each(|i| *damped.at_mut(i, i) *= 1.0 + damping);
                let Ok(covariance) = invert_spd(&damped) else { break };
                let mut step = [0.0; PARAMETERS];
                covariance.product_into(&slope, &mut step);
                let tried = Press {
                    centre_m: self.moved(press.centre_m, normal, [step[0], step[1]]),
                    force_n: press.force_n * exp(step[2].clamp(-1.0, 1.0)),
                    tip_radius_m: press.tip_radius_m * exp(step[3].clamp(-1.0, 1.0)),
                };
                match misfit(&tried).filter(|(tried, _)| *tried < value) {
                    Some((lower, remaining)) => {
                        (press, value, rest, damping) = (tried, lower, remaining, damping * 0.1);
                        break;
                    }
                    None => damping *= 10.0,
                }
            }
            if value > (1.0 - LEAST_DECREASE) * before {
                break;
            }
        }
        Ok(Some(value))
    }
}

/// The value that the test exceeds for one press in 1 % of the cases.
fn threshold() -> f64 {
    bisect(0.0, 100.0, |value| noncentral_chi_square_3(value, 0.0) > 1.0 - FALSE_SPLITS)
}

/// The misfit that exceeds the threshold in 90 % of the cases.
fn needed_misfit() -> f64 {
    let threshold = threshold();
    bisect(0.0, 1000.0, |misfit| noncentral_chi_square_3(threshold, misfit) < 1.0 - POWER)
}

fn bisect(mut low: f64, mut high: f64, is_high: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if is_high(middle) { high = middle } else { low = middle }
    }
    high
}

/// The distribution function of the noncentral chi-square distribution with three degrees of freedom: the probability
/// that a point with a normal distribution in space, its mean at the distance `sqrt(noncentrality)`, is nearer to the
/// origin than `sqrt(value)`.
fn noncentral_chi_square_3(value: f64, noncentrality: f64) -> f64 {
    let (radius, mean) = (value.sqrt(), noncentrality.sqrt());
    let inside = 0.5 * (erf((radius - mean) / SQRT_2) + erf((radius + mean) / SQRT_2));
    let density = |at: f64| exp(-0.5 * at * at) / (2.0 * PI).sqrt();
    // The limit for a mean at the origin.
    if mean < 1e-6 {
        return inside - 2.0 * radius * density(radius);
    }
    inside - (density(radius - mean) - density(radius + mean)) / mean
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noncentral_chi_square_distribution_of_three_degrees() {
        // scipy.stats.chi2.ppf(0.99, 3) and ncx2.cdf(value, 3, noncentrality).
        assert!((threshold() - 11.344_866_730_144_373).abs() < 1e-9);
        let cases = [
            (threshold(), 5.0, 0.777_220_531_604_868_5),
            (threshold(), 17.4, 0.141_678_724_652_405_3),
            (2.0, 4.0, 0.111_254_374_579_325_74),
        ];
        for (value, noncentrality, probability) in cases {
            assert!((noncentral_chi_square_3(value, noncentrality) - probability).abs() < 1e-9, "{noncentrality}");
        }
    }
}
