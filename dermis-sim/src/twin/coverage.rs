//! The part of the sheet below each patch, and the moments of the potential there.

use super::TwinError;
use super::patches::PatchGrid;
use crate::quadrature::{gauss_legendre, triangle_points};
use dermis::forward::{ConductorMoments, PotentialMoments};
use dermis::geom::vector::bounding_box;
use dermis::geom::{Point2, Point3, polygon};
use dermis::linalg::Matrix;
use dermis::mesh::{Cells, Mesh};
use pulp::{Arch, Simd, WithSimd};
use std::sync::Arc;

/// A patch with less than this fraction of its area on the body has no contact.
const SMALLEST_SHARE: f64 = 1e-4;
/// A patch that fills its bounding box within this tolerance is a rectangle; one that fills its shape is whole.
const WHOLE: f64 = 1e-9;
/// A function whose norm squared, after projection onto the complement of the others, is below this fraction is
/// linearly dependent: rounding leaves 1e-16, and above this limit a second pass corrects the errors of the first.
const MIN_OWN: f64 = 1e-10;
/// Points along each side of a patch at which the pressure is evaluated. With the patches of `lab` on `cylinder30`, 8
/// differ from 16 by 0.3 % of a press's change of the frame (0.7 % at worst), 5 by 0.7 % (1.9 %).
const POINTS_PER_SIDE: usize = 8;

/// Memory for the pieces of a patch: as many as those under a patch of twice the size of a cell.
const USUAL_PIECES: usize = 24;

/// The points of a patch at which the pressure is evaluated.
#[derive(Debug, Clone)]
pub(super) struct Cover {
    /// Points in the chart with their areas, m2.
    pub points: Vec<(Point2, f64)>,
    /// Shared by all rectangles.
    functions: Arc<Functions>,
}

/// The values of a patch's functions at its points.
#[derive(Debug)]
struct Functions {
    count: usize,
    /// The products of two functions, points x pairs: a lower triangle row by row.
    products: Matrix,
}

impl Functions {
    /// From a list of values for each point.
    fn new(count: usize, values: &[Vec<f64>]) -> Arc<Self> {
        let mut products = Matrix::zeros(values.len(), count * (count + 1) / 2);
        for (index, values) in values.iter().enumerate() {
            let pairs = values.iter().enumerate().flat_map(|(k, value)| values[..=k].iter().map(move |l| value * l));
            products.row_mut(index).iter_mut().zip(pairs).for_each(|(product, value)| *product = value);
        }
        Arc::new(Functions { count, products })
    }
}

impl Cover {
    /// `C_kl = integral of g phi_k phi_l`, S, from the conductance per area at each point.
    pub(super) fn conductance(&self, mut conductance_s_per_m2: impl FnMut(usize, Point2) -> f64) -> Matrix {
        let points = self.points.iter().enumerate();
        self.conductance_of(
            &points.map(|(index, (point, _))| conductance_s_per_m2(index, *point)).collect::<Vec<f64>>(),
        )
    }

    /// The same from a list of the conductances per area.
    pub(super) fn conductance_of(&self, conductances_s_per_m2: &[f64]) -> Matrix {
        let Functions { count, products } = &*self.functions;
        let mut sums = vec![0.0; products.columns];
        Arch::new().dispatch(Sums { points: &self.points, conductances_s_per_m2, products, sums: &mut sums });
        let mut matrix = Matrix::zeros(*count, *count);
        let mut sums = sums.into_iter();
        for k in 0..*count {
            for (l, sum) in (0..=k).zip(&mut sums) {
                *matrix.at_mut(k, l) = sum;
                *matrix.at_mut(l, k) = sum;
            }
        }
        matrix
    }
}

/// The integrals of a conductance per area times each product.
struct Sums<'a> {
    points: &'a [(Point2, f64)],
    conductances_s_per_m2: &'a [f64],
    products: &'a Matrix,
    sums: &'a mut [f64],
}

