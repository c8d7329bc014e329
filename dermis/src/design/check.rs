//! Checks that a design can be built: sizes, positions, overlaps.

use crate::design::layout::{MAX_ELECTRODES, name};
use crate::design::resolve::Place;
use crate::design::{Body, Electrode, ElectrodeShape, ImageLayout, RegionPlace, Sheet, SheetKind, SkinDesign};
use crate::geom::{Chart, Edge};
use crate::text::decimal;
use std::f64::consts::PI;

/// The errors of a design, and their places.
pub(super) struct Problem {
    pub place: Place,
    pub message: String,
    pub fix: Option<String>,
}

pub(super) fn problem(place: Place, message: impl Into<String>) -> Problem {
    Problem { place, message: message.into(), fix: None }
}

impl Problem {
    pub(super) fn fix(mut self, fix: impl Into<String>) -> Self {
        self.fix = Some(fix.into());
        self
    }
}

/// Sizes outside these limits are in another unit than metres: no skin is 0.1 mm or 20 m across.
pub(super) const SMALLEST_BODY_M: f64 = 1e-4;
pub(crate) const LARGEST_BODY_M: f64 = 20.0;

/// Smallest electrode, and shortest edges of a mesh, m: a mesh grows without limit towards smaller ones.
const SMALLEST_ELECTRODE_M: f64 = 1e-5;
const SHORTEST_EDGE_M: f64 = 1e-6;

/// The resistance of a contact over the sheet resistance: smaller and larger ones cost more digits than voltages need, since the
/// error of a solution by factors grows with the contrast of what is summed at an electrode.
const CONTACT_RATIOS: [f64; 2] = [1e-9, 1e6];

/// Largest conductance of a region over that of the sheet, and of the sheet over that of a region, for the same reason.
const LARGEST_CONTRAST: f64 = 1e6;

/// Maximum number of pixels of an image: a thousand times that of the paper.
const MAX_PIXELS: usize = 1_000_000;

/// Maximum number of cells of a mesh.
const MAX_CELLS: f64 = 1e7;

/// Parts of an arc whose distance from another electrode is computed.
const ARC_PARTS: u32 = 256;

/// Distance from an edge, relative to the body, that counts as rounding error.
const ROUNDING: f64 = 1e-9;

/// All checks that need no mesh.
pub(super) fn check(design: &SkinDesign) -> Result<(), Problem> {
    body(&design.body)?;
    sheet(design)?;
    let count = design.electrodes.len();
    if !(4..=MAX_ELECTRODES).contains(&count) {
        return Err(problem(Place::Electrodes, format!("{count} electrodes, but a skin has 4 to {MAX_ELECTRODES}")));
    }
    for (index, one) in design.electrodes.iter().enumerate() {
        electrode(design, index, one)?;
    }
    overlaps(&design.body, &design.electrodes)?;
    if design.protocol.electrode_count() != count {
        let message = format!("the protocol is for {} electrodes, not {count}", design.protocol.electrode_count());
        return Err(problem(Place::Protocol, message));
    }
    image(design)?;
    mesh(design)
}

/// Checks the size of the body.
pub(super) fn body(body: &Body) -> Result<(), Problem> {
    let sizes: &[(&str, f64)] = match *body {
        Body::Cylinder { length_m, diameter_m } => &[("length_m", length_m), ("diameter_m", diameter_m)],
        Body::Disk { diameter_m } => &[("diameter_m", diameter_m)],
        Body::Rectangle { width_m, height_m } => &[("width_m", width_m), ("height_m", height_m)],
        Body::Mesh { unit_m, .. } if unit_m > 0.0 && unit_m.is_finite() => return Ok(()),
        Body::Mesh { unit_m, .. } => {
            let message = format!("unit_m is {unit_m}: it must be positive and finite");
            return Err(problem(Place::Body, message).fix("metres per unit of the file: 0.001 for millimetres"));
        }
    };
    for &(key, size_m) in sizes {
        if !(size_m > 0.0 && size_m.is_finite()) {
            return Err(problem(Place::Body, format!("{key} is {size_m}: it must be positive and finite")));
        }
        if size_m > LARGEST_BODY_M {
            let message = format!("{key} is {size_m} m, more than any skin: lengths are in metres");
            return Err(problem(Place::Body, message).fix(format!("for {size_m} mm write {}", size_m / 1000.0)));
        }
        if size_m < SMALLEST_BODY_M {
            let message = format!("{key} is {size_m} m, less than any skin: lengths are in metres");
            return Err(problem(Place::Body, message));
        }
    }
    Ok(())
}

