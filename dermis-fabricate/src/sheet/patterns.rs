//! What is on each sheet.

use crate::grooves::grooves;
use crate::model::{FabricatedElectrode, Fabrication};
use crate::outline::Outline;
use crate::sheet::{Label, Layer, Sheet};
use dermis::design::{Body, ElectrodeShape, FabricationOptions, Region, RegionPlace};
use dermis::geom::{Chart, Point2, Point3};
use std::f64::consts::PI;

const RED: ([u8; 3], u8) = ([220, 0, 0], 1);
const GREEN: ([u8; 3], u8) = ([0, 130, 0], 3);
const BLUE: ([u8; 3], u8) = ([0, 0, 220], 5);
const GREY: ([u8; 3], u8) = ([140, 140, 140], 8);
const MAGENTA: ([u8; 3], u8) = ([190, 0, 190], 6);

/// All sheets of a fabrication. A body from a mesh file does not unroll: it has the sheet of its patches alone.
pub(crate) fn sheets(fabrication: &Fabrication) -> Vec<Sheet> {
    let mut sheets = vec![patches(fabrication)];
    if let (Some(chart), Some(coat)) = (&fabrication.chart, &fabrication.coat) {
        sheets.extend([
            foam(fabrication, coat),
            coat_mask(fabrication, chart, coat),
            template(fabrication, chart, coat),
        ]);
    }
    sheets
}

fn sheet(
    fabrication: &Fabrication,
    name: &'static str,
    purpose: &str,
    layers: Vec<Layer>,
    labels: Vec<Label>,
) -> Sheet {
    let title = format!("{}: {purpose}, outer side up", fabrication.design.name);
    Sheet::new(name, purpose.into(), title, layers, labels, fabrication.options.kerf_m)
}

/// Distance of a label from its part, m.
const BESIDE_M: f64 = 0.001;

/// Height of the labels of parts, m: for a drawing of a page's width, and no more than leaves room beside neighbours.
fn label_height_m(parts: &[(Outline, &str)], outline: &Outline) -> f64 {
    let [low, high] = outline.bounds_m();
    let middles: Vec<Point2> = parts
        .iter()
        .map(|(part, _)| {
            let [low, high] = part.bounds_m();
            [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])]
        })
        .collect();
    let apart = |(k, a): (usize, &Point2)| {
        middles[..k].iter().map(|b| (a[0] - b[0]).hypot(a[1] - b[1])).fold(f64::INFINITY, f64::min)
    };
    let nearest_m = middles.iter().enumerate().map(apart).fold(f64::INFINITY, f64::min);
    let wanted_m = (high[0] - low[0]).max(high[1] - low[1]) / 50.0;
    wanted_m.min(0.2 * nearest_m).max(0.0015)
}

/// Labels of parts beside them, where they are inside an outline and on no other part if there is such a place: to the
/// right, to the left, above, or below.
fn beside(parts: &[(Outline, &str)], outline: &Outline) -> Vec<Label> {
    let height_m = label_height_m(parts, outline);
    let boxes: Vec<[Point2; 2]> = parts.iter().map(|(part, _)| part.bounds_m()).collect();
    let is_inside = |label: &Label| {
        let [[x0, y0], [x1, y1]] = label.bounds_m(1.0);
        [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].into_iter().all(|corner| outline.contains(corner))
    };
    let is_free = |label: &Label| {
        let [low, high] = label.bounds_m(1.0);
        let meets = |[l, h]: &[Point2; 2]| (0..2).all(|axis| l[axis] < high[axis] && low[axis] < h[axis]);
        !boxes.iter().any(meets)
    };
    let place = |((_, text), [low, high]): (&(Outline, &str), &[Point2; 2])| {
        let middle = [0, 1].map(|axis| 0.5 * (low[axis] + high[axis]));
        let own = Label::new([high[0] + BESIDE_M, middle[1] - 0.5 * height_m], height_m, text);
        let half_m = 0.5 * (own.bounds_m(1.0)[1][0] - own.at_m[0]);
        let choices = [
            own.clone(),
            Label { at_m: [low[0] - BESIDE_M, own.at_m[1]], ends: true, ..own.clone() },
            Label { at_m: [middle[0] - half_m, high[1] + BESIDE_M], ..own.clone() },
            Label { at_m: [middle[0] - half_m, low[1] - BESIDE_M - height_m], ..own.clone() },
        ];
        let best = choices.iter().find(|label| is_inside(label) && is_free(label));
        best.or_else(|| choices.iter().find(|label| is_inside(label))).unwrap_or(&own).clone()
    };
    parts.iter().zip(&boxes).map(place).collect()
}

