//! Delaunay triangulation of points in the unrolled body, periodic around a cylinder.

use crate::geom::{Chart, Point2};
use crate::mesh::MeshError;
use spade::{ConstrainedDelaunayTriangulation, Point2 as SpadePoint, Triangulation};

/// The constrained Delaunay triangles of some points; the constraints are edges of the triangulation.
///
/// On a cylinder the points near the seam are repeated one period away on both sides. The triangulation of a periodic
/// set is periodic if the copies are exact and no four points are on a circle. Of a triangle's copies the one whose
/// first point is the original is kept.
pub(super) fn triangulate(
    chart: &Chart,
    points: &[Point2],
    constraints: &[[usize; 2]],
    reach: f64,
) -> Result<Vec<[usize; 3]>, MeshError> {
    let (copies, copied_edges) = match chart.period_m() {
        Some(period) => unrolled(chart, points, constraints, period, reach),
        None => {
            let copies = points.iter().zip(0..).map(|(&place, point)| Placed { place, point, turn: 0 }).collect();
            (copies, constraints.to_vec())
        }
    };
    let vertices = copies.iter().map(|copy| SpadePoint::new(copy.place[0], copy.place[1])).collect();
    let triangulation = ConstrainedDelaunayTriangulation::<SpadePoint<f64>>::bulk_load_cdt(vertices, copied_edges)
        .map_err(|error| MeshError::Generate(format!("a point of the mesh cannot be placed: {error}")))?;
    if triangulation.num_vertices() != copies.len() {
        return Err(MeshError::Generate("two points of the mesh fall together".into()));
    }
    let mut triangles = Vec::with_capacity(2 * points.len());
    for face in triangulation.inner_faces() {
        let corners = face.vertices().map(|vertex| copies[vertex.fix().index()]);
        let first = corners.iter().min_by_key(|copy| copy.point).expect("a triangle has corners");
        if first.turn == 0 {
            triangles.push(corners.map(|copy| copy.point));
        }
    }
    Ok(triangles)
}

/// A point in the triangulation.
#[derive(Debug, Clone, Copy)]
struct Placed {
    place: Point2,
    point: usize,
    turn: i8,
}

/// Coordinate units per period: coordinates are integers small enough that adding a period is exact.
const PARTS: f64 = (1u64 << 44) as f64;

/// Points are perturbed by up to this number of units, 4e-12 of a period, depending on their index, so that the four
/// points of no two triangles are on a circle, where copies could be divided differently.
const NUDGE: u64 = 64;

/// Points, in these units, and constraints with their copies one period away, within `reach` of the seam.
fn unrolled(
    chart: &Chart,
    points: &[Point2],
    constraints: &[[usize; 2]],
    period: f64,
    reach: f64,
) -> (Vec<Placed>, Vec<[usize; 2]>) {
    let mut copies = Vec::with_capacity(points.len() * 5 / 4);
    let mut index_of = vec![[None; 3]; points.len()];
    for (slot, turn) in [0i8, -1, 1].into_iter().enumerate() {
        let shift = f64::from(turn) * period;
        for (index, &point) in points.iter().enumerate() {
            if turn == 0 || (-reach..period + reach).contains(&(point[0] + shift)) {
                let [x, y] = nudged(point, index, period, chart.depth_m(point) > 0.0);
                index_of[index][slot] = Some(copies.len());
                copies.push(Placed { place: [x + f64::from(turn) * PARTS, y], point: index, turn });
            }
        }
    }
    let mut edges = Vec::new();
    for &[a, b] in constraints {
        for from in index_of[a].into_iter().flatten() {
            let near = |to: usize| (copies[to].place[0] - copies[from].place[0]).abs() < 0.5 * PARTS;
            edges.extend(index_of[b].into_iter().flatten().find(|&to| near(to)).map(|to| [from, to]));
        }
    }
    (copies, edges)
}

/// A point in these units, perturbed depending on its index; a point of the body's edge stays on it.
fn nudged(point: Point2, index: usize, period: f64, is_inside: bool) -> Point2 {
    // Knuth's multiplicative hash, its upper bits.
    let pattern = (index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let nudge = |bits: u64| (bits % (2 * NUDGE)) as f64 - NUDGE as f64;
    let [x, y] = point.map(|coordinate| (coordinate / period * PARTS).round());
    [x + nudge(pattern >> 32), if is_inside { y + nudge(pattern >> 48) } else { y }]
}
