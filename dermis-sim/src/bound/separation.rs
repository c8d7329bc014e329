//! The distance at which two presses are told from one.

use super::precision::Precision;
use super::{Bounds, LOG_RADIUS_SD, LOG_STEP, PARAMETERS, STEP_M, difference, equations, smallest};
use crate::elementary::{erf, exp};
use crate::twin::{Press, TwinError};
use dermis::estimate::least_squares::{Control, LeastSquares, Normal, Steps, minimise};
use dermis::geom::Point3;
use dermis::linalg::{NotPositiveDefinite, dot};
use dermis::stats::bisect;
use std::f64::consts::{FRAC_PI_2, PI, SQRT_2};

/// Two presses are told from one in this share of the cases...
const POWER: f64 = 0.9;
/// ... and one is taken for two in this share.
const FALSE_SPLITS: f64 = 0.01;
/// Distances between which the smallest is sought, m.
const DISTANCES_M: [f64; 2] = [0.001, 0.2];
/// Relative accuracy of the distance.
const ACCURACY: f64 = 0.02;
/// The misfit of small distances grows with this power of theirs.
const POWER_OF_DISTANCE: f64 = 4.0;
/// The steps of the fit of one press. A step whose parts are a nanometre and a billionth of the force is none.
const STEPS: Steps = Steps {
    most: 40,
    control: Control::Damping { first: 1e-3, down: 0.1, up: 10.0 },
    shortest: 1e-9,
    least_decrease: 1e-3,
};

impl Bounds {
    /// The probability that two presses are told from one, if one press is taken for two in 1 % of the cases.
    ///
    /// The generalised likelihood ratio (Kay, Detection Theory, 1998, section 6.5) compares two presses with one of any
    /// place, force and tip radius. The second press adds three parameters, its place and its force, so twice the
    /// logarithm of the ratio has a chi-square distribution with three degrees of freedom; its noncentrality is the misfit
    /// of the best single press.
    ///
    /// # Errors
    /// Presses that the twin cannot simulate; a body without a chart.
    pub fn told_apart(&self, pair: &[Press; 2]) -> crate::Result<f64> {
        Ok(1.0 - noncentral_chi_square_3(threshold(), self.misfit_of_one(pair, 0.0)?))
    }

    /// The smallest distance at which two equal presses are told from one in 90 % of the cases; `None` if 200 mm is not
    /// enough, or if no such presses lie on the skin.
    ///
    /// # Errors
    /// As [`told_apart`](Self::told_apart).
    pub fn separation_m(&self, place_m: Point3, direction_rad: f64) -> crate::Result<Option<f64>> {
        self.separation_up_to(place_m, direction_rad, DISTANCES_M[1])
    }

    /// The same, `None` if it is above a distance.
    fn separation_up_to(&self, place_m: Point3, direction_rad: f64, most_m: f64) -> crate::Result<Option<f64>> {
        let needed = needed_misfit();
        let [low, mut high] = [DISTANCES_M[0], most_m];
        let misfit = |distance_m: f64| self.misfit_of_one(&self.pair(place_m, distance_m, direction_rad), needed);
        while high > low && self.clean(&self.pair(place_m, high, direction_rad)).is_err() {
            high *= 0.8;
        }
        if high <= low {
            return Ok(None);
        }
        smallest([low, high], needed, POWER_OF_DISTANCE, ACCURACY, misfit)
    }

    /// The smallest distances in two perpendicular directions; `most_m` are distances that are enough, where they are known.
    ///
    /// # Errors
    /// As [`told_apart`](Self::told_apart).
    pub(super) fn separations_m(&self, place_m: Point3, most_m: [Option<f64>; 2]) -> crate::Result<[Option<f64>; 2]> {
        let of = |axis: usize| {
            let most_m = most_m[axis].unwrap_or(DISTANCES_M[1]);
            self.separation_up_to(place_m, [0.0, FRAC_PI_2][axis], most_m)
        };
        Ok([of(0)?, of(1)?])
    }

    /// Two presses of the options' force at a distance, symmetric about a place.
    fn pair(&self, place_m: Point3, distance_m: f64, direction_rad: f64) -> [Press; 2] {
        let half = [0.5 * distance_m * direction_rad.cos(), 0.5 * distance_m * direction_rad.sin()];
        [half, half.map(|step| -step)].map(|step| self.press(self.surface().walk(place_m, step)))
    }

