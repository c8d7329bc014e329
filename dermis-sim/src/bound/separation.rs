//! The distance at which two presses are told from one.

use super::precision::Precision;
use super::{Bounds, LOG_RADIUS, LOG_RADIUS_SD, LOG_STEP, PARAMETERS, STEP_M, difference, equations, smallest};
use crate::elementary::{erf, exp};
use crate::twin::{Press, TwinError};
use dermis::estimate::least_squares::{Control, LeastSquares, Normal, Steps, minimise};
use dermis::geom::{Point2, Point3};
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
/// A press of unknown form is a row of this many equal ones, between which the pressure hardly falls.
const ROW: u32 = 7;
/// The row's half length where the fit begins, as a share of that of the pair: a row has the variance of the pair at 1.5.
const FIRST_LENGTHS: [f64; 2] = [1.2, 0.1];
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
    /// of the best single press. A single press of any form is a row of presses of any length and direction, which are two
    /// more parameters: one degree of freedom is left.
    ///
    /// # Errors
    /// Presses that the twin cannot simulate; a body without a chart.
    pub fn told_apart(&self, pair: &[Press; 2]) -> crate::Result<f64> {
        let freedom = self.freedom();
        Ok(1.0 - freedom.distribution(freedom.threshold(), self.misfit_of_one(pair, 0.0)?))
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
        let needed = self.freedom().needed_misfit();
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
        let apart = self.surface().chart(a.centre_m, b.centre_m);
        let step = apart.map(|step| step * b.force_n / force_n);
        let both = Press { centre_m: self.surface().walk(a.centre_m, step), force_n, ..*a };
        let lengths = if self.options.known_form { &[0.0][..] } else { &FIRST_LENGTHS };
        let mut least = f64::INFINITY;
        for press in [both, *a, *b] {
            for length in lengths {
                let half_m = apart.map(|step| 0.5 * length * step);
                if least >= enough {
                    least = least.min(fit.least_misfit(One { press, half_m }));
                }
            }
        }
        Ok(least)
    }

    fn freedom(&self) -> Freedom {
        if self.options.known_form { Freedom::Three } else { Freedom::One }
    }
}

/// One object: a press, or a row of presses.
#[derive(Debug, Clone, Copy, PartialEq)]
struct One {
    /// All of its force, at its middle.
    press: Press,
    /// From the middle to the end of the row, along the surface, m.
    half_m: Point2,
}

/// The fit of one press to a frame.
struct SingleFit<'a> {
    bounds: &'a Bounds,
    precision: Precision,
    target: Vec<f64>,
    /// The misfit below which the fit ends.
    enough: f64,
}

/// An object and its misfit: squared and in units of the noise, with the tip radius as one more reading.
struct Candidate {
    one: One,
    misfit: f64,
    residuals: Vec<f64>,
}