fn patches_purpose(fabrication: &Fabrication) -> &'static str {
    match fabrication.has_membrane() {
        true => "not used: this coat gets no fabric patches",
        false => "fabric patches to cut",
    }
}

/// The patches: side by side as they lie on the coat, or in rows where each is laid on by itself. Cut outside their
/// outlines.
fn patches(fabrication: &Fabrication) -> Sheet {
    let options = &fabrication.options;
    let in_place = fabrication.chart.is_some();
    let per_row = (fabrication.patches.len() as f64).sqrt().ceil() as usize;
    let place = |number: usize| match in_place {
        true => [0.0; 2],
        false => [number % per_row, number / per_row].map(|step| step as f64 * options.patch_pitch_m),
    };
    let (mut outlines, mut labels) = (Vec::new(), Vec::new());
    for (number, patch) in fabrication.patches.iter().enumerate() {
        let outline = patch.outline.moved(place(number));
        let [[left, _], [right, _]] = outline.bounds_m();
        let [[_, low], [_, high]] = outline.bounds_m();
        let height_m = (0.12 * (right - left)).min(0.002);
        labels.push(Label::new([left + 0.2 * (right - left), 0.5 * (low + high)], height_m, &patch.label));
        outlines.push(outline.grown(0.5 * options.kerf_m));
    }
    let layer = Layer { name: "PATCHES", colour: RED, outlines };
    sheet(fabrication, "patches", patches_purpose(fabrication), vec![layer], labels)
}

/// The foam: the coat, and on a cylinder the overlap beyond the seam. Glued flat to the patches, its inner face has the
/// length of the coat; below a membrane it lies on the base.
fn foam(fabrication: &Fabrication, coat: &Outline) -> Sheet {
    let outline = with_overlap(fabrication, coat, 0.0).grown(0.5 * fabrication.options.kerf_m);
    let layer = Layer { name: "FOAM", colour: BLUE, outlines: vec![outline] };
    let place = if fabrication.has_membrane() { ", below the membrane" } else { "" };
    let purpose = format!("foam to cut, {} mm thick{place}", 1e3 * fabrication.options.foam_thickness_m);
    sheet(fabrication, "foam", &purpose, vec![layer], Vec::new())
}

/// The unrolled coat, on a cylinder with the overlap, and beyond the edges of the coat with a flange.
fn with_overlap(fabrication: &Fabrication, coat: &Outline, flange_m: f64) -> Outline {
    let [[x0, y0], [x1, y1]] = coat.bounds_m();
    match fabrication.design.body {
        Body::Cylinder { .. } => {
            Outline::rectangle([x0, y0 - flange_m], [x1 + fabrication.options.overlap_m, y1 + flange_m])
        }
        _ => coat.grown(flange_m),
    }
}

