//! The steps and what they need, in words, tables and pictures.

use super::html::{code, in_halves, list, marked, mm, rounded, section, table};
use super::pictures;
use crate::electrical;
use crate::error::FabricateError;
use crate::model::Fabrication;
use crate::notes::notes;
use dermis::design::{Body, ElectrodeShape, SkinDesign};
use dermis::text::escaped;
use dermis_plot::report::figure;

pub(super) fn overview(fabrication: &Fabrication) -> Result<String, FabricateError> {
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
    let rows = [
        ("Body", size),
        ("Electrodes", format!("{}: {shape}", fabrication.electrodes.len())),
        ("Coat", format!("{:.0} ohm per square", 1.0 / design.sheet.conductance)),
        ("Patches", format!("{}, {} mm apart", fabrication.patches.len(), mm(options.patch_pitch_m))),
        ("Readings", format!("{} in a frame", electrical.readings.len())),
        ("Frames", format!("{:.0} a second", electrical.frame_rate_hz())),
    ];
    let rows = rows.into_iter().map(|(what, value)| [what.to_string(), value]);
    let warnings: String =
        notes(fabrication).iter().map(|note| format!("<p class=\"note\">Note: {}</p>\n", marked(note))).collect();
    let caption = "The skin: electrodes with their numbers, seen from enough sides to show all of them.";
    Ok(format!(
        "<p class=\"subtitle\">Made from the design by dermis {}. Lengths are in mm; drawings show the outer side. The files \
         named here are in the folder of this page; {} lists them.</p>\n{}{warnings}{}",
        env!("CARGO_PKG_VERSION"),
        code("manifest.json"),
        table(["Property", "Value"], rows).to_html(),
        figure(&pictures::skin(fabrication)?, caption)
    ))
}

pub(super) fn parts(fabrication: &Fabrication) -> Result<String, FabricateError> {
    let parts = electrical::parts(fabrication)?;
    let row = |one: &electrical::Part| {
        let quantity = electrical::amount(one.quantity, one.unit);
        [one.part.clone(), one.kind.clone(), quantity, one.unit.into(), one.purpose.into()]
    };
    let text = format!(
        "<p>Quantities are those of the design ({}); add what is cut away and lost. Silver paste, glue, filler and tools are \
         not listed.</p>\n{}",
        code("tables/parts.csv"),
        table(["Part", "Type", "Quantity", "Unit", "For"], parts.iter().map(row)).to_html()
    );
    Ok(section("Parts and materials", &text, true))
}

pub(super) fn base(fabrication: &Fabrication) -> String {
    let options = &fabrication.options;
    let steps = [
        format!(
            "Print {} (its unit is stated inside) or {} (in mm). Place it so that no support touches the outer side.",
            code("base.3mf"),
            code("base.stl")
        ),
        "Smooth the outer side: grind it, fill it, grind again. The coat follows every step of the print.".into(),
        format!("Clear the {} bores with a drill of {} mm.", fabrication.electrodes.len(), mm(options.bore_m)),
    ];
    let mut text = list(&steps) + &figure(&pictures::wall(options), "Section of the wall, not to scale; sizes in mm.");
    text += &match pictures::sheet(fabrication, "drill-template") {
        Some(picture) => {
            let tube = format!(
                "<p>A tube or plate that is not printed is drilled through the template: print {} at 100 %, check its scale \
                 bar, and lay it on the outer side.</p>\n",
                code("patterns/drill-template.svg")
            );
            figure(&picture, "The base, unrolled: bores (red) and, on the inner side, channels for wires (grey).")
                + &tube
        }
        None => "<p>The body does not unroll: there is no drill template.</p>\n".into(),
    };
    section("1. Base", &text, true)
}

pub(super) fn electrodes(fabrication: &Fabrication) -> String {
    let options = &fabrication.options;
    let wires = match options.channel_depth_m > 0.0 {
        true => format!(
            "Lay the wires in the channels ({} mm wide, {} mm deep) and fix them.",
            mm(options.channel_width_m),
            mm(options.channel_depth_m)
        ),
        false => "Lead the wires away on the inner side and fix them.".into(),
    };
    let steps = [
        "Put an electrode into each bore, flush with the outer side, and glue it from the inner side.".to_string(),
        "Solder or crimp a wire to each, and mark its free end with the electrode's label.".into(),
        wires,
    ];
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
    section("2. Electrodes", &text, false)
}

pub(super) fn coat(fabrication: &Fabrication) -> String {
    let ohm = 1.0 / fabrication.design.sheet.conductance;
    let mut steps = Vec::new();
    if fabrication.chart.is_some() {
        let file = code("patterns/coat-mask.svg");
        steps.push(format!("Cut a mask from {file}: outline COAT for the coat, PADS for the paste."));
    }
    let measure = code("dermis fit");
    steps.extend([
        "Cover what is outside the outline of the coat, and the tips of the electrodes.".to_string(),
        format!(
            "Spray thin layers and let each dry, until a four-point probe or {measure} gives {ohm:.0} ohm per square. \
             Turn the base between layers."
        ),
        "Join each electrode and the coat with silver paste on the pad's outline. Let it dry.".into(),
        format!(
            "Measure between neighbours with an ohmmeter. An open contact shows here, before the cover hides it: {} has the \
             resistances to expect.",
            code("tables/readings.csv")
        ),
    ]);
    let mut text = list(&steps);
    if let Some(picture) = pictures::sheet(fabrication, "coat-mask") {
        text += &figure(&picture, "Coat (red) and pads of the electrodes (green), unrolled, outer side up.");
    }
    section("3. Coat", &text, true)
}

