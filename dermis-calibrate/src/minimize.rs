//! Minimisation of a smooth function of a few variables.

use dermis::linalg::dot;
use rayon::prelude::*;

/// Step of the difference quotients.
const STEP: f64 = 1e-4;
/// A step must lower the value by this share of the linear prediction (Armijo's condition).
const SUFFICIENT: f64 = 1e-4;
/// Halvings of a step before the search ends.
const HALVINGS: usize = 12;
/// Longest step, in the variables.
const LONGEST: f64 = 2.0;

/// Minimises a function by the method of Broyden, Fletcher, Goldfarb and Shanno with difference quotients (Nocedal and
/// Wright 2006, Alg. 6.1) from `start`, in at most `iterations` steps. Returns the best point.
///
/// The value may be infinite where the function is not defined. The quotients are evaluated in parallel.
pub(crate) fn minimize(start: &[f64], iterations: usize, function: impl Fn(&[f64]) -> f64 + Sync) -> Vec<f64> {
    let count = start.len();
    let mut point = start.to_vec();
    let mut value = function(&point);
    let mut gradient = quotients(&function, &point, value);
    let mut inverse: Vec<Vec<f64>> =
        (0..count).map(|i| (0..count).map(|j| f64::from(u8::from(i == j))).collect()).collect();
    for _ in 0..iterations {
        let mut step: Vec<f64> = inverse.iter().map(|row| -dot(row, &gradient)).collect();
        if dot(&step, &gradient) >= 0.0 {
            step = gradient.iter().map(|slope| -slope).collect();
        }
        let length = dot(&step, &step).sqrt();
        step.iter_mut().for_each(|part| *part *= (LONGEST / length).min(1.0));
        let Some((next, next_value)) = search(&function, &point, value, &step, dot(&step, &gradient)) else { break };
        let next_gradient = quotients(&function, &next, next_value);
        let moved: Vec<f64> = next.iter().zip(&point).map(|(a, b)| a - b).collect();
        let change: Vec<f64> = next_gradient.iter().zip(&gradient).map(|(a, b)| a - b).collect();
        update(&mut inverse, &moved, &change);
        let gain = value - next_value;
        (point, value, gradient) = (next, next_value, next_gradient);
        if gain < 1e-6 * (1.0 + value.abs()) {
            break;
        }
    }
    point
}

/// The gradient by central differences.
fn quotients(function: &(impl Fn(&[f64]) -> f64 + Sync), point: &[f64], value: f64) -> Vec<f64> {
    let at = |index: usize, step: f64| {
        let mut moved = point.to_vec();
        moved[index] += step;
        function(&moved)
    };
    let slope = |index: usize| {
        let slope = (at(index, STEP) - at(index, -STEP)) / (2.0 * STEP);
        if slope.is_finite() { slope } else { (at(index, -STEP) - value) / -STEP }
    };
    (0..point.len()).into_par_iter().map(slope).collect()
}

/// The first point along a step, halved again and again, that is low enough.
fn search(
    function: &impl Fn(&[f64]) -> f64,
    point: &[f64],
    value: f64,
    step: &[f64],
    slope: f64,
) -> Option<(Vec<f64>, f64)> {
    (0..HALVINGS).find_map(|halving| {
        let factor = 0.5_f64.powi(halving as i32);
        let next: Vec<f64> = point.iter().zip(step).map(|(at, step)| at + factor * step).collect();
        let reached = function(&next);
        (reached <= value + SUFFICIENT * factor * slope).then_some((next, reached))
    })
}

/// Updates the inverse of the Hessian where the curvature along the step is positive.
fn update(inverse: &mut [Vec<f64>], moved: &[f64], change: &[f64]) {
    let curvature = dot(moved, change);
    if curvature <= 1e-12 {
        return;
    }
    let product: Vec<f64> = inverse.iter().map(|row| dot(row, change)).collect();
    let factor = (1.0 + dot(change, &product) / curvature) / curvature;
    for i in 0..moved.len() {
        for j in 0..moved.len() {
            inverse[i][j] += factor * moved[i] * moved[j] - (product[i] * moved[j] + moved[i] * product[j]) / curvature;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_valley_of_rosenbrock_is_followed_to_its_minimum() {
        let rosenbrock = |x: &[f64]| (1.0 - x[0]).powi(2) + 100.0 * (x[1] - x[0] * x[0]).powi(2);
        let found = minimize(&[-1.2, 1.0], 200, rosenbrock);
        assert!((found[0] - 1.0).abs() < 1e-2 && (found[1] - 1.0).abs() < 2e-2, "{found:?}");
    }

    #[test]
    fn points_without_a_value_are_avoided() {
        let bounded = |x: &[f64]| if x[0] > 0.0 { x[0] - x[0].ln() } else { f64::INFINITY };
        assert!((minimize(&[0.01], 100, bounded)[0] - 1.0).abs() < 1e-2);
    }
}
