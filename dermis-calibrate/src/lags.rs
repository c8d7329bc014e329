//! Channels that are recorded rows late.

use crate::ridge::Regression;
use dermis::protocol::Protocol;
use faer::{Mat, Side};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Largest lag that is looked for, rows.
pub(crate) const MAX_LAG: i32 = 3;
/// Components of the other channels that predict a channel.
const COMPONENTS: usize = 20;
/// Ridge of the regressions.
const RIDGE: f64 = 1e-3;
/// Blocks of rows of the cross-validation.
const BLOCKS: usize = 10;
/// Fewest rows from which lags are estimated.
const MIN_ROWS: usize = 60;
/// A channel is late if the part of its variance that a lag leaves unexplained is smaller than that of lag 0 by this
/// factor.
const RATIO: f64 = 0.9;
/// A channel of which no lag explains more than this part of the variance, and this many standard deviations of what
/// chance explains, `1 / sqrt(rows)`, follows the others of its drive.
const WEAK: (f64, f64) = (0.05, 2.0);

/// A channel that shares its lag with less than this part of the channels of its drive, or with fewer than two others ...
const FEW: f64 = 0.25;
/// ... must be explained by this part at that lag, which leaves unexplained at most this part of what lag 0 leaves and explains
/// this much more: presses next to each other look alike, too. The last is not asked for a lag of [`MIN_AGREED`] other channels
/// of the recording.
const ALONE: (f64, f64, f64) = (0.3, 0.6, 0.25);
/// So must every channel where rows are this much like the next ones (their correlation), as while a finger slides or a press is
/// held: every lag explains nearly all there.
const SMOOTH: f64 = 0.5;
/// Fewest channels with the same lag that tell of others.
const MIN_AGREED: usize = 3;

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

/// How well the other channels predict each channel, by the lag, and the lags that follow.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LagEvidence {
    /// For each channel the part of its variance that each lag of [`LAGS`] explains.
    pub explained: Vec<Vec<f64>>,
    /// For each channel the number of rows by which it is late.
    pub lags: Vec<i32>,
}

/// The lags that are looked for.
pub(crate) const LAGS: std::ops::RangeInclusive<i32> = -MAX_LAG..=MAX_LAG;

/// The number of rows by which each channel is late: its value for row `i` is found in row `i + lag`. All zero where
/// there are too few rows. See [`lag_evidence`].
pub(crate) fn channel_lags(values: &[Vec<f64>], protocol: &Protocol) -> Vec<i32> {
    lag_evidence(values, protocol).lags
}

/// Predicts each channel from the leading components of the channels of all other drives, of rows shifted by -3 to 3,
/// with a ridge regression on every other tenth of the rows that is tested on the others (cross-validation). The
/// presses must be in the order of recording. `values` are in units of the channels, rows x channels.
pub(crate) fn lag_evidence(values: &[Vec<f64>], protocol: &Protocol) -> LagEvidence {
    let channels = protocol.channel_count();
    if values.len() < MIN_ROWS {
        return LagEvidence { explained: Vec::new(), lags: vec![0; channels] };
    }
    let mut drives: BTreeMap<[usize; 2], Vec<usize>> = BTreeMap::new();
    for (channel, pair) in protocol.channels().iter().enumerate() {
        let [a, b] = pair.drive;
        drives.entry([a.min(b), a.max(b)]).or_default().push(channel);
    }
    let covariance = covariance(values);
    let is_smooth = correlation_of_rows(values) > SMOOTH;
    let first = lags_after(&vec![0; channels], values, &covariance, &drives, is_smooth);
    let is_any_late = first.lags.iter().any(|lag| *lag != 0);
    if is_any_late { lags_after(&first.lags, values, &covariance, &drives, is_smooth) } else { first }
}

/// The evidence for all channels, after lags that are known so far: late channels are no good predictors and are left out, and a
/// lag of [`MIN_AGREED`] channels is that of the recording, of which others need less evidence.
fn lags_after(
    before: &[i32],
    values: &[Vec<f64>],
    covariance: &Mat<f64>,
    drives: &BTreeMap<[usize; 2], Vec<usize>>,
    is_smooth: bool,
) -> LagEvidence {
    let channels = before.len();
    let late: Vec<usize> = (0..channels).filter(|&channel| before[channel] != 0).collect();
    let is_known = |lag: &i32| late.iter().filter(|&&channel| before[channel] == *lag).count() >= MIN_AGREED;
    let known: Vec<i32> = LAGS.filter(is_known).collect();
    let found: Vec<(&Vec<usize>, Vec<Vec<f64>>)> = drives
        .values()
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|own| {
            let components = components(values, covariance, &[own.as_slice(), &late].concat());
            let by_lag: Vec<Vec<f64>> = LAGS.map(|lag| explained(values, &components, own, lag)).collect();
            (own, (0..own.len()).map(|k| by_lag.iter().map(|explained| explained[k]).collect()).collect())
        })
        .collect();
    let mut evidence = LagEvidence { explained: vec![Vec::new(); channels], lags: vec![0; channels] };
    for (own, explained) in found {
        let each: Vec<Evidence> = explained.iter().map(|explained| Evidence::of(explained)).collect();
        let lags = decide(&each, WEAK.0 + WEAK.1 / (values.len() as f64).sqrt(), is_smooth, &known);
        for ((&channel, explained), lag) in own.iter().zip(explained).zip(lags) {
            evidence.explained[channel] = explained;
            evidence.lags[channel] = lag;
        }
    }
    evidence
}

