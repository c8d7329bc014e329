//! The part of the sheet below each patch, and the moments of the potential there.

use super::TwinError;
use super::patches::PatchGrid;
use crate::quadrature::{gauss_legendre, triangle_points};
use dermis::forward::{PotentialMoment, PotentialMoments};
use dermis::geom::{Point2, polygon};
use dermis::linalg::Matrix;
use dermis::mesh::{Cells, Mesh};
use std::collections::BTreeMap;

/// A patch with less than this fraction of its area on the body has no contact.
const SMALLEST_SHARE: f64 = 1e-4;
/// A patch that fills its bounding box within this tolerance is a rectangle; one that fills its shape is whole.
const WHOLE: f64 = 1e-9;
/// A function whose norm squared, after projection onto the complement of the others, is below this fraction is
/// linearly dependent: rounding leaves 1e-16, and above this limit a second pass corrects the errors of the first.
const LEAST_OWN: f64 = 1e-10;
/// Points along each side of a patch at which the pressure is evaluated. With the patches of `lab` on `cylinder30`, 8
/// differ from 16 by 0.3 % of a press's change of the frame (0.7 % at worst), 5 by 0.7 % (1.9 %).
const POINTS_PER_SIDE: usize = 8;

/// The points of a patch at which the pressure is evaluated.
#[derive(Debug, Clone)]
pub(super) struct Cover {
    /// Points in the chart with their areas, m2.
    pub points: Vec<(Point2, f64)>,
    /// The functions' values, points x functions.
    pub values: Matrix,
}

impl Cover {
    /// `C_kl = integral of g phi_k phi_l`, S, from the conductance per area at each point.
    pub(super) fn conductance(&self, mut conductance_s_per_m2: impl FnMut(usize, Point2) -> f64) -> Matrix {
        let order = self.values.columns;
        let mut sum = Matrix::zeros(order, order);
        for (index, &(point, area)) in self.points.iter().enumerate() {
            let conductance_s = area * conductance_s_per_m2(index, point);
            if conductance_s == 0.0 {
                continue;
            }
            let row = self.values.row(index);
            for (k, value) in row.iter().enumerate() {
                let factor = conductance_s * value;
                sum.row_mut(k).iter_mut().zip(row).for_each(|(sum, other)| *sum += factor * other);
            }
        }
        sum
    }
}

/// A part of a triangle of the mesh under a patch, in the chart of the patch.
struct Piece {
    nodes: [usize; 3],
    triangle: [Point2; 3],
    part: [Point2; 3],
}

impl Piece {
    /// Points of the part with their areas, m2.
    fn points(&self) -> [(Point2, f64); 7] {
        let area = polygon::signed_area(&self.part).abs();
        triangle_points(&self.part).map(|(point, weight)| (point, weight * area))
    }
}

/// For each patch the moments of the potential with polynomials up to a degree, orthonormal in the mean over the patch.
/// The first is the mean. Patches without contact have no moments.
///
/// The functions are products of Legendre polynomials on a rectangle; on a patch of another shape they are
/// orthogonalised by Gram-Schmidt. Integrals of shape functions are computed part by part, exactly up to degree 4.
pub(super) fn cover(
    grid: &PatchGrid,
    mesh: &Mesh,
    degree: usize,
    wanted: Option<&[bool]>,
) -> Result<(PotentialMoments, Vec<Option<Cover>>), TwinError> {
    let Cells::Triangles(triangles) = &mesh.cells else { return Err(TwinError::NoChart) };
    let mut pieces: Vec<Vec<Piece>> = (0..grid.patch_count()).map(|_| Vec::new()).collect();
    for triangle in triangles {
        cut(grid, mesh, triangle, wanted, &mut pieces);
    }
    let (mut moments, mut covers) = (Vec::new(), Vec::new());
    for (patch, pieces) in pieces.iter().enumerate() {
        let whole = grid.area_m2(patch);
        let area: f64 = pieces.iter().map(|piece| polygon::signed_area(&piece.part).abs()).sum();
        if area < SMALLEST_SHARE * whole {
            covers.push(None);
            continue;
        }
        let points = ((area / whole - 1.0).abs() < WHOLE).then(|| grid.points(patch)).flatten();
        let basis = Basis::new(pieces, area, degree, points);
        moments.extend(basis.moments(pieces).into_iter().map(|nodes| PotentialMoment { conductor: patch, nodes }));
        covers.push(Some(basis.cover()));
    }
    Ok((PotentialMoments::new(moments), covers))
}