pub(super) fn cover(fabrication: &Fabrication) -> String {
    let options = &fabrication.options;
    let count = fabrication.patches.len();
    let foam = format!("foam {} mm thick{}", mm(options.foam_thickness_m), foam_size(fabrication));
    let glue = match fabrication.design.body {
        Body::Mesh { .. } => format!(
            "Glue each patch to its place in {}, film outwards, on the inner face of {foam} that is cut on the body.",
            code("patterns/patches.csv")
        ),
        Body::Cylinder { .. } => format!(
            "Cut {foam} from {}. Glue the patches on it in their places, film to the foam.",
            code("patterns/foam.svg")
        ),
        _ => format!("Cut {foam} from {}. Glue the patches on it, film to the foam.", code("patterns/foam.svg")),
    };
    let lay = match fabrication.design.body {
        Body::Cylinder { .. } => format!(
            "Lay the cover round the base, fabric inwards and without tension. Its edges meet at {:.1} degrees from +x.",
            options.seam_theta_rad.to_degrees()
        ),
        _ => "Lay the cover on the coat, fabric inwards and without tension, and fix it at its edge.".into(),
    };
    let steps = [
        format!(
            "Cut the test piece of a sheet and measure it. The lines allow for a cut {} mm wide: correct {} by the \
             difference and make the folder again.",
            mm(options.kerf_m),
            code("kerf_m")
        ),
        format!(
            "Iron a stretchable film on one side of the conductive fabric, and cut {count} patches from {}.",
            code("patterns/patches.svg")
        ),
        glue,
        lay,
    ];
    let mut text = list(&steps);
    let rows = match fabrication.chart {
        Some(_) => {
            "Patches as they lie on the coat, unrolled: R0C0 is at the lower left, R counts upwards, C to the right."
        }
        None => "Patches, all alike; patches.csv has the place of each.",
    };
    if let Some(picture) = pictures::sheet(fabrication, "patches") {
        text += &figure(&picture, rows);
    }
    section("4. Cover", &text, true)
}

/// Size of the foam's outline: `` (W x H mm)``; nothing for a body that does not unroll.
fn foam_size(fabrication: &Fabrication) -> String {
    let Some(coat) = &fabrication.coat else { return String::new() };
    let [[x0, y0], [x1, y1]] = coat.bounds_m();
    let overlap_m =
        if matches!(fabrication.design.body, Body::Cylinder { .. }) { fabrication.options.overlap_m } else { 0.0 };
    format!(" ({:.1} x {:.1} mm)", 1e3 * (x1 - x0 + overlap_m), 1e3 * (y1 - y0))
}

/// Readings of the first drive that the page shows.
const SHOWN: usize = 12;

pub(super) fn test(fabrication: &Fabrication) -> Result<String, FabricateError> {
    let electrical = fabrication.electrical()?;
    let options = &fabrication.options;
    let first = electrical.readings[0].slot.drive;
    let label = |electrode: usize| fabrication.electrodes[electrode].label.clone();
    let row = |(slot, one): (usize, &electrical::Reading)| {
        let between = match one.slot.measure {
            Some(([plus, minus], _)) => format!("{} - {}", label(plus), label(minus)),
            None => "reference resistor".into(),
        };
        let [low, high] = one.volt.limits();
        let [low, nominal, high] = [low, one.volt.nominal, high].map(|value| rounded(1e3 * value, 2));
        [slot.to_string(), between, low, nominal, high]
    };
    let of_first = electrical.readings.iter().enumerate().filter(|(_, one)| one.slot.drive == first);
    let columns = ["Slot", "Between", "Least, mV", "Expected, mV", "Greatest, mV"];
    let text = format!(
        include_str!("test.html"),
        sheet = 100.0 * options.sheet_spread,
        contact = 100.0 * options.contact_spread,
        reference = 100.0 * electrical::REFERENCE_TOLERANCE,
        source = label(first[0]),
        sink = label(first[1]),
        volt = electrical.electronics.source_v,
        ohm = electrical.electronics.reference_ohm,
        readings = table(columns, of_first.take(SHOWN).map(row)).to_html(),
        design = escaped(&argument(&fabrication.design)),
        port = "--source serial:/dev/ttyACM0"
    );
    Ok(section("6. First test", &text, true))
}

/// A design as an argument of a command: the name of a shipped one, else a file.
fn argument(design: &SkinDesign) -> String {
    let name = if is_plain(&design.name) { design.name.as_str() } else { "skin" };
    match SkinDesign::shipped(name).is_some_and(|shipped| shipped == *design) {
        true => name.into(),
        false => format!("{name}.toml"),
    }
}

/// Whether a name needs no quotes in a shell.
fn is_plain(name: &str) -> bool {
    !name.is_empty() && name.chars().all(|letter| letter.is_ascii_alphanumeric() || "-_".contains(letter))
}

pub(super) fn robot(fabrication: &Fabrication) -> String {
    let text = format!(include_str!("robot.html"), frame = code(&fabrication.design.frame_id()));
    section("7. Robot", &text, false)
}
