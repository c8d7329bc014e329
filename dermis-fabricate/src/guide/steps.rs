//! The steps and what they need, in words, tables and pictures.

use super::html::{Section, code, in_halves, list, marked, mm, rounded, section, table};
use super::pictures;
use crate::electrical;
use crate::error::FabricateError;
use crate::grooves::wires;
use crate::model::{Fabrication, MEMBRANE_M};
use crate::notes::notes;
use dermis::design::{Body, ElectrodeShape, SkinDesign};
use dermis::text::{counted, decimal};
use dermis_plot::report::figure;

pub(super) fn overview(fabrication: &Fabrication) -> Result<Section, FabricateError> {
    let (design, options) = (&fabrication.design, &fabrication.options);
    let electrical = fabrication.electrical()?;
    let size = match &design.body {
        Body::Cylinder { length_m, diameter_m } => {
            format!("cylinder, {} mm long, {} mm in diameter", mm(*length_m), mm(*diameter_m))
        }
        Body::Disk { diameter_m } => format!("disk, {} mm in diameter", mm(*diameter_m)),
        Body::Rectangle { width_m, height_m } => format!("rectangle, {} x {} mm", mm(*width_m), mm(*height_m)),
        Body::Mesh { file, .. } => {
            format!("surface of {}", file.path.file_name().unwrap_or_default().to_string_lossy())
        }
    };
    let shape = match fabrication.electrodes.first().map(|one| one.shape) {
        Some(ElectrodeShape::Disc { radius_m }) => format!("discs, {} mm in diameter", mm(2.0 * radius_m)),
        Some(ElectrodeShape::Arc { length_m }) => format!("arcs on the edge, {} mm long", mm(length_m)),
        Some(ElectrodeShape::Point) | None => "points".into(),
        Some(ElectrodeShape::Group) => "groups of nodes of the mesh file".into(),
    };
    let patches = match fabrication.has_membrane() {
        true => "none".into(),
        false => format!("{}, {} mm apart", fabrication.patches.len(), mm(options.patch_pitch_m)),
    };
    let below = match fabrication.has_membrane() {
        true => format!(", on a membrane {} mm thick over foam", mm(MEMBRANE_M)),
        false => String::new(),
    };
    let rows = [
        ("Body", size),
        ("Electrodes", format!("{}: {shape}", fabrication.electrodes.len())),
        ("Coat", format!("{:.0} ohm per square{below}", 1.0 / design.sheet.conductance)),
        ("Patches", patches),
        ("Readings", readings(design)),
        ("Frames", format!("{:.0} a second", electrical.frame_rate_hz())),
    ];
    let rows = rows.into_iter().map(|(what, value)| [what.to_string(), value]);
    let warnings: String =
        notes(fabrication).iter().map(|note| format!("<p class=\"note\">Note: {}</p>\n", marked(note))).collect();
    let caption = "The skin: electrodes with their numbers, seen from enough sides to show all of them.";
    let text = format!(
        "<p class=\"subtitle\">Made from the design by dermis {}. Lengths are in mm; drawings show the outer side. The files \
         named here are in the folder of this page; {} lists them.</p>\n{}{warnings}{}",
        env!("CARGO_PKG_VERSION"),
        code("manifest.json"),
        table(["Property", "Value"], rows).to_html(),
        figure(&pictures::skin(fabrication)?, caption)
    );
    Ok(section("The skin", text, false))
}

/// How many readings a frame takes, and how many of them are its values.
fn readings(design: &SkinDesign) -> String {
    let (values, drives) = (design.protocol.channel_count(), design.protocol.drives().0.len());
    format!(
        "{} in a frame: its {values} values, and the reference resistor once for each of the {drives} drives",
        values + drives
    )
}

