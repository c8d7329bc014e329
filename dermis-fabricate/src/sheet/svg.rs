//! SVG with its size and its coordinates in mm, y down.

use crate::outline::Outline;
use crate::sheet::{FURNITURE, Label, Layer, Sheet, mm};
use dermis::geom::vector::bounding_box;
use dermis::text::escaped;

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
        let style =
            format!("id=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{LINE_MM}\"", layer.name, colour(layer));
        text += &group(&style, outlines(sheet, layer));
    }
    let labels = sheet.labels.iter().map(|label| written(sheet, label, &mm(label.height_m / CAPITALS)));
    text + &group(&format!("id=\"LABELS\" fill=\"#000\" {FONT}"), labels) + "</svg>\n"
}

const FONT: &str = "font-family=\"'DejaVu Sans', Verdana, sans-serif\"";

fn group(style: &str, lines: impl Iterator<Item = String>) -> String {
    format!("<g {style}>\n{}</g>\n", lines.collect::<String>())
}

fn colour(layer: &Layer) -> String {
    let [red, green, blue] = layer.colour.0;
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn outlines(sheet: &Sheet, layer: &Layer) -> impl Iterator<Item = String> {
    layer.outlines.iter().map(move |outline| format!("<path d=\"{}\"/>\n", path(outline, sheet.size_m[1])))
}

fn written(sheet: &Sheet, label: &Label, size: &str) -> String {
    let [x, y] = [label.at_m[0], sheet.size_m[1] - label.at_m[1]].map(mm);
    let anchor = if label.ends { " text-anchor=\"end\"" } else { "" };
    format!("<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\"{anchor}>{}</text>\n", escaped(&label.text))
}

/// Smallest capitals that are read on paper, mm, and most labels that are enlarged to them.
const READABLE_MM: f64 = 2.2;
const MAX_ENLARGED: usize = 120;

/// The drawing of a sheet alone, for a page, as large as a box (width and height on paper, mm) allows. Labels that would be
/// too small are enlarged, or left out where there are many.
pub(crate) fn figure(sheet: &Sheet, box_mm: [f64; 2]) -> String {
    let layers: Vec<&Layer> = sheet.layers.iter().filter(|layer| !FURNITURE.contains(&layer.name)).collect();
    let [low, high] = bounding_box(layers.iter().flat_map(|layer| &layer.outlines).flat_map(Outline::bounds_m));
    let (width, height) = (1e3 * (high[0] - low[0]), 1e3 * (high[1] - low[1]));
    let scale = (box_mm[0] / width).min(box_mm[1] / height);
    let inside = |label: &&Label| label.at_m[1] >= low[1] && label.at_m[1] <= high[1] && label.at_m[0] <= high[0];
    let labels: Vec<&Label> = sheet.labels.iter().filter(inside).collect();
    let usual_mm = 1e3 * labels.iter().map(|label| label.height_m).fold(f64::MIN_POSITIVE, f64::max);
    let factor = (READABLE_MM / (scale * usual_mm)).max(1.0);
    let shown = factor == 1.0 || labels.len() <= MAX_ENLARGED;
    let line = 0.25 / scale;
    // Room for labels that are enlarged beyond the edges.
    let boxes = labels.iter().filter(|_| shown).flat_map(|label| label.bounds_m(factor));
    let [from, to] = bounding_box(boxes.chain([low, high]));
    let margin = 1.0 / scale;
    let (left, top) = (1e3 * from[0] - margin, 1e3 * (sheet.size_m[1] - to[1]) - margin);
    let (wide, tall) = (1e3 * (to[0] - from[0]) + 2.0 * margin, 1e3 * (to[1] - from[1]) + 2.0 * margin);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{:.1}mm\" viewBox=\"{left:.3} {top:.3} {wide:.3} {tall:.3}\" \
         role=\"img\">\n<title>{}</title>\n",
        (wide * scale).min(box_mm[0]),
        escaped(&sheet.purpose)
    );
    for layer in layers {
        let (colour, opacity) = (colour(layer), if layer.outlines.len() > 1 { 0.15 } else { 0.04 });
        let style =
            format!("fill=\"{colour}\" fill-opacity=\"{opacity}\" stroke=\"{colour}\" stroke-width=\"{line:.3}\"");
        text += &group(&style, outlines(sheet, layer));
    }
    let size = |label: &Label| format!("{:.3}", factor * 1e3 * label.height_m / CAPITALS);
    let labels = labels.into_iter().filter(|_| shown).map(|label| written(sheet, label, &size(label)));
    text + &group(&format!("fill=\"#1c2330\" {FONT}"), labels) + "</svg>\n"
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
