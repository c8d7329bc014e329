//! The electrode positions of a layout.

use crate::design::error::DesignError;
use crate::design::file::{At, Corner, ElectrodesTable, LayoutTable, PositionTable};
use crate::design::outline::Outline;
use crate::design::resolve::Source;
use crate::design::{Body, ElectrodeShape, rim};
use crate::geom::{Point3, beyond_a_turn};
use std::f64::consts::TAU;
use std::ops::Range;

/// Maximum number of electrodes of a skin: the adjacent protocol then has a million values.
pub const MAX_ELECTRODES: usize = 1024;

/// What electrodes are placed on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ground<'a> {
    /// The body.
    pub body: &'a Body,
    /// Its outline, if it is a polygon.
    pub outline: Option<&'a Outline>,
}

impl Ground<'_> {
    /// A description for messages.
    fn name(&self) -> &'static str {
        self.outline.map_or(name(self.body), |_| "a polygon")
    }
}

type Places = Vec<(Point3, ElectrodeShape)>;

/// The centre and the shape of every electrode.
pub(super) fn places(source: &Source<'_>, ground: &Ground<'_>, table: &ElectrodesTable) -> Result<Places, DesignError> {
    let body = ground.body;
    let span = &table.layout.span;
    let shape = ElectrodeShape::from(table.shape.value);
    let sides = ground.outline.map_or(4, |outline| outline.corners_m.len());
    count_fits(source, span, &table.layout.value, sides)?;
    let wrong_body = |layout: &str, bodies: &str| {
        let message = format!("electrodes in {layout} need {bodies}, not {}", ground.name());
        source.fail(Some(span.clone()), message, Some("a list of `positions` fits every body".into()))
    };
    let optional = |at: &Option<At<f64>>| at.as_ref().map_or(0.0, |at| at.value);
    check_angles(source, &table.layout.value)?;
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
        (LayoutTable::Rim { .. }, body)
            if ground.outline.is_some() || matches!(body, Body::Disk { .. } | Body::Rectangle { .. }) =>
        {
            rim_places(ground, &table.layout.value)
                .map_err(|(message, fix)| source.fail(Some(span.clone()), message, fix))?
        }
        (LayoutTable::Rim { .. }, _) => return Err(wrong_body("a rim", "a disk, a rectangle or a polygon")),
        (LayoutTable::Grid { rows, columns, margin_m }, &Body::Rectangle { width_m, height_m }) => {
            let half_m = 0.5 * width_m.min(height_m);
            if let Some(At { value, span }) = margin_m.as_ref().filter(|at| !(0.0..half_m).contains(&at.value)) {
                let message =
                    format!("margin_m is {value}: it must be from 0 to less than half of the shorter side, {half_m} m");
                return Err(source.fail(Some(span.clone()), message, None));
            }
            let margin_m = margin_m.as_ref().map(|at| at.value);
            let place = |index: usize| {
                let (row, column) = (index / columns.value, index % columns.value);
                [step(column, columns.value, width_m, margin_m), step(row, rows.value, height_m, margin_m), 0.0]
            };
            (0..rows.value * columns.value).map(place).collect()
        }
        (LayoutTable::Grid { .. }, _) => return Err(wrong_body("a grid", "a rectangle")),
        (LayoutTable::Positions(list), _) => return positions(source, ground, list, shape),
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

/// Refuses angles of more than one turn, and steps of a stagger of more than one step.
fn check_angles(source: &Source<'_>, layout: &LayoutTable) -> Result<(), DesignError> {
    let (LayoutTable::Rings { first_theta_rad, .. } | LayoutTable::Rim { first_theta_rad, .. }) = layout else {
        return Ok(());
    };
    if let Some(at) = first_theta_rad
        && let Some(wrong) = beyond_a_turn("first_theta_rad", at.value)
    {
        return Err(source.fail(Some(at.span.clone()), wrong, None));
    }
    if let LayoutTable::Rings { stagger: Some(at), .. } = layout
        && !(-1.0..=1.0).contains(&at.value)
    {
        let message = format!("stagger is {}: it must be between -1 and 1", at.value);
        let fix = "it is a part of the angle between two electrodes of a ring: 0.5 is half of it".to_string();
        return Err(source.fail(Some(at.span.clone()), message, Some(fix)));
    }
    Ok(())
}

/// The positions of electrodes along an edge; else what is wrong with the keys, and the fix.
fn rim_places(ground: &Ground<'_>, layout: &LayoutTable) -> Result<Vec<Point3>, (String, Option<String>)> {
    let LayoutTable::Rim { count, per_side, first_theta_rad, first_corner, direction } = layout else {
        unreachable!("called for a rim")
    };
    let no_key = |key: &str, other: &str| {
        let message = format!("electrodes on the rim of {} have no `{key}`", ground.name());
        Err((message, Some(format!("write `{other}`"))))
    };
    let in_all = count.as_ref().map(|count| rim::Count::InAll(count.value));
    let wanted = in_all.xor(per_side.as_ref().map(|count| rim::Count::PerSide(count.value)));
    let either = || ("a rim needs either `count` or `per_side`".to_string(), None);
    if let Some(outline) = ground.outline {
        if first_theta_rad.is_some() || first_corner.is_some() {
            let message = "electrodes on the rim of a polygon have no `first_theta_rad` and no `first_corner`";
            return Err((
                message.into(),
                Some("they begin at its first corner: list the corners from there on".into()),
            ));
        }
        return Ok(rim::on_outline(&outline.corners_m, wanted.ok_or_else(either)?, 0, *direction));
    }
    match (ground.body, count, per_side) {
        (Body::Disk { .. }, _, Some(_)) => no_key("per_side", "count = ..."),
        (Body::Disk { .. }, ..) if first_corner.is_some() => no_key("first_corner", "first_theta_rad = ..."),
        (Body::Rectangle { .. }, ..) if first_theta_rad.is_some() => no_key("first_theta_rad", "first_corner = ..."),
        (&Body::Disk { diameter_m }, Some(count), None) => {
            let first_rad = first_theta_rad.as_ref().map_or(0.0, |at| at.value);
            Ok(rim::on_disk(diameter_m, count.value, first_rad, *direction))
        }
        (&Body::Rectangle { width_m, height_m }, ..) => {
            let first = first_corner.as_ref().map_or(Corner::default(), |at| at.value);
            let corners_m = rim::corners_m([width_m, height_m]);
            Ok(rim::on_outline(&corners_m, wanted.ok_or_else(either)?, first as usize, *direction))
        }
        (Body::Disk { .. }, ..) => Err(("a rim needs `count`".into(), None)),
        _ => Err(either()),
    }
}

/// Refuses counts that do not fit in memory, before any electrode is placed.
fn count_fits(source: &Source<'_>, span: &Range<usize>, layout: &LayoutTable, sides: usize) -> Result<(), DesignError> {
    let count = match layout {
        LayoutTable::Rings { rings, per_ring, .. } => rings.value.saturating_mul(per_ring.value),
        LayoutTable::Grid { rows, columns, .. } => rows.value.saturating_mul(columns.value),
        LayoutTable::Rim { count, per_side, .. } => match (count, per_side) {
            (Some(count), _) => count.value,
            (None, Some(per_side)) => per_side.value.saturating_mul(sides),
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
    ground: &Ground<'_>,
    list: &[At<PositionTable>],
    shape: ElectrodeShape,
) -> Result<Places, DesignError> {
    let mut places = Vec::with_capacity(list.len());
    for (index, At { value: position, span }) in list.iter().enumerate() {
        let own_shape = position.shape.map_or(shape, ElectrodeShape::from);
        if own_shape == ElectrodeShape::Group {
            return Err(group_without_groups(source, span));
        }
        let centre = centre_m(ground, position).map_err(|(message, fix)| {
            source.fail(Some(span.clone()), format!("electrode {index}: {message}"), fix.map(str::to_string))
        })?;
        let centre = rim::without_rounding(ground.body, centre, own_shape);
        places.push((centre, own_shape));
    }
    Ok(places)
}

/// The centre of an electrode from its position; else what is wrong with the keys, and the fix.
fn centre_m(ground: &Ground<'_>, position: &PositionTable) -> Result<Point3, (String, Option<&'static str>)> {
    let PositionTable { x_m, y_m, z_m, theta_rad, along_edge_m, .. } = *position;
    let is_flat = ground.outline.is_some() || matches!(ground.body, Body::Disk { .. } | Body::Rectangle { .. });
    if let Some(wrong) = theta_rad.and_then(|angle_rad| beyond_a_turn("theta_rad", angle_rad)) {
        return Err((wrong, None));
    }
    Ok(match (ground.body, x_m, y_m, z_m, theta_rad, along_edge_m) {
        (&Body::Cylinder { length_m, diameter_m }, None, None, Some(z_m), Some(theta_rad), None) => {
            on_cylinder(length_m, diameter_m, z_m, theta_rad)
        }
        (_, Some(x_m), Some(y_m), None, None, None) if is_flat => [x_m, y_m, 0.0],
        (&Body::Disk { diameter_m }, None, None, None, Some(theta_rad), None) => rim::of_disk(diameter_m, theta_rad),
        (_, None, None, None, None, Some(along_m)) if is_flat => {
            rim::along_edge(ground, along_m).map_err(|length_m| {
                let message = format!("along_edge_m is {along_m}: it must be between 0 and {length_m:.6}");
                (message, Some("the edge is no longer; lengths are in metres"))
            })?
        }
        (Body::Mesh { .. }, Some(x_m), Some(y_m), Some(z_m), None, None) => [x_m, y_m, z_m],
        (body, ..) => {
            let needed = match body {
                Body::Cylinder { .. } => "`z_m` and `theta_rad`",
                Body::Disk { .. } => "`x_m` and `y_m`, or on the edge `theta_rad` or `along_edge_m`",
                _ if is_flat => "`x_m` and `y_m`, or on the edge `along_edge_m`",
                Body::Rectangle { .. } | Body::Mesh { .. } => "`x_m`, `y_m` and `z_m`",
            };
            return Err((format!("a place on {} is {needed}, no more and no less", ground.name()), None));
        }
    })
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
