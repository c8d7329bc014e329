//! Parts of the reader, and materials of the skin.

use crate::error::FabricateError;
use crate::grooves::wires;
use crate::model::{Fabrication, MEMBRANE_M};
use dermis::design::Body;
use dermis::text::decimal;

/// A row of the list of parts.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// What it is.
    pub part: String,
    /// Its type; empty where any will do.
    pub kind: String,
    /// How much.
    pub quantity: f64,
    /// Of which unit: `pieces`, `cm3`, `cm2`, `m`.
    pub unit: &'static str,
    /// What it is for.
    pub purpose: &'static str,
}

/// Length of a wire from the edge of the base to the reader, m: an arm's length from a shelf beside the robot, to be cut.
const LEAD_M: f64 = 0.3;
/// Lines with multiplexers: source, sink, plus, minus.
const LINES: usize = 4;

/// The parts: those of the reader as `docs/firmware.md` names them, and the materials as the design's sizes demand.
///
/// # Errors
/// A base that cannot be made; a design without an electrical model.
pub fn parts(fabrication: &Fabrication) -> Result<Vec<Part>, FabricateError> {
    let electrical = fabrication.electrical()?;
    let multiplexers = LINES * electrical.multiplexers;
    let mut parts = reader(multiplexers, electrical.electronics.reference_ohm / 1e3);
    parts.push(piece("connector", "one pin for each wire of an electrode", 1, "skin to circuit board"));
    parts.push(piece("connector", "4 pins: +12 V; ground; -12 V; 5 V", 1, "supplies to circuit board"));
    parts.push(piece("connector", "two rows of 20 sockets; 2.54 mm", 1, "controller on circuit board"));
    parts.push(piece("cable", "USB; for the controller", 1, "controller to computer"));
    let Pin { diameter_m, length_m } = Pin::of(fabrication);
    let pin = format!("{} mm in diameter; {} mm long", decimal(1e3 * diameter_m, 3), decimal(1e3 * length_m, 3));
    parts.push(piece("electrode", &pin, fabrication.electrodes.len(), "pin of copper or brass in each bore"));
    parts.extend(materials(fabrication)?);
    Ok(parts)
}

fn piece(name: &str, kind: &str, count: usize, purpose: &'static str) -> Part {
    part(name, kind, count as f64, "pieces", purpose)
}

/// The parts of the reader; `guide` has a table of their pins. Integrated circuits come in packages for surfaces alone: the
/// adapter boards are for those that a soldering iron reaches.
fn reader(multiplexers: usize, reference_kohm: f64) -> Vec<Part> {
    // At each supply pin: of the multiplexers, the amplifier (2), driver, converter (2), and at half the supply.
    let small_capacitors = multiplexers + 6;
    vec![
        piece("controller", "Raspberry Pi Pico", 1, "drives the multiplexers and sends frames"),
        piece("multiplexer", "ADG732 (32 to 1)", multiplexers, "source; ground; plus and minus input"),
        piece("amplifier", "AD8253", 1, "gain 1 or 10"),
        piece("driver", "MCP6D11 or another fully differential amplifier for 5 V", 1, "amplifier to converter"),
        piece("gain resistor", "1 kohm; 0.1 %", 4, "unity gain of the driver"),
        piece("converter", "MCP33131D-10", 1, "16 bits"),
        // They settle to 16 bits in 12 x 22 ohm x 1.8 nF = 0.5 us: a sixth of the shortest wait of the paper's skin.
        piece("filter resistor", "22 ohm; 1 %", 2, "driver to each input of the converter"),
        piece("filter capacitor", "1.8 nF; C0G", 2, "each input of the converter to ground"),
        piece("reference resistor", &format!("{reference_kohm} kohm; 0.1 %; 10 ppm/K"), 1, "in series with the source"),
        piece("bias resistor", "10 Mohm", 2, "amplifier inputs to half the supply"),
        piece("divider resistor", "10 kohm; 1 %", 2, "half the supply"),
        piece("supply", "+12 V and -12 V; 20 mA", 1, "amplifier"),
        piece("supply", "5 V; low noise; 50 mA", 1, "source; multiplexers; driver; converter's reference"),
        piece("supply", "1.8 V; 10 mA", 1, "converter; its 3.3 V come from the controller"),
        piece("capacitor", "100 nF; ceramic", small_capacitors, "at each supply pin and at half the supply"),
        piece("capacitor", "10 uF; ceramic", 5, "at each supply and at the converter's reference"),
        piece(
            "circuit board",
            "no layout exists: to be designed from the guide's table of pins",
            1,
            "parts of the reader",
        ),
        piece(
            "adapter board",
            "TQFP-48 with 0.5 mm between pins",
            multiplexers,
            "multiplexers; for a trial without circuit board",
        ),
        piece("adapter board", "MSOP-10", 2, "amplifier and converter; for a trial without circuit board"),
        piece("adapter board", "MSOP-8", 1, "driver; for a trial without circuit board"),
    ]
}

