//! The responses of a frame to touches on a grid of places, and between them.

use super::axis::Axis;
use super::{RefineError, RefineOptions};
use crate::design::Body;
use crate::estimate::drift::{DriftSpread, directions};
use crate::estimate::whitening::Whitening;
use crate::forward::ForwardModel;
use crate::frame::{disconnected_electrodes, quantities};
use crate::geom::{Chart, Point3};
use crate::linalg::Matrix;
use crate::mesh::Mesh;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Step of the grid over the width of a touch. A Gaussian sampled at this step has no visible spectrum beyond a fifth of
/// the sampling rate, where cubic interpolation is exact to a thousandth.
const STEP: f64 = 0.85;
/// Widths beyond which a touch is truncated: `exp(-8)`.
const REACH: f64 = 4.0;
/// Least width of a touch over the edge length of the cells: a Gaussian is sampled at the centres of the cells. That of
/// 3 mm on the mesh of `cylinder30` (edges of 4.6 mm) places contacts as well as one on a mesh of half the size.
const LEAST_WIDTH: f64 = 0.6;
/// Steps of the grid between the places at which a touch is looked for: a fit finds one from there.
const SEARCH_STRIDE: usize = 3;
/// The last places of a grid may be off the body by rounding.
const ROUNDING_M: f64 = 1e-12;
/// Number of cells whose responses are transposed together, so that they stay in the cache.
const BLOCK: usize = 64;

/// A whitened response and its derivatives: per unit of strength, per m, and the Laplacian per m2.
#[derive(Debug, Clone, Default)]
pub(super) struct Response {
    pub value: Vec<f64>,
    pub by_place: [Vec<f64>; 2],
    pub laplacian: Vec<f64>,
}

/// The change of the whitened values of a frame by a touch of unit strength at each place of a grid.
#[derive(Debug, Clone)]
pub(super) struct ResponseTable {
    chart: Chart,
    axes: [Axis; 2],
    /// Standard deviation of a touch's change of conductance along the surface, m.
    width_m: f64,
    /// By place (the second axis first), the response of each value.
    responses: Vec<f32>,
    /// The places at which a touch is looked for, with the norm of the response of each.
    searched: Vec<(usize, f32)>,
    /// The channels of each value, with their weights.
    values: Vec<Vec<(usize, f64)>>,
    /// Standard deviation of each value, ohm.
    sd_ohm: Vec<f64>,
    /// Of values over their standard deviations.
    whitening: Whitening,
    channel_count: usize,
    /// Whether electrodes are disconnected.
    lacks_electrodes: bool,
}

