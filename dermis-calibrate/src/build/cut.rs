//! Cuts through the coat: where one may be, and its best place.

use super::data::Data;
use super::fault::{Cut, Fault, Network};
use super::fit::{Fit, Model};
use dermis::forward::{ForwardModel, Solver};
use dermis::geom::{Point2, Surface};
use dermis::linalg::{Matrix, dot};
use dermis::mesh::{Cells, Mesh};
use std::f64::consts::PI;

/// Remaining part of the conductance of a cell on a cut.
const REMAINING: f64 = 1e-4;
/// Distance between the places where a cut is looked for, m, and the number of its directions.
const SPACING_M: f64 = 0.012;
const DIRECTIONS: usize = 12;
/// Half of the length of a small cut, m.
const SMALL_M: f64 = 0.01;
/// Places from which the best cut is searched, at least this far from each other, m.
const STARTS: usize = 3;
const APART_M: f64 = 0.03;
/// Neighbours of a cut in that search, and its longest and shortest step along the surface, m.
const NEIGHBOURS: usize = 12;
const STEPS_M: [f64; 2] = [0.012, 0.002];
/// The middle of a cut is this close to the middle of a cell, m.
const ON_BODY_M: f64 = 0.008;
/// Shortest and longest cut, m.
const LENGTHS_M: [f64; 2] = [0.008, 0.25];

/// The remaining part of the conductance of each cell with a cut.
pub(super) fn remaining(mesh: &Mesh, surface: &Surface, cut: &Cut) -> Vec<f64> {
    let Cells::Triangles(triangles) = &mesh.cells else { return vec![1.0; mesh.cell_count()] };
    let half_m = 0.5 * cut.length_m;
    let (sine, cosine) = cut.angle_rad.sin_cos();
    // The cut lies on the first axis of these coordinates.
    let place = |node: usize| {
        let [u, v] = surface.chart(cut.centre_m, mesh.nodes[node]);
        [cosine * u + sine * v, cosine * v - sine * u]
    };
    let part = |corners: &[usize; 3]| if crosses(half_m, corners.map(place)) { REMAINING } else { 1.0 };
    triangles.iter().map(part).collect()
}

/// Whether a triangle meets the first axis between two points at equal distances from the origin.
fn crosses(half_m: f64, corners: [Point2; 3]) -> bool {
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for side in 0..3 {
        let ([u0, v0], [u1, v1]) = (corners[side], corners[(side + 1) % 3]);
        if (v0 > 0.0) != (v1 > 0.0) {
            let at = u0 + (u1 - u0) * v0 / (v0 - v1);
            range = [range[0].min(at), range[1].max(at)];
        }
    }
    let wide = corners.iter().any(|[u, _]| u.abs() > half_m + LENGTHS_M[1]);
    range[0] <= half_m && range[1] >= -half_m && !wide
}

/// A cut with its gain of log-likelihood.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    cut: Cut,
    gain: f64,
}

/// The best cut beside some faults, near others or anywhere, for a skin near some unknowns; `None` on a body without a
/// chart, or where no cut helps.
pub(super) fn best_cut(model: &Model, data: &Data, faults: &[Fault], x: &[f64], near: Option<Cut>) -> Option<Cut> {
    let skin = model.identifier.model_of(x).ok()?;
    if model.surface == Surface::Free || !matches!(skin.mesh().cells, Cells::Triangles(_)) {
        return None;
    }
    let fit = model.at(data, faults, x)?;
    let mut search = Search::new(model, &fit, &skin)?;
    let starts = match near {
        Some(cut) => vec![cut],
        None => search.starts(&skin)?,
    };
    let mut best: Option<Candidate> = None;
    for start in starts {
        let found = search.refine(start);
        if best.is_none_or(|best| found.gain > best.gain) {
            best = Some(found);
        }
    }
    best.map(|best| best.cut)
}

/// A search for a cut.
struct Search<'a> {
    model: &'a Model,
    fit: &'a Fit,
    solver: Solver,
    /// The network of the fit.
    network: Network,
    /// `A x`.
    moved: Vec<f64>,
    /// What the adapted skin leaves of the data without a cut, standard deviations.
    left: Vec<f64>,
}

impl<'a> Search<'a> {
    fn new(model: &'a Model, fit: &'a Fit, skin: &ForwardModel) -> Option<Self> {
        let mut solver = skin.solver();
        let network = model.network(&model.impedance_of(&mut solver, &fit.faults)?, &fit.faults);
        let mut moved = vec![0.0; fit.residuals.len()];
        fit.linear.a.product_into(&fit.all_unknowns(model), &mut moved);
        let left = fit.linear.left(&fit.residuals, &moved);
        Some(Search { model, fit, solver, network, moved, left })
    }