/// The mask for spraying: the coat is sprayed through its opening; the pads are openings for silver paste. Cut inside
/// their outlines.
fn coat_mask(fabrication: &Fabrication, chart: &Chart, coat: &Outline) -> Sheet {
    let half_m = 0.5 * fabrication.options.kerf_m;
    let of = |electrode| pads_of(electrode, chart, coat, &fabrication.options);
    let named = fabrication.electrodes.iter().flat_map(|one| of(one).into_iter().map(|pad| (pad, one.label.as_str())));
    let named: Vec<(Outline, &str)> = named.collect();
    let mut labels = beside(&named, coat);
    let pads: Vec<Outline> = named.iter().map(|(pad, _)| pad.grown(-half_m)).collect();
    let mut layers = vec![Layer { name: "COAT", colour: RED, outlines: vec![coat.grown(-half_m)] }];
    layers.extend((!pads.is_empty()).then_some(Layer { name: "PADS", colour: GREEN, outlines: pads }));
    let regions = regions(fabrication, chart, coat);
    let most_m = label_height_m(&named, coat);
    labels.extend(regions.iter().flat_map(|(outline, region)| region_labels(outline, region, most_m)));
    let outlines: Vec<Outline> = regions.into_iter().map(|(outline, _)| outline).collect();
    layers.extend((!outlines.is_empty()).then_some(Layer { name: "REGIONS", colour: MAGENTA, outlines }));
    sheet(fabrication, "coat-mask", "coat and electrode pads", layers, labels)
}

/// The pads of an electrode on the unrolled coat: one, or two where the seam cuts it.
///
/// A disc is clipped at the coat's edge. An arc has no width: its pad is a strip along the edge that reaches over the
/// bore. A point has none.
fn pads_of(
    electrode: &FabricatedElectrode,
    chart: &Chart,
    coat: &Outline,
    options: &FabricationOptions,
) -> Vec<Outline> {
    match electrode.shape {
        ElectrodeShape::Disc { radius_m } => {
            let at = places_within(chart, electrode.centre_m, radius_m);
            at.filter_map(|centre_m| Outline::Circle { centre_m, radius_m }.clipped(coat)).collect()
        }
        ElectrodeShape::Arc { length_m } => {
            let width_m = options.edge_m() + 0.5 * options.bore_m;
            if let Outline::Circle { radius_m, .. } = coat {
                let [x, y] = chart.unroll(electrode.centre_m);
                return vec![ring_part(*radius_m, y.atan2(x), length_m, width_m)];
            }
            let at = places_within(chart, electrode.centre_m, 0.5 * length_m);
            at.filter_map(|centre| strip(centre, length_m, width_m, coat).clipped(coat)).collect()
        }
        ElectrodeShape::Point | ElectrodeShape::Group => Vec::new(),
    }
}

/// The place of a point in the chart with those beyond the seam, as far as a reach.
fn places_within(chart: &Chart, point_m: Point3, reach_m: f64) -> impl Iterator<Item = Point2> {
    chart.copies_within(chart.unroll(point_m), reach_m)
}

/// A strip inside a rectangle along the side on which its middle lies.
fn strip([x, y]: Point2, length_m: f64, width_m: f64, coat: &Outline) -> Outline {
    let [low, high] = coat.bounds_m();
    let near = [(y - low[1]).abs(), (y - high[1]).abs(), (x - low[0]).abs(), (x - high[0]).abs()];
    let side = (0..4).min_by(|&a, &b| near[a].total_cmp(&near[b])).expect("four sides");
    let half = match side {
        0 | 1 => [0.5 * length_m, width_m],
        _ => [width_m, 0.5 * length_m],
    };
    Outline::rectangle([x - half[0], y - half[1]], [x + half[0], y + half[1]])
}

/// The part of a ring inside a circle round the origin.
fn ring_part(radius_m: f64, middle_rad: f64, length_m: f64, width_m: f64) -> Outline {
    let half_rad = 0.5 * length_m / radius_m;
    let steps = ((crate::outline::chords(radius_m, 2e-6) as f64) * half_rad / PI).ceil().max(1.0) as usize;
    let at = |step: usize, radius_m: f64| {
        let angle = middle_rad + half_rad * (2.0 * step as f64 / steps as f64 - 1.0);
        [radius_m * angle.cos(), radius_m * angle.sin()]
    };
    let outer = (0..=steps).map(|step| at(step, radius_m));
    let inner = (0..=steps).rev().map(|step| at(step, radius_m - width_m));
    Outline::Polygon(outer.chain(inner).collect())
}

