//! Several touches at once, by superposition of the calibrated responses of single ones.
//!
//! The changes of a frame by touches add up, each multiplied by its amplitude. Touches are added one by one, each where
//! it explains the frame best, and refined in turn: a greedy search, as matching pursuit (Mallat and Zhang 1993, DOI
//! 10.1109/78.258082). It ends when the posterior density gains too little, and from two touches on when the residual
//! is no larger than those of the labels.

use crate::calibration::Calibration;
use crate::located::tangents;
use crate::posterior::{Posterior, log_student};
use dermis::geom::Point3;
use dermis::geom::vector::{add, distance, dot, scale, sub};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Touches that are looked for, at most.
const MAX_TOUCHES: usize = 4;
/// Logarithm of the posterior density that each further touch must gain.
const MIN_GAIN: f64 = 10.0;
/// Smallest standard deviation of the logarithm of an amplitude.
const LOG_AMPLITUDE_SD: f64 = 0.5;
/// Largest amplitude, and inverse of the smallest.
const LARGEST_AMPLITUDE: f64 = 4.0;
/// Nodes at which a further touch is tried.
const TRIED_NODES: usize = 150;
/// Of these, the best ones that are refined.
const STARTS: usize = 3;
/// Touches are at least this far apart, as a part of the size of the calibrated region.
const APART_PART: f64 = 0.25;
/// The posterior of a touch extends over nodes within this distance, as a part of the size of the calibrated region.
const NEAR_PART: f64 = 0.35;
/// Rounds in which all touches are refined.
const ROUNDS: usize = 5;
/// First step of a position, as a part of the size of the calibrated region, and the number of directions.
const STEP_PART: f64 = 0.3;
const DIRECTIONS: usize = 8;
/// First step of the logarithm of an amplitude.
const AMPLITUDE_STEP: f64 = 0.3;

/// The responses of a calibration at the nodes of its region, for several touches.
#[derive(Debug, Clone)]
pub(crate) struct Superposition {
    /// The untouched frame, in robust standard deviations from the median.
    untouched: Vec<f64>,
    /// Change by a labelled press at each node, in robust standard deviations; nodes x channels.
    changes: Vec<f64>,
    /// Nodes at which a further touch is tried.
    start_nodes: Vec<usize>,
    /// Unit normals of the nodes.
    normals: Vec<Point3>,
    /// The nodes within [`NEAR_PART`] of each node.
    near: Vec<Vec<usize>>,
}

/// A touch at a node.
#[derive(Debug, Clone, Copy)]
struct Touch {
    node: usize,
    log_amplitude: f64,
}

/// The touches that explain a frame.
struct Explanation {
    touches: Vec<Touch>,
    log_density: f64,
}

impl Superposition {
    pub(crate) fn new(calibration: &Calibration) -> Self {
        let locator = &calibration.locator;
        let untouched: Vec<f64> = locator.setup().untouched.iter().map(|value| value.sinh()).collect();
        let (mut changes, _) = locator.map().responses(&locator.region().nodes);
        let history = locator.map().history(&locator.map().at_centre(calibration.last_number()));
        for row in changes.chunks_exact_mut(untouched.len()) {
            let add = |((value, history), rest): ((&mut f64, &f64), &f64)| *value = (*value + history).sinh() - rest;
            row.iter_mut().zip(&history).zip(&untouched).for_each(add);
        }
        let start_nodes = farthest_points(&locator.region().nodes, TRIED_NODES);
        let nodes = &locator.region().nodes;
        let near_m = NEAR_PART * locator.map().extent.radius_m;
        let near = |here_m: &Point3| {
            (0..nodes.len()).filter(|&node| distance(nodes[node], *here_m) <= near_m).collect::<Vec<usize>>()
        };
        let near = nodes.par_iter().map(near).collect();
        Superposition { untouched, changes, start_nodes, normals: locator.region().node_normals(), near }
    }

    /// The posterior of each touch of a frame, in units of the channels: one, unless further ones explain it much
    /// better.
    pub(crate) fn posteriors<'a>(&self, calibration: &'a Calibration, values: &[f64]) -> Vec<Posterior<'a>> {
        let (target, untouched_square) =
            (calibration.locator.whiten(values), calibration.locator.untouched_square(values));
        let search = Search { superposition: self, calibration, target, untouched_square };
        let mut found = search.extend(&[]);
        while found.touches.len() < MAX_TOUCHES {
            // Two touches with a residual as small as those of the labels are two, whatever a third would gain.
            if found.touches.len() >= 2 && calibration.novelty(search.misfit(&found.touches)) <= 1.0 {
                break;
            }
            let next = search.extend(&found.touches);
            if next.log_density < found.log_density + MIN_GAIN {
                break;
            }
            found = next;
        }
        (0..found.touches.len()).map(|index| search.posterior(&found.touches, index)).collect()
    }

    fn change(&self, node: usize) -> &[f64] {
        let channels = self.untouched.len();
        &self.changes[node * channels..(node + 1) * channels]
    }
}

