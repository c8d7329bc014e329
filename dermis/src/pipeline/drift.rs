//! Drift of a frame without a touch.

use crate::estimate::drift::{DriftSpread, directions};
use crate::forward::Matrix;
use crate::geom::Point3;
use crate::linalg::{Cholesky, dot, gram};
use crate::pipeline::error::PipelineError;
use crate::skin::Skin;
use std::borrow::Cow;
use std::sync::Arc;

/// Pixels within this distance of a contact may be changed by it, m.
const REACH_M: f64 = 0.035;
/// Standard deviation of the relative change of a touched pixel.
const TOUCH_SD: f64 = 0.5;
/// The drift that is separated from a touch: of the sheet as a whole and along each axis, and of each contact.
const SPREAD: DriftSpread = DriftSpread { sheet: 0.03, gradient: 0.03, contact: 0.5, contact_least_ohm: 0.5 };

/// The mode of the sheet as a whole.
const WHOLE: usize = 0;
/// The first modes, which are those of the sheet: as a whole, and along each axis.
pub(super) const OF_SHEET: usize = 4;

/// A drift mode of a skin whose untouched frame was measured, ohm. Drift of the whole sheet changes all measured values by the
/// same part; how the skin differs from its model does not matter to it.
pub(super) fn mode<'a>(modes: &'a Matrix, mode: usize, rest_ohm: &[f64]) -> Cow<'a, [f64]> {
    match mode {
        WHOLE => rest_ohm.iter().map(|value| -SPREAD.sheet * value).collect(),
        _ => Cow::Borrowed(modes.row(mode)),
    }
}

/// All these modes, modes x channels, ohm.
pub(super) fn modes_of(modes: &Matrix, rest_ohm: &[f64]) -> Matrix {
    let rows: Vec<Cow<'_, [f64]>> = (0..modes.rows).map(|row| mode(modes, row, rest_ohm)).collect();
    Matrix { values: rows.concat(), ..*modes }
}

/// The input of a fit.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FitQuestion {
    /// The untouched frame, ohm.
    pub rest_ohm: Vec<f64>,
    /// Positions of the contacts, m.
    pub positions_m: Vec<Point3>,
    /// Standard deviation of the noise of each channel, ohm.
    pub sd_ohm: Vec<f64>,
    /// Channels that are masked.
    pub masked: Vec<bool>,
}

/// Computes the maps from frames to drift, or uses one that was computed elsewhere. A map depends only on its input.
#[derive(Debug)]
pub(super) struct DriftFitter {
    skin: Skin,
    modes: Arc<Matrix>,
    requested: Option<FitQuestion>,
    installed: Option<DriftFit>,
}

/// A job that computes how drift is separated from a touch. It may run on any thread.
#[derive(Debug, Clone)]
pub struct DriftFitJob {
    skin: Skin,
    modes: Arc<Matrix>,
    question: FitQuestion,
}

/// The result of a [`DriftFitJob`].
#[derive(Debug, Clone)]
pub struct DriftFit {
    question: FitQuestion,
    map: Matrix,
}

impl DriftFitJob {
    /// Computes the fit.
    ///
    /// # Errors
    /// A skin whose forward problem cannot be solved.
    pub fn run(self) -> Result<DriftFit, PipelineError> {
        let map = fit(&self.skin, &self.modes, &self.question)?;
        Ok(DriftFit { question: self.question, map })
    }
}

impl DriftFitter {
    /// For a skin.
    pub(super) fn new(skin: Skin) -> Result<Self, PipelineError> {
        let modes = Arc::new(directions(skin.forward(), &SPREAD).map_err(crate::Error::from)?);
        Ok(DriftFitter { skin, modes, requested: None, installed: None })
    }

    /// The drift modes of the model, modes x channels, ohm.
    pub(super) fn modes(&self) -> &Matrix {
        &self.modes
    }

    /// Announces that a fit will be needed.
    pub(super) fn request(&mut self, question: FitQuestion) {
        self.requested = Some(question);
    }

    /// The announced fit, if it has not been taken yet.
    pub(super) fn job(&mut self) -> Option<DriftFitJob> {
        let question = self.requested.take()?;
        Some(DriftFitJob { skin: self.skin.clone(), modes: Arc::clone(&self.modes), question })
    }

    /// Keeps a fit until it is needed.
    pub(super) fn install(&mut self, fit: DriftFit) {
        self.installed = Some(fit);
    }

