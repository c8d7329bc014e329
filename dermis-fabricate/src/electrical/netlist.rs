//! A SPICE netlist of source, reference resistor, switches and skin, which gives the expected readings.

use crate::electrical::Electrical;
use crate::model::Fabrication;
use std::fmt::Write as _;

/// An open switch, ohm.
const OPEN_OHM: &str = "1e12";

/// The electrodes' network as resistors, a switch of each electrode to source and ground, and a run of every drive.
pub(super) fn netlist(fabrication: &Fabrication, electrical: &Electrical) -> String {
    let (count, network, electronics) = (fabrication.electrodes.len(), &electrical.network, &electrical.electronics);
    let name = &fabrication.design.name;
    let mut text = format!(
        "* {} untouched: source, reference resistor, switches, electrodes\nV1 supply 0 {}\n\
         Rreference supply source {}\n",
        name.replace(|letter: char| !letter.is_ascii_graphic(), "_"),
        electronics.source_v,
        electronics.reference_ohm
    );
    for k in 0..count {
        let _ = writeln!(text, "Rsource{k} source e{k} {OPEN_OHM}\nRsink{k} e{k} 0 {OPEN_OHM}");
    }
    for (a, b) in (0..count).flat_map(|b| (0..b).map(move |a| (a, b))) {
        let siemens = -network.admittance.at(a, b);
        if siemens != 0.0 {
            let _ = writeln!(text, "Rskin{a}_{b} e{a} e{b} {:.12e}", 1.0 / siemens);
        }
    }
    text + &control(fabrication, electronics.on_resistance_ohm) + ".end\n"
}

/// Commands for ngspice: every drive is switched on, solved, and its measures are printed.
fn control(fabrication: &Fabrication, on_ohm: f64) -> String {
    let protocol = &fabrication.design.protocol;
    let mut text = String::from(".control\nset numdgt=12\n");
    let (drives, drive_of) = protocol.drives();
    for (drive, [source, sink]) in drives.iter().enumerate() {
        let _ = writeln!(text, "alter Rsource{source} {on_ohm}\nalter Rsink{sink} {on_ohm}\nop");
        for (channel, _) in drive_of.iter().enumerate().filter(|(_, own)| **own == drive) {
            let [plus, minus] = protocol.channels()[channel].measure;
            let _ = writeln!(text, "print v(e{plus})-v(e{minus})");
        }
        let _ = writeln!(text, "alter Rsource{source} {OPEN_OHM}\nalter Rsink{sink} {OPEN_OHM}");
    }
    text + "quit\n.endc\n"
}