/// The search for the touches of a frame.
struct Search<'s, 'a> {
    superposition: &'s Superposition,
    calibration: &'a Calibration,
    /// The whitened frame.
    target: Vec<f64>,
    /// Its squared difference from the untouched one.
    untouched_square: f64,
}

impl<'a> Search<'_, 'a> {
    /// The explanation with one more touch.
    fn extend(&self, touches: &[Touch]) -> Explanation {
        let rest = self.total_change(touches, None);
        let tried = self.superposition.start_nodes.iter().map(|&node| Touch { node, log_amplitude: 0.0 });
        let free = tried.filter(|touch| self.is_apart(*touch, touches, None));
        let mut added: Vec<(Touch, f64)> =
            free.map(|touch| (touch, self.log_density(&rest, touch, touches, None))).collect();
        added.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut starts: Vec<Touch> = Vec::new();
        for (touch, _) in added {
            if starts.len() < STARTS && self.is_apart(touch, &starts, None) {
                starts.push(touch);
            }
        }
        let refined: Vec<Explanation> =
            starts.into_par_iter().map(|touch| self.refine([touches, &[touch]].concat())).collect();
        let none = Explanation { touches: touches.to_vec(), log_density: f64::NEG_INFINITY };
        refined.into_iter().fold(none, |best, other| if other.log_density > best.log_density { other } else { best })
    }

    /// Moves and scales each touch in turn, in steps that become smaller.
    fn refine(&self, mut touches: Vec<Touch>) -> Explanation {
        let mut log_density = f64::NEG_INFINITY;
        for round in 0..ROUNDS {
            let part = 0.5_f64.powi(round as i32);
            for index in 0..touches.len() {
                (touches[index], log_density) = self.improve(&touches, index, part);
            }
        }
        Explanation { touches, log_density }
    }

    /// One of several touches, better placed and scaled by steps of a part of the first ones, and the density with it.
    fn improve(&self, touches: &[Touch], index: usize, part: f64) -> (Touch, f64) {
        let rest = self.total_change(touches, Some(index));
        let density = |touch: Touch| (touch, self.log_density(&rest, touch, touches, Some(index)));
        let better = |best: (Touch, f64), other: (Touch, f64)| if other.1 > best.1 { other } else { best };
        let here = touches[index];
        let around = self.around(here, STEP_PART * part * self.size_m());
        let moved = around.filter(|touch| self.is_apart(*touch, touches, Some(index))).map(density);
        let (here, before) = moved.fold(density(here), better);
        let steps = [-2.0, -1.0, 1.0, 2.0].map(|steps| here.log_amplitude + steps * AMPLITUDE_STEP * part);
        let allowed = steps.into_iter().filter(|log| log.abs() <= LARGEST_AMPLITUDE.ln());
        let scaled = allowed.map(|log_amplitude| density(Touch { log_amplitude, ..here }));
        scaled.fold((here, before), better)
    }

    /// The same touch at the nodes nearest to a circle about it.
    fn around(&self, touch: Touch, radius_m: f64) -> impl Iterator<Item = Touch> {
        let nodes = self.nodes();
        let centre_m = nodes[touch.node];
        let [along, across] = tangents(self.superposition.normals[touch.node]);
        (0..DIRECTIONS).map(move |k| {
            let (sine, cosine) = (TAU * k as f64 / DIRECTIONS as f64).sin_cos();
            let goal_m = add(centre_m, add(scale(along, radius_m * cosine), scale(across, radius_m * sine)));
            let apart = |node: &usize| squared(sub(nodes[*node], goal_m));
            let near = self.superposition.near[touch.node].iter().copied();
            let node = near.min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("a node is near itself");
            Touch { node, ..touch }
        })
    }

    /// A touch at the nodes near one of several, apart from the others.
    fn neighbours(&self, touches: &[Touch], index: usize) -> Vec<Touch> {
        let near = self.superposition.near[touches[index].node].iter().map(|&node| Touch { node, ..touches[index] });
        near.filter(|touch| self.is_apart(*touch, touches, Some(index))).collect()
    }

    /// The posterior of the position of one of several touches, given the others and its amplitude.
    fn posterior(&self, touches: &[Touch], index: usize) -> Posterior<'a> {
        let locator = &self.calibration.locator;
        let rest = self.total_change(touches, Some(index));
        let amplitude = touches[index].log_amplitude.exp();
        let mut squares = vec![f64::INFINITY; self.nodes().len()];
        let mut residuals: Vec<Vec<f64>> = vec![Vec::new(); self.nodes().len()];
        for touch in self.neighbours(touches, index) {
            residuals[touch.node] = self.residual(&rest, touch);
            squares[touch.node] = residuals[touch.node].iter().map(|value| value * value).sum();
        }
        // A triangle at the border needs the residuals of all its corners.
        for triangle in &locator.region().triangles {
            if triangle.iter().any(|&node| squares[node].is_finite()) {
                for &node in triangle {
                    if residuals[node].is_empty() {
                        residuals[node] = self.residual(&rest, Touch { node, ..touches[index] });
                    }
                }
            }
        }
        let residual = move |node: usize| residuals[node].clone();
        Posterior::new(locator, amplitude, residual, squares, self.untouched_square)
    }

    /// The change by touches but one.
    fn total_change(&self, touches: &[Touch], but: Option<usize>) -> Vec<f64> {
        let mut sum = vec![0.0; self.superposition.untouched.len()];
        for touch in all_but(touches, but) {
            let amplitude = touch.log_amplitude.exp();
            let change = self.superposition.change(touch.node);
            sum.iter_mut().zip(change).for_each(|(sum, change)| *sum += amplitude * change);
        }
        sum
    }

    /// The whitened residual with a touch beside the change by others.
    fn residual(&self, rest: &[f64], touch: Touch) -> Vec<f64> {
        let amplitude = touch.log_amplitude.exp();
        let change = self.superposition.change(touch.node).iter().zip(rest).zip(&self.superposition.untouched);
        let predicted = change.map(|((change, rest), untouched)| asinh(untouched + rest + amplitude * change));
        let whitened = self.calibration.locator.whiten(&self.calibration.complete(predicted.collect()));
        self.target.iter().zip(whitened).map(|(value, predicted)| value - predicted).collect()
    }

    /// The squared whitened residual with a touch beside the change by others.
    fn square(&self, rest: &[f64], touch: Touch) -> f64 {
        self.residual(rest, touch).iter().map(|value| value * value).sum()
    }

    /// The mean square of the residual of touches, in units of its variance.
    fn misfit(&self, touches: &[Touch]) -> f64 {
        let index = touches.len() - 1;
        let square = self.square(&self.total_change(touches, Some(index)), touches[index]);
        square / (self.variance(touches.iter()) * self.target.len() as f64)
    }

    /// The variance of the residual of touches, in units of that of the noise.
    fn variance<'t>(&self, touches: impl Iterator<Item = &'t Touch>) -> f64 {
        touches.map(|touch| self.calibration.locator.variances()[touch.node]).fold(0.0, f64::max)
    }

    /// The logarithm of the posterior density of touches, without a constant.
    fn log_density(&self, rest: &[f64], touch: Touch, touches: &[Touch], replaced: Option<usize>) -> f64 {
        let locator = &self.calibration.locator;
        let square = self.square(rest, touch);
        let all: Vec<Touch> = all_but(touches, replaced).chain([touch]).collect();
        let variance = self.variance(all.iter());
        let sd = locator.strength().map_or(LOG_AMPLITUDE_SD, |strength| strength.log_sd.max(LOG_AMPLITUDE_SD));
        let prior: f64 = all.iter().map(|touch| (touch.log_amplitude / sd).powi(2)).sum();
        log_student(square, variance, self.target.len()) - 0.5 * prior
    }

    fn is_apart(&self, touch: Touch, touches: &[Touch], but: Option<usize>) -> bool {
        let apart_m = APART_PART * self.size_m();
        let apart = |other: Touch| distance(self.position_m(touch.node), self.position_m(other.node)) >= apart_m;
        all_but(touches, but).all(apart)
    }

    fn nodes(&self) -> &[Point3] {
        &self.calibration.locator.region().nodes
    }

    fn position_m(&self, node: usize) -> Point3 {
        self.nodes()[node]
    }

    /// Root mean square distance of the labels from their centre, m.
    fn size_m(&self) -> f64 {
        self.calibration.locator.map().extent.radius_m
    }
}

