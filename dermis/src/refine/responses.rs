//! The response of a frame to touches of any place and form.

use super::cubes::Cubes;
use super::form::{Density, Form};
use super::places::{Place, Space};
use super::{RefineError, RefineOptions};
use crate::design::Body;
use crate::estimate::drift::{DriftSpread, directions};
use crate::estimate::reciprocal_pairs::ReciprocalPairs;
use crate::estimate::whitening::Whitening;
use crate::fem::Gradients;
use crate::forward::ForwardModel;
use crate::frame::quantities;
use crate::geom::vector::{add, cross, dot, scale, sub};
use crate::geom::{Point2, Point3};
use crate::linalg::{Matrix, add_scaled};
use crate::mesh::Mesh;
use faer::{Mat, MatRef, Side};
use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashSet};

/// Least width of a touch over the edge length of the cells: a density is sampled at the centres of the cells.
const MIN_WIDTH: f64 = 0.6;
/// Directions of the values in which touches change a frame by less than this part of the largest are left out.
const MIN_PART: f64 = 1e-3;
/// Cells are taken together where their mean area is less than this part of the square of a touch's width.
const FEW_IN_CUBE: f64 = 0.25;
/// One of this many cells is used to find them.
const BASIS_STRIDE: usize = 8;
/// Values of a table are as many as a multiple of this.
const BLOCK: usize = 32;
/// Distance of the places at which a touch is looked for over the usual width: a fit finds one from there.
const SEARCH_STEP: f64 = 1.8;
/// Places that are searched together, in registers.
const PLACES: usize = 64;
/// Distance of the places of a search from each other over the usual width.
const APART: f64 = 5.0;

/// Columns of a response: three of the tensor, and those of the place, the width and the segment.
pub(super) const COLUMNS: usize = 8;

/// The change of the values by a touch of unit strength and its derivatives.
#[derive(Debug, Clone)]
pub(super) struct Response {
    /// By column, the values: for the even tensor and the two uneven ones, then the derivatives of the touch with its own
    /// tensor by the centre (two, per m), the logarithm of the width, the vector of the segment (two, per m).
    pub columns: [Vec<f64>; COLUMNS],
    /// The covariance of the centre, m2, by independent changes of the conductance of unit area: of the first axis, of both,
    /// of the second.
    pub grain_m2: [f64; 3],
}

/// The responses of one skin with one noise.
#[derive(Debug, Clone)]
pub(super) struct Responses {
    space: Space,
    usual_m: f64,
    area_m2: f64,
    /// Cells of the mesh, or several together; by their cubes.
    cells: Vec<Cell>,
    cubes: Cubes,
    /// By cell, the values of the three tensors.
    table: Vec<f32>,
    count: usize,
    /// From whitened values to those of the table.
    basis: Matrix,
    /// The channels of each value, with their weights.
    values: Vec<Vec<(usize, f64)>>,
    /// Standard deviation of each value, ohm.
    sd_ohm: Vec<f64>,
    whitening: Whitening,
    channel_count: usize,
    /// Of the usable channels.
    pairs: ReciprocalPairs,
    searched: Vec<Place>,
    /// By block of places and value, the unit vectors of the responses of round, even touches.
    search_table: Vec<f32>,
}

#[derive(Debug, Clone, Copy)]
struct Cell {
    place: Place,
    area_m2: f64,
}

/// The part of a touch on one cell.
struct Part {
    cell: usize,
    /// The density and its derivatives; the area of the cell is in the table.
    weights: [f32; 6],
    /// Cosine and sine of twice the angle from the axes of the touch to those of the cell.
    double: [f32; 2],
}