impl WithSimd for Sums<'_> {
    type Output = ();

    /// Compiled once per instruction set, with the same bits: no operation is fused.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let columns = self.products.columns;
        let rows = self.products.values.chunks_exact(columns.max(1));
        for ((&(_, area), value), products) in self.points.iter().zip(self.conductances_s_per_m2).zip(rows) {
            let conductance_s = area * value;
            if conductance_s != 0.0 {
                for (sum, product) in self.sums.iter_mut().zip(products) {
                    *sum += conductance_s * product;
                }
            }
        }
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
    let places: Vec<Point2> = mesh.nodes.iter().map(|&node| grid.chart.unroll(node)).collect();
    let mut memory = [Vec::new(), Vec::new()];
    for triangle in triangles {
        cut(grid, &places, triangle, wanted, &mut memory, &mut pieces);
    }
    let mut polynomials = Polynomials::new(degree);
    let rectangle = Rectangle::new(&mut polynomials);
    let mut row_of_node = vec![usize::MAX; mesh.nodes.len()];
    let (mut moments, mut covers) = (Vec::new(), Vec::new());
    for (patch, pieces) in pieces.iter().enumerate() {
        let whole = grid.area_m2(patch);
        let area: f64 = pieces.iter().map(|piece| polygon::signed_area(&piece.part).abs()).sum();
        if area < SMALLEST_SHARE * whole {
            moments.push(ConductorMoments::none());
            covers.push(None);
            continue;
        }
        let points = ((area / whole - 1.0).abs() < WHOLE).then(|| grid.points(patch)).flatten();
        let basis = Basis::new(pieces, area, points, &rectangle, &mut polynomials);
        moments.push(basis.moments(pieces, &mut polynomials, &mut row_of_node));
        covers.push(Some(basis.cover(&rectangle, &mut polynomials)));
    }
    Ok((PotentialMoments::new(moments), covers))
}

/// Adds the parts of one triangle to the patches above it.
fn cut(
    grid: &PatchGrid,
    places: &[Point2],
    nodes: &[usize; 3],
    wanted: Option<&[bool]>,
    memory: &mut [Vec<Point2>; 2],
    pieces: &mut [Vec<Piece>],
) {
    let first = places[nodes[0]];
    let corners = nodes.map(|node| {
        let step = grid.chart.difference(first, places[node]);
        [first[0] + step[0], first[1] + step[1]]
    });
    let [low, high] = bounding_box(corners);
    grid.visit_between(low, high, |patch, shift| {
        if wanted.is_some_and(|wanted| !wanted[patch]) {
            return;
        }
        let triangle = corners.map(|corner| [corner[0] - shift, corner[1]]);
        grid.clip_in(patch, &triangle, memory);
        let part = &memory[0];
        let Some(&origin) = part.first() else { return };
        for pair in part.windows(2).skip(1) {
            let part = [origin, pair[0], pair[1]];
            if polygon::signed_area(&part) != 0.0 {
                let pieces = &mut pieces[patch];
                if pieces.is_empty() {
                    pieces.reserve(USUAL_PIECES);
                }
                pieces.push(Piece { nodes: *nodes, triangle, part });
            }
        }
    });
}

/// Eight pieces at once.
const LANES: usize = 8;
type Lanes = [f64; LANES];

/// Products `P_i(x) P_j(y)` of Legendre polynomials up to a degree, by `i + j`, then by `j`, orthonormal in the mean over a
/// square, evaluated in the same memory.
struct Polynomials {
    /// The norm of each polynomial of one variable, and the inverse of its degree plus 1.
    factors: Vec<[f64; 2]>,
    along: [Vec<Lanes>; 2],
    /// At the points of [`PieceSums`], points x products.
    values: Vec<Lanes>,
    /// The integrals of [`PieceSums`].
    sums: Vec<Lanes>,
    /// At one point.
    products: Vec<f64>,
}

impl Polynomials {
    fn new(degree: usize) -> Self {
        let count = (degree + 1) * (degree + 2) / 2;
        let factors = |n: usize| [(2.0 * n as f64 + 1.0).sqrt(), 1.0 / (n as f64 + 1.0)];
        Polynomials {
            factors: (0..=degree).map(factors).collect(),
            along: [0, 1].map(|_| vec![[0.0; LANES]; degree + 1]),
            values: vec![[0.0; LANES]; POINTS * count],
            sums: vec![[0.0; LANES]; 3 * count],
            products: vec![0.0; count],
        }
    }

