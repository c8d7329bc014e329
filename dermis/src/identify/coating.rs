//! The coating's unevenness as a Gaussian field with few coefficients.

use crate::geom::Point3;
use crate::geom::vector::distance;
use crate::linalg::{Cholesky, Matrix, NotPositiveDefinite};
use crate::mesh::Mesh;

/// Spacing of the field's points over its correlation length. The covariance between points half a length apart is
/// interpolated to better than 1 % of the variance, below the errors of the identification.
const SPACING: f64 = 0.5;
/// Maximum number of points: more make the equations slow and add detail that no frame resolves.
const MAX_POINTS: usize = 300;
/// Added to the variances of the points, so that their covariance stays positive definite.
const JITTER: f64 = 1e-4;

/// A field with the covariance `exp(-d^2 / (2 l^2))` on the cells of a mesh: `basis x`, with independent unit normal
/// coefficients `x`, cells x coefficients. `d` is the straight-line distance: this covariance is positive definite in
/// space, but not along a closed surface.
///
/// The field is the conditional mean given its values at some cells (a Gaussian process with inducing points:
/// Quinonero-Candela and Rasmussen, 2005, JMLR 6, Eq. 9).
pub(super) fn basis(mesh: &Mesh, length_m: f64) -> Result<Matrix, NotPositiveDefinite> {
    let centres: Vec<Point3> = (0..mesh.cell_count()).map(|cell| mesh.cell_centre(cell)).collect();
    let mut spacing_m = SPACING * length_m;
    let mut points = spread(&centres, spacing_m);
    while points.len() > MAX_POINTS {
        spacing_m *= 1.2;
        points = spread(&centres, spacing_m);
    }
    let kernel = |a: Point3, b: Point3| (-0.5 * (distance(a, b) / length_m).powi(2)).exp();
    let count = points.len();
    let mut covariance = Matrix::zeros(count, count);
    for (i, &a) in points.iter().enumerate() {
        for (j, &b) in points.iter().enumerate() {
            *covariance.at_mut(i, j) = kernel(a, b) + if i == j { JITTER } else { 0.0 };
        }
    }
    let factor = Cholesky::new(&covariance)?;
    let mut basis = Matrix::zeros(centres.len(), count);
    for (row, &centre) in basis.values.chunks_exact_mut(count).zip(&centres) {
        // Row L' = k.
        row.iter_mut().zip(&points).for_each(|(value, &point)| *value = kernel(centre, point));
        factor.forward_substitute(row);
    }
    Ok(basis)
}

/// A subset of points, each at least a distance from all before it.
fn spread(points: &[Point3], spacing_m: f64) -> Vec<Point3> {
    let mut chosen: Vec<Point3> = Vec::new();
    for &point in points {
        if chosen.iter().all(|&other| distance(point, other) >= spacing_m) {
            chosen.push(point);
        }
    }
    chosen
}