impl ResponseTable {
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
        let width_m = options.width_m.max(LEAST_WIDTH * edge_m(model.mesh()));
        let step_m = STEP * width_m;
        let chart = body.chart().ok_or(RefineError::NoChart)?.with_seam(-PI);
        let mut table = ResponseTable {
            chart,
            axes: axes(&chart, step_m),
            width_m,
            responses: Vec::new(),
            searched: Vec::new(),
            values,
            sd_ohm,
            whitening: Whitening::default(),
            channel_count: noise_ohm.len(),
            lacks_electrodes: !disconnected_electrodes(model.protocol(), |channel| is_usable(noise_ohm[channel]))
                .is_empty(),
        };
        let spread =
            DriftSpread { sheet: options.coating_drift, contact: options.contact_drift, ..DriftSpread::default() };
        let drifts = directions(model, &spread)?;
        table.whitening = Whitening::new((0..drifts.rows).map(|row| table.over_noise(drifts.row(row))));
        table.fill(model)?;
        table.searched = table.searched();
        Ok(table)
    }

    /// Computes the responses: each the sum of those of the cells under the touch.
    fn fill(&mut self, model: &ForwardModel) -> Result<(), RefineError> {
        let cells = Cells::new(self, model);
        let by_cell = self.cell_responses(&model.jacobian(model.rest_conductivity())?, &cells.order);
        let ([round, along], width) = (self.axes, self.values.len());
        let mut responses = vec![0.0; round.count * along.count * width];
        let fill = |(place, response): (usize, &mut [f32])| {
            let place = [round.at(place % round.count), along.at(place / round.count)];
            let part = cells.touch(&self.chart, place, self.width_m);
            pulp::Arch::new().dispatch(Sum { part: &part, by_cell: &by_cell, sum: response });
            let mut whitened: Vec<f64> = response.iter().map(|&value| f64::from(value)).collect();
            self.whitening.apply(&mut whitened);
            response.iter_mut().zip(whitened).for_each(|(value, whitened)| *value = whitened as f32);
        };
        responses.par_chunks_exact_mut(width).enumerate().for_each(fill);
        self.responses = responses;
        Ok(())
    }

    /// Every third place along each axis that is on the body, with the norm of its response.
    fn searched(&self) -> Vec<(usize, f32)> {
        let ([round, along], width) = (self.axes, self.values.len());
        let is_searched = |place: &usize| {
            let [i, j] = [place % round.count, place / round.count];
            let is_on_body = self.chart.depth_m([round.at(i), along.at(j)]) >= -ROUNDING_M;
            is_on_body && i.is_multiple_of(SEARCH_STRIDE) && j.is_multiple_of(SEARCH_STRIDE)
        };
        let with_norm = |place: usize| (place, norm(&self.responses[place * width..][..width]));
        let searched = (0..round.count * along.count).filter(is_searched).map(with_norm);
        searched.filter(|(_, norm)| *norm > 0.0).collect()
    }

    /// The place at which a touch explains whitened values best, among those searched; `None` if none does.
    pub(super) fn likeliest(&self, values: &[f64]) -> Option<[f64; 2]> {
        let values: Vec<f32> = values.iter().map(|&value| value as f32).collect();
        let mut best = (0.0, None);
        pulp::Arch::new().dispatch(Search { table: self, values: &values, best: &mut best });
        let ([round, along], place) = (self.axes, best.1?);
        Some([round.at(place % round.count), along.at(place / round.count)])
    }

    /// The change of each value, over its noise, by the conductivity of each cell in an order, cells x values.
    fn cell_responses(&self, jacobian: &Matrix, order: &[usize]) -> Vec<f32> {
        let width = self.values.len();
        let mut by_cell = vec![0.0; order.len() * width];
        let fill = |(cells, rows): (&[usize], &mut [f32])| {
            for (index, (value, sd)) in self.values.iter().zip(&self.sd_ohm).enumerate() {
                for &(channel, weight) in value {
                    let (factor, row) = (weight / sd, jacobian.row(channel));
                    for (out, &cell) in rows.iter_mut().skip(index).step_by(width).zip(cells) {
                        *out += (factor * row[cell]) as f32;
                    }
                }
            }
        };
        order.par_chunks(BLOCK).zip(by_cell.par_chunks_mut(BLOCK * width)).for_each(fill);
        by_cell
    }

    /// The values of a difference, whitened: noise and drift have unit covariance.
    ///
    /// # Panics
    /// If the difference has another length than the protocol.
    pub(super) fn whitened(&self, difference: &[f64]) -> Vec<f64> {
        assert_eq!(difference.len(), self.channel_count, "a value per channel");
        let mut values = self.over_noise(difference);
        self.whitening.apply(&mut values);
        values
    }

    /// The values of a difference over their noise.
    fn over_noise(&self, difference: &[f64]) -> Vec<f64> {
        let value = |(value, sd): (&Vec<(usize, f64)>, &f64)| {
            value.iter().map(|&(channel, weight)| weight * difference[channel]).sum::<f64>() / sd
        };
        self.values.iter().zip(&self.sd_ohm).map(value).collect()
    }

    /// The place halfway between two places.
    pub(super) fn middle(&self, from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
        let step = self.chart.difference(from, to);
        self.bounded([0, 1].map(|axis| from[axis] + 0.5 * step[axis]))
    }

    /// The place on the body of a point.
    pub(super) fn place(&self, point_m: Point3) -> [f64; 2] {
        self.bounded(self.chart.unroll(point_m))
    }

    /// The point of a place.
    pub(super) fn position_m(&self, place: [f64; 2]) -> Point3 {
        self.chart.roll(place)
    }

    pub(super) fn distance_m(&self, a: [f64; 2], b: [f64; 2]) -> f64 {
        self.chart.distance_m(a, b)
    }

    /// The nearest place on the body.
    pub(super) fn bounded(&self, place: [f64; 2]) -> [f64; 2] {
        self.chart.nearest(place)
    }

    /// The standard deviation of a touch's change of conductance along the surface, m: that of the options, or more on a
    /// coarse mesh.
    pub(super) fn width_m(&self) -> f64 {
        self.width_m
    }

    /// Whether electrodes are disconnected: most channels of their drives are not usable.
    pub(super) fn lacks_electrodes(&self) -> bool {
        self.lacks_electrodes
    }

    /// The change of a frame by a touch of a strength, ohm.
    pub(super) fn change(&self, place: [f64; 2], strength_m2: f64) -> Vec<f64> {
        let mut response = self.response(place);
        self.whitening.undo(&mut response.value);
        let mut change = vec![0.0; self.channel_count];
        for ((value, sd), response) in self.values.iter().zip(&self.sd_ohm).zip(&response.value) {
            for &(channel, weight) in value {
                change[channel] = strength_m2 * response * sd * weight.signum();
            }
        }
        change
    }

    /// The response at a place, by cubic interpolation.
    pub(super) fn response(&self, place: [f64; 2]) -> Response {
        let mut response = Response::default();
        let Response { value, by_place: [by_round, by_along], laplacian } = &mut response;
        self.interpolate(place, [value, by_round, by_along, laplacian], |[[a, by_a, twice_a], [b, by_b, twice_b]]| {
            [a * b, by_a * b, a * by_b, twice_a * b + a * twice_b]
        });
        response
    }

    /// The changes of the response at a place, per m2, by an oblong form of the touch: along the axes, and along the
    /// diagonals between them.
    pub(super) fn by_form(&self, place: [f64; 2]) -> [Vec<f64>; 2] {
        let mut by_form = [Vec::new(), Vec::new()];
        self.interpolate(place, by_form.each_mut(), |[[a, by_a, twice_a], [b, by_b, twice_b]]| {
            [twice_a * b - a * twice_b, 2.0 * by_a * by_b]
        });
        by_form
    }

    /// Sums of the tabulated responses about a place, with the weights of the two axes' stencils combined.
    fn interpolate<const COUNT: usize>(
        &self,
        place: [f64; 2],
        out: [&mut Vec<f64>; COUNT],
        combined: impl Fn([[f64; 3]; 2]) -> [f64; COUNT],
    ) {
        let width = self.values.len();
        let [round, along] = [0, 1].map(|axis: usize| self.axes[axis].stencil(place[axis]));
        // All values are overwritten below.
        let out = out.map(|out| {
            out.resize(width, 0.0);
            &mut out[..]
        });
        let row = |k: usize| {
            let (i, j) = (k % 4, k / 4);
            let place = self.axes[1].index(along.first + j as i64) * self.axes[0].count
                + self.axes[0].index(round.first + i as i64);
            let weights = combined([round.weights.map(|weights| weights[i]), along.weights.map(|weights| weights[j])]);
            (&self.responses[place * width..][..width], weights)
        };
        pulp::Arch::new().dispatch(Interpolate { rows: std::array::from_fn(row), out });
    }
}