fn sheet(design: &SkinDesign) -> Result<(), Problem> {
    let positive = |value: f64| value > 0.0 && value.is_finite();
    if !positive(design.sheet.conductance) {
        let message =
            format!("the sheet's conductance is {}: it must be positive and finite", design.sheet.conductance);
        return Err(problem(Place::Sheet, message));
    }
    for (index, region) in design.sheet.regions.iter().enumerate() {
        let wrong = |message: String| problem(Place::Region(index), format!("region `{}`: {message}", region.name));
        if !positive(region.conductance) {
            return Err(wrong(format!("the conductance is {}: it must be positive and finite", region.conductance)));
        }
        let ratio = region.conductance / design.sheet.conductance;
        if !(1.0 / LARGEST_CONTRAST..=LARGEST_CONTRAST).contains(&ratio) {
            let message =
                format!("it conducts {ratio:.0e} times as well as the sheet, more contrast than can be computed");
            let fix = format!("{LARGEST_CONTRAST:.0e} is as good as an insulator or a perfect conductor");
            return Err(wrong(message).fix(fix));
        }
        match (&region.place, &design.body) {
            (RegionPlace::Box { .. }, Body::Mesh { .. }) => {
                return Err(wrong("a box needs a cylinder, a disk or a rectangle".into())
                    .fix("name a physical group of the mesh file and leave the box out"));
            }
            (RegionPlace::Box { low_m, high_m }, _) => {
                let ordered = (0..2).all(|axis| low_m[axis] < high_m[axis] && (high_m[axis] - low_m[axis]).is_finite());
                if !ordered {
                    return Err(wrong(format!("low_m {low_m:?} must lie below high_m {high_m:?} on both axes")));
                }
            }
            (RegionPlace::Group, Body::Mesh { .. }) => {}
            (RegionPlace::Group, body) => {
                return Err(wrong(format!("{} has no groups", name(body))).fix("give `low_m` and `high_m`"));
            }
        }
    }
    Ok(())
}

/// Checks one electrode: its size, its place, its contact impedance.
fn electrode(SkinDesign { body, sheet, .. }: &SkinDesign, index: usize, electrode: &Electrode) -> Result<(), Problem> {
    let wrong = |message: String| problem(Place::Electrode(index), format!("electrode {index} {message}"));
    let wrong_shape = |message: String| problem(Place::Shape(index), format!("electrode {index} {message}"));
    let Electrode { centre_m, shape, contact_impedance } = *electrode;
    if shape == ElectrodeShape::Group {
        return impedance(index, contact_impedance, None);
    }
    if centre_m.iter().any(|coordinate| !coordinate.is_finite()) {
        return Err(wrong(format!("is at {centre_m:?}: its place must be finite")));
    }
    let (size_key, size_m) = match shape {
        ElectrodeShape::Disc { radius_m } => ("radius_m", radius_m),
        ElectrodeShape::Arc { length_m } => ("length_m", length_m),
        ElectrodeShape::Point | ElectrodeShape::Group => ("", 1.0),
    };
    if !(size_m > 0.0 && size_m.is_finite()) {
        return Err(wrong_shape(format!("has {size_key} = {size_m}: it must be positive and finite")));
    }
    if size_m < SMALLEST_ELECTRODE_M {
        let message = format!("has {size_key} = {size_m} m: it must be at least {SMALLEST_ELECTRODE_M} m");
        return Err(wrong_shape(message).fix("lengths are in metres"));
    }
    if let Some((where_it_is, limits)) = off_body(body, centre_m) {
        return Err(wrong(format!("leaves the body: its centre is at {where_it_is}, but the body {limits}"))
            .fix("only an outline may cross an edge, where it is clipped"));
    }
    match shape {
        ElectrodeShape::Disc { radius_m } => {
            let room_m =
                body.chart().map_or(f64::INFINITY, |chart| chart.size_m().into_iter().fold(f64::INFINITY, f64::min));
            if 2.0 * radius_m >= room_m {
                let message = format!(
                    "is larger than the body: {} mm across on a body of {} mm",
                    millimetres(2.0 * radius_m),
                    millimetres(room_m)
                );
                return Err(wrong_shape(message).fix("radius_m is in metres"));
            }
        }
        ElectrodeShape::Arc { length_m } => arc(body, index, electrode, length_m)?,
        ElectrodeShape::Point | ElectrodeShape::Group => return Ok(()),
    }
    impedance(index, contact_impedance, contact_ratio(sheet, electrode))
}

