//! Fast rasterisation of Gaussian touches on the cells of a mesh.
//!
//! The results equal those of [`GaussianTouch::add_cell_means`], for many touches on one mesh. The quadrature points of
//! every cell are computed once, in coordinates in which distances along the surface are straight-line distances; eight
//! neighbouring cells form a block, one in each SIMD lane; only blocks near a touch are evaluated.

use crate::dataset::DatasetError;
use crate::dataset::quadrature::Rule;
use crate::elementary::{Chart, unrolled};
use crate::touch::GaussianTouch;
use dermis::geom::vector::{bounding_box, longest_edge};
use dermis::geom::{Point3, Surface};
use dermis::linalg::{LANES, SimdLevel};
use dermis::mesh::{Cells, Mesh};
use pulp::{Simd, WithSimd};

/// Distance in widths beyond which a Gaussian is neglected: exp(-5.5^2 / 2) = 2.7e-7 of its amplitude.
const REACH_WIDTHS: f64 = 5.5;
/// Limit of exponents, so that the series for the exponential stays in its range: exp(-32) = 1.3e-14.
const LARGEST_EXPONENT: f64 = 32.0;
/// Maximum subdivision level: a mesh cannot resolve a touch of an eighth of a cell's edge.
const MAX_DIVISIONS: usize = 3;
/// A block's lane without a cell.
const NO_CELL: u32 = u32::MAX;

/// The cells of a mesh, prepared for Gaussian touches.
#[derive(Debug, Clone)]
pub(crate) struct CellRaster {
    chart: Chart,
    /// Coordinates of a point: two on a surface that can be unrolled, three in space.
    dimensions: usize,
    rule: Rule,
    weights: Vec<f64>,
    blocks: Vec<Block>,
    /// Per block, level and point: each coordinate of eight cells.
    points: Vec<[f64; LANES]>,
    level: SimdLevel,
}

/// Eight neighbouring cells.
#[derive(Debug, Clone)]
struct Block {
    centre: Point3,
    radius_m: f64,
    longest_edge_m: f64,
    cells: [u32; LANES],
    /// The index of the first point of each level.
    starts: Vec<usize>,
}

/// One cell during the construction of blocks.
struct Item {
    cell: usize,
    centre: Point3,
}

impl CellRaster {
    /// The raster of a mesh for touches with a width of at least `least_width_m`, with a chosen instruction set.
    ///
    /// # Errors
    /// A width far below the cells of the mesh.
    pub(super) fn at_level(
        surface: Surface,
        mesh: &Mesh,
        least_width_m: f64,
        level: SimdLevel,
    ) -> Result<Self, DatasetError> {
        let rule = match mesh.cells {
            Cells::Triangles(_) => Rule::Triangle,
            Cells::Tetrahedra(_) => Rule::Tetrahedron,
        };
        let flat_sheet = surface == Surface::Plane && mesh.nodes.iter().all(|node| node[2] == 0.0);
        let dimensions = if flat_sheet || matches!(surface, Surface::Cylinder { .. }) { 2 } else { 3 };
        let chart = unrolled(&surface);
        let mut items: Vec<Item> = (0..mesh.cell_count())
            .map(|cell| Item { cell, centre: chart.unroll_in_space(mesh.cell_centre(cell)) })
            .collect();
        sort_by_place(&mut items, dimensions);
        let mut raster = CellRaster {
            chart,
            dimensions,
            rule,
            weights: rule.weights(),
            blocks: Vec::with_capacity(items.len().div_ceil(LANES)),
            points: Vec::new(),
            level,
        };
        for block in items.chunks(LANES) {
            raster.add_block(mesh, block, least_width_m)?;
        }
        Ok(raster)
    }

