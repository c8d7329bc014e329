//! Sheets for cutters and printers: closed outlines in layers, as SVG and DXF with the same coordinates.

mod dxf;
mod patterns;
mod svg;

pub(crate) use patterns::sheets;
pub(crate) use svg::figure;

use crate::error::FabricateError;
use crate::folder::OutputFile;
use crate::model::Fabrication;
use crate::outline::Outline;
use dermis::geom::Point2;
use dermis::geom::vector::bounding_box;
use dermis::text::decimal;
use std::fmt::Write as _;

/// A layer: the outlines of one operation.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Its name in the files.
    pub(crate) name: &'static str,
    /// Its colour: red, green, blue, and the number of the similar one of a DXF file.
    pub(crate) colour: ([u8; 3], u8),
    /// Paths to be cut or drawn, m.
    pub(crate) outlines: Vec<Outline>,
}

/// A text beside an outline, in the layer `LABELS`.
#[derive(Debug, Clone, PartialEq)]
pub struct Label {
    /// Left end of its base line, m; its right end if it is to end there.
    pub(crate) at_m: Point2,
    /// Whether `at_m` is its right end.
    pub(crate) ends: bool,
    /// Height of its capitals, m.
    pub(crate) height_m: f64,
    /// The text: ASCII without control characters.
    pub(crate) text: String,
}

/// Width of a letter over the height of capitals, at most.
const LETTER: f64 = 1.0;

impl Label {
    /// A text that begins at a place.
    pub(crate) fn new(at_m: Point2, height_m: f64, text: &str) -> Self {
        Label { at_m, ends: false, height_m, text: ascii(text) }
    }

    /// The box that it takes, at most, with letters enlarged by a factor.
    pub(crate) fn bounds_m(&self, factor: f64) -> [Point2; 2] {
        let [x, y] = self.at_m;
        let wide_m = LETTER * factor * self.height_m * self.text.len() as f64;
        let left = if self.ends { x - wide_m } else { x };
        [[left, y], [left + wide_m, y + factor * self.height_m]]
    }
}

/// A drawing: the lower left corner is at the origin, x to the right, y up.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// Name of its files.
    pub(crate) name: &'static str,
    /// What it is for.
    pub(crate) purpose: String,
    /// Its layers.
    pub(crate) layers: Vec<Layer>,
    /// Its labels.
    pub(crate) labels: Vec<Label>,
    /// Width and height, m.
    pub(crate) size_m: [f64; 2],
}

/// Space round the drawing and between its parts, m.
const MARGIN_M: f64 = 0.010;
/// Length of the scale bar, m.
const SCALE_M: f64 = 0.100;
/// Side of the test piece, and of the hole in it, m.
const COUPON_M: f64 = 0.020;
const COUPON_HOLE_M: f64 = 0.010;
const TEXT_M: f64 = 0.003;

/// Layers that every sheet has, whatever is on it.
pub(crate) const FURNITURE: [&str; 2] = ["SCALE", "COUPON"];

const BLACK: ([u8; 3], u8) = ([0, 0, 0], 7);

impl Sheet {
    /// A sheet of some layers: below them the scale bar, the test piece for the kerf, and the title.
    pub(crate) fn new(
        name: &'static str,
        purpose: String,
        title: String,
        mut layers: Vec<Layer>,
        mut labels: Vec<Label>,
        kerf_m: f64,
    ) -> Self {
        let outlines = layers.iter().flat_map(|layer| &layer.outlines).flat_map(Outline::bounds_m);
        let [low, mut high] = bounding_box(outlines.chain(labels.iter().flat_map(|label| label.bounds_m(1.0))));
        high[0] = high[0].max(low[0] + SCALE_M + MARGIN_M + COUPON_M + MARGIN_M);
        let foot = [low[0], low[1] - MARGIN_M - COUPON_M];
        layers.extend(furniture(foot, kerf_m, &mut labels));
        let at_m = [foot[0], foot[1] - MARGIN_M];
        let title = Label::new(at_m, TEXT_M, &title);
        high[0] = high[0].max(title.bounds_m(1.0)[1][0]);
        labels.push(title);
        let by = [MARGIN_M - low[0], MARGIN_M - at_m[1]];
        for layer in &mut layers {
            layer.outlines = layer.outlines.iter().map(|outline| outline.moved(by)).collect();
        }
        for label in &mut labels {
            label.at_m = [label.at_m[0] + by[0], label.at_m[1] + by[1]];
        }
        let size_m = [high[0] + by[0] + MARGIN_M, high[1] + by[1] + MARGIN_M];
        Sheet { name, purpose, layers, labels, size_m }
    }

