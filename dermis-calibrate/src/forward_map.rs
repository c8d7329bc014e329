//! The learned forward map: a Gaussian process from presses to the values of all channels.

use crate::covariance::{Covariance, Extent, PARAMETERS, PressInput};
use crate::error::CalibrateError;
use crate::minimize::minimize;
use crate::shrinkage::shrunk_covariance;
use dermis::geom::Point3;
use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{Mat, Side};
use rayon::prelude::*;

/// Presses from which the hyperparameters are estimated, at most: their cost is cubic in it.
const MAX_FOR_HYPERPARAMETERS: usize = 250;
/// Whitened components of the largest variance from which the hyperparameters are estimated. The components with the
/// most signal determine the position; a fit to all channels would be dominated by noisy ones.
const COMPONENTS: usize = 6;
/// Whitened components of the largest variance that are kept: the others are noise. The cross-validated
/// error changes by less than 3 % from 12 to 32.
const KEPT: usize = 24;
/// Standard deviation of the logarithm of a hyperparameter about its typical value.
const PRIOR_SD: f64 = 2.0;
/// Steps of the estimation of hyperparameters.
const ITERATIONS: usize = 30;

/// Labelled presses: what a forward map is fitted to.
#[derive(Debug, Clone)]
pub(crate) struct Samples {
    /// Values in units of the channels, presses x channels.
    pub values: Mat<f64>,
    /// The press of each row.
    pub inputs: Vec<PressInput>,
    /// Variance of each position per axis, m2; 0 for measured ones.
    pub position_variance_m2: Vec<f64>,
}

impl Samples {
    pub(crate) fn len(&self) -> usize {
        self.inputs.len()
    }

    /// Some of the presses.
    pub(crate) fn select(&self, rows: &[usize]) -> Samples {
        Samples {
            values: Mat::from_fn(rows.len(), self.values.ncols(), |i, j| self.values[(rows[i], j)]),
            inputs: rows.iter().map(|&row| self.inputs[row]).collect(),
            position_variance_m2: rows.iter().map(|&row| self.position_variance_m2[row]).collect(),
        }
    }

    fn extent(&self) -> Extent {
        Extent::of(&self.inputs.iter().map(|input| input.position_m).collect::<Vec<_>>())
    }

    /// The variance of the noise of each press: 1, and what the uncertainty of its position adds. The slope of a Matern
    /// 5/2 process has the variance `5/3 variance / length^2` per axis.
    fn noise(&self, covariance: &Covariance) -> Vec<f64> {
        let slope = 5.0 / 3.0 * covariance.position_variance / covariance.position_length_m.powi(2);
        self.position_variance_m2.iter().map(|variance| 1.0 + 2.0 * slope * variance).collect()
    }
}

/// What is estimated once from all samples and then kept: the hyperparameters, and the covariance of the residuals as
/// the matrix that makes them white.
#[derive(Debug, Clone)]
pub(crate) struct Hyperparameters {
    pub covariance: Covariance,
    pub extent: Extent,
    /// Channels x components; whitened values are `values * whitening`.
    pub whitening: Mat<f64>,
}

impl Hyperparameters {
    /// Estimates them by maximum marginal likelihood (Rasmussen and Williams 2006, Eq. 5.8; the scale of each channel
    /// is profiled): first from all channels, then from the whitened components with the most signal.
    pub(crate) fn estimate(samples: &Samples) -> Result<Self, CalibrateError> {
        let extent = samples.extent();
        let part = samples.select(&spread_over(samples.len(), MAX_FOR_HYPERPARAMETERS));
        let first = maximise(&part, &centred(&part.values), &extent, Covariance::typical(&extent));
        let whitening = whitening_of(samples, &first, &extent)?;
        let white = centred(&samples.values) * &whitening;
        let components = leading_components(&white, COMPONENTS)?;
        let signal = centred(&part.values) * &whitening * &components;
        Self::with_covariance(samples, maximise(&part, &signal, &extent, first))
    }

    /// The covariance of the residuals alone, with given hyperparameters of the process.
    pub(crate) fn with_covariance(samples: &Samples, covariance: Covariance) -> Result<Self, CalibrateError> {
        let extent = samples.extent();
        let whitening = whitening_of(samples, &covariance, &extent)?;
        let components = leading_components(&(centred(&samples.values) * &whitening), KEPT)?;
        Ok(Hyperparameters { covariance, extent, whitening: whitening * components })
    }
}

/// The forward map given samples: the mean response at any press, of all channels or of whitened components.
#[derive(Debug, Clone)]
pub(crate) struct ForwardMap {
    pub covariance: Covariance,
    pub extent: Extent,
    pub inputs: Vec<PressInput>,
    /// Mean of the samples.
    pub mean: Vec<f64>,
    /// `K^-1 (values - mean)`; presses x channels or components.
    pub weights: Mat<f64>,
}

