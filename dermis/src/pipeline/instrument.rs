//! Checks of a frame before it is used: what an instrument that works cannot send.

use crate::estimate::agreement::{DOUBTFUL, agreement};
use crate::estimate::reciprocal_pairs::{MAX_UNLIKE, UNLIKE_NOISES, contradict};
use crate::pipeline::condition::PartMonitor;
use crate::pipeline::electrodes::{ElectrodeMonitor, ElectrodeTopology, OPEN};
use crate::pipeline::frame::Measurement;
use crate::pipeline::repeats::RepeatMonitor;
use crate::pipeline::statistics::{Statistics, difference};
use crate::pipeline::validity::InvalidReason;
use crate::stats::{rms, upper_median};
use serde::{Deserialize, Serialize};

/// A loop below this part of its reference: the current is measured wrongly.
const SHORT: f64 = 0.2;
/// A loop that differs from its reference by more than this part, beyond what its electrodes explain, is measured
/// wrongly.
const SICK_LOOP: f64 = 0.3;
/// No voltage exceeds that of its drive; the margin covers errors of the instrument's gain.
const ABOVE_DRIVE: f64 = 1.2;
/// The median ratio of values and baseline is in this range; a touch changes the values of part of the channels.
const SCALE: [f64; 2] = [0.6, 1.5];
/// Values of this many times their noise are compared with the baseline, if there are so many.
const SCALED_NOISES: f64 = 10.0;
const MIN_SCALED: usize = 8;
/// Frames whose values jump by this many times the noise, at the median channel, are noisy: a touch changes the values of
/// most channels in one or two frames at most.
const JUMPS: f64 = 4.0;
/// Noisy frames in a row after which the frames are invalid, if there are too few reciprocal channels to tell.
const NOISY_FRAMES: u32 = 3;
/// Reciprocal channels jump alike, by the reciprocity theorem; noise makes them jump differently. Fewest pairs that can
/// tell, and the part of the jumps from which on their differences are noise.
const MIN_PAIRS: usize = 8;
const UNLIKE_JUMPS: f64 = 0.5;
/// Reciprocal channels that [contradict] each other are a fault of one of them, if their difference also exceeds this part of
/// their values: two steps of a converter of 12 bits, one of them the sign, whose range is four times a value. Of values that
/// stay on their step at the tare neither the step nor the noise is known.
const UNLIKE_VALUE: f64 = 4e-3;
/// It has to last for so many frames: a touch can begin between the two measurements.
const UNLIKE_FRAMES: u32 = 6;
/// Median of the absolute value of a standard normal deviate.
const NORMAL_MEDIAN: f64 = 0.674_489_75;
/// Frames with the time of the frame before after which the clock is faulty. (Rows of a file may share a time.)
const SAME_TIME: u32 = 100;

/// The state of the instrument, of its drives and of its channels.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct InstrumentMonitor {
    whole: PartMonitor,
    drives: Vec<PartMonitor>,
    channels: Vec<PartMonitor>,
    /// Channels whose values at the tare are below the voltage of their drive.
    bounded: Vec<bool>,
    /// Channels whose values at the tare are far above their noise.
    scaled: Vec<bool>,
    /// For each pair of reciprocal channels the limit of the difference between their changes, ohm, and the number of
    /// frames in a row that exceed it; empty if they are not checked.
    #[serde(default)]
    unlike_ohm: Vec<f64>,
    #[serde(default)]
    unlike_frames: Vec<u32>,
    #[serde(default)]
    repeats: RepeatMonitor,
    same_time_frames: u32,
    /// The values of the last two frames, ohm, the newest first.
    before_ohm: [Vec<f64>; 2],
    noisy_frames: u32,
}

/// The findings in a frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Findings {
    /// Why the frame cannot be used at all.
    pub reason: Option<InvalidReason>,
    /// Drives whose current is wrong.
    pub drives: Vec<bool>,
    /// Channels whose reading is wrong.
    pub channels: Vec<bool>,
    /// The difference of the frame from the baseline, ohm.
    pub change_ohm: Vec<f64>,
    /// The frame is too noisy to judge drives, channels and electrodes.
    pub is_noisy: bool,
}

