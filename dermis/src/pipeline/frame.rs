//! Input and output of a pipeline.

use crate::pipeline::contact::TrackedContact;
use crate::pipeline::health::Health;
use crate::pipeline::timestamp::Timestamp;
use crate::pipeline::validity::Validity;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// One measured frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameInput {
    /// Its number, which increases from frame to frame.
    pub sequence: u64,
    /// Time at which its first value was measured.
    pub measured_at: Timestamp,
    /// Its values.
    pub measurement: Measurement,
    /// Counts of frames and packets, for [`Health`]; zeros if they are not counted.
    pub counts: Counts,
    /// Frames per second, for [`Health`]; 0 if not measured.
    pub rate_hz: f64,
    /// Frames per second that the instrument should send, for [`Health`]; `None` if it does not state a rate.
    pub nominal_rate_hz: Option<f64>,
}

impl FrameInput {
    /// A frame with values only, ohm, in the order of the protocol's channels.
    pub fn new(sequence: u64, measured_at: Timestamp, values_ohm: Vec<f64>) -> Self {
        let measurement = Measurement { values_ohm, ..Measurement::default() };
        FrameInput { sequence, measured_at, measurement, ..Self::default() }
    }
}

/// The values of one frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Measurement {
    /// Voltage over current of each channel, ohm, in the order of the protocol.
    pub values_ohm: Vec<f64>,
    /// Resistance of each drive's current loop without the reference resistor (skin, contacts, switches), ohm, in the
    /// order of [`Protocol::drives`](crate::protocol::Protocol::drives). Empty if not measured: then no electrode is
    /// monitored.
    pub loops_ohm: Vec<f64>,
    /// Channels whose readings, or those of their currents, are out of the converter's range.
    pub saturated: Vec<usize>,
}

/// One processed frame.
#[derive(Debug, Clone, PartialEq)]
pub struct PipelineFrame {
    /// The number of the frame.
    pub sequence: u64,
    /// Time at which its first value was measured.
    pub measured_at: Timestamp,
    /// Its values, ohm, in the order of the protocol.
    pub values_ohm: Vec<f64>,
    /// The image, a value for each pixel in the order of [`PixelSpace`](crate::image::PixelSpace); zeros during a tare.
    pub image: Vec<f32>,
    /// Whether the contacts can be relied on.
    pub validity: Validity,
    /// Whether the values differ from the baseline by more than noise, or a contact exists; `None` if the frame is
    /// invalid.
    pub touched: Option<bool>,
    /// The contacts, the oldest first.
    pub contacts: Vec<TrackedContact>,
    /// State of the skin and its instrument.
    pub health: Arc<Health>,
}

/// Frames and packets since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// Frames received, each counted once.
    pub frames: u64,
    /// Frames missing.
    pub lost: u64,
    /// Frames received again and ignored.
    pub repeated: u64,
    /// Frames received after later ones and ignored.
    pub reordered: u64,
    /// Damaged packets, and noise between packets.
    pub damaged: u64,
    /// Reconnections of the device.
    pub reconnected: u64,
    /// Frames whose time on the device's clock did not follow that of the frame before; their times are those of
    /// arrival.
    #[serde(default)]
    pub clock_faults: u64,
}
