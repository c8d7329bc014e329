//! Electrodes along the edge of a flat skin.

use crate::design::file::{Corner, Direction};
use crate::geom::Point3;
use std::f64::consts::TAU;

/// Electrodes at equal distances around a disk.
pub(super) fn on_disk(diameter_m: f64, count: usize, first_theta_rad: f64, direction: Direction) -> Vec<Point3> {
    let sign = match direction {
        Direction::CounterClockwise => 1.0,
        Direction::Clockwise => -1.0,
    };
    let place = |index: usize| {
        let theta_rad = first_theta_rad + sign * (index as f64 * TAU / count as f64);
        [0.5 * diameter_m * theta_rad.cos(), 0.5 * diameter_m * theta_rad.sin(), 0.0]
    };
    (0..count).map(place).collect()
}

/// The number of electrodes on a rectangle's edge.
#[derive(Debug, Clone, Copy)]
pub(super) enum Count {
    /// In total, at equal distances along the whole edge.
    InAll(usize),
    /// On each side, at equal distances along it.
    PerSide(usize),
}

/// Electrodes along the edge of a rectangle. The first and the last of a row are half a step from its ends.
pub(super) fn on_rectangle(size_m: [f64; 2], count: Count, first: Corner, direction: Direction) -> Vec<Point3> {
    let sides = sides(size_m, first, direction);
    let lengths_m = sides.map(|(_, _, length_m)| length_m);
    let ways_m: Vec<f64> = match count {
        Count::InAll(count) => {
            let step_m = lengths_m.iter().sum::<f64>() / count as f64;
            (0..count).map(|index| (index as f64 + 0.5) * step_m).collect()
        }
        Count::PerSide(count) => {
            let on_side = |side: usize| {
                let before_m: f64 = lengths_m[..side].iter().sum();
                (0..count).map(move |k| before_m + (k as f64 + 0.5) * lengths_m[side] / count as f64)
            };
            (0..4).flat_map(on_side).collect()
        }
    };
    ways_m.into_iter().map(|way_m| at(&sides, way_m)).collect()
}

/// Corner, direction and length of a side.
type Side = ([f64; 2], [f64; 2], f64);

/// The sides in numbering order.
fn sides([width_m, height_m]: [f64; 2], first: Corner, direction: Direction) -> [Side; 4] {
    let corners = [[0.0, 0.0], [width_m, 0.0], [width_m, height_m], [0.0, height_m]];
    let start = first as usize;
    let step = match direction {
        Direction::CounterClockwise => 1,
        Direction::Clockwise => 3,
    };
    [0, 1, 2, 3].map(|side| {
        let (from, to) = (corners[(start + side * step) % 4], corners[(start + (side + 1) * step) % 4]);
        let length_m = (to[0] - from[0]).abs() + (to[1] - from[1]).abs();
        (from, [0, 1].map(|axis| (to[axis] - from[axis]) / length_m), length_m)
    })
}

/// The point at an arc length along the sides.
fn at(sides: &[Side; 4], way_m: f64) -> Point3 {
    let mut rest_m = way_m;
    for (index, &(from, direction, length_m)) in sides.iter().enumerate() {
        if rest_m <= length_m || index == 3 {
            let rest_m = rest_m.min(length_m);
            return [from[0] + rest_m * direction[0], from[1] + rest_m * direction[1], 0.0];
        }
        rest_m -= length_m;
    }
    unreachable!("the last side takes every way")
}
