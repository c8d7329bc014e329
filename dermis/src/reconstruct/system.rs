//! The regularised linear problem of a one-step image, in both of its forms.
//!
//! ```text
//! x = argmin |y - J x|^2 + mu x'Rx = (J'J + mu R)^-1 J' y             parameter space, pixels x pixels   (1)
//!                                  = R^-1 J' (J R^-1 J' + mu I)^-1 y  data space, channels x channels    (2)
//! ```
//!
//! If R has a null space `N` (constants, for the Laplace prior), (2) is computed in its complement, and the null-space
//! part `N b` is fitted without a penalty: with `T = J N`, `S = K + mu I` and `K = J R^-1 J'`,
//!
//! ```text
//! b = (T' S^-1 T)^-1 T' S^-1 y,    x = R^-1 J' S^-1 (y - T b) + N b.                                     (3)
//! ```

mod modes;

pub(crate) use modes::Modes;

use crate::reconstruct::ReconstructError;
use crate::reconstruct::prior::Penalty;
use faer::linalg::solvers::{Llt, Solve};
use faer::{ColRef, Mat, MatRef, Side};

/// `min |y - J x|^2 + mu x'Rx` with everything precomputed that does not depend on `mu`.
#[derive(Debug, Clone)]
pub(crate) struct System {
    jacobian: Mat<f64>,
    penalty: Penalty,
    form: Form,
}

#[derive(Debug, Clone)]
enum Form {
    /// Equation (1): J'J.
    Parameter { normal: Mat<f64> },
    /// Equation (2) and (3).
    Data(DataForm),
}

/// The additional matrices for equation (3).
#[derive(Debug, Clone)]
pub(crate) struct DataForm {
    /// `R^-1 J'`, pixels x channels.
    smoothed: Mat<f64>,
    /// `K = J R^-1 J'`.
    pub(crate) kernel: Mat<f64>,
    /// `T = J N`, channels x components.
    pub(crate) trend: Mat<f64>,
    /// The component of each pixel, if R is singular.
    component: Vec<usize>,
}

impl System {
    /// The problem in the form with the smaller matrix.
    pub(crate) fn new(jacobian: Mat<f64>, penalty: Penalty) -> Result<Self, ReconstructError> {
        if jacobian.ncols() <= jacobian.nrows() {
            Ok(Self::parameter(jacobian, penalty))
        } else {
            Self::data(jacobian, penalty)
        }
    }

    /// The problem in parameter space.
    pub(crate) fn parameter(jacobian: Mat<f64>, penalty: Penalty) -> Self {
        let normal = jacobian.transpose() * &jacobian;
        System { jacobian, penalty, form: Form::Parameter { normal } }
    }

    /// The problem in data space.
    pub(crate) fn data(jacobian: Mat<f64>, penalty: Penalty) -> Result<Self, ReconstructError> {
        let form = Form::Data(DataForm::new(jacobian.as_ref(), &penalty)?);
        Ok(System { jacobian, penalty, form })
    }

    pub(crate) fn jacobian(&self) -> MatRef<'_, f64> {
        self.jacobian.as_ref()
    }

    /// `trace(J'J) / trace(R)`, which makes alpha dimensionless.
    pub(crate) fn scale(&self) -> Result<f64, ReconstructError> {
        let scale = self.jacobian.squared_norm_l2() / self.penalty.trace();
        if scale.is_finite() && scale > 0.0 {
            Ok(scale)
        } else {
            let message = format!("trace(J'J) / trace(R) is {scale}: no channel in use sees any pixel");
            Err(ReconstructError::Singular(message))
        }
    }

    /// The matrix from `y` to `x`, pixels x channels.
    pub(crate) fn inverse(&self, mu: f64) -> Result<Mat<f64>, ReconstructError> {
        match &self.form {
            Form::Parameter { normal } => {
                let mut matrix = normal.clone();
                self.penalty.add_to(&mut matrix, mu);
                let mut rhs = self.jacobian.transpose().to_owned();
                cholesky(&matrix, "J'J + mu R", mu)?.solve_in_place(rhs.as_mut());
                Ok(rhs)
            }
            Form::Data(form) => form.inverse(mu),
        }
    }

    /// The image of `y` only, without the whole matrix.
    pub(crate) fn solve(&self, data: &[f64], mu: f64) -> Result<Vec<f64>, ReconstructError> {
        let data = ColRef::from_slice(data).as_mat();
        let image = match &self.form {
            Form::Parameter { normal } => {
                let mut matrix = normal.clone();
                self.penalty.add_to(&mut matrix, mu);
                cholesky(&matrix, "J'J + mu R", mu)?.solve(self.jacobian.transpose() * data)
            }
            Form::Data(form) => form.solve(data, mu)?,
        };
        Ok(image.col(0).iter().copied().collect())
    }

    /// The data-space matrices, prepared if the problem is in the other form.
    pub(crate) fn data_form(&self) -> Result<std::borrow::Cow<'_, DataForm>, ReconstructError> {
        use std::borrow::Cow;
        match &self.form {
            Form::Data(form) => Ok(Cow::Borrowed(form)),
            Form::Parameter { .. } => Ok(Cow::Owned(DataForm::new(self.jacobian.as_ref(), &self.penalty)?)),
        }
    }
}

