//! SVG with its size and its coordinates in mm, y down.

use crate::outline::Outline;
use crate::sheet::{Sheet, escaped, mm};
use std::fmt::Write as _;

/// Width of a line, mm: cutters read it as a hairline.
const LINE_MM: f64 = 0.1;
/// Height of capitals over the size of a font (DejaVu Sans, as the drawings of the other commands).
const CAPITALS: f64 = 0.73;

pub(super) fn text(sheet: &Sheet) -> String {
    let [width, height] = sheet.size_m.map(mm);
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" \
         height=\"{height}mm\" viewBox=\"0 0 {width} {height}\">\n<title>{}</title>\n",
        escaped(&sheet.purpose)
    );
    for layer in &sheet.layers {
        let [red, green, blue] = layer.colour.0;
        let _ = writeln!(
            text,
            "<g id=\"{}\" fill=\"none\" stroke=\"#{red:02x}{green:02x}{blue:02x}\" stroke-width=\"{LINE_MM}\">",
            layer.name
        );
        for outline in &layer.outlines {
            let _ = writeln!(text, "<path d=\"{}\"/>", path(outline, sheet.size_m[1]));
        }
        text += "</g>\n";
    }
    text += "<g id=\"LABELS\" fill=\"#000\" font-family=\"'DejaVu Sans', Verdana, sans-serif\">\n";
    for label in &sheet.labels {
        let [x, y] = [label.at_m[0], sheet.size_m[1] - label.at_m[1]].map(mm);
        let size = mm(label.height_m / CAPITALS);
        let _ = writeln!(text, "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\">{}</text>", escaped(&label.text));
    }
    text + "</g>\n</svg>\n"
}

fn path(outline: &Outline, height_m: f64) -> String {
    match outline {
        Outline::Polygon(corners) => {
            let corner = |&[x, y]: &[f64; 2]| format!("{},{}", mm(x), mm(height_m - y));
            format!("M{}Z", corners.iter().map(corner).collect::<Vec<_>>().join("L"))
        }
        &Outline::Circle { centre_m: [x, y], radius_m } => {
            let [left, right, y, r] = [x - radius_m, x + radius_m, height_m - y, radius_m].map(mm);
            format!("M{left},{y}A{r},{r} 0 0 0 {right},{y}A{r},{r} 0 0 0 {left},{y}Z")
        }
    }
}