    fn add_block(&mut self, mesh: &Mesh, items: &[Item], least_width_m: f64) -> Result<(), DatasetError> {
        let corners: Vec<Vec<Point3>> = (items.iter())
            .map(|item| mesh.cells.corners(item.cell).iter().map(|&node| mesh.nodes[node]).collect())
            .collect();
        let longest = corners.iter().map(|corners| longest_edge(corners)).fold(0.0, f64::max);
        let levels = self.rule.level(longest, least_width_m);
        if levels > MAX_DIVISIONS {
            return Err(DatasetError::OutOfRange {
                what: "the width of touches in m",
                value: least_width_m,
                must: format!("no narrower than the mesh can carry: its cells measure up to {longest:.4} m"),
            });
        }
        let mut cells = [NO_CELL; LANES];
        for (lane, item) in cells.iter_mut().zip(items) {
            *lane = u32::try_from(item.cell).expect("a mesh has fewer cells than 32 bits count");
        }
        let centre = items[items.len() / 2].centre;
        let away = |corner: &Point3| self.chart.squared_distance_m2(centre, self.chart.unroll_in_space(*corner));
        let radius_m = corners.iter().flatten().map(away).fold(0.0, f64::max).sqrt();
        let mut starts = Vec::with_capacity(levels + 1);
        for level in 0..=levels {
            starts.push(self.points.len());
            let points: Vec<Vec<Point3>> = corners.iter().map(|corners| self.rule.points(corners, level)).collect();
            for point in 0..points[0].len() {
                // Lanes without a cell repeat the first cell.
                let of_lane = |lane: usize| self.chart.unroll_in_space(points.get(lane).unwrap_or(&points[0])[point]);
                let lanes: [Point3; LANES] = std::array::from_fn(of_lane);
                for axis in 0..self.dimensions {
                    self.points.push(lanes.map(|point| point[axis]));
                }
            }
        }
        self.blocks.push(Block { centre, radius_m, longest_edge_m: longest, cells, starts });
        Ok(())
    }

    /// Moves the quadrature points of some cells with their nodes, for another skin of the design. `original` is the
    /// raster of the undeformed mesh, `shifts_m` the displacement of each node (around, along; or x, y).
    ///
    /// Points move by the weighted mean of their corners' shifts, with larger weights for nearer corners. Only blocks
    /// that contain a cell with `is_movable` are updated: the others never move.
    pub(super) fn follow(&mut self, original: &CellRaster, mesh: &Mesh, movable: &[bool], shifts_m: &[[f64; 2]]) {
        let shares = original.shares();
        for (block, (own, from)) in self.blocks.iter_mut().zip(&original.blocks).enumerate() {
            if !from.cells.iter().any(|&cell| cell != NO_CELL && movable[cell as usize]) {
                continue;
            }
            // Lanes without a cell follow the first cell, as in the raster itself.
            let nodes = |lane: usize| {
                let cell = if from.cells[lane] == NO_CELL { from.cells[0] } else { from.cells[lane] };
                mesh.cells.corners(cell as usize)
            };
            let corners: [[[f64; 2]; 3]; LANES] =
                std::array::from_fn(|lane| std::array::from_fn(|corner| shifts_m[nodes(lane)[corner]]));
            let squares = corners.iter().flatten().map(|shift| shift[0] * shift[0] + shift[1] * shift[1]);
            own.radius_m = from.radius_m + squares.fold(0.0, f64::max).sqrt();
            let last = original.blocks.get(block + 1).map_or(original.points.len(), |next| next.starts[0]);
            for (level, &start) in from.starts.iter().enumerate() {
                let end = from.starts.get(level + 1).copied().unwrap_or(last);
                for (index, share) in (start..end).step_by(2).zip(&shares[level]) {
                    for axis in 0..2 {
                        let moved = &mut self.points[index + axis];
                        for (lane, value) in moved.iter_mut().enumerate() {
                            let [a, b, c] = corners[lane];
                            let shift = share[0] * a[axis] + share[1] * b[axis] + share[2] * c[axis];
                            *value = original.points[index + axis][lane] + shift;
                        }
                    }
                }
            }
        }
    }

    /// For each level and point of a cell, the weights of its corners.
    fn shares(&self) -> Vec<Vec<Point3>> {
        let levels = self.blocks.iter().map(|block| block.starts.len()).max().unwrap_or(0);
        let corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        (0..levels).map(|level| self.rule.points(&corners, level)).collect()
    }

    /// Calls `add(cell, mean)` with the mean of a touch's change over every cell within its range, once per cell.
    ///
    /// Equal to [`GaussianTouch::add_cell_means`] within 5e-6 of the amplitude.
    pub(crate) fn for_each_mean(&self, touch: &GaussianTouch, mut add: impl FnMut(usize, f64)) {
        let centre = self.chart.unroll_in_space(touch.centre_m);
        let reach_m = REACH_WIDTHS * touch.width_m;
        let run = Means { raster: self, centre, reach_m, touch, add: &mut add };
        self.level.arch().dispatch(run);
    }
}