impl Responses {
    pub(super) fn new(
        body: &Body,
        model: &ForwardModel,
        noise_ohm: &[f64],
        options: &RefineOptions,
    ) -> Result<Self, RefineError> {
        let (values, sd_ohm) = values(model, noise_ohm);
        if values.is_empty() {
            return Err(RefineError::NoChannel);
        }
        let mesh = model.mesh();
        let space = Space::new(body, mesh);
        let (cubes, parts) = parts(mesh, options.width_m);
        let cell = |part: &Vec<usize>| {
            let area_m2 = part.iter().map(|&cell| mesh.cell_measure(cell)).sum();
            Cell { place: space.place(centre(mesh, part)), area_m2 }
        };
        let cells: Vec<Cell> = parts.iter().map(cell).collect();
        let area_m2: f64 = cells.iter().map(|cell| cell.area_m2).sum();
        let edge_m = (4.0 / 3f64.sqrt() * area_m2 / cells.len() as f64).sqrt();
        let mut responses = Responses {
            space,
            usual_m: options.width_m.max(MIN_WIDTH * edge_m),
            area_m2,
            cells,
            cubes,
            table: Vec::new(),
            count: 0,
            basis: Matrix::zeros(0, values.len()),
            values,
            sd_ohm,
            whitening: Whitening::default(),
            channel_count: noise_ohm.len(),
            pairs: ReciprocalPairs::new(model.protocol(), noise_ohm)
                .with_rest(&model.solve(model.rest_conductivity())?),
            searched: Vec::new(),
            search_table: Vec::new(),
        };
        let spread = DriftSpread {
            sheet: options.coating_drift,
            gradient: options.coating_drift,
            contact: options.contact_drift,
            ..DriftSpread::default()
        };
        let drifts = directions(model, &spread)?;
        responses.whitening = Whitening::new((0..drifts.rows).map(|row| responses.over_noise(drifts.row(row))));
        responses.fill(model, &parts)?;
        responses.prepare_search();
        Ok(responses)
    }

    /// Computes the table: the whitened change of the values by each tensor on each cell, in a basis of what touches change.
    fn fill(&mut self, model: &ForwardModel, parts: &[Vec<usize>]) -> Result<(), RefineError> {
        let potentials = model.potentials(model.rest_conductivity())?;
        let of_cell = |index: usize| self.changes(model, &potentials, &parts[index], &self.cells[index].place);
        let sample: Vec<Vec<f64>> =
            (0..parts.len()).into_par_iter().step_by(BASIS_STRIDE).flat_map_iter(of_cell).collect();
        let basis = basis(&sample);
        let count = basis.rows.next_multiple_of(BLOCK);
        let mut table = vec![0.0f32; parts.len() * 3 * count];
        let project = |(index, rows): (usize, &mut [f32])| {
            let mut projected = vec![0.0; basis.rows];
            for (row, change) in rows.chunks_exact_mut(count).zip(of_cell(index)) {
                basis.product_into(&change, &mut projected);
                row.iter_mut().zip(&projected).for_each(|(out, value)| *out = *value as f32);
            }
        };
        table.par_chunks_exact_mut(3 * count).enumerate().for_each(project);
        (self.table, self.basis, self.count) = (table, basis, count);
        Ok(())
    }

    /// The whitened changes of the values by a relative change of the conductance of some cells, over its area: even, along the
    /// first axis less along the second, and along both. With the fields `u` of a drive and `m` of a measured pair the
    /// voltage changes by `-sigma (S grad u) . grad m` times the area (Geselowitz, 1971, DOI 10.1109/TBME.1971.4502787).
    fn changes(&self, model: &ForwardModel, potentials: &Matrix, cells: &[usize], place: &Place) -> [Vec<f64>; 3] {
        let mut changes = [const { Vec::new() }; 3];
        changes.iter_mut().for_each(|change| change.resize(self.values.len(), 0.0));
        cells.iter().for_each(|&cell| self.add_changes(model, potentials, cell, place, &mut changes));
        changes.iter_mut().for_each(|change| self.whitening.apply(change));
        changes
    }

