//! The step of the cover: patches, foam, and how it is closed.

use super::html::{self, Section, code, list, mm};
use super::pictures;
use crate::model::Fabrication;
use dermis::design::Body;
use dermis_plot::report::figure;

pub(super) fn section(fabrication: &Fabrication) -> Section {
    let text = match fabrication.has_membrane() {
        true => over_membrane(fabrication),
        false => patches(fabrication),
    };
    html::section("4. Cover", text, true)
}

/// What may lie on a coat that conducts less where it is pressed.
fn over_membrane(fabrication: &Fabrication) -> String {
    format!(
        "<p>This coat conducts less where it is pressed (<code>touch = \"conductance_falls\"</code>): pressing stretches it \
         with its membrane. Lay no conductive fabric on it: patches would let it conduct more there. {} and {} are not used. \
         Protect the coat with a soft film that does not conduct and stretches with it, or leave it open.</p>\n\
         <p>Press it with a finger between two neighbours while you measure between them: the resistance must rise, and come \
         back. The coat now is {} mm above the outer side of the base: that is the height of its surface in the robot \
         descriptions over {}.</p>\n",
        code("patterns/patches.svg"),
        code("patterns/patches.csv"),
        mm(fabrication.coat_height_m()),
        code("base.stl")
    )
}

/// The foam with its sizes: ``foam 2 mm thick (W x H mm)``.
pub(super) fn foam(fabrication: &Fabrication) -> String {
    format!("foam {} mm thick{}", mm(fabrication.options.foam_thickness_m), foam_size(fabrication))
}

fn patches(fabrication: &Fabrication) -> String {
    let mut text = list(&steps(fabrication));
    let rows = match fabrication.chart {
        Some(_) => {
            "Patches as they lie on the coat, unrolled: R0C0 is at the lower left, R counts upwards, C to the right."
        }
        None => "Patches, all alike; patches.csv has the place of each.",
    };
    if let Some(picture) = pictures::sheet(fabrication, "patches") {
        text += &figure(&picture, rows);
    }
    text
}

fn steps(fabrication: &Fabrication) -> Vec<String> {
    let options = &fabrication.options;
    let count = fabrication.patches.len();
    let foam = foam(fabrication);
    let glue = match fabrication.design.body {
        Body::Mesh { .. } => format!(
            "Glue each patch to its place in {}, film to the foam, on the inner face of {foam} that is cut on the body.",
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
            "Lay the cover round the base, fabric inwards. Its edges meet at {:.1} degrees from +x. Without tension: tension \
             presses the fabric on the coat, which reads as a touch.",
            options.seam_theta_rad.to_degrees()
        ),
        _ => "Lay the cover on the coat, fabric inwards and without tension: tension presses the fabric on the coat, which \
              reads as a touch."
            .into(),
    };
    vec![
        format!(
            "Cut the test piece of a sheet and measure it. The lines allow for a cut {} mm wide: correct {} by the \
             difference and make the folder again.",
            mm(options.kerf_m),
            code("kerf_m")
        ),
        format!(
            "Iron a stretchable film on one side of the conductive fabric, as hot as the film's data sheet says, and cut \
             {count} patches from {}.",
            code("patterns/patches.svg")
        ),
        format!("{glue} Glue must not soak through to the side of the fabric that touches the coat: let it dry before."),
        lay,
        closure(fabrication),
        "Measure between neighbours again and write the values down. The fabric lies loosely: no value may be lower than \
         before by more than a few per cent, or the cover is too tight."
            .into(),
    ]
}

/// How the cover is closed, by the sizes of the design.
fn closure(fabrication: &Fabrication) -> String {
    let options = &fabrication.options;
    let edge = match options.flange_m > 0.0 {
        true => format!("the flange ({} mm of the base beyond the coat)", mm(options.flange_m)),
        false => "the face of the wall, as the base has no flange beyond the coat".into(),
    };
    match fabrication.design.body {
        Body::Cylinder { .. } => {
            let joint = match options.overlap_m > 0.0 {
                true => format!("glue the overlap of {} mm on the outer face of the foam", mm(options.overlap_m)),
                false => {
                    "its edges are flush: stick an elastic tape 20 mm wide over the joint, on the outer face".into()
                }
            };
            format!("Close the cover: {joint}. Fix both ends with a turn of tape, from the foam to {edge}.")
        }
        Body::Mesh { .. } => {
            "Close the cover: stick an elastic tape 20 mm wide over the joints of the foam, on the outer \
                              face, and from its edges to the inner side of the base."
                .into()
        }
        _ => format!("Fix the cover all round with tape, from the foam to {edge}."),
    }
}

/// Size of the foam's outline: `` (W x H mm)``; nothing for a body that does not unroll.
fn foam_size(fabrication: &Fabrication) -> String {
    let Some(coat) = &fabrication.coat else { return String::new() };
    let [[x0, y0], [x1, y1]] = coat.bounds_m();
    let overlap_m =
        if matches!(fabrication.design.body, Body::Cylinder { .. }) { fabrication.options.overlap_m } else { 0.0 };
    format!(" ({:.1} x {:.1} mm)", 1e3 * (x1 - x0 + overlap_m), 1e3 * (y1 - y0))
}
