//! Channels and rows whose values alone show that something is wrong: constant, piled up at a limit, far outside the
//! range.

use dermis::finding::{Finding, FindingKind};
use dermis::frame::Frame;
use dermis::stats::{quantile, sorted, upper_median};

/// A channel is constant if this part of its values is one number.
const SAME: f64 = 0.98;
/// A channel is saturated if its largest (or smallest) value makes up this part of its rows...
const PILED: f64 = 0.02;
/// ... at least this many rows ...
const PILED_ROWS: usize = 5;
/// ... and this many times those in the next part [`BESIDE`] of its range.
const PILED_RATIO: usize = 2;
/// The part of the range next to a limit.
const BESIDE: f64 = 0.05;
/// ... and this many times the most frequent of the values between its limits: those of a coarsely quantized channel all come often.
const PILED_OVER: usize = 3;
/// Most different values of a channel whose steps are coarse.
const MAX_LEVELS: usize = 10;
/// A value is an outlier if it is this many times farther from the median than 99 % of its channel's values, ...
const FAR_VALUE: f64 = 30.0;
/// ... and at most this part of the frame's other values are farther than [`FAR_FRAME`]: a hard press shows in many
/// channels.
const FAR_OTHERS: f64 = 0.02;
/// A frame is an outlier if a quarter of its channels are this many times farther from the median than 99 % of their
/// values.
const FAR_FRAME: f64 = 3.0;
/// Part of the channels of an outlier frame.
const FAR_PART: f64 = 0.25;
/// Fewest rows for statistics of a channel.
pub(super) const MIN_ROWS: usize = 20;

/// The columns of frames.
pub(crate) fn columns(frames: &[Frame]) -> Vec<Vec<f64>> {
    let channels = frames.first().map_or(0, |frame| frame.len());
    (0..channels).map(|channel| frames.iter().map(|frame| frame[channel]).collect()).collect()
}

/// Channels of which nearly all values are one number.
pub(crate) fn constant_channels(columns: &[Vec<f64>]) -> Vec<usize> {
    let is_constant = |column: &Vec<f64>| {
        let middle = upper_median(column).unwrap_or(0.0);
        let same = column.iter().filter(|value| **value == middle).count();
        column.len() >= 3 && same as f64 >= SAME * column.len() as f64
    };
    (0..columns.len()).filter(|&channel| is_constant(&columns[channel])).collect()
}

/// The finding of channels that do not respond.
pub(crate) fn dead(channels: Vec<usize>, constant: usize, explained: f64) -> Option<Finding> {
    let noisy = channels.len() - constant;
    let evidence = match (constant, noisy) {
        (_, 0) => "part of the values that are one number".to_string(),
        _ => format!("{constant} constant; of the others the other channels explain at most this part"),
    };
    let value = if noisy == 0 { 1.0 } else { explained };
    let fix = "check the wiring of these channels; leave them out with --leave-out where a command has it";
    let found = Finding::new(FindingKind::Dead, value, evidence, fix);
    (!channels.is_empty()).then(|| found.at_channels(channels))
}

/// Channels whose values pile up at their largest or smallest value. Of few levels it is not the untouched one, or without untouched
/// frames the median: coarse steps hide small changes, and touches change a channel in one direction.
pub(crate) fn saturated(columns: &[Vec<f64>], untouched: &[Frame], dead: &[usize]) -> Option<Finding> {
    let rest = |channel: usize| {
        let values = untouched.iter().map(|frame| frame[channel]);
        let range = values.fold(None, |range: Option<[f64; 2]>, value| {
            let [low, high] = range.unwrap_or([value; 2]);
            Some([low.min(value), high.max(value)])
        });
        range.or_else(|| upper_median(&columns[channel]).map(|median| [median; 2]))
    };
    let piled: Vec<(usize, f64)> = (0..columns.len())
        .filter(|channel| !dead.contains(channel))
        .filter_map(|channel| Some((channel, piled_part(&columns[channel], rest(channel)?)?)))
        .collect();
    let most = piled.iter().map(|(_, part)| *part).fold(0.0, f64::max);
    let evidence = "largest part of a channel's values that are exactly its limit";
    let fix = "lower the gain or the drive current, and record again: the values beyond the limit are lost";
    let found = Finding::new(FindingKind::Saturated, most, evidence, fix);
    (!piled.is_empty()).then(|| found.at_channels(piled.into_iter().map(|(channel, _)| channel).collect()))
}

/// The part of the values at a limit, where they pile up; not at the untouched values, which are in a range.
fn piled_part(column: &[f64], [rest_low, rest_high]: [f64; 2]) -> Option<f64> {
    let sorted = sorted(column.iter().copied());
    let (low, high) = (*sorted.first()?, *sorted.last()?);
    let beside = BESIDE * (high - low);
    let levels = sorted.chunk_by(|a, b| a == b).count();
    let step = sorted.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min);
    let at = |limit: f64| sorted.iter().filter(|value| **value == limit).count();
    let near = |limit: f64| sorted.iter().filter(|value| **value != limit && (**value - limit).abs() <= beside).count();
    let piled = |limit: f64| {
        let (at, near) = (at(limit), near(limit));
        let enough = at >= PILED_ROWS && at as f64 >= PILED * sorted.len() as f64;
        let alone = at >= PILED_RATIO * near && at >= PILED_OVER * most_frequent_between(&sorted, [low, high]);
        let is_rest = levels <= MAX_LEVELS && (rest_low - step..=rest_high + step).contains(&limit);
        (enough && alone && high > low && !is_rest).then_some(at as f64 / sorted.len() as f64)
    };
    [low, high].into_iter().filter_map(piled).reduce(f64::max)
}

