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
    /// Largest force that is stated, N: stronger contacts have at least this force. `None` for no limit.
    #[serde(default)]
    pub most_n: Option<f64>,
}

/// Minimum number of presses for a calibration.
const MIN_PRESSES: usize = 30;
/// The fraction of a Gaussian within one standard deviation.
const WITHIN_ONE: f64 = 0.682_689_492;

impl Forces {
    /// Forces are not extrapolated by more than this factor beyond those of the calibration.
    pub const EXTRAPOLATION: f64 = 1.5;

    /// From presses: the force of each, N, and its ratio to the strength. Ratios that are not finite are ignored. `None`
    /// if too few are left.
    pub fn fit(presses: impl Iterator<Item = (f64, f64)>) -> Option<Self> {
        let known: Vec<(f64, f64)> = presses.filter(|(_, ratio)| ratio.is_finite() && *ratio > 0.0).collect();
        let ratios: Vec<f64> = known.iter().map(|(_, ratio)| *ratio).collect();
        if ratios.len() < MIN_PRESSES {
            return None;
        }
        let newtons_per_strength = upper_median(&ratios)?;
        // The relative error of the stated force.
        let off: Vec<f64> = ratios.iter().map(|ratio| (ratio / newtons_per_strength - 1.0).abs()).collect();
        let relative_sd = order_statistic(&off, ((off.len() - 1) as f64 * WITHIN_ONE) as usize);
        let most_n = Self::EXTRAPOLATION * known.iter().map(|(force_n, _)| *force_n).fold(0.0, f64::max);
        Some(Forces { newtons_per_strength, relative_sd, most_n: Some(most_n) })
    }

    /// The force of a contact with some strength and its standard deviation, N. The deviation is `NaN` if the force is
    /// larger than the calibration can tell: then it is a lower bound.
    pub fn of(&self, strength: f64) -> [f64; 2] {
        let force_n = self.newtons_per_strength * strength;
        match self.most_n {
            Some(most_n) if force_n > most_n => [most_n, f64::NAN],
            _ => [force_n, self.relative_sd * force_n],
        }
    }

    /// Checks values that were read from a file.
    ///
    /// # Errors
    /// The field and its value.
    pub fn check(&self) -> Result<(), String> {
        let Forces { newtons_per_strength, relative_sd, most_n } = self;
        let values = [("newtons_per_strength", Some(newtons_per_strength)), ("relative_sd", Some(relative_sd))];
        for (name, value) in values.into_iter().chain([("most_n", most_n.as_ref())]) {
            let Some(value) = value else { continue };
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
        let presses =
            ratios.chain([f64::NAN, f64::INFINITY]).enumerate().map(|(k, ratio)| (1.0 + (k % 5) as f64, ratio));
        let forces = Forces::fit(presses).unwrap();
        assert!((forces.newtons_per_strength / 4000.0 - 1.0).abs() < 0.01, "{forces:?}");
        assert!((forces.relative_sd - 0.2).abs() < 0.01, "{forces:?}");
        assert_eq!(Forces::fit([(1.0, 1.0); 29].into_iter()), None);
        assert_eq!(forces.most_n, Some(7.5));
        let [force_n, sd_n] = forces.of(7.4 / forces.newtons_per_strength);
        assert!((force_n - 7.4).abs() < 1e-9 && (sd_n / 7.4 - forces.relative_sd).abs() < 1e-9);
        assert!(forces.of(1e9)[0] == 7.5 && forces.of(1e9)[1].is_nan());
    }
}