/// Sorts cells so that neighbouring cells are adjacent: recursive bisection along the longer side, in whole blocks.
fn sort_by_place(items: &mut [Item], dimensions: usize) {
    if items.len() <= LANES {
        return;
    }
    let [low, high] = bounding_box(items.iter().map(|item| item.centre));
    let extent = |axis: usize| high[axis] - low[axis];
    let axis = (0..dimensions).max_by(|&a, &b| extent(a).total_cmp(&extent(b))).unwrap_or(0);
    let half = items.len().div_ceil(LANES).div_ceil(2) * LANES;
    let half = half.min(items.len() - 1);
    items.select_nth_unstable_by(half, |a, b| a.centre[axis].total_cmp(&b.centre[axis]).then(a.cell.cmp(&b.cell)));
    let (low, high) = items.split_at_mut(half);
    sort_by_place(low, dimensions);
    sort_by_place(high, dimensions);
}

struct Means<'a, F> {
    raster: &'a CellRaster,
    centre: Point3,
    reach_m: f64,
    touch: &'a GaussianTouch,
    add: &'a mut F,
}

impl<F: FnMut(usize, f64)> WithSimd for Means<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let raster = self.raster;
        let per_square = 0.5 / (self.touch.width_m * self.touch.width_m);
        let mut sums = [0.0; LANES];
        for block in &raster.blocks {
            let reach_m = self.reach_m + block.radius_m;
            if raster.chart.squared_distance_m2(block.centre, self.centre) > reach_m * reach_m {
                continue;
            }
            let level = raster.rule.level(block.longest_edge_m, self.touch.width_m);
            let count = raster.rule.part_count(level) * raster.weights.len();
            let start = block.starts[level];
            let points = &raster.points[start..start + count * raster.dimensions];
            match (raster.dimensions, raster.chart.period_m()) {
                (2, Some(period_m)) => {
                    block_sums(simd, Wrapped { centre: self.centre, period_m }, points, raster, per_square, &mut sums)
                }
                (2, None) => block_sums(simd, Flat::<2>(self.centre), points, raster, per_square, &mut sums),
                _ => block_sums(simd, Flat::<3>(self.centre), points, raster, per_square, &mut sums),
            }
            let share = self.touch.amplitude / raster.rule.part_count(level) as f64;
            for (&cell, &sum) in block.cells.iter().zip(&sums) {
                if cell != NO_CELL {
                    (self.add)(cell as usize, share * sum);
                }
            }
        }
    }
}

/// The distances of points from a centre.
trait SquaredDistance: Copy {
    const DIMENSIONS: usize;

    /// The squared distances of as many cells as a vector has lanes, m2.
    fn squares<S: Simd>(self, simd: S, point: &[[f64; LANES]], pass: usize) -> S::f64s;
}

/// Straight-line distances in `D` coordinates.
#[derive(Clone, Copy)]
struct Flat<const D: usize>(Point3);

impl<const D: usize> SquaredDistance for Flat<D> {
    const DIMENSIONS: usize = D;

    #[inline(always)]
    fn squares<S: Simd>(self, simd: S, point: &[[f64; LANES]], pass: usize) -> S::f64s {
        let mut squares = simd.splat_f64s(0.0);
        for (place, centre) in point.iter().zip(self.0).take(D) {
            let off = simd.sub_f64s(S::as_simd_f64s(place).0[pass], simd.splat_f64s(centre));
            squares = simd.mul_add_e_f64s(off, off, squares);
        }
        squares
    }
}

/// Distances on a cylinder, the shorter way around.
#[derive(Clone, Copy)]
struct Wrapped {
    centre: Point3,
    period_m: f64,
}

impl SquaredDistance for Wrapped {
    const DIMENSIONS: usize = 2;

    #[inline(always)]
    fn squares<S: Simd>(self, simd: S, point: &[[f64; LANES]], pass: usize) -> S::f64s {
        let off =
            |axis: usize| simd.sub_f64s(S::as_simd_f64s(&point[axis]).0[pass], simd.splat_f64s(self.centre[axis]));
        let round = simd.abs_f64s(off(0));
        let round = simd.min_f64s(round, simd.sub_f64s(simd.splat_f64s(self.period_m), round));
        let along = off(1);
        simd.mul_add_e_f64s(along, along, simd.mul_f64s(round, round))
    }
}