/// The name of a region and its sheet resistance in the middle of its outline, as large as its width allows.
fn region_labels(outline: &Outline, region: &Region, most_m: f64) -> [Label; 2] {
    let [[x0, y0], [x1, y1]] = outline.bounds_m();
    let lines = [format!("{:.0} ohm/sq", 1.0 / region.conductance), region.name.clone()];
    let longest = lines.iter().map(String::len).max().expect("two lines");
    let height_m = (0.9 * (x1 - x0) / longest as f64).min(most_m);
    let mut up_m = 0.5 * (y0 + y1) - 1.2 * height_m;
    lines.map(|line| {
        let label = Label::new([x0, up_m], height_m, &line);
        up_m += 1.6 * height_m;
        let wide_m = label.bounds_m(1.0)[1][0] - x0;
        Label { at_m: [0.5 * (x0 + x1 - wide_m), label.at_m[1]], ..label }
    })
}

/// Boxes of another conductance with their regions, as (z, s) on a cylinder and (x, y) on a flat body.
fn regions<'a>(fabrication: &'a Fabrication, chart: &Chart, coat: &Outline) -> Vec<(Outline, &'a Region)> {
    let mut outlines = Vec::new();
    for region in &fabrication.design.sheet.regions {
        let RegionPlace::Box { low_m, high_m } = region.place else { continue };
        match chart.period_m() {
            Some(period_m) => {
                let whole = Outline::rectangle([low_m[1], low_m[0]], [high_m[1], high_m[0]]);
                let copies = (-2..=2).map(|turn| whole.moved([f64::from(turn) * period_m, 0.0]));
                outlines.extend(copies.filter_map(|copy| Some((copy.clipped(coat)?, region))));
            }
            None => outlines.extend(Outline::rectangle(low_m, high_m).clipped(coat).map(|outline| (outline, region))),
        }
    }
    outlines
}

/// The wire channels on the inner side, as far as the template goes: from each bore to the lower edge.
fn channels(fabrication: &Fabrication, chart: &Chart, template: &Outline) -> Vec<Outline> {
    let grooves = grooves(fabrication, chart, template.bounds_m()[0][1]);
    grooves.iter().filter_map(|groove| groove.outline.clipped(template)).collect()
}

/// The drill template: a print that is laid round the base; lines are drawn where they are, without the kerf.
fn template(fabrication: &Fabrication, chart: &Chart, coat: &Outline) -> Sheet {
    let options = &fabrication.options;
    let outline = with_overlap(fabrication, coat, options.flange_m);
    let [[low_m, _], _] = coat.bounds_m();
    let mut bores: Vec<(Outline, &str)> = Vec::new();
    for electrode in &fabrication.electrodes {
        let radius_m = 0.5 * electrode.bore.diameter_m;
        let overlap_m = if chart.period_m().is_some() { options.overlap_m } else { 0.0 };
        for centre_m in places_within(chart, electrode.bore.centre_m, radius_m.max(overlap_m)) {
            if centre_m[0] < low_m - radius_m && chart.period_m().is_some() {
                continue;
            }
            bores.push((Outline::Circle { centre_m, radius_m }, &electrode.label));
        }
    }
    let labels = beside(&bores, &outline);
    let bores = bores.into_iter().map(|(bore, _)| bore).collect();
    let channels = channels(fabrication, chart, &outline);
    let mut layers = vec![Layer { name: "TEMPLATE", colour: BLUE, outlines: vec![outline] }];
    layers.extend((!channels.is_empty()).then_some(Layer { name: "CHANNELS", colour: GREY, outlines: channels }));
    layers.push(Layer { name: "DRILL", colour: RED, outlines: bores });
    sheet(fabrication, "drill-template", "drill template to print at 100 %", layers, labels)
}