impl SingleFit<'_> {
    /// The smallest misfit from a start; infinite if the skin does not bear the start.
    fn least_misfit(&self, start: One) -> f64 {
        let Some(start) = self.candidate(start) else { return f64::INFINITY };
        minimise(self, start, &STEPS).map_or(f64::INFINITY, |found| found.point.misfit)
    }

    /// The misfit of an object; `None` if the skin does not bear it.
    fn candidate(&self, one: One) -> Option<Candidate> {
        let residuals = self.residuals(&one).ok()?;
        let misfit = dot(&residuals, &residuals) + (self.log_radius(&one.press) / LOG_RADIUS_SD).powi(2);
        Some(Candidate { one, misfit, residuals })
    }

    /// What an object leaves of the frame, whitened.
    fn residuals(&self, one: &One) -> crate::Result<Vec<f64>> {
        Ok(self.precision.whiten(difference(&self.target, &self.bounds.clean(&self.presses(one))?)))
    }

    fn presses(&self, one: &One) -> Vec<Press> {
        if self.bounds.options.known_form {
            return vec![one.press];
        }
        let at = |index: u32| {
            let part = 2.0 * f64::from(index) / f64::from(ROW - 1) - 1.0;
            let centre_m = self.bounds.surface().walk(one.press.centre_m, one.half_m.map(|half| part * half));
            Press { centre_m, force_n: one.press.force_n / f64::from(ROW), ..one.press }
        };
        (0..ROW).map(at).collect()
    }

    /// The steps of the parameters: those of a press, and of the row's end.
    fn steps(&self) -> &[f64] {
        let steps = &[STEP_M, STEP_M, LOG_STEP, LOG_STEP, STEP_M, STEP_M];
        if self.bounds.options.known_form { &steps[..PARAMETERS] } else { steps }
    }

    /// The change of the frame by each parameter, as one-sided quotients: they set the way to the minimum, not the minimum.
    fn derivatives(&self, at: &Candidate) -> crate::Result<Vec<Vec<f64>>> {
        let column = |(index, size): (usize, &f64)| -> crate::Result<Vec<f64>> {
            let mut step = [0.0; PARAMETERS + 2];
            step[index] = *size;
            let residuals = self.residuals(&self.stepped(&at.one, &step))?;
            Ok(at.residuals.iter().zip(&residuals).map(|(here, there)| (here - there) / size).collect())
        };
        self.steps().iter().enumerate().map(column).collect()
    }

    /// An object after a step of its parameters.
    fn stepped(&self, One { press, half_m }: &One, step: &[f64]) -> One {
        let along = |axis: usize| step.get(PARAMETERS + axis).copied().unwrap_or(0.0);
        One {
            press: Press {
                centre_m: self.bounds.surface().walk(press.centre_m, [step[0], step[1]]),
                force_n: press.force_n * exp(step[2]),
                tip_radius_m: press.tip_radius_m * exp(step[LOG_RADIUS]),
            },
            half_m: [half_m[0] + along(0), half_m[1] + along(1)],
        }
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

    /// Where the place has no derivatives, at an edge, or no effect, the object stays where it is.
    fn equations(&self, at: &Candidate) -> Result<Normal, NotPositiveDefinite> {
        let has_normal = self.bounds.surface().normal(at.one.press.centre_m).is_some();
        let columns = has_normal.then(|| self.derivatives(at).ok()).flatten();
        let found = columns.map(|columns| equations(&columns, &at.residuals, self.log_radius(&at.one.press)));
        let zeros = vec![0.0; self.steps().len()];
        let still = || Normal::new(&vec![&[][..]; zeros.len()], &[]).with_unit_priors(&zeros);
        Ok(found.filter(|found| found.factor().is_ok()).unwrap_or_else(still))
    }

    /// Force and tip radius change by at most a factor of e.
    fn limit(&self, _: &Candidate, step: &mut [f64]) {
        step[2..PARAMETERS].iter_mut().for_each(|part| *part = part.clamp(-1.0, 1.0));
    }

    fn moved(&self, at: &Candidate, step: &[f64]) -> Option<Candidate> {
        self.candidate(self.stepped(&at.one, step))
    }

    fn is_enough(&self, point: &Candidate, _: usize) -> bool {
        point.misfit < self.enough
    }
}

/// The degrees of freedom of the test: the parameters that the second press adds.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Freedom {
    One,
    Three,
}

impl Freedom {
    /// The value that the test exceeds for one press in 1 % of the cases.
    fn threshold(self) -> f64 {
        bisect([0.0, 100.0], 100, |value| self.distribution(value, 0.0) > 1.0 - FALSE_SPLITS)
    }

    /// The misfit that exceeds the threshold in 90 % of the cases.
    fn needed_misfit(self) -> f64 {
        let threshold = self.threshold();
        bisect([0.0, 1000.0], 100, |misfit| self.distribution(threshold, misfit) < 1.0 - POWER)
    }

    /// The distribution function of the noncentral chi-square distribution: the probability that a point with a normal
    /// distribution on a line or in space, its mean at the distance `sqrt(noncentrality)`, is nearer to the origin than
    /// `sqrt(value)`.
    fn distribution(self, value: f64, noncentrality: f64) -> f64 {
        let (radius, mean) = (value.sqrt(), noncentrality.sqrt());
        let inside = 0.5 * (erf((radius - mean) / SQRT_2) + erf((radius + mean) / SQRT_2));
        let density = |at: f64| exp(-0.5 * at * at) / (2.0 * PI).sqrt();
        match self {
            Freedom::One => inside,
            // The limit for a mean at the origin.
            Freedom::Three if mean < 1e-6 => inside - 2.0 * radius * density(radius),
            Freedom::Three => inside - (density(radius - mean) - density(radius + mean)) / mean,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noncentral_chi_square_distributions() {
        // scipy.stats.chi2.ppf(0.99, n) and ncx2.cdf(value, n, noncentrality), n = 3 and 1.
        let (one, three) = (Freedom::One, Freedom::Three);
        assert!((three.threshold() - 11.344_866_730_144_373).abs() < 1e-9);
        assert!((one.threshold() - 6.634_896_601_021_214).abs() < 1e-9);
        let cases = [
            (three, three.threshold(), 5.0, 0.777_220_531_604_868_5),
            (three, three.threshold(), 17.4, 0.141_678_724_652_405_3),
            (three, 2.0, 4.0, 0.111_254_374_579_325_74),
            (one, 6.0, 5.0, 0.584_499_601_349_272_3),
            (one, 2.0, 4.0, 0.278_689_687_340_667_07),
        ];
        for (freedom, value, noncentrality, probability) in cases {
            let found = freedom.distribution(value, noncentrality);
            assert!((found - probability).abs() < 1e-9, "{freedom:?} {noncentrality}: {found}");
        }
    }
}