/// The weighted sums of `exp(-d^2 / (2 w^2))` over the points of eight cells.
#[inline(always)]
fn block_sums<S: Simd, D: SquaredDistance>(
    simd: S,
    distance: D,
    points: &[[f64; LANES]],
    raster: &CellRaster,
    per_square: f64,
    sums: &mut [f64; LANES],
) {
    for pass in 0..LANES / S::F64_LANES {
        let mut sum = simd.splat_f64s(0.0);
        for part in points.chunks_exact(raster.weights.len() * D::DIMENSIONS) {
            for (point, &weight) in part.chunks_exact(D::DIMENSIONS).zip(&raster.weights) {
                let exponent = simd.mul_f64s(distance.squares(simd, point, pass), simd.splat_f64s(per_square));
                let exponent = simd.min_f64s(exponent, simd.splat_f64s(LARGEST_EXPONENT));
                sum = simd.mul_add_e_f64s(simd.splat_f64s(weight), exp_of_minus(simd, exponent), sum);
            }
        }
        S::as_mut_simd_f64s(sums.as_mut_slice()).0[pass] = sum;
    }
}

/// `exp(-t)` for `t` from 0 to [`LARGEST_EXPONENT`]: the series at `x = -t / 64`, squared six times.
///
/// With `|x| <= 1/2` and nine terms after the first the relative error is at most `64 (1/2)^10 / 10! = 2e-8`, for the
/// smallest values; in the important range `t < 8` it is 1e-14.
#[inline(always)]
fn exp_of_minus<S: Simd>(simd: S, t: S::f64s) -> S::f64s {
    const INVERSE_FACTORIALS: [f64; 9] =
        [1.0 / 40320.0, 1.0 / 5040.0, 1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    let x = simd.mul_f64s(t, simd.splat_f64s(-1.0 / 64.0));
    let mut value = simd.splat_f64s(1.0 / 362_880.0);
    for factor in INVERSE_FACTORIALS {
        value = simd.mul_add_e_f64s(value, x, simd.splat_f64s(factor));
    }
    for _ in 0..6 {
        value = simd.mul_f64s(value, value);
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::places::Places;
    use crate::random::sample_rng;
    use dermis::design::SkinDesign;
    use rand::RngExt;

    /// Largest difference from the reference rasteriser, relative to the amplitude, for touches of the given widths.
    fn worst(surface: Surface, mesh: &Mesh, places: &Places, widths_m: [f64; 2], level: SimdLevel) -> f64 {
        let raster = CellRaster::at_level(surface, mesh, widths_m[0], level).unwrap();
        let mut worst = 0.0f64;
        for index in 0..60 {
            let mut rng = sample_rng(11, index);
            let centre_m = places.draw(&mut rng);
            let width_m = rng.random_range(widths_m[0]..widths_m[1]);
            let touch = GaussianTouch { centre_m, amplitude: 0.7, width_m };
            let mut plain = vec![0.0; mesh.cell_count()];
            touch.add_cell_means(&surface, mesh, &mut plain);
            let mut seen = vec![false; mesh.cell_count()];
            raster.for_each_mean(&touch, |cell, mean| {
                assert!(!std::mem::replace(&mut seen[cell], true), "cell {cell} came twice");
                plain[cell] -= mean;
            });
            worst = plain.iter().fold(worst, |worst, off| worst.max(off.abs() / 0.7));
        }
        worst
    }

    /// The quadrature error for a cell as long as the width of the touch; the reference rasteriser also has it. It
    /// subdivides by each cell's own edge, this one by the longest edge of eight cells.
    const TOLERANCE: f64 = 5e-6;

    #[test]
    fn the_error_that_is_left_is_that_of_the_quadrature() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let mesh = Mesh::generate(&design).unwrap();
        let (surface, places) = (design.body.surface(), Places::new(&design.body, &mesh));
        let raster = CellRaster::at_level(surface, &mesh, 0.004, SimdLevel::best()).unwrap();
        let mut worst = 0.0f64;
        for index in 0..4 {
            let centre_m = places.draw(&mut sample_rng(12, index));
            let touch = GaussianTouch { centre_m, amplitude: 1.0, width_m: 0.0045 };
            raster.for_each_mean(&touch, |cell, mean| {
                let corners: Vec<Point3> = mesh.cells.corners(cell).iter().map(|&node| mesh.nodes[node]).collect();
                let points = Rule::Triangle.points(&corners, 3);
                let weights = Rule::Triangle.weights();
                let sum: f64 =
                    points.iter().zip(weights.iter().cycle()).map(|(&p, w)| w * touch.value(&surface, p)).sum();
                worst = worst.max((mean - sum / 64.0).abs());
            });
        }
        println!("off from a quadrature of 448 points by {worst:.1e} of the amplitude");
        assert!(worst < TOLERANCE, "{worst}");
    }

    #[test]
    fn the_fast_raster_equals_the_plain_one_at_every_level() {
        for name in ["cylinder30", "tank16"] {
            let design = SkinDesign::shipped(name).unwrap();
            let mesh = Mesh::generate(&design).unwrap();
            let (surface, places) = (design.body.surface(), Places::new(&design.body, &mesh));
            for level in SimdLevel::available() {
                let off = worst(surface, &mesh, &places, [0.004, 0.02], level);
                println!("{name} at {level:?}: off by {off:.1e} of the amplitude");
                assert!(off < TOLERANCE, "{off}");
            }
        }
    }

    #[test]
    fn wide_touches_meet_round_the_cylinder() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let mesh = Mesh::generate(&design).unwrap();
        let places = Places::new(&design.body, &mesh);
        assert!(worst(design.body.surface(), &mesh, &places, [0.04, 0.1], SimdLevel::best()) < TOLERANCE);
    }

    #[test]
    fn a_mesh_in_space_and_a_volume_are_rastered_too() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let mesh = Mesh::generate(&design).unwrap();
        let places = Places::new(&design.body, &mesh);
        assert!(worst(Surface::Free, &mesh, &places, [0.005, 0.02], SimdLevel::best()) < TOLERANCE);
        let nodes = vec![[0.0; 3], [0.02, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.02], [0.02, 0.02, 0.02]];
        let cells = Cells::Tetrahedra(vec![[0, 1, 2, 3], [1, 2, 3, 4]]);
        let volume = Mesh { nodes, cells, electrodes: vec![], regions: vec![] };
        let body = dermis::design::Body::Mesh { file: "block.msh".into(), unit_m: 1.0 };
        let places = Places::new(&body, &volume);
        // The reference rule subdivides each cell by its own longest edge, this one both in the same way.
        assert!(worst(Surface::Free, &volume, &places, [0.008, 0.02], SimdLevel::best()) < 2e-3);
    }

    #[test]
    fn a_raster_that_follows_its_nodes_is_that_of_the_mesh_they_make() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let mesh = Mesh::generate(&design).unwrap();
        let surface = design.body.surface();
        let original = CellRaster::at_level(surface, &mesh, 0.005, SimdLevel::best()).unwrap();
        // A smooth field of shifts of up to 1.4 mm that is zero at the rims; only nodes with z above 60 mm move.
        let shift = |node: &Point3| match node[2] > 0.06 {
            true => [1e-3 * (20.0 * node[0]).sin(), 1e-3 * (10.5 * (node[2] - 0.06)).sin()],
            false => [0.0; 2],
        };
        let shifts: Vec<[f64; 2]> = mesh.nodes.iter().map(shift).collect();
        let movable: Vec<bool> = (0..mesh.cell_count())
            .map(|cell| mesh.cells.corners(cell).iter().any(|&node| mesh.nodes[node][2] > 0.06))
            .collect();
        let nodes = mesh.nodes.iter().zip(&shifts).map(|(&node, &shift)| surface.walk(node, shift)).collect();
        let moved = Mesh { nodes, ..mesh.clone() };
        let mut raster = original.clone();
        // The result does not depend on earlier updates.
        raster.follow(&original, &mesh, &movable, &vec![[5e-4, -5e-4]; mesh.node_count()]);
        raster.follow(&original, &mesh, &movable, &shifts);
        let (mut worst, mut worst_left_behind) = (0.0f64, 0.0f64);
        for index in 0..40 {
            let centre_m = Places::new(&design.body, &mesh).draw(&mut sample_rng(13, index));
            let touch = GaussianTouch { centre_m, amplitude: 1.0, width_m: 0.007 };
            let mut plain = vec![0.0; mesh.cell_count()];
            touch.add_cell_means(&surface, &moved, &mut plain);
            let off = |raster: &CellRaster, worst: &mut f64| {
                let mut off = plain.clone();
                raster.for_each_mean(&touch, |cell, mean| off[cell] -= mean);
                *worst = off.iter().fold(*worst, |worst, off| worst.max(off.abs()));
            };
            off(&raster, &mut worst);
            off(&original, &mut worst_left_behind);
        }
        println!("a raster that followed is off by {worst:.1e}, one that did not by {worst_left_behind:.1e}");
        assert!(worst_left_behind > 0.05, "{worst_left_behind}");
        // Points of a chord follow it on the cylinder to second order.
        assert!(worst < 1e-4, "{worst}");
    }

    #[test]
    fn touches_that_the_mesh_cannot_carry_are_refused() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let mesh = Mesh::generate(&design).unwrap();
        let error = CellRaster::at_level(design.body.surface(), &mesh, 5e-4, SimdLevel::best()).unwrap_err();
        assert!(error.to_string().contains("0.0005: it must be no narrower"), "{error}");
    }
}