/// The pin that is the electrode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pin {
    /// Its diameter, m.
    pub(crate) diameter_m: f64,
    /// Its length, m.
    pub(crate) length_m: f64,
}

impl Pin {
    /// What the bore is wider than the pin, m: drilled plastic closes by some hundredths of a millimetre, and glue needs
    /// as much.
    pub(crate) const CLEARANCE_M: f64 = 1e-4;
    /// How far a pin passes the inner face of a wall without channels, m: room for the solder of a wire.
    const BEYOND_M: f64 = 0.002;

    /// From the coat to the bottom of the channel, whose depth is left to the solder and the wires that pass it; without
    /// a channel beyond the inner face.
    pub(crate) fn of(fabrication: &Fabrication) -> Self {
        let options = &fabrication.options;
        let inner_m = match options.channel_depth_m > 0.0 {
            true => -options.channel_depth_m,
            false => Self::BEYOND_M,
        };
        let length_m = fabrication.coat_height_m() + options.wall_m + inner_m;
        Pin { diameter_m: options.bore_m - Self::CLEARANCE_M, length_m }
    }
}

fn part(name: &str, kind: &str, quantity: f64, unit: &'static str, purpose: &'static str) -> Part {
    Part { part: name.into(), kind: kind.into(), quantity, unit, purpose }
}

fn materials(fabrication: &Fabrication) -> Result<Vec<Part>, FabricateError> {
    let fabric_m2: f64 = fabrication.patches.iter().map(|patch| patch.outline.area_m2()).sum();
    let coat = format!("{:.0} ohm per square", 1.0 / fabrication.design.sheet.conductance);
    let foam = format!("{} mm thick", 1e3 * fabrication.options.foam_thickness_m);
    let base_cm3 = 1e-3 * fabrication.base()?.volume_mm3();
    let wire =
        wires(fabrication).map_or(String::new(), |(wide_m, _)| format!("at most {} mm", decimal(1e3 * wide_m, 2)));
    let membrane = format!("rubber; {} mm thick", 1e3 * MEMBRANE_M);
    let (coat_cm2, foam_cm2) = (1e4 * coat_m2(fabrication), 1e4 * foam_m2(fabrication));
    let mut parts = vec![part("printed base", "", base_cm3, "cm3", "solid volume without supports")];
    parts.extend(match fabrication.has_membrane() {
        true => vec![
            part("foam", &foam, foam_cm2, "cm2", "below the membrane"),
            part("membrane", &membrane, coat_cm2, "cm2", "below the coat; without the rim that is glued to the base"),
            part("coat", &coat, coat_cm2, "cm2", "elastic; sprayed on the membrane"),
        ],
        false => vec![
            part("coat", &coat, coat_cm2, "cm2", "sprayed on the base"),
            part("conductive fabric", "", 1e4 * fabric_m2, "cm2", "patches; without what is cut away"),
            part("stretchable film", "", 1e4 * fabric_m2, "cm2", "ironed on the fabric"),
            part("foam", &foam, foam_cm2, "cm2", "over the patches"),
        ],
    });
    parts.push(part("wire", &wire, wire_m(fabrication), "m", "channels and 0.3 m to the reader for each electrode"));
    Ok(parts)
}

