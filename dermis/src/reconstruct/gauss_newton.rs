//! Iterative Gauss-Newton: the nonlinear least-squares image of a difference or of a single frame.

use crate::estimate::least_squares::{Control, LeastSquares, Minimum, Steps, minimise};
use crate::estimate::scale::least_squares;
use crate::forward::{ForwardModel, Matrix};
use crate::frame::Frame;
use crate::image::PixelSpace;
use crate::reconstruct::channels::Channels;
use crate::reconstruct::linearised::Linearised;
use crate::reconstruct::prior::Penalty;
use crate::reconstruct::system::System;
use crate::reconstruct::{OneStepOptions, Prior, Reconstruct, ReconstructError, alpha, check_lengths};
use std::sync::Arc;

/// The unknowns of a Gauss-Newton iteration, one per pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unknowns {
    /// The relative change of conductance, `x`.
    Conductance,
    /// Its logarithm, `ln(1 + x)`: every value is a positive conductance, and an insulator and a conductor are equally
    /// far from the untouched skin.
    #[default]
    LogConductance,
}

impl Unknowns {
    /// The unknown of a relative change.
    fn of_change(self, change: f64) -> f64 {
        match self {
            Unknowns::Conductance => change,
            Unknowns::LogConductance => change.ln_1p(),
        }
    }

    /// The relative change of an unknown.
    fn change(self, unknown: f64) -> f64 {
        match self {
            Unknowns::Conductance => unknown,
            Unknowns::LogConductance => unknown.exp_m1(),
        }
    }

    /// The derivative of the relative change by the unknown, at a relative change.
    fn derivative(self, change: f64) -> f64 {
        match self {
            Unknowns::Conductance => 1.0,
            Unknowns::LogConductance => 1.0 + change,
        }
    }
}

/// Options of a Gauss-Newton iteration.
#[derive(Debug, Clone)]
pub struct GaussNewtonOptions {
    /// Prior, alpha, channels and sign, as for one step; alpha is chosen on the linear model.
    pub linear: OneStepOptions,
    /// The unknowns, to which the prior applies.
    pub unknowns: Unknowns,
    /// The measured frame of the untouched skin, ohm. The model is scaled to it, so that the sheet resistance of the
    /// design does not matter. Without it differences are compared with the model as it is.
    pub baseline: Option<Frame>,
    /// Maximum number of steps.
    pub max_iterations: usize,
    /// The iteration ends when a step lowers the objective by less than this fraction of it.
    pub tolerance: f64,
}

impl Default for GaussNewtonOptions {
    fn default() -> Self {
        GaussNewtonOptions {
            linear: OneStepOptions { prior: Prior::Laplace, ..OneStepOptions::default() },
            unknowns: Unknowns::default(),
            baseline: None,
            max_iterations: 15,
            tolerance: 1e-3,
        }
    }
}

/// Iterative Gauss-Newton.
///
/// The unknowns `u` of the pixels ([`Unknowns`]) have the relative changes `x(u)` of the conductance from the rest
/// values. With `f` the forward model, `v` the voltages and `g` the weights of the channels it minimises
///
/// ```text
/// |g (f(x(u)) - v)|^2 + alpha^2 c (u - u0)' R (u - u0)
/// ```
///
/// where `u0` is zero for a difference (`v = f(0) + difference / s`) and the best uniform change for a single frame. `s`
/// is the factor from the model's untouched frame to the measured one, 1 if that is not given. Each step solves the
/// linearised problem, changes every conductance by a factor of at most ten downwards (with logarithms also upwards) and
/// is halved until the objective decreases. With an instrument that reports amplitudes, channels have the signs of the
/// untouched model.
///
/// The values of its images are the unknowns: with logarithms `ln(1 + x)`, which equals `x` for small changes.
#[derive(Debug, Clone)]
pub struct GaussNewton {
    forward: ForwardModel,
    pixels: Arc<PixelSpace>,
    channels: Channels,
    /// Factors of the model's channels in use: those of the data, with the sign that the instrument drops.
    model_scale: Vec<f64>,
    penalty: Penalty,
    alpha: f64,
    mu: f64,
    rest_frame: Vec<f64>,
    /// `s`.
    frame_scale: f64,
    options: GaussNewtonOptions,
}

/// The result of an iteration.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Relative change of each pixel's conductance from the rest value.
    pub change: Vec<f64>,
    /// Conductivity of each cell.
    pub conductivity: Vec<f64>,
    /// Weighted misfit of the voltages, `|g (f - v)|`; ohm for plain differences.
    pub misfit: f64,
    /// The objective before the first step and after each.
    pub objectives: Vec<f64>,
}

/// A point of the iteration.
struct Point {
    unknowns: Vec<f64>,
    change: Vec<f64>,
    conductivity: Vec<f64>,
    /// `g (v - f)`.
    residual: Vec<f64>,
    objective: f64,
}

