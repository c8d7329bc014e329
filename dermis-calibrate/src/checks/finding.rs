//! Findings: what is wrong with a recording, where, by which evidence, and what to do.

use serde::Serialize;

/// What is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FindingKind {
    /// The channels come in another order than the protocol of the design says.
    Order,
    /// The untouched frame fits the model in no order.
    UnlikeModel,
    /// Values have the opposite sign.
    SignTurned,
    /// Signs that the model has are missing.
    SignLost,
    /// The design says that signs are missing, but they are there.
    SignPresent,
    /// Values are too small or too large by a factor of ten and more.
    Magnitude,
    /// Channels come rows late (or early).
    Late,
    /// Channels that do not respond: constant, or noise.
    Dead,
    /// Channels whose values pile up at a limit.
    Saturated,
    /// Channels that measure the same quantity and disagree.
    PairsDisagree,
    /// Channels that only record voltages of the other sign.
    OneSign,
    /// Frames that are far outside the range of all others.
    OutlierFrame,
    /// Single values that are far outside the range of their channel.
    OutlierValue,
    /// The positions of the presses belong to other rows than the frames.
    TruthShifted,
    /// The axes of the positions of the presses are reversed or exchanged.
    TruthAxes,
    /// The values change slowly over the recording.
    Drift,
    /// Part of a frame is what the press before left.
    Memory,
}

impl FindingKind {
    /// Its name, as in JSON.
    pub fn name(self) -> &'static str {
        match self {
            FindingKind::Order => "order",
            FindingKind::UnlikeModel => "unlike_model",
            FindingKind::SignTurned => "sign_turned",
            FindingKind::SignLost => "sign_lost",
            FindingKind::SignPresent => "sign_present",
            FindingKind::Magnitude => "magnitude",
            FindingKind::Late => "late",
            FindingKind::Dead => "dead",
            FindingKind::Saturated => "saturated",
            FindingKind::PairsDisagree => "pairs_disagree",
            FindingKind::OneSign => "one_sign",
            FindingKind::OutlierFrame => "outlier_frame",
            FindingKind::OutlierValue => "outlier_value",
            FindingKind::TruthShifted => "truth_shifted",
            FindingKind::TruthAxes => "truth_axes",
            FindingKind::Drift => "drift",
            FindingKind::Memory => "memory",
        }
    }

    /// Whether it is an error to mend, or a property of the skin and its instrument to know.
    pub fn severity(self) -> Severity {
        match self {
            FindingKind::PairsDisagree | FindingKind::OneSign | FindingKind::Drift | FindingKind::Memory => {
                Severity::Note
            }
            _ => Severity::Fault,
        }
    }
}

/// Whether a finding is to be mended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// An error of the recording or of the design.
    Fault,
    /// A property of the skin or the instrument.
    Note,
}

/// One thing that is wrong with a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What is wrong.
    pub kind: FindingKind,
    /// Whether it is to be mended.
    pub severity: Severity,
    /// The channels that it affects, ascending; empty for all of them.
    pub channels: Vec<usize>,
    /// The rows that it affects, ascending; empty for all of them.
    pub rows: Vec<usize>,
    /// The number of rows by which channels or positions are late; 0 for other kinds.
    pub lag: i32,
    /// The number on which the finding rests.
    pub value: f64,
    /// What that number is, and what it would be on sound frames.
    pub evidence: String,
    /// What to do.
    pub fix: String,
}

impl Finding {
    /// A finding of all channels and rows.
    pub(crate) fn new(kind: FindingKind, value: f64, evidence: String, fix: impl Into<String>) -> Self {
        let (channels, rows) = (Vec::new(), Vec::new());
        Finding { kind, severity: kind.severity(), channels, rows, lag: 0, value, evidence, fix: fix.into() }
    }

    /// The same for some channels.
    pub(crate) fn at_channels(mut self, mut channels: Vec<usize>) -> Self {
        channels.sort_unstable();
        self.channels = channels;
        self
    }

    /// The same for some rows.
    pub(crate) fn at_rows(mut self, rows: Vec<usize>) -> Self {
        self.rows = rows;
        self
    }

    /// The same with a lag.
    pub(crate) fn with_lag(mut self, lag: i32) -> Self {
        self.lag = lag;
        self
    }
}
