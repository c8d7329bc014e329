//! The fixed points: the body's edges and the electrodes' outlines.

use super::outline::Outline;
use super::sizing::Sizing;
use crate::geom::{Chart, Edge, Point2};
use crate::mesh::MeshError;

/// Two arc lengths closer than this fraction of the curve are one point.
const SAME: f64 = 1e-9;

/// A ring of points inside a disc's outline has this distance from it, as a fraction of the outline's edges: current
/// enters a skin of sheet conductance `s` within `sqrt(s z)` of the rim of an electrode of contact impedance `z`, which
/// is less than an edge; closer than this the triangles between would be too flat.
const INNER_RING: f64 = 0.4;

/// Fixed points, the edges between them that the mesh must contain, and the electrodes.
#[derive(Debug, Default)]
pub(super) struct Layout {
    pub points: Vec<Point2>,
    pub constraints: Vec<[usize; 2]>,
    pub electrodes: Vec<Marking>,
}

/// How an electrode is identified in the finished mesh.
#[derive(Debug, Clone)]
pub(super) enum Marking {
    /// The cells inside these edges, which are counter-clockwise around them.
    Inside(Vec<[usize; 2]>),
    /// These edges.
    Along(Vec<[usize; 2]>),
    /// This point.
    At(usize),
}

impl Layout {
    pub(super) fn new(chart: &Chart, outlines: &[Outline], sizing: &Sizing) -> Result<Self, MeshError> {
        let mut layout = Layout::default();
        let curves = layout.lay_edges(chart, outlines, sizing);
        for (electrode, outline) in outlines.iter().enumerate() {
            let marking = match *outline {
                Outline::Disc { centre, radius, ref arcs, whole, step } => {
                    let disc = Disc { electrode, centre, radius, step };
                    if whole { layout.lay_circle(chart, disc) } else { layout.lay_arcs(chart, disc, arcs, &curves)? }
                }
                Outline::Arc { edge, from, to } => Marking::Along(curves[edge].between(from, to)),
                Outline::Point { at } => match curves.iter().find_map(|curve| curve.at(chart, at)) {
                    Some(index) => Marking::At(index),
                    None => Marking::At(layout.push(at)),
                },
            };
            layout.electrodes.push(marking);
        }
        Ok(layout)
    }

    fn push(&mut self, point: Point2) -> usize {
        self.points.push(point);
        self.points.len() - 1
    }

    /// Divides the body's edges, with points where outlines intersect them.
    fn lay_edges(&mut self, chart: &Chart, outlines: &[Outline], sizing: &Sizing) -> Vec<Curve> {
        let mut curves = Vec::new();
        for (index, edge) in Edge::all(chart).into_iter().enumerate() {
            let mut stops = edge.corners.clone();
            for outline in outlines {
                match outline {
                    Outline::Disc { centre, radius, arcs, whole: false, .. } => {
                        let ends = arcs.iter().flatten().map(|angle| on_circle(*centre, *radius, *angle));
                        stops
                            .extend(ends.map(|end| edge.nearest(end)).filter(|(_, d)| *d < 1e-6 * radius).map(|n| n.0));
                    }
                    Outline::Arc { edge, from, to } if *edge == index => stops.extend([*from, *to]),
                    Outline::Point { at } => {
                        let (s, distance) = edge.nearest(*at);
                        stops.extend((distance < SAME * edge.length).then_some(s));
                    }
                    _ => {}
                }
            }
            stops.iter_mut().for_each(|s| *s = s.rem_euclid(edge.length));
            stops.sort_by(f64::total_cmp);
            stops.dedup_by(|a, b| *a - *b < SAME * edge.length);
            if stops.is_empty() {
                stops.push(0.0);
            }
            let mut lengths = Vec::new();
            for (k, &from) in stops.iter().enumerate() {
                let to = stops.get(k + 1).copied().unwrap_or(stops[0] + edge.length);
                lengths.push(from);
                lengths.extend(sizing.divide(from, to, |s| edge.point(s)));
            }
            let nodes: Vec<usize> = lengths.iter().map(|&s| self.push(chart.wrap(edge.point(s)))).collect();
            self.constraints.extend((0..nodes.len()).map(|k| [nodes[k], nodes[(k + 1) % nodes.len()]]));
            curves.push(Curve { edge, lengths, nodes });
        }
        curves
    }

