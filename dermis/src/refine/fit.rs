//! The touches that explain a frame: their most probable places, forms and strengths, and their number.

use super::RefineOptions;
use super::form::{Density, Form};
use super::free_form::FreeForm;
use super::places::Place;
use super::responses::{COLUMNS, Response, Responses};
use crate::estimate::least_squares::{Control, Equations, LeastSquares, Normal, Steps, minimise};
use crate::geom::Point2;
use crate::linalg::{Cholesky, Matrix, NotPositiveDefinite, add_scaled, dot};
use std::f64::consts::{PI, TAU};

/// Unknowns of a touch: place (two), width, segment (two), strength, uneven tensor (two).
pub(super) const UNKNOWNS: usize = 8;
/// The unit of each unknown: m, the logarithm of the width, m, the logarithm of the strength, a share. A step of one unit is
/// about as important for each.
pub(super) const UNITS: [f64; UNKNOWNS] = [1e-3, 1e-3, 0.2, 2e-3, 2e-3, 0.2, 0.2, 0.2];
/// The longest step of each unknown, in its unit: the responses are nearly linear over it.
const LONGEST: [f64; UNKNOWNS] = [5.0, 5.0, 2.0, 4.0, 4.0, 4.0, 2.0, 2.0];
/// From contacts that are a few millimetres off, six steps are usually enough. A step shorter than 20 um is the last one.
const STEPS: Steps = Steps {
    most: 40,
    control: Control::Damping { first: 1e-3, down: 0.2, up: 10.0 },
    shortest: 0.02,
    least_decrease: 3e-5,
};
/// The logarithm of the range of strengths that a touch may have: from noise to the strongest press.
const STRENGTHS: f64 = 7.0;
/// Other values from which the variance of the misfit is known before a frame, over the number of values.
const FREEDOM: f64 = 0.2;
/// Below this variance by misfit, over that of noise, the variance of a value is as good as known.
const NO_MISFIT: f64 = 1e-6;
/// Two touches nearer than this may be one, m: two segments of half of it.
pub(super) const JOINED_M: f64 = 0.05;
/// A segment longer than this may be two touches, m.
pub(super) const SPLIT_M: f64 = 8e-3;
/// Changes of the number of touches, which are as many as a frame may need.
const MAX_CHANGES: usize = 32;
/// A touch is at most this many times as wide as usual, and at least one over this.
pub(super) const WIDEST: f64 = 4.0;
/// The 95 % quantile of the absolute value of Student's distribution of one degree of freedom, over that of a normal one.
const WIDTH_TAIL: f64 = 12.706 / 1.960;
/// Places at which one more touch is tried.
const MORE_TRIED: usize = 3;
/// A frame has at most this many touches.
const MAX_TOUCHES: usize = 16;

/// A touch: the unknowns of the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Touch {
    pub place: Place,
    pub form: Form,
    /// The logarithm of the strength, m2.
    pub log_strength: f64,
    /// The uneven part of the tensor of conductance: along the first axis less along the second, and along both.
    pub uneven: Point2,
    /// The contact that it is of, if it was detected.
    pub of: Option<usize>,
}

impl Touch {
    /// A usual touch at a place.
    pub(super) fn at(place: Place, of: Option<usize>) -> Self {
        Touch { place, form: Form::default(), log_strength: f64::NAN, uneven: [0.0; 2], of }
    }

    /// The unknowns with a prior about zero: the width, the segment, the uneven tensor; in their units.
    fn deviations(&self) -> [(usize, Point2); 3] {
        let over = |value: f64, unknown: usize| value / UNITS[unknown];
        [
            (2, [over(self.form.log_width, 2), 0.0]),
            (3, self.form.oblong_m.map(|part| over(part, 3))),
            (6, self.uneven.map(|part| over(part, 6))),
        ]
    }
}

/// Touches with the values that they leave.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub touches: Vec<Touch>,
    pub responses: Vec<Response>,
    pub residuals: Vec<f64>,
    cost: f64,
}

