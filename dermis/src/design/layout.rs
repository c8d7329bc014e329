//! The electrode positions of a layout.

use crate::design::error::DesignError;
use crate::design::file::{At, Corner, ElectrodesTable, LayoutTable, PositionTable};
use crate::design::resolve::Source;
use crate::design::{Body, ElectrodeShape, rim};
use crate::geom::Point3;
use std::f64::consts::TAU;
use std::ops::Range;

/// Maximum number of electrodes of a skin: the adjacent protocol then has a million values.
pub const MAX_ELECTRODES: usize = 1024;

type Places = Vec<(Point3, ElectrodeShape)>;

/// The centre and the shape of every electrode.
pub(super) fn places(source: &Source<'_>, body: &Body, table: &ElectrodesTable) -> Result<Places, DesignError> {
    let span = &table.layout.span;
    let shape = ElectrodeShape::from(table.shape.value);
    count_fits(source, span, &table.layout.value)?;
    let wrong_body = |layout: &str, bodies: &str| {
        let message = format!("electrodes in {layout} need {bodies}, not {}", name(body));
        source.fail(Some(span.clone()), message, Some("a list of `positions` fits every body".into()))
    };
    let optional = |at: &Option<At<f64>>| at.as_ref().map_or(0.0, |at| at.value);
    let centres = match (&table.layout.value, body) {
        (
            LayoutTable::Rings { rings, per_ring, spacing_m, first_z_m, first_theta_rad, stagger },
            &Body::Cylinder { length_m, diameter_m },
        ) => {
            let (first_z_m, first_rad, stagger) = (optional(first_z_m), optional(first_theta_rad), optional(stagger));
            let place = |index: usize| {
                let (ring, k) = (index / per_ring.value, index % per_ring.value);
                let turn = if ring % 2 == 1 { stagger } else { 0.0 };
                let theta_rad = first_rad + (k as f64 + turn) * TAU / per_ring.value as f64;
                on_cylinder(length_m, diameter_m, first_z_m + ring as f64 * spacing_m.value, theta_rad)
            };
            (0..rings.value * per_ring.value).map(place).collect()
        }
        (LayoutTable::Rings { .. }, _) => return Err(wrong_body("rings", "a cylinder")),
        (LayoutTable::Rim { .. }, &Body::Disk { .. } | &Body::Rectangle { .. }) => {
            rim_places(body, &table.layout.value)
                .map_err(|(message, fix)| source.fail(Some(span.clone()), message, fix))?
        }
        (LayoutTable::Rim { .. }, _) => return Err(wrong_body("a rim", "a disk or a rectangle")),
        (LayoutTable::Grid { rows, columns, margin_m }, &Body::Rectangle { width_m, height_m }) => {
            let margin_m = margin_m.as_ref().map(|at| at.value);
            let place = |index: usize| {
                let (row, column) = (index / columns.value, index % columns.value);
                [step(column, columns.value, width_m, margin_m), step(row, rows.value, height_m, margin_m), 0.0]
            };
            (0..rows.value * columns.value).map(place).collect()
        }
        (LayoutTable::Grid { .. }, _) => return Err(wrong_body("a grid", "a rectangle")),
        (LayoutTable::Positions(list), body) => return positions(source, body, list, shape),
        (LayoutTable::Groups { count }, Body::Mesh { .. }) if shape == ElectrodeShape::Group => {
            vec![[f64::NAN; 3]; count.value]
        }
        (LayoutTable::Groups { .. }, Body::Mesh { .. }) => {
            let fix = "write `shape = \"group\"`: a group covers what the mesh file says".to_string();
            return Err(source.fail(
                Some(table.shape.span.clone()),
                "electrodes in groups have no other shape",
                Some(fix),
            ));
        }
        (LayoutTable::Groups { .. }, _) => return Err(wrong_body("groups", "a mesh file")),
    };
    if shape == ElectrodeShape::Group && !matches!(table.layout.value, LayoutTable::Groups { .. }) {
        return Err(group_without_groups(source, &table.shape.span));
    }
    Ok(centres.into_iter().map(|centre: Point3| (centre, shape)).collect())
}

/// The positions of electrodes along an edge; else what is wrong with the keys, and the fix.
fn rim_places(body: &Body, layout: &LayoutTable) -> Result<Vec<Point3>, (String, Option<String>)> {
    let LayoutTable::Rim { count, per_side, first_theta_rad, first_corner, direction } = layout else {
        unreachable!("called for a rim")
    };
    let no_key = |key: &str, other: &str| {
        let message = format!("electrodes on the rim of {} have no `{key}`", name(body));
        Err((message, Some(format!("write `{other}`"))))
    };
    match (body, count, per_side) {
        (Body::Disk { .. }, _, Some(_)) => no_key("per_side", "count = ..."),
        (Body::Disk { .. }, ..) if first_corner.is_some() => no_key("first_corner", "first_theta_rad = ..."),
        (Body::Rectangle { .. }, ..) if first_theta_rad.is_some() => no_key("first_theta_rad", "first_corner = ..."),
        (&Body::Disk { diameter_m }, Some(count), None) => {
            let first_rad = first_theta_rad.as_ref().map_or(0.0, |at| at.value);
            Ok(rim::on_disk(diameter_m, count.value, first_rad, *direction))
        }
        (&Body::Rectangle { width_m, height_m }, count, per_side) if count.is_some() != per_side.is_some() => {
            let in_all = count.as_ref().map(|count| rim::Count::InAll(count.value));
            let count = in_all.or(per_side.as_ref().map(|count| rim::Count::PerSide(count.value)));
            let count = count.expect("one of the two is there");
            let first = first_corner.as_ref().map_or(Corner::default(), |at| at.value);
            Ok(rim::on_rectangle([width_m, height_m], count, first, *direction))
        }
        (Body::Disk { .. }, ..) => Err(("a rim needs `count`".into(), None)),
        _ => Err(("a rim needs either `count` or `per_side`".into(), None)),
    }
}

