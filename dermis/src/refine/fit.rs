//! The maximum-likelihood fit of the touches of one frame.

use super::VALUES_PER_UNKNOWN;
use super::table::{Response, ResponseTable};
use crate::estimate::least_squares::{Control, Equations, LeastSquares, Normal, Steps, minimise};
use crate::linalg::{Matrix, NotPositiveDefinite, add_scaled, dot, products};
use std::f64::consts::PI;

/// From contacts that are a few millimetres off, three steps are usually enough. A step that is shorter than 0.1 mm is the
/// last one: the next would be of the order of its square over the width of a touch, a thousandth of the accuracy of a
/// position.
const STEPS: Steps = Steps {
    most: 8,
    control: Control::Damping { first: 1e-3, down: 0.3, up: 10.0 },
    shortest: 1e-4,
    least_decrease: 0.0,
};
/// Longest step along an axis, m: the responses are nearly linear over this distance.
const LONGEST_STEP_M: f64 = 5e-3;

/// Two touches near each other are detected as one. One is split where two explain the values better by this much in
/// the sum of squares, whose standard deviation due to noise is 4 for the four more unknowns.
const SPLIT_GAIN: f64 = 40.0;
/// Between two touches a third may be detected. One is left out where the sum of squares grows by less than this: its
/// unknowns alone make it smaller by 4, and by this much in one of 20,000 frames.
const KEEP_GAIN: f64 = 25.0;
/// The gain is at least this part of what noise does not explain: a further touch always explains a part of what the model
/// cannot, which are above all the patches under a press. Two touches 25 mm apart leave two thirds on `lab`.
const LEAST_PART: f64 = 0.2;
/// A touch is tried without where its significance is below this many times that gain: the places of the others adapt,
/// which the significance knows to first order only.
const MOST_SIGNIFICANCE: f64 = 2.0;
/// A split is tried where one touch leaves this much more than its expectation.
const LEAST_EXCESS: f64 = 40.0;
/// Distance of both from the middle at the start, m, and the least distance between them: that of the patches that one
/// press may touch.
const HALF_APART_M: f64 = 12e-3;
pub(super) const LEAST_APART_M: f64 = 14e-3;
/// What two touches have in common is neglected below this part of the weaker one.
const LEAST_SHARED: f64 = 0.01;
/// The weaker one has at least this share of the stronger one's strength.
const LEAST_SHARE: f64 = 0.12;
/// Directions in which they may lie, over a half turn.
const DIRECTIONS: usize = 4;
/// Steps from each of them, after which the best one goes on. At the start, one across the touches may be better than one
/// along them: the width of a touch explains much.
const FIRST_STEPS: usize = 2;
/// A split is given up where its gain after them, without the other touches' steps, is below this part of the one needed.
const LEAST_FIRST_GAIN: f64 = 0.25;
/// With more touches than this, none is split or added.
const MOST_CONTACTS: usize = 4;
/// A touch is added where it explains this much of the sum of squares, and this part of what noise does not explain: where
/// one was missed, it is most of it.
const LEAST_ADDED: Limits = Limits { gain: 40.0, part: 0.5 };
/// The same beside another touch where electrodes are disconnected, whose neighbourhood images do not show. (By noise alone a
/// touch explains 40 in one of 100,000 frames and 20 in one of seven: chi-square with four degrees of freedom, at some 300
/// separate places. A frame with another touch is more than noise.)
const LEAST_ADDED_UNSEEN: Limits = Limits { gain: 20.0, part: 0.3 };
/// Touches explain a frame that differs from noise by this much if they leave at most this part of it, or no more than noise.
const LEAST_EXPLAINED: f64 = 150.0;
const MOST_LEFT: f64 = 0.1;

/// What a further touch explains at least.
struct Limits {
    /// Decrease of the sum of squares.
    gain: f64,
    /// Part of what noise does not explain.
    part: f64,
}

/// A fitted touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Touch {
    /// Its place in the chart, m.
    pub place: [f64; 2],
    /// Its strength, m2.
    pub strength: f64,
    /// Covariance of its place due to noise, misfit and effects that are not fitted, m2: of the first axis, of both, of the
    /// second.
    covariance_m2: [f64; 3],
    /// Its strength squared over the variance due to noise: without it, the sum of squares is larger by about this.
    significance: f64,
}

