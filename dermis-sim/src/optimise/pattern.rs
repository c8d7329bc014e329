//! Which readings to take, for a number of readings.

use super::information::{Readings, Rest, Square, position_sd_m};
use super::layout::Layout;
use super::touch::{PARAMETERS, UNKNOWNS};
use super::{Objective, OptimiseError};
use dermis::linalg::{Cholesky, Matrix};
use dermis::protocol::Channel;
use rayon::prelude::*;

/// Fewest readings of a press: a value for each unknown, and a current.
pub(super) const MIN_SLOTS: usize = UNKNOWNS + 1;

/// Presses whose worth one thread sums.
const PRESSES: usize = 32;

/// Readings of a protocol, some of them taken.
struct Pattern<'a> {
    readings: &'a Readings,
    rest: Rest,
    exponent: i32,
    /// For each press the change of each reading by each parameter.
    rows: Vec<Vec<[f64; PARAMETERS]>>,
    taken: Vec<bool>,
}

/// The readings of a layout that are worth most, in the protocol's order: all of them without those that are worth least,
/// one by one; then exchanges while they help (Fedorov, Theory of Optimal Experiments, 1972). `slots` counts values and,
/// for each drive in use, the reading of its current. `left_out` is called with the share of the work that is done, whenever
/// a reading is left out.
///
/// # Errors
/// Too few or too many slots.
pub(super) fn select(
    layout: &Layout<'_>,
    readings: &Readings,
    objective: Objective,
    slots: usize,
    mut left_out: impl FnMut(f64),
) -> Result<Vec<Channel>, OptimiseError> {
    let channels = readings.channels();
    let most = channels.len() + readings.drive_count;
    if slots < MIN_SLOTS {
        return Err(OptimiseError::TooFewSlots { slots, least: MIN_SLOTS });
    }
    if slots > most {
        return Err(OptimiseError::TooManySlots { slots, most });
    }
    let rows = layout.changes().map(|change| readings.rows(change));
    let exponent = objective.exponent();
    let mut pattern =
        Pattern { rows: rows.collect(), readings, rest: layout.rest(), exponent, taken: vec![true; channels.len()] };
    while pattern.slots() > slots {
        let Some(least) = pattern.least(&pattern.worth()) else { break };
        pattern.taken[least] = false;
        // The last reading of a drive saves that of its current, too.
        left_out(((most - pattern.slots()) as f64 / (most - slots) as f64).min(1.0));
    }
    pattern.exchange(slots);
    if !pattern.objective().is_finite() {
        return Err(OptimiseError::TooFewSlots { slots, least: slots + 1 });
    }
    Ok(channels.iter().zip(&pattern.taken).filter(|(_, taken)| **taken).map(|(channel, _)| *channel).collect())
}

