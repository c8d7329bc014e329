//! The order of the channels, scored against the model.
//!
//! An order is scored by the untouched frame, as the cosine with that of the model, and by the changes, as the cosine
//! of the correlations between channels over the rows with those over simulated touches. Rows and touches need not be
//! at the same places for that. A symmetric skin has several orders with the same score; the simplest of them is taken.

use crate::checks::correlation::cosine;
use crate::checks::model::ModelChannels;
use crate::checks::orders::{Change, Order};
use crate::checks::signs::turned_correlations;
use dermis::linalg::smallest_total;
use dermis::protocol::Protocol;
use dermis::stats::upper_median;
use faer::Mat;
use rayon::prelude::*;

/// Pairs of channels that are compared, at most.
const MAX_PAIRS: usize = 20_000;
/// Scores closer than this part are equal.
const EQUAL: f64 = 0.02;
/// Another order must leave at most this part of what the untouched frame misses ...
const MISS_RATIO: f64 = 0.5;
/// ... and be better by at least this.
const MIN_GAIN: f64 = 0.05;
/// By the changes alone, another order must be better by this factor ...
const GAIN_RATIO: f64 = 1.12;
/// ... and by this difference: of two orders of noise one always fits better.
const GAIN_CHANGES: f64 = 0.05;
/// ... and its cosine is at least this: among the many orders of noise one is always right by chance.
const MIN_CHANGES: f64 = 0.12;
/// Exchanged drives: smallest gain of one exchange, as a part of the score.
const MIN_EXCHANGE: f64 = 0.02;

/// How well an order fits the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Score {
    /// Cosine of the untouched frame with that of the model; 0 without one.
    pub untouched: f64,
    /// Cosine of the correlations of the channels with those of the model; 0 where there are too few rows.
    pub changes: f64,
}

impl Score {
    fn total(self) -> f64 {
        self.untouched.abs() + self.changes
    }
}

/// Compares a recording with the model of the skin.
pub(crate) struct Matcher<'a> {
    protocol: &'a Protocol,
    model_untouched: Vec<f64>,
    untouched: Option<Vec<f64>>,
    pairs: Vec<(usize, usize, f64)>,
    measured: Option<&'a Mat<f64>>,
    /// Columns of the file that are not compared.
    dead: Vec<bool>,
    /// Channels of the design that are not compared: those at a driven electrode, whose contact the design hardly knows.
    driven: Vec<bool>,
}

/// Channels at a driven electrode; none where there are hardly any others.
pub(crate) fn driven(protocol: &Protocol) -> Vec<bool> {
    let mut driven = vec![true; protocol.channel_count()];
    protocol.undriven().for_each(|channel| driven[channel] = false);
    let others = driven.iter().filter(|driven| !**driven).count();
    if 2 * others < driven.len() { vec![false; driven.len()] } else { driven }
}

/// An order that fits better than that of the design.
pub(crate) struct BetterOrder {
    /// The order.
    pub order: Order,
    /// Its score.
    pub score: Score,
}

impl<'a> Matcher<'a> {
    /// Compares an untouched frame and the correlations of the channels, in the order of the file, with the model. Both
    /// may be absent.
    pub(crate) fn new(
        protocol: &'a Protocol,
        model: &ModelChannels,
        untouched: Option<&[f64]>,
        measured: Option<&'a Mat<f64>>,
        dead: &[usize],
    ) -> Self {
        let channels = model.channel_count();
        let count = channels * (channels - 1) / 2;
        let step = count.div_ceil(MAX_PAIRS);
        let pairs = (0..channels).flat_map(|a| (0..a).map(move |b| (a, b))).step_by(step);
        let pairs = pairs.map(|(a, b)| (a, b, model.correlation[(a, b)])).collect();
        Matcher {
            protocol,
            model_untouched: compressed(&model.untouched),
            untouched: untouched.map(compressed),
            pairs,
            measured,
            dead: (0..channels).map(|column| dead.contains(&column)).collect(),
            driven: driven(protocol),
        }
    }

    /// The score of an order.
    pub(crate) fn score(&self, order: &Order) -> Score {
        let untouched = self.untouched.as_ref().map_or(0.0, |frame| {
            let alive =
                || (0..frame.len()).filter(|&channel| !self.dead[order.columns[channel]] && !self.driven[channel]);
            let own = alive().map(|channel| order.signs[channel] * frame[order.columns[channel]]);
            cosine(own, alive().map(|channel| self.model_untouched[channel]))
        });
        let changes = self.measured.map_or(0.0, |measured| {
            let value = |&(a, b, _): &(usize, usize, f64)| {
                order.signs[a] * order.signs[b] * measured[(order.columns[a], order.columns[b])]
            };
            let is_compared = |channel: usize| !self.dead[order.columns[channel]] && !self.driven[channel];
            let alive = |&&(a, b, _): &&(usize, usize, f64)| is_compared(a) && is_compared(b);
            let pairs = || self.pairs.iter().filter(alive);
            cosine(pairs().map(value), pairs().map(|pair| pair.2))
        });
        Score { untouched, changes }
    }