    /// The squared distance of the frame of two presses from that of the best single one, in units of the noise. The search
    /// ends where it is below `enough`.
    fn misfit_of_one(&self, pair: &[Press; 2], enough: f64) -> crate::Result<f64> {
        if !self.has_chart() {
            return Err(TwinError::NoChart.into());
        }
        let target = self.clean(pair)?;
        let precision = self.with_unknown_phase(pair, &target)?;
        let fit = SingleFit { bounds: self, precision, target: target.0, enough };
        // From the centre of force, and from each of them: one press may hide the other.
        let [a, b] = pair;
        let force_n = a.force_n + b.force_n;
        let step = self.surface().chart(a.centre_m, b.centre_m).map(|step| step * b.force_n / force_n);
        let both = Press { centre_m: self.surface().walk(a.centre_m, step), force_n, ..*a };
        let mut least = f64::INFINITY;
        for start in [both, *a, *b] {
            if least >= enough {
                least = least.min(fit.least_misfit(start));
            }
        }
        Ok(least)
    }
}

/// The fit of one press to a frame.
struct SingleFit<'a> {
    bounds: &'a Bounds,
    precision: Precision,
    target: Vec<f64>,
    /// The misfit below which the fit ends.
    enough: f64,
}

/// A press and its misfit: squared and in units of the noise, with the tip radius as one more reading.
struct Candidate {
    press: Press,
    misfit: f64,
    residuals: Vec<f64>,
}

impl SingleFit<'_> {
    /// The smallest misfit from a start; infinite if the skin does not bear the start.
    fn least_misfit(&self, start: Press) -> f64 {
        let Some(start) = self.candidate(start) else { return f64::INFINITY };
        minimise(self, start, &STEPS).map_or(f64::INFINITY, |found| found.point.misfit)
    }

    /// The misfit of a press; `None` if the skin does not bear it.
    fn candidate(&self, press: Press) -> Option<Candidate> {
        let frame = self.bounds.clean(&[press]).ok()?;
        let residuals = self.precision.whiten(difference(&self.target, &frame));
        let misfit = dot(&residuals, &residuals) + (self.log_radius(&press) / LOG_RADIUS_SD).powi(2);
        Some(Candidate { press, misfit, residuals })
    }

    /// The change of the frame by each parameter, as one-sided quotients: they set the way to the minimum, not the minimum.
    fn derivatives(&self, at: &Candidate, normal: Point3) -> crate::Result<[Vec<f64>; PARAMETERS]> {
        let column = |[moved, _]: [Press; 2], step: f64| -> crate::Result<Vec<f64>> {
            let residuals = self.precision.whiten(difference(&self.target, &self.bounds.clean(&[moved])?));
            Ok(at.residuals.iter().zip(&residuals).map(|(here, there)| (here - there) / step).collect())
        };
        let [around, along, force, radius] = self.bounds.steps(&at.press, normal);
        Ok([column(around, STEP_M)?, column(along, STEP_M)?, column(force, LOG_STEP)?, column(radius, LOG_STEP)?])
    }

    fn log_radius(&self, press: &Press) -> f64 {
        (press.tip_radius_m / self.bounds.options.tip_radius_m).ln()
    }
}

impl LeastSquares for SingleFit<'_> {
    type Point = Candidate;
    type Equations = Normal;
    type Error = NotPositiveDefinite;

    fn cost(&self, point: &Candidate) -> f64 {
        point.misfit
    }

    /// Where the place has no derivatives, at an edge, or no effect, the press stays where it is.
    fn equations(&self, at: &Candidate) -> Result<Normal, NotPositiveDefinite> {
        let normal = self.bounds.surface().normal(at.press.centre_m);
        let columns = normal.and_then(|normal| self.derivatives(at, normal).ok());
        let found = columns.map(|columns| equations(&columns, &at.residuals, self.log_radius(&at.press)));
        let still = || Normal::new(&[&[][..]; PARAMETERS], &[]).with_unit_priors(&[0.0; PARAMETERS]);
        Ok(found.filter(|found| found.factor().is_ok()).unwrap_or_else(still))
    }

    /// Force and tip radius change by at most a factor of e.
    fn limit(&self, _: &Candidate, step: &mut [f64]) {
        step[2..].iter_mut().for_each(|part| *part = part.clamp(-1.0, 1.0));
    }

    fn moved(&self, Candidate { press, .. }: &Candidate, step: &[f64]) -> Option<Candidate> {
        self.candidate(Press {
            centre_m: self.bounds.surface().walk(press.centre_m, [step[0], step[1]]),
            force_n: press.force_n * exp(step[2]),
            tip_radius_m: press.tip_radius_m * exp(step[3]),
        })
    }

    fn is_enough(&self, point: &Candidate, _: usize) -> bool {
        point.misfit < self.enough
    }
}

/// The value that the test exceeds for one press in 1 % of the cases.
fn threshold() -> f64 {
    bisect([0.0, 100.0], 100, |value| noncentral_chi_square_3(value, 0.0) > 1.0 - FALSE_SPLITS)
}

/// The misfit that exceeds the threshold in 90 % of the cases.
fn needed_misfit() -> f64 {
    let threshold = threshold();
    bisect([0.0, 1000.0], 100, |misfit| noncentral_chi_square_3(threshold, misfit) < 1.0 - POWER)
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