    fn lay_circle(&mut self, chart: &Chart, disc: Disc) -> Marking {
        let count = (std::f64::consts::TAU / disc.step).round() as usize;
        let ring: Vec<usize> = (0..count)
            .map(|k| self.push(chart.wrap(on_circle(disc.centre, disc.radius, k as f64 * disc.step))))
            .collect();
        self.lay_inner_ring(chart, disc, [0.0, std::f64::consts::TAU], count);
        let outline: Vec<[usize; 2]> = (0..count).map(|k| [ring[k], ring[(k + 1) % count]]).collect();
        self.constraints.extend(&outline);
        Marking::Inside(outline)
    }

    fn lay_arcs(
        &mut self,
        chart: &Chart,
        disc: Disc,
        arcs: &[[f64; 2]],
        curves: &[Curve],
    ) -> Result<Marking, MeshError> {
        let mut outline = Vec::new();
        for &[from, to] in arcs {
            let end = |angle: f64| {
                let point = on_circle(disc.centre, disc.radius, angle);
                curves.iter().find_map(|curve| curve.at(chart, point)).ok_or_else(|| {
                    MeshError::Generate(format!(
                        "the outline of electrode {} meets the body's edge where no point of the mesh can be placed",
                        disc.electrode
                    ))
                })
            };
            let count = ((to - from) / disc.step).round().max(1.0) as usize;
            let mut nodes = vec![end(from)?];
            for k in 1..count {
                let angle = from + (to - from) * k as f64 / count as f64;
                nodes.push(self.push(chart.wrap(on_circle(disc.centre, disc.radius, angle))));
            }
            nodes.push(end(to)?);
            outline.extend(nodes.windows(2).map(|pair| [pair[0], pair[1]]));
            self.lay_inner_ring(chart, disc, [from, to], count);
        }
        self.constraints.extend(&outline);
        Ok(Marking::Inside(outline))
    }

    fn lay_inner_ring(&mut self, chart: &Chart, disc: Disc, [from, to]: [f64; 2], count: usize) {
        let step = (to - from) / count as f64;
        let side = disc.radius * step;
        let radius = disc.radius - INNER_RING * side;
        for k in 0..count {
            let point = on_circle(disc.centre, radius, from + (k as f64 + 0.5) * step);
            if chart.depth_m(point) > 0.3 * side {
                self.push(chart.wrap(point));
            }
        }
    }
}

/// A disc electrode as a polygon.
#[derive(Debug, Clone, Copy)]
struct Disc {
    electrode: usize,
    centre: Point2,
    radius: f64,
    /// Angle of a side.
    step: f64,
}

/// A divided boundary curve.
struct Curve {
    edge: Edge,
    lengths: Vec<f64>,
    nodes: Vec<usize>,
}

impl Curve {
    /// The node at a point of the curve; `None` if the point is not on it.
    fn at(&self, chart: &Chart, point: Point2) -> Option<usize> {
        let k = self.index_at(self.edge.nearest(chart.wrap(point)).0);
        let place = chart.wrap(self.edge.point(self.lengths[k]));
        (chart.distance_m(place, point) < 1e-6 * self.edge.length).then_some(self.nodes[k])
    }

    /// The division point nearest to an arc length.
    fn index_at(&self, s: f64) -> usize {
        let apart = |index: usize| self.edge.arc_m(s, self.lengths[index]);
        (0..self.lengths.len()).min_by(|&a, &b| apart(a).total_cmp(&apart(b))).expect("a curve has points")
    }

    /// The edges from one arc length to another.
    fn between(&self, from: f64, to: f64) -> Vec<[usize; 2]> {
        let count = self.nodes.len();
        let (first, last) = (self.index_at(from), self.index_at(to));
        let parts = (last + count - first) % count;
        (0..parts).map(|k| [self.nodes[(first + k) % count], self.nodes[(first + k + 1) % count]]).collect()
    }
}

fn on_circle(centre: Point2, radius: f64, angle: f64) -> Point2 {
    [centre[0] + radius * angle.cos(), centre[1] + radius * angle.sin()]
}
