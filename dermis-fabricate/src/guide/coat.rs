//! The step of the coat: what it lies on, masks, layers, regions, paste, and the resistances that show that all is well.

use super::cover::foam;
use super::html::{self, Section, code, in_halves, list, mm, table};
use super::pictures;
use crate::electrical::Neighbours;
use crate::error::FabricateError;
use crate::model::{Fabrication, MEMBRANE_M};
use dermis::design::{Body, Region, RegionPlace};
use dermis::text::escaped;
use dermis_plot::report::figure;

/// A test strip, mm: its length is this many times its width, and so many times the sheet resistance is its own.
const STRIP_MM: [usize; 2] = [10, 50];

/// When paint or paste is dry: what a test shows, whatever it is made of.
const DRY: &str = "It is dry when two readings of the resistance, ten minutes apart, differ by less than 1 %: it no longer \
                   falls.";

pub(super) fn section(fabrication: &Fabrication) -> Result<Section, FabricateError> {
    let has_regions = !fabrication.design.sheet.regions.is_empty();
    let mut text = String::new();
    if fabrication.has_membrane() {
        text += &format!("<h3>Foam and membrane</h3>\n{}<h3>Coat</h3>\n", list(&membrane(fabrication)));
    }
    text += &list(&steps(fabrication));
    if has_regions {
        text += &regions(fabrication);
    }
    if let Some(picture) = pictures::sheet(fabrication, "coat-mask") {
        let regions = if has_regions { ", regions of another resistance (magenta)" } else { "" };
        let caption = format!("Coat (red), pads of the electrodes (green){regions}, unrolled, outer side up.");
        text += &figure(&picture, &caption);
    }
    text += &neighbours(fabrication)?;
    let heading = if fabrication.has_membrane() { "3. Membrane and coat" } else { "3. Coat" };
    Ok(html::section(heading, text, true))
}

/// How the membrane comes over the base, so that a press stretches the coat on it.
fn membrane(fabrication: &Fabrication) -> Vec<String> {
    let hole = format!("punch a hole of {} mm for each pin", mm(fabrication.options.bore_m));
    let lay = match fabrication.chart {
        Some(_) => format!(
            "Cut {} from {}, {hole} ({} has their places), and lay it on the base over the pins.",
            foam(fabrication),
            code("patterns/foam.svg"),
            code("patterns/drill-template.svg")
        ),
        None => format!("Cut {} on the body, {hole}, and lay it on the base over the pins.", foam(fabrication)),
    };
    vec![
        format!("{lay} Under a press it gives way, so that the membrane stretches. A rigid base below it would not let it."),
        format!(
            "Cut a membrane of rubber {} mm thick (latex, silicone or thermoplastic polyurethane), 20 mm larger than the foam \
             all round. Choose one to which the paint sticks, and a paint that stays elastic: the resistance of a coated \
             strip must rise when it is stretched by a tenth, and come back.",
            mm(MEMBRANE_M)
        ),
        "Lay the membrane over the foam. Pierce it at each pin with a hole narrower than the pin, and push it down until the \
         pin's face is flush with its outer side."
            .into(),
        "Stretch the membrane until it has no folds and lies on the foam without pressing it, and glue its rim to the base \
         beyond the foam, or round the edge to the inner side."
            .into(),
    ]
}

fn steps(fabrication: &Fabrication) -> Vec<String> {
    let design = &fabrication.design;
    let mut steps = Vec::new();
    if fabrication.chart.is_some() {
        let file = code("patterns/coat-mask.svg");
        steps.push(format!("Cut a mask from {file}: outline COAT for the coat, PADS for the paste."));
    } else {
        steps.push("The body does not unroll: mask its edges with tape.".into());
    }
    let [wide, long] = STRIP_MM;
    let ground = if fabrication.has_membrane() { "membrane" } else { "material" };
    let ohm = 1.0 / design.sheet.conductance;
    steps.extend([
        "Cover what is outside the outline of the coat, and the faces of the electrodes.".to_string(),
        format!(
            "Lay a test strip beside the base, of the same {ground}: {wide} mm wide, with silver paste across it at two \
             places {long} mm apart. Its resistance is {} times the sheet resistance.",
            long / wide
        ),
        format!(
            "Spray thin layers, and turn the base between them. Read on the paint's data sheet how long a layer dries \
             before the next one, and how long and how warm the last one; stay below the temperature at which the print \
             softens (PLA: about 55 \u{b0}C). {DRY}"
        ),
        format!(
            "Spray until the dry strip has {:.0} ohm: {ohm:.0} ohm per square. Within {:.0} % of it the limits below hold.",
            ohm * (long / wide) as f64,
            100.0 * fabrication.options.sheet_spread
        ),
    ]);
    if !design.sheet.regions.is_empty() {
        steps.push(
            "Regions of another resistance: mask them while the rest is sprayed, then mask the rest, and spray each region \
             to the resistance of the table below, with a test strip of its own. Both coats must touch along the edge of \
             the region. Where regions overlap, the later row holds."
                .into(),
        );
    }
    steps.extend([
        format!(
            "Join each electrode and the coat with silver paste on the pad's outline. Its data sheet says how it dries, and \
             whether its solvent harms the coat: try it on the strip. {DRY}"
        ),
        format!(
            "Measure between neighbours with an ohmmeter, at the ends of the wires, before the cover hides the contacts. The \
             table below has what to expect ({} is the same). One electrode with both values too high has a bad \
             contact: paste it again. The limits are wide, as all values grow with the sheet resistance: compare electrodes \
             that have equal values in the table with one another, too.",
            code("tables/neighbours.csv")
        ),
    ]);
    steps
}

/// The regions with their resistances.
fn regions(fabrication: &Fabrication) -> String {
    let axes = if matches!(fabrication.design.body, Body::Cylinder { .. }) { ["z", "s"] } else { ["x", "y"] };
    let place = |region: &Region| match region.place {
        RegionPlace::Box { low_m: [a0, b0], high_m: [a1, b1] } => {
            format!("{} {} to {}, {} {} to {}", axes[0], mm(a0), mm(a1), axes[1], mm(b0), mm(b1))
        }
        RegionPlace::Group => "the group of this name in the body's file".into(),
    };
    let row = |region: &Region| [region.name.clone(), format!("{:.0}", 1.0 / region.conductance), place(region)];
    let rows = table(["Region", "Ohm per square", "Place, mm"], fabrication.design.sheet.regions.iter().map(row));
    let around = match fabrication.design.body {
        Body::Cylinder { .. } => "<p>s is the length round the cylinder from +x towards +y.</p>\n",
        _ => "",
    };
    rows.to_html() + around
}

fn neighbours(fabrication: &Fabrication) -> Result<String, FabricateError> {
    let label = |number: usize| escaped(&fabrication.electrodes[number].label);
    let row = |one: &Neighbours| {
        let [low, high] = one.ohm.limits();
        let [a, b] = one.pair.map(label);
        let [low, expected, high] = [low, one.ohm.nominal, high].map(|ohm| format!("{:.0}", ohm.max(0.0)));
        [format!("{a} - {b}"), low, expected, high, String::new()]
    };
    let columns = ["Between", "Least", "Expected", "Most", "Read"];
    let rows = in_halves(&table(columns, fabrication.electrical()?.neighbours.iter().map(row)));
    Ok(format!("<h3>Resistances between neighbours, without the reader, ohm</h3>\n{rows}"))
}