    /// The products at a point of the square from -1 to 1.
    fn at(&mut self, point: Point2) -> &[f64] {
        let Polynomials { factors, along, values, products: own, .. } = self;
        let count = own.len();
        products(factors, &point.map(|t| [t; LANES]), along, &mut values[..count]);
        own.iter_mut().zip(&*values).for_each(|(product, lanes)| *product = lanes[0]);
        own
    }
}

/// The products at some points.
#[inline(always)]
fn products(factors: &[[f64; 2]], point: &[Lanes; 2], along: &mut [Vec<Lanes>; 2], products: &mut [Lanes]) {
    for (values, t) in along.iter_mut().zip(point) {
        legendre(factors, t, values);
    }
    let [x, y] = along;
    let mut index = 0;
    for total in 0..factors.len() {
        for j in 0..=total {
            let (x, y) = (&x[total - j], &y[j]);
            for lane in 0..LANES {
                products[index][lane] = x[lane] * y[lane];
            }
            index += 1;
        }
    }
}

/// Some pieces in lanes. Those without a piece repeat the last one.
struct PieceLanes {
    /// Corners x axes.
    part: [[Lanes; 2]; 3],
    triangle: [[Lanes; 2]; 3],
    /// The area of the part over that of the patch and over twice the signed area of the triangle.
    scale: Lanes,
}

impl PieceLanes {
    /// Compiled without wide instructions, whose gathers are slow.
    fn new(pieces: &[Piece], patch_area_m2: f64) -> Self {
        let mut lanes = PieceLanes { part: [[[0.0; 8]; 2]; 3], triangle: [[[0.0; 8]; 2]; 3], scale: [0.0; 8] };
        for lane in 0..LANES {
            let Piece { part, triangle, .. } = &pieces[lane.min(pieces.len() - 1)];
            for corner in 0..3 {
                for axis in 0..2 {
                    lanes.part[corner][axis][lane] = part[corner][axis];
                    lanes.triangle[corner][axis][lane] = triangle[corner][axis];
                }
            }
            lanes.scale[lane] =
                polygon::signed_area(part).abs() / patch_area_m2 / (2.0 * polygon::signed_area(triangle));
        }
        lanes
    }
}

/// Points of a triangle, [`triangle_points`].
const POINTS: usize = 7;

/// The integrals over pieces of the products times each of the shape functions of their triangles, over the patch's area.
struct PieceSums<'a> {
    polynomials: &'a mut Polynomials,
    /// Barycentric coordinates of the points of a triangle, and their weights.
    rule: &'a [(Point3, f64); POINTS],
    basis: &'a Basis,
    pieces: &'a PieceLanes,
}

impl<'a> WithSimd for PieceSums<'a> {
    /// Shape functions x products.
    type Output = &'a [Lanes];

    /// Compiled once per instruction set, with the same bits: no operation is fused.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let PieceSums { polynomials, rule, basis, pieces: PieceLanes { part, triangle, scale } } = self;
        let Polynomials { factors: degrees, along, values, sums, .. } = polynomials;
        let count = values.len() / POINTS;
        let inverse = basis.half.map(f64::recip);
        let mut factors = [[[0.0; LANES]; 3]; POINTS];
        for (point, &(corners, weight)) in rule.iter().enumerate() {
            let (mut at, mut inside) = ([[0.0; LANES]; 2], [[0.0; LANES]; 2]);
            for axis in 0..2 {
                for lane in 0..LANES {
                    at[axis][lane] = part[0][axis][lane] * corners[0]
                        + part[1][axis][lane] * corners[1]
                        + part[2][axis][lane] * corners[2];
                    inside[axis][lane] = (at[axis][lane] - basis.middle[axis]) * inverse[axis];
                }
            }
            products(degrees, &inside, along, &mut values[point * count..][..count]);
            for corner in 0..3 {
                // Twice the area of the triangle of the point and the other two corners, over that of the whole.
                let ([ax, ay], [bx, by]) = (&triangle[(corner + 1) % 3], &triangle[(corner + 2) % 3]);
                for lane in 0..LANES {
                    let (x, y) = (at[0][lane], at[1][lane]);
                    let twice = (ax[lane] - x) * (by[lane] - y) - (bx[lane] - x) * (ay[lane] - y);
                    factors[point][corner][lane] = twice * (scale[lane] * weight);
                }
            }
        }
        for corner in 0..3 {
            for product in 0..count {
                let mut sum = [0.0; LANES];
                for (point, factors) in factors.iter().enumerate() {
                    let value = &values[point * count + product];
                    for lane in 0..LANES {
                        sum[lane] += factors[corner][lane] * value[lane];
                    }
                }
                sums[corner * count + product] = sum;
            }
        }
        sums
    }
}

