//! Signs of channels: turned, lost, or there although the design says that they are lost.

use crate::checks::correlation::{cosine, unit_rows};
use crate::checks::model::{ModelChannels, compressed};
use crate::checks::order::compressed as compressed_row;
use dermis::finding::{Finding, FindingKind};
use dermis::protocol::Protocol;
use dermis::stats::upper_median;
use faer::Mat;

/// A value has a sign if its size is at least this part of the median size.
const SIGNIFICANT: f64 = 0.2;
/// Signs are lost if the model has at least this part of each sign, and the recording none of one.
const BOTH: f64 = 0.1;
/// Signs are there if at least this part of the values has the other one.
const OTHER: f64 = 0.02;
/// A drive is turned if its channels go with those of the other drives as the model says, but with the opposite sign: a
/// cosine below this, and below this part of that of the median drive.
const TURNED: (f64, f64) = (-0.06, -0.3);
/// Single channels are judged where the median channel goes with the others as the model says by at least this cosine.
const JUDGED: f64 = 0.5;
/// A single channel is turned below this part of the cosine of the median channel.
const TURNED_CHANNEL: f64 = -0.4;
/// All signs are turned if single touches of the model fit the frames by this cosine with the sign turned, ...
const ALL_TURNED: f64 = 0.42;
/// ... this many times better than without ...
const ALL_RATIO: f64 = 2.0;
/// ... in this part of the frames.
const ALL_PART: f64 = 0.9;

/// Parts of the significant values that are negative and positive.
fn parts(values: &[f64]) -> [f64; 2] {
    let sizes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    let least = SIGNIFICANT * upper_median(&sizes).unwrap_or(0.0);
    let count = values.len().max(1) as f64;
    [-1.0, 1.0].map(|sign| values.iter().filter(|value| **value * sign > least).count() as f64 / count)
}

/// Signs of the untouched frame that are lost, or there against the design.
pub(crate) fn of_untouched(untouched: &[f64], model: &ModelChannels, protocol: &Protocol) -> Option<Finding> {
    let [negative, positive] = parts(untouched);
    let fewer = negative.min(positive);
    if protocol.amplitude_only() {
        let evidence = "part of the untouched values with the rarer sign; 0 for amplitudes".to_string();
        let fix = "set protocol.amplitude_only = false: the instrument records signs";
        return (fewer >= OTHER).then(|| Finding::new(FindingKind::SignPresent, fewer, evidence, fix));
    }
    let [model_negative, model_positive] = parts(&model.untouched);
    let expected = model_negative.min(model_positive);
    let any =
        if negative <= positive { untouched.iter().any(|v| *v < 0.0) } else { untouched.iter().any(|v| *v > 0.0) };
    let evidence =
        "part of the untouched values to which the model gives the other sign; the recording has one sign".to_string();
    (expected >= BOTH && !any).then(|| Finding::new(FindingKind::SignLost, expected, evidence, LOST))
}

const LOST: &str = "record signed values, or set protocol.amplitude_only = true";

/// Differences that are all of one sign.
pub(crate) fn of_differences(columns: &[Vec<f64>], model: &ModelChannels) -> Option<Finding> {
    let is_positive = |column: &Vec<f64>| column.iter().all(|value| *value >= 0.0);
    let positive = columns.iter().filter(|column| is_positive(column)).count() as f64 / columns.len().max(1) as f64;
    // The part of the model's changes that lower a value.
    let all: Vec<f64> =
        (0..model.channel_count()).flat_map(|channel| model.touches.col(channel).iter().copied()).collect();
    let [expected, _] = parts(&all);
    let found = positive > 0.9 && columns.first().is_some_and(|column| column.len() > 1) && expected >= BOTH;
    let evidence =
        "part of the channels without a negative difference; touches of the model lower many values".to_string();
    let fix = "give signed differences: frames minus the untouched frame, without absolute values";
    found.then(|| Finding::new(FindingKind::SignLost, positive, evidence, fix))
}

/// Channels of an untouched frame whose sign is not that of the model: drives and measure pairs most of whose values
/// have the other sign, and single channels with a large value.
pub(crate) fn turned_untouched(
    untouched: &[f64],
    model: &ModelChannels,
    protocol: &Protocol,
    dead: &[usize],
) -> Vec<usize> {
    let (measured, expected) = (compressed_row(untouched), compressed_row(&model.untouched));
    let alive: Vec<usize> = (0..untouched.len()).filter(|channel| !dead.contains(channel)).collect();
    let sized = |channel: usize, least: f64| measured[channel].abs() > least && expected[channel].abs() > least;
    let opposite = |channel: usize| measured[channel] * expected[channel] < 0.0;
    let mut turned: Vec<usize> =
        alive.iter().copied().filter(|&channel| opposite(channel) && sized(channel, 1.0)).collect();
    for (_, of_channel) in [protocol.drives(), protocol.measures()] {
        for group in 0..=of_channel.iter().copied().max().unwrap_or(0) {
            let all: Vec<usize> = alive.iter().copied().filter(|&channel| of_channel[channel] == group).collect();
            let judged: Vec<usize> = all.iter().copied().filter(|&channel| sized(channel, SIGNIFICANT)).collect();
            let against = judged.iter().filter(|&&channel| opposite(channel)).count();
            if judged.len() > 2 && 4 * against >= 3 * judged.len() {
                turned.extend(all);
            }
        }
    }
    turned.sort_unstable();
    turned.dedup();
    turned
}

