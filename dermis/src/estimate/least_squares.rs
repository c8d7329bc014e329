//! Nonlinear least squares with Gaussian priors: Gauss-Newton steps, damped, halved or as they are.
//!
//! A problem is to
//!
//! `minimise |r(x)|^2 + (x - c)' P (x - c)`
//!
//! with the residuals `r` (data minus model, over their standard deviations) and the prior of the unknowns, whose mean is
//! `c` and whose precision `P`: 1 for unknowns in standard deviations of their prior. With `A` the derivative of the model,
//! a step `s` solves the normal equations
//!
//! `(A'A + P) s = A' r - P (x - c)`
//!
//! by one Cholesky factor, whose inverse is the covariance of the unknowns at the minimum (Nocedal and Wright, 2006, DOI
//! 10.1007/978-0-387-40065-5, chapter 10; Tarantola, 2005, DOI 10.1137/1.9780898717921, section 3.2).
//!
//! ```
//! use dermis::estimate::least_squares::{Control, LeastSquares, Normal, Steps, minimise};
//! use dermis::linalg::NotPositiveDefinite;
//!
//! /// The values 1.0 exp(-0.5 t) at four times; both factors are sought.
//! struct Decay([(f64, f64); 4]);
//!
//! impl LeastSquares for Decay {
//!     type Point = [f64; 2];
//!     type Equations = Normal;
//!     type Error = NotPositiveDefinite;
//!
//!     fn cost(&self, [a, b]: &[f64; 2]) -> f64 {
//!         self.0.iter().map(|(t, y)| (y - a * (-b * t).exp()).powi(2)).sum()
//!     }
//!
//!     fn equations(&self, [a, b]: &[f64; 2]) -> Result<Normal, NotPositiveDefinite> {
//!         let columns: [Vec<f64>; 2] = [
//!             self.0.iter().map(|(t, _)| (-b * t).exp()).collect(),
//!             self.0.iter().map(|(t, _)| -a * t * (-b * t).exp()).collect(),
//!         ];
//!         let residuals: Vec<f64> = self.0.iter().map(|(t, y)| y - a * (-b * t).exp()).collect();
//!         Ok(Normal::new(&[&columns[0], &columns[1]], &residuals))
//!     }
//!
//!     fn moved(&self, from: &[f64; 2], step: &[f64]) -> Option<[f64; 2]> {
//!         Some([from[0] + step[0], from[1] + step[1]])
//!     }
//! }
//!
//! let decay = Decay([0.0, 1.0, 2.0, 3.0].map(|t| (t, (-0.5f64 * t).exp())));
//! let steps = Steps { most: 20, control: Control::Halving(10), shortest: 1e-9, least_decrease: 0.0 };
//! let found = minimise(&decay, [0.5, 1.0], &steps)?.point;
//! assert!((found[0] - 1.0).abs() < 1e-9 && (found[1] - 0.5).abs() < 1e-9);
//! # Ok::<(), NotPositiveDefinite>(())
//! ```

use crate::linalg::{Cholesky, Matrix, NotPositiveDefinite, gram, products};

/// A least-squares problem: its residuals, derivatives and unknowns.
pub trait LeastSquares {
    /// Values of the unknowns, with what the model gives there.
    type Point;
    /// The equations of a step: [`Normal`], but where another form is cheaper.
    type Equations: Equations;
    /// Why a step cannot be computed.
    type Error: From<NotPositiveDefinite>;

    /// The sum of the squares of the residuals and of the distances from the prior.
    fn cost(&self, point: &Self::Point) -> f64;

    /// The equations of a step from a point.
    ///
    /// # Errors
    /// Derivatives that cannot be computed.
    fn equations(&self, point: &Self::Point) -> Result<Self::Equations, Self::Error>;

    /// Limits a step to where the model is valid.
    fn limit(&self, _from: &Self::Point, _step: &mut [f64]) {}

    /// The point at the end of a step; `None` where the model has no solution.
    fn moved(&self, from: &Self::Point, step: &[f64]) -> Option<Self::Point>;

    /// Whether the search may end at a point after a number of steps.
    fn is_enough(&self, _point: &Self::Point, _steps: usize) -> bool {
        false
    }
}

/// The equations of a step.
pub trait Equations {
    /// Their solution, with the diagonal increased by a share, which is 0 but with [`Control::Damping`].
    ///
    /// # Errors
    /// The first unknown that is not determined.
    fn step(&self, damping: f64) -> Result<Vec<f64>, NotPositiveDefinite>;
}

/// A step that is solved already.
impl Equations for Vec<f64> {
    fn step(&self, _: f64) -> Result<Vec<f64>, NotPositiveDefinite> {
        Ok(self.clone())
    }
}

/// What is done where a step does not lower the cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Control {
    /// It is taken nevertheless: for derivatives that are not those at the point.
    Full,
    /// It is halved, at most this many times.
    Halving(i32),
    /// The diagonal of the normal equations is increased by a share (Marquardt, 1963, DOI 10.1137/0111030).
    Damping {
        /// The first share.
        first: f64,
        /// Its factor after a step that lowers the cost.
        down: f64,
        /// Its factor after one that does not.
        up: f64,
    },
}

/// The steps of a search, and when it ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// Maximum number of steps; steps that are given up for a larger damping count.
    pub most: usize,
    /// What is done where a step does not lower the cost.
    pub control: Control,
    /// A step none of whose parts is longer is the last one.
    pub shortest: f64,
    /// A step that lowers the cost by less than this share of it is the last one.
    pub least_decrease: f64,
}