/// The points of all rectangles, and the functions there.
struct Rectangle {
    /// In the square from -1 to 1, with weights whose sum is 1.
    points: Vec<(Point2, f64)>,
    functions: Arc<Functions>,
}

impl Rectangle {
    fn new(polynomials: &mut Polynomials) -> Self {
        let rule = gauss_legendre(POINTS_PER_SIDE);
        let pairs = rule.iter().flat_map(|&(s, v)| rule.iter().map(move |&(t, w)| ([s, t], 0.25 * v * w)));
        let points: Vec<(Point2, f64)> = pairs.collect();
        let values: Vec<Vec<f64>> = points.iter().map(|(point, _)| polynomials.at(*point).to_vec()).collect();
        Rectangle { functions: Functions::new(polynomials.products.len(), &values), points }
    }
}

/// The functions of one patch.
struct Basis {
    area: f64,
    middle: Point2,
    half: Point2,
    points: Vec<(Point2, f64)>,
    /// The functions as combinations of the products of Legendre polynomials, functions x products; `None` on a
    /// rectangle, whose functions are the products.
    combinations: Option<Matrix>,
}

impl Basis {
    /// The functions of the patch that consists of some parts, with the points of its shape if it is whole.
    fn new(
        pieces: &[Piece],
        area: f64,
        whole: Option<Vec<(Point2, f64)>>,
        rectangle: &Rectangle,
        polynomials: &mut Polynomials,
    ) -> Self {
        let [low, high] = bounding_box(pieces.iter().flat_map(|piece| piece.part));
        let half = [0.5 * (high[0] - low[0]), 0.5 * (high[1] - low[1])];
        let middle = [low[0] + half[0], low[1] + half[1]];
        let mut basis = Basis { area, middle, half, points: Vec::new(), combinations: None };
        if (4.0 * half[0] * half[1] / area - 1.0).abs() < WHOLE {
            let at = |[s, t]: Point2| [middle[0] + half[0] * s, middle[1] + half[1] * t];
            basis.points = rectangle.points.iter().map(|&(point, weight)| (at(point), weight * area)).collect();
        } else {
            basis.points = whole.unwrap_or_else(|| pieces.iter().flat_map(Piece::points).collect());
            basis.orthonormalise(polynomials);
        }
        basis
    }

    /// Gram-Schmidt in the mean over the points, twice: after one pass the rounding error is of the order of the
    /// condition number.
    fn orthonormalise(&mut self, polynomials: &mut Polynomials) {
        let count = polynomials.products.len();
        let mut combinations = Matrix::identity(count);
        for _ in 0..2 {
            for k in 0..count {
                self.combinations = Some(combinations);
                let values: Vec<Vec<f64>> =
                    self.points.iter().map(|(point, _)| self.values(*point, polynomials)).collect();
                let mean = |i: usize, j: usize| {
                    let terms = values.iter().zip(&self.points).map(|(values, (_, area))| values[i] * values[j] * area);
                    terms.sum::<f64>() / self.area
                };
                let overlaps: Vec<f64> = (0..k).map(|earlier| mean(k, earlier)).collect();
                let own = mean(k, k);
                let rest = own - overlaps.iter().map(|o| o * o).sum::<f64>();
                // On a sliver the functions are linearly dependent up to rounding: dependent ones are set to zero.
                let factor = if rest > MIN_OWN * own { 1.0 / rest.sqrt() } else { 0.0 };
                combinations = self.combinations.take().unwrap_or_else(|| Matrix::zeros(count, count));
                for column in 0..count {
                    let taken: f64 = overlaps.iter().enumerate().map(|(i, o)| o * combinations.at(i, column)).sum();
                    let value = (combinations.at(k, column) - taken) * factor;
                    *combinations.at_mut(k, column) = value;
                }
            }
        }
        self.combinations = Some(combinations);
    }