impl ForwardMap {
    /// Conditions the process on samples, for all channels; also returns the factor of their covariance matrix.
    pub(crate) fn condition(
        samples: &Samples,
        hyperparameters: &Hyperparameters,
    ) -> Result<(Self, Llt<f64>), CalibrateError> {
        let Hyperparameters { covariance, extent, .. } = hyperparameters;
        let factor = factor(samples, covariance, extent)?;
        let map = ForwardMap {
            covariance: *covariance,
            extent: *extent,
            inputs: samples.inputs.clone(),
            mean: column_means(&samples.values),
            weights: factor.solve(centred(&samples.values)),
        };
        Ok((map, factor))
    }

    /// The map to whitened components (channels x components).
    pub(crate) fn whitened(&self, whitening: &Mat<f64>) -> Self {
        let component = |j: usize| whitening.col(j).iter().zip(&self.mean).map(|(weight, mean)| weight * mean).sum();
        ForwardMap {
            mean: (0..whitening.ncols()).map(component).collect(),
            weights: &self.weights * whitening,
            inputs: self.inputs.clone(),
            ..*self
        }
    }

    /// A press at the centre of the labels, after one there.
    pub(crate) fn at_centre(&self, number: f64) -> PressInput {
        PressInput { position_m: self.extent.centre_m, previous_m: self.extent.centre_m, number }
    }

    /// Number of channels or components.
    pub(crate) fn value_count(&self) -> usize {
        self.mean.len()
    }

    /// The part of the response that depends on the position, at some positions (positions x channels), and its factors
    /// of the position before, one table for each axis along which presses vary.
    pub(crate) fn responses(&self, positions_m: &[Point3]) -> (Vec<f64>, Vec<(usize, Vec<f64>)>) {
        let kernel = |of: &(dyn Fn(Point3, &PressInput) -> f64 + Sync)| {
            let rows: Vec<Vec<f64>> = positions_m
                .par_iter()
                .map(|&position| self.inputs.iter().map(|input| of(position, input)).collect())
                .collect();
            let product = Mat::from_fn(positions_m.len(), self.inputs.len(), |i, j| rows[i][j]) * &self.weights;
            let row = |i: usize| (0..product.ncols()).map(move |j| (i, j));
            (0..product.nrows()).flat_map(row).map(|at| product[at]).collect::<Vec<f64>>()
        };
        let mut base = kernel(&|position, input| self.covariance.of_position(position, input.position_m));
        for row in base.chunks_exact_mut(self.value_count()) {
            row.iter_mut().zip(&self.mean).for_each(|(value, mean)| *value += mean);
        }
        let shifts = self.shift_axes().into_iter().map(|axis| {
            let of = |position: Point3, input: &PressInput| {
                self.extent.relative(input.previous_m)[axis] * self.covariance.of_shift(position, input.position_m)
            };
            (axis, kernel(&of))
        });
        let shifts = shifts.collect();
        (base, shifts)
    }

    /// The axes along which the positions before vary: two of a flat skin.
    fn shift_axes(&self) -> Vec<usize> {
        let largest = |axis: usize| {
            let relative = self.inputs.iter().map(|input| self.extent.relative(input.previous_m)[axis].abs());
            relative.fold(0.0, f64::max)
        };
        (0..3).filter(|&axis| largest(axis) > 0.01).collect()
    }

    /// The part of the response that does not depend on the position: the press before and drift.
    pub(crate) fn history(&self, press: &PressInput) -> Vec<f64> {
        let mut sum = vec![0.0; self.value_count()];
        let factors: Vec<f64> = self.inputs.iter().map(|input| self.covariance.of_history(press, input)).collect();
        for (channel, value) in sum.iter_mut().enumerate() {
            *value = self.weights.col(channel).iter().zip(&factors).map(|(weight, factor)| weight * factor).sum();
        }
        sum
    }

    /// The variance of the response at some positions beside that of the noise, which is 1: that of the part of the
    /// position alone.
    pub(crate) fn variances(&self, positions_m: &[Point3], factor: &Llt<f64>) -> Vec<f64> {
        const BLOCK: usize = 512;
        let block = |positions_m: &[Point3]| {
            let kernel = Mat::from_fn(self.inputs.len(), positions_m.len(), |i, j| {
                self.covariance.of_position(self.inputs[i].position_m, positions_m[j])
            });
            let mut half = kernel;
            factor.L().solve_lower_triangular_in_place(half.as_mut());
            let explained = |j: usize| half.col(j).iter().map(|value| value * value).sum::<f64>();
            (0..positions_m.len())
                .map(|j| (self.covariance.position_variance - explained(j)).max(0.0))
                .collect::<Vec<f64>>()
        };
        positions_m.chunks(BLOCK).flat_map(block).collect()
    }
}