    /// Adds the changes by one cell, over the noise.
    fn add_changes(
        &self,
        model: &ForwardModel,
        potentials: &Matrix,
        cell: usize,
        place: &Place,
        changes: &mut [Vec<f64>; 3],
    ) {
        let gradients = Gradients::new(model.mesh(), cell);
        let corners = model.mesh().cells.corners(cell);
        let mut fields = vec![[0.0; 2]; potentials.columns];
        for (&node, &gradient) in corners.iter().zip(&gradients.of_corner) {
            let parts = [dot(gradient, place.axes[0]), dot(gradient, place.axes[1])];
            for (field, potential) in fields.iter_mut().zip(potentials.row(node)) {
                field[0] += parts[0] * potential;
                field[1] += parts[1] * potential;
            }
        }
        let factor = -model.rest_conductivity()[cell] * gradients.measure;
        let channels = model.protocol().channels();
        for (index, (value, sd)) in self.values.iter().zip(&self.sd_ohm).enumerate() {
            let mut sums = [0.0; 3];
            for &(channel, weight) in value {
                let [u, m] = [channels[channel].drive, channels[channel].measure]
                    .map(|[from, to]| [fields[from][0] - fields[to][0], fields[from][1] - fields[to][1]]);
                let over = weight * factor / sd;
                sums[0] += over * (u[0] * m[0] + u[1] * m[1]);
                sums[1] += over * (u[0] * m[0] - u[1] * m[1]);
                sums[2] += over * (u[0] * m[1] + u[1] * m[0]);
            }
            changes.iter_mut().zip(sums).for_each(|(change, sum)| change[index] += sum);
        }
    }

    /// One place in each cube of the search step, with its response.
    fn prepare_search(&mut self) {
        let step_m = SEARCH_STEP * self.usual_m;
        let mut taken = HashSet::new();
        let is_first = |cell: &&Cell| taken.insert(cell.place.point_m.map(|part| (part / step_m).floor() as i64));
        let places: Vec<Place> = self.cells.iter().filter(is_first).map(|cell| cell.place).collect();
        let responses = places.par_iter().map(|place| {
            let value = self.usual(place);
            let norm = crate::linalg::dot(&value, &value).sqrt().max(f64::MIN_POSITIVE);
            value.into_iter().map(|value| (value / norm) as f32).collect::<Vec<f32>>()
        });
        let responses: Vec<Vec<f32>> = responses.collect();
        let value =
            |block: &[Vec<f32>], value: usize, lane: usize| block.get(lane).map_or(0.0, |response| response[value]);
        let of_block = |block: &[Vec<f32>]| -> Vec<f32> {
            (0..self.count * PLACES).map(|k| value(block, k / PLACES, k % PLACES)).collect()
        };
        self.search_table = responses.chunks(PLACES).flat_map(of_block).collect();
        self.searched = places;
    }

    /// The places, apart from each other, at which a round touch explains values best, among those searched: where it decreases the
    /// sum of squares by more than some amount; the best first.
    pub(super) fn likeliest(&self, values: &[f64], most: usize, least: f64) -> Vec<Place> {
        let values: Vec<f32> = values.iter().map(|&value| value as f32).collect();
        let mut explained = vec![0.0; self.searched.len().next_multiple_of(PLACES)];
        pulp::Arch::new().dispatch(Search { table: &self.search_table, values: &values, explained: &mut explained });
        let least = least.sqrt() as f32;
        let mut possible: Vec<(&Place, f32)> =
            self.searched.iter().zip(explained).filter(|(_, explained)| *explained > least).collect();
        possible.sort_by(|a, b| b.1.total_cmp(&a.1));
        let apart_m = APART * self.usual_m;
        let mut found: Vec<Place> = Vec::new();
        for (place, _) in possible {
            if found.len() < most && found.iter().all(|other| self.space.distance_m(place, other) > apart_m) {
                found.push(*place);
            }
        }
        found
    }

    /// Takes reciprocal channels as they agree in an untouched frame.
    pub(super) fn set_rest(&mut self, rest_ohm: &[f64]) {
        self.pairs = self.pairs.clone().with_rest(rest_ohm);
    }

    /// The noise of a difference over that of the responses, as far as reciprocal channels tell it.
    ///
    /// # Panics
    /// If the difference has another length than the protocol.
    pub(super) fn noise_ratio(&self, difference: &[f64]) -> f64 {
        assert_eq!(difference.len(), self.channel_count, "a value per channel");
        self.pairs.noise_ratio(difference)
    }

    /// The values of a difference in the table's basis: noise of the given ratio and drift have unit covariance.
    pub(super) fn whitened(&self, difference: &[f64], noise_ratio: f64) -> Vec<f64> {
        let mut values = self.over_noise(difference);
        values.iter_mut().for_each(|value| *value /= noise_ratio);
        self.whitening.apply(&mut values);
        let mut projected = vec![0.0; self.count];
        self.basis.product_into(&values, &mut projected[..self.basis.rows]);
        projected
    }