/// Touches at the minimum, with the covariance of their unknowns.
#[derive(Debug, Clone)]
pub(super) struct Fitted {
    pub state: State,
    /// The information about all unknowns, and its inverse.
    information: Matrix,
    covariance: Matrix,
    /// Twice the negative logarithm of the probability of the frame and these touches, up to a constant.
    pub evidence: f64,
    /// By touch, what it is as a touch of any form, where it may be one.
    pub free: Vec<Option<FreeForm>>,
    /// By touch, the probability that it is one of its own, and no part of a touch of any form with those near it.
    pub apart: Vec<f64>,
}

/// The data of a fit.
#[derive(Clone, Copy)]
pub(super) struct Fit<'a> {
    pub responses: &'a Responses,
    pub options: &'a RefineOptions,
    /// The whitened values.
    pub values: &'a [f64],
    /// The least variance of a value by the misfit of touches; that of noise is 1.
    pub misfit: f64,
    /// Touches that the values no longer contain.
    pub others: usize,
}

impl LeastSquares for Fit<'_> {
    type Point = State;
    type Equations = Normal;
    type Error = NotPositiveDefinite;

    fn cost(&self, state: &State) -> f64 {
        state.cost
    }

    fn equations(&self, state: &State) -> Result<Normal, NotPositiveDefinite> {
        Ok(self.stepped(state))
    }

    fn limit(&self, _: &State, step: &mut [f64]) {
        for step in step.as_chunks_mut::<UNKNOWNS>().0 {
            let factor = step.iter().zip(LONGEST).map(|(part, most)| most / part.abs().max(most)).fold(1.0, f64::min);
            step.iter_mut().for_each(|part| *part *= factor);
        }
    }

    fn moved(&self, from: &State, step: &[f64]) -> Option<State> {
        let moved = |(touch, step): (&Touch, &[f64; UNKNOWNS])| {
            let by: [f64; UNKNOWNS] = std::array::from_fn(|unknown| step[unknown] * UNITS[unknown]);
            let [x, y] = touch.form.oblong_m;
            Touch {
                place: self.responses.space().walk(&touch.place, [by[0], by[1]]),
                form: Form {
                    log_width: (touch.form.log_width + by[2]).clamp(-WIDEST.ln(), WIDEST.ln()),
                    oblong_m: [x + by[3], y + by[4]],
                },
                log_strength: touch.log_strength + by[5],
                uneven: definite([touch.uneven[0] + by[6], touch.uneven[1] + by[7]]),
                of: touch.of,
            }
        };
        Some(self.state(from.touches.iter().zip(step.as_chunks::<UNKNOWNS>().0).map(moved).collect()))
    }
}