/// Drives and channels that cannot be judged because of their electrodes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Unjudged {
    /// Drives of electrodes that are out: their loops measure the contact.
    pub drives: Vec<bool>,
    /// Channels of electrodes that are not in use: they can saturate.
    pub channels: Vec<bool>,
}

/// How the values of a frame have jumped.
struct Jumps {
    /// Those of most channels have.
    are_large: bool,
    /// Those of most pairs of reciprocal channels have jumped differently.
    is_noise: bool,
}

impl InstrumentMonitor {
    /// From untouched frames.
    pub(super) fn new(
        topology: &ElectrodeTopology,
        untouched: &[Measurement],
        statistics: &Statistics,
        noise_ohm: &[f64],
    ) -> Self {
        let is_bounded = |channel: usize| {
            !untouched.is_empty()
                && untouched.iter().all(|frame| {
                    let drive_ohm = frame.loops_ohm.get(topology.drive_of(channel));
                    drive_ohm.is_some_and(|drive_ohm| frame.values_ohm[channel].abs() <= *drive_ohm)
                })
        };
        InstrumentMonitor {
            whole: PartMonitor::default(),
            drives: vec![PartMonitor::default(); topology.drive_count()],
            channels: vec![PartMonitor::default(); topology.channel_count()],
            bounded: (0..topology.channel_count()).map(is_bounded).collect(),
            scaled: (statistics.mean.iter().zip(noise_ohm)).map(|(mean, sd)| mean.abs() > SCALED_NOISES * sd).collect(),
            unlike_ohm: unlike_limits_ohm(topology, statistics, noise_ohm),
            unlike_frames: vec![0; topology.reciprocal_pairs().len()],
            repeats: RepeatMonitor::new(topology.drives_of_channels(), untouched),
            same_time_frames: 0,
            before_ohm: Default::default(),
            noisy_frames: 0,
        }
    }

    /// Of a state without a tare of its own: repeated frames are accepted.
    pub(super) fn unmonitored(topology: &ElectrodeTopology) -> Self {
        let channel_count = topology.channel_count();
        InstrumentMonitor {
            drives: vec![PartMonitor::default(); topology.drive_count()],
            channels: vec![PartMonitor::default(); channel_count],
            bounded: vec![false; channel_count],
            scaled: vec![false; channel_count],
            ..Self::default()
        }
    }

    /// Whether it fits a skin.
    pub(super) fn fits(&self, topology: &ElectrodeTopology) -> bool {
        self.drives.len() == topology.drive_count()
            && [self.channels.len(), self.bounded.len(), self.scaled.len()] == [topology.channel_count(); 3]
            && self.unlike_ohm.len() == self.unlike_frames.len()
            && [0, topology.reciprocal_pairs().len()].contains(&self.unlike_ohm.len())
    }

    /// Checks a frame. `step_s`: time since the last frame.
    pub(super) fn check(
        &mut self,
        topology: &ElectrodeTopology,
        electrodes: &ElectrodeMonitor,
        baseline_ohm: &[f64],
        frame: &Measurement,
        step_s: f64,
    ) -> Findings {
        let loops = loop_ratios(electrodes, frame);
        let (drives, is_off) = self.check_drives(topology, electrodes, frame, &loops);
        let mut channels = self.check_channels(topology, frame, &drives);
        let change_ohm = difference(&frame.values_ohm, baseline_ohm);
        self.check_pairs(topology, electrodes, [&loops, &frame.values_ohm, &change_ohm], &drives, &mut channels);
        let jumps = self.jumps(topology, electrodes.noise_ohm(), frame);
        let reason = match () {
            () if self.clock_stands(step_s) => Some(InvalidReason::Clock),
            () if self.repeats.check(frame) => Some(InvalidReason::Frozen),
            () if is_most(&is_off) => Some(InvalidReason::NoCurrent),
            () if is_most(&channels) => Some(InvalidReason::OutOfRange),
            () if self.is_unlike(baseline_ohm, frame, &channels) => Some(InvalidReason::Scale),
            () if jumps.is_noise || self.noisy_frames >= NOISY_FRAMES => Some(InvalidReason::Noise),
            () => None,
        };
        Findings { reason, drives, channels, change_ohm, is_noisy: jumps.are_large }
    }