impl Evidence {
    /// The best lag, if it leaves at most a part `ratio` of the variance unexplained that lag 0 leaves; else 0.
    fn own_lag(&self, ratio: f64) -> i32 {
        if 1.0 - self.best < ratio * (1.0 - self.at_zero.max(0.0)) { self.lag } else { 0 }
    }

    /// The best of the lags, by what each explains.
    fn of(explained: &[f64]) -> Self {
        let at_zero = explained[MAX_LAG as usize];
        let mut evidence = Evidence { lag: 0, best: at_zero, at_zero };
        for (lag, &value) in LAGS.zip(explained) {
            if value > evidence.best {
                evidence = Evidence { lag, best: value, at_zero };
            }
        }
        evidence
    }
}

/// The lags of the channels of one drive: those of which no lag explains the part `weak` follow the majority of the
/// others. `known` are lags of the recording.
fn decide(evidence: &[Evidence], weak: f64, is_smooth: bool, known: &[i32]) -> Vec<i32> {
    let is_strong = |one: &Evidence| one.best > weak;
    let own: Vec<i32> = evidence.iter().map(|one| if is_strong(one) { one.own_lag(RATIO) } else { 0 }).collect();
    let others = |lag: i32| own.iter().filter(|other| **other == lag).count() - 1;
    let agreed = |(one, &lag): (&Evidence, &i32)| {
        let few = others(lag) < 2 || ((others(lag) + 1) as f64) < FEW * own.len() as f64;
        let alone = lag != 0 && (few || is_smooth);
        let gains = known.contains(&lag) || one.best - one.at_zero.max(0.0) > ALONE.2;
        let is_clear = one.best >= ALONE.0 && one.own_lag(ALONE.1) == lag && gains;
        if alone && !is_clear { 0 } else { lag }
    };
    let own: Vec<i32> = evidence.iter().zip(&own).map(agreed).collect();
    let mut votes: BTreeMap<i32, usize> = BTreeMap::new();
    for (_, &lag) in evidence.iter().zip(&own).filter(|(one, _)| is_strong(one)) {
        *votes.entry(lag).or_default() += 1;
    }
    let strong: usize = votes.values().sum();
    let majority = votes
        .into_iter()
        .max_by_key(|(_, count)| *count)
        .filter(|(_, count)| 2 * count > strong && *count >= MIN_AGREED);
    let majority = majority.map_or(0, |(lag, _)| lag);
    evidence.iter().zip(own).map(|(one, own)| if is_strong(one) { own } else { majority }).collect()
}

/// The mean of each channel.
fn means(values: &[Vec<f64>]) -> Vec<f64> {
    let mean = |channel| values.iter().map(|row| row[channel]).sum::<f64>() / values.len() as f64;
    (0..values[0].len()).map(mean).collect()
}

/// The correlation of rows with the next ones, over all channels.
fn correlation_of_rows(values: &[Vec<f64>]) -> f64 {
    let means = means(values);
    let product =
        |a: &[f64], b: &[f64]| -> f64 { (0..means.len()).map(|j| (a[j] - means[j]) * (b[j] - means[j])).sum() };
    let of_next: f64 = values.windows(2).map(|pair| product(&pair[0], &pair[1])).sum();
    of_next / values.iter().map(|row| product(row, row)).sum::<f64>().max(f64::MIN_POSITIVE)
}

fn covariance(values: &[Vec<f64>]) -> Mat<f64> {
    let means = means(values);
    let centred = Mat::from_fn(values.len(), means.len(), |i, j| values[i][j] - means[j]);
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

/// The part of the variance of each of some channels that the components of the row `lag` rows before it explain.
/// Alternating [`BLOCKS`] of the rows are fitted and tested: both halves of a raster of presses are all over the skin.
fn explained(values: &[Vec<f64>], components: &Mat<f64>, channels: &[usize], lag: i32) -> Vec<f64> {
    let rows = values.len() as i32;
    let (first, last) = (lag.max(0) as usize, (rows + lag.min(0)) as usize);
    let (even, odd): (Vec<usize>, Vec<usize>) =
        (first..last).partition(|row| ((row - first) * BLOCKS / (last - first)).is_multiple_of(2));
    let source = |row: usize| (row as i32 - lag) as usize;
    let input = |rows: &[usize]| Mat::from_fn(rows.len(), components.ncols(), |i, k| components[(source(rows[i]), k)]);
    let target = |rows: &[usize]| Mat::from_fn(rows.len(), channels.len(), |i, j| values[rows[i]][channels[j]]);
    let mut sums = vec![[0.0; 2]; channels.len()];
    for (fit, test) in [(&even, &odd), (&odd, &even)] {
        let (fitted, tested) = (target(fit), target(test));
        let Some(regression) = Regression::fit(&input(fit), &fitted, RIDGE) else { return vec![0.0; channels.len()] };
        let predicted = input(test) * &regression.weights;
        for (j, [residual, total]) in sums.iter_mut().enumerate() {
            let mean = fitted.col(j).iter().sum::<f64>() / fit.len() as f64;
            for i in 0..test.len() {
                *residual += (tested[(i, j)] - regression.offsets[j] - predicted[(i, j)]).powi(2);
                *total += (tested[(i, j)] - mean).powi(2);
            }
        }
    }
    sums.into_iter().map(|[residual, total]| if total > 0.0 { 1.0 - residual / total } else { 0.0 }).collect()
}