impl Fit<'_> {
    /// What some touches leave.
    pub(super) fn state(&self, touches: Vec<Touch>) -> State {
        let responses = self.responses_of(&touches);
        self.with(touches, responses)
    }

    fn responses_of(&self, touches: &[Touch]) -> Vec<Response> {
        touches.iter().map(|touch| self.responses.response(&touch.place, &touch.form, touch.uneven)).collect()
    }

    /// The same with the responses of the touches.
    fn with(&self, touches: Vec<Touch>, responses: Vec<Response>) -> State {
        let mut residuals = self.values.to_vec();
        for (touch, response) in touches.iter().zip(&responses) {
            subtract(&mut residuals, touch, response);
        }
        let prior: f64 = touches.iter().map(|touch| self.prior(touch)).sum();
        let cost = self.cost_of(dot(&residuals, &residuals)) + prior;
        State { cost, touches, responses, residuals }
    }

    /// Usual touches at some places, with the strengths that explain the values best.
    pub(super) fn start(&self, mut touches: Vec<Touch>) -> Option<State> {
        let responses = self.responses_of(&touches);
        let columns: Vec<&[f64]> = responses.iter().map(|response| response.columns[0].as_slice()).collect();
        let strengths = Normal::new(&columns, self.values).step(1e-6).ok()?;
        // A touch that explains nothing starts as a weak one.
        let most = strengths.iter().copied().fold(0.0, f64::max);
        if most <= 0.0 {
            return None;
        }
        for (touch, strength) in touches.iter_mut().zip(strengths) {
            touch.log_strength = strength.max(0.01 * most).ln();
        }
        Some(self.with(touches, responses))
    }

    /// The scales of the priors of the width, the segment and the uneven tensor in their units, with their dimensions.
    fn scales(&self) -> [(f64, f64); 3] {
        let options = self.options;
        [
            (options.width_ratio.ln() / UNITS[2], 1.0),
            (options.length_m / UNITS[3], 2.0),
            (options.unevenness / UNITS[6], 2.0),
        ]
    }

    /// Twice the negative logarithm of the prior of a touch over that at its mode: Student's distributions with one degree of
    /// freedom, `(1 + d) ln(1 + x^2 / s^2)` in `d` dimensions.
    pub(super) fn prior(&self, touch: &Touch) -> f64 {
        let of = |((_, [a, b]), (scale, dimensions)): ((usize, Point2), (f64, f64))| {
            (1.0 + dimensions) * ((a * a + b * b) / (scale * scale)).ln_1p()
        };
        touch.deviations().into_iter().zip(self.scales()).map(of).sum()
    }

    /// The logarithm of the odds against a touch beside a number of those of this fit.
    fn log_odds(&self, count: usize) -> f64 {
        if self.others + count == 0 { self.options.log_odds } else { self.options.log_odds_further }
    }

    /// Twice the negative logarithm of the prior of a touch beside a number of others at its mode, less that of the constant of
    /// Laplace's approximation.
    pub(super) fn constant(&self, count: usize) -> f64 {
        let [(width, _), (length, _), (uneven, _)] = self.scales();
        let area = self.responses.area_m2() / (UNITS[0] * UNITS[1]);
        let volume = area * (STRENGTHS / UNITS[5]) * (PI * width) * (TAU * length * length) * (TAU * uneven * uneven);
        2.0 * (volume.ln() + self.log_odds(count)) - UNKNOWNS as f64 * TAU.ln()
    }

    /// Twice the negative logarithm of the likelihood of residuals with this sum of squares, up to a constant: Student's
    /// distribution. The variance of noise is known; that of the misfit is known before the frame as if from [`FREEDOM`] times
    /// as many other values, and the frame tells the rest (Gelman et al., 2013, "Bayesian Data Analysis", section 3.2).
    pub(super) fn cost_of(&self, square: f64) -> f64 {
        self.freedom() * (square / self.prior_square()).ln_1p()
    }

    /// The number of other values from which the variance of a value is known: more, the smaller the share of the misfit is.
    fn other_values(&self) -> f64 {
        FREEDOM * self.responses.value_count() as f64 * (1.0 + 1.0 / self.misfit.max(NO_MISFIT))
    }

    /// The degrees of freedom of the variance of a value.
    fn freedom(&self) -> f64 {
        self.other_values() + self.responses.rank() as f64
    }

    /// The sum of squares that is known before the frame: of the noise of other values, and of the misfit of all of them.
    fn prior_square(&self) -> f64 {
        self.other_values() + self.freedom() * self.misfit
    }

    /// One over the variance of a value beside the residuals of a state: the slope of the cost, at most the weight of noise alone.
    pub(super) fn weight_at(&self, state: &State) -> f64 {
        1.0 / self.variance_of(state.sum_of_squares())
    }

    /// The variance of a value by a sum of squares: at least that of noise.
    pub(super) fn variance_of(&self, square: f64) -> f64 {
        ((self.prior_square() + square) / self.freedom()).max(1.0)
    }

    /// The equations of a step, with the precision of a prior by its scale, dimensions and the square of the unknowns.
    fn normal(&self, state: &State, precision: impl Fn(f64, f64, f64) -> f64) -> Normal {
        let weight = self.weight_at(state);
        let columns: Vec<Vec<f64>> = state.touches.iter().zip(&state.responses).flat_map(derivatives).collect();
        let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let mut normal = Normal::new(&columns, &state.residuals);
        normal.matrix.values.iter_mut().for_each(|value| *value *= weight);
        normal.right.iter_mut().for_each(|value| *value *= weight);
        for (index, touch) in state.touches.iter().enumerate() {
            for ((unknown, value), (scale, dimensions)) in touch.deviations().into_iter().zip(self.scales()) {
                let precision = precision(scale, dimensions, value[0] * value[0] + value[1] * value[1]);
                for (part, value) in value.into_iter().take(dimensions as usize).enumerate() {
                    normal.add_prior(UNKNOWNS * index + unknown + part, precision, value);
                }
            }
        }
        normal
    }

    /// The equations of a step with the precisions of Student's distributions: their second derivatives where the unknown is zero,
    /// and less beyond.
    pub(super) fn stepped(&self, state: &State) -> Normal {
        self.normal(state, |scale, dimensions, square| (1.0 + dimensions) / (scale * scale + square))
    }

    /// The information about the unknowns: with the precisions of Gaussians that have the height of the priors. With them
    /// Laplace's approximation is exact for unknowns that the frame tells nothing about, too.
    pub(super) fn information(&self, state: &State) -> Matrix {
        let of_height =
            |scale: f64, dimensions: f64, _: f64| if dimensions > 1.0 { 1.0 } else { 2.0 / PI } / (scale * scale);
        self.normal(state, of_height).matrix
    }

    /// The most probable touches near some.
    pub(super) fn fitted(&self, state: State) -> Option<Fitted> {
        let state = minimise(self, state, &STEPS).ok()?.point;
        let information = self.information(&state);
        let factor = Cholesky::determined(&information).ok()?;
        let evidence = self.evidence(&state, factor.log_determinant());
        let (free, apart) = (vec![None; state.touches.len()], vec![1.0; state.touches.len()]);
        Some(Fitted { covariance: factor.inverse(), information, evidence, free, apart, state })
    }

    /// Twice the negative logarithm of the probability of the values and some touches, from the determinant of the information
    /// about their unknowns.
    fn evidence(&self, state: &State, log_determinant: f64) -> f64 {
        let constants: f64 = (0..state.touches.len()).map(|count| self.constant(count)).sum();
        state.cost + log_determinant + constants
    }

    /// No touch at all.
    fn untouched(&self) -> Fitted {
        let state = self.state(Vec::new());
        let nothing = Matrix::zeros(0, 0);
        let (free, apart) = (Vec::new(), Vec::new());
        Fitted { evidence: state.cost, covariance: nothing.clone(), information: nothing, free, apart, state }
    }

    /// The most probable touches near those detected, and their most probable number.
    pub(super) fn run(&self, detected: Vec<Touch>) -> Fitted {
        let start = if detected.is_empty() { None } else { self.start(detected).and_then(|state| self.fitted(state)) };
        let mut best = start.unwrap_or_else(|| self.untouched());
        for _ in 0..MAX_CHANGES {
            let better = self
                .joined(&best)
                .or_else(|| self.split(&best))
                .or_else(|| self.more(&best))
                .or_else(|| self.fewer(&best));
            let Some(better) = better else { break };
            best = better;
        }
        self.of_any_form(best)
    }

    /// The values of some touches of a state, and the number of the others.
    pub(super) fn part(&self, state: &State, chosen: &[usize]) -> (Vec<f64>, usize) {
        let mut own = state.residuals.clone();
        for &index in chosen {
            restore(&mut own, &state.touches[index], &state.responses[index]);
        }
        (own, self.others + state.touches.len() - chosen.len())
    }

    /// Some touches of another state as those of this fit.
    pub(super) fn chosen(&self, state: &State, chosen: &[usize]) -> State {
        let of = |index: &usize| (state.touches[*index], state.responses[*index].clone());
        let (touches, responses) = chosen.iter().map(of).unzip();
        self.with(touches, responses)
    }

    /// The evidence of a state where it is.
    pub(super) fn as_it_is(&self, state: &State) -> Option<f64> {
        let factor = Cholesky::determined(&self.information(state)).ok()?;
        Some(self.evidence(state, factor.log_determinant()))
    }

    /// Some touches in place of others, of which the most probable of several choices, where that is more probable: first with
    /// the other touches as they are.
    fn changed(&self, from: &Fitted, removed: &[usize], choices: Vec<Vec<Touch>>) -> Option<Fitted> {
        let state = &from.state;
        let (own, others) = self.part(state, removed);
        let local = Fit { values: &own, others, ..*self };
        let fits = choices.into_iter().filter_map(|touches| local.fitted(local.start(touches)?));
        let new = fits.min_by(|a, b| a.evidence.total_cmp(&b.evidence));
        if let Some(new) = &new
            && new.evidence >= self.as_it_is(&local.chosen(state, removed))?
        {
            return None;
        }
        let is_kept = |index: &usize| !removed.contains(index);
        let kept = (0..state.touches.len()).filter(is_kept).map(|index| state.touches[index]);
        let all: Vec<Touch> = kept.chain(new.into_iter().flat_map(|new| new.state.touches)).collect();
        let changed = self.fitted(self.state(all))?;
        let is_possible = changed.state.touches.len() <= state.touches.len() || !self.overlap(&changed.state.touches);
        (is_possible && changed.evidence < from.evidence).then_some(changed)
    }

    /// Whether two touches are in one place, where two objects cannot be: the segments of both are nearer to each other than half
    /// their widths.
    fn overlap(&self, touches: &[Touch]) -> bool {
        let (space, usual_m) = (self.responses.space(), self.responses.usual_m());
        let of = |touch: &Touch| {
            let density = Density::new(&touch.form, usual_m);
            let [_, half_width_m] = density.half_extents_m();
            let at = |part: f64| space.walk(&touch.place, density.axis.map(|axis| axis * part * density.half_length_m));
            ([-1.0, -0.5, 0.0, 0.5, 1.0].map(at), half_width_m)
        };
        let all: Vec<_> = touches.iter().map(of).collect();
        let near = |(a, half_a): &([Place; 5], f64), (b, half_b): &([Place; 5], f64)| {
            a.iter().any(|one| b.iter().any(|other| space.distance_m(one, other) < half_a + half_b))
        };
        (0..all.len()).any(|a| (0..a).any(|b| near(&all[a], &all[b])))
    }

    /// Two touches as one.
    fn joined(&self, from: &Fitted) -> Option<Fitted> {
        let (touches, space) = (&from.state.touches, self.responses.space());
        let pairs = (0..touches.len()).flat_map(|a| (0..a).map(move |b| [a, b]));
        let near = |&[a, b]: &[usize; 2]| space.distance_m(&touches[a].place, &touches[b].place) < JOINED_M;
        pairs.filter(near).find_map(|pair| {
            let [a, b] = pair.map(|index| &touches[index]);
            let share = 1.0 / (1.0 + (a.log_strength - b.log_strength).exp());
            let step = space.step(&a.place, &b.place);
            let place = space.walk(&a.place, step.map(|part| share * part));
            let turn = space.turn(&a.place, &place);
            let half = step.map(|part| 0.5 * part);
            let form = Form::of_segment(half, self.responses.usual_m()).turned(turn);
            let stronger = if share < 0.5 { a } else { b };
            let joined = Touch { form, ..Touch::at(place, stronger.of.or(a.of).or(b.of)) };
            self.changed(from, &pair, vec![vec![joined]])
        })
    }

    /// A long touch as two.
    fn split(&self, from: &Fitted) -> Option<Fitted> {
        let (space, usual_m) = (self.responses.space(), self.responses.usual_m());
        from.state.touches.iter().enumerate().find_map(|(index, touch)| {
            let density = Density::new(&touch.form, usual_m);
            if density.half_length_m < SPLIT_M {
                return None;
            }
            let half = density.axis.map(|part| part * density.half_length_m * 0.7);
            let end = |sign: f64, of| Touch::at(space.walk(&touch.place, half.map(|part| sign * part)), of);
            self.changed(from, &[index], vec![vec![end(1.0, touch.of), end(-1.0, None)]])
        })
    }

    /// One more touch, where one explains what the others leave.
    fn more(&self, from: &Fitted) -> Option<Fitted> {
        if from.state.touches.len() >= MAX_TOUCHES {
            return None;
        }
        // At its most probable place a touch is known to about its width, which leaves the odds of the area.
        let odds = self.log_odds(from.state.touches.len());
        let least = 2.0 * (odds + (self.responses.area_m2() / (TAU * self.responses.usual_m().powi(2))).ln());
        let least = least / self.weight_at(&from.state);
        let places = self.responses.likeliest(&from.state.residuals, MORE_TRIED, least);
        let tried: Vec<Vec<Touch>> = places.into_iter().map(|place| vec![Touch::at(place, None)]).collect();
        if tried.is_empty() { None } else { self.changed(from, &[], tried) }
    }

    /// The touches without the least significant one.
    fn fewer(&self, from: &Fitted) -> Option<Fitted> {
        let count = from.state.touches.len();
        let gains: Vec<f64> = (0..count).map(|index| from.odds(index, self)).collect();
        let weakest = (0..count).min_by(|a, b| gains[*a].total_cmp(&gains[*b]))?;
        if gains[weakest] > self.constant(count - 1) {
            return None;
        }
        if count == 1 {
            return Some(self.untouched()).filter(|untouched| untouched.evidence < from.evidence);
        }
        self.changed(from, &[weakest], Vec::new())
    }
}

