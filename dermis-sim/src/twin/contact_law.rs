//! Contact conductance between a patch and the coating as a function of the pressure.

use super::TwinError;
use super::error::{check_between, check_positive};
use crate::elementary::{Lanes, powf, powf_lanes, replace_in_lanes};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Contact conductance per area between patch and coating as a function of the pressure.
///
/// `g(p) = c / (1 + c / g_max)` with `c = g_ref (p / p_ref)^n`: a power law with saturation. The exponent is 1/2 if one
/// contact spot grows elastically or plastically, and near 1 if the number of spots grows with the pressure (Holm,
/// Electric Contacts, 4th ed. 1967, DOI 10.1007/978-3-662-06688-1; Greenwood and Williamson, 1966, DOI
/// 10.1098/rspa.1966.0242). It saturates when the fabric is in full contact with the coating.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ContactLaw {
    /// `g_ref`: conductance per area at the reference pressure, without saturation, S/m2.
    pub conductance_s_per_m2: f64,
    /// `p_ref`, Pa.
    pub reference_pressure_pa: f64,
    /// `n`.
    pub exponent: f64,
    /// `g_max`: conductance per area at full contact, S/m2.
    pub saturation_s_per_m2: f64,
    /// Pressure of the foam everywhere without a press, Pa; 0 if patches are loose.
    #[serde(default)]
    pub preload_pa: f64,
    /// Hysteresis: the fraction of the conductance at the highest pressure that remains while the pressure decreases: 0
    /// for none, below 1. The contact behaves as at `p (p_max / p)^hysteresis`, `p_max` the highest pressure since it
    /// closed. It has an effect while a press is released or slides, as on an emulated device. The tip leaves the skin
    /// between the presses of an experiment and the samples of a dataset, so each of these starts without history.
    #[serde(default)]
    pub hysteresis: f64,
}

impl ContactLaw {
    /// Conductance per area at a pressure, S/m2.
    pub fn conductance_s_per_m2(&self, pressure_pa: f64) -> f64 {
        if pressure_pa <= 0.0 {
            return 0.0;
        }
        let free = self.conductance_s_per_m2 * powf(pressure_pa / self.reference_pressure_pa, self.exponent);
        free / (1.0 + free / self.saturation_s_per_m2)
    }

    /// Replaces pressures, Pa, by the [conductances](Self::conductance_s_per_m2) there, eight at a time; the relative
    /// difference is below 1e-14.
    pub(crate) fn replace_by_conductances(&self, values: &mut [f64]) {
        replace_in_lanes(values, |pressures_pa| self.conductance_lanes(pressures_pa));
    }

    #[inline(always)]
    fn conductance_lanes(&self, pressures_pa: &Lanes) -> Lanes {
        let mut ratios = *pressures_pa;
        for ratio in &mut ratios {
            *ratio /= self.reference_pressure_pa;
        }
        let free = powf_lanes(&ratios, self.exponent);
        let mut conductances = [0.0; 8];
        for lane in 0..8 {
            let free = self.conductance_s_per_m2 * free[lane];
            let limited = free / (1.0 + free / self.saturation_s_per_m2);
            conductances[lane] = if pressures_pa[lane] > 0.0 { limited } else { 0.0 };
        }
        conductances
    }

    /// Conductance per area at a pressure after a higher one, S/m2. A pure function: `highest_pa` is the highest
    /// pressure since the contact closed, the present one included; the caller stores it.
    pub(super) fn conductance_after_s_per_m2(&self, pressure_pa: f64, highest_pa: f64) -> f64 {
        if pressure_pa <= 0.0 || self.hysteresis == 0.0 {
            return self.conductance_s_per_m2(pressure_pa);
        }
        self.conductance_s_per_m2(pressure_pa * powf(highest_pa.max(pressure_pa) / pressure_pa, self.hysteresis))
    }