    /// Drives with a wrong current, and those without current.
    fn check_drives(
        &self,
        topology: &ElectrodeTopology,
        electrodes: &ElectrodeMonitor,
        frame: &Measurement,
        ratio: &[f64],
    ) -> (Vec<bool>, Vec<bool>) {
        let reference = electrodes.loops_ohm();
        if ratio.is_empty() {
            return (vec![false; topology.drive_count()], vec![false; topology.drive_count()]);
        }
        let rise_ohm = |drive: usize| frame.loops_ohm[drive] - reference[drive];
        // The rise that all drives of an electrode share is that of its contact.
        let of_electrode = |&electrode: &usize, drive: usize| {
            let others = topology.drives_of(electrode).iter().filter(|&&other| other != drive);
            others.map(|&other| rise_ohm(other)).reduce(f64::min).unwrap_or(rise_ohm(drive)).max(0.0)
        };
        let is_sick = |drive: usize| {
            let explained: f64 = topology.ends_of(drive).iter().map(|electrode| of_electrode(electrode, drive)).sum();
            let unexplained = rise_ohm(drive) - explained.min(rise_ohm(drive).max(0.0));
            !(SHORT..=OPEN).contains(&ratio[drive]) && explained < 0.5 * rise_ohm(drive)
                || unexplained.abs() > SICK_LOOP * reference[drive]
        };
        let is_off = ratio.iter().map(|ratio| !(SHORT..=OPEN).contains(ratio)).collect();
        ((0..ratio.len()).map(is_sick).collect(), is_off)
    }

    /// Channels whose reading is saturated or exceeds the voltage of its drive.
    fn check_channels(&self, topology: &ElectrodeTopology, frame: &Measurement, sick_drives: &[bool]) -> Vec<bool> {
        let mut bad = vec![false; topology.channel_count()];
        frame.saturated.iter().for_each(|&channel| bad[channel] = true);
        for (channel, bad) in bad.iter_mut().enumerate() {
            let drive = topology.drive_of(channel);
            let is_checked = self.bounded[channel] && !sick_drives[drive];
            let limit_ohm = frame.loops_ohm.get(drive).map_or(f64::INFINITY, |ohm| ABOVE_DRIVE * ohm);
            *bad |= is_checked && frame.values_ohm[channel].abs() > limit_ohm;
        }
        bad
    }

