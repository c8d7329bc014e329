//! The force of a contact from its strength, if the method is calibrated.

use crate::stats::{order_statistic, upper_median};
use serde::{Deserialize, Serialize};

/// Conversion of the strengths of a method's contacts to forces, measured on presses of known force.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Forces {
    /// Median ratio of force to strength, N per unit of strength.
    pub newtons_per_strength: f64,
    /// Relative standard deviation of a force: that of a Gaussian with the same 68 % quantile of the errors.
    pub relative_sd: f64,
}

/// Minimum number of presses for a calibration.
const LEAST_PRESSES: usize = 30;
/// The fraction of a Gaussian within one standard deviation.
const WITHIN_ONE: f64 = 0.682_689_492;

impl Forces {
    /// From the ratios of force to strength of presses; ratios that are not finite are ignored. `None` if too few are
    /// left.
    pub fn fit(ratios: impl Iterator<Item = f64>) -> Option<Self> {
        let ratios: Vec<f64> = ratios.filter(|ratio| ratio.is_finite() && *ratio > 0.0).collect();
        if ratios.len() < LEAST_PRESSES {
            return None;
        }
        let newtons_per_strength = upper_median(&ratios)?;
        // The relative error of the stated force.
        let off: Vec<f64> = ratios.iter().map(|ratio| (ratio / newtons_per_strength - 1.0).abs()).collect();
        let relative_sd = order_statistic(&off, ((off.len() - 1) as f64 * WITHIN_ONE) as usize);
        Some(Forces { newtons_per_strength, relative_sd })
    }

    /// Checks values that were read from a file.
    ///
    /// # Errors
    /// The field and its value.
    pub fn check(&self) -> Result<(), String> {
        let Forces { newtons_per_strength, relative_sd } = self;
        for (name, value) in [("newtons_per_strength", newtons_per_strength), ("relative_sd", relative_sd)] {
            if !(*value > 0.0 && value.is_finite()) {
                return Err(format!("{name} is {value}: it must be positive"));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_sim::random::{sample_rng, standard_normal};

    #[test]
    fn the_spread_of_known_ratios_is_found() {
        let mut rng = sample_rng(3, 0);
        let ratios = (0..20_000).map(|_| 4000.0 * (1.0 + 0.2 * standard_normal(&mut rng)));
        let forces = Forces::fit(ratios.chain([f64::NAN, f64::INFINITY])).unwrap();
        assert!((forces.newtons_per_strength / 4000.0 - 1.0).abs() < 0.01, "{forces:?}");
        assert!((forces.relative_sd - 0.2).abs() < 0.01, "{forces:?}");
        assert_eq!(Forces::fit([1.0; 29].into_iter()), None);
    }
}
