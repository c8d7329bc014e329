//! Changes over the rows: drift, and the memory of the press before.

use crate::ridge::Regression;
use dermis::finding::{Finding, FindingKind};
use faer::{Mat, Side};

/// Blocks of rows whose means show drift.
const BLOCKS: usize = 10;
/// Fewest rows in which drift and memory are looked for.
const MIN_ROWS: usize = 100;
/// Drift is stated where the means of the blocks explain this part of the variance of the median channel.
const DRIFT: f64 = 0.02;
/// Memory is stated where the row before explains this part of the leading components, by cross-validation.
const MEMORY: f64 = 0.01;
/// Components that are predicted, and that predict.
const COMPONENTS: usize = 12;
/// Ridge of the prediction.
const RIDGE: f64 = 1e-2;

/// How a recording changes over its rows.
pub(crate) struct Course {
    /// For each channel the part of its variance between blocks of rows, less what chance explains.
    pub drift: Vec<f64>,
    /// Mean of the leading component in each of many blocks of rows, in its standard deviations: first row, mean.
    pub trend: Vec<[f64; 2]>,
    /// Part of the leading components that the row before explains.
    pub memory: f64,
}

/// The course of a recording (standardised, rows x channels); `None` for few rows.
pub(crate) fn course(standardised: &Mat<f64>, components: &Mat<f64>) -> Option<Course> {
    let rows = standardised.nrows();
    if rows < MIN_ROWS || components.ncols() == 0 {
        return None;
    }
    let drift = (0..standardised.ncols()).map(|channel| {
        let values: Vec<f64> = standardised.col(channel).iter().copied().collect();
        between_blocks(&values)
    });
    Some(Course { drift: drift.collect(), trend: trend(components), memory: memory(components) })
}

/// The part of the variance of a column between blocks of rows, less what chance explains.
fn between_blocks(values: &[f64]) -> f64 {
    let size = values.len() / BLOCKS;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let total: f64 = values.iter().map(|value| value * value).sum();
    if total == 0.0 {
        return 0.0;
    }
    let between: f64 = values.chunks(size).map(|block| block.len() as f64 * mean(block).powi(2)).sum();
    between / total - (BLOCKS as f64 - 1.0) / values.len() as f64
}

/// Means of the component with the most drift.
fn trend(components: &Mat<f64>) -> Vec<[f64; 2]> {
    let rows = components.nrows();
    let column = |k: usize| components.col(k).iter().copied().collect::<Vec<f64>>();
    let most =
        (0..components.ncols()).max_by(|&a, &b| between_blocks(&column(a)).total_cmp(&between_blocks(&column(b))));
    let values = column(most.unwrap_or(0));
    let size = (rows / 50).max(1);
    let mean = |block: &[f64]| block.iter().sum::<f64>() / block.len() as f64;
    values.chunks(size).enumerate().map(|(k, block)| [(k * size) as f64, mean(block)]).collect()
}

/// The part of the leading components of a row that the row before explains, by prediction of one half from the other.
fn memory(components: &Mat<f64>) -> f64 {
    let rows = components.nrows() - 1;
    let middle = rows / 2;
    let (mut residual, mut total) = (0.0, 0.0);
    for (fit, test) in [(0..middle, middle..rows), (middle..rows, 0..middle)] {
        let part = |range: &std::ops::Range<usize>, after: usize| {
            Mat::from_fn(range.len(), components.ncols(), |i, k| components[(range.start + i + after, k)])
        };
        let Some(regression) = Regression::fit(&part(&fit, 0), &part(&fit, 1), RIDGE) else { return 0.0 };
        let predicted = part(&test, 0) * &regression.weights;
        let target = part(&test, 1);
        for k in 0..components.ncols() {
            let mean = target.col(k).iter().sum::<f64>() / test.len() as f64;
            for i in 0..test.len() {
                // Slow drift is no memory: the mean of the half is taken from the half itself.
                residual += (target[(i, k)] - mean - (predicted[(i, k)] - predicted_mean(&predicted, k))).powi(2);
                total += (target[(i, k)] - mean).powi(2);
            }
        }
    }
    if total > 0.0 { 1.0 - residual / total } else { 0.0 }
}

fn predicted_mean(predicted: &Mat<f64>, k: usize) -> f64 {
    predicted.col(k).iter().sum::<f64>() / predicted.nrows() as f64
}

/// The leading components of a standardised table, rows x components, each with mean square 1.
pub(crate) fn leading_components(standardised: &Mat<f64>, correlation: &Mat<f64>) -> Mat<f64> {
    let channels = standardised.ncols();
    let Ok(eigen) = correlation.self_adjoint_eigen(Side::Lower) else { return Mat::zeros(standardised.nrows(), 0) };
    let count = COMPONENTS.min(channels).min(standardised.nrows() / 4);
    let vectors = Mat::from_fn(channels, count, |i, k| {
        let size = eigen.S()[channels - 1 - k].max(f64::MIN_POSITIVE).sqrt();
        eigen.U()[(i, channels - 1 - k)] / size
    });
    standardised * vectors
}

/// The notes on drift (of the median channel) and memory.
pub(crate) fn notes(drift: f64, memory: f64, by_truth: bool) -> Vec<Finding> {
    let mut found = Vec::new();
    if drift > DRIFT {
        let evidence = "part of the variance of the median channel between tenths of the rows";
        let fix = "take an untouched frame more often; keep the order of the rows, so that a calibration can follow it";
        found.push(Finding::new(FindingKind::Drift, drift, evidence, fix));
    }
    if memory > MEMORY {
        let evidence = match by_truth {
            true => "part of the frames that the position of the press before explains",
            false => "part of the frames that the row before explains: memory, or presses next to each other",
        };
        let fix = "keep the order of the rows: a calibration takes the press before into account";
        found.push(Finding::new(FindingKind::Memory, memory, evidence, fix));
    }
    found
}