/// Area of the coat, m2.
fn coat_m2(fabrication: &Fabrication) -> f64 {
    match (&fabrication.coat, &fabrication.body_mesh) {
        (Some(coat), _) => coat.area_m2(),
        (None, Some(mesh)) => mesh.area_m2(),
        (None, None) => 0.0,
    }
}

/// Area of the foam, m2: the coat, and the overlap of a cylinder.
fn foam_m2(fabrication: &Fabrication) -> f64 {
    let overlap_m2 = match fabrication.design.body {
        Body::Cylinder { length_m, .. } => length_m * fabrication.options.overlap_m,
        _ => 0.0,
    };
    coat_m2(fabrication) + overlap_m2
}

/// Length of all wires, m: each as far as its channel's end (on a body from a mesh file, to the nearest edge) and to the
/// reader.
fn wire_m(fabrication: &Fabrication) -> f64 {
    let flange_m = fabrication.options.flange_m;
    let channel_m = |[x, y, z]: [f64; 3]| match (&fabrication.design.body, &fabrication.body_mesh) {
        (Body::Cylinder { .. }, _) => z + flange_m,
        (Body::Disk { diameter_m }, _) => y + (0.25 * diameter_m * diameter_m - x * x).max(0.0).sqrt() + flange_m,
        (Body::Rectangle { .. }, _) => y + flange_m,
        (_, mesh) => mesh.as_ref().and_then(|mesh| mesh.edge_distance_m([x, y, z])).unwrap_or(0.0),
    };
    fabrication.electrodes.iter().map(|one| channel_m(one.bore.centre_m) + LEAD_M).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::design::SkinDesign;
    use std::f64::consts::PI;

    fn amount_of(parts: &[Part], name: &str) -> f64 {
        parts.iter().find(|part| part.part == name).unwrap().quantity
    }

    /// The paper's skin: a coat of 942 cm2, 30 x 31 patches, a tube less 30 bores and 10 channels.
    #[test]
    fn the_papers_skin_needs_what_its_sizes_say() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let parts = parts(&Fabrication::new(&design).unwrap()).unwrap();
        let coat_cm2 = PI * 10.0 * 30.0;
        assert!((amount_of(&parts, "coat") - coat_cm2).abs() < 1e-9);
        assert!((amount_of(&parts, "foam") - coat_cm2).abs() < 1e-9);
        let patch_cm2 = 0.9 * (PI * 10.0 / 31.0 - 0.1);
        assert!((amount_of(&parts, "conductive fabric") - 930.0 * patch_cm2).abs() < 1e-9);
        // Rings at 0, 60, ..., 300 mm, the outer ones moved 2.5 mm inward.
        let heights_m = 5.0 * (0.0025 + 0.06 + 0.12 + 0.18 + 0.24 + 0.2975);
        assert!((amount_of(&parts, "wire") - heights_m - 30.0 * 0.3).abs() < 1e-9);
        assert_eq!((amount_of(&parts, "multiplexer"), amount_of(&parts, "electrode")), (4.0, 30.0));
        // A capacitor at each of 4 + 2 + 1 + 2 supply pins, and one at half the supply.
        assert_eq!(amount_of(&parts, "capacitor"), 10.0);
        let pin = parts.iter().find(|part| part.part == "electrode").unwrap();
        assert_eq!(pin.kind, "2.9 mm in diameter; 3 mm long");
        // Each channel takes 3 x 2 mm off: five of 240 mm and five of 297.5 mm; bores take the wall above them.
        let tube = PI * (25.0 - 20.25) * 30.0;
        let channels = 0.3 * 0.2 * 5.0 * (24.0 + 29.75);
        let bores = 30.0 * PI * 0.15 * 0.15 * 0.3;
        let least = tube - channels - bores;
        let volume = amount_of(&parts, "printed base");
        assert!(volume < tube && (volume / least - 1.0).abs() < 0.003, "{volume} cm3, about {least} cm3");
    }
}
