//! Findings on a built skin: what is wrong, where, by which evidence, and what to do.

use super::fault::{Cut, Fault};
use crate::checks::{Finding, Severity};
use dermis::geom::Point3;
use dermis::protocol::Protocol;
use dermis::text::counted;
use serde::Serialize;

/// Unevenness of the coat from which it is noted: more than that of good workmanship, 10 %, by half.
const UNEVEN: f64 = 0.15;
/// Largest factor between the sheet resistance and that of the design.
const SHEET_FACTOR: f64 = 3.0;

/// One thing that is wrong with a built skin, or that is to be known.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BuildFinding {
    /// What is wrong.
    pub kind: String,
    /// Whether it is to be mended.
    pub severity: Severity,
    /// The electrodes that it affects, ascending.
    pub electrodes: Vec<usize>,
    /// The drive that it affects, by its place in the protocol.
    pub drive: Option<usize>,
    /// Its place on the skin, m.
    pub place_m: Option<Point3>,
    /// The number on which the finding rests: of a fault the gain of the logarithm of the evidence, else as the evidence
    /// says.
    pub value: f64,
    /// What was seen.
    pub evidence: String,
    /// What to do.
    pub fix: String,
}

impl BuildFinding {
    fn new(kind: &str, severity: Severity, value: f64, evidence: String, fix: &str) -> Self {
        let (kind, fix) = (kind.to_string(), fix.to_string());
        BuildFinding { kind, severity, electrodes: Vec::new(), drive: None, place_m: None, value, evidence, fix }
    }

    fn at_electrodes(mut self, mut electrodes: Vec<usize>) -> Self {
        electrodes.sort_unstable();
        self.electrodes = electrodes;
        self
    }

    /// A fault of the network or of the coat.
    pub(super) fn of_fault(fault: &Fault, gain: f64, protocol: &Protocol) -> Self {
        let found = |evidence, fix| BuildFinding::new(fault.name(), Severity::Fault, gain, evidence, fix);
        match *fault {
            Fault::OpenElectrode { electrode } => found(
                format!("no current passes electrode {electrode}; without it the frame fits"),
                "mend its wire or its contact with the coat",
            )
            .at_electrodes(vec![electrode]),
            Fault::PoorContact { electrode, ohm } => found(
                format!("{ohm:.1} ohm in series with electrode {electrode}, beside its contact"),
                "solder or glue it again",
            )
            .at_electrodes(vec![electrode]),
            Fault::Short { electrodes: [a, b], ohm } => found(
                format!("{ohm:.1} ohm between the wires of electrodes {a} and {b}"),
                "look for a bridge between the two wires, from the skin to the reader",
            )
            .at_electrodes(vec![a, b]),
            Fault::ExchangedWires { electrodes: [a, b] } => found(
                format!("the frame fits with electrodes {a} and {b} exchanged"),
                "exchange the two wires at the reader, or the two electrodes in the design",
            )
            .at_electrodes(vec![a, b]),
            Fault::Reference { drive, factor } => {
                BuildFinding { drive: Some(drive), ..reference(gain, drive, factor, protocol) }
            }
            Fault::Cut(Cut { centre_m, length_m, .. }) => {
                let evidence = format!("a cut of about {:.0} mm explains the frame", 1e3 * length_m);
                BuildFinding {
                    place_m: Some(centre_m),
                    ..found(evidence, "look for a cut, a crack or a scratch there; spray the coat again")
                }
            }
        }
    }

    /// The resistance of the sheet, where it is not near that of the design.
    pub(super) fn of_resistance(factor: f64) -> Option<Self> {
        let plausible = (1.0 / SHEET_FACTOR..=SHEET_FACTOR).contains(&factor);
        (!plausible).then(|| {
            BuildFinding::new(
                "resistance",
                Severity::Fault,
                factor,
                format!("all resistances are {factor:.3} times those of the design"),
                "measure the sheet resistance of the coat, and check the reference resistor and the unit of the frames: the \
                 frame cannot tell these apart",
            )
        })
    }

    /// An uneven coat.
    pub(super) fn of_coat(unevenness: f64, range: [f64; 2]) -> Option<Self> {
        (unevenness > UNEVEN).then(|| {
            BuildFinding::new(
                "uneven_coat",
                Severity::Note,
                unevenness,
                format!(
                    "the conductance of the coat varies by {:.0} % (rms), from {:.2} to {:.2} of its mean",
                    100.0 * unevenness,
                    range[0],
                    range[1]
                ),
                "see the map: thin places have less signal",
            )
        })
    }

    /// A frame that no explanation fits.
    pub(super) fn unexplained(misfit: f64) -> Self {
        BuildFinding::new(
            "unexplained",
            Severity::Fault,
            misfit,
            format!("what is left of the frame is {misfit:.1} times what noise and workmanship explain"),
            "check that the skin is untouched and is that of the design, and the scan table; several faults at once are not \
             always told apart",
        )
    }

    /// A finding of the check of the recording.
    pub(super) fn of_recording(finding: &Finding) -> Self {
        let evidence = match finding.channels.len() {
            0 => finding.evidence.clone(),
            channels => format!("{} ({})", finding.evidence, counted(channels, "channel")),
        };
        BuildFinding::new(finding.kind.name(), finding.severity, finding.value, evidence, &finding.fix)
    }
}

fn reference(gain: f64, drive: usize, factor: f64, protocol: &Protocol) -> BuildFinding {
    let [source, sink] = protocol.drives().0[drive];
    let evidence = format!(
        "the values of drive {drive} (electrodes {source} and {sink}) are {:.3} times those of the others",
        1.0 / factor
    );
    let fix = "check the reference resistor and the reading of the current of this drive";
    BuildFinding::new("reference", Severity::Fault, gain, evidence, fix).at_electrodes(vec![source, sink])
}