    /// The map from a frame's difference to the drift in it, channels x drift modes.
    pub(super) fn fit(&mut self, question: FitQuestion) -> Result<Matrix, PipelineError> {
        self.requested = None;
        match self.installed.take().filter(|installed| installed.question == question) {
            Some(installed) => Ok(installed.map),
            None => Ok(fit(&self.skin, &self.modes, &question)?),
        }
    }
}

/// The map from a difference to the drift in it, fitted together with changes of the pixels near the contacts: the rows
/// of `(A' W A + 1)^-1 A' W` for the drift modes, with the columns of `A` for one standard deviation each and `W` the
/// inverse variances of the noise. Transposed: channels x drift modes.
fn fit(
    skin: &Skin,
    modes: &Matrix,
    FitQuestion { rest_ohm, positions_m, sd_ohm, masked }: &FitQuestion,
) -> crate::Result<Matrix> {
    let modes = modes_of(modes, rest_ohm);
    let (jacobian, pixels) = (&skin.linearised()?.jacobian, skin.pixels());
    let is_touched = |pixel: &usize| {
        let centre_m = pixels.centres_m[*pixel];
        positions_m.iter().any(|&position| pixels.surface.distance_m(position, centre_m) <= REACH_M)
    };
    let touched: Vec<usize> = (0..pixels.len()).filter(is_touched).collect();
    let (drift_count, channel_count) = (modes.rows, jacobian.rows);
    let count = drift_count + touched.len();
    // The columns of A over the deviations of the noise, one after another.
    let mut columns = Matrix::zeros(count, channel_count);
    for (row, values) in columns.values.chunks_exact_mut(channel_count).enumerate() {
        for (channel, value) in values.iter_mut().enumerate().filter(|(channel, _)| !masked[*channel]) {
            let effect = match row.checked_sub(drift_count) {
                None => modes.at(row, channel),
                Some(pixel) => TOUCH_SD * jacobian.at(channel, touched[pixel]),
            };
            *value = effect / sd_ohm[channel];
        }
    }
    let mut fit = separated(&columns, drift_count);
    for (channel, sd) in sd_ohm.iter().enumerate() {
        (0..drift_count).for_each(|mode| *fit.at_mut(channel, mode) /= sd);
    }
    Ok(fit)
}

/// The first rows of `(C C' + 1)^-1 C` for the rows `C` of the unknowns, transposed: channels x drift modes. With more unknowns
/// than channels from the equal `C (C' C + 1)^-1`.
fn separated(unknowns: &Matrix, drift_count: usize) -> Matrix {
    let channels = unknowns.transposed();
    let is_wide = unknowns.rows > channels.rows;
    let side = if is_wide { &channels } else { unknowns };
    let mut normal = gram(&side.values.chunks_exact(side.columns).collect::<Vec<_>>());
    (0..side.rows).for_each(|i| *normal.at_mut(i, i) += 1.0);
    let mut fit = Matrix::zeros(channels.rows, drift_count);
    // The identity matrix keeps it positive definite, if the noise is finite.
    let Ok(factor) = Cholesky::new(&normal) else { return fit };
    for mode in 0..drift_count {
        let of_channels = if is_wide {
            factor.solve(unknowns.row(mode))
        } else {
            let mut unit = vec![0.0; unknowns.rows];
            unit[mode] = 1.0;
            let of_unknowns = factor.solve(&unit);
            (0..channels.rows).map(|channel| dot(&of_unknowns, channels.row(channel))).collect()
        };
        of_channels.into_iter().enumerate().for_each(|(channel, value)| *fit.at_mut(channel, mode) = value);
    }
    fit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drift_is_separated_with_fewer_and_with_more_unknowns_than_channels() {
        for (unknowns, channels) in [(5, 9), (9, 9), (14, 9)] {
            let values = (0..unknowns * channels).map(|index| ((index * index * 7) as f64).sin()).collect();
            let columns = Matrix { rows: unknowns, columns: channels, values };
            let fit = separated(&columns, 3);
            for mode in 0..3 {
                // `x (C' C + 1) = C` for a row `x` of the result.
                let found: Vec<f64> = (0..channels).map(|channel| fit.at(channel, mode)).collect();
                let products: Vec<f64> = (0..unknowns).map(|row| dot(columns.row(row), &found)).collect();
                for (channel, found) in found.iter().enumerate() {
                    let back: f64 = (0..unknowns).map(|row| products[row] * columns.at(row, channel)).sum();
                    let residual = back + found - columns.at(mode, channel);
                    assert!(residual.abs() < 1e-13, "{unknowns} x {channels}, mode {mode}: {residual:e}");
                }
            }
        }
    }
}
