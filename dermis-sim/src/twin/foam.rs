//! The foam between a tip and the sheet, and how a tip sinks into it.

use super::TwinError;
use super::error::{check_between, check_positive};
use super::patch_shape::is_default;
use super::press::Press;
use crate::elementary::powf;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// The layer of foam between tip and patches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Foam {
    /// Its thickness, m.
    pub thickness_m: f64,
    /// Its modulus, Pa: pressure over strain of a foundation, Young's modulus over `1 - nu^2` of a half space.
    pub modulus_pa: f64,
    /// How a tip sinks into it.
    #[serde(default, skip_serializing_if = "is_default")]
    pub indentation: Indentation,
}

/// How a spherical tip sinks into a layer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Indentation {
    /// As into springs side by side, a foam whose pores collapse: an elastic foundation.
    #[default]
    Foundation,
    /// As into a half space of rubber: Hertz's contact.
    HalfSpace,
}

impl Foam {
    /// # Errors
    /// Invalid values.
    pub(super) fn check(&self) -> Result<(), TwinError> {
        check_positive("thickness_m", self.thickness_m, "0.003 is a thin neoprene foam")?;
        check_positive("modulus_pa", self.modulus_pa, "200000 is a soft neoprene foam")?;
        // Thicker foam spreads each press over the whole skin.
        check_between("thickness_m", self.thickness_m, [1e-5, 0.1], "0.003 is a thin neoprene foam")?;
        check_between("modulus_pa", self.modulus_pa, [1.0, 1e12], "200000 is a soft neoprene foam")
    }

    /// The indentation depth of a tip, m: `delta = sqrt(F h / (pi R E))` of a foundation, `delta = a^2 / R` of a half
    /// space.
    pub fn depth_m(&self, press: &Press) -> f64 {
        match self.indentation {
            Indentation::Foundation => {
                (press.force_n * self.thickness_m / (PI * press.tip_radius_m * self.modulus_pa)).sqrt()
            }
            Indentation::HalfSpace => self.contact_radius_m(press).powi(2) / press.tip_radius_m,
        }
    }

    /// Radius of the contact between tip and foam, m: `a = sqrt(2 R delta)` of a foundation, `a^3 = 3 F R / (4 E)` of a
    /// half space.
    pub(crate) fn contact_radius_m(&self, press: &Press) -> f64 {
        match self.indentation {
            Indentation::Foundation => (2.0 * press.tip_radius_m * self.depth_m(press)).sqrt(),
            Indentation::HalfSpace => powf(0.75 * press.force_n * press.tip_radius_m / self.modulus_pa, 1.0 / 3.0),
        }
    }
}

impl Indentation {
    /// Points of Gauss's rule on each panel of the contact. Hertz's pressure is steeper at the edge: three would leave an
    /// error of 2e-4 on the axis at 5 N.
    pub(super) fn points_per_panel(self) -> usize {
        match self {
            Indentation::Foundation => 3,
            Indentation::HalfSpace => 5,
        }
    }

    /// A ring of the tip's pressure from a point of a rule over 0 to the contact radius: its radius and its force, N.
    pub(super) fn ring(self, force_n: f64, radius_m: f64, s: f64, weight: f64) -> (f64, f64) {
        match self {
            Indentation::Foundation => {
                (s, weight * 4.0 * force_n * s / (radius_m * radius_m) * (1.0 - (s / radius_m) * (s / radius_m)))
            }
            // With t = sqrt(1 - r^2 / a^2) the force outside the radius r is F t^3, so that dF = 3 F t^2 dt.
            Indentation::HalfSpace => {
                let t = s / radius_m;
                (radius_m * (1.0 - t * t).sqrt(), weight / radius_m * 3.0 * force_n * t * t)
            }
        }
    }
}
