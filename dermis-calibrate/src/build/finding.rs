//! Findings on a built skin.

use super::fault::{Cut, Fault};
use dermis::finding::{Finding, FindingKind};
use dermis::protocol::Protocol;

/// Unevenness of the coat from which it is noted: more than that of good workmanship, 10 %, by half.
const UNEVEN: f64 = 0.15;
/// Largest factor between the sheet resistance and that of the design.
const SHEET_FACTOR: f64 = 3.0;

/// A fault of the network or of the coat, with the gain of the logarithm of the evidence.
pub(super) fn of_fault(fault: &Fault, gain: f64, protocol: &Protocol) -> Finding {
    match *fault {
        Fault::OpenElectrode { electrode } => Finding::new(
            FindingKind::OpenElectrode,
            gain,
            format!("no current passes electrode {electrode}; without it the frame fits"),
            "mend its wire or its contact with the coat",
        )
        .at_electrodes([electrode]),
        Fault::PoorContact { electrode, ohm } => Finding::new(
            FindingKind::PoorContact,
            gain,
            format!("{ohm:.1} ohm in series with electrode {electrode}, beside its contact"),
            "solder or glue it again",
        )
        .at_electrodes([electrode]),
        Fault::Short { electrodes: [a, b], ohm } => Finding::new(
            FindingKind::Short,
            gain,
            format!("{ohm:.1} ohm between the wires of electrodes {a} and {b}"),
            "look for a bridge between the two wires, from the skin to the reader",
        )
        .at_electrodes([a, b]),
        Fault::ExchangedWires { electrodes: [a, b] } => Finding::new(
            FindingKind::ExchangedWires,
            gain,
            format!("the frame fits with electrodes {a} and {b} exchanged"),
            "exchange the two wires at the reader, or the two electrodes in the design",
        )
        .at_electrodes([a, b]),
        Fault::Reference { drive, factor } => {
            let [source, sink] = protocol.drives().0[drive];
            let evidence = format!(
                "the values of drive {drive} (electrodes {source} and {sink}) are {:.3} times those of the others",
                1.0 / factor
            );
            let fix = "check the reference resistor and the reading of the current of this drive";
            let found = Finding::new(FindingKind::Reference, gain, evidence, fix).at_electrodes([source, sink]);
            Finding { drive: Some(drive), ..found }
        }
        Fault::Cut(Cut { centre_m, length_m, .. }) => {
            let evidence = format!("a cut of about {:.0} mm explains the frame", 1e3 * length_m);
            let fix = "look for a cut, a crack or a scratch there; spray the coat again";
            Finding { place_m: Some(centre_m), ..Finding::new(FindingKind::Cut, gain, evidence, fix) }
        }
    }
}

/// The resistance of the sheet, where it is not near that of the design.
pub(super) fn of_resistance(factor: f64) -> Option<Finding> {
    let evidence = format!("all resistances are {factor:.3} times those of the design");
    let fix = "measure the sheet resistance of the coat, and check the reference resistor and the unit of the frames: the \
               frame cannot tell these apart";
    let plausible = (1.0 / SHEET_FACTOR..=SHEET_FACTOR).contains(&factor);
    (!plausible).then(|| Finding::new(FindingKind::Resistance, factor, evidence, fix))
}

/// An uneven coat.
pub(super) fn of_coat(unevenness: f64, [low, high]: [f64; 2]) -> Option<Finding> {
    let percent = 100.0 * unevenness;
    let evidence =
        format!("the conductance of the coat varies by {percent:.0} % (rms), from {low:.2} to {high:.2} of its mean");
    let fix = "see the map: thin places have less signal";
    (unevenness > UNEVEN).then(|| Finding::new(FindingKind::UnevenCoat, unevenness, evidence, fix))
}

/// A frame that no explanation fits.
pub(super) fn unexplained(misfit: f64) -> Finding {
    let evidence = format!("what is left of the frame is {misfit:.1} times what noise and workmanship explain");
    let fix = "check that the skin is untouched and is that of the design, and the scan table; several faults at once are \
               not always told apart";
    Finding::new(FindingKind::Unexplained, misfit, evidence, fix)
}
