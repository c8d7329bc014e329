//! Whether the contacts of a frame can be relied on.

use crate::pipeline::degradation::Degradation;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Whether the contacts of a frame can be relied on. In JSON: `{"state": "ok"}`, `{"state": "invalid", "reason": ...}`.
///
/// ```
/// use dermis::pipeline::{InvalidReason, Validity};
///
/// let validity = Validity::Invalid { reason: InvalidReason::Frozen };
/// assert!(!validity.is_usable());
/// assert_eq!(validity.to_string(), "invalid: the same values repeatedly");
/// assert_eq!(serde_json::to_string(&validity)?, r#"{"state":"invalid","reason":"frozen"}"#);
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(tag = "state", rename_all = "snake_case")]
pub enum Validity {
    /// All channels are in use.
    #[default]
    Ok,
    /// Some channels are masked; the contacts come from the others.
    Degraded(Box<Degradation>),
    /// The frame says nothing about the skin: no contacts, and whether it is touched is unknown.
    Invalid {
        /// Why.
        reason: InvalidReason,
    },
    /// No frame has arrived for too long, or its contacts were computed too late: no contacts, and whether the skin is touched is
    /// unknown.
    Stale {
        /// Time since the frame arrived, s.
        age_s: f64,
    },
}

/// Why a frame is invalid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum InvalidReason {
    /// The baseline is being measured.
    Tare,
    /// Most drives carry no current.
    NoCurrent,
    /// Most readings are out of the converter's range, or above the voltage of their drive.
    OutOfRange,
    /// The same values repeatedly.
    Frozen,
    /// All values are larger or smaller than the baseline by one factor, or those of other channels.
    Scale,
    /// All values are shifted from the baseline by one voltage.
    Offset,
    /// The values are far noisier than at the tare.
    Noise,
    /// The times of the frames do not increase.
    Clock,
    /// Most channels are masked.
    TooFewChannels,
    /// The instrument was faulty until a moment ago.
    OnTrial,
}

impl InvalidReason {
    /// The reason in words.
    pub fn text(self) -> &'static str {
        match self {
            InvalidReason::Tare => "the baseline is being measured",
            InvalidReason::NoCurrent => "most drives carry no current: check the source and the reference resistor",
            InvalidReason::OutOfRange => "most readings are out of range: check the gain and the converter",
            InvalidReason::Frozen => "the same values repeatedly",
            InvalidReason::Scale => {
                "all values are larger or smaller by one factor, or those of other channels: check the gain, the reference, and \
                 whether values were lost"
            }
            InvalidReason::Offset => {
                "all values are shifted alike: check the ground and the amplifier, then tare again"
            }
            InvalidReason::Noise => "far noisier than at the tare: check for interference and the shield",
            InvalidReason::Clock => "the times of the frames do not increase",
            InvalidReason::TooFewChannels => "most channels are masked: check the wires",
            InvalidReason::OnTrial => "the instrument was faulty until a moment ago",
        }
    }
}

impl Validity {
    /// Whether the frame has contacts that can be relied on: it is ok or degraded.
    pub fn is_usable(&self) -> bool {
        matches!(self, Validity::Ok | Validity::Degraded(_))
    }

    /// Its name, as in JSON.
    pub fn name(&self) -> &'static str {
        match self {
            Validity::Ok => "ok",
            Validity::Degraded(_) => "degraded",
            Validity::Invalid { .. } => "invalid",
            Validity::Stale { .. } => "stale",
        }
    }
}

impl fmt::Display for Validity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Validity::Ok => f.write_str("ok"),
            Validity::Degraded(degradation) => write!(f, "degraded: {degradation}"),
            Validity::Invalid { reason } => write!(f, "invalid: {}", reason.text()),
            Validity::Stale { age_s } => write!(f, "stale: the last frame is {age_s:.2} s old"),
        }
    }
}
