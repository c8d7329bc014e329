//! A layout of electrodes on candidate places, and what a move does to its bound.

use super::fields::{Fields, PressFields};
use super::information::{Change, LANES, Readings, Rest, position_sd_m};
use super::local::COMPONENTS;
use super::{Objective, OptimiseError};

/// The bound of a press that no reading locates: larger than any other, and finite, so that a search finds out of it, m.
const UNLOCATED_M: f64 = 1.0;

/// Electrodes at candidates.
pub(super) struct Layout<'a> {
    fields: &'a Fields,
    readings: &'a Readings,
    exponent: i32,
    chosen: Vec<usize>,
    presses: Vec<PressState>,
    /// The presses, the least certain first: a bad move shows there.
    order: Vec<usize>,
    /// Sum of the powers of the standard deviations.
    total: f64,
}

/// What the electrodes read of a press.
struct PressState {
    /// The electrodes' fields around the press.
    fields: Vec<[f32; COMPONENTS]>,
    /// The change of the transfer impedance of each pair by each parameter.
    change: Vec<Change>,
    weight: f64,
    /// The power of the weighted standard deviation.
    power: f64,
}

/// A change of a layout.
#[derive(Debug, Clone, Copy)]
pub(super) enum Move {
    /// An electrode goes to a candidate.
    To {
        /// The electrode's number.
        electrode: usize,
        /// The candidate.
        candidate: usize,
    },
    /// Two electrodes exchange their numbers.
    Swap(usize, usize),
}

impl<'a> Layout<'a> {
    pub(super) fn new(fields: &'a Fields, readings: &'a Readings, objective: Objective, chosen: Vec<usize>) -> Self {
        let weights = vec![1.0; fields.presses().len()];
        Self::weighted(fields, readings, objective, chosen, &weights)
    }

    /// The same with a factor for the bound of each press.
    pub(super) fn weighted(
        fields: &'a Fields,
        readings: &'a Readings,
        objective: Objective,
        chosen: Vec<usize>,
        weights: &[f64],
    ) -> Self {
        let rest = readings.rest(&fields.impedance_ohm, &chosen);
        let exponent = objective.exponent();
        let state = |(press, &weight): (&PressFields, &f64)| {
            let mut state = PressState::new(press, &chosen, weight);
            state.power = state.power_of(readings, &rest, exponent);
            state
        };
        let presses: Vec<PressState> = fields.presses().iter().zip(weights).map(state).collect();
        let total = presses.iter().map(|press| press.power).sum();
        let mut layout =
            Layout { order: (0..presses.len()).collect(), fields, readings, exponent, chosen, presses, total };
        layout.sort();
        layout
    }

    pub(super) fn chosen(&self) -> &[usize] {
        &self.chosen
    }

    /// The generalised mean of the standard deviations, m.
    pub(super) fn objective_m(&self) -> f64 {
        (self.total / self.presses.len() as f64).powf(1.0 / f64::from(self.exponent))
    }

    /// For each press the change of the transfer impedance of each pair of electrodes by each parameter.
    pub(super) fn changes(&self) -> impl Iterator<Item = &[Change]> {
        self.presses.iter().map(|press| &press.change[..])
    }

    /// The untouched frame.
    pub(super) fn rest(&self) -> Rest {
        self.readings.rest(&self.fields.impedance_ohm, &self.chosen)
    }

    /// The bound at each press, m.
    pub(super) fn bounds_m(&self) -> Vec<f64> {
        let rest = self.rest();
        self.presses.iter().map(|press| position_sd_m(&self.readings.information(&press.change, &rest))).collect()
    }

    /// # Errors
    /// A press that no reading locates.
    pub(super) fn check(&self) -> Result<(), OptimiseError> {
        match self.bounds_m().iter().position(|&bound_m| bound_m >= UNLOCATED_M) {
            Some(press) => Err(OptimiseError::NoCurrent { place_m: self.fields.presses()[press].place_m }),
            None => Ok(()),
        }
    }

    /// Makes a move if the objective does not exceed a limit, m; returns whether it did.
    pub(super) fn try_move(&mut self, change: Move, limit_m: f64) -> bool {
        let most = limit_m.powi(self.exponent) * self.presses.len() as f64;
        let before = self.chosen.clone();
        apply(&mut self.chosen, change);
        let rest = self.rest();
        let (mut total, mut done, mut powers) = (0.0, 0, Vec::with_capacity(self.presses.len()));
        for &press in &self.order {
            let cells = &self.fields.presses()[press];
            let state = &mut self.presses[press];
            state.apply(cells, change);
            powers.push(state.power_of(self.readings, &rest, self.exponent));
            total += powers[done];
            done += 1;
            if total.is_nan() || total > most {
                break;
            }
        }
        if total <= most {
            self.order.iter().zip(&powers).for_each(|(&press, &power)| self.presses[press].power = power);
            self.total = total;
            self.sort();
            return true;
        }
        let back = match change {
            Move::To { electrode, .. } => Move::To { electrode, candidate: before[electrode] },
            swap => swap,
        };
        for &press in &self.order[..done] {
            self.presses[press].apply(&self.fields.presses()[press], back);
        }
        self.chosen = before;
        false
    }

    fn sort(&mut self) {
        let presses = &self.presses;
        self.order.sort_by(|&a, &b| presses[b].power.total_cmp(&presses[a].power));
    }
}

fn apply(chosen: &mut [usize], change: Move) {
    match change {
        Move::To { electrode, candidate } => chosen[electrode] = candidate,
        Move::Swap(a, b) => chosen.swap(a, b),
    }
}

impl PressState {
    fn new(press: &PressFields, chosen: &[usize], weight: f64) -> Self {
        let count = chosen.len();
        let mut state = PressState {
            fields: vec![[0.0; COMPONENTS]; count],
            change: vec![[0.0; LANES]; count * count],
            weight,
            power: 0.0,
        };
        for (electrode, &candidate) in chosen.iter().enumerate() {
            state.apply(press, Move::To { electrode, candidate });
        }
        state
    }

    fn count(&self) -> usize {
        self.change.len().isqrt()
    }

    fn power_of(&self, readings: &Readings, rest: &Rest, exponent: i32) -> f64 {
        (self.weight * position_sd_m(&readings.information(&self.change, rest)).min(UNLOCATED_M)).powi(exponent)
    }

    fn apply(&mut self, press: &PressFields, change: Move) {
        let count = self.count();
        match change {
            Move::To { electrode, candidate } => {
                self.fields[electrode] = *press.field(candidate);
                let answered = press.answered(&self.fields[electrode]);
                let of = |field: &[f32; COMPONENTS]| {
                    let mut sum = [0.0f32; LANES];
                    for (values, &part) in answered.iter().zip(field) {
                        sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value * part);
                    }
                    sum
                };
                let row: Vec<Change> = self.fields.iter().map(of).collect();
                for (other, &change) in row.iter().enumerate() {
                    self.change[electrode * count + other] = change;
                    self.change[other * count + electrode] = change;
                }
            }
            Move::Swap(a, b) => {
                self.fields.swap(a, b);
                for other in 0..count {
                    self.change.swap(a * count + other, b * count + other);
                }
                self.change.chunks_exact_mut(count).for_each(|row| row.swap(a, b));
            }
        }
    }
}