/// Adds the parts of one triangle to the patches above it.
fn cut(grid: &PatchGrid, mesh: &Mesh, nodes: &[usize; 3], wanted: Option<&[bool]>, pieces: &mut [Vec<Piece>]) {
    let chart = |node: usize| grid.surface.chart(mesh.nodes[node]);
    let first = chart(nodes[0]);
    let corners = nodes.map(|node| {
        let step = grid.surface.chart_step(first, chart(node));
        [first[0] + step[0], first[1] + step[1]]
    });
    let ([left, bottom], [right, top]) = bounds(corners.iter());
    for (patch, shift) in grid.patches_between([left, bottom], [right, top]) {
        if wanted.is_some_and(|wanted| !wanted[patch]) {
            continue;
        }
        let triangle = corners.map(|corner| [corner[0] - shift, corner[1]]);
        let part = grid.clip(patch, &triangle);
        let Some(&origin) = part.first() else { continue };
        for pair in part.windows(2).skip(1) {
            let part = [origin, pair[0], pair[1]];
            if polygon::signed_area(&part) != 0.0 {
                pieces[patch].push(Piece { nodes: *nodes, triangle, part });
            }
        }
    }
}

fn bounds<'a>(points: impl Iterator<Item = &'a Point2>) -> (Point2, Point2) {
    points.fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(low, high), point| {
        ([low[0].min(point[0]), low[1].min(point[1])], [high[0].max(point[0]), high[1].max(point[1])])
    })
}

/// The functions of one patch.
struct Basis {
    degree: usize,
    area: f64,
    middle: Point2,
    half: Point2,
    points: Vec<(Point2, f64)>,
    /// The functions as combinations of the products of Legendre polynomials, functions x products.
    combinations: Matrix,
}

impl Basis {
    /// The functions of the patch that consists of some parts, with the points of its shape if it is whole.
    fn new(pieces: &[Piece], area: f64, degree: usize, whole: Option<Vec<(Point2, f64)>>) -> Self {
        let (low, high) = bounds(pieces.iter().flat_map(|piece| &piece.part));
        let half = [0.5 * (high[0] - low[0]), 0.5 * (high[1] - low[1])];
        let middle = [low[0] + half[0], low[1] + half[1]];
        let count = (degree + 1) * (degree + 2) / 2;
        let mut combinations = Matrix::zeros(count, count);
        (0..count).for_each(|k| *combinations.at_mut(k, k) = 1.0);
        let mut basis = Basis { degree, area, middle, half, points: Vec::new(), combinations };
        if (4.0 * half[0] * half[1] / area - 1.0).abs() < WHOLE {
            let rule = gauss_legendre(POINTS_PER_SIDE);
            let at = |s: f64, t: f64| [middle[0] + half[0] * s, middle[1] + half[1] * t];
            let products = rule.iter().flat_map(|&(s, v)| rule.iter().map(move |&(t, w)| (s, t, v * w)));
            basis.points = products.map(|(s, t, weight)| (at(s, t), 0.25 * weight * area)).collect();
        } else {
            basis.points = whole.unwrap_or_else(|| pieces.iter().flat_map(Piece::points).collect());
            basis.orthonormalise();
        }
        basis
    }

    /// Gram-Schmidt in the mean over the points, twice: after one pass the rounding error is of the order of the
    /// condition number.
    fn orthonormalise(&mut self) {
        let count = self.combinations.rows;
        for _ in 0..2 {
            for k in 0..count {
                let values: Vec<Vec<f64>> = self.points.iter().map(|(point, _)| self.values(*point)).collect();
                let mean = |i: usize, j: usize| {
                    let terms = values.iter().zip(&self.points).map(|(values, (_, area))| values[i] * values[j] * area);
                    terms.sum::<f64>() / self.area
                };
                let overlaps: Vec<f64> = (0..k).map(|earlier| mean(k, earlier)).collect();
                let own = mean(k, k);
                let rest = own - overlaps.iter().map(|o| o * o).sum::<f64>();
                // On a sliver the functions are linearly dependent up to rounding: dependent ones are set to zero.
                let factor = if rest > LEAST_OWN * own { 1.0 / rest.sqrt() } else { 0.0 };
                for column in 0..count {
                    let taken: f64 =
                        overlaps.iter().enumerate().map(|(i, o)| o * self.combinations.at(i, column)).sum();
                    let value = (self.combinations.at(k, column) - taken) * factor;
                    *self.combinations.at_mut(k, column) = value;
                }
            }
        }
    }

