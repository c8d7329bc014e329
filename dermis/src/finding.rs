//! Findings: what is wrong with a recording, a built skin or a device, where, by which evidence, and what to do.

use crate::geom::Point3;
use crate::text::{counted, number_of, ranges};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Severity of a finding or a notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Information.
    Info,
    /// Results may be worse.
    Warning,
    /// Something does not work.
    Error,
}

impl fmt::Display for Severity {
    /// Its name, as in JSON.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(formatter)
    }
}

/// What is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FindingKind {
    /// The channels come in another order than the protocol of the design says.
    Order,
    /// The untouched frame fits the model in no order.
    UnlikeModel,
    /// Frames do not fit the untouched frame that they are compared with.
    UnlikeBaseline,
    /// The protocol cannot tell places apart.
    Ambiguous,
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
    /// The positions of the presses do not belong to the frames in any simple way.
    TruthUnrelated,
    /// The values change slowly over the recording.
    Drift,
    /// Part of a frame is what the press before left.
    Memory,
    /// An electrode without connection.
    OpenElectrode,
    /// An electrode with a series resistance.
    PoorContact,
    /// Two electrodes whose wires touch.
    Short,
    /// Two electrodes whose wires are exchanged.
    ExchangedWires,
    /// A drive whose current is read wrongly.
    Reference,
    /// A cut through the coat.
    Cut,
    /// The resistances are not near those of the design.
    Resistance,
    /// The coat is less even than good workmanship makes it.
    UnevenCoat,
    /// No explanation fits the frame.
    Unexplained,
    /// A device departs from the wire protocol.
    WireProtocol,
}

impl FindingKind {
    /// Whether it is to be mended, or a property of the skin and its instrument to know.
    pub fn severity(self) -> Severity {
        use FindingKind::{Drift, Memory, OneSign, PairsDisagree, UnevenCoat};
        match self {
            PairsDisagree | OneSign | Drift | Memory | UnevenCoat => Severity::Info,
            _ => Severity::Error,
        }
    }

    /// The unit of its value; empty for ratios and correlations. That of faults of the network and the coat is the gain of
    /// the natural logarithm of the evidence.
    fn unit(self) -> &'static str {
        use FindingKind::{Cut, ExchangedWires, OpenElectrode, PoorContact, Reference, Short};
        match self {
            OpenElectrode | PoorContact | Short | ExchangedWires | Reference | Cut => "nat",
            _ => "",
        }
    }
}

impl fmt::Display for FindingKind {
    /// Its name, as in JSON.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(formatter)
    }
}

/// One thing that is wrong, or that is to be known.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What is wrong.
    pub kind: FindingKind,
    /// Whether it is to be mended ([`Severity::Error`]).
    pub severity: Severity,
    /// The channels that it affects, ascending; empty for all of them.
    pub channels: Vec<usize>,
    /// The rows that it affects, ascending; empty for all of them.
    pub rows: Vec<usize>,
    /// The number of rows by which channels or positions are late; 0 for other kinds.
    pub lag: i32,
    /// The electrodes that it affects, ascending.
    pub electrodes: Vec<usize>,
    /// The drive that it affects, by its place in the protocol.
    pub drive: Option<usize>,
    /// Its place on the skin, m.
    pub place_m: Option<Point3>,
    /// The step of a conversation with a device in which it was found.
    pub step: Option<&'static str>,
    /// The number on which it rests; `NaN` (in JSON `null`) without one.
    pub value: f64,
    /// The unit of the value; empty for ratios and correlations.
    pub unit: &'static str,
    /// What was seen: what the value is, and what it would be if all were well.
    pub evidence: String,
    /// What to do.
    pub fix: String,
}

impl Finding {
    /// A finding without a place: of all channels and rows.
    pub fn new(kind: FindingKind, value: f64, evidence: impl Into<String>, fix: impl Into<String>) -> Self {
        Finding {
            kind,
            severity: kind.severity(),
            channels: Vec::new(),
            rows: Vec::new(),
            lag: 0,
            electrodes: Vec::new(),
            drive: None,
            place_m: None,
            step: None,
            value,
            unit: kind.unit(),
            evidence: evidence.into(),
            fix: fix.into(),
        }
    }

    /// The same for some channels.
    pub fn at_channels(mut self, mut channels: Vec<usize>) -> Self {
        channels.sort_unstable();
        self.channels = channels;
        self
    }

    /// The same for some electrodes.
    pub fn at_electrodes<const N: usize>(mut self, mut electrodes: [usize; N]) -> Self {
        electrodes.sort_unstable();
        self.electrodes = electrodes.to_vec();
        self
    }

    /// Whether it is to be mended.
    pub fn is_fault(&self) -> bool {
        self.severity == Severity::Error
    }

    /// Its kind and its place, in words.
    pub fn title(&self) -> String {
        let numbers = |what: &str, numbers: &[usize]| {
            (!numbers.is_empty()).then(|| format!("{} {}", number_of(numbers.len(), what), ranges(numbers)))
        };
        let place = [
            self.step.map(str::to_string),
            self.drive.map(|drive| format!("drive {drive}")),
            numbers("electrode", &self.electrodes),
            numbers("channel", &self.channels),
            numbers("row", &self.rows),
            (self.lag != 0).then(|| format!("by {}", counted(self.lag, "row"))),
            self.place_m.map(|place_m| {
                let [x, y, z] = place_m.map(|value| 1e3 * value);
                format!("at ({x:.0}, {y:.0}, {z:.0}) mm")
            }),
        ];
        std::iter::once(self.kind.to_string()).chain(place.into_iter().flatten()).collect::<Vec<_>>().join(", ")
    }

    /// Its value with the unit; empty without one.
    pub fn value_text(&self) -> String {
        if self.value.is_nan() { String::new() } else { format!("{:.3} {}", self.value, self.unit).trim_end().into() }
    }
}

/// Whether none of some findings is to be mended.
pub fn is_sound(findings: &[Finding]) -> bool {
    !findings.iter().any(Finding::is_fault)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_title_has_the_kind_and_the_place() {
        let late = Finding::new(FindingKind::Late, 0.97, "evidence", "fix").at_channels(vec![2, 0, 1, 7]);
        assert_eq!(Finding { lag: -2, ..late.clone() }.title(), "late, channels 0-2, 7, by -2 rows");
        assert_eq!((late.value_text().as_str(), late.is_fault()), ("0.970", true));
        let reference = Finding::new(FindingKind::Reference, 31.0, "evidence", "fix").at_electrodes([4, 2]);
        let reference = Finding { drive: Some(3), ..reference };
        assert_eq!(
            (reference.title().as_str(), &*reference.value_text()),
            ("reference, drive 3, electrodes 2, 4", "31.000 nat")
        );
        let note = Finding::new(FindingKind::UnevenCoat, f64::NAN, "evidence", "fix");
        assert_eq!(
            (note.title().as_str(), &*note.value_text(), is_sound(std::slice::from_ref(&note))),
            ("uneven_coat", "", true)
        );
        assert_eq!(note.severity.to_string(), "info");
    }
}