    /// The order that fits best, where it fits clearly better than that of the design, and the score of that of the
    /// design.
    pub(crate) fn search(&self, model: &ModelChannels) -> (Score, Option<BetterOrder>) {
        let orders = Order::all(self.protocol);
        let scores: Vec<Score> = orders.par_iter().map(|order| self.score(order)).collect();
        let best = scores.iter().map(|score| score.total()).fold(f64::NEG_INFINITY, f64::max);
        let enough = best - EQUAL * best.abs();
        let first = scores.iter().position(|score| score.total() >= enough).unwrap_or(0);
        let (mut order, mut score) = (orders[first].clone(), scores[first]);
        if !self.is_better(score, scores[0]) {
            (order, score) = (orders[0].clone(), scores[0]);
        }
        // Drives whose sign is turned are no exchanged ones; exchanges are looked for with and without turned signs.
        let turned = self.with_turned_drives(&order, model);
        let starts: Vec<Order> = std::iter::once(order.clone()).chain(turned).collect();
        let known = starts.iter().map(|start| self.score(start)).max_by(|a, b| a.total().total_cmp(&b.total()));
        let known = known.expect("at least one start");
        let found = starts.iter().filter_map(|start| self.permuted(start, self.score(start)));
        let found = found.max_by(|a, b| a.1.total().total_cmp(&b.1.total()));
        if let Some((drives, score_found)) = found.filter(|(_, found)| self.is_better(*found, known)) {
            let permuted = order.with_drives(self.protocol, &drives).expect("it was permuted before");
            (order, score) = (permuted, score_found);
            order.changes.push(Change::DrivesPermuted);
        }
        let better = !order.changes.is_empty();
        (scores[0], better.then_some(BetterOrder { order, score }))
    }

    /// An order with the signs of those channels turned that the changes show to be turned.
    fn with_turned_drives(&self, order: &Order, model: &ModelChannels) -> Option<Order> {
        let measured = self.measured?;
        let count = order.columns.len();
        let ordered = Mat::from_fn(count, count, |a, b| {
            order.signs[a] * order.signs[b] * measured[(order.columns[a], order.columns[b])]
        });
        let dead: Vec<usize> = (0..count).filter(|&channel| self.dead[order.columns[channel]]).collect();
        let mut turned = order.clone();
        let channels = turned_correlations(&ordered, model, self.protocol, &dead).channels;
        channels.into_iter().for_each(|channel| turned.signs[channel] = -turned.signs[channel]);
        Some(turned)
    }

    /// Whether a score is better than another by more than chance.
    fn is_better(&self, score: Score, than: Score) -> bool {
        let [new, old] = [score, than].map(|score| score.untouched.abs());
        if self.untouched.is_some() && new - old > MIN_GAIN && 1.0 - new < MISS_RATIO * (1.0 - old) {
            return true;
        }
        let is_possible = self.untouched.is_none() || new > old - EQUAL;
        let gains = score.changes > MIN_CHANGES
            && score.changes - than.changes > GAIN_CHANGES
            && score.changes > GAIN_RATIO * than.changes;
        is_possible && gains
    }

    /// The best order with permuted drives: by assignment for an untouched frame, then by exchanges of two drives.
    fn permuted(&self, start: &Order, score: Score) -> Option<(Vec<usize>, Score)> {
        let count = self.protocol.drives().0.len();
        let mut drives: Vec<usize> = (0..count).collect();
        let mut best_score = score;
        if let Some(assigned) = self.assigned(start) {
            let order = start.with_drives(self.protocol, &assigned)?;
            let found = self.score(&order);
            if found.total() > best_score.total() + MIN_GAIN {
                (drives, best_score) = (assigned, found);
            }
        }
        for _ in 0..count {
            let exchanges: Vec<[usize; 2]> = (0..count).flat_map(|a| (0..a).map(move |b| [a, b])).collect();
            let exchanged = |&[a, b]: &[usize; 2]| {
                let mut drives = drives.clone();
                drives.swap(a, b);
                let order = start.with_drives(self.protocol, &drives)?;
                Some((drives, self.score(&order)))
            };
            let found = exchanges.par_iter().filter_map(exchanged);
            let (next, found) = found.max_by(|a, b| a.1.total().total_cmp(&b.1.total()))?;
            if found.total() < best_score.total() * (1.0 + MIN_EXCHANGE) {
                break;
            }
            (drives, best_score) = (next, found);
        }
        (!drives.iter().copied().eq(0..count)).then_some((drives, best_score))
    }

    /// The assignment of the drives of a file to those of the design, by the untouched frame.
    fn assigned(&self, start: &Order) -> Option<Vec<usize>> {
        let frame = start.apply(self.untouched.as_ref()?);
        let (drives, of_channel) = self.protocol.drives();
        let mut blocks = vec![Vec::new(); drives.len()];
        for (channel, &drive) in of_channel.iter().enumerate() {
            blocks[drive].push(channel);
        }
        let sign = cosine(frame.iter().copied(), self.model_untouched.iter().copied()).signum();
        let cost = |design: usize, file: usize| -> f64 {
            let pairs = blocks[design].iter().zip(&blocks[file]).filter(|(a, _)| !self.driven[**a]);
            pairs.map(|(&a, &b)| (self.model_untouched[a] - sign * frame[b]).powi(2)).sum()
        };
        let mut assigned = vec![0; drives.len()];
        for (design, file) in smallest_total(drives.len(), drives.len(), &cost) {
            assigned[design] = file;
        }
        Some(assigned)
    }
}

/// Values over their median absolute value, with large ones compressed.
pub(crate) fn compressed(values: &[f64]) -> Vec<f64> {
    let sizes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    let scale = upper_median(&sizes).unwrap_or(0.0).max(f64::MIN_POSITIVE);
    values.iter().map(|value| (value / scale).asinh()).collect()
}