    /// A point in the coordinates of the polynomials.
    fn inside(&self, point: Point2) -> Point2 {
        [0, 1].map(|axis| (point[axis] - self.middle[axis]) / self.half[axis])
    }

    /// The functions at a point.
    fn values(&self, point: Point2, polynomials: &mut Polynomials) -> Vec<f64> {
        let products = polynomials.at(self.inside(point));
        self.combine(products)
    }

    /// The functions from the products.
    fn combine(&self, products: &[f64]) -> Vec<f64> {
        let Some(combinations) = &self.combinations else { return products.to_vec() };
        let combine = |k: usize| combinations.row(k).iter().zip(products).map(|(c, p)| c * p).sum();
        (0..combinations.rows).map(combine).collect()
    }

    /// The mean of each function times the potential. `row_of_node` is memory: no node has a row before and after.
    fn moments(&self, pieces: &[Piece], polynomials: &mut Polynomials, row_of_node: &mut [usize]) -> ConductorMoments {
        let count = polynomials.products.len();
        let mut nodes: Vec<usize> = Vec::with_capacity(pieces.len());
        for piece in pieces {
            for node in piece.nodes {
                if row_of_node[node] == usize::MAX {
                    row_of_node[node] = nodes.len();
                    nodes.push(node);
                }
            }
        }
        nodes.sort_unstable();
        nodes.iter().enumerate().for_each(|(row, &node)| row_of_node[node] = row);
        // The integrals of the products times each node's shape function, node by node.
        let mut integrals = Matrix::zeros(nodes.len(), count);
        let rule = triangle_points(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        for pieces in pieces.chunks(LANES) {
            let lanes = PieceLanes::new(pieces, self.area);
            let sums = Arch::new().dispatch(PieceSums { polynomials, rule: &rule, basis: self, pieces: &lanes });
            for (lane, piece) in pieces.iter().enumerate() {
                for (&node, sums) in piece.nodes.iter().zip(sums.chunks_exact(count)) {
                    integrals
                        .row_mut(row_of_node[node])
                        .iter_mut()
                        .zip(sums)
                        .for_each(|(sum, value)| *sum += value[lane]);
                }
            }
        }
        nodes.iter().for_each(|&node| row_of_node[node] = usize::MAX);
        if self.combinations.is_some() {
            (0..nodes.len()).for_each(|row| {
                let combined = self.combine(integrals.row(row));
                integrals.row_mut(row).copy_from_slice(&combined);
            });
        }
        ConductorMoments { nodes, weights: integrals }
    }

    fn cover(self, rectangle: &Rectangle, polynomials: &mut Polynomials) -> Cover {
        let functions = match &self.combinations {
            None => rectangle.functions.clone(),
            Some(combinations) => {
                let values: Vec<Vec<f64>> =
                    self.points.iter().map(|(point, _)| self.values(*point, polynomials)).collect();
                Functions::new(combinations.rows, &values)
            }
        };
        Cover { points: self.points, functions }
    }
}

/// Legendre polynomials, orthonormal in the mean over -1 to 1: one for each degree with its [`Polynomials::factors`].
#[inline(always)]
fn legendre(factors: &[[f64; 2]], t: &Lanes, values: &mut [Lanes]) {
    let (mut before, mut now) = ([0.0; LANES], [1.0; LANES]);
    for (n, (&[norm, inverse], value)) in factors.iter().zip(values).enumerate() {
        let n = n as f64;
        for lane in 0..LANES {
            value[lane] = now[lane] * norm;
            let next = ((2.0 * n + 1.0) * t[lane] * now[lane] - n * before[lane]) * inverse;
            (before[lane], now[lane]) = (now[lane], next);
        }
    }
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
            let mut polynomials = Polynomials::new(2);
            let rectangle = Rectangle::new(&mut polynomials);
            let basis = Basis::new(&[piece], area, None, &rectangle, &mut polynomials);
            let cover = basis.cover(&rectangle, &mut polynomials);
            let count = polynomials.products.len();
            let gram = |i: usize, j: usize| cover.conductance(|_, _| 1.0).at(i, j) / area;
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