/// Channels that go with the others with the opposite of the sign that the model says: whole drives, and single
/// channels where the model describes the skin well enough. All channels, dead ones too, are those of the design.
pub(crate) fn turned_correlations(
    correlation: &Mat<f64>,
    model: &ModelChannels,
    protocol: &Protocol,
    dead: &[usize],
) -> Turned {
    let (drives, of_channel) = protocol.drives();
    let is_alive = |channel: &usize| !dead.contains(channel);
    let group = |drive: usize| (0..of_channel.len()).filter(|&c| of_channel[c] == drive).collect::<Vec<_>>();
    // A drive whose channels are mostly dead is not judged.
    let judged = (0..drives.len()).map(group).filter(|all| 2 * all.iter().filter(|c| is_alive(c)).count() >= all.len());
    let drives: Vec<Vec<usize>> = judged.map(|all| all.into_iter().filter(is_alive).collect()).collect();
    let mut signs: Vec<f64> = (0..of_channel.len()).map(|c| f64::from(u8::from(is_alive(&c)))).collect();
    let by_drive =
        turn(&drives, &mut signs, correlation, model, &|score, median| score < TURNED.0 && score < TURNED.1 * median);
    let single: Vec<Vec<usize>> = (0..of_channel.len()).filter(is_alive).map(|channel| vec![channel]).collect();
    turn(&single, &mut signs, correlation, model, &|score, median| median > JUDGED && score < TURNED_CHANNEL * median);
    let channels = (0..signs.len()).filter(|&channel| signs[channel] < 0.0).collect();
    Turned { channels, worst: by_drive }
}

/// Channels whose sign is turned.
pub(crate) struct Turned {
    /// The channels, ascending.
    pub channels: Vec<usize>,
    /// The smallest cosine of a drive with the others, before any was turned.
    pub worst: f64,
}

/// Turns the groups of channels that fit worst, one after the other. Returns the score of the first.
fn turn(
    groups: &[Vec<usize>],
    signs: &mut [f64],
    correlation: &Mat<f64>,
    model: &ModelChannels,
    is_turned: &dyn Fn(f64, f64) -> bool,
) -> f64 {
    let mut first = None;
    for _ in 0..groups.len() / 2 {
        let scores: Vec<f64> = groups.iter().map(|group| score(group, signs, correlation, model)).collect();
        let median = upper_median(&scores).unwrap_or(0.0);
        let worst = (0..groups.len()).min_by(|&a, &b| scores[a].total_cmp(&scores[b]));
        let Some(worst) = worst else { break };
        first.get_or_insert(scores[worst]);
        if !is_turned(scores[worst], median) {
            break;
        }
        groups[worst].iter().for_each(|&channel| signs[channel] = -signs[channel]);
    }
    first.unwrap_or(0.0)
}

/// The cosine between the correlations of a group with all other channels and those of the model.
fn score(group: &[usize], signs: &[f64], correlation: &Mat<f64>, model: &ModelChannels) -> f64 {
    // Dead channels have the sign 0.
    let others: Vec<usize> =
        (0..signs.len()).filter(|channel| signs[*channel] != 0.0 && !group.contains(channel)).collect();
    let pairs = || group.iter().flat_map(|&a| others.iter().map(move |&b| (a, b)));
    let measured = pairs().map(|(a, b)| signs[a] * signs[b] * correlation[(a, b)]);
    cosine(measured, pairs().map(|(a, b)| model.correlation[(a, b)]))
}

/// How well single touches of the model fit the frames, with their sign and with the opposite.
pub(crate) struct TouchFit {
    /// Mean over the frames of the largest cosine with a touch.
    pub same: f64,
    /// The same for touches of the opposite sign.
    pub opposite: f64,
    /// Part of the frames that the opposite sign fits better.
    pub opposite_part: f64,
}

impl TouchFit {
    /// Compares some of the frames (differences, in the order of the design, rows x channels) with all touches.
    pub(crate) fn new(differences: &Mat<f64>, model: &ModelChannels) -> Self {
        const MAX: usize = 200;
        let step = differences.nrows().div_ceil(MAX).max(1);
        let rows: Vec<usize> = (0..differences.nrows()).step_by(step).collect();
        let unit = |values: &Mat<f64>| unit_rows(&compressed(values));
        let frames = Mat::from_fn(rows.len(), differences.ncols(), |i, j| differences[(rows[i], j)]);
        let cosines = unit(&frames) * unit(&model.touches).transpose();
        let mut fit = TouchFit { same: 0.0, opposite: 0.0, opposite_part: 0.0 };
        for i in 0..cosines.nrows() {
            let most = cosines.row(i).iter().copied().fold(-1.0, f64::max);
            let least = cosines.row(i).iter().copied().fold(1.0, f64::min);
            fit.same += most / rows.len() as f64;
            fit.opposite -= least / rows.len() as f64;
            fit.opposite_part += if -least > most { 1.0 / rows.len() as f64 } else { 0.0 };
        }
        fit
    }

    /// Whether all signs are turned.
    pub(crate) fn is_turned(&self) -> bool {
        self.opposite > ALL_TURNED && self.opposite > ALL_RATIO * self.same && self.opposite_part >= ALL_PART
    }
}