/// Why a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// A short step, a small decrease, or a point that is good enough.
    Converged,
    /// The maximum number of steps.
    MostSteps,
    /// No shorter step lowers the cost, or the model has no solution at the end of a full one.
    NoDecrease,
}

/// The result of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum<P> {
    /// The last point, which with halving or damping has the lowest cost.
    pub point: P,
    /// The cost at the start and after each step that was taken.
    pub costs: Vec<f64>,
    /// Why the search ended.
    pub end: End,
}

impl Control {
    /// The damping of the first step.
    fn damping(self) -> f64 {
        if let Control::Damping { first, .. } = self { first } else { 0.0 }
    }

    /// The point at the end of the step that is taken, with its cost; `None` where none is.
    fn taken<P: LeastSquares>(self, problem: &P, from: &P::Point, cost: f64, step: &[f64]) -> Option<(P::Point, f64)> {
        let at = |step: &[f64]| {
            let point = problem.moved(from, step)?;
            let cost = problem.cost(&point);
            Some((point, cost))
        };
        let part = |halvings: i32| step.iter().map(|part| 0.5f64.powi(halvings) * part).collect::<Vec<f64>>();
        let is_lower = |next: &(P::Point, f64)| next.1 < cost;
        match self {
            Control::Full => at(step),
            Control::Damping { .. } => at(step).filter(is_lower),
            Control::Halving(most) => (0..=most).find_map(|halvings| at(&part(halvings)).filter(is_lower)),
        }
    }
}

/// Steps from a point to a minimum.
///
/// # Errors
/// Equations of a step that cannot be computed or solved.
pub fn minimise<P: LeastSquares>(problem: &P, start: P::Point, steps: &Steps) -> Result<Minimum<P::Point>, P::Error> {
    let control = steps.control;
    let (mut point, mut damping, mut equations) = (start, control.damping(), None);
    let mut cost = problem.cost(&point);
    let mut costs = vec![cost];
    for count in 0..steps.most {
        if problem.is_enough(&point, count) {
            return Ok(Minimum { point, costs, end: End::Converged });
        }
        let here = match equations.take() {
            Some(here) => here,
            None => problem.equations(&point)?,
        };
        let mut step = here.step(damping)?;
        problem.limit(&point, &mut step);
        let mut is_last = step.iter().all(|part| part.abs() < steps.shortest);
        match (control.taken(problem, &point, cost, &step), control) {
            (Some((next, next_cost)), _) => {
                is_last |= control != Control::Full && next_cost > (1.0 - steps.least_decrease) * cost;
                (point, cost) = (next, next_cost);
                costs.push(cost);
                damping *= if let Control::Damping { down, .. } = control { down } else { 1.0 };
            }
            (None, Control::Damping { up, .. }) => (damping, equations) = (damping * up, Some(here)),
            (None, _) => return Ok(Minimum { point, costs, end: End::NoDecrease }),
        }
        if is_last {
            return Ok(Minimum { point, costs, end: End::Converged });
        }
    }
    Ok(Minimum { point, costs, end: End::MostSteps })
}

/// The normal equations `H s = g` of a step.
#[derive(Debug, Clone)]
pub struct Normal {
    /// `H = A'A + P`.
    pub matrix: Matrix,
    /// `g = A' r - P (x - c)`.
    pub(crate) right: Vec<f64>,
}

impl Normal {
    /// Of the derivatives by each unknown and the residuals, without a prior.
    ///
    /// # Panics
    /// If a column is shorter than the residuals.
    pub fn new(columns: &[&[f64]], residuals: &[f64]) -> Self {
        Normal { matrix: gram(columns), right: products(columns, residuals) }
    }

    /// The same of a matrix of derivatives, values x unknowns.
    ///
    /// # Panics
    /// If its rows are not as many as the residuals.
    pub fn of(derivatives: &Matrix, residuals: &[f64]) -> Self {
        assert_eq!(derivatives.rows, residuals.len(), "a residual per value");
        let columns = derivatives.transposed();
        Normal::new(&columns.values.chunks_exact(columns.columns.max(1)).collect::<Vec<&[f64]>>(), residuals)
    }

    /// With the prior of an unknown: its precision, and the distance of the unknown from its mean.
    pub fn add_prior(&mut self, unknown: usize, precision: f64, distance: f64) {
        *self.matrix.at_mut(unknown, unknown) += precision;
        self.right[unknown] -= precision * distance;
    }

    /// With the prior of unknowns in its standard deviations.
    #[must_use]
    pub fn with_unit_priors(mut self, x: &[f64]) -> Self {
        x.iter().enumerate().for_each(|(unknown, &value)| self.add_prior(unknown, 1.0, value));
        self
    }

    /// The factor of `H`, which gives steps and, by its inverse, the covariance of the unknowns.
    ///
    /// # Errors
    /// The first unknown that is not determined.
    pub fn factor(&self) -> Result<Cholesky, NotPositiveDefinite> {
        Cholesky::determined(&self.matrix)
    }
}

impl Equations for Normal {
    fn step(&self, damping: f64) -> Result<Vec<f64>, NotPositiveDefinite> {
        let mut damped = self.matrix.clone();
        (0..damped.rows).for_each(|i| *damped.at_mut(i, i) *= 1.0 + damping);
        Ok(Cholesky::determined(&damped)?.solve(&self.right))
    }
}

#[cfg(test)]
mod tests;