    /// Marks reciprocal channels that do not change alike. A pair is judged if its electrodes, drives and readings are
    /// sound and if both channels or none are masked: the baseline of a channel that was masked alone is older.
    fn check_pairs(
        &mut self,
        topology: &ElectrodeTopology,
        electrodes: &ElectrodeMonitor,
        [ratios, values_ohm, change_ohm]: [&[f64]; 3],
        sick_drives: &[bool],
        bad: &mut [bool],
    ) {
        if self.unlike_ohm.is_empty() {
            return;
        }
        let mut unjudged = bad.to_vec();
        topology.mark_channels_of(electrodes.in_condition(PartMonitor::is_masked), &mut unjudged);
        for (channel, unjudged) in unjudged.iter_mut().enumerate() {
            let drive = topology.drive_of(channel);
            *unjudged |= sick_drives[drive] || self.drives[drive].is_masked();
        }
        let judged = change_ohm.iter().zip(&unjudged).filter(|(_, unjudged)| !**unjudged);
        let usual_ohm = rms(judged.map(|(change, _)| *change));
        // The values of a drive and the resistance of its loop are voltages over one current: an error of the current, as a step of
        // its converter, changes them by the same part, and those of the reciprocal drive by none.
        let by_current_ohm = |channel: usize| {
            let ratio = ratios.get(topology.drive_of(channel)).unwrap_or(&1.0);
            ((ratio - 1.0) * values_ohm[channel]).abs()
        };
        let is_unlike = |(&[a, b], limit_ohm): (&[usize; 2], &f64)| {
            let is_judged = [a, b].iter().all(|&channel| !unjudged[channel])
                && self.channels[a].is_masked() == self.channels[b].is_masked();
            let limit_ohm = limit_ohm + by_current_ohm(a) + by_current_ohm(b);
            is_judged && contradict([change_ohm[a], change_ohm[b]], limit_ohm, usual_ohm)
        };
        let pairs = topology.reciprocal_pairs();
        let unlike: Vec<bool> = pairs.iter().zip(&self.unlike_ohm).map(is_unlike).collect();
        let count = unlike.iter().filter(|unlike| **unlike).count();
        let are_single = count as f64 <= (MAX_UNLIKE * unlike.len() as f64).max(1.0);
        for ((frames, is_unlike), pair) in self.unlike_frames.iter_mut().zip(unlike).zip(pairs) {
            if are_single {
                *frames = if is_unlike { frames.saturating_add(1) } else { 0 };
            }
            if *frames >= UNLIKE_FRAMES {
                pair.iter().for_each(|&channel| bad[channel] = true);
            }
        }
    }

    /// Whether all values are larger or smaller than the baseline by one factor, or as unlike it as values of other channels.
    fn is_unlike(&self, baseline_ohm: &[f64], frame: &Measurement, wrong: &[bool]) -> bool {
        let used = || (0..wrong.len()).filter(|&channel| self.scaled[channel] && !wrong[channel]);
        let ratios: Vec<f64> = used().map(|channel| frame.values_ohm[channel] / baseline_ohm[channel]).collect();
        ratios.len() >= MIN_SCALED
            && (upper_median(&ratios).is_some_and(|ratio| !(SCALE[0]..=SCALE[1]).contains(&ratio))
                || agreement(
                    used().map(|channel| frame.values_ohm[channel]),
                    used().map(|channel| baseline_ohm[channel]),
                ) < DOUBTFUL)
    }

    /// How the values have jumped. The jump is the second difference of three frames, which is small for steady changes.
    fn jumps(&mut self, topology: &ElectrodeTopology, noise_ohm: &[f64], frame: &Measurement) -> Jumps {
        let [last, second] = &mut self.before_ohm;
        let jump_ohm: Vec<f64> = (frame.values_ohm.iter().zip(&*last).zip(&*second))
            .map(|((value, last), second)| value - 2.0 * last + second)
            .collect();
        std::mem::swap(last, second);
        last.clone_from(&frame.values_ohm);
        let single = median_size(jump_ohm.iter().zip(noise_ohm).map(|(jump, noise)| jump / noise));
        let are_large = exceeds_noise(single);
        let pairs = topology.reciprocal_pairs().iter().filter(|_| are_large && !jump_ohm.is_empty());
        let unlike = pairs.map(|&[a, b]| (jump_ohm[a] - jump_ohm[b]) / noise_ohm[a].hypot(noise_ohm[b]));
        let unlike: Vec<f64> = unlike.collect();
        let can_tell = unlike.len() >= MIN_PAIRS;
        let unlike = median_size(unlike.into_iter());
        // Of noise both are equal; of a touch that moves the pairs differ by what it moves from one to the other.
        let is_noise = can_tell && exceeds_noise(unlike) && unlike > UNLIKE_JUMPS * single;
        self.noisy_frames = if are_large && !can_tell { self.noisy_frames + 1 } else { 0 };
        Jumps { are_large, is_noise }
    }

    fn clock_stands(&mut self, step_s: f64) -> bool {
        self.same_time_frames = if step_s > 0.0 { 0 } else { self.same_time_frames.saturating_add(1) };
        self.same_time_frames > SAME_TIME
    }