    /// The places where a small cut explains most.
    fn starts(&mut self, skin: &ForwardModel) -> Option<Vec<Cut>> {
        let potentials = self.solver.potentials(skin.rest_conductivity()).ok()?;
        let mesh = skin.mesh();
        let mut places: Vec<usize> = Vec::new();
        let distance_m = |a: usize, b: usize| self.model.surface.distance_m(mesh.cell_centre(a), mesh.cell_centre(b));
        for cell in 0..mesh.cell_count() {
            if places.iter().all(|&other| distance_m(cell, other) >= SPACING_M) {
                places.push(cell);
            }
        }
        let mut found: Vec<Candidate> = places.iter().filter_map(|&cell| self.small(skin, &potentials, cell)).collect();
        found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut starts: Vec<Cut> = Vec::new();
        for Candidate { cut, .. } in found {
            let apart = |other: &Cut| self.model.surface.distance_m(cut.centre_m, other.centre_m) >= APART_M;
            if starts.len() < STARTS && starts.iter().all(apart) {
                starts.push(cut);
            }
        }
        Some(starts)
    }

    /// The best small cut in a cell. A cut of length `2 a` that a field `E` meets at right angles is a dipole: with `g`
    /// the slopes across it of the potentials of all electrodes the impedances increase by `s pi a^2 g g'`, `s` the
    /// conductance of the sheet (the polarisability of a flat ellipse; Ammari and Kang, 2007, DOI
    /// 10.1007/978-0-387-71566-7, section 4).
    fn small(&self, skin: &ForwardModel, potentials: &Matrix, cell: usize) -> Option<Candidate> {
        let centre_m = skin.mesh().cell_centre(cell);
        let slopes = self.slopes(skin.mesh(), potentials, cell);
        let strength = PI * SMALL_M * SMALL_M * skin.rest_conductivity()[cell];
        let [along_u, along_v] = slopes.map(|axis| self.pair_slopes(&axis));
        let products = |a: &[[f64; 2]], b: &[[f64; 2]]| -> Vec<f64> {
            a.iter().zip(b).zip(&self.fit.data.sd).map(|((a, b), sd)| strength * a[0] * b[1] / sd).collect()
        };
        let mut changes = [products(&along_u, &along_u), products(&along_v, &along_v), products(&along_u, &along_v)];
        let other = products(&along_v, &along_u);
        changes[2].iter_mut().zip(other).for_each(|(sum, value)| *sum += value);
        let (scores, information) = self.scores(&changes);
        let gain = |direction: usize| {
            let normal_rad = PI * direction as f64 / DIRECTIONS as f64;
            let (sine, cosine) = normal_rad.sin_cos();
            let parts = [cosine * cosine, sine * sine, sine * cosine];
            let score: f64 = parts.iter().zip(scores).map(|(part, score)| part * score).sum();
            let own = |i: usize| parts.iter().zip(information[i]).map(|(part, one)| part * one).sum::<f64>();
            let total: f64 = (0..3).map(|i| parts[i] * own(i)).sum();
            let size = (score / total).max(0.0);
            let length_m = (2.0 * SMALL_M * size.sqrt()).clamp(LENGTHS_M[0], LENGTHS_M[1]);
            let cut = Cut { centre_m, angle_rad: (normal_rad + 0.5 * PI) % PI, length_m };
            Candidate { cut, gain: 0.5 * size * score }
        };
        (0..DIRECTIONS).map(gain).filter(|one| one.gain > 0.0).max_by(|a, b| a.gain.total_cmp(&b.gain))
    }

