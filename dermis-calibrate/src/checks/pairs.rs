//! Channels that measure the same quantity: with drive and measure exchanged (reciprocity), or with a pair reversed.

use dermis::finding::{Finding, FindingKind};
use dermis::frame::{Frame, Screening, reciprocal};
use dermis::protocol::Protocol;
use dermis::stats::{ranks, upper_median};
use faer::Mat;

/// Pairs of untouched values disagree if their difference is larger than this part of their sum ...
const APART: f64 = 0.25;
/// ... and than this many times that of the median pair.
const APART_RATIO: f64 = 5.0;
/// Changes disagree if their rank correlation is negative by this many times the deviation of unrelated values.
const AGAINST_SD: f64 = 5.0;
/// Fewest rows for a rank correlation.
const MIN_ROWS: usize = 30;

/// Channels that disagree with most of their reciprocal channels, in the untouched frame or in the changes, and the part of all
/// pairs.
pub(crate) fn disagreeing(
    untouched: Option<&[f64]>,
    differences: &Mat<f64>,
    protocol: &Protocol,
    left_out: &[usize],
) -> Option<Finding> {
    let reciprocal = reciprocal(protocol);
    let usable = |channel: usize| !left_out.contains(&channel) && !reciprocal[channel].is_empty();
    let mut against = untouched.map_or_else(Vec::new, |frame| apart_at_rest(frame, &reciprocal));
    if differences.nrows() >= MIN_ROWS {
        against.extend(against_in_changes(differences, &reciprocal));
    }
    against.sort_unstable();
    against.dedup();
    against.retain(|&channel| usable(channel));
    let paired = (0..reciprocal.len()).filter(|&channel| usable(channel)).count();
    let part = against.len() as f64 / paired.max(1) as f64;
    let evidence = "part of the channels with a reciprocal or repeated one that disagree with it".to_string();
    let fix =
        "one channel of each pair is wrong, or the skin changes within a frame; `evaluate` leaves such channels out";
    (!against.is_empty()).then(|| Finding::new(FindingKind::PairsDisagree, part, evidence, fix).at_channels(against))
}

/// Channels whose untouched value is far from that of most of their reciprocal channels.
fn apart_at_rest(frame: &[f64], reciprocal: &[Vec<(usize, f64)>]) -> Vec<usize> {
    let sizes: Vec<f64> = frame.iter().map(|value| value.abs()).collect();
    // Small values differ by noise alone.
    let floor = 0.05 * upper_median(&sizes).unwrap_or(0.0);
    let apart = |a: usize, (b, sign): (usize, f64)| {
        (frame[a] - sign * frame[b]).abs() / (frame[a].abs() + frame[b].abs() + floor).max(f64::MIN_POSITIVE)
    };
    let all: Vec<f64> =
        (0..frame.len()).flat_map(|a| reciprocal[a].iter().map(move |&partner| apart(a, partner))).collect();
    let limit = APART.max(APART_RATIO * upper_median(&all).unwrap_or(0.0));
    let is_apart = |&a: &usize| {
        2 * reciprocal[a].iter().filter(|&&partner| apart(a, partner) > limit).count() > reciprocal[a].len()
    };
    (0..frame.len()).filter(is_apart).collect()
}

/// Channels whose changes go against those of most of their reciprocal channels.
fn against_in_changes(differences: &Mat<f64>, reciprocal: &[Vec<(usize, f64)>]) -> Vec<usize> {
    let rows = differences.nrows();
    let ranked = |channel: usize| {
        let values: Vec<f64> = differences.col(channel).iter().copied().collect();
        ranks(&values).into_iter().map(|rank| rank - (rows as f64 - 1.0) / 2.0).collect::<Vec<f64>>()
    };
    let ranks: Vec<Vec<f64>> = (0..differences.ncols()).map(ranked).collect();
    let product = |a: usize, b: usize| ranks[a].iter().zip(&ranks[b]).map(|(a, b)| a * b).sum::<f64>();
    let limit = -AGAINST_SD / (rows as f64).sqrt();
    let is_against = |a: usize, &(b, sign): &(usize, f64)| {
        let norm = (product(a, a) * product(b, b)).sqrt();
        norm > 0.0 && sign * product(a, b) / norm < limit
    };
    let most =
        |&a: &usize| 2 * reciprocal[a].iter().filter(|partner| is_against(a, partner)).count() > reciprocal[a].len();
    (0..differences.ncols()).filter(most).collect()
}

/// Channels that hardly change because the instrument records one sign alone.
pub(crate) fn one_sign(differences: &[Frame], protocol: &Protocol, untouched: &[f64]) -> Option<Finding> {
    let blind = Screening::of(differences, protocol).polarity_blind(protocol, &Frame(untouched.to_vec()));
    let part = blind.len() as f64 / protocol.channel_count() as f64;
    let evidence =
        "part of the channels that change less than half as much as those with the drive reversed".to_string();
    let fix = "the instrument records voltages of one sign; `evaluate` leaves these channels out";
    (!blind.is_empty()).then(|| Finding::new(FindingKind::OneSign, part, evidence, fix).at_channels(blind))
}