pub(super) fn parts(fabrication: &Fabrication) -> Result<Section, FabricateError> {
    let parts = electrical::parts(fabrication)?;
    let row = |one: &electrical::Part| {
        let quantity = format!("{}\u{a0}{}", electrical::amount(one.quantity, one.unit), one.unit);
        [one.part.clone(), one.kind.clone(), quantity, one.purpose.into()]
    };
    let text = format!(
        "<p>Quantities are those of the design ({}); add what is cut away and lost. Also needed are silver paste, \
         two-part glue that holds metal in the print, filler, abrasive paper, masking tape, elastic tape, solder, an \
         ohmmeter, a drill of the bores' size and calipers. The reader has no circuit board yet, and its integrated circuits \
         are for soldering on surfaces: design the board from the table of pins below, or try the circuit on adapter boards \
         first, with the capacitors on them.</p>\n{}",
        code("tables/parts.csv"),
        table(["Part", "Type", "Quantity", "For"], parts.iter().map(row)).to_html()
    );
    Ok(section("Parts and materials", text, true))
}

pub(super) fn base(fabrication: &Fabrication) -> Section {
    let options = &fabrication.options;
    let steps = [
        format!(
            "Print {} (its unit is stated inside) or {} (in mm). Place it so that no support touches the outer side.",
            code("base.3mf"),
            code("base.stl")
        ),
        match fabrication.has_membrane() {
            true => "Grind away what would cut the foam or hold the membrane, above all along the edges.".into(),
            false => "Smooth the outer side: grind it, fill it, grind again. The coat follows every step of the print."
                .into(),
        },
        format!(
            "Clear the {} bores with a drill of {} mm, turned by hand: printed holes come out narrower than drawn.",
            fabrication.electrodes.len(),
            mm(options.bore_m)
        ),
    ];
    let legend: String =
        pictures::wall_legend(fabrication).iter().map(|(_, line)| format!("<li>{line}</li>\n")).collect();
    let mut text = list(&steps)
        + &figure(&pictures::wall(fabrication), "Section of the wall through a bore, not to scale:")
        + &format!("<ol class=\"legend\">\n{legend}</ol>\n");
    text += &match pictures::sheet(fabrication, "drill-template") {
        Some(picture) => {
            let tube = format!(
                "<p>A tube or plate that is not printed is drilled through the template: print {} at 100 %, check its scale \
                 bar, and lay it on the outer side.</p>\n",
                code("patterns/drill-template.svg")
            );
            let channels = match options.channel_depth_m > 0.0 {
                true => " and, on the inner side, channels for wires (grey)",
                false => "",
            };
            figure(&picture, &format!("The base, unrolled: bores (red){channels}.")) + &tube
        }
        None => "<p>The body does not unroll: there is no drill template.</p>\n".into(),
    };
    section("1. Base", text, true)
}

pub(super) fn electrodes(fabrication: &Fabrication) -> Section {
    let steps = electrode_steps(fabrication);
    let places = |[x, y, z]: [f64; 3]| [x, y, z].map(|value| rounded(1e3 * value, 1));
    let row = |one: &crate::model::FabricatedElectrode| {
        let [x, y, z] = places(one.bore.centre_m);
        [one.label.clone(), x, y, z]
    };
    let places = table(["Electrode", "x, mm", "y, mm", "z, mm"], fabrication.electrodes.iter().map(row));
    let text = format!(
        "{}<p>Places of the bores on the outer side; {} has them with the normals.</p>\n{}",
        list(&steps),
        code("tables/electrodes.csv"),
        in_halves(&places)
    );
    section("2. Electrodes", text, true)
}

