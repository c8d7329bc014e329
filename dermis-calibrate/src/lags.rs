//! Channels that are recorded rows late.

use crate::ridge::Regression;
use dermis::protocol::Protocol;
use faer::{Mat, Side};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Largest lag that is looked for, rows.
pub(crate) const MOST_LAG: i32 = 3;
/// Components of the other channels that predict a channel.
const COMPONENTS: usize = 20;
/// Ridge of the regressions.
const RIDGE: f64 = 1e-3;
/// Fewest rows from which lags are estimated.
const FEWEST_ROWS: usize = 60;
/// A channel is late if the part of its variance that a lag leaves unexplained is smaller than that of lag 0 by this
/// factor.
const RATIO: f64 = 0.9;
/// A channel of which no lag explains more than this part of the variance, and this many standard deviations of what chance
/// explains, `1 / sqrt(rows)`, follows the others of its drive.
const WEAK: (f64, f64) = (0.05, 2.0);

/// How well the other channels of each row predict one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Evidence {
    /// Lag of the best prediction.
    lag: i32,
    /// Part of the variance that it explains.
    best: f64,
    /// Part of the variance that the same row explains.
    at_zero: f64,
}

/// The number of rows by which each channel is late: its value for row `i` is found in row `i + lag`. All zero where there
/// are too few rows.
///
/// Each channel is predicted from the leading components of the channels of all other drives, of rows shifted by -3 to 3,
/// with a ridge regression on one half of the rows that is tested on the other (cross-validation). The presses must be
/// in the order of recording. `values` are in units of the channels, rows x channels.
pub(crate) fn channel_lags(values: &[Vec<f64>], protocol: &Protocol) -> Vec<i32> {
    let channels = protocol.channel_count();
    if values.len() < FEWEST_ROWS {
        return vec![0; channels];
    }
    let mut drives: BTreeMap<[usize; 2], Vec<usize>> = BTreeMap::new();
    for (channel, pair) in protocol.channels().iter().enumerate() {
        let [a, b] = pair.drive;
        drives.entry([a.min(b), a.max(b)]).or_default().push(channel);
    }
    let covariance = covariance(values);
    // Late channels are no good predictors: the second pass leaves them out.
    let first = lags_without(values, &covariance, &drives, &[]);
    let late: Vec<usize> = (0..channels).filter(|&channel| first[channel] != 0).collect();
    if late.is_empty() { first } else { lags_without(values, &covariance, &drives, &late) }
}

/// The lags of all channels, without the use of some as predictors.
fn lags_without(
    values: &[Vec<f64>],
    covariance: &Mat<f64>,
    drives: &BTreeMap<[usize; 2], Vec<usize>>,
    late: &[usize],
) -> Vec<i32> {
    let found: Vec<(&Vec<usize>, Vec<Evidence>)> = drives
        .values()
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|own| {
            let components = components(values, covariance, &[own, late].concat());
            let evidence = own.iter().map(|&channel| evidence(values, &components, channel)).collect();
            (own, evidence)
        })
        .collect();
    let mut lags = vec![0; values[0].len()];
    for (own, evidence) in found {
        for (channel, lag) in own.iter().zip(decide(&evidence, WEAK.0 + WEAK.1 / (values.len() as f64).sqrt())) {
            lags[*channel] = lag;
        }
    }
    lags
}

/// The lags of the channels of one drive: those of which no lag explains the part `weak` follow the majority of the others.
fn decide(evidence: &[Evidence], weak: f64) -> Vec<i32> {
    let own = |one: &Evidence| if 1.0 - one.best < RATIO * (1.0 - one.at_zero) { one.lag } else { 0 };
    let mut votes: BTreeMap<i32, usize> = BTreeMap::new();
    for one in evidence.iter().filter(|one| one.best > weak) {
        *votes.entry(own(one)).or_default() += 1;
    }
    let strong: usize = votes.values().sum();
    let majority = votes.into_iter().max_by_key(|(_, count)| *count).filter(|(_, count)| 2 * count > strong);
    let majority = majority.map_or(0, |(lag, _)| lag);
    evidence.iter().map(|one| if one.best > weak { own(one) } else { majority }).collect()
}

fn covariance(values: &[Vec<f64>]) -> Mat<f64> {
    let (rows, channels) = (values.len(), values[0].len());
    let means: Vec<f64> = (0..channels).map(|j| values.iter().map(|row| row[j]).sum::<f64>() / rows as f64).collect();
    let centred = Mat::from_fn(rows, channels, |i, j| values[i][j] - means[j]);
    centred.transpose() * &centred
}

/// The leading components of all channels but some, rows x components.
fn components(values: &[Vec<f64>], covariance: &Mat<f64>, without: &[usize]) -> Mat<f64> {
    let others: Vec<usize> = (0..values[0].len()).filter(|channel| !without.contains(channel)).collect();
    let count = others.len();
    let part = Mat::from_fn(count, count, |i, j| covariance[(others[i], others[j])]);
    let Ok(eigen) = part.self_adjoint_eigen(Side::Lower) else { return Mat::zeros(values.len(), 0) };
    let own = Mat::from_fn(values.len(), count, |i, j| values[i][others[j]]);
    let leading = COMPONENTS.min(count);
    own * Mat::from_fn(count, leading, |i, j| eigen.U()[(i, count - 1 - j)])
}

fn evidence(values: &[Vec<f64>], components: &Mat<f64>, channel: usize) -> Evidence {
    let explained = |lag: i32| explained(values, components, channel, lag);
    let at_zero = explained(0);
    let mut evidence = Evidence { lag: 0, best: at_zero, at_zero };
    for lag in (-MOST_LAG..=MOST_LAG).filter(|lag| *lag != 0) {
        let value = explained(lag);
        if value > evidence.best {
            evidence = Evidence { lag, best: value, at_zero };
        }
    }
    evidence
}

/// The part of the variance of a channel that the components of the row `lag` rows before it explain.
fn explained(values: &[Vec<f64>], components: &Mat<f64>, channel: usize, lag: i32) -> f64 {
    let rows = values.len() as i32;
    let first = lag.max(0);
    let last = rows + lag.min(0);
    let own: Vec<f64> = (first..last).map(|row| values[row as usize][channel]).collect();
    let source = |row: usize| (first - lag) as usize + row;
    let half = own.len() / 2;
    let (mut residual, mut total) = (0.0, 0.0);
    for (fit, test) in [(0..half, half..own.len()), (half..own.len(), 0..half)] {
        let mean = fit.clone().map(|row| own[row]).sum::<f64>() / fit.len() as f64;
        let input = Mat::from_fn(fit.len(), components.ncols(), |i, k| components[(source(fit.start + i), k)]);
        let target = Mat::from_fn(fit.len(), 1, |i, _| own[fit.start + i]);
        let Some(regression) = Regression::fit(&input, &target, RIDGE) else { return 0.0 };
        let weights = regression.weights.col(0);
        for row in test {
            let product = |k: usize| weights[k] * components[(source(row), k)];
            let predicted = regression.offsets[0] + (0..components.ncols()).map(product).sum::<f64>();
            residual += (own[row] - predicted).powi(2);
            total += (own[row] - mean).powi(2);
        }
    }
    if total > 0.0 { 1.0 - residual / total } else { 0.0 }
}
