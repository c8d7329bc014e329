//! Touches of any inner form: as a capsule with squares whose conductance changes each by its own amount.
//!
//! A palm on patches, the rim of a cup or a corner is one object, but no capsule: what a capsule leaves of its change is a share of
//! the change, in few directions, and one more capsule explains a part of it. Here the density of a touch is `rho (1 + u_i)` on
//! square `i`, where the `u_i` are independent with standard deviation 1. With the capsule's residuals `r` and the changes `T` by
//! the squares, whitened and with the variance `v` of a value by noise and misfit, the sum of squares becomes
//!
//! `r' (I + T T' / v)^-1 r = r' r - h' (T' T + v I)^-1 h`, with `h = T' r`,
//!
//! and the determinant of `I + T' T / v` is what the freedom costs (the matrix inversion and determinant lemmas; Rasmussen and
//! Williams, 2006, "Gaussian Processes for Machine Learning", A.3). The place of the touch is that of the capsule, which is known
//! less well beside squares of any amount.

use super::fit::{Fit, Fitted, JOINED_M, SPLIT_M, State, Touch, UNITS, WIDEST, derivatives};
use super::form::{Density, Form};
use crate::estimate::least_squares::LeastSquares;
use crate::geom::Point2;
use crate::linalg::{Cholesky, Matrix, add_scaled, dot, gram, products};

/// The variance of a value follows from the sum of squares, and this from it, so many times.
const PASSES: usize = 4;

/// The most probable inner form of a touch.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FreeForm {
    /// Twice the negative logarithm of the probability of the values and the touch, as that of a [`Fitted`].
    pub evidence: f64,
    /// The probability of this form, of which the rest is that of a capsule.
    pub share: f64,
    /// From the place of the capsule to the most probable one beside the squares, m.
    pub step: Point2,
    /// The covariance of that place in the axes of the place, m2: of the first axis, of both, of the second.
    pub covariance_m2: [f64; 3],
}

impl FreeForm {
    /// The inner form of the only touch of a fit, on squares of an edge.
    pub(super) fn of(fit: &Fit<'_>, state: &State, size_m: f64) -> Option<Self> {
        let [touch] = state.touches[..] else { return None };
        let strength = touch.log_strength.exp();
        let mut squares = fit.responses.squares(&touch.place, &touch.form, size_m);
        squares.iter_mut().flatten().for_each(|value| *value *= strength);
        let changes: Vec<&[f64]> = squares.iter().map(Vec::as_slice).collect();
        let (gram, product) = (gram(&changes), products(&changes, &state.residuals));
        let unknowns = derivatives((&touch, &state.responses[0]));
        let total = state.sum_of_squares();

        let (mut square, mut found) = (total, None);
        for _ in 0..PASSES {
            let variance = fit.variance_of(square);
            let factor = beside(&gram, variance)?;
            square = total - dot(&factor.solve(&product), &product);
            found = Some((variance, factor));
        }
        let (variance, factor) = found?;

        // The information about the capsule, which the squares hide a part of.
        let crossed = unknowns.each_ref().map(|unknown| products(&changes, unknown));
        let hidden = crossed.each_ref().map(|crossed| factor.solve(crossed));
        let (mut information, weight) = (fit.information(state), fit.weight_at(state));
        for (i, one) in unknowns.iter().enumerate() {
            for (j, other) in unknowns.iter().enumerate() {
                let plain = dot(one, other);
                *information.at_mut(i, j) += (plain - dot(&hidden[i], &crossed[j])) / variance - weight * plain;
            }
        }
        let informed = Cholesky::determined(&information).ok()?;
        let determinant = log_determinant(&factor, squares.len(), variance);

        // The step to the most probable capsule beside its squares.
        let mut right = fit.stepped(state).right;
        for (right, (unknown, hidden)) in right.iter_mut().zip(unknowns.iter().zip(&hidden)) {
            let plain = dot(unknown, &state.residuals);
            *right += (plain - dot(hidden, &product)) / variance - weight * plain;
        }
        let mut step = informed.solve(&right);
        fit.limit(state, &mut step);
        let inverse = informed.inverse();
        let covariance = |i: usize, j: usize| UNITS[i] * UNITS[j] * inverse.at(i, j);
        let cost = fit.cost_of(square) + fit.prior(&touch);
        Some(FreeForm {
            evidence: cost + determinant + informed.log_determinant() + fit.constant(0),
            share: 1.0,
            step: [UNITS[0] * step[0], UNITS[1] * step[1]],
            covariance_m2: [covariance(0, 0), covariance(0, 1), covariance(1, 1)],
        })
    }
}

