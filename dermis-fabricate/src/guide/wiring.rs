//! The step of wiring: a diagram of the multiplexers and the tables of their inputs and pins.

use super::html::{self, code, in_halves, list, table};
use crate::electrical::Electrical;
use crate::error::FabricateError;
use crate::model::Fabrication;
use dermis::protocol::MultiplexerInput;
use dermis::text::escaped;
use dermis_plot::report::figure;
use std::fmt::Write as _;

/// The lines in the order of the diagram: name, and what the common pin of its multiplexer is joined to.
const LINES: [(&str, &str); 4] =
    [("source", "reference resistor"), ("sink", "ground"), ("plus", "amplifier +"), ("minus", "amplifier -")];
/// Multiplexers of each line that are drawn; the table has all.
const MAX_DRAWN: usize = 2;
/// The most electrodes of a board as `docs/firmware.md` describes it.
const MAX_OF_PICO: usize = MultiplexerInput::REFERENCE.input;

/// Pins of the controller (`docs/firmware.md`).
const PINS: [(&str, &str); 9] = [
    ("GP0 to GP4", "address of the source's multiplexer, lowest bit first"),
    ("GP5 to GP9", "address of the sink's (ground's) multiplexer"),
    ("GP10 to GP14", "address of the plus input's multiplexer"),
    ("GP15 to GP19", "address of the minus input's multiplexer"),
    ("GP20, GP21", "gain of the amplifier: 01 is 10, 00 is 1"),
    ("GP22", "enable of all multiplexers; high opens all switches"),
    ("GP26", "converter: CNVST"),
    ("GP27", "converter: SCLK"),
    ("GP28", "converter: SDO"),
];

fn body(fabrication: &Fabrication, electrical: &Electrical) -> String {
    let steps = [
        format!(
            "Join each wire to the same input of the four multiplexers (source, sink, plus, minus), as in {}.",
            code("tables/wiring.csv")
        ),
        format!(
            "Join the ends of the reference resistor to input {} of multiplexer 0 of plus (the end at the supply) and minus \
             (the end at the source's multiplexer).",
            MultiplexerInput::REFERENCE.input
        ),
        "Measure from each electrode to its inputs with an ohmmeter before the board is switched on.".into(),
    ];
    let mut text = list(&steps);
    for multiplexer in 0..electrical.multiplexers.min(MAX_DRAWN) {
        let caption = format!(
            "Multiplexers {multiplexer} of the four lines. Each row is an input; the electrode beside it is on this input \
             of all four. A dot is a joint."
        );
        text += &figure(&diagram(fabrication, electrical, multiplexer), &caption);
    }
    text + &inputs(fabrication, electrical) + &controller(fabrication)
}

pub(super) fn section(fabrication: &Fabrication) -> Result<String, FabricateError> {
    Ok(html::section("5. Wiring", &body(fabrication, fabrication.electrical()?), true))
}

fn inputs(fabrication: &Fabrication, electrical: &Electrical) -> String {
    let row = |(one, place): (&crate::model::FabricatedElectrode, &MultiplexerInput)| {
        [one.label.clone(), place.multiplexer.to_string(), place.input.to_string(), String::new()]
    };
    let rows = fabrication.electrodes.iter().zip(&electrical.places).map(row);
    format!("<h3>Inputs</h3>\n{}", in_halves(&table(["Electrode", "Multiplexer", "Input", "Checked"], rows)))
}

fn controller(fabrication: &Fabrication) -> String {
    let rows = PINS.iter().map(|(pin, to)| [pin.to_string(), to.to_string()]);
    let more = match fabrication.electrodes.len() > MAX_OF_PICO {
        true => format!(
            "<p class=\"note\">Note: this controller's firmware reads up to {MAX_OF_PICO} electrodes with one multiplexer a \
             line. More multiplexers need an enable pin each and a front end of your own (docs/firmware.md).</p>\n"
        ),
        false if fabrication.options.inputs.is_some() => {
            "<p class=\"note\">Note: this controller's firmware takes electrode n to be on input n. With other inputs it needs \
             a table of them: tables/scan_table.h has the place of every reading.</p>\n"
                .into()
        }
        false => String::new(),
    };
    format!("<h3>Pins of the controller</h3>\n{more}{}", table(["Pins", "To"], rows).to_html())
}

/// Places of the diagram, mm.
const ROW_MM: f64 = 4.1;
const TOP_MM: f64 = 12.0;
const FIRST_MM: f64 = 42.0;
const STEP_MM: f64 = 34.0;
const WIDE_MM: f64 = 20.0;

fn diagram(fabrication: &Fabrication, electrical: &Electrical, multiplexer: usize) -> String {
    let per_one = MultiplexerInput::PER_MULTIPLEXER;
    let bottom = TOP_MM + ROW_MM * per_one as f64;
    let height = bottom + 16.0;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"172mm\" viewBox=\"0 0 172 {height:.1}\" role=\"img\" \
         font-family=\"'DejaVu Sans', Verdana, sans-serif\" font-size=\"2.9\" fill=\"#1c2330\">\n\
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
    let electrode = electrical.places.iter().position(|own| *own == place);
    let (label, joined): (&str, &[usize]) = match electrode {
        Some(electrode) => (&fabrication.electrodes[electrode].label, &[0, 1, 2, 3]),
        None if place == MultiplexerInput::REFERENCE => ("reference", &[2, 3]),
        None => return,
    };
    let colour = if electrode.is_some() { "#1c2330" } else { "#b3261e" };
    let _ = write!(
        text,
        "<text x=\"{:.1}\" y=\"{:.2}\" text-anchor=\"end\" fill=\"{colour}\">{}</text>",
        FIRST_MM - 14.0,
        y + 1.0,
        escaped(label)
    );
    let last = left_mm(*joined.last().expect("joined somewhere"));
    // Behind the boxes of multiplexers that it passes.
    let mut from = FIRST_MM - 12.0;
    for line in 0..LINES.len() {
        let x = left_mm(line);
        let _ = write!(text, "<path d=\"M{from:.1} {y:.2} H{x:.1}\" stroke=\"{colour}\" stroke-width=\"0.25\"/>");
        if joined.contains(&line) {
            let _ = write!(text, "<circle cx=\"{x:.1}\" cy=\"{y:.2}\" r=\"0.7\" fill=\"{colour}\"/>");
        }
        from = x + WIDE_MM;
        if x >= last {
            break;
        }
    }
    text.push('\n');
}
