//! A contact on the skin: one type for ground truth and estimate.
//!
//! ```
//! use dermis::contact::Contact;
//!
//! let touch = Contact::truth([0.01, 0.0, 0.0], [0.0, 0.0, 1.0], 2.0); // m, unit normal, N
//! assert!(touch.sd_m.is_nan(), "a truth has no standard deviation");
//! ```

use crate::geom::Point3;
use serde::{Deserialize, Deserializer, Serialize};

/// One contact on the skin, true or estimated.
///
/// An unknown quantity is `NaN` (ground truth has no standard deviation, uncalibrated estimates have no force).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// Number of the contact, unique within its frame. With tracking it stays the same while the contact lasts.
    pub id: u64,
    /// Position on the surface, in the body's frame, m.
    pub position_m: Point3,
    /// Outward unit normal at the position.
    pub normal: Point3,
    /// Integral of the image over the contact: relative change of conductance times area, m2.
    #[serde(deserialize_with = "number_or_null")]
    pub strength: f64,
    /// Area where the image exceeds half of the contact's peak, m2.
    #[serde(deserialize_with = "number_or_null")]
    pub area_m2: f64,
    /// Normal force on the skin, positive when pressing, N.
    #[serde(deserialize_with = "number_or_null")]
    pub force_n: f64,
    /// Standard deviation of the force, N.
    #[serde(default = "unknown", deserialize_with = "number_or_null")]
    pub force_sd_n: f64,
    /// Standard deviation of the position along the surface, per axis, m.
    #[serde(deserialize_with = "number_or_null")]
    pub sd_m: f64,
    /// Probability that a true contact is within 20 mm.
    pub confidence: f64,
    /// The sign of the conductance change, where contacts of both signs were looked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conductance: Option<ConductanceChange>,
}

/// The sign of a conductance change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum ConductanceChange {
    /// The contact conducts better than the untouched skin: a conductor in a tank.
    Rises,
    /// It conducts worse: an insulator.
    Falls,
}

impl ConductanceChange {
    /// Its name in tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            ConductanceChange::Rises => "rises",
            ConductanceChange::Falls => "falls",
        }
    }

    /// 1 if it rises, -1 if it falls.
    pub fn sign(self) -> f64 {
        match self {
            ConductanceChange::Rises => 1.0,
            ConductanceChange::Falls => -1.0,
        }
    }

    /// The other sign.
    #[must_use]
    pub fn reversed(self) -> Self {
        match self {
            ConductanceChange::Rises => ConductanceChange::Falls,
            ConductanceChange::Falls => ConductanceChange::Rises,
        }
    }
}

impl Contact {
    /// The columns of a contact in tables (CSV, NPZ): the keys of its JSON, vectors by component.
    pub const COLUMNS: [&str; 13] = [
        "id",
        "x_m",
        "y_m",
        "z_m",
        "normal_x",
        "normal_y",
        "normal_z",
        "force_n",
        "force_sd_n",
        "strength",
        "area_m2",
        "sd_m",
        "confidence",
    ];

    /// The values of [`COLUMNS`](Self::COLUMNS) without the id; unknown values are `NaN`.
    pub fn values(&self) -> [f64; 12] {
        let Contact { position_m: [x, y, z], normal: [nx, ny, nz], .. } = *self;
        let Contact { force_n, force_sd_n, strength, area_m2, sd_m, confidence, .. } = *self;
        [x, y, z, nx, ny, nz, force_n, force_sd_n, strength, area_m2, sd_m, confidence]
    }

    /// A known touch at a place; unknown quantities are `NaN`.
    pub fn truth(position_m: Point3, normal: Point3, force_n: f64) -> Self {
        Contact {
            id: 0,
            position_m,
            normal,
            strength: f64::NAN,
            area_m2: f64::NAN,
            force_n,
            force_sd_n: f64::NAN,
            sd_m: f64::NAN,
            confidence: 1.0,
            conductance: None,
        }
    }
}

fn unknown() -> f64 {
    f64::NAN
}

/// JSON has no `NaN`: it is written and read as `null`.
fn number_or_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_known_comes_back_from_json_as_such() {
        let contact = Contact { strength: 0.1, ..Contact::truth([1.0, 2.0, 3.0], [0.0, 0.0, 1.0], f64::NAN) };
        let back: Contact = serde_json::from_str(&serde_json::to_string(&contact).unwrap()).unwrap();
        assert!(back.force_n.is_nan() && back.area_m2.is_nan());
        assert_eq!((back.strength, back.position_m), (0.1, [1.0, 2.0, 3.0]));
    }

    #[test]
    fn the_sign_of_a_change_is_written_only_where_it_is_known() {
        let contact = Contact::truth([1.0, 2.0, 3.0], [0.0, 0.0, 1.0], f64::NAN);
        assert!(!serde_json::to_string(&contact).unwrap().contains("conductance"));
        let contact = Contact { conductance: Some(ConductanceChange::Falls), ..contact };
        let text = serde_json::to_string(&contact).unwrap();
        assert!(text.ends_with(",\"conductance\":\"falls\"}"), "{text}");
        assert_eq!(serde_json::from_str::<Contact>(&text).unwrap().conductance, contact.conductance);
    }
}
