//! Findings in words: what differs, and the field of the design to change.

use crate::checks::Figures;
use crate::checks::model::ModelChannels;
use crate::checks::order::Score;
use crate::checks::orders::{Change, Order};
use crate::lags::LagEvidence;
use dermis::finding::{Finding, FindingKind};
use dermis::frame::Frame;
use dermis::protocol::Protocol;
use dermis::stats::{mean_and_sd, rms, upper_median};
use dermis::text::counted;

/// Below this cosine an untouched frame is unlike the model.
pub(super) const UNLIKE: f64 = 0.5;
/// A channel is noise if the others explain less than this part of its variance.
pub(super) const NOISE: f64 = 0.05;
/// Noise is looked for where the others explain at least this part of the median channel.
const EXPLAINED: f64 = 0.2;
/// A noisy channel is dead if its scale is less than this part of what the model says; weak channels may be noise on a
/// sound skin.
const QUIET: f64 = 0.3;
/// Signs are lost if amplitudes fit the changes better by this factor.
const LOST_RATIO: f64 = 1.3;
/// ... and by this cosine.
const LOST_LEAST: f64 = 0.15;

/// The order of the channels differs from that of the design.
pub(super) fn order(order: &Order, score: Score, own: Score, protocol: &Protocol) -> Finding {
    let changes: Vec<String> = order.changes.iter().map(|change| words(*change, protocol)).collect();
    let (value, instead, what) = match own.untouched == 0.0 {
        false => (score.untouched.abs(), own.untouched.abs(), "untouched frame"),
        true => (score.changes, own.changes, "correlations between channels"),
    };
    let evidence = format!(
        "cosine of the {what} with the model in this order: {}; {instead:.3} in that of the design",
        changes.join(", ")
    );
    let moved = (0..order.columns.len()).filter(|&channel| order.columns[channel] != channel).collect();
    Finding::new(FindingKind::Order, value, evidence, fix(order, protocol)).at_channels(moved)
}

fn words(change: Change, protocol: &Protocol) -> String {
    match change {
        Change::StartAtDrive(0) => "the measurements of each drive start at its source".into(),
        Change::StartAtDrive(k) => {
            format!("the measurements of each drive start {} after its source", counted(k, "electrode"))
        }
        Change::StartAtElectrode(k) => format!("the measurements of each drive start at electrode {k}"),
        Change::MeasuresDescending => "they come in descending order".into(),
        Change::DrivesRotated(k) => format!("the first drive is that of number {k}"),
        Change::DrivesDescending => "the drives come in descending order".into(),
        Change::MeasureMajor => "frames are ordered by measurement, then by drive".into(),
        Change::ElectrodesRotated(k) => format!("electrode 0 is the design's electrode {k}"),
        Change::ElectrodesMirrored(k) => {
            format!(
                "the electrodes are numbered the other way round, from the design's electrode {}",
                k % protocol.electrode_count()
            )
        }
        Change::DrivesPermuted => "drives are exchanged".into(),
    }
}

/// The field of the design that states this order.
fn fix(order: &Order, protocol: &Protocol) -> String {
    let count = protocol.electrode_count();
    match order.changes[..] {
        [Change::StartAtDrive(0)] => "set protocol.measures_start = \"drive\"".into(),
        [Change::StartAtElectrode(0)] => "set protocol.measures_start = \"electrode_zero\"".into(),
        [Change::ElectrodesRotated(k)] => format!(
            "turn the numbering: electrode e of the instrument is electrode e + {k} of the design (a rim: first_theta_rad + \
             {:.4})",
            k as f64 / count as f64 * std::f64::consts::TAU
        ),
        [Change::ElectrodesMirrored(_)] => {
            "reverse the numbering: electrodes.layout.rim.direction, or the order of the positions".into()
        }
        _ => "write the channels in the order of the instrument as a table: protocol.pattern = { table = \"channels.csv\" }".into(),
    }
}

/// The untouched frame fits in no order.
pub(super) fn unlike(own: Score) -> Finding {
    let evidence = "cosine of the untouched frame with that of the model; no other order fits better";
    let fix = "check protocol.pattern, the positions of the electrodes and the untouched frames";
    Finding::new(FindingKind::UnlikeModel, own.untouched.abs(), evidence, fix)
}

/// All signs turned, by the untouched frame.
pub(super) fn turned_untouched(cosine: f64, protocol: &Protocol) -> Finding {
    let evidence = "cosine of the untouched frame with that of the model";
    Finding::new(FindingKind::SignTurned, cosine, evidence, reversal(protocol))
}