    fn files(&self) -> [OutputFile; 2] {
        let file = |ending: &str, format: &str, text: String| {
            let purpose = format!("{} ({format})", self.purpose);
            OutputFile::new(format!("patterns/{}.{ending}", self.name), purpose, text)
        };
        [file("svg", "SVG, mm", svg::text(self)), file("dxf", "DXF R2000, mm", dxf::text(self))]
    }
}

/// The scale bar, and the test piece: after cutting, its side and its hole have the lengths of its label.
fn furniture([x, y]: Point2, kerf_m: f64, labels: &mut Vec<Label>) -> [Layer; 2] {
    let half_m = 0.5 * kerf_m;
    let bar = Outline::rectangle([x, y], [x + SCALE_M, y + 0.002]);
    let left = x + SCALE_M + MARGIN_M;
    let inset = 0.5 * (COUPON_M - COUPON_HOLE_M);
    let piece = Outline::rectangle([left, y], [left + COUPON_M, y + COUPON_M]);
    let hole = Outline::rectangle([left + inset, y + inset], [left + inset + COUPON_HOLE_M, y + inset + COUPON_HOLE_M]);
    labels.push(Label::new([x, y + 0.004], TEXT_M, "100 mm"));
    let text = format!("cut with a kerf of {:.2} mm:", 1e3 * kerf_m);
    labels.push(Label::new([x, y + 0.016], TEXT_M, &text));
    labels.push(Label::new([x, y + 0.011], TEXT_M, "side 20.00 mm, hole 10.00 mm ->"));
    [
        Layer { name: FURNITURE[0], colour: BLACK, outlines: vec![bar] },
        Layer {
            name: FURNITURE[1],
            colour: ([230, 120, 0], 30),
            outlines: vec![piece.grown(half_m), hole.grown(-half_m)],
        },
    ]
}

/// A length in mm with at most seven decimals: tenths of a nanometre.
pub(crate) fn mm(length_m: f64) -> String {
    decimal(1e3 * length_m, 7)
}

/// A text in ASCII, as every reader of DXF knows it.
fn ascii(text: &str) -> String {
    text.chars().map(|letter| if letter == ' ' || letter.is_ascii_graphic() { letter } else { '?' }).collect()
}

/// The cut patterns, the drill template, and the list of patches.
///
/// # Errors
/// None; the type is that of all kinds of outputs.
pub fn files(fabrication: &Fabrication) -> Result<Vec<OutputFile>, FabricateError> {
    let mut files: Vec<OutputFile> = patterns::sheets(fabrication).iter().flat_map(Sheet::files).collect();
    files.push(OutputFile::new(
        "patterns/patches.csv",
        match fabrication.has_membrane() {
            true => "not used: places of fabric patches",
            false => "place, area and strain of each patch",
        },
        patch_table(fabrication),
    ));
    Ok(files)
}

fn patch_table(fabrication: &Fabrication) -> String {
    let mut text = String::from("label,x_mm,y_mm,z_mm,area_mm2,strain\n");
    for patch in &fabrication.patches {
        let [x, y, z] = patch.centre_m.map(|value| format!("{:.4}", 1e3 * value + 0.0));
        let _ = writeln!(text, "{},{x},{y},{z},{:.6},{:.6}", patch.label, 1e6 * patch.outline.area_m2(), patch.strain);
    }
    text
}

#[cfg(test)]
mod tests;