impl State {
    /// The sum of the squares of the values that the touches leave.
    pub(super) fn sum_of_squares(&self) -> f64 {
        dot(&self.residuals, &self.residuals)
    }
}

impl Fitted {
    /// Twice the logarithm of the odds that a touch of this form is there: what the frame would be without it, where the others
    /// adapt to first order.
    pub(super) fn odds(&self, index: usize, fit: &Fit<'_>) -> f64 {
        let own = UNKNOWNS * index..UNKNOWNS * (index + 1);
        let strength = own.start + 5;
        let others = (0..self.information.rows).filter(|unknown| !own.contains(unknown));
        let with_strength: Vec<usize> = others.chain([strength]).collect();
        let factor = |matrix: &Matrix, unknowns: &[usize]| {
            let mut part = Matrix::zeros(unknowns.len(), unknowns.len());
            for (i, &row) in unknowns.iter().enumerate() {
                unknowns.iter().enumerate().for_each(|(j, &column)| *part.at_mut(i, j) = matrix.at(row, column));
            }
            Cholesky::new(&part)
        };
        let mut unit = vec![0.0; with_strength.len()];
        *unit.last_mut().expect("the strength") = 1.0;
        let variance = factor(&self.information, &with_strength)
            .map_or(f64::INFINITY, |factor| factor.solve(&unit)[unit.len() - 1]);
        let explained = 1.0 / (variance * UNITS[5] * UNITS[5]) - fit.prior(&self.state.touches[index]);
        let determinant =
            factor(&self.covariance, &own.collect::<Vec<usize>>()).map_or(0.0, |factor| factor.log_determinant());
        // What Student's distribution loses without the touch. It may explain less than its prior costs: the logarithm stays finite.
        fit.freedom() * (explained / fit.freedom()).max(-0.5).ln_1p() + determinant
            - fit.constant(self.state.touches.len() - 1)
    }