impl Pattern<'_> {
    /// Values and currents.
    fn slots(&self) -> usize {
        let mut drives = vec![false; self.readings.drive_count];
        let taken = self.readings.drive_of.iter().zip(&self.taken).filter(|(_, taken)| **taken);
        let values = taken.map(|(&drive, _)| drives[drive] = true).count();
        values + drives.iter().filter(|drive| **drive).count()
    }

    /// For each drive the sum of `z row` over its readings of a press, and `R_ref^2 + z' z`.
    fn along(&self, rows: &[[f64; PARAMETERS]]) -> Vec<([f64; PARAMETERS], f64)> {
        let base = self.rest.values_ohm.iter().zip(&self.readings.drive_of);
        let mut scales = self.rest.scales.clone();
        for ((value, &drive), taken) in base.zip(&self.taken) {
            if !taken {
                scales[drive] -= value * value;
            }
        }
        let mut along: Vec<_> = scales.into_iter().map(|scale| ([0.0; PARAMETERS], scale)).collect();
        for (channel, row) in rows.iter().enumerate().filter(|(channel, _)| self.taken[*channel]) {
            let value = self.rest.values_ohm[channel];
            let sum = &mut along[self.readings.drive_of[channel]].0;
            sum.iter_mut().zip(row).for_each(|(sum, change)| *sum += value * change);
        }
        along
    }

    fn information(&self, rows: &[[f64; PARAMETERS]], along: &[([f64; PARAMETERS], f64)]) -> Square {
        let mut all = [[0.0; PARAMETERS]; PARAMETERS];
        let taken = rows.iter().zip(&self.taken).filter(|(_, taken)| **taken).map(|(row, _)| (row, 1.0));
        for (row, factor) in taken.chain(along.iter().map(|(a, scale)| (a, -1.0 / scale))) {
            for i in 0..PARAMETERS {
                for j in 0..PARAMETERS {
                    all[i][j] += factor * row[i] * row[j];
                }
            }
        }
        self.readings.with_prior(all, self.rest.sd_ohm)
    }

    fn objective(&self) -> f64 {
        let power = |rows: &Vec<[f64; PARAMETERS]>| {
            position_sd_m(&self.information(rows, &self.along(rows))).powi(self.exponent)
        };
        self.rows.iter().map(power).sum()
    }

    /// For each reading the derivative of the objective by its weight, with the sign of a gain: `b' G b` summed over the
    /// presses, with `G = F^-1 E F^-1` for the block `E` of the position and `b` the reading's change without what the
    /// noise of its current takes: `b = row - a z / (R_ref^2 + z' z)`.
    fn worth(&self) -> Vec<f64> {
        // Parts of a fixed size, summed in their order: the same bits on any number of threads.
        let parts: Vec<Vec<f64>> = self.rows.par_chunks(PRESSES).map(|presses| self.worth_for(presses)).collect();
        let mut worth = vec![0.0; self.taken.len()];
        for part in parts {
            worth.iter_mut().zip(part).for_each(|(sum, value)| *sum += value);
        }
        worth
    }

    /// The worth for some presses.
    fn worth_for(&self, presses: &[Vec<[f64; PARAMETERS]>]) -> Vec<f64> {
        let mut worth = vec![0.0; self.taken.len()];
        for rows in presses {
            let along = self.along(rows);
            let information = self.information(rows, &along);
            let sd_m = position_sd_m(&information);
            let Some(gain) = gain(&information).filter(|_| sd_m.is_finite()) else { continue };
            let factor = sd_m.powi(self.exponent - 2);
            for (channel, row) in rows.iter().enumerate() {
                let (a, scale) = &along[self.readings.drive_of[channel]];
                let share = self.rest.values_ohm[channel] / scale;
                let mut own = *row;
                own.iter_mut().zip(a).for_each(|(own, a)| *own -= share * a);
                let of = |i: usize| own[i] * (0..PARAMETERS).map(|j| gain[i][j] * own[j]).sum::<f64>();
                worth[channel] += factor * (0..PARAMETERS).map(of).sum::<f64>();
            }
        }
        worth
    }

    fn least(&self, worth: &[f64]) -> Option<usize> {
        (0..worth.len()).filter(|&channel| self.taken[channel]).min_by(|&a, &b| worth[a].total_cmp(&worth[b]))
    }

    /// Exchanges the reading that is worth least for the one that would be worth most, while the objective falls.
    fn exchange(&mut self, slots: usize) {
        let mut best = self.objective();
        for _ in 0..self.taken.len() {
            let worth = self.worth();
            let Some(out) = self.least(&worth) else { return };
            self.taken[out] = false;
            let free = |&channel: &usize| !self.taken[channel] && channel != out;
            let into = (0..worth.len()).filter(free).max_by(|&a, &b| worth[a].total_cmp(&worth[b]));
            let improved = into.is_some_and(|into| {
                self.taken[into] = true;
                let next = self.objective();
                let is_better = self.slots() <= slots && next < best * (1.0 - 1e-9);
                if is_better {
                    best = next
                } else {
                    self.taken[into] = false
                }
                is_better
            });
            if !improved {
                self.taken[out] = true;
                return;
            }
        }
    }
}

/// `F^-1 E F^-1`.
fn gain(information: &Square) -> Option<Square> {
    let mut matrix = Matrix::zeros(PARAMETERS, PARAMETERS);
    matrix.values.copy_from_slice(information.as_flattened());
    let inverse = Cholesky::new(&matrix).ok()?.inverse();
    let mut gain = [[0.0; PARAMETERS]; PARAMETERS];
    for (i, row) in gain.iter_mut().enumerate() {
        for (j, value) in row.iter_mut().enumerate() {
            *value = (0..2).map(|k| inverse.at(i, k) * inverse.at(k, j)).sum();
        }
    }
    Some(gain)
}