impl GaussNewton {
    /// The iteration for a skin.
    ///
    /// # Errors
    /// Options out of their range, a forward problem that cannot be solved.
    pub fn new(forward: &ForwardModel, pixels: Arc<PixelSpace>, options: &GaussNewtonOptions) -> crate::Result<Self> {
        let model = Linearised::new(forward, &pixels)?;
        model.validate(&pixels)?;
        let linear = &options.linear;
        alpha::positive("the tolerance", options.tolerance)?;
        let channels = Channels::new(&model, linear.difference, &linear.excluded, &linear.channel_sd)?;
        let for_prior = channels.jacobian(&model, &channels.prior_scale, false);
        let penalty = linear.prior.matrix(for_prior.as_ref(), &pixels)?;
        let system = System::new(channels.jacobian(&model, &channels.scale, false), penalty.clone())?;
        let scale = if matches!(linear.alpha, alpha::Alpha::Absolute(_)) { 1.0 } else { system.scale()? };
        let (alpha, _) = alpha::choose(&system, scale, &channels, &pixels, linear)?;
        let signed = forward.solve(forward.rest_conductivity())?;
        let sign = |&channel: &usize| if signed[channel] * model.rest_frame[channel] < 0.0 { -1.0 } else { 1.0 };
        let model_scale = channels.kept.iter().zip(&channels.scale).map(|(channel, scale)| sign(channel) * scale);
        let frame_scale = match &options.baseline {
            Some(baseline) => frame_scale(&channels, &model.rest_frame, baseline)?,
            None => 1.0,
        };
        Ok(GaussNewton {
            forward: forward.clone(),
            pixels,
            model_scale: model_scale.collect(),
            channels,
            penalty,
            alpha,
            mu: alpha * alpha * scale,
            rest_frame: model.rest_frame,
            frame_scale,
            options: options.clone(),
        })
    }

    /// The alpha in use: as given, or as chosen on the linear model.
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// The conductance that explains a single frame, without a baseline.
    ///
    /// # Errors
    /// A frame of the wrong length or with a value that is not finite, or whose signs do not match any uniform skin.
    pub fn absolute(&self, frame: &Frame) -> crate::Result<Solution> {
        // Voltages are inversely proportional to a uniform conductance, except for the contacts.
        let ratio = 1.0 / frame_scale(&self.channels, &self.rest_frame, frame)?;
        self.minimise(&self.channels.gather(frame), ratio - 1.0)
    }

    /// The conductance that explains a difference from the untouched skin.
    ///
    /// # Errors
    /// A difference of the wrong length or with a value that is not finite.
    pub fn difference(&self, difference: &[f64]) -> crate::Result<Solution> {
        check_lengths(difference, self.rest_frame.len(), &[], 0)?;
        let target = self.rest_frame.iter().zip(difference).map(|(rest, change)| rest + change / self.frame_scale);
        let target: Vec<f64> = target.collect();
        self.minimise(&self.channels.gather(&target), 0.0)
    }

    /// Steps from a uniform change until the objective stops decreasing.
    fn minimise(&self, target: &[f64], change: f64) -> crate::Result<Solution> {
        /// A millionth of a step has no effect.
        const HALVINGS: i32 = 20;
        let origin = self.options.unknowns.of_change(change);
        let steps = Steps {
            most: self.options.max_iterations,
            control: Control::Halving(HALVINGS),
            shortest: 0.0,
            // The objective lowered by a share of what is left.
            least_decrease: self.options.tolerance / (1.0 + self.options.tolerance),
        };
        let start = self.point(vec![origin; self.pixels.len()], target, origin)?;
        let search = Search { method: self, target, origin };
        let Minimum { point, costs: objectives, .. } = minimise(&search, start, &steps)?;
        let misfit = point.residual.iter().map(|r| r * r).sum::<f64>().sqrt();
        Ok(Solution { change: point.change, conductivity: point.conductivity, misfit, objectives })
    }

    /// The objective for a single frame at some relative changes `x`, with `u0` zero.
    ///
    /// # Errors
    /// Changes or a frame of the wrong length, a conductance that is not positive.
    pub fn objective(&self, change: &[f64], frame: &Frame) -> crate::Result<f64> {
        check_lengths(frame, self.rest_frame.len(), change, self.pixels.len())?;
        let unknowns = change.iter().map(|&x| self.options.unknowns.of_change(x)).collect();
        Ok(self.point(unknowns, &self.channels.gather(frame), 0.0)?.objective)
    }