    /// The part of a difference, of its square over the noise, that drift does not explain.
    pub(super) fn left_by_drift(&self, difference: &[f64]) -> f64 {
        let values = self.over_noise(difference);
        let mut left = values.clone();
        self.whitening.apply(&mut left);
        crate::linalg::dot(&left, &left) / crate::linalg::dot(&values, &values)
    }

    /// The values of a difference over their noise.
    fn over_noise(&self, difference: &[f64]) -> Vec<f64> {
        let value = |(value, sd): (&Vec<(usize, f64)>, &f64)| {
            value.iter().map(|&(channel, weight)| weight * difference[channel]).sum::<f64>() / sd
        };
        self.values.iter().zip(&self.sd_ohm).map(value).collect()
    }

    /// The change of a frame by a touch of a strength, ohm.
    pub(super) fn change(&self, place: &Place, form: &Form, uneven: Point2, strength_m2: f64) -> Vec<f64> {
        let [mut value, first, second, ..] = self.response(place, form, uneven).columns;
        add_scaled(&mut value, uneven[0], &first);
        add_scaled(&mut value, uneven[1], &second);
        let mut whitened = vec![0.0; self.values.len()];
        for (row, value) in value.iter().take(self.basis.rows).enumerate() {
            add_scaled(&mut whitened, *value, self.basis.row(row));
        }
        self.whitening.undo(&mut whitened);
        let mut change = vec![0.0; self.channel_count];
        for ((value, sd), response) in self.values.iter().zip(&self.sd_ohm).zip(&whitened) {
            for &(channel, weight) in value {
                change[channel] = strength_m2 * response * sd * weight.signum();
            }
        }
        change
    }

    pub(super) fn space(&self) -> &Space {
        &self.space
    }

    /// Standard deviation of a usual touch's change of conductance along the surface, m: that of the options, or more on a
    /// coarse mesh.
    pub(super) fn usual_m(&self) -> f64 {
        self.usual_m
    }

    /// Area of the body, m2.
    pub(super) fn area_m2(&self) -> f64 {
        self.area_m2
    }

    /// The number of values of a frame, of which the table's are combinations.
    pub(super) fn value_count(&self) -> usize {
        self.values.len()
    }

    /// Number of combinations of the values that touches change.
    pub(super) fn rank(&self) -> usize {
        self.basis.rows
    }

    /// The response of a touch; its tensor is 1 plus the uneven parts.
    pub(super) fn response(&self, place: &Place, form: &Form, uneven: Point2) -> Response {
        let density = Density::new(form, self.usual_m);
        let (mut parts, mut grain_m2) = (Vec::new(), [0.0; 3]);
        self.for_each_part(place, &density, |cell, offset| {
            let weights = density.at(offset);
            let square = weights[0] * weights[0] * self.cells[cell].area_m2;
            grain_m2[0] += square * offset[0] * offset[0];
            grain_m2[1] += square * offset[0] * offset[1];
            grain_m2[2] += square * offset[1] * offset[1];
            let [c, s] = self.space.turn(&self.cells[cell].place, place);
            parts.push(Part {
                cell,
                weights: weights.map(|weight| weight as f32),
                double: [c * c - s * s, 2.0 * s * c].map(|part| part as f32),
            });
        });
        let mut columns = [const { Vec::new() }; COLUMNS];
        columns.iter_mut().for_each(|column| column.resize(self.count, 0.0));
        let uneven = uneven.map(|part| part as f32);
        pulp::Arch::new().dispatch(Sum { responses: self, parts: &parts, uneven, columns: &mut columns });
        Response { columns, grain_m2 }
    }

    /// The values of a round, even touch of usual width, without their derivatives.
    pub(super) fn usual(&self, place: &Place) -> Vec<f64> {
        let density = Density::new(&Form::default(), self.usual_m);
        let mut sums = vec![0.0f32; self.count];
        self.for_each_part(place, &density, |cell, offset| {
            let [weight, ..] = density.at(offset).map(|weight| weight as f32);
            let even = &self.table[cell * 3 * self.count..][..self.count];
            sums.iter_mut().zip(even).for_each(|(sum, value)| *sum += weight * value);
        });
        sums.into_iter().map(f64::from).collect()
    }

