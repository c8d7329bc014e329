//! What is known of a robot at a time, and events: the schema of its lines of JSON.

use crate::pose::Pose;
use crate::wrench::Wrench;
use dermis::contact::Contact;
use dermis::geom::Point3;
use dermis::pipeline::{InvalidReason, Timestamp, TrackedContact};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What is known of a robot at a time. Lengths in m, forces in N, times in nanoseconds since 1970; unknown values are `null`.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(title = "Dermis robot snapshot"))]
pub struct Snapshot {
    /// The name of the robot.
    pub robot: String,
    /// The time.
    pub at: Timestamp,
    /// The link in whose frame the positions with `base` in their name are.
    pub base: Option<String>,
    /// Whether any skin is touched; `null` if none is, but a required one is unknown.
    pub touched: Option<bool>,
    /// Whether every required skin is known.
    pub complete: bool,
    /// The skins that are unknown.
    pub unknown: Vec<String>,
    /// The skins, in the order of the file.
    pub skins: Vec<SkinSnapshot>,
    /// The contacts of all skins that are known, the oldest first; a touch over the seam of two skins is one contact.
    pub contacts: Vec<RobotContact>,
    /// The wrench of the contacts of each link that wears a skin.
    pub wrenches: Vec<Wrench>,
    /// The torques of all contacts on the joints; `null` unless all wrenches are complete and the joints are known.
    pub joint_torques: Option<BTreeMap<String, JointTorque>>,
    /// The rules that hold now, with the cause.
    pub rules: BTreeMap<String, Cause>,
    /// Age of the newest joint states, s; `null` without any.
    pub joints_age_s: Option<f64>,
}

/// A skin at a time.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SkinSnapshot {
    /// Its name.
    pub skin: String,
    /// The link that wears it.
    pub link: String,
    /// Whether it is touched.
    #[serde(flatten)]
    pub zone: Zone,
    /// Time since its last frame was measured, s; `null` without any.
    pub age_s: Option<f64>,
    /// Frames per second.
    pub rate_hz: Option<f64>,
    /// Serial number of its device.
    pub device_serial: Option<u32>,
}

/// Whether a skin is touched. In JSON: `"zone": "clear"`, `"touched"`, or `"unknown"` with a `"reason"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(tag = "zone", rename_all = "snake_case")]
pub enum Zone {
    /// It is not touched.
    Clear,
    /// It is touched.
    Touched,
    /// Whether it is touched is unknown.
    Unknown {
        /// Why.
        reason: UnknownReason,
    },
}

/// Why a skin is unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum UnknownReason {
    /// Its device has not been there yet.
    Absent,
    /// Its device was lost.
    Lost,
    /// Its frames are older than `age_s`.
    Late,
    /// Its device has another serial number.
    OtherDevice,
    /// What reads it has failed.
    Unserved,
    /// Its frames are invalid.
    #[serde(untagged)]
    Invalid(InvalidReason),
}

impl UnknownReason {
    /// The reason in words.
    pub fn text(self) -> &'static str {
        match self {
            UnknownReason::Absent => "its device is not there yet",
            UnknownReason::Lost => "its device was lost",
            UnknownReason::Late => "its frames are too old",
            UnknownReason::OtherDevice => "its device has another serial number: are cables swapped?",
            UnknownReason::Unserved => "what reads it has failed",
            UnknownReason::Invalid(reason) => reason.text(),
        }
    }
}

/// A contact on a robot. The fields of the contact itself are in the frame of its skin; its id is one of the robot, that no other
/// touch has had.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RobotContact {
    /// The skin.
    pub skin: String,
    /// The link that wears it.
    pub link: String,
    /// The contact.
    #[serde(flatten)]
    pub contact: TrackedContact,
    /// The other link of the robot that it touches, as that link's skin tells; `null` if none tells so.
    pub self_link: Option<String>,
    /// The contacts of skins that it is made of: several if it lies over a seam. The first is the oldest.
    pub parts: Vec<ContactPart>,
    /// Position in the link's frame, m.
    pub position_link_m: Point3,
    /// Outward unit normal in the link's frame.
    pub normal_link: Point3,
    /// Position in the base's frame when the contact was measured, m; `null` if the pose of the link is unknown.
    pub position_base_m: Option<Point3>,
    /// Outward unit normal in the base's frame.
    pub normal_base: Option<Point3>,
    /// Standard deviation of the position in the base's frame, m: that on the skin, and the way that the point may have moved
    /// since the last joint states.
    pub sd_base_m: Option<f64>,
    /// The pose of the skin's frame in the base's.
    #[serde(skip)]
    pub(crate) pose_base: Option<Pose>,
}

impl RobotContact {
    /// The contact in the frame of the base, with `sd_base_m`; `None` if the pose of the link is unknown.
    pub fn in_base(&self) -> Option<TrackedContact> {
        let pose = self.pose_base?;
        let TrackedContact { contact, centroid_m, centre_of_pressure_m, velocity_m_s, .. } = &self.contact;
        Some(TrackedContact {
            contact: Contact {
                position_m: pose.point(contact.position_m),
                normal: pose.vector(contact.normal),
                direction: pose.vector(contact.direction),
                sd_m: self.sd_base_m.unwrap_or(f64::NAN),
                ..*contact
            },
            centroid_m: pose.point(*centroid_m),
            centre_of_pressure_m: pose.point(*centre_of_pressure_m),
            velocity_m_s: pose.vector(*velocity_m_s),
            ..self.contact.clone()
        })
    }
}

/// A contact of a skin.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ContactPart {
    /// The skin.
    pub skin: String,
    /// Its id on that skin.
    pub id: u64,
}

/// A torque on a joint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct JointTorque {
    /// Torque of the contacts, N m; of a joint that slides the force, N.
    pub torque_n_m: f64,
    /// Its standard deviation.
    pub sd_n_m: f64,
}

/// Why a rule holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(tag = "cause", rename_all = "snake_case")]
pub enum Cause {
    /// Its condition is true.
    Touched {
        /// The skin.
        skin: String,
    },
    /// A skin is unknown.
    Unknown {
        /// The skin.
        skin: String,
        /// Why; `null` if a force is unknown, or only a lower bound.
        reason: Option<UnknownReason>,
    },
}

/// The begin or end of a rule, or another reason for it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(title = "Dermis robot event"))]
pub struct RuleEvent {
    /// The name of the rule.
    pub rule: String,
    /// Whether it begins, ends, or goes on for another reason.
    pub event: EventKind,
    /// Why it holds; at its end why it held until now.
    #[serde(flatten)]
    pub cause: Cause,
    /// When that was measured or noticed.
    pub measured_at: Timestamp,
    /// When the event was found.
    pub at: Timestamp,
}

/// What happens to a rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// It holds from now on.
    Begins,
    /// It goes on to hold, for another reason: a touch in place of an unknown skin, or the other way round.
    Changes,
    /// It does not hold any more.
    Ends,
}