/// The edge length of equilateral triangles of the mean area of a mesh's cells, m.
fn edge_m(mesh: &Mesh) -> f64 {
    let area_m2: f64 = (0..mesh.cell_count()).map(|cell| mesh.cell_measure(cell)).sum();
    (4.0 / 3f64.sqrt() * area_m2 / mesh.cell_count() as f64).sqrt()
}

/// Whether a channel with this noise is used.
fn is_usable(noise_ohm: f64) -> bool {
    noise_ohm.is_finite() && noise_ohm > 0.0
}

/// The values of a frame that are fitted: each the mean of the usable channels of a quantity, with its standard
/// deviation.
fn values(model: &ForwardModel, noise_ohm: &[f64]) -> (Vec<Vec<(usize, f64)>>, Vec<f64>) {
    let mut all = (Vec::new(), Vec::new());
    for group in quantities(model.protocol()) {
        let channels: Vec<(usize, f64)> =
            group.into_iter().filter(|&(channel, _)| is_usable(noise_ohm[channel])).collect();
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

/// The axes of the grid of a body.
fn axes(chart: &Chart, step_m: f64) -> [Axis; 2] {
    let [low_m, high_m] = chart.bounds_m();
    let open = |axis: usize| Axis::open(low_m[axis], high_m[axis], step_m);
    match chart.period_m() {
        Some(period_m) => [Axis::closed(low_m[0], period_m, step_m), open(1)],
        None => [open(0), open(1)],
    }
}

/// The cells of a mesh in the chart, sorted along the second axis.
struct Cells {
    order: Vec<usize>,
    /// In that order.
    places: Vec<[f64; 2]>,
    conductivity: Vec<f64>,
}

impl Cells {
    fn new(table: &ResponseTable, model: &ForwardModel) -> Self {
        let mesh = model.mesh();
        let place = |cell: usize| table.chart.unroll(mesh.cell_centre(cell));
        let mut sorted: Vec<([f64; 2], usize)> = (0..mesh.cell_count()).map(|cell| (place(cell), cell)).collect();
        sorted.sort_by(|(a, _), (b, _)| a[1].total_cmp(&b[1]));
        let (places, order): (Vec<_>, Vec<_>) = sorted.into_iter().unzip();
        let conductivity = order.iter().map(|&cell| model.rest_conductivity()[cell]).collect();
        Cells { order, places, conductivity }
    }

    /// The cells of a touch of unit strength, by their place in the order, with the change of each one's conductivity: a
    /// Gaussian with the integral of 1 over the plane.
    fn touch(&self, chart: &Chart, centre: [f64; 2], width_m: f64) -> Vec<(usize, f32)> {
        let reach_m = REACH * width_m;
        let first = self.places.partition_point(|place| place[1] < centre[1] - reach_m);
        let last = self.places.partition_point(|place| place[1] <= centre[1] + reach_m);
        let height = 1.0 / (TAU * width_m * width_m);
        let weight = |index: usize| {
            let square = chart.squared_distance_m2(centre, self.places[index]) / (width_m * width_m);
            let change = || (self.conductivity[index] * height * (-0.5 * square).exp()) as f32;
            (square <= REACH * REACH).then(|| (index, change()))
        };
        (first..last).filter_map(weight).collect()
    }
}

/// Sums of tabulated responses: each row with its weight in every sum.
struct Interpolate<'a, const COUNT: usize> {
    rows: [(&'a [f32], [f64; COUNT]); 16],
    out: [&'a mut [f64]; COUNT],
}

impl<const COUNT: usize> Interpolate<'_, COUNT> {
    /// Some values of the sums, from one on.
    #[inline(always)]
    fn block<const WIDTH: usize>(&self, from: usize) -> [[f64; WIDTH]; COUNT] {
        let mut sums = [[0.0; WIDTH]; COUNT];
        for (row, weights) in &self.rows {
            let row: &[f32; WIDTH] = row[from..][..WIDTH].try_into().expect("WIDTH values");
            for (sums, weight) in sums.iter_mut().zip(weights) {
                sums.iter_mut().zip(row).for_each(|(sum, &table)| *sum += weight * f64::from(table));
            }
        }
        sums
    }

    #[inline(always)]
    fn put<const WIDTH: usize>(&mut self, from: usize) {
        let sums = self.block::<WIDTH>(from);
        self.out.iter_mut().zip(sums).for_each(|(out, sums)| out[from..][..WIDTH].copy_from_slice(&sums));
    }
}

impl<const COUNT: usize> WithSimd for Interpolate<'_, COUNT> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) {
        const WIDTH: usize = 8;
        let count = self.out[0].len();
        let whole = count - count % WIDTH;
        (0..whole).step_by(WIDTH).for_each(|from| self.put::<WIDTH>(from));
        (whole..count).for_each(|from| self.put::<1>(from));
    }
}

/// The place, of those searched, where values are most like the response of a touch.
struct Search<'a> {
    table: &'a ResponseTable,
    values: &'a [f32],
    best: &'a mut (f32, Option<usize>),
}

