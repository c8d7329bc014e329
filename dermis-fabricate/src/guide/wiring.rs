//! The step of wiring: a diagram of the multiplexers and the tables of their inputs and pins.

use super::html::{self, Section, code, in_halves, list, table};
use super::reader;
use crate::electrical::Electrical;
use crate::error::FabricateError;
use crate::model::Fabrication;
use dermis::protocol::MultiplexerInput;
use dermis::text::escaped;
use dermis_plot::report::figure;
use std::fmt::Write as _;

/// The lines in the order of the diagram: name, and what the common pin of its multiplexer is joined to.
const LINES: [(&str, &str); 4] =
    [("source", "end B"), ("sink", "ground"), ("plus", "amplifier +"), ("minus", "amplifier -")];
/// Multiplexers of each line that are drawn; the table has all.
const MAX_DRAWN: usize = 2;
fn body(fabrication: &Fabrication, electrical: &Electrical) -> String {
    let steps = [
        format!(
            "Join each wire to the same input of the four multiplexers (source, sink, plus, minus), as in {}.",
            code("tables/wiring.csv")
        ),
        format!(
            "The reference resistor lies between 5 V (its end A) and the common pin of the source's multiplexers (its end \
             B). Join A to input {input} of multiplexer 0 of plus, and B to input {input} of multiplexer 0 of minus. A and B \
             are joined by nothing but the resistor.",
            input = MultiplexerInput::REFERENCE.input
        ),
        "Measure from each electrode to its inputs with an ohmmeter before the board is switched on, and between A and B: the \
         reference resistor's value."
            .into(),
    ];
    let mut text = list(&steps);
    for multiplexer in 0..electrical.multiplexers.min(MAX_DRAWN) {
        let caption = format!(
            "Multiplexers {multiplexer} of the four lines. Each row is an input; the electrode beside it is on this input \
             of all four. A dot is a joint. A and B are the ends of the reference resistor; 5 V are at A."
        );
        text += &figure(&diagram(fabrication, electrical, multiplexer), &caption);
    }
    text + &inputs(fabrication, electrical) + &reader::pins(fabrication)
}

pub(super) fn section(fabrication: &Fabrication) -> Result<Section, FabricateError> {
    Ok(html::section("5. Wiring", body(fabrication, fabrication.electrical()?), true))
}

fn inputs(fabrication: &Fabrication, electrical: &Electrical) -> String {
    let row = |(one, place): (&crate::model::FabricatedElectrode, &MultiplexerInput)| {
        [one.label.clone(), place.multiplexer.to_string(), place.input.to_string(), String::new()]
    };
    let rows = fabrication.electrodes.iter().zip(&electrical.places).map(row);
    format!("<h3>Inputs</h3>\n{}", in_halves(&table(["Electrode", "Multiplexer", "Input", "Checked"], rows)))
}

/// Places of the diagram, mm.
const ROW_MM: f64 = 4.1;
const TOP_MM: f64 = 12.0;
const FIRST_MM: f64 = 20.0;
const STEP_MM: f64 = 27.0;
const WIDE_MM: f64 = 18.0;
const ALL_MM: f64 = 126.0;

fn diagram(fabrication: &Fabrication, electrical: &Electrical, multiplexer: usize) -> String {
    let per_one = MultiplexerInput::PER_MULTIPLEXER;
    let bottom = TOP_MM + ROW_MM * per_one as f64;
    let height = bottom + 16.0;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{ALL_MM}mm\" viewBox=\"0 0 {ALL_MM} {height:.1}\" role=\"img\" \
         font-family=\"'DejaVu Sans', Verdana, sans-serif\" font-size=\"3.1\" fill=\"#1c2330\">\n\
         <title>Multiplexers {multiplexer}</title>\n"
    );
    for (line, (name, to)) in LINES.iter().enumerate() {
        let (x, middle) = (left_mm(line), left_mm(line) + 0.5 * WIDE_MM);
        let _ = writeln!(
            text,
            "<text x=\"{middle}\" y=\"4\" text-anchor=\"middle\" font-weight=\"bold\">{name} {multiplexer}</text>\
             <text x=\"{middle}\" y=\"8.4\" text-anchor=\"middle\" fill=\"#5a6472\">ADG732</text>\
             <rect x=\"{x}\" y=\"{:.1}\" width=\"{WIDE_MM}\" height=\"{:.1}\" fill=\"#f1f4f8\" stroke=\"#1c2330\" \
             stroke-width=\"0.3\"/>\
             <path d=\"M{middle} {bottom:.1} v7\" fill=\"none\" stroke=\"#0b5c94\" stroke-width=\"0.5\"/>\
             <text x=\"{middle}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            TOP_MM - 1.2,
            ROW_MM * per_one as f64 + 1.2,
            bottom + 10.5,
            escaped(to)
        );
    }
    for input in 0..per_one {
        row(&mut text, fabrication, electrical, MultiplexerInput { multiplexer, input });
    }
    text + "</svg>\n"
}

fn left_mm(line: usize) -> f64 {
    FIRST_MM + STEP_MM * line as f64
}

/// An input of the four multiplexers, and what is joined to it.
fn row(text: &mut String, fabrication: &Fabrication, electrical: &Electrical, place: MultiplexerInput) {
    let y = TOP_MM + ROW_MM * (place.input as f64 + 0.5);
    for line in 0..LINES.len() {
        let x = left_mm(line) + 1.5;
        let _ = write!(text, "<text x=\"{x}\" y=\"{:.2}\" fill=\"#5a6472\">{}</text>", y + 1.0, place.input);
    }
    if place == MultiplexerInput::REFERENCE {
        // Its ends have joints of their own: one at each amplifier input.
        for (line, end) in [(2, "A"), (3, "B")] {
            let x = left_mm(line);
            let _ = write!(
                text,
                "<text x=\"{:.1}\" y=\"{:.2}\" text-anchor=\"end\" fill=\"{RED}\">{end}</text>{}",
                x - 4.0,
                y + 1.0,
                joint(x - 3.5, x, y, RED)
            );
        }
    }
    let Some(electrode) = electrical.places.iter().position(|own| *own == place) else { return };
    let _ = write!(
        text,
        "<text x=\"{:.1}\" y=\"{:.2}\" text-anchor=\"end\">{}</text>",
        FIRST_MM - 6.0,
        y + 1.0,
        escaped(&fabrication.electrodes[electrode].label)
    );
    // Behind the boxes of multiplexers that it passes.
    for line in 0..LINES.len() {
        let x = left_mm(line);
        let from = if line == 0 { x - 5.0 } else { left_mm(line - 1) + WIDE_MM };
        text.push_str(&joint(from, x, y, INK));
    }
    text.push('\n');
}

/// Colours of joints: of electrodes, of the reference resistor.
const INK: &str = "#1c2330";
const RED: &str = "#b3261e";

/// A line to a pin, with a dot on it.
fn joint(from: f64, to: f64, y: f64, colour: &str) -> String {
    format!(
        "<path d=\"M{from:.1} {y:.2} H{to:.1}\" stroke=\"{colour}\" stroke-width=\"0.25\"/>\
         <circle cx=\"{to:.1}\" cy=\"{y:.2}\" r=\"0.7\" fill=\"{colour}\"/>"
    )
}