/// Refuses counts that do not fit in memory, before any electrode is placed.
fn count_fits(source: &Source<'_>, span: &Range<usize>, layout: &LayoutTable) -> Result<(), DesignError> {
    let count = match layout {
        LayoutTable::Rings { rings, per_ring, .. } => rings.value.saturating_mul(per_ring.value),
        LayoutTable::Grid { rows, columns, .. } => rows.value.saturating_mul(columns.value),
        LayoutTable::Rim { count, per_side, .. } => match (count, per_side) {
            (Some(count), _) => count.value,
            (None, Some(per_side)) => per_side.value.saturating_mul(4),
            (None, None) => return Ok(()),
        },
        LayoutTable::Groups { count } => count.value,
        LayoutTable::Positions(list) => list.len(),
    };
    let wrong = if count < 4 {
        format!("{count} electrodes are too few: a skin needs at least 4")
    } else if count > MAX_ELECTRODES {
        format!("{count} electrodes are too many: a skin has at most {MAX_ELECTRODES}")
    } else {
        return Ok(());
    };
    Err(source.fail(Some(span.clone()), wrong, None))
}

fn positions(
    source: &Source<'_>,
    body: &Body,
    list: &[At<PositionTable>],
    shape: ElectrodeShape,
) -> Result<Places, DesignError> {
    let mut places = Vec::with_capacity(list.len());
    for (index, At { value: position, span }) in list.iter().enumerate() {
        let own_shape = position.shape.map_or(shape, ElectrodeShape::from);
        if own_shape == ElectrodeShape::Group {
            return Err(group_without_groups(source, span));
        }
        let PositionTable { x_m, y_m, z_m, theta_rad, .. } = *position;
        let centre = match (body, x_m, y_m, z_m, theta_rad) {
            (&Body::Cylinder { length_m, diameter_m }, None, None, Some(z_m), Some(theta_rad)) => {
                on_cylinder(length_m, diameter_m, z_m, theta_rad)
            }
            (Body::Disk { .. } | Body::Rectangle { .. }, Some(x_m), Some(y_m), None, None) => [x_m, y_m, 0.0],
            (Body::Mesh { .. }, Some(x_m), Some(y_m), Some(z_m), None) => [x_m, y_m, z_m],
            _ => {
                let needed = match body {
                    Body::Cylinder { .. } => "`z_m` and `theta_rad`",
                    Body::Disk { .. } | Body::Rectangle { .. } => "`x_m` and `y_m`",
                    Body::Mesh { .. } => "`x_m`, `y_m` and `z_m`",
                };
                let message = format!("electrode {index}: a place on {} is {needed}, no more and no less", name(body));
                return Err(source.fail(Some(span.clone()), message, None));
            }
        };
        places.push((centre, own_shape));
    }
    Ok(places)
}

fn group_without_groups(source: &Source<'_>, span: &Range<usize>) -> DesignError {
    let fix = "write `layout.groups.count = ...`, or another shape".to_string();
    source.fail(Some(span.clone()), "only electrodes in groups of a mesh file have the shape `group`", Some(fix))
}

/// A position on a cylinder; a z within rounding error of a rim is set to the rim.
fn on_cylinder(length_m: f64, diameter_m: f64, z_m: f64, theta_rad: f64) -> Point3 {
    let rounding_m = 1e-9 * length_m;
    let z_m = [0.0, length_m].into_iter().find(|rim| (z_m - rim).abs() <= rounding_m).unwrap_or(z_m);
    [0.5 * diameter_m * theta_rad.cos(), 0.5 * diameter_m * theta_rad.sin(), z_m]
}

/// The position of step `index` of `count` along a side.
fn step(index: usize, count: usize, side_m: f64, margin_m: Option<f64>) -> f64 {
    match margin_m {
        Some(_) if count == 1 => 0.5 * side_m,
        Some(margin_m) => margin_m + index as f64 * (side_m - 2.0 * margin_m) / (count - 1) as f64,
        None => (index as f64 + 0.5) * side_m / count as f64,
    }
}

/// A description of a body for messages.
pub(super) fn name(body: &Body) -> &'static str {
    match body {
        Body::Cylinder { .. } => "a cylinder",
        Body::Disk { .. } => "a disk",
        Body::Rectangle { .. } => "a rectangle",
        Body::Mesh { .. } => "a mesh file",
    }
}
