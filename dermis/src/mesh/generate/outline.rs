//! The outlines of electrodes in the unrolled body.

use crate::design::{Electrode, ElectrodeShape};
use crate::geom::{Chart, Edge, Point2};
use std::f64::consts::TAU;

/// Number of directions in which a circle is searched for the body's edge. Intersections closer together than a
/// hundredth of the circle are not separated; the design's checks exclude such electrodes.
const DIRECTIONS: usize = 720;

/// The outline of an electrode, before it is divided into edges.
#[derive(Debug, Clone)]
pub(super) enum Outline {
    /// A circle, or the arcs of it inside the body, each from one angle to another, counter-clockwise.
    Disc { centre: Point2, radius: f64, arcs: Vec<[f64; 2]>, whole: bool, step: f64 },
    /// A part of a boundary curve, from one arc length to another.
    Arc { edge: usize, from: f64, to: f64 },
    /// One point.
    Point { at: Point2 },
}

impl Outline {
    /// The outline of an electrode, its edges about `edge_length` long.
    pub(super) fn new(chart: &Chart, electrode: &Electrode, edge_length: f64) -> Option<Self> {
        let centre = chart.unroll(electrode.centre_m);
        match electrode.shape {
            ElectrodeShape::Disc { radius_m } => Some(disc(chart, centre, radius_m, edge_length)),
            ElectrodeShape::Arc { length_m } => {
                let (edge, (s, _)) = Edge::all(chart)
                    .iter()
                    .map(|edge| edge.nearest(centre))
                    .enumerate()
                    .min_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
                Some(Outline::Arc { edge, from: s - length_m / 2.0, to: s + length_m / 2.0 })
            }
            ElectrodeShape::Point => Some(Outline::Point { at: centre }),
            ElectrodeShape::Group => None,
        }
    }
}

/// A disc as a polygon of the same area: with `n` sides of angle `d` the corners are at the radius `r sqrt(d / sin d)`.
fn disc(chart: &Chart, centre: Point2, radius: f64, edge_length: f64) -> Outline {
    let nominal = arcs_inside(chart, centre, radius);
    let sides = |span: f64| ((span * radius / edge_length).round() as usize).max((span / (TAU / 8.0)).ceil() as usize);
    let span: f64 = nominal.iter().map(|[from, to]| to - from).sum();
    let count: usize = nominal.iter().map(|[from, to]| sides(to - from)).sum();
    let step = span / count as f64;
    let radius = radius * (step / step.sin()).sqrt();
    let arcs = arcs_inside(chart, centre, radius);
    let whole = arcs.len() == 1 && arcs[0][1] - arcs[0][0] > TAU - 1e-9;
    Outline::Disc { centre, radius, arcs, whole, step }
}

/// The parts of a circle inside the body, as angles from..to with `to > from`.
fn arcs_inside(chart: &Chart, centre: Point2, radius: f64) -> Vec<[f64; 2]> {
    let depth = |angle: f64| chart.depth_m([centre[0] + radius * angle.cos(), centre[1] + radius * angle.sin()]);
    let angle = |k: usize| TAU * (k as f64 + 0.5) / DIRECTIONS as f64;
    let inside = |k: usize| depth(angle(k)) > 0.0;
    let Some(start) = (0..DIRECTIONS).find(|&k| !inside(k)) else { return vec![[0.0, TAU]] };
    let mut arcs = Vec::new();
    let mut from = None;
    for k in start..start + DIRECTIONS {
        match (inside(k), inside(k + 1)) {
            (false, true) => from = Some(crossing(&depth, angle(k), angle(k + 1))),
            (true, false) => {
                if let Some(from) = from.take() {
                    arcs.push([from, crossing(&depth, angle(k + 1), angle(k))]);
                }
            }
            _ => {}
        }
    }
    arcs
}

/// The angle between one outside and one inside at which the depth is zero.
fn crossing(depth: &impl Fn(f64) -> f64, mut outer: f64, mut inner: f64) -> f64 {
    for _ in 0..60 {
        let middle = 0.5 * (outer + inner);
        if depth(middle) > 0.0 {
            inner = middle;
        } else {
            outer = middle;
        }
    }
    0.5 * (outer + inner)
}