/// The resistance of an electrode's contact over the sheet resistance; `None` where the size of the electrode is not known.
fn contact_ratio(sheet: &Sheet, electrode: &Electrode) -> Option<f64> {
    let size = match electrode.shape {
        ElectrodeShape::Disc { radius_m } => PI * radius_m * radius_m,
        ElectrodeShape::Arc { length_m } => length_m,
        ElectrodeShape::Point | ElectrodeShape::Group => return None,
    };
    (sheet.kind == SheetKind::Surface).then_some(electrode.contact_impedance * sheet.conductance / size)
}

fn impedance(index: usize, value: f64, ratio: Option<f64>) -> Result<(), Problem> {
    let wrong = |message: String| {
        problem(Place::ContactImpedance, format!("the contact impedance of electrode {index} is {value}: {message}"))
    };
    if !(value > 0.0 && value.is_finite()) {
        return Err(wrong("it must be positive and finite".into()));
    }
    let [least, most] = CONTACT_RATIOS;
    match ratio.filter(|ratio| !(least..=most).contains(ratio)) {
        None => Ok(()),
        Some(ratio) => {
            let message = format!(
                "its contact has {ratio:.0e} of the sheet resistance, and {least:.0e} to {most:.0e} can be computed"
            );
            let fix = match ratio < least {
                true => format!("{:.0e} is as good as a perfect contact", 10.0 * value * least / ratio),
                false => "leave an electrode without contact out of the protocol".into(),
            };
            Err(wrong(message).fix(fix))
        }
    }
}

/// Checks that an arc is on an edge and shorter than it.
fn arc(body: &Body, index: usize, electrode: &Electrode, length_m: f64) -> Result<(), Problem> {
    let wrong = |message: String| problem(Place::Shape(index), format!("electrode {index} {message}"));
    let Some(chart) = body.chart() else {
        return Err(wrong("is an arc, which a mesh file or a polygon cannot hold".into())
            .fix("use a disc or a point, or groups of edges in the file"));
    };
    let rounding_m = rounding_m(&chart);
    let centre = chart.unroll(electrode.centre_m);
    let edges = Edge::all(&chart);
    let off_m = edges.iter().map(|edge| edge.nearest(centre).1).fold(f64::INFINITY, f64::min);
    let edge_m = edges.iter().map(|edge| edge.length).fold(0.0, f64::max);
    if off_m > rounding_m {
        let message = format!("is an arc, but its centre is {} mm from the edge of the body", millimetres(off_m));
        let fix = "an arc is part of the edge: move its centre there, or make the electrode a disc";
        return Err(wrong(message).fix(fix));
    }
    if length_m >= edge_m {
        let message = format!("is {} mm long on an edge of {} mm", millimetres(length_m), millimetres(edge_m));
        return Err(wrong(message).fix("length_m is in metres"));
    }
    Ok(())
}

