//! Wire channels in the inner face of the base: from each bore to an edge.

use crate::body::BodyMesh;
use crate::error::FabricateError;
use crate::model::{Bore, Fabrication};
use crate::solid::base::mm;
use crate::solid::cutter::{Frame, cuboid, hull_of_balls};
use crate::solid::shell;
use dermis::design::{Body, FabricationOptions};
use dermis::geom::Point3;
use dermis::geom::surface::angle_difference;
use dermis::geom::vector::{add, distance, normalize, scale, sub};
use manifold_rust::manifold::Manifold;
use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

/// What is cut off for the channels.
///
/// On a cylinder they run along the axis to the end at z = 0, on a flat body along y to the lower edge, on a body from a
/// mesh file along the edges of its triangles to the nearest edge of the body; a closed body gets none.
pub(crate) fn channels(fabrication: &Fabrication) -> Result<Vec<Manifold>, FabricateError> {
    let bores = fabrication.electrodes.iter().map(|one| one.bore);
    let options = &fabrication.options;
    Ok(match (&fabrication.design.body, &fabrication.body_mesh) {
        (&Body::Cylinder { diameter_m, .. }, _) => {
            lines(bores).into_iter().map(|line| along_axis(line, diameter_m, options)).collect()
        }
        (_, Some(mesh)) => on_mesh(&bores.collect::<Vec<_>>(), mesh, options)?,
        (body, None) => bores.map(|bore| to_lower_edge(bore, body, options)).collect(),
    })
}

/// For each angle at which there are bores of a cylinder, the highest.
fn lines(bores: impl Iterator<Item = Bore>) -> Vec<Bore> {
    const ROUNDING_RAD: f64 = 1e-6;
    let angle = |bore: &Bore| bore.normal[1].atan2(bore.normal[0]);
    let mut lines: Vec<Bore> = Vec::new();
    for bore in bores {
        match lines.iter_mut().find(|line| angle_difference(angle(line), angle(&bore)).abs() < ROUNDING_RAD) {
            Some(line) if line.centre_m[2] < bore.centre_m[2] => *line = bore,
            Some(_) => {}
            None => lines.push(bore),
        }
    }
    lines
}

fn along_axis(bore: Bore, diameter_m: f64, options: &FabricationOptions) -> Manifold {
    let (half, wall, depth) = (0.5 * mm(options.channel_width_m), mm(options.wall_m), mm(options.channel_depth_m));
    let inner = 0.5 * mm(diameter_m) - wall;
    // Below the inner face at the corners of the profile, too, but not beyond the axis.
    let low = ((inner * inner - half * half).max(0.0).sqrt() - 1.0).max(0.0);
    let [x, y, _] = bore.normal;
    // Across, outwards; the third vector is the axis.
    let frame = Frame { origin: [0.0; 3], u: bore.normal, v: [-y, x, 0.0] };
    cuboid(&frame, [low, inner + depth], [-half, half], [-mm(options.flange_m) - wall, mm(bore.centre_m[2])])
}

fn to_lower_edge(bore: Bore, body: &Body, options: &FabricationOptions) -> Manifold {
    let (half, wall, depth) = (0.5 * mm(options.channel_width_m), mm(options.wall_m), mm(options.channel_depth_m));
    let lowest = match *body {
        Body::Disk { diameter_m } => -0.5 * mm(diameter_m),
        _ => 0.0,
    };
    let [x, y, _] = bore.centre_m.map(mm);
    let frame = Frame { origin: [0.0; 3], u: [1.0, 0.0, 0.0], v: [0.0, 1.0, 0.0] };
    cuboid(&frame, [x - half, x + half], [lowest - mm(options.flange_m) - wall, y], [-wall - 1.0, depth - wall])
}

