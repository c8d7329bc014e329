//! Pictures of the page: the skin, a section of the wall, and the sheets of the cut patterns.

use super::html::mm;
use crate::error::FabricateError;
use crate::model::Fabrication;
use crate::sheet;
use dermis::design::FabricationOptions;
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

/// A section of the wall through a bore, along its channel, not to scale, with numbers where the lines of
/// [`wall_legend`] point to.
pub(super) fn wall(options: &FabricationOptions) -> String {
    let has_channel = options.channel_depth_m > 0.0;
    let pointer = |(row, [x, y]): (usize, &[f64; 2])| {
        format!(
            "<circle cx=\"{x}\" cy=\"{y}\" r=\"2.6\" fill=\"#fff\" stroke=\"#1c2330\" stroke-width=\"0.25\"/>\
             <text x=\"{x}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\n",
            y + 1.2,
            row + 1
        )
    };
    format!(
        include_str!("wall.svg"),
        channel = if has_channel { CHANNEL } else { "" },
        // To half the depth of the channel; without one beyond the inner face.
        pin = if has_channel { 23.5 } else { 29.0 },
        wire = if has_channel { 47.5 } else { 53.0 },
        pointers = PLACES_MM.iter().enumerate().map(pointer).collect::<String>()
    )
}

/// Places of the numbers in the section of the wall.
const PLACES_MM: [[f64; 2]; 8] =
    [[84.0, 9.0], [72.0, 15.1], [37.0, 22.5], [90.0, 25.3], [50.0, 34.0], [78.0, 40.0], [20.0, 49.6], [30.0, 45.5]];

/// What the numbers in the section of the wall are.
pub(super) fn wall_legend(options: &FabricationOptions) -> [String; 8] {
    let channel = match options.channel_depth_m > 0.0 {
        true => format!("channel {} mm wide, {} mm deep", mm(options.channel_width_m), mm(options.channel_depth_m)),
        false => "inner side: wires, no channels".into(),
    };
    [
        format!("foam, {} mm", mm(options.foam_thickness_m)),
        format!("fabric patches, pitch {} mm, gap {} mm", mm(options.patch_pitch_m), mm(options.patch_gap_m)),
        "silver paste on the pad".into(),
        "coat".into(),
        format!("electrode in a bore of {} mm", mm(options.bore_m)),
        format!("wall, {} mm", mm(options.wall_m)),
        "wire".into(),
        channel,
    ]
}