/// Pins, wires and how they are put in, by the sizes of the design.
fn electrode_steps(fabrication: &Fabrication) -> [String; 6] {
    let options = &fabrication.options;
    let pin = electrical::Pin::of(fabrication);
    let above = match fabrication.has_membrane() {
        true => format!("foam and membrane ({} mm) and ", mm(fabrication.coat_height_m())),
        false => String::new(),
    };
    let length = match options.channel_depth_m > 0.0 {
        true => format!(
            "{above}the wall of {} mm less the depth of a channel. Its upper half is for the solder, which is no wider than the \
             pin and at most {} mm high; below it the wires pass",
            mm(options.wall_m),
            mm(0.5 * options.channel_depth_m)
        ),
        false => format!("{above}the wall of {} mm and room for the solder", mm(options.wall_m)),
    };
    let (wire, lay) = match wires(fabrication) {
        Some((wide_m, most)) => (
            format!(
                "a wire of at most {} mm with its insulation ({}; check its data sheet; the fullest channel holds {}, with \
                 a fifth of its room to spare)",
                decimal(1e3 * wide_m, 2),
                gauge(wide_m),
                counted(most, "wire")
            ),
            format!(
                "Lay the wires in the channels ({} mm wide, {} mm deep) to the edge, and fix them with a drop of glue.",
                mm(options.channel_width_m),
                mm(options.channel_depth_m)
            ),
        ),
        None => (
            "a stranded wire, for example AWG 28".into(),
            "Lead the wires away on the inner side and fix them with a drop of glue.".into(),
        ),
    };
    [
        format!(
            "Cut {} pins of copper or brass, {} mm in diameter: {} mm less than the bore, so that they slide and glue fills \
             the gap. Length {} mm: {length}.",
            fabrication.electrodes.len(),
            mm(pin.diameter_m),
            mm(options.bore_m - pin.diameter_m),
            mm(pin.length_m)
        ),
        format!(
            "Solder to one end of each {wire}, before it goes into the base: the iron would melt the print. Any gauge \
             will do for the readings: a few mA flow, and a metre of AWG 30 has 0.3 ohm. Leave 0.3 m beyond the edge \
             of the base, or as much as the way to the reader needs."
        ),
        format!(
            "Lead the wire through the bore from the outer side, push the pin in until {}, and glue it from the inner side. No \
             glue on its outer face. Let the glue harden as its data sheet says, and grind the face {}.",
            if above.is_empty() {
                "it is flush".into()
            } else {
                format!("{} mm stand out", mm(fabrication.coat_height_m()))
            },
            if above.is_empty() { "flush" } else { "clean and its edge round: the membrane lies there" }
        ),
        lay,
        "Mark the free end of each wire with the electrode's label.".into(),
        "Measure from each pin's face to the end of its wire: below 1 ohm. To every other wire: open.".into(),
    ]
}

/// Wires by their outer diameter, m: seven strands are three strands wide, and the insulation is on both sides.
const GAUGES: [(f64, &str); 4] = [
    (0.78e-3, "stranded, AWG 28: 7 strands of 0.127 mm and 0.2 mm of PVC are 0.78 mm"),
    (0.60e-3, "stranded, AWG 30: 7 strands of 0.1 mm and 0.15 mm of PTFE are 0.6 mm"),
    (0.44e-3, "stranded, AWG 32: 7 strands of 0.08 mm and 0.1 mm of PTFE or FEP are 0.44 mm"),
    (0.25e-3, "stranded, AWG 36: 7 strands of 0.05 mm and 0.05 mm of FEP are 0.25 mm"),
];

/// The thickest of common wires that is thin enough.
fn gauge(wide_m: f64) -> &'static str {
    // Diameters that differ by rounding are equal.
    let fits = |one: &&(f64, &str)| one.0 <= wide_m + 1e-9;
    GAUGES
        .iter()
        .find(fits)
        .map_or("too thin for strands: enamelled copper, which breaks when it is bent often", |one| one.1)
}

/// A design as an argument of a command: the name of a shipped one, else a file.
pub(super) fn argument(design: &SkinDesign) -> String {
    let name = if is_plain(&design.name) { design.name.as_str() } else { "skin" };
    match SkinDesign::shipped(name).is_some_and(|shipped| shipped == *design) {
        true => name.into(),
        false => format!("{name}.toml"),
    }
}

/// Whether a name needs no quotes in a shell.
pub(super) fn is_plain(name: &str) -> bool {
    !name.is_empty() && name.chars().all(|letter| letter.is_ascii_alphanumeric() || "-_".contains(letter))
}

pub(super) fn robot(fabrication: &Fabrication) -> Section {
    let text = format!(include_str!("robot.html"), frame = code(&fabrication.design.frame_id()));
    section("8. Robot", text, false)
}