impl Touch {
    /// Place, strength and width.
    pub(super) const UNKNOWNS: usize = 4;

    /// Whether its place is known well enough to tell it from other touches.
    fn is_located(&self) -> bool {
        self.sd_m(0.0) <= LEAST_APART_M
    }

    /// The standard deviation per axis of a round distribution whose circle of 95 % is as large as that of the place, with
    /// an independent deviation of `offset_sd_m` per axis, m; `NaN` without a covariance. The squared distance has nearly a
    /// chi-square distribution with between one (a line) and two degrees of freedom (Satterthwaite, 1946, DOI
    /// 10.2307/3002019), whose quantile is that of Wilson and Hilferty (1931, DOI 10.1073/pnas.17.12.684).
    pub(super) fn sd_m(&self, offset_sd_m: f64) -> f64 {
        const QUANTILE: f64 = 1.6449;
        let [first, both, second] = self.covariance_m2;
        let [first, second] = [first, second].map(|variance| variance + offset_sd_m * offset_sd_m);
        let freedom = (first + second).powi(2) / (first * first + second * second + 2.0 * both * both);
        let over_mean =
            |freedom: f64| (1.0 - 2.0 / (9.0 * freedom) + QUANTILE * (2.0 / (9.0 * freedom)).sqrt()).powi(3);
        (0.5 * (first + second) * over_mean(freedom) / over_mean(2.0)).sqrt()
    }
}

/// The touches of a frame.
pub(super) struct Fitted {
    pub touches: Vec<Touch>,
    state: State,
}

impl Fitted {
    fn cost(&self) -> f64 {
        self.state.cost
    }

    fn places(&self) -> Vec<[f64; 2]> {
        self.state.places.clone()
    }
}

/// The data of a fit.
#[derive(Clone, Copy)]
pub(super) struct Fit<'a> {
    pub table: &'a ResponseTable,
    /// The values over their noise.
    pub values: &'a [f64],
    pub width_spread_m2: f64,
}

/// Touches at some places, with the strengths that explain the values best.
pub(super) struct State {
    places: Vec<[f64; 2]>,
    responses: Vec<Response>,
    /// Of each touch its strength, and its strength times `t`.
    strengths: Vec<[f64; 2]>,
    /// Square root of the weight of the prior on the latter.
    prior: Vec<f64>,
    residuals: Vec<f64>,
    /// Sum of the squares of the residuals and of the widths, in standard deviations.
    cost: f64,
}

impl State {
    /// The values that one touch explains, and what none does.
    fn without_others(&self, touch: usize) -> Vec<f64> {
        let (Response { value, laplacian, .. }, [strength, width]) = (&self.responses[touch], self.strengths[touch]);
        let own = value.iter().zip(laplacian).map(|(value, laplacian)| strength * value + width * laplacian);
        self.residuals.iter().zip(own).map(|(left, own)| left + own).collect()
    }

    /// The derivatives of the values by the unknowns of each touch: place, strength, width.
    fn derivatives(&self) -> Vec<Vec<f64>> {
        let of_touch = |(Response { value, by_place, laplacian }, strength): (&Response, &[f64; 2])| {
            let [round, along] = [0, 1].map(|axis: usize| by_place[axis].iter().map(|by| strength[0] * by).collect());
            [round, along, value.clone(), laplacian.clone()]
        };
        self.responses.iter().zip(&self.strengths).flat_map(of_touch).collect()
    }

    /// The equations of a step of places, strengths and widths, from the derivatives of the values.
    fn equations(&self, derivatives: &[&[f64]]) -> Normal {
        let mut normal = Normal::new(derivatives, &self.residuals);
        for (touch, (prior, strength)) in self.prior.iter().zip(&self.strengths).enumerate() {
            normal.add_prior(Touch::UNKNOWNS * touch + 3, prior * prior, strength[1]);
        }
        normal
    }

    /// The square of the width of a touch, in standard deviations.
    fn penalty(&self, touch: usize) -> f64 {
        (self.strengths[touch][1] * self.prior[touch]).powi(2)
    }
}

