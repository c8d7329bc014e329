//! Tables and a netlist for wiring and first tests: electrodes, multiplexers, expected readings, SPICE.

use crate::error::FabricateError;
use crate::folder::OutputFile;
use crate::model::Fabrication;
use dermis::forward::{ElectrodeNetwork, ForwardModel};
use dermis::mesh::Mesh;
use std::fmt::Write as _;

/// The circuit in front of the skin: a constant voltage behind a reference resistor and closed switches.
///
/// The paper states the on-resistance (ADG1206, 120 ohm); voltage and reference are those of the shipped twins.
const SOURCE_V: f64 = 5.0;
const REFERENCE_OHM: f64 = 1000.0;
const ON_RESISTANCE_OHM: f64 = 120.0;
/// An open switch in the netlist, ohm.
const OPEN_OHM: &str = "1e12";
/// Inputs of a multiplexer (ADG732).
const INPUTS: usize = 32;

/// Electrode and wiring tables, expected readings of the untouched skin, and a SPICE netlist that gives the same.
///
/// # Errors
/// A design that cannot be meshed or solved.
pub fn files(fabrication: &Fabrication) -> Result<Vec<OutputFile>, FabricateError> {
    let network = network(fabrication)?;
    Ok(vec![
        OutputFile::new("tables/electrodes.csv", "place, normal and bore of each electrode", electrodes(fabrication)),
        OutputFile::new("tables/wiring.csv", "multiplexer input of each electrode", wiring(fabrication)),
        OutputFile::new("tables/readings.csv", "expected readings, untouched", readings(fabrication, &network)),
        OutputFile::new("tables/skin.cir", "SPICE netlist that gives the readings", netlist(fabrication, &network)),
    ])
}

fn network(fabrication: &Fabrication) -> Result<ElectrodeNetwork, FabricateError> {
    let mesh = Mesh::generate(&fabrication.design)?;
    let model = ForwardModel::new(&fabrication.design, &mesh)?;
    Ok(model.network(model.rest_conductivity()).map_err(dermis::Error::from)?)
}

fn electrodes(fabrication: &Fabrication) -> String {
    let mut text = String::from(
        "electrode,label,x_mm,y_mm,z_mm,normal_x,normal_y,normal_z,bore_x_mm,bore_y_mm,bore_z_mm,bore_mm,moved_mm\n",
    );
    let point = |place: [f64; 3], factor: f64| place.map(|value| format!("{:.6}", factor * value + 0.0)).join(",");
    for one in &fabrication.electrodes {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{:.4},{:.6}",
            one.number,
            one.label,
            point(one.centre_m, 1e3),
            point(one.normal, 1.0),
            point(one.bore.centre_m, 1e3),
            1e3 * one.bore.diameter_m,
            1e3 * one.bore.moved_m
        );
    }
    text
}

/// Each of the four lines (source, sink, plus, minus) has its own multiplexers; an electrode is on the same input of all.
fn wiring(fabrication: &Fabrication) -> String {
    let mut text = String::from("electrode,label,multiplexer,input\n");
    for one in &fabrication.electrodes {
        let _ = writeln!(text, "{},{},{},{}", one.number, one.label, one.number / INPUTS, one.number % INPUTS);
    }
    text
}

/// Resistance between two electrodes, ohm.
fn between_ohm(network: &ElectrodeNetwork, a: usize, b: usize) -> f64 {
    let s = &network.transfer_impedance;
    s.at(a, a) + s.at(b, b) - s.at(a, b) - s.at(b, a)
}

fn readings(fabrication: &Fabrication, network: &ElectrodeNetwork) -> String {
    let protocol = &fabrication.design.protocol;
    let mut text = String::from("channel,drive_source,drive_sink,measure_plus,measure_minus,ohm,current_a,volt\n");
    let mut values = vec![0.0; protocol.channel_count()];
    network.frame_into(protocol, &mut values);
    // An instrument that loses the signs shows none.
    protocol.drop_signs(&mut values);
    for (index, (channel, ohm)) in protocol.channels().iter().zip(values).enumerate() {
        let ([source, sink], [plus, minus]) = (channel.drive, channel.measure);
        let loop_ohm = REFERENCE_OHM + 2.0 * ON_RESISTANCE_OHM + between_ohm(network, source, sink);
        let current_a = SOURCE_V / loop_ohm;
        let _ =
            writeln!(text, "{index},{source},{sink},{plus},{minus},{ohm:.9e},{current_a:.9e},{:.9e}", ohm * current_a);
    }
    text
}

/// The electrodes' network as resistors, a switch of each electrode to source and ground, and a run of every drive.
fn netlist(fabrication: &Fabrication, network: &ElectrodeNetwork) -> String {
    let count = fabrication.electrodes.len();
    let name = &fabrication.design.name;
    let mut text = format!(
        "* {} untouched: source, reference resistor, switches, electrodes\nV1 supply 0 {SOURCE_V}\n\
         Rreference supply source {REFERENCE_OHM}\n",
        name.replace(|letter: char| !letter.is_ascii_graphic(), "_")
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
    text + &control(fabrication) + ".end\n"
}

/// Commands for ngspice: every drive is switched on, solved, and its measures are printed.
fn control(fabrication: &Fabrication) -> String {
    let protocol = &fabrication.design.protocol;
    let mut text = String::from(".control\nset numdgt=12\n");
    let (drives, drive_of) = protocol.drives();
    for (drive, [source, sink]) in drives.iter().enumerate() {
        let _ = writeln!(text, "alter Rsource{source} {ON_RESISTANCE_OHM}\nalter Rsink{sink} {ON_RESISTANCE_OHM}\nop");
        for (channel, _) in drive_of.iter().enumerate().filter(|(_, own)| **own == drive) {
            let [plus, minus] = protocol.channels()[channel].measure;
            let _ = writeln!(text, "print v(e{plus})-v(e{minus})");
        }
        let _ = writeln!(text, "alter Rsource{source} {OPEN_OHM}\nalter Rsink{sink} {OPEN_OHM}");
    }
    text + "quit\n.endc\n"
}
