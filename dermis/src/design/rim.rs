//! Electrodes along the edge of a flat skin.

use crate::design::check::rounding_m;
use crate::design::file::Direction;
use crate::design::layout::Ground;
use crate::design::{Body, ElectrodeShape};
use crate::geom::{Edge, Point2, Point3};
use std::f64::consts::TAU;

/// Electrodes at equal distances around a disk.
pub(super) fn on_disk(diameter_m: f64, count: usize, first_theta_rad: f64, direction: Direction) -> Vec<Point3> {
    let sign = match direction {
        Direction::CounterClockwise => 1.0,
        Direction::Clockwise => -1.0,
    };
    let place = |index: usize| of_disk(diameter_m, first_theta_rad + sign * (index as f64 * TAU / count as f64));
    (0..count).map(place).collect()
}

/// The point of a disk's edge at an angle.
pub(super) fn of_disk(diameter_m: f64, theta_rad: f64) -> Point3 {
    [0.5 * diameter_m * theta_rad.cos(), 0.5 * diameter_m * theta_rad.sin(), 0.0]
}

/// The point of a flat body's edge at a distance along it; else the length of the edge.
pub(super) fn along_edge(ground: &Ground<'_>, along_m: f64) -> Result<Point3, f64> {
    if let Some(outline) = ground.outline {
        let sides = sides(&outline.corners_m, 0, Direction::CounterClockwise);
        let length_m = sides.iter().map(|(_, _, length_m)| length_m).sum();
        return if (0.0..=length_m).contains(&along_m) { Ok(at(&sides, along_m)) } else { Err(length_m) };
    }
    let chart = ground.body.chart().expect("flat bodies have a chart");
    let [edge] = &Edge::all(&chart)[..] else { unreachable!("a flat body has one edge") };
    match (0.0..=edge.length).contains(&along_m) {
        true => Ok(chart.roll(edge.point(along_m))),
        false => Err(edge.length),
    }
}

/// Parts of an arc's length and a disc's radius by which a position may be off, and a distance for points, m: positions
/// rounded to 0.01 mm are at most 7 micrometres off.
const ROUNDED_PART: f64 = 0.1;
const ROUNDED_POINT_M: f64 = 1e-5;

/// The centre of an electrode whose position is rounded: that of an arc or a point near the edge is moved to the edge,
/// that of a disc just beyond the edge too.
pub(super) fn without_rounding(body: &Body, centre_m: Point3, shape: ElectrodeShape) -> Point3 {
    let Some(chart) = body.chart() else { return centre_m };
    let place = chart.unroll(centre_m);
    let depth_m = chart.depth_m(place);
    let tolerance_m = match shape {
        ElectrodeShape::Arc { length_m } => ROUNDED_PART * length_m,
        ElectrodeShape::Disc { radius_m } if depth_m < 0.0 => ROUNDED_PART * radius_m,
        ElectrodeShape::Point => ROUNDED_POINT_M,
        ElectrodeShape::Disc { .. } | ElectrodeShape::Group => return centre_m,
    };
    // A position computed to the last digits keeps them.
    if depth_m.abs() <= rounding_m(&chart) || depth_m.abs() > tolerance_m || depth_m.is_nan() {
        return centre_m;
    }
    let on_edge = Edge::all(&chart).into_iter().map(|edge| (edge.nearest(place), edge));
    match on_edge.min_by(|(a, _), (b, _)| a.1.total_cmp(&b.1)) {
        Some(((along_m, _), edge)) => chart.roll(edge.point(along_m)),
        None => centre_m,
    }
}

/// The number of electrodes on an outline.
#[derive(Debug, Clone, Copy)]
pub(super) enum Count {
    /// In total, at equal distances along the whole edge.
    InAll(usize),
    /// On each side, at equal distances along it.
    PerSide(usize),
}

/// Electrodes along a closed outline, from one of its corners on. The first and the last of a row are half a step from its
/// ends.
pub(super) fn on_outline(corners_m: &[Point2], count: Count, first: usize, direction: Direction) -> Vec<Point3> {
    let sides = sides(corners_m, first, direction);
    let lengths_m: Vec<f64> = sides.iter().map(|(_, _, length_m)| *length_m).collect();
    let ways_m: Vec<f64> = match count {
        Count::InAll(count) => {
            let step_m = lengths_m.iter().sum::<f64>() / count as f64;
            (0..count).map(|index| (index as f64 + 0.5) * step_m).collect()
        }
        Count::PerSide(count) => {
            let on_side = |side: usize| {
                let before_m: f64 = lengths_m[..side].iter().sum();
                let step_m = lengths_m[side] / count as f64;
                (0..count).map(move |k| before_m + (k as f64 + 0.5) * step_m)
            };
            (0..lengths_m.len()).flat_map(on_side).collect()
        }
    };
    ways_m.into_iter().map(|way_m| at(&sides, way_m)).collect()
}

/// The corners of a rectangle.
pub(super) fn corners_m([width_m, height_m]: [f64; 2]) -> [Point2; 4] {
    [[0.0, 0.0], [width_m, 0.0], [width_m, height_m], [0.0, height_m]]
}

/// Corner, direction and length of a side.
type Side = (Point2, Point2, f64);

/// The sides in numbering order.
fn sides(corners_m: &[Point2], first: usize, direction: Direction) -> Vec<Side> {
    let count = corners_m.len();
    let step = match direction {
        Direction::CounterClockwise => 1,
        Direction::Clockwise => count - 1,
    };
    let side = |side: usize| {
        let (from, to) = (corners_m[(first + side * step) % count], corners_m[(first + (side + 1) * step) % count]);
        let length_m = (to[0] - from[0]).hypot(to[1] - from[1]);
        (from, [0, 1].map(|axis| (to[axis] - from[axis]) / length_m), length_m)
    };
    (0..count).map(side).collect()
}

/// The point at an arc length along the sides.
fn at(sides: &[Side], way_m: f64) -> Point3 {
    let mut rest_m = way_m;
    for (index, &(from, direction, length_m)) in sides.iter().enumerate() {
        if rest_m <= length_m || index + 1 == sides.len() {
            let rest_m = rest_m.min(length_m);
            return [from[0] + rest_m * direction[0], from[1] + rest_m * direction[1], 0.0];
        }
        rest_m -= length_m;
    }
    unreachable!("the last side takes every way")
}
