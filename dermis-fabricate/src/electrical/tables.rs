//! Tables as CSV.

use crate::electrical::{Electrical, Neighbours, Part, Value};
use crate::model::Fabrication;
use dermis::protocol::MultiplexerInput;
use std::fmt::Write as _;

pub(super) fn electrodes(fabrication: &Fabrication) -> String {
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
pub(super) fn wiring(fabrication: &Fabrication, places: &[MultiplexerInput]) -> String {
    let mut text = String::from("electrode,label,multiplexer,input\n");
    for (one, MultiplexerInput { multiplexer, input }) in fabrication.electrodes.iter().zip(places) {
        let _ = writeln!(text, "{},{},{multiplexer},{input}", one.number, one.label);
    }
    text
}

pub(super) fn readings(electrical: &Electrical) -> String {
    let mut text = String::from(
        "slot,drive_source,drive_sink,measure_plus,measure_minus,channel,ohm,ohm_low,ohm_high,volt,volt_low,volt_high,\
         settling_us\n",
    );
    let limits = |value: &Value| {
        let [low, high] = value.limits();
        format!("{:.9e},{low:.6e},{high:.6e}", value.nominal)
    };
    for (index, reading) in electrical.readings.iter().enumerate() {
        let [source, sink] = reading.slot.drive;
        let measure = match reading.slot.measure {
            Some(([plus, minus], channel)) => format!("{plus},{minus},{channel}"),
            None => ",,".into(),
        };
        let ohm = reading.ohm.as_ref().map_or(",,".into(), limits);
        let (volt, wait_us) = (limits(&reading.volt), 1e6 * reading.wait_s);
        let _ = writeln!(text, "{index},{source},{sink},{measure},{ohm},{volt},{wait_us:.3}");
    }
    text
}

pub(super) fn neighbours(fabrication: &Fabrication, electrical: &Electrical) -> String {
    let mut text = String::from("electrode_a,label_a,electrode_b,label_b,distance_mm,ohm,ohm_low,ohm_high\n");
    for Neighbours { pair: [a, b], distance_m, ohm } in &electrical.neighbours {
        let [a_label, b_label] = [a, b].map(|&number| &fabrication.electrodes[number].label);
        let (mm, [low, high]) = (1e3 * distance_m, ohm.limits());
        let _ = writeln!(text, "{a},{a_label},{b},{b_label},{mm:.3},{:.3},{low:.3},{high:.3}", ohm.nominal);
    }
    text
}

pub(super) fn parts(parts: &[Part]) -> String {
    let mut text = String::from("part,type,quantity,unit,use\n");
    for Part { part, kind, quantity, unit, purpose } in parts {
        let _ = writeln!(text, "{part},{kind},{},{unit},{purpose}", amount(*quantity, unit));
    }
    text
}

/// A quantity: a whole number of pieces, or a measure with two decimals.
pub(crate) fn amount(quantity: f64, unit: &str) -> String {
    if unit == "pieces" { format!("{quantity:.0}") } else { format!("{quantity:.2}") }
}
