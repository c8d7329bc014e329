//! What a dataset is made of: the distributions from which its samples are drawn.

use crate::dataset::DatasetError;
use crate::design::TouchEffect;
use serde::{Deserialize, Serialize};

/// Most touches that a sample may have: more than fingers of two hands are a typing error.
const MOST_TOUCHES: usize = 16;

/// Everything that decides what the samples are, beside the design and its mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// The seed: sample `i` depends on `(seed, i)` alone.
    pub seed: u64,
    /// How many samples.
    pub samples: u64,
    /// What touches do, and how they are drawn.
    pub touch: Touch,
}

/// What touches do, and how they are drawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Touch {
    /// Gaussian changes of conductance, as the paper trains on.
    Gaussian(GaussianTouches),
}

/// Gaussian touches: `1 + sum of A exp(-d^2 / (2 w^2))` times the untouched conductance, the sum taken off where touches
/// lower it. Their places are uniform by area over the whole surface, rim and seam included.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaussianTouches {
    /// A sample has 1 to this many touches, each number as often.
    pub most: usize,
    /// Lowest and highest width `w` (standard deviation along the surface), m; uniform between.
    pub width_m: [f64; 2],
    /// Lowest and highest amplitude `A`, the relative change in the middle; uniform in its logarithm between.
    pub amplitude: [f64; 2],
}

impl GaussianTouches {
    /// 1 to 4 touches, 5 to 15 mm wide: from half of the paper's patch to the foot of a hand. Amplitudes from 0.1 to 2
    /// where touches raise conductance; from 0.05 to 0.2 where they lower it, so that four in one place leave some.
    pub fn for_effect(effect: TouchEffect) -> Self {
        let amplitude = match effect {
            TouchEffect::ConductanceRises => [0.1, 2.0],
            TouchEffect::ConductanceFalls => [0.05, 0.2],
        };
        GaussianTouches { most: 4, width_m: [0.005, 0.015], amplitude }
    }

    /// Checks everything that can be checked without a mesh.
    ///
    /// # Errors
    /// A number that no touch has; amplitudes that could leave no conductance.
    pub fn check(&self, effect: TouchEffect) -> Result<(), DatasetError> {
        check_count(self.most)?;
        check_range("the width of touches in m", self.width_m)?;
        check_range("the amplitude of touches", self.amplitude)?;
        let strongest = self.most as f64 * self.amplitude[1];
        if effect == TouchEffect::ConductanceFalls && strongest >= 1.0 {
            return Err(DatasetError::OutOfRange {
                what: "the most touches times their highest amplitude",
                value: strongest,
                must: "below 1 where touches lower the conductance, or nothing of it may be left".into(),
            });
        }
        Ok(())
    }
}

fn check_count(most: usize) -> Result<(), DatasetError> {
    if (1..=MOST_TOUCHES).contains(&most) {
        return Ok(());
    }
    let must = format!("1 to {MOST_TOUCHES}");
    Err(DatasetError::OutOfRange { what: "the most touches of a sample", value: most as f64, must })
}

fn check_range(what: &'static str, [low, high]: [f64; 2]) -> Result<(), DatasetError> {
    for value in [low, high] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(DatasetError::OutOfRange { what, value, must: "positive and finite".into() });
        }
    }
    if high < low {
        let must = format!("at least {low} at its upper end, the lower end");
        return Err(DatasetError::OutOfRange { what, value: high, must });
    }
    Ok(())
}

impl Recipe {
    /// Checks everything that can be checked without a mesh.
    ///
    /// # Errors
    /// No samples; numbers that no touch has.
    pub fn check(&self, effect: TouchEffect) -> Result<(), DatasetError> {
        if self.samples == 0 {
            return Err(DatasetError::OutOfRange {
                what: "the number of samples",
                value: 0.0,
                must: "at least 1".into(),
            });
        }
        match &self.touch {
            Touch::Gaussian(touches) => touches.check(effect),
        }
    }

    /// Most touches of a sample.
    pub fn most_touches(&self) -> usize {
        match &self.touch {
            Touch::Gaussian(touches) => touches.most,
        }
    }
}
