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

/// A line of the picture's legend: where it points to, and its text.
type Pointer = ([f64; 2], String);

const CHANNEL: &str =
    "<rect x=\"4\" y=\"43\" width=\"52\" height=\"9\" fill=\"#ffffff\" stroke=\"#1c2330\" stroke-width=\"0.25\"/>\n";

/// A section of the wall through a bore, along its channel. Not to scale.
pub(super) fn wall(options: &FabricationOptions) -> String {
    let channel = if options.channel_depth_m > 0.0 { CHANNEL } else { "" };
    let pointer = |(row, ([x, y], label)): (usize, &Pointer)| {
        let at = 6.5 + 7.2 * row as f64;
        format!(
            "<path d=\"M{x} {y} L101 {at}\" fill=\"none\" stroke=\"#5a6472\" stroke-width=\"0.2\"/>\
             <circle cx=\"{x}\" cy=\"{y}\" r=\"0.6\" fill=\"#1c2330\"/><text x=\"102\" y=\"{:.1}\">{label}</text>\n",
            at + 1.2
        )
    };
    let pointers: String = pointers(options).iter().enumerate().map(pointer).collect();
    format!(include_str!("wall.svg"), channel = channel, pointers = pointers)
}

fn pointers(options: &FabricationOptions) -> Vec<Pointer> {
    let channel = match options.channel_depth_m > 0.0 {
        true => format!("channel {} wide, {} deep", mm(options.channel_width_m), mm(options.channel_depth_m)),
        false => "inner side: wires, no channels".into(),
    };
    vec![
        ([90.0, 9.0], format!("foam {}", mm(options.foam_thickness_m))),
        ([80.0, 15.1], format!("fabric patches, pitch {}, gap {}", mm(options.patch_pitch_m), mm(options.patch_gap_m))),
        ([58.0, 24.0], "silver paste on the pad".into()),
        ([90.0, 25.3], "coat".into()),
        ([50.0, 31.0], format!("electrode in a bore of {}", mm(options.bore_m))),
        ([88.0, 40.0], format!("wall {}", mm(options.wall_m))),
        ([12.0, 48.5], "wire".into()),
        ([20.0, 45.0], channel),
    ]
}
