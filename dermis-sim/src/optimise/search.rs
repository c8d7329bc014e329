//! The search for a layout by simulated annealing.

use super::layout::{Layout, Move};
use super::places::Places;
use crate::elementary::{ln, powf};
use dermis::geom::Point3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Neighbours of a candidate to which an electrode moves in a small step.
const NEAR: usize = 16;
/// Shares of the moves: to a near candidate, to any, and exchanges of two numbers.
const NEAR_SHARE: f64 = 0.6;
const ANY_SHARE: f64 = 0.15;

/// A schedule of simulated annealing (Kirkpatrick, Gelatt and Vecchi, 1983, DOI 10.1126/science.220.4598.671): the
/// temperature, relative to the objective, falls geometrically.
#[derive(Debug, Clone, Copy)]
pub(super) struct Schedule {
    pub(super) moves: usize,
    pub(super) temperatures: [f64; 2],
}

/// Candidates by distance.
pub(super) struct Neighbourhood<'a> {
    places: &'a Places,
    positions_m: &'a [Point3],
    near: Vec<Vec<usize>>,
}

impl<'a> Neighbourhood<'a> {
    pub(super) fn new(places: &'a Places, positions_m: &'a [Point3]) -> Self {
        let near = |centre: &Point3| {
            let mut by_distance: Vec<(f64, usize)> = (positions_m.iter().enumerate())
                .map(|(index, other)| (places.surface.distance_m(*centre, *other), index))
                .collect();
            by_distance.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            by_distance.into_iter().skip(1).take(NEAR).map(|(_, index)| index).collect()
        };
        Neighbourhood { near: positions_m.iter().map(near).collect(), places, positions_m }
    }

    /// Whether an electrode may go to a candidate.
    fn is_free(&self, chosen: &[usize], electrode: usize, candidate: usize) -> bool {
        let place = self.positions_m[candidate];
        let keeps = |(other, &at): (usize, &usize)| {
            other == electrode
                || self.places.surface.distance_m(self.positions_m[at], place) >= self.places.least_distance_m
        };
        chosen.iter().enumerate().all(keeps)
    }

    fn propose(&self, chosen: &[usize], rng: &mut ChaCha8Rng) -> Option<Move> {
        let electrode = rng.random_range(0..chosen.len());
        let kind = rng.random::<f64>();
        if kind > NEAR_SHARE + ANY_SHARE {
            let other = rng.random_range(0..chosen.len());
            return (other != electrode).then_some(Move::Swap(electrode, other));
        }
        let near = &self.near[chosen[electrode]];
        let candidate = if kind < NEAR_SHARE && !near.is_empty() {
            near[rng.random_range(0..near.len())]
        } else {
            rng.random_range(0..self.positions_m.len())
        };
        let is_new = candidate != chosen[electrode] && self.is_free(chosen, electrode, candidate);
        is_new.then_some(Move::To { electrode, candidate })
    }

    /// Improves a layout; it ends as the best layout that was found.
    pub(super) fn anneal(&self, layout: &mut Layout<'_>, schedule: Schedule, rng: &mut ChaCha8Rng) -> Vec<usize> {
        let [hot, cold] = schedule.temperatures;
        let mut best = (layout.objective_m(), layout.chosen().to_vec());
        for step in 0..schedule.moves {
            let temperature = hot * powf(cold / hot, step as f64 / schedule.moves as f64);
            let Some(change) = self.propose(layout.chosen(), rng) else { continue };
            // The uniform number is drawn first, so that most bad moves are refused before all places are computed.
            let accepted = 1.0 - temperature * ln(1.0 - rng.random::<f64>());
            if layout.try_move(change, accepted * layout.objective_m()) && layout.objective_m() < best.0 {
                best = (layout.objective_m(), layout.chosen().to_vec());
            }
        }
        best.1
    }
}

/// The order of a tour from place to place, each to the nearest that is left: neighbours in number are neighbours on the
/// skin.
pub(super) fn tour(places: &Places, positions_m: &[Point3], first: usize) -> Vec<usize> {
    let mut left: Vec<usize> = (0..positions_m.len()).collect();
    let mut order = vec![left.swap_remove(first)];
    while !left.is_empty() {
        let at = positions_m[order[order.len() - 1]];
        let away = |&index: &usize| places.surface.distance_m(at, positions_m[index]);
        let next = (0..left.len()).min_by(|&a, &b| away(&left[a]).total_cmp(&away(&left[b]))).unwrap_or(0);
        order.push(left.swap_remove(next));
    }
    order
}
