use super::*;

/// The residuals `10 (y - x^2)` and `1 - x`, whose minimum is at (1, 1) (Rosenbrock, 1960, DOI 10.1093/comjnl/3.3.175), with
/// steps of at most 2 along each axis.
struct Valley;

impl LeastSquares for Valley {
    type Point = [f64; 2];
    type Equations = Normal;
    type Error = NotPositiveDefinite;

    fn cost(&self, [x, y]: &[f64; 2]) -> f64 {
        100.0 * (y - x * x).powi(2) + (1.0 - x).powi(2)
    }

    fn equations(&self, [x, y]: &[f64; 2]) -> Result<Normal, NotPositiveDefinite> {
        // The derivatives of the model, which is minus the residuals.
        let derivatives = Matrix { rows: 2, columns: 2, values: vec![20.0 * x, -10.0, 1.0, 0.0] };
        Ok(Normal::of(&derivatives, &[10.0 * (y - x * x), 1.0 - x]))
    }

    fn limit(&self, _: &[f64; 2], step: &mut [f64]) {
        step.iter_mut().for_each(|part| *part = part.clamp(-2.0, 2.0));
    }

    fn moved(&self, from: &[f64; 2], step: &[f64]) -> Option<[f64; 2]> {
        Some([from[0] + step[0], from[1] + step[1]])
    }
}

const START: [f64; 2] = [-1.2, 1.0];

fn steps(control: Control) -> Steps {
    Steps { most: 200, control, shortest: 1e-10, least_decrease: 0.0 }
}

#[test]
fn every_control_finds_the_minimum_and_lowers_the_cost_if_it_promises_to() {
    let damping = Control::Damping { first: 1e-3, down: 0.1, up: 10.0 };
    for control in [Control::Full, Control::Halving(20), damping] {
        let found = minimise(&Valley, START, &steps(control)).unwrap();
        assert!((found.point[0] - 1.0).abs() < 1e-8 && (found.point[1] - 1.0).abs() < 1e-8, "{control:?} {found:?}");
        let falls = found.costs.windows(2).all(|pair| pair[1] < pair[0]);
        assert!(falls || control == Control::Full, "{control:?} {:?}", found.costs);
    }
    // Undamped steps are taken to where the cost is larger.
    let full = minimise(&Valley, START, &Steps { most: 2, ..steps(Control::Full) }).unwrap();
    assert!(full.costs[2] > full.costs[1] || full.costs[1] > full.costs[0], "{:?}", full.costs);
    assert_eq!(full.end, End::MostSteps);
}

#[test]
fn a_search_ends_where_the_decrease_is_small_or_no_step_lowers_the_cost() {
    let few = Steps { least_decrease: 0.9999, ..steps(Control::Halving(20)) };
    let found = minimise(&Valley, START, &few).unwrap();
    assert_eq!((found.end, found.costs.len()), (End::Converged, 2));
    let there = minimise(&Valley, [1.0, 1.0], &Steps { shortest: 0.0, ..steps(Control::Halving(3)) }).unwrap();
    assert_eq!((there.end, there.costs.len()), (End::NoDecrease, 1));
}

/// Of a linear model with a Gaussian prior the first step is the whole way, and the inverse of the factor is the covariance:
/// with the precision `1/s^2` of one value and that of the prior, the weighted mean and `1 / (1/s^2 + 1)`.
#[test]
fn a_linear_model_with_a_prior_needs_one_step() {
    let normal = Normal::new(&[&[2.0, 2.0]], &[2.0 * 0.8, 2.0 * 1.2]).with_unit_priors(&[0.0]);
    // Two values with the deviation 0.5 and the mean 1: the precision 8, and 1 of the prior.
    assert!((normal.step(0.0).unwrap()[0] - 8.0 / 9.0).abs() < 1e-15);
    assert!((normal.factor().unwrap().inverse().at(0, 0) - 1.0 / 9.0).abs() < 1e-15);
    assert!((normal.step(1.0).unwrap()[0] - 8.0 / 18.0).abs() < 1e-15, "the diagonal is doubled");
    let column: &[f64] = &[1.0, 3.0];
    let twice = Normal::new(&[column, column], &[1.0, 1.0]);
    assert_eq!(twice.step(0.0).unwrap_err().unknown, 1, "two unknowns with the same effect");
}