/// How often the most frequent of ascending values between two limits occurs.
fn most_frequent_between(sorted: &[f64], [low, high]: [f64; 2]) -> usize {
    let equal = sorted.chunk_by(|a, b| a == b);
    equal.filter(|equal| low < equal[0] && equal[0] < high).map(<[f64]>::len).max().unwrap_or(0)
}

/// The distance of each value from the median of its channel, in units of that below which 99 % of them lie.
pub(crate) fn distances(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let of_column = |column: &Vec<f64>| {
        let middle = upper_median(column).unwrap_or(0.0);
        let apart: Vec<f64> = column.iter().map(|value| (value - middle).abs()).collect();
        let sorted = sorted(apart.iter().copied());
        let scale = quantile(&sorted, 0.99).max(4.0 * quantile(&sorted, 0.5));
        apart.into_iter().map(|apart| if scale > 0.0 { apart / scale } else { 0.0 }).collect()
    };
    columns.iter().map(of_column).collect()
}

/// Frames and single values far outside the range of the others.
pub(crate) fn outliers(columns: &[Vec<f64>], dead: &[usize]) -> Vec<Finding> {
    let rows = columns.first().map_or(0, Vec::len);
    if rows < MIN_ROWS {
        return Vec::new();
    }
    let used: Vec<usize> = (0..columns.len()).filter(|channel| !dead.contains(channel)).collect();
    let distances = distances(columns);
    let beyond =
        |row: usize, limit: f64| used.iter().copied().filter(|&c| distances[c][row] > limit).collect::<Vec<_>>();
    let (mut frames, mut values, mut channels) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..rows {
        let (far, farther) = (beyond(row, FAR_FRAME).len() as f64, beyond(row, FAR_VALUE));
        if far > FAR_PART * used.len() as f64 {
            frames.push(row);
        } else if !farther.is_empty() && far - 1.0 <= FAR_OTHERS * used.len() as f64 {
            values.push(row);
            channels.extend(farther);
        }
    }
    channels.sort_unstable();
    channels.dedup();
    let most = |rows: &[usize]| {
        let of_row = |&row: &usize| used.iter().map(|&channel| distances[channel][row]).fold(0.0, f64::max);
        rows.iter().map(of_row).fold(0.0, f64::max)
    };
    outlier_findings([most(&frames), most(&values)], frames, values, channels)
}

/// The findings of outlier frames and of rows with outlier values, with the largest distance of each.
fn outlier_findings(most: [f64; 2], frames: Vec<usize>, values: Vec<usize>, channels: Vec<usize>) -> Vec<Finding> {
    let evidence = "largest distance from the median of a channel, over the distance of 99 % of its values";
    let mut found = Vec::new();
    if !frames.is_empty() {
        let fix = "remove these rows from the frames and from the truth";
        found.push(Finding { rows: frames, ..Finding::new(FindingKind::OutlierFrame, most[0], evidence, fix) });
    }
    if !values.is_empty() {
        let fix = "check the converter and the wiring of these channels; remove these rows before training";
        let finding = Finding::new(FindingKind::OutlierValue, most[1], evidence, fix);
        found.push(Finding { rows: values, ..finding.at_channels(channels) });
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(rows: usize, phase: f64) -> Vec<f64> {
        (0..rows).map(|row| (row as f64 * 0.7 + phase).sin() * (1.0 + (row as f64 * 0.13).cos())).collect()
    }

    #[test]
    fn quantized_readings_over_a_measured_current_are_not_saturated() {
        // Levels of the converter over a current that varies by 1 %; the lowest is as frequent as the others.
        let column: Vec<f64> =
            (0..420_i32).map(|row| f64::from(1 + row % 12) / (100.0 + f64::from(row % 7 / 6))).collect();
        assert!(saturated(&[column], &[], &[]).is_none());
    }

    #[test]
    fn small_changes_from_the_untouched_value_are_not_saturated() {
        let column: Vec<f64> = (0..30).map(|row| if row % 7 == 6 { 1.1 } else { 1.0 }).collect();
        assert!(saturated(std::slice::from_ref(&column), &[Frame(vec![1.01])], &[]).is_none());
        assert!(saturated(std::slice::from_ref(&column), &[], &[]).is_none());
        assert!(saturated(&[column], &[Frame(vec![0.5])], &[]).is_some());
    }

    #[test]
    fn constants_limits_and_outliers_are_told_apart() {
        let mut columns: Vec<Vec<f64>> = (0..8).map(|k| wave(200, f64::from(k))).collect();
        assert!(constant_channels(&columns).is_empty() && saturated(&columns, &[], &[]).is_none());
        assert!(outliers(&columns, &[]).is_empty());
        columns[2] = vec![3.0; 200];
        columns[5].iter_mut().for_each(|value| *value = value.min(0.8));
        columns[6][17] = 400.0;
        columns.iter_mut().for_each(|column| column[90] += 30.0);
        let dead = constant_channels(&columns);
        assert_eq!(dead, vec![2]);
        assert_eq!(saturated(&columns, &[], &dead).map(|found| found.channels), None, "one frame is above the limit");
        columns.iter_mut().for_each(|column| column[90] -= 30.0);
        assert_eq!(saturated(&columns, &[], &dead).map(|found| found.channels), Some(vec![5]));
        columns.iter_mut().for_each(|column| column[90] += 30.0);
        let found = outliers(&columns, &dead);
        assert_eq!((found[0].kind, &found[0].rows[..]), (FindingKind::OutlierFrame, &[90][..]));
        assert_eq!(
            (found[1].kind, &found[1].rows[..], &found[1].channels[..]),
            (FindingKind::OutlierValue, &[17][..], &[6][..])
        );
    }
}