impl FreeForm {
    /// The covariance of the place of a touch with the covariance that it has as a capsule.
    pub(super) fn mixed(&self, capsule: [f64; 3]) -> [f64; 3] {
        let ([x, y], share) = (self.step, self.share);
        let between = [x * x, x * y, y * y].map(|square| share * (1.0 - share) * square);
        std::array::from_fn(|part| (1.0 - share) * capsule[part] + share * self.covariance_m2[part] + between[part])
    }

    /// From the place of the capsule to the mean place, m.
    pub(super) fn mean_step(&self) -> Point2 {
        self.step.map(|part| self.share * part)
    }
}

/// The factor of `T' T + v I`.
fn beside(gram: &Matrix, variance: f64) -> Option<Cholesky> {
    let mut regular = gram.clone();
    (0..regular.rows).for_each(|index| *regular.at_mut(index, index) += variance);
    Cholesky::determined(&regular).ok()
}

/// The logarithm of the determinant of `I + T T' / v` from that factor.
fn log_determinant(factor: &Cholesky, count: usize, variance: f64) -> f64 {
    factor.log_determinant() - count as f64 * variance.ln()
}

impl Fit<'_> {
    /// Some touches with those of any form that are more probable than the capsules in their places.
    pub(super) fn of_any_form(&self, mut best: Fitted) -> Fitted {
        let mut left: Vec<usize> = (0..best.state.touches.len()).rev().collect();
        let mut whole: Vec<(Vec<usize>, Touch, FreeForm)> = Vec::new();
        while let Some(first) = left.pop() {
            let mut group = vec![first];
            while let Some(at) = left.iter().position(|&one| group.iter().any(|&other| self.is_near(&best, one, other)))
            {
                group.push(left.remove(at));
            }
            let Some((touch, mut free, before)) = self.as_one(&best, &group) else { continue };
            let share = 1.0 / (1.0 + (0.5 * (free.evidence - before)).exp());
            if let [index] = group[..] {
                free.share = share;
                best.free[index] = Some(free);
            } else if free.evidence < before {
                whole.push((group, touch, free));
            } else {
                // One of them is there in any case: the strongest.
                let strength = |index: &usize| best.state.touches[*index].log_strength;
                let strongest = group.iter().copied().max_by(|a, b| strength(a).total_cmp(&strength(b)));
                group
                    .iter()
                    .filter(|&&index| Some(index) != strongest)
                    .for_each(|&index| best.apart[index] = 1.0 - share);
            }
        }
        if whole.is_empty() {
            return best;
        }
        let is_kept = |index: &usize| !whole.iter().any(|(group, ..)| group.contains(index));
        let kept: Vec<usize> = (0..best.state.touches.len()).filter(is_kept).collect();
        let touches =
            kept.iter().map(|&index| best.state.touches[index]).chain(whole.iter().map(|(_, touch, _)| *touch));
        let Some(mut joined) = self.fitted(self.state(touches.collect())) else { return best };
        joined.apart = kept.iter().map(|&index| best.apart[index]).chain(whole.iter().map(|_| 1.0)).collect();
        joined.free = kept
            .iter()
            .map(|&index| best.free[index].take())
            .chain(whole.into_iter().map(|(.., free)| Some(free)))
            .collect();
        joined
    }

    fn is_near(&self, fitted: &Fitted, a: usize, b: usize) -> bool {
        let [a, b] = [a, b].map(|index| &fitted.state.touches[index].place);
        self.responses.space().distance_m(a, b) < JOINED_M
    }

    /// Some touches as one of any form, with the evidence of the touches themselves. `None` for one that is so short that a capsule
    /// has all that the frame tells of its form.
    fn as_one(&self, from: &Fitted, group: &[usize]) -> Option<(Touch, FreeForm, f64)> {
        let state = &from.state;
        let parts: Vec<Touch> = group.iter().map(|&index| state.touches[index]).collect();
        if let [touch] = parts[..]
            && Density::new(&touch.form, self.responses.usual_m()).half_length_m < SPLIT_M
        {
            return None;
        }
        let (own, others) = self.part(state, group);
        let local = Fit { values: &own, others, ..*self };
        let old = local.chosen(state, group);
        let before = local.as_it_is(&old)?;
        let mut starts = vec![old];
        if parts.len() > 1 {
            let start = local.start(vec![self.moments(&parts)])?;
            starts = local.fitted(start.clone()).into_iter().map(|fitted| fitted.state).chain([start]).collect();
        }
        let free = |state: State| FreeForm::of(&local, &state, self.options.inner_form_m).map(|free| (state, free));
        let all = starts.into_iter().filter_map(free);
        let (state, free) = all.min_by(|a, b| a.1.evidence.total_cmp(&b.1.evidence))?;
        Some((state.touches[0], free, before))
    }

    /// The touch with the mean and the variances of some others.
    fn moments(&self, parts: &[Touch]) -> Touch {
        let (space, usual_m) = (self.responses.space(), self.responses.usual_m());
        let strongest = parts.iter().max_by(|a, b| a.log_strength.total_cmp(&b.log_strength)).expect("some touches");
        let total: f64 = parts.iter().map(|part| part.log_strength.exp()).sum();
        let (mut mean, mut squares) = ([0.0; 2], [0.0; 3]);
        for part in parts {
            let share = part.log_strength.exp() / total;
            let [x, y] = space.step(&strongest.place, &part.place);
            let turned = part.form.turned(space.turn(&part.place, &strongest.place));
            let density = Density::new(&turned, usual_m);
            let ([c, s], along_m2) = (density.axis, density.half_length_m.powi(2) / 3.0);
            add_scaled(&mut mean, share, &[x, y]);
            let own =
                [along_m2 * c * c + density.variance_m2, along_m2 * c * s, along_m2 * s * s + density.variance_m2];
            add_scaled(&mut squares, share, &[own[0] + x * x, own[1] + x * y, own[2] + y * y]);
        }
        let [a, b, c] =
            [squares[0] - mean[0] * mean[0], squares[1] - mean[0] * mean[1], squares[2] - mean[1] * mean[1]];
        // The difference of both variances is that along a segment.
        let (half, sum) = ((0.5 * (a - c)).hypot(b), 0.5 * (a + c));
        let angle = 0.5 * b.atan2(0.5 * (a - c));
        let length_m = (6.0 * half).sqrt();
        let form = Form::of_segment([length_m * angle.cos(), length_m * angle.sin()], usual_m);
        let log_width = (0.5 * sum.ln() - usual_m.ln()).clamp(-WIDEST.ln(), WIDEST.ln());
        Touch { form: Form { log_width, ..form }, ..Touch::at(space.walk(&strongest.place, mean), strongest.of) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_sim::random::{sample_rng, standard_normal};

    /// By the squares, and by the covariance of all values.
    #[test]
    fn squares_and_values_give_the_same_probability() {
        const VALUES: usize = 12;
        let mut rng = sample_rng(1, 0);
        let mut draw = || -> Vec<f64> { (0..VALUES).map(|_| standard_normal(&mut rng)).collect() };
        let (changes, residuals, variance) = ([draw(), draw(), draw()], draw(), 0.7);
        let columns: Vec<&[f64]> = changes.iter().map(Vec::as_slice).collect();
        let (gram, product) = (gram(&columns), products(&columns, &residuals));
        let factor = beside(&gram, variance).unwrap();
        let square = dot(&residuals, &residuals) - dot(&factor.solve(&product), &product);

        let mut covariance = Matrix::zeros(VALUES, VALUES);
        for i in 0..VALUES {
            for j in 0..VALUES {
                let of_squares: f64 = changes.iter().map(|change| change[i] * change[j]).sum();
                *covariance.at_mut(i, j) = of_squares / variance + f64::from(u8::from(i == j));
            }
        }
        let whole = Cholesky::new(&covariance).unwrap();
        assert!((square - dot(&residuals, &whole.solve(&residuals))).abs() < 1e-12);
        assert!((log_determinant(&factor, 3, variance) - whole.log_determinant()).abs() < 1e-12);
    }
}
