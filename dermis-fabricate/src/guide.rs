//! The builder's guide: the steps of the paper's section III.B with the numbers of a design.

use crate::error::FabricateError;
use crate::folder::OutputFile;
use crate::model::Fabrication;
use crate::notes::notes;
use dermis::design::Body;
use std::fmt::Write as _;

/// The guide.
///
/// # Errors
/// None; the type is that of all kinds of outputs.
pub fn files(fabrication: &Fabrication) -> Result<Vec<OutputFile>, FabricateError> {
    Ok(vec![OutputFile::new("GUIDE.md", "steps of the builder", text(fabrication))])
}

fn text(fabrication: &Fabrication) -> String {
    let mut text = format!("# Building {}\n\n", fabrication.design.name);
    let steps = [base(fabrication), coat(fabrication), cover(fabrication), test(fabrication)];
    for (number, step) in steps.iter().enumerate() {
        let _ = writeln!(text, "{}. {step}", number + 1);
    }
    let notes = notes(fabrication);
    if !notes.is_empty() {
        text += "\nNotes:\n\n";
    }
    for note in notes {
        let _ = writeln!(text, "- {note}");
    }
    text
}

fn mm(length_m: f64) -> String {
    let text = format!("{:.3}", 1e3 * length_m);
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

fn base(fabrication: &Fabrication) -> String {
    let options = &fabrication.options;
    let count = fabrication.electrodes.len();
    let channels = match options.channel_depth_m > 0.0 {
        true => format!(
            " Lay their wires in the channels ({} mm wide, {} mm deep).",
            mm(options.channel_width_m),
            mm(options.channel_depth_m)
        ),
        false => String::new(),
    };
    format!(
        "Print `base.3mf` (or `base.stl`, in mm), with a wall of {} mm. Smooth its outer side. Put the {count} electrodes \
         into the bores of {} mm, flush with the surface.{channels} Connect each to the multiplexer input of \
         `tables/wiring.csv`; labels are those of `tables/electrodes.csv`.",
        mm(options.wall_m),
        mm(options.bore_m)
    )
}

fn coat(fabrication: &Fabrication) -> String {
    let resistance_ohm = 1.0 / fabrication.design.sheet.conductance;
    let mask = match fabrication.chart {
        Some(_) => "Cover what is outside the outline `COAT` of `patterns/coat-mask`. ",
        None => "",
    };
    format!(
        "{mask}Spray the coat in thin layers until its sheet resistance is {resistance_ohm:.0} ohm per square. Join coat and \
         electrodes with silver paste, on the pads of the design."
    )
}

fn cover(fabrication: &Fabrication) -> String {
    let options = &fabrication.options;
    let count = fabrication.patches.len();
    let patches = format!(
        "Iron a stretchable film on the conductive fabric, and cut {count} patches from `patterns/patches` (the lines allow \
         for a cut {} mm wide: measure the test piece first).",
        mm(options.kerf_m)
    );
    let foam = format!("foam {} mm thick", mm(options.foam_thickness_m));
    match fabrication.design.body {
        Body::Mesh { .. } => format!(
            "{patches} Glue each to its place in `patterns/patches.csv`, on a layer of {foam} that is cut on the body."
        ),
        Body::Cylinder { .. } => format!(
            "{patches} Glue {foam} from `patterns/foam` on them, and lay the cover round the base, fabric inwards; its edges \
             meet at the angle {:.4} rad.",
            options.seam_theta_rad
        ),
        _ => format!("{patches} Glue {foam} from `patterns/foam` on them, and lay the cover on the base, fabric down."),
    }
}

fn test(fabrication: &Fabrication) -> String {
    format!(
        "Read the untouched skin and compare with `tables/readings.csv` ({} values); `dermis check-frames` names channels \
         that are wrong, and `dermis fit` the sheet resistance that was reached.",
        fabrication.design.protocol.channel_count()
    )
}