    /// The strength of the round, even touch of usual width at the same place whose change of the frame is nearest to that of a
    /// touch, m2. The frame determines it better than the strength of the touch itself, which depends on its width.
    pub(super) fn strength_m2(&self, index: usize, fit: &Fit<'_>) -> f64 {
        let touch = &self.state.touches[index];
        let mut own = vec![0.0; fit.values.len()];
        restore(&mut own, touch, &self.state.responses[index]);
        let usual = fit.responses.usual(&touch.place);
        dot(&usual, &own) / dot(&usual, &usual)
    }

    /// The covariance of the place of a touch in its axes, m2, by noise and misfit and by the grain of the contact, and its
    /// form. The prior of the width counts by its tails: a wide touch at the edge of a skin changes a frame nearly as a narrow one
    /// farther inside.
    pub(super) fn place_covariance_m2(&self, index: usize, fit: &Fit<'_>) -> [f64; 3] {
        let first = UNKNOWNS * index;
        let grain_m2 = fit.options.grain_m * fit.options.grain_m;
        let unit = UNITS[0] * UNITS[1];
        let at = |i: usize, j: usize| self.covariance.at(first + i, first + j);
        let less = fit.less_of_width();
        let factor = less / (1.0 - less * at(2, 2));
        let of_capsule = || [(0, 0), (0, 1), (1, 1)].map(|(i, j)| unit * (at(i, j) + factor * at(i, 2) * at(j, 2)));
        let [a, b, c] = self.free[index].as_ref().map_or_else(of_capsule, |free| free.mixed(of_capsule()));
        let grain = self.state.responses[index].grain_m2;
        [a + grain_m2 * grain[0], b + grain_m2 * grain[1], c + grain_m2 * grain[2]]
    }
}