/// Touches without one of them.
fn all_but(touches: &[Touch], but: Option<usize>) -> impl Iterator<Item = Touch> {
    touches.iter().enumerate().filter(move |(index, _)| Some(*index) != but).map(|(_, touch)| *touch)
}

/// The inverse hyperbolic sine, with an absolute error of rounding: faster than that of the standard library.
fn asinh(value: f64) -> f64 {
    let size = value.abs();
    (size + (size * size + 1.0).sqrt()).ln().copysign(value)
}

fn squared(vector: Point3) -> f64 {
    dot(vector, vector)
}

/// At most so many nodes, each the farthest from those before it (farthest-point sampling, Gonzalez 1985, DOI
/// 10.1016/0304-3975(85)90224-5).
fn farthest_points(nodes: &[Point3], most: usize) -> Vec<usize> {
    let mut apart_m = vec![f64::INFINITY; nodes.len()];
    let mut chosen = Vec::new();
    while chosen.len() < most.min(nodes.len()) {
        let next = (0..nodes.len()).max_by(|&a, &b| apart_m[a].total_cmp(&apart_m[b])).expect("a region has nodes");
        chosen.push(next);
        apart_m.iter_mut().zip(nodes).for_each(|(apart, node)| *apart = apart.min(distance(*node, nodes[next])));
    }
    chosen
}