impl LeastSquares for Fit<'_> {
    type Point = State;
    type Equations = Normal;
    type Error = NotPositiveDefinite;

    fn cost(&self, state: &State) -> f64 {
        state.cost
    }

    fn equations(&self, state: &State) -> Result<Normal, NotPositiveDefinite> {
        Ok(state.equations(&columns(&state.derivatives())))
    }

    /// Touches stay on the body; the strengths and widths are solved for wherever they are.
    fn limit(&self, state: &State, step: &mut [f64]) {
        for (place, step) in state.places.iter().zip(step.as_chunks_mut::<{ Touch::UNKNOWNS }>().0) {
            let by = [0, 1].map(|axis: usize| step[axis].clamp(-LONGEST_STEP_M, LONGEST_STEP_M));
            let bounded = self.table.bounded([place[0] + by[0], place[1] + by[1]]);
            *step = [bounded[0] - place[0], bounded[1] - place[1], 0.0, 0.0];
        }
    }

    fn moved(&self, state: &State, step: &[f64]) -> Option<State> {
        let steps = step.as_chunks::<{ Touch::UNKNOWNS }>().0;
        self.at(state.places.iter().zip(steps).map(|(place, by)| [place[0] + by[0], place[1] + by[1]]).collect())
    }
}

impl Fit<'_> {
    /// The touches of greatest likelihood near some places; `None` where the values are too few or the equations have no
    /// solution.
    pub(super) fn run(&self, places: &[[f64; 2]]) -> Option<Fitted> {
        if self.values.len() < VALUES_PER_UNKNOWN * Touch::UNKNOWNS * places.len().max(1) {
            return None;
        }
        self.fitted(self.descended(self.at(places.to_vec())?, STEPS.most)?)
    }

    /// A state after some steps; `None` where the equations have no solution.
    fn descended(&self, state: State, most: usize) -> Option<State> {
        Some(minimise(self, state, &Steps { most, ..STEPS }).ok()?.point)
    }

    /// The touches without one that hardly explains anything, and its index: between two touches that overlap in the
    /// image a third may be detected.
    pub(super) fn without_excess(&self, fitted: &Fitted) -> Option<(usize, Fitted)> {
        if fitted.touches.len() < 2 {
            return None;
        }
        let by_significance = |a: &(usize, &Touch), b: &(usize, &Touch)| a.1.significance.total_cmp(&b.1.significance);
        let (index, weakest) = fitted.touches.iter().enumerate().min_by(by_significance)?;
        if weakest.significance > MOST_SIGNIFICANCE * self.least_gain(KEEP_GAIN, fitted.cost() + weakest.significance) {
            return None;
        }
        let mut places = fitted.places();
        places.remove(index);
        let fewer = self.run(&places)?;
        (fewer.cost() - fitted.cost() < self.least_gain(KEEP_GAIN, fewer.cost())).then_some((index, fewer))
    }

    /// One of the touches as two, if two explain the values far better: its index, and all touches with its other half
    /// as the last one.
    pub(super) fn split(&self, fitted: &Fitted) -> Option<(usize, Fitted)> {
        if !self.may_be_more(fitted, LEAST_EXCESS) {
            return None;
        }
        let misfit = dot(&fitted.state.residuals, &fitted.state.residuals);
        let gain = |touch: usize| {
            let own = fitted.state.without_others(touch);
            let halves = Fit { values: &own, ..*self }.halves(fitted.touches[touch].place)?;
            Some((misfit + fitted.state.penalty(touch) - halves.cost, touch, halves))
        };
        let (gain, touch, halves) = (0..fitted.touches.len()).filter_map(gain).max_by(|a, b| a.0.total_cmp(&b.0))?;
        if gain < LEAST_FIRST_GAIN * self.least_gain(SPLIT_GAIN, fitted.cost()) {
            return None;
        }
        let mut places = fitted.places();
        places[touch] = halves.places[0];
        places.push(halves.places[1]);
        let two = self.run(&places)?;
        self.are_two(&two, touch, fitted.cost()).then_some((touch, two))
    }

    /// Whether touches explain most of what noise does not explain.
    pub(super) fn is_explained(&self, fitted: &Fitted) -> bool {
        let noise = self.values.len() as f64;
        let excess = dot(self.values, self.values) - noise;
        let left = fitted.cost() - noise + (Touch::UNKNOWNS * fitted.touches.len()) as f64;
        excess >= LEAST_EXPLAINED && left <= LEAST_EXCESS.max(MOST_LEFT * excess)
    }

    /// The touches and one more as the last one, where that explains most of what they leave.
    pub(super) fn added(&self, fitted: &Fitted) -> Option<Fitted> {
        let may_be_unseen = self.table.lacks_electrodes() && !fitted.touches.is_empty();
        let least = if may_be_unseen { LEAST_ADDED_UNSEEN } else { LEAST_ADDED };
        if !self.may_be_more(fitted, least.gain) {
            return None;
        }
        let mut places = fitted.places();
        places.push(self.table.likeliest(&fitted.state.residuals)?);
        let more = self.run(&places)?;
        let (added, others) = more.touches.split_last()?;
        let unexplained = fitted.cost() - self.values.len() as f64;
        let strongest = others.iter().map(|other| other.strength).fold(0.0, f64::max);
        let is_apart = |other: &Touch| self.table.distance_m(other.place, added.place) >= LEAST_APART_M;
        let is_touch = fitted.cost() - more.cost() >= least.gain.max(least.part * unexplained)
            && added.strength > LEAST_SHARE * strongest
            && added.is_located()
            && others.iter().all(is_apart);
        is_touch.then_some(more)
    }

    /// Whether touches leave this much more than noise, and there are enough values for one more.
    fn may_be_more(&self, fitted: &Fitted, excess: f64) -> bool {
        let (count, values) = (fitted.touches.len(), self.values.len());
        let expected = values as f64 - (Touch::UNKNOWNS * count) as f64;
        let enough = values >= VALUES_PER_UNKNOWN * Touch::UNKNOWNS * (count + 1);
        fitted.cost() >= expected + excess && count <= MOST_CONTACTS && enough
    }

    /// Two touches about a place, in the best of some directions, after a few steps.
    fn halves(&self, [u, v]: [f64; 2]) -> Option<State> {
        let in_direction = |direction: usize| {
            let (sine, cosine) = (PI * direction as f64 / DIRECTIONS as f64).sin_cos();
            let by = |by: f64| self.table.bounded([u + by * cosine, v + by * sine]);
            self.descended(self.at(vec![by(-HALF_APART_M), by(HALF_APART_M)])?, FIRST_STEPS)
        };
        (0..DIRECTIONS).filter_map(in_direction).min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// The least decrease of a sum of squares by one more touch.
    fn least_gain(&self, of_noise: f64, cost: f64) -> f64 {
        of_noise.max(LEAST_PART * (cost - self.values.len() as f64))
    }

    /// Whether a touch and the last one are two touches.
    fn are_two(&self, two: &Fitted, touch: usize, cost_of_one: f64) -> bool {
        let (Some(last), own) = (two.touches.last(), &two.touches[touch]) else { return false };
        let (weaker, stronger) = (last.strength.min(own.strength), last.strength.max(own.strength));
        cost_of_one - two.cost() >= self.least_gain(SPLIT_GAIN, cost_of_one)
            && weaker >= LEAST_SHARE * stronger
            && weaker > 0.0
            && last.is_located()
            && own.is_located()
            && self.table.distance_m(last.place, own.place) >= LEAST_APART_M
    }

    /// The strengths at some places.
    fn at(&self, places: Vec<[f64; 2]>) -> Option<State> {
        let responses: Vec<Response> = places.iter().map(|&place| self.table.response(place)).collect();
        let columns: Vec<&[f64]> = responses.iter().flat_map(|r| [&r.value[..], &r.laplacian[..]]).collect();
        let mut normal = Normal::new(&columns, self.values);
        // The prior is on t, the ratio of both strengths; the first is that without a width.
        let first = every_other(&normal).step(0.0).ok()?;
        let prior: Vec<f64> = first.iter().map(|strength| 1.0 / (strength.abs() * self.width_spread_m2)).collect();
        (prior.iter().enumerate()).for_each(|(touch, prior)| normal.add_prior(2 * touch + 1, prior * prior, 0.0));
        let solution = normal.step(0.0).ok()?;
        let mut residuals = self.values.to_vec();
        for (column, strength) in columns.iter().zip(&solution) {
            add_scaled(&mut residuals, -strength, column);
        }
        let strengths = solution.as_chunks::<2>().0.to_vec();
        let mut state = State { places, responses, strengths, prior, residuals, cost: 0.0 };
        let penalty: f64 = (0..state.places.len()).map(|touch| state.penalty(touch)).sum();
        state.cost = dot(&state.residuals, &state.residuals) + penalty;
        Some(state)
    }

    /// The touches with their variances. Residuals above the noise are errors of the model, by which the variances grow.
    fn fitted(&self, state: State) -> Option<Fitted> {
        let derivatives = state.derivatives();
        let derivatives = columns(&derivatives);
        let covariance = state.equations(&derivatives).factor().ok()?.inverse();
        let freedom = self.values.len() - Touch::UNKNOWNS * state.places.len();
        let misfit = (dot(&state.residuals, &state.residuals) / freedom as f64).max(1.0);
        let errors = self.systematic_errors(&state, &derivatives, &covariance);
        let touch = |(index, (&place, strength)): (usize, (&[f64; 2], &[f64; 2]))| {
            let first = Touch::UNKNOWNS * index;
            let of = |i: usize, j: usize| {
                let systematic: f64 = errors.iter().map(|error| error[first + i] * error[first + j]).sum();
                covariance.at(first + i, first + j) * misfit + systematic
            };
            let covariance_m2 = [of(0, 0), of(0, 1), of(1, 1)];
            let significance = strength[0] * strength[0] / covariance.at(first + 2, first + 2);
            Touch { place, strength: strength[0], covariance_m2, significance }
        };
        let touches = state.places.iter().zip(&state.strengths).enumerate().map(touch).collect();
        Some(Fitted { touches, state })
    }

    /// The errors of the unknowns by one standard deviation of each effect that is not fitted.
    fn systematic_errors(&self, state: &State, derivatives: &[&[f64]], covariance: &Matrix) -> Vec<Vec<f64>> {
        let error = |change: Vec<f64>| {
            let mut error = vec![0.0; covariance.rows];
            covariance.product_into(&products(derivatives, &change), &mut error);
            error
        };
        self.by_forms(state).chain(self.by_shared_patches(state)).map(error).collect()
    }

    /// The changes of the values by the oblong forms of the touches.
    fn by_forms(&self, state: &State) -> impl Iterator<Item = Vec<f64>> {
        let of_touch = |(&place, [strength, _]): (&[f64; 2], &[f64; 2])| {
            self.table.by_form(place).map(|change| scaled(change, self.width_spread_m2 * strength))
        };
        state.places.iter().zip(&state.strengths).flat_map(of_touch)
    }

    /// The changes of the values by what touches on the same patches have in common, which do not add up: a touch in their
    /// middle, as strong as the weaker one where they meet.
    fn by_shared_patches(&self, state: &State) -> impl Iterator<Item = Vec<f64>> {
        let pairs = (0..state.places.len()).flat_map(|a| (0..a).map(move |b| [a, b]));
        pairs.filter_map(|pair| {
            let [a, b] = pair.map(|touch| state.places[touch]);
            let apart = self.table.distance_m(a, b) / LEAST_APART_M;
            let weaker = pair.map(|touch| state.strengths[touch][0].abs()).into_iter().fold(f64::INFINITY, f64::min);
            // The overlap of two Gaussians of that width.
            let share = (-0.25 * apart * apart).exp();
            (share > LEAST_SHARED).then(|| scaled(self.table.response(self.table.middle(a, b)).value, share * weaker))
        })
    }
}

fn columns(values: &[Vec<f64>]) -> Vec<&[f64]> {
    values.iter().map(Vec::as_slice).collect()
}

fn scaled(mut values: Vec<f64>, by: f64) -> Vec<f64> {
    values.iter_mut().for_each(|value| *value *= by);
    values
}

/// The equations of the first of each two unknowns.
fn every_other(normal: &Normal) -> Normal {
    let count = normal.matrix.rows / 2;
    let mut own = Normal { matrix: Matrix::zeros(count, count), right: vec![0.0; count] };
    for i in 0..count {
        own.right[i] = normal.right[2 * i];
        (0..count).for_each(|j| *own.matrix.at_mut(i, j) = normal.matrix.at(2 * i, 2 * j));
    }
    own
}