/// The Cholesky factor of the covariance of some samples.
fn factor(samples: &Samples, covariance: &Covariance, extent: &Extent) -> Result<Llt<f64>, CalibrateError> {
    let matrix = covariance.matrix(&samples.inputs, &samples.noise(covariance), extent);
    matrix.llt(Side::Lower).map_err(|_| CalibrateError::Fit("the covariance of the labels is singular".into()))
}

/// The inverse of the Cholesky factor of the covariance of the residuals, transposed: whitens from the right.
fn whitening_of(samples: &Samples, covariance: &Covariance, extent: &Extent) -> Result<Mat<f64>, CalibrateError> {
    let residuals = leave_one_out(&factor(samples, covariance, extent)?, &centred(&samples.values));
    let factor = shrunk_covariance(&residuals)
        .llt(Side::Lower)
        .map_err(|_| CalibrateError::Fit("the residuals of the labels have a singular covariance".into()))?;
    let channels = residuals.ncols();
    let mut inverse = Mat::<f64>::identity(channels, channels);
    factor.L().solve_lower_triangular_in_place(inverse.as_mut());
    Ok(inverse.transpose().to_owned())
}

/// The residual of each sample by the process conditioned on all others, in its standard deviations (Rasmussen and
/// Williams 2006, Eq. 5.10 to 5.12).
fn leave_one_out(factor: &Llt<f64>, values: &Mat<f64>) -> Mat<f64> {
    let weights = factor.solve(values);
    let inverse = factor.inverse();
    Mat::from_fn(values.nrows(), values.ncols(), |i, j| weights[(i, j)] / inverse[(i, i)].sqrt())
}

/// What the process predicts of each sample from all others, of all channels.
pub(crate) fn predict_left_out(
    samples: &Samples,
    hyperparameters: &Hyperparameters,
) -> Result<Mat<f64>, CalibrateError> {
    let factor = factor(samples, &hyperparameters.covariance, &hyperparameters.extent)?;
    let weights = factor.solve(centred(&samples.values));
    let inverse = factor.inverse();
    let value = |i: usize, j: usize| samples.values[(i, j)] - weights[(i, j)] / inverse[(i, i)];
    Ok(Mat::from_fn(samples.values.nrows(), samples.values.ncols(), value))
}

/// The hyperparameters of the largest posterior density, from values of some components.
fn maximise(samples: &Samples, values: &Mat<f64>, extent: &Extent, start: Covariance) -> Covariance {
    let typical = Covariance::typical(extent).to_log();
    let objective = |log: &[f64]| {
        let covariance = Covariance::from_log(log);
        let Ok(factor) = factor(samples, &covariance, extent) else { return f64::INFINITY };
        let prior: f64 = log.iter().zip(&typical).map(|(value, centre)| ((value - centre) / PRIOR_SD).powi(2)).sum();
        negative_log_likelihood(&factor, values) + 0.5 * prior
    };
    let log: [f64; PARAMETERS] = start.to_log();
    Covariance::from_log(&minimize(&log, ITERATIONS, objective))
}

/// The negative logarithm of the marginal likelihood per component, with each component's scale at its best value.
fn negative_log_likelihood(factor: &Llt<f64>, values: &Mat<f64>) -> f64 {
    let mut half = values.clone();
    factor.L().solve_lower_triangular_in_place(half.as_mut());
    let (count, components) = (values.nrows() as f64, values.ncols());
    let log_scale = |j: usize| (half.col(j).iter().map(|value| value * value).sum::<f64>() / count).max(1e-300).ln();
    let scales = (0..components).map(log_scale).sum::<f64>() / components as f64;
    let determinant: f64 = (0..values.nrows()).map(|i| factor.L()[(i, i)].ln()).sum();
    0.5 * count * scales + determinant
}

/// The directions of the largest variance; channels x components.
fn leading_components(values: &Mat<f64>, count: usize) -> Result<Mat<f64>, CalibrateError> {
    let covariance = values.transpose() * values;
    let eigen = covariance
        .self_adjoint_eigen(Side::Lower)
        .map_err(|_| CalibrateError::Fit("the components of the frames cannot be computed".into()))?;
    let channels = values.ncols();
    // Eigenvalues ascend.
    Ok(Mat::from_fn(channels, count.min(channels), |i, j| eigen.U()[(i, channels - 1 - j)]))
}

fn column_means(values: &Mat<f64>) -> Vec<f64> {
    (0..values.ncols()).map(|j| values.col(j).iter().sum::<f64>() / values.nrows() as f64).collect()
}

fn centred(values: &Mat<f64>) -> Mat<f64> {
    let means = column_means(values);
    Mat::from_fn(values.nrows(), values.ncols(), |i, j| values[(i, j)] - means[j])
}

/// At most `most` of `count` indices, evenly spread.
pub(crate) fn spread_over(count: usize, most: usize) -> Vec<usize> {
    let chosen = count.min(most);
    (0..chosen).map(|k| k * count / chosen).collect()
}
