//! The methods available for every skin: one step with a prior, and the iterative and trained methods of the
//! literature.

use crate::method::{Method, MethodError, MethodOptions};
use crate::reconstruct::{
    Alpha, GaussNewton, GaussNewtonOptions, Greit, GreitOptions, OneStepOptions, Prior, Reconstruct, TotalVariation,
    TotalVariationOptions, default_prior,
};
use crate::skin::Skin;
use std::sync::Arc;

/// Their names.
pub(super) const NAMES: &[&str] = &["noser", "laplace", "tikhonov", "gauss-newton", "tv", "greit"];

/// The default method.
pub(super) fn default_name(skin: &Skin) -> &'static str {
    match default_prior(skin.design()) {
        Prior::Laplace => "laplace",
        Prior::Tikhonov => "tikhonov",
        Prior::Noser { .. } => "noser",
    }
}

/// Prepares the linear method with this name; `None` for any other name.
pub(super) fn method(skin: &Skin, name: &str, options: &MethodOptions) -> Result<Option<Method>, MethodError> {
    let noser = Prior::Noser { exponent: options.noser_exponent };
    let one_step = |prior: Prior| Method::from_one_step(name, skin, one_step_options(prior, skin, options));
    let method = match name {
        "noser" => one_step(noser),
        "laplace" => one_step(Prior::Laplace),
        "tikhonov" => one_step(Prior::Tikhonov),
        "gauss-newton" => gauss_newton(name, skin, options),
        "tv" => total_variation(name, skin, options),
        "greit" => greit(name, skin, options),
        _ => return Ok(None),
    };
    method.map(Some)
}

fn one_step_options(prior: Prior, skin: &Skin, options: &MethodOptions) -> OneStepOptions {
    OneStepOptions {
        prior,
        alpha: options.alpha,
        difference: options.difference,
        excluded: options.excluded.clone(),
        channel_sd: options.channel_sd.clone(),
        touch: skin.design().sheet.touch,
        examples: options.examples.clone(),
        baseline: options.baseline.clone(),
        ..OneStepOptions::default()
    }
}

fn gauss_newton(name: &str, skin: &Skin, options: &MethodOptions) -> Result<Method, MethodError> {
    let defaults = GaussNewtonOptions::default();
    let linear = one_step_options(defaults.linear.prior, skin, options);
    let options = GaussNewtonOptions { linear, baseline: options.baseline.clone(), ..defaults };
    let method = GaussNewton::new(skin.forward(), Arc::clone(skin.pixels()), &options)?;
    let (label, alpha) = (method.name(), method.alpha());
    Ok(Method::new(name, label, Arc::new(method)).with_alpha(alpha))
}

fn total_variation(name: &str, skin: &Skin, options: &MethodOptions) -> Result<Method, MethodError> {
    options.check_equal_weights(name)?;
    let defaults = TotalVariationOptions::default();
    let alpha = match options.alpha {
        Alpha::Auto => defaults.alpha,
        Alpha::Given(value) => value,
        _ => return Err(MethodError::option(name, "has no rule for alpha: give a number, such as 0.002")),
    };
    let (excluded, touch) = (options.excluded.clone(), skin.design().sheet.touch);
    let options = TotalVariationOptions { alpha, excluded, touch, ..defaults };
    let method = TotalVariation::from_linearised(skin.linearised()?, Arc::clone(skin.pixels()), &options)?;
    let label = method.name();
    Ok(Method::new(name, label, Arc::new(method)).with_alpha(alpha))
}

fn greit(name: &str, skin: &Skin, options: &MethodOptions) -> Result<Method, MethodError> {
    options.check_equal_weights(name)?;
    let defaults = GreitOptions::default();
    let noise_figure = match options.alpha {
        Alpha::Auto => defaults.noise_figure,
        Alpha::NoiseFigure(value) => Some(value),
        _ => return Err(MethodError::option(name, "is regularized by its noise figure alone: give noise-figure:0.5")),
    };
    let (excluded, touch) = (options.excluded.clone(), skin.design().sheet.touch);
    let options = GreitOptions { noise_figure, excluded, touch, ..defaults };
    let method = Greit::new(skin.forward(), Arc::clone(skin.pixels()), &options)?;
    let (label, rule) = (method.name(), method.alpha_rule());
    Ok(Method { alpha_rule: Some(rule), ..Method::new(name, label, Arc::new(method)) })
}
