//! Insertion of points between the fixed ones with the target density, and their relaxation.

use super::sizing::Sizing;
use super::triangulate::triangulate;
use crate::geom::{Chart, Point2};
use crate::mesh::MeshError;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::{HashMap, HashSet};

/// Minimum distance of points as a fraction of the target edge length: between the densest random packing (0.7) and a
/// regular lattice (1).
const CLOSEST: f64 = 0.76;
/// Minimum distance from the body's edge as a fraction of the target edge length.
const CLOSEST_TO_EDGE: f64 = 0.55;
/// Relaxation iterations; the smallest angle stops improving after about thirty.
const ROUNDS: usize = 30;
/// Iterations in which edges longer than allowed are divided; after the first number of them no point moves, because
/// each move can make another edge too long without end. The second number is a limit for termination.
const MOVING_ROUNDS: usize = 20;
const LENGTH_ROUNDS: usize = 40;
/// Edges beyond these multiples of the target length are divided or contracted, in the iterations before the last ten.
const TOO_LONG: f64 = 1.45;
const TOO_SHORT: f64 = 0.62;

/// A spatial index of points, to find those near a point.
struct Cells {
    size: f64,
    columns: i64,
    wraps: bool,
    points: HashMap<(i64, i64), Vec<usize>>,
}

impl Cells {
    fn new(chart: &Chart, size: f64) -> Self {
        let [low, high] = chart.bounds_m();
        let columns = (((high[0] - low[0]) / size).floor() as i64).max(1);
        Cells { size, columns, wraps: chart.period_m().is_some(), points: HashMap::new() }
    }

    fn key(&self, point: Point2) -> (i64, i64) {
        ((point[0] / self.size).floor() as i64, (point[1] / self.size).floor() as i64)
    }

    fn insert(&mut self, point: Point2, index: usize) {
        self.points.entry(self.key(point)).or_default().push(index);
    }

    /// The points in the grid cell of a point and all cells around it; the last column may be wider than the others.
    fn near(&self, point: Point2) -> impl Iterator<Item = usize> + '_ {
        let (x, y) = self.key(point);
        let span = if self.wraps { 2 } else { 1 };
        (-span..=span).flat_map(move |dx| {
            (-1..=1).flat_map(move |dy| {
                let column = if self.wraps { (x + dx).rem_euclid(self.columns + 1) } else { x + dx };
                self.points.get(&(column, y + dy)).into_iter().flatten().copied()
            })
        })
    }
}

/// Adds points to the fixed ones: a regular lattice where the longest edges are allowed, random ones elsewhere.
pub(super) fn fill(chart: &Chart, sizing: &Sizing, points: &mut Vec<Point2>) {
    let mut cells = Cells::new(chart, sizing.largest);
    for (index, &point) in points.iter().enumerate() {
        cells.insert(point, index);
    }
    let mut offer = |point: Point2, closest: f64, points: &mut Vec<Point2>| {
        let wanted = sizing.at(point);
        if chart.depth_m(point) < CLOSEST_TO_EDGE * wanted {
            return false;
        }
        let crowded = cells.near(point).any(|other| chart.distance_m(points[other], point) < closest * wanted);
        if !crowded {
            cells.insert(point, points.len());
            points.push(point);
        }
        !crowded
    };
    for point in lattice(chart, sizing.largest) {
        if sizing.at(point) >= sizing.largest {
            offer(point, CLOSEST, points);
        }
    }
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut seeds: Vec<usize> = (0..points.len()).collect();
    // Candidate points are in a ring around each accepted one (Bridson, 2007, DOI 10.1145/1278780.1278807).
    while let Some(seed) = seeds.pop() {
        let centre = points[seed];
        for _ in 0..20 {
            let distance = sizing.at(centre) * random.random_range(CLOSEST..2.0 * CLOSEST);
            let (sin, cos) = random.random_range(0.0..std::f64::consts::TAU).sin_cos();
            let point = chart.wrap([centre[0] + distance * cos, centre[1] + distance * sin]);
            if offer(point, CLOSEST, points) {
                seeds.push(points.len() - 1);
            }
        }
    }
}

/// Equilateral triangles that are periodic around a cylinder.
fn lattice(chart: &Chart, side: f64) -> Vec<Point2> {
    let [low, high] = chart.bounds_m();
    let columns = ((high[0] - low[0]) / side).round().max(1.0);
    let rows = ((high[1] - low[1]) / (side * 0.75f64.sqrt())).round().max(1.0);
    let mut points = Vec::new();
    for row in 0..rows as usize {
        for column in 0..columns as usize {
            let shift = if row % 2 == 0 { 0.25 } else { 0.75 };
            points.push([
                low[0] + (high[0] - low[0]) * (column as f64 + shift) / columns,
                low[1] + (high[1] - low[1]) * (row as f64 + 0.5) / rows,
            ]);
        }
    }
    points
}