    /// The change of the values by each square of a touch of unit strength, along the axes of its place.
    pub(super) fn squares(&self, place: &Place, form: &Form, size_m: f64) -> Vec<Vec<f64>> {
        let density = Density::new(form, self.usual_m);
        let mut squares: BTreeMap<[i64; 2], Vec<f64>> = BTreeMap::new();
        self.for_each_part(place, &density, |cell, offset| {
            let [weight, ..] = density.at(offset);
            let square = offset.map(|part| (part / size_m).round() as i64);
            let change = squares.entry(square).or_insert_with(|| vec![0.0; self.count]);
            let even = &self.table[cell * 3 * self.count..][..self.count];
            change.iter_mut().zip(even).for_each(|(sum, value)| *sum += weight * f64::from(*value));
        });
        squares.into_values().collect()
    }

    /// The cells that a touch reaches, with the offset of each from its centre.
    fn for_each_part(&self, place: &Place, density: &Density, mut part: impl FnMut(usize, Point2)) {
        let reach_m = density.reach_m();
        for cell in self.cubes.near(place.point_m, reach_m).flatten() {
            let at = &self.cells[cell].place;
            let straight = sub(at.point_m, place.point_m);
            if dot(straight, straight) > reach_m * reach_m || dot(at.axes[2], place.axes[2]) <= 0.0 {
                continue;
            }
            let offset = self.space.step(place, at);
            if density.reaches(offset) {
                part(cell, offset);
            }
        }
    }
}

/// The values of a frame that are fitted: each the mean of the usable channels of a quantity, with its standard
/// deviation.
fn values(model: &ForwardModel, noise_ohm: &[f64]) -> (Vec<Vec<(usize, f64)>>, Vec<f64>) {
    let is_usable = |channel: usize| noise_ohm[channel].is_finite() && noise_ohm[channel] > 0.0;
    let mut all = (Vec::new(), Vec::new());
    for group in quantities(model.protocol()) {
        let channels: Vec<(usize, f64)> = group.into_iter().filter(|&(channel, _)| is_usable(channel)).collect();
        if channels.is_empty() {
            continue;
        }
        let count = channels.len() as f64;
        let variance = channels.iter().map(|&(channel, _)| noise_ohm[channel].powi(2)).sum::<f64>();
        all.0.push(channels.into_iter().map(|(channel, sign)| (channel, sign / count)).collect());
        all.1.push(variance.sqrt() / count);
    }
    all
}

/// The cells of a mesh by their cubes. Those of a mesh that is far finer than touches are taken together where they are in one
/// cube of a touch's width, so that a frame costs the same on every mesh.
fn parts(mesh: &Mesh, width_m: f64) -> (Cubes, Vec<Vec<usize>>) {
    let centres: Vec<Point3> = (0..mesh.cell_count()).map(|cell| mesh.cell_centre(cell)).collect();
    let area_m2: f64 = (0..centres.len()).map(|cell| mesh.cell_measure(cell)).sum();
    let is_fine = area_m2 < FEW_IN_CUBE * width_m * width_m * centres.len() as f64;
    let mut parts: BTreeMap<([i64; 3], i64), Vec<usize>> = BTreeMap::new();
    for (cell, centre) in centres.iter().enumerate() {
        let key = if is_fine {
            (centre.map(|part| (part / width_m).floor() as i64), side(mesh, cell))
        } else {
            ([cell as i64, 0, 0], 0)
        };
        parts.entry(key).or_default().push(cell);
    }
    let mut parts: Vec<Vec<usize>> = parts.into_values().collect();
    let centres: Vec<Point3> = parts.iter().map(|part| centre(mesh, part)).collect();
    let (cubes, order) = Cubes::new(&centres, width_m);
    (cubes, order.into_iter().map(|part| std::mem::take(&mut parts[part])).collect())
}