/// Channels along edges of the inner face: the shortest way of each bore to the edge of the body. Common ways are cut
/// once.
fn on_mesh(bores: &[Bore], mesh: &BodyMesh, options: &FabricationOptions) -> Result<Vec<Manifold>, FabricateError> {
    if mesh.boundary.is_empty() {
        return Ok(Vec::new());
    }
    let inner: Vec<Point3> = shell::inner_m(mesh, options.wall_m);
    let ways = Ways::new(mesh, &inner);
    let ways_of = ways.of(bores, options);
    let (half, depth) = (0.5 * options.channel_width_m, options.channel_depth_m);
    // Two balls at each node: one on the inner face, and one whose lowest point is at the depth.
    let balls = |place: Point3, outward: Point3| {
        let lower = add(place, scale(outward, (depth - half).max(0.0)));
        [place, lower].map(|centre| centre.map(mm))
    };
    let radius = mm(half.min(depth.max(1e-4)));
    let segment = |a: [Point3; 2], b: [Point3; 2]| hull_of_balls(&[a[0], a[1], b[0], b[1]], radius);
    let outward = |node: usize| normalize(sub(mesh.nodes[node], inner[node]));
    let mut cut = Vec::new();
    let mut edges = BTreeSet::new();
    for (bore, way) in bores.iter().zip(&ways_of) {
        let (start, at) = (way[0], way[way.len() - 1]);
        let place = inner_end(bore, options);
        cut.push(segment(balls(place, bore.normal), balls(inner[start], outward(start))));
        edges.extend(way.windows(2).map(|step| [step[0].min(step[1]), step[0].max(step[1])]));
        let beyond = add(inner[at], scale(ways.out_of(at, mesh, &inner), options.channel_width_m));
        cut.push(segment(balls(inner[at], outward(at)), balls(beyond, outward(at))));
    }
    cut.extend(edges.into_iter().map(|[a, b]| segment(balls(inner[a], outward(a)), balls(inner[b], outward(b)))));
    Ok(cut)
}

/// The middle of a bore on the inner face.
fn inner_end(bore: &Bore, options: &FabricationOptions) -> Point3 {
    sub(bore.centre_m, scale(bore.normal, options.wall_m))
}

/// The most wires that lie in one channel of a body from a mesh file; `None` for other bodies and without channels.
pub(crate) fn most_wires(fabrication: &Fabrication) -> Option<usize> {
    let mesh = fabrication.body_mesh.as_ref().filter(|mesh| !mesh.boundary.is_empty())?;
    let inner: Vec<Point3> = shell::inner_m(mesh, fabrication.options.wall_m);
    let bores: Vec<Bore> = fabrication.electrodes.iter().map(|one| one.bore).collect();
    let mut wires = vec![0; inner.len()];
    for node in Ways::new(mesh, &inner).of(&bores, &fabrication.options).into_iter().flatten() {
        wires[node] += 1;
    }
    wires.into_iter().max()
}

/// Shortest ways along edges to the boundary (Dijkstra, 1959, DOI 10.1007/BF01386390).
struct Ways<'a> {
    inner: &'a [Point3],
    /// The next node of each; `None` on the boundary.
    next: Vec<Option<usize>>,
}

impl<'a> Ways<'a> {
    fn new(mesh: &BodyMesh, inner: &'a [Point3]) -> Self {
        let mut neighbours = vec![BTreeSet::new(); inner.len()];
        for &[a, b, c] in &mesh.triangles {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                neighbours[from].insert(to);
                neighbours[to].insert(from);
            }
        }
        let mut length_m = vec![f64::INFINITY; inner.len()];
        let mut next = vec![None; inner.len()];
        let mut open = BinaryHeap::new();
        for &node in mesh.boundary.iter().flatten() {
            length_m[node] = 0.0;
            open.push(Reverse((Length(0.0), node)));
        }
        while let Some(Reverse((Length(so_far_m), node))) = open.pop() {
            if so_far_m > length_m[node] {
                continue;
            }
            for &other in &neighbours[node] {
                let by_m = so_far_m + distance(inner[node], inner[other]);
                if by_m < length_m[other] {
                    (length_m[other], next[other]) = (by_m, Some(node));
                    open.push(Reverse((Length(by_m), other)));
                }
            }
        }
        Ways { inner, next }
    }

    /// The nodes from each bore to the edge.
    fn of(&self, bores: &[Bore], options: &FabricationOptions) -> Vec<Vec<usize>> {
        let way = |bore: &Bore| {
            let start = self.nearest_node(inner_end(bore, options));
            std::iter::successors(Some(start), |&at| self.next[at]).collect()
        };
        bores.iter().map(way).collect()
    }

    fn nearest_node(&self, place: Point3) -> usize {
        let nearest = (0..self.inner.len())
            .min_by(|&a, &b| distance(self.inner[a], place).total_cmp(&distance(self.inner[b], place)));
        nearest.expect("a surface has nodes")
    }

    /// The direction out of the body at a node of the boundary: away from the mean of its triangles.
    fn out_of(&self, node: usize, mesh: &BodyMesh, inner: &[Point3]) -> Point3 {
        let own = mesh.triangles.iter().filter(|triangle| triangle.contains(&node));
        let away = own.flatten().fold([0.0; 3], |sum, &corner| add(sum, sub(inner[node], inner[corner])));
        normalize(away)
    }
}

/// A length that can be ordered.
#[derive(Debug, PartialEq)]
struct Length(f64);

impl Eq for Length {}

impl PartialOrd for Length {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Length {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}