    fn point(&self, unknowns: Vec<f64>, target: &[f64], origin: f64) -> crate::Result<Point> {
        let change: Vec<f64> = unknowns.iter().map(|&u| self.options.unknowns.change(u)).collect();
        let mut factors = vec![1.0; self.forward.rest_conductivity().len()];
        for (overlaps, x) in self.pixels.overlaps.iter().zip(&change) {
            overlaps.iter().for_each(|&(cell, fraction)| factors[cell] += fraction * x);
        }
        let conductivity: Vec<f64> =
            self.forward.rest_conductivity().iter().zip(&factors).map(|(rest, factor)| rest * factor).collect();
        let frame = self.forward.solve(&conductivity)?;
        let frame = self.channels.kept.iter().zip(&self.model_scale).map(|(&channel, scale)| scale * frame[channel]);
        let residual: Vec<f64> = target.iter().zip(frame).map(|(v, f)| v - f).collect();
        let shift: Vec<f64> = unknowns.iter().map(|u| u - origin).collect();
        let roughness: f64 = self.penalty.apply(&shift).iter().zip(&shift).map(|(r, x)| r * x).sum();
        let objective = residual.iter().map(|r| r * r).sum::<f64>() + self.mu * roughness;
        Ok(Point { unknowns, change, conductivity, residual, objective })
    }

    /// The derivative of the weighted frame with respect to the unknowns.
    fn jacobian(&self, point: &Point) -> crate::Result<faer::Mat<f64>> {
        let rest = self.forward.rest_conductivity();
        let mut weighted = PixelSpace::clone(&self.pixels);
        for (overlaps, &change) in weighted.overlaps.iter_mut().zip(&point.change) {
            let derivative = self.options.unknowns.derivative(change);
            overlaps.iter_mut().for_each(|(cell, fraction)| *fraction *= derivative * rest[*cell]);
        }
        let jacobian: Matrix = self.forward.pixel_jacobian(&point.conductivity, &weighted)?;
        Ok(self.channels.rows(&jacobian, &self.model_scale))
    }
}

/// The search of the image of a frame.
struct Search<'a> {
    method: &'a GaussNewton,
    /// The weighted frame.
    target: &'a [f64],
    /// `u0`.
    origin: f64,
}

impl LeastSquares for Search<'_> {
    type Point = Point;
    /// The step: that of pixels and channels in the smaller form.
    type Equations = Vec<f64>;
    type Error = crate::Error;

    fn cost(&self, point: &Point) -> f64 {
        point.objective
    }

    fn equations(&self, point: &Point) -> crate::Result<Vec<f64>> {
        let system = System::new(self.method.jacobian(point)?, self.method.penalty.clone())?;
        let shift: Vec<f64> = point.unknowns.iter().map(|u| u - self.origin).collect();
        let explained = system.jacobian() * faer::ColRef::from_slice(&shift);
        let data: Vec<f64> = point.residual.iter().zip(explained.iter()).map(|(r, e)| r + e).collect();
        let goal = system.solve(&data, self.method.mu)?;
        Ok(goal.iter().zip(&shift).map(|(goal, from)| goal - from).collect())
    }

    fn limit(&self, from: &Point, step: &mut [f64]) {
        /// Minimum fraction of a pixel's conductance after a step; of logarithms also the inverse of the maximum.
        const KEPT: f64 = 0.1;
        for (step, u) in step.iter_mut().zip(&from.unknowns) {
            *step = match self.method.options.unknowns {
                Unknowns::Conductance => step.max((KEPT - 1.0) * (1.0 + u)),
                Unknowns::LogConductance => step.clamp(KEPT.ln(), -KEPT.ln()),
            };
        }
    }

    fn moved(&self, from: &Point, step: &[f64]) -> Option<Point> {
        let unknowns = from.unknowns.iter().zip(step).map(|(u, step)| u + step).collect();
        self.method.point(unknowns, self.target, self.origin).ok()
    }
}

/// The factor from the model's untouched frame to a measured one, by least squares.
fn frame_scale(channels: &Channels, rest: &[f64], measured: &[f64]) -> Result<f64, ReconstructError> {
    check_lengths(measured, rest.len(), &[], 0)?;
    let factor = least_squares(&channels.gather(measured), &channels.gather(rest));
    if factor.is_finite() && factor > 0.0 {
        Ok(factor)
    } else {
        let message = "the frame has the opposite sign of the model's: is a drive or a measure turned round?";
        Err(ReconstructError::Parameter(message.into()))
    }
}

impl Reconstruct for GaussNewton {
    fn name(&self) -> String {
        format!("Gauss-Newton {}", self.options.linear.prior.name())
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        &self.pixels
    }

    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        check_lengths(difference, self.rest_frame.len(), values, self.pixels.len())?;
        let solution = self.difference(difference).map_err(|error| ReconstructError::Singular(error.to_string()))?;
        let sign = self.options.linear.touch.sign();
        let unknown = |&x: &f64| self.options.unknowns.of_change(x);
        values.iter_mut().zip(&solution.change).for_each(|(value, x)| *value = sign * unknown(x));
        Ok(())
    }
}