    /// The scores of some changes of the weighted channels, and their information after the skin has adapted.
    fn scores(&self, changes: &[Vec<f64>; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
        let open: Vec<bool> = self.model.protocol.channels().iter().map(|one| self.network.is_open(one)).collect();
        let used = changes.each_ref().map(|change| {
            change.iter().zip(&open).map(|(value, open)| if *open { 0.0 } else { *value }).collect::<Vec<f64>>()
        });
        let passed = used.each_ref().map(|change| self.fit.linear.transposed_product(change));
        let adapted = passed.each_ref().map(|one| self.fit.linear.factor.solve(one));
        let scores = used.each_ref().map(|change| dot(change, &self.left));
        let information =
            std::array::from_fn(|i| std::array::from_fn(|j| dot(&used[i], &used[j]) - dot(&passed[i], &adapted[j])));
        (scores, information)
    }

    /// The slopes of the potentials of all electrodes in a cell along the axes of the chart, V/m.
    fn slopes(&self, mesh: &Mesh, potentials: &Matrix, cell: usize) -> [Vec<f64>; 2] {
        let corners = mesh.cells.corners(cell);
        let centre_m = mesh.cell_centre(cell);
        let [p0, p1, p2] = [0, 1, 2].map(|k: usize| self.model.surface.chart(centre_m, mesh.nodes[corners[k]]));
        let (a, b) = ([p1[0] - p0[0], p1[1] - p0[1]], [p2[0] - p0[0], p2[1] - p0[1]]);
        let twice_area = a[0] * b[1] - a[1] * b[0];
        let [f0, f1, f2] = [0, 1, 2].map(|k: usize| potentials.row(corners[k]));
        let slope = |axis: usize, k: usize| {
            let (da, db) = (f1[k] - f0[k], f2[k] - f0[k]);
            if axis == 0 { (da * b[1] - db * a[1]) / twice_area } else { (db * a[0] - da * b[0]) / twice_area }
        };
        [0, 1].map(|axis| (0..f0.len()).map(|k| slope(axis, k)).collect())
    }

    /// For each channel the slopes of its drive (with its gain) and of its measure pair.
    fn pair_slopes(&self, slopes: &[f64]) -> Vec<[f64; 2]> {
        let mut passed = vec![0.0; slopes.len()];
        self.network.passed.product_into(slopes, &mut passed);
        let of_pair = |[a, b]: [usize; 2]| passed[a] - passed[b];
        let channels = self.model.protocol.channels().iter().zip(&self.model.drive_of);
        channels.map(|(one, &drive)| [self.network.gain(drive) * of_pair(one.drive), of_pair(one.measure)]).collect()
    }

    /// The gain of a cut, with the skin adapted to first order.
    fn gain(&mut self, cut: Cut) -> f64 {
        let mesh = self.solver.model().mesh();
        let near = |cell: usize| self.model.surface.distance_m(mesh.cell_centre(cell), cut.centre_m) < ON_BODY_M;
        if !(0..mesh.cell_count()).any(near) {
            return f64::NEG_INFINITY;
        }
        let mut faults = self.fit.faults.clone();
        faults.push(Fault::Cut(cut));
        let Some(impedance) = self.model.impedance_of(&mut self.solver, &faults) else { return f64::NEG_INFINITY };
        let residuals = self.model.residuals(&self.fit.data, &impedance, &faults);
        -self.fit.linear.least_squares(&residuals, &self.moved)
    }

    /// The best cut near another: steps of the whole cut and of its ends along the surface, each shorter after the last.
    fn refine(&mut self, start: Cut) -> Candidate {
        let mut best = Candidate { gain: self.gain(start), cut: start };
        let mut step_m = STEPS_M[0];
        while step_m >= STEPS_M[1] {
            let before = best.gain;
            for change in 0..NEIGHBOURS {
                let cut = self.neighbour(best.cut, change, step_m);
                let gain = self.gain(cut);
                if gain > best.gain {
                    best = Candidate { cut, gain };
                }
            }
            // A whole round without a clear gain.
            if best.gain < before + 1.0 {
                step_m *= 0.5;
            }
        }
        best
    }

    /// One of the neighbours of a cut: moved as a whole, or at one end, along itself or across. (A cut whose one end is
    /// right grows at the other alone.)
    fn neighbour(&self, cut: Cut, change: usize, step_m: f64) -> Cut {
        let step_m = if change.is_multiple_of(2) { step_m } else { -step_m };
        let (sine, cosine) = cut.angle_rad.sin_cos();
        let axis = if (change / 2).is_multiple_of(2) { [cosine, sine] } else { [-sine, cosine] };
        let step = axis.map(|part| step_m * part);
        let moved = |part: f64| self.model.surface.walk(cut.centre_m, step.map(|one| part * one));
        // The vector from the middle to the end that moves.
        let half = match change / 4 {
            0 => return Cut { centre_m: moved(1.0), ..cut },
            1 => 0.5 * cut.length_m,
            _ => -0.5 * cut.length_m,
        };
        let [u, v] = [half * cosine + 0.5 * step[0], half * sine + 0.5 * step[1]];
        let length_m = (2.0 * u.hypot(v)).clamp(LENGTHS_M[0], LENGTHS_M[1]);
        Cut { centre_m: moved(0.5), angle_rad: v.atan2(u).rem_euclid(PI), length_m }
    }
}
