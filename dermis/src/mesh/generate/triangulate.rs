//! Delaunay triangulation of points in the unrolled body, closed round a cylinder.

use super::domain::Domain;
use crate::geom::vector::Point2;
use crate::mesh::MeshError;
use spade::{ConstrainedDelaunayTriangulation, Point2 as SpadePoint, Triangulation};

/// The constrained Delaunay triangles of some points; the constraints are edges of it.
///
/// On a cylinder the points near the seam are repeated one turn away on both sides, and of the triangles' copies the one
/// whose centre lies in the turn `[0, period)` is kept: the triangulation of a periodic set is periodic.
pub(super) fn triangulate(
    domain: &Domain,
    points: &[Point2],
    constraints: &[[usize; 2]],
    reach: f64,
) -> Result<Vec<[usize; 3]>, MeshError> {
    let mut copies: Vec<(Point2, usize)> = points.iter().copied().zip(0..).collect();
    let mut copied_edges = constraints.to_vec();
    if let Some(period) = domain.period() {
        (copies, copied_edges) = unrolled(domain, points, constraints, period, reach);
    }
    let vertices = copies.iter().map(|(point, _)| SpadePoint::new(point[0], point[1])).collect();
    let triangulation = ConstrainedDelaunayTriangulation::<SpadePoint<f64>>::bulk_load_cdt(vertices, copied_edges)
        .map_err(|error| MeshError::Generate(format!("a point of the mesh cannot be placed: {error}")))?;
    if triangulation.num_vertices() != copies.len() {
        return Err(MeshError::Generate("two points of the mesh fall together".into()));
    }
    let mut triangles = Vec::with_capacity(2 * points.len());
    for face in triangulation.inner_faces() {
        let corners = face.vertices().map(|vertex| vertex.fix().index());
        let centre = corners.iter().map(|&corner| copies[corner].0[0]).sum::<f64>() / 3.0;
        if domain.period().is_none_or(|period| (0.0..period).contains(&centre)) {
            triangles.push(corners.map(|corner| copies[corner].1));
        }
    }
    Ok(triangles)
}

/// Points and constraints with their copies one turn away, within `reach` of the seam.
fn unrolled(
    domain: &Domain,
    points: &[Point2],
    constraints: &[[usize; 2]],
    period: f64,
    reach: f64,
) -> (Vec<(Point2, usize)>, Vec<[usize; 2]>) {
    let mut copies = Vec::with_capacity(points.len() * 5 / 4);
    let mut index_of = vec![[None; 3]; points.len()];
    for (turn, shift) in [0.0, -period, period].into_iter().enumerate() {
        for (index, point) in points.iter().enumerate() {
            let round = point[0] + shift;
            if turn == 0 || (-reach..period + reach).contains(&round) {
                index_of[index][turn] = Some(copies.len());
                copies.push(([round, point[1]], index));
            }
        }
    }
    let mut edges = Vec::new();
    for &[a, b] in constraints {
        for from in index_of[a].into_iter().flatten() {
            let near = |to: usize| (copies[to].0[0] - copies[from].0[0]).abs() < 0.5 * period;
            edges.extend(index_of[b].into_iter().flatten().find(|&to| near(to)).map(|to| [from, to]));
        }
    }
    debug_assert!(domain.period().is_some());
    (copies, edges)
}
