//! What is known of a frame once it has gone through the pipeline: what every sink is given.

use crate::timestamp::Timestamp;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// One frame, from readings to contacts.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveFrame {
    /// Number of the frame since the device was powered up, not wrapping round.
    pub sequence: u64,
    /// When its first reading was taken, on the host's clock.
    pub measured_at: Timestamp,
    /// When its last byte came.
    pub received_at: Timestamp,
    /// When its contacts were known.
    pub output_at: Timestamp,
    /// The message as the device sent it ([`dermis_wire::Frame`]): with the session's hello all that a replay needs.
    pub message: Vec<u8>,
    /// Its values, ohm, in the order of the protocol.
    pub values_ohm: Vec<f64>,
    /// The image, a value for each pixel in the order of [`PixelSpace`](dermis::image::PixelSpace).
    pub image: Vec<f32>,
    /// Whether the raw voltages say that something touches, before any image.
    pub touched: bool,
    /// What touches, the oldest contact first.
    pub contacts: Vec<LiveContact>,
    /// How the skin and its instrument are.
    pub health: Arc<Health>,
}

/// A contact that is followed from frame to frame. Numbers that are not known are `null`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LiveContact {
    /// Stays while the contact lasts, and is not used again.
    pub id: u64,
    /// Where it is, in the body's frame, m.
    pub position_m: [f64; 3],
    /// Outward unit normal there.
    pub normal: [f64; 3],
    /// Centre of the area where the image exceeds half of the contact's peak, m.
    pub centroid_m: [f64; 3],
    /// Mean position weighted by the image, m.
    pub centre_of_pressure_m: [f64; 3],
    /// How it moves along the surface, m/s.
    pub velocity_m_s: [f64; 3],
    /// Integral of the image over the contact: relative change of conductance (or newtons, of an image of touches) times m2.
    pub strength: f64,
    /// Area where the image exceeds half of the contact's peak, m2.
    pub area_m2: f64,
    /// Normal force on the skin, positive when pressing, N; where the skin or the method is calibrated.
    pub force_n: Option<f64>,
    /// Its standard deviation, N.
    pub force_sd_n: Option<f64>,
    /// Standard deviation of the position along the surface, per axis, m.
    pub sd_m: f64,
    /// Probability that something touches within 20 mm.
    pub confidence: f64,
    /// Whether the image shows it on its own. A contact that is hidden by another one or missing for a moment is where it is
    /// expected, with the strength and force that were last seen.
    pub seen: bool,
    /// When it began.
    pub since: Timestamp,
    /// The zone that it lies in, where zones are named.
    pub zone: Option<String>,
}

/// How the skin and its instrument are.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Health {
    /// Every electrode, by its number.
    pub electrodes: Vec<ElectrodeHealth>,
    /// Root mean square of the noise of all channels in use, over what it was at the tare; `null` while it is not known.
    pub noise: Option<f64>,
    /// Root mean square by which channels differ from their reciprocal ones, over what their noise explains; `null` where no
    /// two channels are reciprocal.
    pub reciprocity: Option<f64>,
    /// Channels whose readings are out of the converter's range now.
    pub saturated_channels: usize,
    /// Channels that are left out.
    pub masked_channels: usize,
    /// Frames a second that arrive.
    pub rate_hz: f64,
    /// Counts since the start.
    pub counts: Counts,
}

/// How an electrode is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ElectrodeHealth {
    /// What it is.
    pub state: ElectrodeState,
    /// Its contact resistance, ohm: the design's at the tare, and what its readings tell of its change since.
    pub contact_ohm: Option<f64>,
    /// Noise of the channels that it is part of, over what it was at the tare.
    pub noise: Option<f64>,
}

/// What an electrode is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ElectrodeState {
    /// As it should be.
    Sound,
    /// Noisier than it should be; its readings are used.
    Doubtful,
    /// Its contact has grown far poorer; its readings are left out.
    Loose,
    /// No current flows through it; its readings are left out.
    Open,
}

/// Frames and packets since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// Frames that came, each once.
    pub frames: u64,
    /// Frames that did not come.
    pub lost: u64,
    /// Frames that came again, and were left aside.
    pub repeated: u64,
    /// Frames that came after later ones, and were left aside.
    pub reordered: u64,
    /// Packets that were damaged, and noise between packets.
    pub damaged: u64,
    /// Times that the device was lost and found again.
    pub reconnected: u64,
}

/// Something that a person should know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Notice {
    /// How much it matters.
    pub level: Severity,
    /// What it is, and what to do.
    pub text: String,
    /// When it was noticed.
    pub at: Timestamp,
}

/// How much something matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// For the record.
    Info,
    /// Results may be worse.
    Warning,
    /// Something does not work.
    Error,
}