impl WithSimd for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let width = self.values.len();
        for &(place, norm) in &self.table.searched {
            let explained = dot(&self.table.responses[place * width..][..width], self.values) / norm;
            if explained > self.best.0 {
                *self.best = (explained, Some(place));
            }
        }
    }
}

/// A scalar product in sixteen independent sums.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let (a, b) = (a.as_chunks::<16>(), b.as_chunks::<16>());
    let mut sums = [0.0; 16];
    for (a, b) in a.0.iter().zip(b.0) {
        (0..16).for_each(|lane| sums[lane] += a[lane] * b[lane]);
    }
    sums.iter().sum::<f32>() + a.1.iter().zip(b.1).map(|(a, b)| a * b).sum::<f32>()
}

fn norm(values: &[f32]) -> f32 {
    dot(values, values).sqrt()
}

/// The sum of the responses of cells, each times its weight.
struct Sum<'a> {
    part: &'a [(usize, f32)],
    by_cell: &'a [f32],
    sum: &'a mut [f32],
}

impl WithSimd for Sum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let width = self.sum.len();
        for &(cell, weight) in self.part {
            let response = &self.by_cell[cell * width..][..width];
            self.sum.iter_mut().zip(response).for_each(|(sum, value)| *sum += weight * value);
        }
    }
}