/// The axis of space that the normal of a cell is nearest to, with its sign: the two sides of a thin body are apart.
fn side(mesh: &Mesh, cell: usize) -> i64 {
    let corners = mesh.cells.corners(cell);
    let [a, b, c] = [0, 1, 2].map(|corner| mesh.nodes[corners[corner]]);
    let normal = cross(sub(b, a), sub(c, a));
    let axis = (0..3).max_by(|a, b| normal[*a].abs().total_cmp(&normal[*b].abs())).unwrap_or(0);
    if normal[axis] < 0.0 { -1 - axis as i64 } else { axis as i64 }
}

/// The centre of some cells, by area.
fn centre(mesh: &Mesh, cells: &[usize]) -> Point3 {
    if let &[cell] = cells {
        return mesh.cell_centre(cell);
    }
    let (mut sum, mut area_m2) = ([0.0; 3], 0.0);
    for &cell in cells {
        let own = mesh.cell_measure(cell);
        sum = add(sum, scale(mesh.cell_centre(cell), own));
        area_m2 += own;
    }
    scale(sum, 1.0 / area_m2)
}

/// Orthonormal directions, as rows, that contain nearly all of some changes.
fn basis(changes: &[Vec<f64>]) -> Matrix {
    let width = changes[0].len();
    let all = changes.concat();
    let changes = MatRef::from_row_major_slice(&all, changes.len(), width);
    let gram: Mat<f64> = changes.transpose() * changes;
    let eigen = gram.self_adjoint_eigen(Side::Lower).expect("a symmetric matrix of finite values");
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    let least = MIN_PART * MIN_PART * values[width - 1];
    let kept: Vec<usize> = (0..width).rev().filter(|&k| values[k] > least).collect();
    let rows = kept.iter().flat_map(|&k| (0..width).map(move |i| vectors[(i, k)]));
    Matrix { rows: kept.len(), columns: width, values: rows.collect() }
}

/// The columns of a response, summed over its parts. No operation is fused: every instruction set gives the same bits.
struct Sum<'a> {
    responses: &'a Responses,
    parts: &'a [Part],
    uneven: [f32; 2],
    columns: &'a mut [Vec<f64>; COLUMNS],
}

impl WithSimd for Sum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let count = self.responses.count;
        let [a, b] = self.uneven.map(|part| simd.splat_f32s(part));
        for from in (0..count).step_by(S::F32_LANES) {
            let mut sums = [simd.splat_f32s(0.0); COLUMNS];
            for Part { cell, weights, double } in self.parts {
                let rows = &self.responses.table[cell * 3 * count..][..3 * count];
                let row = |k: usize| S::as_simd_f32s(&rows[k * count + from..][..S::F32_LANES]).0[0];
                let (even, first, second) = (row(0), row(1), row(2));
                let [c, s] = double.map(|part| simd.splat_f32s(part));
                let own = [
                    even,
                    simd.add_f32s(simd.mul_f32s(c, first), simd.mul_f32s(s, second)),
                    simd.sub_f32s(simd.mul_f32s(c, second), simd.mul_f32s(s, first)),
                ];
                let all = simd.add_f32s(even, simd.add_f32s(simd.mul_f32s(a, own[1]), simd.mul_f32s(b, own[2])));
                for (column, sum) in sums.iter_mut().enumerate() {
                    let (weight, value) =
                        if column < 3 { (weights[0], own[column]) } else { (weights[column - 2], all) };
                    *sum = simd.add_f32s(*sum, simd.mul_f32s(simd.splat_f32s(weight), value));
                }
            }
            for (column, sum) in self.columns.iter_mut().zip(sums) {
                let lanes: &[f32] = pulp::bytemuck::cast_slice(std::slice::from_ref(&sum));
                column[from..].iter_mut().zip(lanes).for_each(|(out, lane)| *out = f64::from(*lane));
            }
        }
    }
}

/// The scalar product of the response at each place with some values.
struct Search<'a> {
    table: &'a [f32],
    values: &'a [f32],
    explained: &'a mut [f32],
}

impl WithSimd for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let blocks = self.table.chunks_exact(self.values.len() * PLACES);
        for (block, explained) in blocks.zip(self.explained.as_chunks_mut::<PLACES>().0) {
            let mut sums = [0.0f32; PLACES];
            for (row, value) in block.as_chunks::<PLACES>().0.iter().zip(self.values) {
                (0..PLACES).for_each(|lane| sums[lane] += row[lane] * value);
            }
            *explained = sums;
        }
    }
}
