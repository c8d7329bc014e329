//! The matrix of a one-step image for every `mu` at once, from one eigen-decomposition.
//!
//! With the matrices of equation (3), let `T = B U` with orthonormal `B`, and let `Q` be the eigenvectors of `K` in the
//! complement of `B`, with the eigenvalues `l`. The part of the data that is explained against the penalty is
//! `v = S^-1 (y - T b) = Q (l + mu)^-1 Q'y`, because `T'v = 0`, and `b = U^-1 B'(y - K v)`, so that
//!
//! ```text
//! x = [F Q, N U^-1] diag((l + mu)^-1, 1) [Q, B]' y,    F = R^-1 J' - N U^-1 B'K.                           (4)
//! ```

use super::DataForm;
use crate::reconstruct::ReconstructError;
use faer::linalg::solvers::Qr;
use faer::{Mat, Side};

/// The matrices of equation (4).
#[derive(Debug, Clone)]
pub(crate) struct Modes {
    /// `l`, without those that are zero within rounding errors.
    eigenvalues: Vec<f64>,
    /// `[Q, B]`, channels x modes, with orthonormal columns.
    pub(crate) channels: Mat<f64>,
    /// `[F Q, N U^-1]`, pixels x modes.
    pub(crate) pixels: Mat<f64>,
}

impl Modes {
    pub(crate) fn new(form: &DataForm) -> Result<Self, ReconstructError> {
        let (channel_count, trend_count) = (form.trend.nrows(), form.trend.ncols());
        if trend_count > channel_count {
            return Err(unseen_part());
        }
        let qr = form.trend.qr();
        let basis = qr.compute_Q();
        let complement = basis.subcols(trend_count, channel_count - trend_count);
        let spectrum = (complement.transpose() * (&form.kernel * complement))
            .self_adjoint_eigen(Side::Lower)
            .map_err(|error| ReconstructError::Singular(format!("J R^-1 J' has no eigenvalues: {error:?}")))?;
        let all: Vec<f64> = spectrum.S().column_vector().iter().copied().collect();
        // Twice the error of an eigenvalue of a symmetric matrix (Golub and Van Loan 2013, section 8.1).
        let zero = 2.0 * f64::EPSILON * channel_count as f64 * all.iter().fold(0.0, |a: f64, &b| a.max(b));
        let first = all.partition_point(|&value| value <= zero);
        let penalised = complement * spectrum.U().subcols(first, all.len() - first);
        let mut modes = Modes {
            pixels: Mat::zeros(form.smoothed.nrows(), all.len() - first + trend_count),
            channels: Mat::zeros(channel_count, all.len() - first + trend_count),
            eigenvalues: all[first..].to_vec(),
        };
        let count = modes.eigenvalues.len();
        modes.channels.subcols_mut(0, count).copy_from(&penalised);
        modes.pixels.subcols_mut(0, count).copy_from(&form.smoothed * &penalised);
        if trend_count > 0 {
            modes.fit_trend(form, &qr, basis.subcols(0, trend_count).to_owned())?;
        }
        Ok(modes)
    }

    /// The columns of the null space, and its part in the others.
    fn fit_trend(&mut self, form: &DataForm, qr: &Qr<f64>, basis: Mat<f64>) -> Result<(), ReconstructError> {
        let (count, trend_count) = (self.eigenvalues.len(), basis.ncols());
        let upper = qr.thin_R().to_owned();
        let largest = (0..trend_count).fold(0.0, |a: f64, c| a.max(upper[(c, c)].abs()));
        if (0..trend_count).any(|c| upper[(c, c)].abs() <= f64::EPSILON * trend_count as f64 * largest) {
            return Err(unseen_part());
        }
        let mut level = basis.transpose() * (&form.kernel * self.channels.subcols(0, count));
        upper.solve_upper_triangular_in_place(&mut level);
        let mut inverse = Mat::identity(trend_count, trend_count);
        upper.solve_upper_triangular_in_place(&mut inverse);
        for (pixel, &component) in form.component.iter().enumerate() {
            for mode in 0..count {
                self.pixels[(pixel, mode)] -= level[(component, mode)];
            }
            for trend in 0..trend_count {
                self.pixels[(pixel, count + trend)] = inverse[(component, trend)];
            }
        }
        self.channels.subcols_mut(count, trend_count).copy_from(&basis);
        Ok(())
    }

    /// The diagonal of equation (4).
    pub(crate) fn gains(&self, mu: f64) -> impl Iterator<Item = f64> + '_ {
        let trends = self.channels.ncols() - self.eigenvalues.len();
        self.eigenvalues.iter().map(move |value| 1.0 / (value + mu)).chain(std::iter::repeat_n(1.0, trends))
    }

    /// The largest of the eigenvalues; zero if there is none.
    pub(crate) fn largest(&self) -> f64 {
        self.eigenvalues.last().copied().unwrap_or(0.0)
    }
}

fn unseen_part() -> ReconstructError {
    ReconstructError::Singular("a part of the image that is joined to no other is seen by no channel".into())
}
