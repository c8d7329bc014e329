//! Drift of a frame without a touch: of the coating's conductance as a whole and along each axis, and of each
//! electrode's contact.

use crate::forward::Matrix;
use crate::geom::Point3;
use crate::geom::vector::centroid;
use crate::linalg::invert_spd;
use crate::pipeline::error::PipelineError;
use crate::skin::Skin;
use std::sync::Arc;

/// Pixels within this distance of a contact may be changed by it, m.
const REACH_M: f64 = 0.035;
/// Standard deviation of the relative change of a touched pixel.
const TOUCH_SD: f64 = 0.5;
/// Standard deviation of the relative drift of a coating.
const COATING_SD: f64 = 0.03;
/// Standard deviation of the drift of a contact resistance, relative to itself, and its minimum, ohm.
const CONTACT_SD: f64 = 0.5;
const CONTACT_LEAST_OHM: f64 = 0.5;

/// The drift modes of a skin, modes x channels: the change of a frame for one standard deviation of each, ohm. First
/// the coating's, then each electrode's.
fn drift_modes(skin: &Skin) -> crate::Result<Matrix> {
    let jacobian = &skin.linearised()?.jacobian;
    let pixels = skin.pixels();
    let extent_m = 0.5 * pixels.extent_m();
    let mut modes: Vec<Vec<f64>> = Vec::new();
    let shapes: [Box<dyn Fn(Point3) -> f64>; 4] = [
        Box::new(|_| 1.0),
        Box::new(|[x, _, _]| x / extent_m),
        Box::new(|[_, y, _]| y / extent_m),
        Box::new(|[_, _, z]| z / extent_m),
    ];
    let centre = centroid(&pixels.centres_m);
    for shape in shapes {
        // A body without extent along an axis does not have this mode: its weights are not finite.
        let weights: Vec<f64> = (pixels.centres_m.iter())
            .map(|position| COATING_SD * shape([0, 1, 2].map(|axis| position[axis] - centre[axis])))
            .map(|weight| if weight.is_finite() { weight } else { 0.0 })
            .collect();
        let mode = |channel: usize| jacobian.row(channel).iter().zip(&weights).map(|(j, w)| j * w).sum();
        modes.push((0..jacobian.rows).map(mode).collect());
    }
    for electrode in 0..skin.design().electrodes.len() {
        let sd_ohm = (CONTACT_SD * skin.forward().contact_resistance_ohm(electrode)).max(CONTACT_LEAST_OHM);
        modes.push(skin.design().protocol.contact_gains(electrode).map(|gain| sd_ohm * gain).collect());
    }
    let values: Vec<f64> = modes.iter().flatten().copied().collect();
    Ok(Matrix { rows: modes.len(), columns: jacobian.rows, values })
}

/// The input of a fit.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FitQuestion {
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
        let modes = Arc::new(drift_modes(&skin)?);
        Ok(DriftFitter { skin, modes, requested: None, installed: None })
    }

    /// The drift modes, modes x channels, ohm.
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
    FitQuestion { positions_m, sd_ohm, masked }: &FitQuestion,
) -> crate::Result<Matrix> {
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
    let mut fit = Matrix::zeros(channel_count, drift_count);
    // The identity matrix keeps it positive definite, if the noise is finite.
    let Ok(inverse) = invert_spd(&gram_plus_one(&columns)) else { return Ok(fit) };
    for (channel, row) in fit.values.chunks_exact_mut(drift_count).enumerate() {
        for (mode, value) in row.iter_mut().enumerate() {
            let sum: f64 = (0..count).map(|other| inverse.at(mode, other) * columns.at(other, channel)).sum();
            *value = sum / sd_ohm[channel];
        }
    }
    Ok(fit)
}

/// `A A' + 1`.
fn gram_plus_one(rows: &Matrix) -> Matrix {
    let mut gram = Matrix::zeros(rows.rows, rows.rows);
    for i in 0..rows.rows {
        for j in 0..=i {
            let product: f64 = rows.row(i).iter().zip(rows.row(j)).map(|(a, b)| a * b).sum();
            *gram.at_mut(i, j) = product;
            *gram.at_mut(j, i) = product;
        }
        *gram.at_mut(i, i) += 1.0;
    }
    gram
}