/// Distance from an edge that counts as rounding error, m.
pub(super) fn rounding_m(chart: &Chart) -> f64 {
    let [width_m, height_m] = chart.size_m();
    // A centre on a cylinder's rim is exactly there.
    if chart.period_m().is_some() { 0.0 } else { ROUNDING * width_m.max(height_m) }
}

/// The centre and the body's limits, if the centre is off the body.
fn off_body(body: &Body, [x, y, z]: [f64; 3]) -> Option<(String, String)> {
    let beyond = |value: f64, high: f64| value < -ROUNDING * high || value > high * (1.0 + ROUNDING);
    match *body {
        Body::Cylinder { length_m, diameter_m } => {
            let off_wall = (x.hypot(y) - 0.5 * diameter_m).abs() > 1e-6 * diameter_m;
            (off_wall || beyond(z, length_m))
                .then(|| (format!("z_m = {z}"), format!("reaches from z_m = 0 to {length_m}")))
        }
        Body::Disk { diameter_m } => beyond(x.hypot(y), 0.5 * diameter_m)
            .then(|| (format!("({x}, {y})"), format!("reaches {} m from its middle", 0.5 * diameter_m))),
        Body::Rectangle { width_m, height_m } => (beyond(x, width_m) || beyond(y, height_m))
            .then(|| (format!("({x}, {y})"), format!("reaches from (0, 0) to ({width_m}, {height_m})"))),
        Body::Mesh { .. } => None,
    }
}

fn overlaps(body: &Body, electrodes: &[Electrode]) -> Result<(), Problem> {
    for (j, b) in electrodes.iter().enumerate() {
        for (i, a) in electrodes[..j].iter().enumerate() {
            let (what, apart_m, needed_m) = apart_m(body, a, b);
            // Rounding may leave a tiny gap between two electrodes that touch; no mesh fits into it.
            if apart_m <= (needed_m + SMALLEST_ELECTRODE_M * ROUNDING) * (1.0 + ROUNDING) {
                let message = format!(
                    "electrodes {i} and {j} overlap: {what} {} mm apart, and they reach {} mm",
                    millimetres(apart_m),
                    millimetres(needed_m)
                );
                return Err(problem(Place::Electrode(j), message).fix("move them apart or make them smaller"));
            }
        }
    }
    Ok(())
}

/// Half of an electrode's extent.
fn reach_m(shape: ElectrodeShape) -> f64 {
    match shape {
        ElectrodeShape::Disc { radius_m } => radius_m,
        ElectrodeShape::Arc { length_m } => 0.5 * length_m,
        ElectrodeShape::Point | ElectrodeShape::Group => 0.0,
    }
}

/// The distance of two electrodes, and how far they reach in its direction: between two arcs of a flat skin along its edge, from
/// another electrode to the nearest point of an arc, else between centres along the surface. Groups have no known place, so their
/// distance is `NaN`, which never counts as overlap.
fn apart_m(body: &Body, a: &Electrode, b: &Electrode) -> (&'static str, f64, f64) {
    let of_centres = |apart_m: f64| ("their centres are", apart_m, reach_m(a.shape) + reach_m(b.shape));
    let between_centres = || of_centres(body.surface().distance_m(a.centre_m, b.centre_m));
    let Some(chart) = body.chart() else { return between_centres() };
    let edges = Edge::all(&chart);
    // The edge that a point is on, and the place on it.
    let on_edge = |electrode: &Electrode| {
        let place = chart.unroll(electrode.centre_m);
        edges.iter().map(|edge| (edge, edge.nearest(place))).min_by(|a, b| a.1.1.total_cmp(&b.1.1))
    };
    let (arc, half_m, other) = match (a.shape, b.shape) {
        (ElectrodeShape::Arc { .. }, ElectrodeShape::Arc { .. }) => match (on_edge(a), on_edge(b)) {
            (Some((edge, (from, _))), Some((_, (to, _)))) if edges.len() == 1 => {
                return of_centres(edge.arc_m(from, to));
            }
            _ => return between_centres(),
        },
        (ElectrodeShape::Arc { length_m }, _) => (a, 0.5 * length_m, b),
        (_, ElectrodeShape::Arc { length_m }) => (b, 0.5 * length_m, a),
        _ => return between_centres(),
    };
    let Some((edge, (middle, _))) = on_edge(arc) else { return between_centres() };
    let place = chart.unroll(other.centre_m);
    let part = |k: u32| middle + half_m * (f64::from(2 * k) / f64::from(ARC_PARTS) - 1.0);
    let to_parts_m =
        (0..=ARC_PARTS).map(|k| chart.distance_m(place, edge.point(part(k)))).fold(f64::INFINITY, f64::min);
    let (nearest, off_m) = edge.nearest(place);
    let apart_m = if edge.arc_m(middle, nearest) <= half_m { off_m.min(to_parts_m) } else { to_parts_m };
    ("the arc and the centre of the other are", apart_m, reach_m(other.shape))
}

