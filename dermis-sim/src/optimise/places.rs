//! Where electrodes may lie.

use super::OptimiseError;
use dermis::design::{Body, Electrode, ElectrodeShape, MeshOptions, SkinDesign};
use dermis::geom::vector::distance;
use dermis::geom::{Point3, Surface};
use dermis::mesh::{Cells, Mesh};
use dermis::protocol::Protocol;

/// Most nodes of a mesh whose nodes are places: far more than places that are tried.
const MAX_NODES: f64 = 40_000.0;
/// A disc that is not cut by an edge keeps this share of its radius from it: no mesh fits into a narrower strip.
const STRIP: f64 = 0.25;
/// Rounding error of a node on an edge, m.
const ON_EDGE_M: f64 = 1e-7;

/// A ball in which no electrode has its centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Zone {
    /// Its centre, m.
    pub centre_m: Point3,
    /// Its radius, m.
    pub radius_m: f64,
}

/// Where electrodes may lie.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlaceRules {
    /// Least distance of two centres along the surface, m; without it one and a half times an electrode's extent.
    pub least_distance_m: Option<f64>,
    /// Least distance of a centre from the body's edge, m. With 0, centres may lie on the edge itself, where a disc is
    /// cut in half.
    pub edge_m: f64,
    /// Zones without electrodes.
    pub forbidden: Vec<Zone>,
}

/// The places that obey the rules.
#[derive(Debug)]
pub(super) struct Places {
    pub(super) surface: Surface,
    pub(super) least_distance_m: f64,
    pub(super) allowed_m: Vec<Point3>,
    pub(super) area_m2: f64,
    /// Whether the design's own electrodes obey the rules.
    pub(super) allow_given: bool,
}

impl Places {
    /// The nodes of a fine mesh of the body that obey the rules.
    pub(super) fn new(design: &SkinDesign, rules: &PlaceRules) -> crate::Result<Self> {
        let shape = design.electrodes[0].shape;
        let size_m = extent_m(shape).ok_or(OptimiseError::Groups)?;
        if matches!(shape, ElectrodeShape::Arc { .. }) && rules.edge_m > 0.0 {
            return Err(OptimiseError::EdgeOfArcs.into());
        }
        let whole = Mesh::generate(design)?;
        if !matches!(whole.cells, Cells::Triangles(_)) {
            return Err(OptimiseError::Volume.into());
        }
        let area_m2: f64 = (0..whole.cell_count()).map(|cell| whole.cell_measure(cell)).sum();
        let fallback_m = if size_m > 0.0 { 1.5 * size_m } else { 0.02 * area_m2.sqrt() };
        let distance_m = rules.least_distance_m.unwrap_or(fallback_m);
        if distance_m <= size_m {
            return Err(OptimiseError::Overlap { distance_m, size_m }.into());
        }
        let edge_m = (distance_m / 4.0).max((area_m2 / MAX_NODES).sqrt());
        let centres: Vec<Point3> = design.electrodes.iter().map(|electrode| electrode.centre_m).collect();
        let mesh = Mesh::generate(&with_points(design, &centres, edge_m)?)?;
        let edge = Edge::of(&design.body, &mesh);
        let is_allowed = |node: &Point3| {
            edge.allows(*node, shape, rules.edge_m)
                && rules.forbidden.iter().all(|zone| distance(zone.centre_m, *node) >= zone.radius_m)
        };
        let allowed_m: Vec<Point3> = mesh.nodes.iter().copied().filter(is_allowed).collect();
        if allowed_m.is_empty() {
            return Err(OptimiseError::NoPlace { zones: rules.forbidden.len(), edge_m: rules.edge_m }.into());
        }
        let surface = design.body.surface();
        let is_apart = |(index, centre): (usize, &Point3)| {
            centres[..index].iter().all(|other| surface.distance_m(*other, *centre) >= distance_m)
        };
        let allow_given = centres.iter().all(is_allowed) && centres.iter().enumerate().all(is_apart);
        Ok(Places { surface, least_distance_m: distance_m, allowed_m, area_m2, allow_given })
    }

    /// At most `count` places that are spread over the body, no nearer than `least_m`.
    pub(super) fn spread(&self, count: usize, least_m: f64) -> Vec<Point3> {
        let spread = farthest_points(self.surface, &self.allowed_m, count, least_m);
        spread.into_iter().map(|place| self.allowed_m[place]).collect()
    }