/// All signs turned, by the changes.
pub(super) fn turned_changes(cosine: f64, untouched_fits: bool, protocol: &Protocol) -> Finding {
    let evidence = "mean cosine of the frames with the best single touch of the opposite sign";
    let touch = "set sheet.touch to the other value (conductance_rises, conductance_falls)";
    let fix = match untouched_fits || protocol.amplitude_only() {
        true => touch.to_string(),
        false => format!("{}; or {touch}", reversal(protocol)),
    };
    Finding::new(FindingKind::SignTurned, -cosine, evidence, fix)
}

/// The field that reverses the measure pairs.
fn reversal(protocol: &Protocol) -> String {
    let [a, b] = protocol.channels()[0].measure;
    let reversed = (b + 1) % protocol.electrode_count() == a;
    format!("set protocol.measures_reversed = {}", !reversed)
}

/// Signs lost, where amplitudes fit the changes better than signed values.
pub(super) fn lost(amplitudes: f64, signed: f64) -> Option<Finding> {
    let evidence =
        format!("cosine of the correlations between channels with those of amplitudes; {signed:.3} with signs");
    let found = amplitudes > LOST_LEAST && amplitudes > LOST_RATIO * signed;
    let fix = "record signed values, or set protocol.amplitude_only = true";
    found.then(|| Finding::new(FindingKind::SignLost, amplitudes, evidence, fix))
}

/// Channels with the opposite sign.
pub(super) fn turned(columns: Vec<usize>, worst: f64) -> Finding {
    let (value, what) = match worst == -1.0 {
        true => (columns.len() as f64, "channels whose untouched value has the sign opposite to that of the model"),
        false => (worst, "smallest cosine of a drive's correlations with the other channels to those of the model"),
    };
    let fix = "exchange source and sink of a drive, plus and minus of a measurement, or multiply these channels by -1";
    Finding::new(FindingKind::SignTurned, value, what, fix).at_channels(columns)
}

/// An electrode without connection.
pub(super) fn open(electrode: usize) -> Finding {
    let evidence =
        "most values of each of its drives scatter far more than others in the untouched frames, or are constant";
    let fix = "check its wire and its contact; the other commands leave its channels out";
    Finding::new(FindingKind::OpenElectrode, f64::NAN, evidence, fix).at_electrodes([electrode])
}

/// The channels of one lag.
pub(super) fn late(lag: i32, lags: &[i32], figures: &Figures) -> Option<Finding> {
    let channels: Vec<usize> = (0..lags.len()).filter(|&channel| lags[channel] == lag).collect();
    if channels.is_empty() {
        return None;
    }
    let at = |lag: i32| figures.lags.iter().position(|other| *other == lag).expect("a lag that was tried");
    let median = |lag: i32| {
        let values: Vec<f64> =
            channels.iter().filter_map(|&channel| figures.lag_explained[channel].get(at(lag)).copied()).collect();
        upper_median(&values).unwrap_or(0.0)
    };
    let way = if lag > 0 { "late" } else { "early" };
    let evidence =
        format!("part of the median channel that the others explain at this lag; {:.3} at the same row", median(0));
    let fix =
        format!("{} {way}: mend them with --realign (dermis calibrate mends them itself)", counted(lag.abs(), "row"));
    Some(Finding { lag, ..Finding::new(FindingKind::Late, median(lag), evidence, fix).at_channels(channels) })
}

/// Channels of the design that are noise: no other channel explains them at any lag, and their scale is far below what
/// the model says of them.
pub(super) fn noise_only(evidence: &LagEvidence, aligned: &[Frame], model: &ModelChannels) -> Vec<usize> {
    let best: Vec<f64> =
        evidence.explained.iter().map(|each| each.iter().copied().fold(f64::NEG_INFINITY, f64::max)).collect();
    if best.is_empty() || upper_median(&best).unwrap_or(0.0) < EXPLAINED {
        return Vec::new();
    }
    let sd = |channel: usize| mean_and_sd(&aligned.iter().map(|frame| frame[channel]).collect::<Vec<_>>()).1;
    let expected = |channel: usize| rms(model.touches.col(channel).iter().copied()).max(f64::MIN_POSITIVE);
    let ratios: Vec<f64> = (0..best.len()).map(|channel| sd(channel) / expected(channel)).collect();
    let usual = upper_median(&ratios).unwrap_or(0.0);
    (0..best.len()).filter(|&channel| best[channel] < NOISE && ratios[channel] < QUIET * usual).collect()
}