/// Moves the free points (from `fixed` on) to the centres of their triangles, divides edges that are too long and
/// contracts those too short; returns the triangles.
pub(super) fn relax(
    chart: &Chart,
    sizing: &Sizing,
    points: &mut Vec<Point2>,
    fixed: usize,
    constraints: &[[usize; 2]],
    longest: f64,
) -> Result<Vec<[usize; 3]>, MeshError> {
    let reach = 6.0 * sizing.largest;
    for round in 0..ROUNDS {
        let triangles = triangulate(chart, points, constraints, reach)?;
        move_to_centres(chart, sizing, points, |point| point >= fixed, &triangles);
        if round + 10 < ROUNDS && round % 5 == 4 {
            let triangles = triangulate(chart, points, constraints, reach)?;
            adapt(chart, sizing, points, fixed, &triangles);
        }
    }
    for round in 0..LENGTH_ROUNDS {
        let triangles = triangulate(chart, points, constraints, reach)?;
        let first = points.len();
        divide_longest(chart, points, &triangles, longest);
        if points.len() == first {
            return Ok(triangles);
        }
        if round >= MOVING_ROUNDS {
            continue;
        }
        // Only points near the new points move: elsewhere edges stay as short as they are.
        let movable = near(chart, points, first, 2.5 * longest);
        for _ in 0..2 {
            let triangles = triangulate(chart, points, constraints, reach)?;
            move_to_centres(chart, sizing, points, |point| point >= fixed && movable[point], &triangles);
        }
    }
    triangulate(chart, points, constraints, reach)
}

/// The points within `reach` of one of those from `first` on.
fn near(chart: &Chart, points: &[Point2], first: usize, reach: f64) -> Vec<bool> {
    let mut cells = Cells::new(chart, reach);
    (first..points.len()).for_each(|point| cells.insert(points[point], point));
    let within = |point: Point2| cells.near(point).any(|new| chart.distance_m(points[new], point) < reach);
    points.iter().map(|&point| within(point)).collect()
}

/// Adds the midpoints of the edges that are too long, longest first, no two of them near each other.
fn divide_longest(chart: &Chart, points: &mut Vec<Point2>, triangles: &[[usize; 3]], longest: f64) {
    let length = |&[a, b]: &[usize; 2]| chart.distance_m(points[a], points[b]);
    let mut long: Vec<[usize; 2]> = edges(triangles).into_iter().filter(|edge| length(edge) > longest).collect();
    long.sort_by(|a, b| length(b).total_cmp(&length(a)));
    let mut middles: Vec<Point2> = Vec::new();
    for [a, b] in long {
        let place = middle(chart, points[a], points[b]);
        let alone = middles.iter().all(|&other| chart.distance_m(other, place) > 1.5 * longest);
        if alone && chart.depth_m(place) > 0.1 * longest {
            middles.push(place);
        }
    }
    points.extend(&middles);
}

fn middle(chart: &Chart, a: Point2, b: Point2) -> Point2 {
    let [x, y] = chart.difference(a, b);
    chart.wrap([a[0] + 0.5 * x, a[1] + 0.5 * y])
}

/// The edges of some triangles, each once.
pub(super) fn edges(triangles: &[[usize; 3]]) -> Vec<[usize; 2]> {
    let mut edges: Vec<[usize; 2]> =
        triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).map(|[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// One iteration of centroidal patch smoothing (Chen and Holst, 2011, DOI 10.1016/j.cma.2010.11.007): each free point
/// moves to the mean of the centres of its triangles, weighted by area and density. The density `h^-2` keeps edges at
/// the target length; the theoretical `h^-4`, for equilateral triangles, pulls points out of the coarse parts on meshes
/// with this steep grading (edges 19 % too short next to electrodes and 12 % too long elsewhere on `cylinder30`).
fn move_to_centres(
    chart: &Chart,
    sizing: &Sizing,
    points: &mut [Point2],
    is_free: impl Fn(usize) -> bool,
    triangles: &[[usize; 3]],
) {
    let mut sums = vec![[0.0; 3]; points.len()];
    for &corners in triangles {
        let [a, b, c] = corners.map(|corner| points[corner]);
        let (ab, ac) = (chart.difference(a, b), chart.difference(a, c));
        let centre = [(ab[0] + ac[0]) / 3.0, (ab[1] + ac[1]) / 3.0];
        let area = 0.5 * (ab[0] * ac[1] - ab[1] * ac[0]).abs();
        let place = [a[0] + centre[0], a[1] + centre[1]];
        let weight = area * sizing.at(chart.wrap(place)).powi(-2);
        for corner in corners.into_iter().filter(|&corner| is_free(corner)) {
            let [x, y] = chart.difference(points[corner], place);
            sums[corner][0] += weight * x;
            sums[corner][1] += weight * y;
            sums[corner][2] += weight;
        }
    }
    for (point, [x, y, weight]) in points.iter_mut().zip(sums) {
        if weight > 0.0 {
            *point = chart.wrap([point[0] + x / weight, point[1] + y / weight]);
        }
    }
}

/// Divides edges between free points that are too long and removes a free end of those too short.
fn adapt(chart: &Chart, sizing: &Sizing, points: &mut Vec<Point2>, fixed: usize, triangles: &[[usize; 3]]) {
    let mut touched = HashSet::new();
    let mut removed = HashSet::new();
    let mut added = Vec::new();
    for [a, b] in edges(triangles) {
        if touched.contains(&a) || touched.contains(&b) {
            continue;
        }
        let place = middle(chart, points[a], points[b]);
        let ratio = chart.distance_m(points[a], points[b]) / sizing.at(place);
        if ratio < TOO_SHORT && b >= fixed {
            removed.insert(b);
            touched.extend([a, b]);
        } else if ratio > TOO_LONG && chart.depth_m(place) > CLOSEST_TO_EDGE * sizing.at(place) {
            added.push(place);
            touched.extend([a, b]);
        }
    }
    let mut index = 0;
    points.retain(|_| {
        index += 1;
        !removed.contains(&(index - 1))
    });
    points.extend(added);
}