fn image(design: &SkinDesign) -> Result<(), Problem> {
    let ImageLayout::Grid { rows, columns } = design.image else { return Ok(()) };
    if matches!(design.body, Body::Mesh { .. }) {
        let message = "a mesh file has no grid of pixels";
        return Err(problem(Place::Image, message).fix("write `image = \"cells\"` above the first table"));
    }
    if rows == 0 || columns == 0 || rows.saturating_mul(columns) > MAX_PIXELS {
        let message = format!("an image of {rows} x {columns} pixels: it has 1 to {MAX_PIXELS}");
        return Err(problem(Place::Image, message));
    }
    if matches!(design.body, Body::Disk { .. }) && rows != columns {
        let message = format!("an image of {rows} x {columns} pixels: a disk's grid is square");
        return Err(problem(Place::Image, message).fix("make rows and columns equal"));
    }
    Ok(())
}

fn mesh(design: &SkinDesign) -> Result<(), Problem> {
    if matches!(design.body, Body::Mesh { .. }) {
        return Ok(());
    }
    let options = design.mesh;
    for (key, value) in
        [("max_edge_m", options.max_edge_m), ("electrode_edge_m", options.electrode_edge_m), ("growth", options.growth)]
    {
        if !(value > 0.0 && value.is_finite()) {
            return Err(problem(Place::Mesh, format!("{key} is {value}: it must be positive and finite")));
        }
    }
    if options.electrode_edge_m > options.max_edge_m {
        let message = format!(
            "electrode_edge_m ({}) is longer than max_edge_m ({})",
            options.electrode_edge_m, options.max_edge_m
        );
        return Err(problem(Place::Mesh, message));
    }
    for (key, edge_m) in [("max_edge_m", options.max_edge_m), ("electrode_edge_m", options.electrode_edge_m)] {
        if edge_m < SHORTEST_EDGE_M {
            let message = format!("{key} is {edge_m} m: it must be at least {SHORTEST_EDGE_M} m");
            return Err(problem(Place::Mesh, message).fix("lengths are in metres"));
        }
    }
    let cells = cell_estimate(design);
    if cells > MAX_CELLS {
        let message = format!("a mesh this fine would have about {cells:.0e} cells, more than {MAX_CELLS:.0e}");
        return Err(problem(Place::Mesh, message).fix("lengths are in metres; make the edges longer"));
    }
    Ok(())
}

/// Approximate number of cells of the mesh: the body with its longest edges, the electrodes with theirs.
fn cell_estimate(design: &SkinDesign) -> f64 {
    let area_m2 = design.body.chart().map_or(0.0, |chart| chart.area_m2());
    let fine_m2: f64 = design.electrodes.iter().map(|electrode| PI * reach_m(electrode.shape).powi(2)).sum();
    // An equilateral triangle of side h has the area sqrt(3)/4 h^2.
    let per_area = |edge_m: f64| 1.0 / (0.433 * edge_m * edge_m);
    area_m2 * per_area(design.mesh.max_edge_m) + fine_m2 * per_area(design.mesh.electrode_edge_m)
}

/// A length in mm for messages.
pub(super) fn millimetres(length_m: f64) -> String {
    decimal(1e3 * length_m, 3)
}
