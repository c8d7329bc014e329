//! Pictures of the page: the skin, a section of the wall, and the sheets of the cut patterns.

use super::html::mm;
use crate::error::FabricateError;
use crate::model::{Fabrication, MEMBRANE_M};
use crate::sheet;
use dermis_plot::{Drawing, View};

/// Width and greatest height of a drawing on the page, mm.
const BOX_MM: [f64; 2] = [172.0, 118.0];

/// The skin with its electrodes, from enough sides.
pub(super) fn skin(fabrication: &Fabrication) -> Result<String, FabricateError> {
    let electrical = fabrication.electrical()?;
    let drawing = Drawing::new(&fabrication.design, &electrical.mesh);
    let picture = View::Solid.draw(&drawing.electrodes(), &fabrication.design);
    Ok(picture.map_err(|error| FabricateError::Internal(error.to_string()))?.to_svg())
}

/// The drawing of a sheet; `None` if the body has none of this name.
pub(super) fn sheet(fabrication: &Fabrication, name: &str) -> Option<String> {
    let sheets = sheet::sheets(fabrication);
    sheets.iter().find(|sheet| sheet.name == name).map(|sheet| sheet::figure(sheet, BOX_MM))
}

const CHANNEL: &str =
    "<rect x=\"4\" y=\"43\" width=\"52\" height=\"9\" fill=\"#ffffff\" stroke=\"#1c2330\" stroke-width=\"0.25\"/>\n";
const COVER: &str = "<g stroke=\"#1c2330\" stroke-width=\"0.25\">\
    <rect x=\"4\" y=\"4\" width=\"92\" height=\"10\" fill=\"#d8e6f3\"/>\
    <path d=\"M4.5 14 h29 v2.2 h-29 z M35.5 14 h29 v2.2 h-29 z M66.5 14 h29 v2.2 h-29 z\" fill=\"#8a8f98\"/></g>\n";

const MEMBRANE: &str = "<g stroke=\"#1c2330\" stroke-width=\"0.25\">\
    <rect x=\"4\" y=\"17\" width=\"92\" height=\"9\" fill=\"#d8e6f3\"/>\
    <rect x=\"4\" y=\"15.6\" width=\"92\" height=\"1.4\" fill=\"#e3b7c3\"/></g>\n";
/// Height of foam and membrane in the section, mm.
const RAISED_MM: f64 = 10.4;

/// A section of the wall through a bore, along its channel, not to scale, with the numbers of the rows of [`wall_legend`].
pub(super) fn wall(fabrication: &Fabrication) -> String {
    let has_channel = fabrication.options.channel_depth_m > 0.0;
    let pointer = |(row, ([x, y], _)): (usize, &([f64; 2], String))| {
        format!(
            "<circle cx=\"{x}\" cy=\"{y:.1}\" r=\"2.6\" fill=\"#fff\" stroke=\"#1c2330\" stroke-width=\"0.25\"/>\
             <text x=\"{x}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\n",
            y + 1.2,
            row + 1
        )
    };
    // The pin ends at the bottom of the channel, or beyond the inner face.
    let end = if has_channel { 43.0 } else { 54.5 };
    let top = if fabrication.has_membrane() { 7 } else { 0 };
    let raised = raised_mm(fabrication);
    format!(
        include_str!("wall.svg"),
        cover = if fabrication.has_membrane() { MEMBRANE } else { COVER },
        coat = 24.6 - raised,
        paste = 23.4 - raised,
        face = 24.0 - raised,
        top = top,
        height = 60 - top,
        channel = if has_channel { CHANNEL } else { "" },
        pin = end - 24.0 + raised,
        end = end,
        wire = wire_mm(fabrication),
        pointers = wall_legend(fabrication).iter().enumerate().map(pointer).collect::<String>()
    )
}

/// Height of the coat over the wall in the section, mm.
fn raised_mm(fabrication: &Fabrication) -> f64 {
    if fabrication.has_membrane() { RAISED_MM } else { 0.0 }
}

/// Height of the wire in the section, mm.
fn wire_mm(fabrication: &Fabrication) -> f64 {
    if fabrication.options.channel_depth_m > 0.0 { 49.6 } else { 56.6 }
}

/// What is where in the section of the wall, mm.
pub(super) fn wall_legend(fabrication: &Fabrication) -> Vec<([f64; 2], String)> {
    let options = &fabrication.options;
    let (foam, raised) = (format!("foam, {} mm", mm(options.foam_thickness_m)), raised_mm(fabrication));
    let mut legend = match fabrication.has_membrane() {
        true => vec![([64.0, 21.5], foam), ([78.0, 16.3], format!("membrane, {} mm", mm(MEMBRANE_M)))],
        false => {
            let patches =
                format!("fabric patches, pitch {} mm, gap {} mm", mm(options.patch_pitch_m), mm(options.patch_gap_m));
            vec![([84.0, 9.0], foam), ([72.0, 15.1], patches)]
        }
    };
    legend.extend([
        ([37.0, 22.5 - raised], "silver paste on the pad".into()),
        ([90.0, 25.3 - raised], "coat".into()),
        ([50.0, 34.0], format!("electrode in a bore of {} mm", mm(options.bore_m))),
        ([78.0, 40.0], format!("wall, {} mm", mm(options.wall_m))),
        ([20.0, wire_mm(fabrication)], "wire".into()),
    ]);
    if options.channel_depth_m > 0.0 {
        let size = format!("{} mm wide, {} mm deep", mm(options.channel_width_m), mm(options.channel_depth_m));
        legend.push(([30.0, 45.5], format!("channel, {size}")));
    }
    legend
}
