//! The reader: supplies, pins, and its firmware. Its parts are those of `docs/firmware.md`.

use super::html::{self, Section, code, list, table};
use super::steps::{argument, is_plain};
use crate::electrical;
use crate::error::FabricateError;
use crate::model::Fabrication;
use dermis::protocol::MultiplexerInput;
use dermis::text::escaped;

/// The most electrodes of a board as `docs/firmware.md` describes it.
const MAX_OF_PICO: usize = MultiplexerInput::REFERENCE.input;

/// Every pin of a part of the reader, and what it is joined to.
const PINS: [[&str; 3]; 36] = [
    ["controller (Pico)", "GP0 to GP4", "A0 to A4 of the source's multiplexer, lowest bit first"],
    ["", "GP5 to GP9", "A0 to A4 of the sink's (ground's) multiplexer"],
    ["", "GP10 to GP14", "A0 to A4 of the plus input's multiplexer"],
    ["", "GP15 to GP19", "A0 to A4 of the minus input's multiplexer"],
    ["", "GP20", "A0 of the amplifier: high is gain 10, low is gain 1"],
    ["", "GP21", "A1 of the amplifier: always low; the pin is spare"],
    ["", "GP22", "/EN of all multiplexers: high opens all switches"],
    ["", "GP26, GP27, GP28", "CNVST, SCLK, SDO of the converter"],
    ["", "3V3(OUT); GND; USB", "DVIO of the converter; ground; computer"],
    ["multiplexer (ADG732), each", "VDD", "5 V"],
    ["", "VSS, GND", "ground: one supply"],
    ["", "/CS, /WR", "ground: the address passes without a latch"],
    ["", "/EN, A0 to A4", "controller, as above; at 5 V the inputs take 3.3 V as high"],
    ["", "S1 to S32", "inputs 0 to 31 of the table: input n is pin S(n + 1)"],
    ["", "D, source", "end B of the reference resistor"],
    ["", "D, sink", "ground"],
    ["", "D, plus; D, minus", "+IN; -IN of the amplifier"],
    ["reference resistor", "end A", "5 V, and S32 (input 31) of multiplexer 0 of plus"],
    ["", "end B", "D of the source's multiplexers, and S32 (input 31) of multiplexer 0 of minus"],
    ["amplifier (AD8253)", "+VS; -VS", "+12 V; -12 V"],
    ["", "/WR", "-VS: the gain follows A0 and A1 (transparent mode)"],
    ["", "A0, A1", "controller, as above; its data sheet must take 3.3 V as high"],
    ["", "DGND, REF", "ground"],
    ["", "+IN, -IN", "as above, and each through 10 Mohm to half the supply"],
    ["", "OUT", "driver"],
    ["half the supply", "2.5 V", "middle of two resistors of 10 kohm from 5 V to ground"],
    ["driver (MCP6D11)", "VDD; VSS", "5 V; ground"],
    ["", "inputs", "amplifier's OUT and ground, each through 1 kohm; 1 kohm from each output back to its input"],
    ["", "VOCM", "half the supply"],
    ["", "outputs", "AIN+ and AIN- of the converter, each through 22 ohm; 1.8 nF from each AIN to ground, close to it"],
    ["converter (MCP33131D-10)", "AVDD", "1.8 V"],
    ["", "DVIO", "3.3 V of the controller"],
    ["", "VREF", "5 V (5.1 V at most), 10 uF close to the pin"],
    ["", "GND", "ground"],
    ["", "CNVST, SCLK, SDO", "controller, as above"],
    ["", "SDI", "as its data sheet says for reading without commands"],
];

/// The table of pins, and what is to be known about the supplies.
pub(super) fn pins(fabrication: &Fabrication) -> String {
    let rows = PINS.iter().map(|row| row.map(String::from));
    format!(
        "<h3>Pins and supplies</h3>\n{}<p class=\"note\">Note: no board of this reader has been built; it was checked in \
         emulation. There is no layout of a circuit board either: the pins below are its circuit, and you must design the \
         board, or wire the parts on adapter boards. Check every pin and voltage with the data sheets before you switch on. All grounds are joined. Each supply pin has \
         100 nF to ground close to it, each supply 10 uF.</p>\n\
         <p>Why the amplifier gets 12 V: its inputs and its output do not reach its supplies (by 1 to 2 V; see its data \
         sheet), and the reference resistor is read at 5 V. The data sheet allows \u{b1}5 V to \u{b1}15 V. A reading out \
         of range drives its output towards 12 V: check that the driver's inputs stand the current through 1 kohm. The 5 V \
         need not be exact, as each current is read across the reference resistor, but quiet: not the computer's USB.</p>\n{}",
        limits(fabrication),
        table(["Part", "Pin", "To"], rows).to_html()
    )
}