impl Fitted {
    /// The width of a touch one standard deviation above its own, over its own, by the tails of its prior.
    pub(super) fn wide(&self, index: usize, fit: &Fit<'_>) -> f64 {
        let variance = self.covariance.at(UNKNOWNS * index + 2, UNKNOWNS * index + 2);
        let sd = (variance / (1.0 - fit.less_of_width() * variance)).sqrt();
        (UNITS[2] * sd).exp().min(WIDEST * (-self.state.touches[index].form.log_width).exp())
    }
}

impl Fit<'_> {
    /// By how much the tails of the prior of the width are less precise than its middle, in its unit.
    fn less_of_width(&self) -> f64 {
        let [(scale, _), ..] = self.scales();
        (2.0 / PI - 1.0 / (WIDTH_TAIL * WIDTH_TAIL)) / (scale * scale)
    }
}

/// A tensor that raises the conductance in every direction, as near as possible to one that may not.
fn definite([a, b]: Point2) -> Point2 {
    let size = a.hypot(b).max(1.0);
    [a / size, b / size]
}

/// The derivatives of the values by the unknowns of a touch, in their units.
pub(super) fn derivatives((touch, response): (&Touch, &Response)) -> [Vec<f64>; UNKNOWNS] {
    const { assert!(COLUMNS == UNKNOWNS) };
    let strength = touch.log_strength.exp();
    let scaled = |column: &[f64], unknown: usize| -> Vec<f64> {
        column.iter().map(|value| strength * UNITS[unknown] * value).collect()
    };
    let [even, first, second, by_form @ ..] = &response.columns;
    let mut whole = scaled(even, 5);
    add_scaled(&mut whole, strength * UNITS[5] * touch.uneven[0], first);
    add_scaled(&mut whole, strength * UNITS[5] * touch.uneven[1], second);
    let by_form: [Vec<f64>; 5] = std::array::from_fn(|unknown| scaled(&by_form[unknown], unknown));
    let [a, b, c, d, e] = by_form;
    [a, b, c, d, e, whole, scaled(first, 6), scaled(second, 7)]
}

/// Subtracts what a touch explains.
fn subtract(values: &mut [f64], touch: &Touch, response: &Response) {
    add(values, -touch.log_strength.exp(), touch, response);
}

/// Adds it again.
fn restore(values: &mut [f64], touch: &Touch, response: &Response) {
    add(values, touch.log_strength.exp(), touch, response);
}

fn add(values: &mut [f64], strength: f64, touch: &Touch, response: &Response) {
    let [even, first, second, ..] = &response.columns;
    add_scaled(values, strength, even);
    add_scaled(values, strength * touch.uneven[0], first);
    add_scaled(values, strength * touch.uneven[1], second);
}