    /// The highest pressure for the next call: it increases with the pressure, and is reset when the contact is back at
    /// the preload.
    pub(super) fn highest_pa(&self, pressure_pa: f64, highest_before_pa: f64) -> f64 {
        if pressure_pa <= self.preload_pa { pressure_pa } else { pressure_pa.max(highest_before_pa) }
    }

    /// # Errors
    /// Invalid values.
    pub(super) fn check(&self) -> Result<(), TwinError> {
        check_positive("conductance_s_per_m2", self.conductance_s_per_m2, "20 is a fabric pressed on a coat")?;
        check_positive("reference_pressure_pa", self.reference_pressure_pa, "10000 is the pressure of a finger")?;
        check_positive("saturation_s_per_m2", self.saturation_s_per_m2, "a large number switches saturation off")?;
        check_between("exponent", self.exponent, [0.2, 1.5], "contacts have 0.5 to 1")?;
        check_between("preload_pa", self.preload_pa, [0.0, 1e6], "0 where patches lie loose")?;
        check_between("hysteresis", self.hysteresis, [0.0, 0.99], "0 switches it off")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAW: ContactLaw = ContactLaw {
        conductance_s_per_m2: 20.0,
        reference_pressure_pa: 1e4,
        exponent: 0.7,
        saturation_s_per_m2: 200.0,
        preload_pa: 0.0,
        hysteresis: 0.3,
    };

    #[test]
    fn conductance_is_a_power_law_that_saturates() {
        let slope = |p: f64| {
            let [low, high] = [p, p * 1.001].map(|p| LAW.conductance_s_per_m2(p));
            (high / low).ln() / 1.001f64.ln()
        };
        assert!((slope(1.0) - 0.7).abs() < 1e-3, "{}", slope(1.0));
        // At c = g_max the slope is half of the exponent.
        let half_way = 1e4 * 10f64.powf(1.0 / 0.7);
        assert!((slope(half_way) - 0.35).abs() < 1e-3, "{}", slope(half_way));
        assert!((LAW.conductance_s_per_m2(half_way) - 100.0).abs() < 1e-9);
        assert!(LAW.conductance_s_per_m2(1e12) < 200.0 && LAW.conductance_s_per_m2(1e12) > 199.9);
        assert_eq!(LAW.conductance_s_per_m2(0.0), 0.0);
    }

    #[test]
    fn eight_pressures_at_once_have_the_same_conductances() {
        let pressures: Vec<f64> = (-3..240).map(|k| if k < 0 { f64::from(k) } else { 1.13f64.powi(k - 130) }).collect();
        let mut values = pressures.clone();
        LAW.replace_by_conductances(&mut values);
        for (value, pressure) in values.iter().zip(&pressures) {
            let exact = LAW.conductance_s_per_m2(*pressure);
            assert!((value - exact).abs() <= 1e-14 * exact, "{pressure} Pa: {value} S/m2, {exact} one by one");
        }
    }

    #[test]
    fn the_unloading_curve_is_above_the_loading_curve_and_closes_the_loop() {
        let (mut highest, mut loop_area) = (0.0, 0.0);
        let up: Vec<f64> = (0..=50).map(|k| f64::from(k) * 400.0).collect();
        let down: Vec<f64> = up.iter().rev().copied().collect();
        let mut previous = (0.0, 0.0);
        for &pressure in up.iter().chain(&down) {
            highest = LAW.highest_pa(pressure, highest);
            let now = LAW.conductance_after_s_per_m2(pressure, highest);
            assert!(now >= LAW.conductance_s_per_m2(pressure));
            loop_area += 0.5 * (now + previous.1) * (pressure - previous.0);
            previous = (pressure, now);
        }
        assert_eq!((previous, highest), ((0.0, 0.0), 0.0), "the loop closes and is forgotten");
        assert!(loop_area < 0.0, "unloading takes another way: {loop_area}");
        let none = ContactLaw { hysteresis: 0.0, ..LAW };
        assert_eq!(none.conductance_after_s_per_m2(3e3, 9e3), none.conductance_s_per_m2(3e3));
    }
}
