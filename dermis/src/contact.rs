//! A contact on the skin: one type for ground truth and estimate.
//!
//! ```
//! use dermis::contact::Contact;
//!
//! let touch = Contact::truth([0.01, 0.0, 0.0], [0.0, 0.0, 1.0], 2.0); // m, unit normal, N
//! assert!(touch.sd_m.is_nan(), "a truth has no standard deviation");
//! ```

use crate::geom::Point3;
use FieldKind::{Change, Count, Number};
use serde::{Deserialize, Deserializer, Serialize};

/// A true contact counts as found within this distance: the gate of the scores, m.
pub const GATE_M: f64 = 0.02;
/// The confidence of a certain contact without grounds for more: the noise is not known, or touches do not explain the frame.
pub const DOUBT: f64 = 0.5;

/// The radius, in standard deviations per axis, that contains 95 % of a two-dimensional Gaussian: the square root of
/// `-2 ln 0.05`.
pub const REGION_95_SD: f64 = 2.447_746_830_680_816;

/// One contact on the skin, true or estimated.
///
/// An unknown quantity is `NaN`, in JSON `null` (ground truth has no standard deviation, uncalibrated estimates have no
/// force).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Contact {
    /// Number of the contact, unique within its frame. With tracking it is constant while the contact lasts and never used
    /// again.
    pub id: u64,
    /// Position on the surface, in the body's frame, m.
    pub position_m: Point3,
    /// Outward unit normal at the position.
    pub normal: Point3,
    /// Integral of the image over the contact: relative change of conductance (or newtons, for images of touches) times
    /// area, m2.
    #[serde(deserialize_with = "number_or_null")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>"))]
    pub strength: f64,
    /// Area where the image, or the density of a fitted touch, exceeds half of the contact's peak, m2.
    #[serde(deserialize_with = "number_or_null")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>"))]
    pub area_m2: f64,
    /// Unit vector along the contact, in the tangent plane at the position; the opposite one is as good. Unknown unless its
    /// form was fitted.
    #[serde(default = "unknown_vector", deserialize_with = "vector_or_null")]
    #[cfg_attr(feature = "schema", schemars(with = "[Option<f64>; 3]"))]
    pub direction: Point3,
    /// Half its length along the direction, where its density exceeds half of its peak, m.
    #[serde(default = "unknown", deserialize_with = "number_or_null")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>"))]
    pub half_length_m: f64,
    /// Half its width across the direction, at most the half length, m.
    #[serde(default = "unknown", deserialize_with = "number_or_null")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>"))]
    pub half_width_m: f64,
    /// Normal force on the skin, positive when pressing, N; only if the skin or the method is calibrated.
    #[serde(deserialize_with = "number_or_null")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>"))]
    pub force_n: f64,
    /// Standard deviation of the force, N; unknown with a force that is a lower bound, because it is larger than the
    /// calibration can tell.
    #[serde(default = "unknown", deserialize_with = "number_or_null")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>"))]
    pub force_sd_n: f64,
    /// Distance of the position from the edge of the skin, m; unknown on a closed skin. Contacts within 15 mm of an edge that is
    /// far from electrodes are less certain.
    #[serde(default = "unknown", deserialize_with = "number_or_null")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>"))]
    pub edge_m: f64,
    /// Standard deviation of the position along the surface, per axis, m.
    #[serde(deserialize_with = "number_or_null")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>"))]
    pub sd_m: f64,
    /// Probability that a true contact is within 20 mm.
    pub confidence: f64,
    /// The sign of the conductance change, where contacts of both signs are looked for: `rises` or `falls`, as a number 1
    /// or -1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conductance: Option<ConductanceChange>,
}

impl Contact {
    /// Whether the force is known. One without a standard deviation is a lower bound.
    pub fn force_is_known(&self) -> bool {
        self.force_n.is_finite() && self.force_sd_n.is_finite()
    }
}

/// A field of a contact: its names and its value in every output. JSON follows from the type itself.
#[derive(Debug)]
pub struct Field<T> {
    /// Its key in JSON.
    pub key: &'static str,
    /// Its columns in tables, one for each component.
    pub columns: &'static [&'static str],
    /// Its fields in a point cloud of ROS 2, one for each component; empty if float32 cannot hold it.
    pub ros: &'static [&'static str],
    /// What its numbers are.
    pub kind: FieldKind,
    /// Its components, each a number: `NaN` if unknown.
    value: fn(&T) -> Point3,
}