    /// Takes the findings of a frame in which drives and channels can be judged. `is_untouched`: of the frame before.
    pub(super) fn update_parts(&mut self, findings: &Findings, unjudged: &Unjudged, is_untouched: bool, time_s: f64) {
        let drives = self.drives.iter_mut().zip(&findings.drives).zip(&unjudged.drives);
        let channels = self.channels.iter_mut().zip(&findings.channels).zip(&unjudged.channels);
        for ((part, is_bad), _) in drives.chain(channels).filter(|(_, unjudged)| !**unjudged) {
            part.update(*is_bad, is_untouched, time_s);
        }
    }

    /// Takes a frame that is invalid or not; returns the reason for which it is not used.
    pub(super) fn update_whole(&mut self, reason: Option<InvalidReason>, time_s: f64) -> Option<InvalidReason> {
        self.whole.update(reason.is_some(), true, time_s);
        reason.or(self.whole.is_confirmed().then_some(InvalidReason::OnTrial))
    }

    /// Drives that are confirmed as bad.
    pub(super) fn bad_drives(&self) -> Vec<usize> {
        (0..self.drives.len()).filter(|&drive| self.drives[drive].is_confirmed()).collect()
    }

    /// Channels that are confirmed as bad, without those of bad drives.
    pub(super) fn bad_channels(&self) -> Vec<usize> {
        (0..self.channels.len()).filter(|&channel| self.channels[channel].is_confirmed()).collect()
    }

    /// Marks what the findings of a frame concern.
    pub(super) fn mark_findings(topology: &ElectrodeTopology, findings: &Findings, marked: &mut [bool]) {
        for (channel, marked) in marked.iter_mut().enumerate() {
            *marked |= findings.channels[channel] || findings.drives[topology.drive_of(channel)];
        }
    }

    /// Marks the channels of parts for which `holds`.
    pub(super) fn mark(&self, topology: &ElectrodeTopology, holds: fn(&PartMonitor) -> bool, marked: &mut [bool]) {
        for (channel, marked) in marked.iter_mut().enumerate() {
            *marked |= holds(&self.channels[channel]) || holds(&self.drives[topology.drive_of(channel)]);
        }
    }
}

/// For each pair of reciprocal channels the limit of the difference between their changes, ohm. A channel can be
/// constant at the tare, with a coarse converter: the median noise of all channels is the least.
fn unlike_limits_ohm(topology: &ElectrodeTopology, statistics: &Statistics, noise_ohm: &[f64]) -> Vec<f64> {
    let least_ohm = upper_median(noise_ohm).unwrap_or(0.0);
    let noise = |channel: usize| noise_ohm[channel].max(least_ohm);
    let limit = |&[a, b]: &[usize; 2]| {
        let value_ohm = statistics.mean[a].abs().max(statistics.mean[b].abs());
        (UNLIKE_NOISES * noise(a).hypot(noise(b))).max(UNLIKE_VALUE * value_ohm)
    };
    topology.reciprocal_pairs().iter().map(limit).collect()
}

/// The resistance of each drive's loop over its reference; empty where it is not measured.
fn loop_ratios(electrodes: &ElectrodeMonitor, frame: &Measurement) -> Vec<f64> {
    let (now, then) = (&frame.loops_ohm, electrodes.loops_ohm());
    if now.len() == then.len() { now.iter().zip(then).map(|(now, then)| now / then).collect() } else { Vec::new() }
}

/// Whether most are marked.
pub(super) fn is_most(marked: &[bool]) -> bool {
    2 * marked.iter().filter(|marked| **marked).count() > marked.len()
}

/// The median size of second differences, in units of the noise of a value; 0 without one.
fn median_size(jumps: impl Iterator<Item = f64>) -> f64 {
    upper_median(&jumps.map(f64::abs).collect::<Vec<f64>>()).unwrap_or(0.0)
}

/// Whether it is far above noise.
fn exceeds_noise(median: f64) -> bool {
    median > JUMPS * NORMAL_MEDIAN * 6f64.sqrt()
}