impl DataForm {
    pub(crate) fn new(jacobian: MatRef<'_, f64>, penalty: &Penalty) -> Result<Self, ReconstructError> {
        let smoothed = penalty.solve(jacobian)?;
        let kernel = jacobian * &smoothed;
        let (component, component_count) = penalty.components().unwrap_or((&[], 0));
        let mut trend = Mat::zeros(jacobian.nrows(), component_count);
        for (pixel, &component) in component.iter().enumerate() {
            for channel in 0..jacobian.nrows() {
                trend[(channel, component)] += jacobian[(channel, pixel)];
            }
        }
        Ok(DataForm { smoothed, kernel, trend, component: component.to_vec() })
    }

    /// `S = K + mu I`.
    fn factor(&self, mu: f64) -> Result<Llt<f64>, ReconstructError> {
        let mut system = self.kernel.clone();
        for channel in 0..system.nrows() {
            system[(channel, channel)] += mu;
        }
        cholesky(&system, "J R^-1 J' + mu I", mu)
    }

    fn solve(&self, data: MatRef<'_, f64>, mu: f64) -> Result<Mat<f64>, ReconstructError> {
        let factor = self.factor(mu)?;
        if self.trend.ncols() == 0 {
            return Ok(&self.smoothed * factor.solve(data));
        }
        let solved = factor.solve(&self.trend);
        let fit = cholesky(&(self.trend.transpose() * &solved), "T' S^-1 T", mu)?.solve(solved.transpose() * data);
        let mut image = &self.smoothed * factor.solve(data - &self.trend * &fit);
        for (pixel, &component) in self.component.iter().enumerate() {
            image[(pixel, 0)] += fit[(component, 0)];
        }
        Ok(image)
    }

    fn inverse(&self, mu: f64) -> Result<Mat<f64>, ReconstructError> {
        let factor = self.factor(mu)?;
        let mut transposed = self.smoothed.transpose().to_owned();
        factor.solve_in_place(transposed.as_mut());
        let mut inverse = transposed.transpose().to_owned();
        if self.trend.ncols() > 0 {
            let solved = factor.solve(&self.trend);
            let fit = cholesky(&(self.trend.transpose() * &solved), "T' S^-1 T", mu)?.solve(solved.transpose());
            // N b and, through y - T b, its effect on the penalised part.
            let mut lift = -(&self.smoothed * &solved);
            for (pixel, &component) in self.component.iter().enumerate() {
                lift[(pixel, component)] += 1.0;
            }
            inverse += lift * fit;
        }
        Ok(inverse)
    }
}

fn cholesky(matrix: &Mat<f64>, what: &str, mu: f64) -> Result<Llt<f64>, ReconstructError> {
    matrix.llt(Side::Lower).map_err(|_| {
        let message = format!(
            "{what} is not positive definite at mu = {mu:e}: alpha is too small for this Jacobian, or a part of the image \
             is seen by no channel"
        );
        ReconstructError::Singular(message)
    })
}

#[cfg(test)]
mod tests;