/// The kind of a [`Field`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldKind {
    /// A whole number.
    Count,
    /// A number, or a vector.
    Number,
    /// The sign of a change: 1 if it [rises](ConductanceChange), -1 if it falls.
    Change,
    /// Yes, 1, or no, 0.
    Flag,
}

impl<T> Field<T> {
    /// A field; the columns, and the fields in ROS 2, are those of the first components of the value.
    pub(crate) const fn new(
        key: &'static str,
        columns: &'static [&'static str],
        ros: &'static [&'static str],
        kind: FieldKind,
        value: fn(&T) -> Point3,
    ) -> Self {
        Field { key, columns, ros, kind, value }
    }

    /// Its name in structured arrays: the key of a vector, the column of a number.
    pub fn array_name(&self) -> &'static str {
        if let [column] = self.columns { column } else { self.key }
    }

    /// Its components as numbers.
    pub fn numbers(&self, of: &T) -> impl Iterator<Item = f64> {
        (self.value)(of).into_iter().take(self.columns.len())
    }
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
    /// Its fields, in the order of tables.
    pub const FIELDS: [Field<Self>; 14] = [
        Field::new("id", &["id"], &["id"], Count, |contact| [contact.id as f64; 3]),
        Field::new("position_m", &["x_m", "y_m", "z_m"], &["x", "y", "z"], Number, |contact| contact.position_m),
        Field::new("normal", &["normal_x", "normal_y", "normal_z"], &["nx", "ny", "nz"], Number, |contact| {
            contact.normal
        }),
        Field::new("force_n", &["force_n"], &["force"], Number, |contact| [contact.force_n; 3]),
        Field::new("force_sd_n", &["force_sd_n"], &["force_sd"], Number, |contact| [contact.force_sd_n; 3]),
        Field::new("strength", &["strength"], &["strength"], Number, |contact| [contact.strength; 3]),
        Field::new("area_m2", &["area_m2"], &["area"], Number, |contact| [contact.area_m2; 3]),
        Field::new(
            "direction",
            &["direction_x", "direction_y", "direction_z"],
            &["direction_x", "direction_y", "direction_z"],
            Number,
            |contact| contact.direction,
        ),
        Field::new("half_length_m", &["half_length_m"], &["half_length"], Number, |contact| [contact.half_length_m; 3]),
        Field::new("half_width_m", &["half_width_m"], &["half_width"], Number, |contact| [contact.half_width_m; 3]),
        Field::new("edge_m", &["edge_m"], &["edge"], Number, |contact| [contact.edge_m; 3]),
        Field::new("sd_m", &["sd_m"], &["sd"], Number, |contact| [contact.sd_m; 3]),
        Field::new("confidence", &["confidence"], &["confidence"], Number, |contact| [contact.confidence; 3]),
        Field::new("conductance", &["conductance"], &["conductance"], Change, |contact| {
            [contact.conductance.map_or(f64::NAN, ConductanceChange::sign); 3]
        }),
    ];

    /// A known touch at a place; unknown quantities are `NaN`.
    pub fn truth(position_m: Point3, normal: Point3, force_n: f64) -> Self {
        Contact {
            id: 0,
            position_m,
            normal,
            strength: f64::NAN,
            area_m2: f64::NAN,
            direction: [f64::NAN; 3],
            half_length_m: f64::NAN,
            half_width_m: f64::NAN,
            force_n,
            force_sd_n: f64::NAN,
            edge_m: f64::NAN,
            sd_m: f64::NAN,
            confidence: 1.0,
            conductance: None,
        }
    }
}

fn unknown() -> f64 {
    f64::NAN
}

fn unknown_vector() -> Point3 {
    [f64::NAN; 3]
}

pub(crate) fn vector_or_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Point3, D::Error> {
    Ok(<[Option<f64>; 3]>::deserialize(deserializer)?.map(|part| part.unwrap_or(f64::NAN)))
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
