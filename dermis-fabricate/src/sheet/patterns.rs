//! What is on each sheet.

use crate::model::{FabricatedElectrode, Fabrication};
use crate::outline::Outline;
use crate::sheet::{Label, Layer, Sheet};
use dermis::design::{Body, ElectrodeShape, FabricationOptions, RegionPlace};
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

fn label(at_m: Point2, height_m: f64, text: &str) -> Label {
    Label { at_m, height_m, text: text.into() }
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
        labels.push(label([left + 0.2 * (right - left), 0.5 * (low + high)], height_m, &patch.label));
        outlines.push(outline.grown(0.5 * options.kerf_m));
    }
    let layer = Layer { name: "PATCHES", colour: RED, outlines };
    sheet(fabrication, "patches", "fabric patches to cut", vec![layer], labels)
}

/// The foam: the coat, and on a cylinder the overlap beyond the seam. Glued flat to the patches, its inner face has the
/// length of the coat.
fn foam(fabrication: &Fabrication, coat: &Outline) -> Sheet {
    let outline = with_overlap(fabrication, coat, 0.0).grown(0.5 * fabrication.options.kerf_m);
    let layer = Layer { name: "FOAM", colour: BLUE, outlines: vec![outline] };
    let purpose = format!("foam to cut, {} mm thick", 1e3 * fabrication.options.foam_thickness_m);
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
    let (mut pads, mut labels) = (Vec::new(), Vec::new());
    for electrode in &fabrication.electrodes {
        for pad in pads_of(electrode, chart, coat, &fabrication.options) {
            let [low, high] = pad.bounds_m();
            labels.push(label([high[0] + 0.001, 0.5 * (low[1] + high[1])], 0.002, &electrode.label));
            pads.push(pad.grown(-half_m));
        }
    }
    let mut layers = vec![Layer { name: "COAT", colour: RED, outlines: vec![coat.grown(-half_m)] }];
    layers.extend((!pads.is_empty()).then_some(Layer { name: "PADS", colour: GREEN, outlines: pads }));
    let regions = regions(fabrication, chart, coat);
    layers.extend((!regions.is_empty()).then_some(Layer { name: "REGIONS", colour: MAGENTA, outlines: regions }));
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

/// Boxes of another conductance, as (z, s) on a cylinder and (x, y) on a flat body.
fn regions(fabrication: &Fabrication, chart: &Chart, coat: &Outline) -> Vec<Outline> {
    let mut outlines = Vec::new();
    for region in &fabrication.design.sheet.regions {
        let RegionPlace::Box { low_m, high_m } = region.place else { continue };
        match chart.period_m() {
            Some(period_m) => {
                let whole = Outline::rectangle([low_m[1], low_m[0]], [high_m[1], high_m[0]]);
                let copies = (-2..=2).map(|turn| whole.moved([f64::from(turn) * period_m, 0.0]));
                outlines.extend(copies.filter_map(|copy| copy.clipped(coat)));
            }
            None => outlines.extend(Outline::rectangle(low_m, high_m).clipped(coat)),
        }
    }
    outlines
}

/// The wire channels on the inner side, as far as the template goes: from each bore to the lower edge.
fn channels(fabrication: &Fabrication, chart: &Chart, template: &Outline) -> Vec<Outline> {
    let options = &fabrication.options;
    if options.channel_depth_m == 0.0 {
        return Vec::new();
    }
    let half_m = 0.5 * options.channel_width_m;
    let low_m = template.bounds_m()[0][1];
    let places = fabrication.electrodes.iter().flat_map(|one| places_within(chart, one.bore.centre_m, half_m));
    let band = |[s, t]: Point2| Outline::rectangle([s - half_m, low_m], [s + half_m, t]).clipped(template);
    places.filter_map(band).collect()
}

/// The drill template: a print that is laid round the base; lines are drawn where they are, without the kerf.
fn template(fabrication: &Fabrication, chart: &Chart, coat: &Outline) -> Sheet {
    let options = &fabrication.options;
    let outline = with_overlap(fabrication, coat, options.flange_m);
    let [[low_m, _], _] = coat.bounds_m();
    let (mut bores, mut labels) = (Vec::new(), Vec::new());
    for electrode in &fabrication.electrodes {
        let radius_m = 0.5 * electrode.bore.diameter_m;
        let overlap_m = if chart.period_m().is_some() { options.overlap_m } else { 0.0 };
        for centre_m in places_within(chart, electrode.bore.centre_m, radius_m.max(overlap_m)) {
            if centre_m[0] < low_m - radius_m && chart.period_m().is_some() {
                continue;
            }
            labels.push(label([centre_m[0] + radius_m + 0.001, centre_m[1] - 0.001], 0.0025, &electrode.label));
            bores.push(Outline::Circle { centre_m, radius_m });
        }
    }
    let channels = channels(fabrication, chart, &outline);
    let mut layers = vec![Layer { name: "TEMPLATE", colour: BLUE, outlines: vec![outline] }];
    layers.extend((!channels.is_empty()).then_some(Layer { name: "CHANNELS", colour: GREY, outlines: channels }));
    layers.push(Layer { name: "DRILL", colour: RED, outlines: bores });
    sheet(fabrication, "drill-template", "drill template to print at 100 %", layers, labels)
}