    /// Places for some electrodes.
    ///
    /// # Errors
    /// Fewer places than `count` that keep the least distance.
    pub(super) fn fitting(&self, count: usize) -> Result<Vec<Point3>, OptimiseError> {
        let spread = self.spread(count, self.least_distance_m);
        match spread.len() < count {
            true => Err(OptimiseError::TooFewPlaces {
                fitting: spread.len(),
                wanted: count,
                distance_m: self.least_distance_m,
            }),
            false => Ok(spread),
        }
    }
}

/// The indices of at most `count` points, each the farthest from those before (Gonzalez, 1985, DOI
/// 10.1016/0304-3975(85)90224-5); it ends before two are nearer than `least_m`.
pub(super) fn farthest_points(surface: Surface, points: &[Point3], count: usize, least_m: f64) -> Vec<usize> {
    let mut nearest_m = vec![f64::INFINITY; points.len()];
    let (mut chosen, mut next) = (Vec::new(), 0);
    while chosen.len() < count.min(points.len()) {
        chosen.push(next);
        let mut farthest = (0, f64::NEG_INFINITY);
        for (index, (point, nearest)) in points.iter().zip(&mut nearest_m).enumerate() {
            *nearest = nearest.min(surface.distance_m(*point, points[next]));
            if *nearest > farthest.1 {
                farthest = (index, *nearest);
            }
        }
        if farthest.1 < least_m || farthest.1 <= 0.0 {
            break;
        }
        next = farthest.0;
    }
    chosen
}

/// The design with point electrodes at some places, on a mesh of even size.
pub(super) fn with_points(design: &SkinDesign, places_m: &[Point3], edge_m: f64) -> crate::Result<SkinDesign> {
    let point = |&centre_m: &Point3| Electrode { centre_m, shape: ElectrodeShape::Point, contact_impedance: 0.0 };
    Ok(SkinDesign {
        electrodes: places_m.iter().map(point).collect(),
        protocol: Protocol::adjacent(places_m.len())?,
        mesh: MeshOptions { max_edge_m: edge_m, electrode_edge_m: edge_m, growth: 0.5, correct_arc_ends: false },
        fabrication: None,
        ..design.clone()
    })
}

/// The extent of an electrode, m; `None` for a group.
pub(super) fn extent_m(shape: ElectrodeShape) -> Option<f64> {
    match shape {
        ElectrodeShape::Disc { radius_m } => Some(2.0 * radius_m),
        ElectrodeShape::Arc { length_m } => Some(length_m),
        ElectrodeShape::Point => Some(0.0),
        ElectrodeShape::Group => None,
    }
}

/// The edge of a body.
enum Edge<'a> {
    Known(&'a Body),
    /// The nodes on the edge of a mesh; none if it is closed.
    Nodes(Vec<Point3>),
}

impl<'a> Edge<'a> {
    fn of(body: &'a Body, mesh: &Mesh) -> Self {
        if !matches!(body, Body::Mesh { .. }) {
            return Edge::Known(body);
        }
        let mut nodes: Vec<usize> = mesh.edge_sides().into_flattened();
        nodes.sort_unstable();
        nodes.dedup();
        Edge::Nodes(nodes.into_iter().map(|node| mesh.nodes[node]).collect())
    }

    /// Whether an electrode may have its centre at a node.
    fn allows(&self, node: Point3, shape: ElectrodeShape, least_m: f64) -> bool {
        let (away_m, may_be_cut) = match self {
            Edge::Known(body) => (body.edge_distance_m(node).unwrap_or(f64::INFINITY), true),
            Edge::Nodes(edge) => (edge.iter().map(|other| distance(*other, node)).fold(f64::INFINITY, f64::min), false),
        };
        let is_on_edge = away_m <= ON_EDGE_M;
        match shape {
            ElectrodeShape::Arc { .. } => is_on_edge,
            ElectrodeShape::Disc { radius_m } => {
                (may_be_cut && is_on_edge && least_m == 0.0) || away_m >= least_m.max((1.0 + STRIP) * radius_m)
            }
            ElectrodeShape::Point | ElectrodeShape::Group => away_m >= least_m,
        }
    }
}
