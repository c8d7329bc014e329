//! State of the skin and its instrument, and messages for users.

use crate::finding::Severity;
use crate::pipeline::frame::Counts;
use crate::pipeline::timestamp::Timestamp;
use serde::{Deserialize, Serialize};
use std::num::NonZeroU32;

/// State of the skin and its instrument.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Health {
    /// Serial number of the device; absent if it has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device_serial: Option<NonZeroU32>,
    /// Every electrode, by its number.
    pub electrodes: Vec<ElectrodeHealth>,
    /// Root mean square of the noise of all channels in use, relative to the tare; `null` while it is unknown.
    pub noise: Option<f64>,
    /// Root mean square of the differences of reciprocal channels, relative to their noise; `null` if no two channels
    /// are reciprocal.
    pub reciprocity: Option<f64>,
    /// Channels whose readings are now out of the converter's range.
    pub saturated_channels: usize,
    /// Channels that are masked.
    pub masked_channels: usize,
    /// Drives whose current is wrong, by their index in the protocol; their channels are masked.
    #[serde(default)]
    pub bad_drives: Vec<usize>,
    /// Frames per second.
    pub rate_hz: f64,
    /// Frames per second that the instrument should send.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nominal_rate_hz: Option<f64>,
    /// Counts since the start.
    pub counts: Counts,
}

/// State of an electrode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ElectrodeHealth {
    /// Its state.
    pub state: ElectrodeState,
    /// Contact resistance, ohm: the design's value at the tare plus the measured change since.
    pub contact_ohm: Option<f64>,
    /// Noise of its channels, relative to the tare.
    pub noise: Option<f64>,
}

/// States of an electrode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum ElectrodeState {
    /// Good.
    Sound,
    /// Noisier than at the tare; its channels are used.
    Doubtful,
    /// Bad in the last frames, not yet confirmed; its channels are masked.
    Suspect,
    /// Its contact resistance has risen; its channels are masked.
    Loose,
    /// It carries no current; its channels are masked.
    Open,
    /// Good again after it was loose or open, but not yet for long enough; its channels are masked.
    OnTrial,
}

impl ElectrodeState {
    /// Whether its channels are masked because of a confirmed fault.
    pub fn is_bad(self) -> bool {
        matches!(self, ElectrodeState::Loose | ElectrodeState::Open | ElectrodeState::OnTrial)
    }
}

/// A message for users.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Notice {
    /// Severity.
    pub level: Severity,
    /// The event, and the recommended action.
    pub text: String,
    /// Time of the event.
    pub at: Timestamp,
}
