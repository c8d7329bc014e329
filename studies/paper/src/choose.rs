//! Selection of alpha for a linear method, on twins that are not reported.

use crate::bench::{Bench, Pressed};
use crate::scale::{CHOOSING_SEED, Scale};
use dermis::contact::GATE_M;
use dermis::reconstruct::Alpha;
use dermis_sim::evaluate::Score;
use dermis_study::Result;
use dermis_study::comparison::{LINEAR, Named, Shown};
use serde::{Deserialize, Serialize};

/// Exponents of ten of the tested alphas, in quarters: from images dominated by noise to over-smoothed images.
const QUARTER_POWERS: std::ops::RangeInclusive<i32> = -6..=4;

/// A tested alpha and its cost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Tried {
    /// Alpha.
    pub alpha: f64,
    /// Mean distance of a press from its contact, m; a miss or a false positive counts as the gate of 20 mm.
    pub cost_m: f64,
}

/// All tested alphas of each linear method, and the best one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Choice {
    /// Best alpha of each method of [`LINEAR`].
    pub alphas: Vec<f64>,
    /// All tested alphas of each method.
    pub tried: Vec<Vec<Tried>>,
}

impl Choice {
    /// Tests all alphas on twins that are not reported.
    pub(crate) fn make(bench: &Bench<'_>, scale: Scale) -> Result<Self> {
        let seeds = CHOOSING_SEED..CHOOSING_SEED + scale.choosing_twins();
        let count = scale.choosing_presses();
        let task = bench.progress.begin("pressing twins to choose alpha", count * seeds.clone().count());
        let press = |seed| {
            let presses = bench.presses(seed).at_random(count).presses;
            bench.press(seed, &presses, scale.untouched(), &*task)
        };
        let pressed: Vec<Pressed> = seeds.map(press).collect::<Result<_>>()?;
        let tried: Vec<Vec<Tried>> =
            (0..LINEAR.len()).map(|which| try_all(bench, which, &pressed)).collect::<Result<_>>()?;
        let best = |tried: &Vec<Tried>| {
            let best = tried.iter().min_by(|a, b| a.cost_m.total_cmp(&b.cost_m));
            best.expect("alphas were tried").alpha
        };
        Ok(Choice { alphas: tried.iter().map(best).collect(), tried })
    }

    /// The linear methods with these alphas.
    pub(crate) fn methods(&self, bench: &Bench<'_>) -> Result<Vec<Named>> {
        let linear = |(which, &alpha): (usize, &f64)| Named::linear(which, &bench.skin, Alpha::Given(alpha));
        self.alphas.iter().enumerate().map(linear).collect()
    }
}

fn try_all(bench: &Bench<'_>, which: usize, pressed: &[Pressed]) -> Result<Vec<Tried>> {
    let try_one = |quarter: i32| {
        let alpha = 10f64.powf(0.25 * f64::from(quarter));
        let method = Named::linear(which, &bench.skin, Alpha::Given(alpha))?;
        let cost = |one: &Pressed| {
            let detector = method.method.detector(&one.untouched, &bench.skin.design().protocol)?;
            Ok(cost_m(&Shown::of(&method, &one.recording, &one.truth, &detector, bench.progress)?.score))
        };
        let costs: Vec<f64> = pressed.iter().map(cost).collect::<Result<_>>()?;
        Ok(Tried { alpha, cost_m: costs.iter().sum::<f64>() / costs.len() as f64 })
    };
    QUARTER_POWERS.map(try_one).collect()
}

fn cost_m(score: &Score) -> f64 {
    let found = (score.presses - score.misses) as f64;
    let near = if found > 0.0 { found * score.localisation_m.mean } else { 0.0 };
    (near + GATE_M * (score.misses + score.false_positives) as f64) / score.presses as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::stats::Summary;

    #[test]
    fn a_miss_and_a_false_positive_cost_as_much_as_the_gate() {
        let summary = |mean| Summary { mean, sd: 0.0, median: mean, p95: mean, largest_tenth: mean };
        let score = |misses, false_positives, mean| Score {
            presses: 10,
            misses,
            false_positives,
            localisation_m: summary(mean),
            eq11_m: summary(0.0),
            sensitivity_spread: 0.0,
            strength_spread: 0.0,
            force: None,
            method: String::new(),
            alpha: None,
        };
        assert!((cost_m(&score(0, 0, 0.004)) - 0.004).abs() < 1e-12);
        assert!((cost_m(&score(2, 1, 0.005)) - (8.0 * 0.005 + 3.0 * 0.02) / 10.0).abs() < 1e-12);
        assert!((cost_m(&score(10, 0, f64::NAN)) - 0.02).abs() < 1e-12);
    }
}