    /// The functions at a point.
    fn values(&self, point: Point2) -> Vec<f64> {
        let along = |axis: usize| legendre(self.degree, (point[axis] - self.middle[axis]) / self.half[axis]);
        let (x, y) = (along(0), along(1));
        let degrees = (0..=self.degree).flat_map(|total| (0..=total).map(move |j| (total - j, j)));
        let products: Vec<f64> = degrees.map(|(i, j)| x[i] * y[j]).collect();
        let combine = |k: usize| self.combinations.row(k).iter().zip(&products).map(|(c, p)| c * p).sum();
        (0..self.combinations.rows).map(combine).collect()
    }

    /// The mean of each function times the potential, as weights of the nodes.
    fn moments(&self, pieces: &[Piece]) -> Vec<Vec<(usize, f64)>> {
        let count = self.combinations.rows;
        let mut weights: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for piece in pieces {
            let whole = polygon::signed_area(&piece.triangle);
            for (point, area) in piece.points() {
                let values = self.values(point);
                for (corner, &node) in piece.nodes.iter().enumerate() {
                    let mut opposite = piece.triangle;
                    opposite[corner] = point;
                    let shape = polygon::signed_area(&opposite) / whole;
                    let target = weights.entry(node).or_insert_with(|| vec![0.0; count]);
                    target.iter_mut().zip(&values).for_each(|(sum, value)| *sum += value * shape * area / self.area);
                }
            }
        }
        (0..count).map(|k| weights.iter().map(|(&node, weights)| (node, weights[k])).collect()).collect()
    }

    fn cover(&self) -> Cover {
        let mut values = Matrix::zeros(self.points.len(), self.combinations.rows);
        for (index, (point, _)) in self.points.iter().enumerate() {
            values.row_mut(index).copy_from_slice(&self.values(*point));
        }
        Cover { points: self.points.clone(), values }
    }
}

/// Legendre polynomials up to a degree, orthonormal in the mean over -1 to 1.
fn legendre(degree: usize, t: f64) -> Vec<f64> {
    let mut values = vec![1.0, t];
    for n in 1..degree {
        let next = ((2 * n + 1) as f64 * t * values[n] - n as f64 * values[n - 1]) / (n + 1) as f64;
        values.push(next);
    }
    values.iter().take(degree + 1).enumerate().map(|(n, value)| value * ((2 * n + 1) as f64).sqrt()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_stay_orthonormal_or_vanish_however_thin_a_patch_is_cut() {
        for thickness_m in [1e-3, 1e-6, 1e-8, 1e-10, 1e-13] {
            let part = [[0.0, 0.0], [1e-2, 1e-2], [1e-2, 1e-2 + thickness_m]];
            let piece = Piece { nodes: [0, 1, 2], triangle: part, part };
            let area = polygon::signed_area(&part).abs();
            let cover = Basis::new(&[piece], area, 2, None).cover();
            let count = cover.values.columns;
            let gram = |i: usize, j: usize| {
                let terms = cover.points.iter().enumerate();
                let term =
                    |(p, (_, share)): (usize, &(Point2, f64))| cover.values.at(p, i) * cover.values.at(p, j) * share;
                terms.map(term).sum::<f64>() / area
            };
            let kept = (0..count).filter(|&k| gram(k, k) > 0.5).count();
            println!("{thickness_m} m: {kept} of {count} functions are left");
            assert!(kept >= 3, "those along the sliver are never lost");
            for (i, j) in (0..count).flat_map(|i| (0..=i).map(move |j| (i, j))) {
                let expected = if i == j && gram(i, i) > 0.5 { 1.0 } else { 0.0 };
                assert!((gram(i, j) - expected).abs() < 1e-5, "{i} {j}: {}", gram(i, j));
            }
        }
    }
}