/// What the firmware of the board cannot read.
fn limits(fabrication: &Fabrication) -> String {
    if fabrication.electrodes.len() > MAX_OF_PICO {
        return format!(
            "<p class=\"note\">Note: this controller's firmware reads up to {MAX_OF_PICO} electrodes with one multiplexer a \
             line. More multiplexers need an enable pin each and a front end of your own (docs/firmware.md).</p>\n"
        );
    }
    match fabrication.options.inputs {
        Some(_) => {
            "<p class=\"note\">Note: this controller's firmware takes electrode n to be on input n. With other inputs it needs \
             a table of them: tables/scan_table.h has the place of every reading.</p>\n"
                .into()
        }
        None => String::new(),
    }
}

/// The reader's electronics as a file for the firmware: the command that writes it, if the skin has another reference resistor
/// than `reader.toml`, and its path.
fn twin(reference_ohm: f64, module: &str) -> (String, String) {
    const USUAL: &str = "dermis-firmware/boards/reader.toml";
    if reference_ohm == electrical::USUAL_REFERENCE_OHM {
        return (String::new(), USUAL.into());
    }
    let own = format!("dermis-firmware/boards/skins/{module}_reader.toml");
    let copy = format!("sed 's/^reference_ohm = .*/reference_ohm = {reference_ohm:.1}/' {USUAL} &gt; {own}\n");
    (copy, own)
}

/// The step of building the firmware and bringing it on the controller.
///
/// # Errors
/// A design without an electrical model.
pub(super) fn firmware(fabrication: &Fabrication) -> Result<Section, FabricateError> {
    let name = &fabrication.design.name;
    let module = if is_plain(name) { name.replace('-', "_") } else { "skin".into() };
    let design = escaped(&argument(&fabrication.design));
    let (copy, twin) = twin(fabrication.electrical()?.electronics.reference_ohm, &module);
    let steps = [
        format!(
            "Install Rust, and clone {}. Run the commands below in its folder. A design in a file is named by its path.",
            code(env!("CARGO_PKG_REPOSITORY"))
        ),
        format!(
            "Add the controller's target, and write the scan table of this skin with its settling times{}:\
             <pre><code>dermis-firmware/boards/targets\nmkdir -p dermis-firmware/boards/skins\n{copy}\
             dermis scan-table {design} --firmware --twin {twin} \
             -o dermis-firmware/boards/skins/{module}.rs</code></pre>",
            if copy.is_empty() { "" } else { ", for its own reference resistor" }
        ),
        format!(
            "Name this table in {}: the line {}.",
            code("dermis-firmware/boards/pico/src/main.rs"),
            code(&format!("#[path = \"../../skins/{module}.rs\"]"))
        ),
        "Build it, with a serial number of your own:<pre><code>cd dermis-firmware/boards/pico\n\
         DERMIS_SERIAL=7 cargo build --release</code></pre>"
            .into(),
        format!(
            "Convert it ({} installs the program). Hold BOOTSEL while you plug the controller in: it is a drive, \
             {}. Copy the file there:<pre><code>elf2uf2-rs target/thumbv6m-none-eabi/release/dermis-board-pico dermis.uf2\
             </code></pre>With a debug probe instead: {}.",
            code("cargo install elf2uf2-rs"),
            code("RPI-RP2"),
            code("probe-rs run --chip RP2040 target/thumbv6m-none-eabi/release/dermis-board-pico")
        ),
        "The controller now is a serial port: <code>/dev/ttyACM0</code> below (on other systems another name).".into(),
    ];
    Ok(html::section("6. Firmware", limits(fabrication) + &list(&steps), true))
}
