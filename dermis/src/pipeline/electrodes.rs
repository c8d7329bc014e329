//! Monitoring of electrodes and channels, frame by frame.
//!
//! A loose contact differs from a touch in two ways. The resistance of every loop through it (source, skin, sink) rises
//! by the same amount, and so does every channel that measures at it while it is driven; all other channels keep their
//! values. The smallest rise over an electrode's loops and such channels is the rise of its contact resistance. A touch
//! that raises the conductance lowers all of them; one that lowers it raises them by far less than a third.

use crate::design::TouchEffect;
use crate::pipeline::condition::{Condition, PartMonitor};
use crate::pipeline::frame::Measurement;
use crate::pipeline::health::{ElectrodeHealth, ElectrodeState};
use crate::pipeline::statistics::Statistics;
use crate::protocol::Protocol;
use crate::skin::Skin;
use crate::stats::{rms, upper_median};
use serde::{Deserialize, Serialize};

/// Limit of a contact's rise, in standard deviations of a reading's noise.
const NOISES: f64 = 6.0;
/// The same as a fraction of the smallest loop: for touches that lower loops, and for touches that raise them.
const PART_RISES: f64 = 0.01;
const PART_FALLS: f64 = 0.3;
/// A loop of more than this many times its resistance at the tare is open.
pub(super) const OPEN: f64 = 20.0;
/// Weight of each frame in the smoothed rise.
const SMOOTH: f64 = 0.02;
/// Time constant of the noise, s.
const NOISE_S: f64 = 1.0;
/// Time constant with which the reference of good contacts follows, s.
const FOLLOW_S: f64 = 60.0;
/// At the tare, an electrode is loose if each of its loops is this many times the median loop.
const LOOSE_AT_TARE: f64 = 3.0;
/// An untouched electrode this many times noisier than at the tare is doubtful.
const DOUBTFUL: f64 = 4.0;
/// A touch next to an electrode on trial changes the channels that do not measure its contact, root mean square, by more
/// than this many times their noise.
const HIDDEN_NOISES: f64 = 1.5;
/// A loop that grows to more than this many times its reference is not followed.
const FOLLOWED: f64 = 2.0;

/// The electrodes, drives and channels of a skin, and their relations.
#[derive(Debug, Clone)]
pub(super) struct ElectrodeTopology {
    /// Whether each electrode is never used.
    left_out: Vec<bool>,
    /// The drives of each electrode, and the electrodes of each drive.
    drives: Vec<Vec<usize>>,
    drive_ends: Vec<[usize; 2]>,
    /// The drive of each channel.
    drive_of: Vec<usize>,
    /// For each electrode the channels that change with its contact resistance, with the sign of the change.
    contact_channels: Vec<Vec<(usize, f64)>>,
    /// The channels of each electrode.
    channels: Vec<Vec<usize>>,
    /// Pairs of reciprocal channels.
    reciprocal: Vec<[usize; 2]>,
    contacts_ohm: Vec<f64>,
    /// Limit of a contact's rise, as a fraction of its smallest loop.
    part: f64,
    channel_count: usize,
    drive_count: usize,
}

impl ElectrodeTopology {
    /// Of a skin whose electrodes are used but for some.
    pub(super) fn of(skin: &Skin, left_out: &[usize]) -> Self {
        let protocol = &skin.design().protocol;
        let (drives, drive_of) = protocol.drives();
        let electrodes = 0..skin.design().electrodes.len();
        let drives_of =
            |electrode: usize| (0..drives.len()).filter(|&drive| drives[drive].contains(&electrode)).collect();
        ElectrodeTopology {
            left_out: electrodes.clone().map(|electrode| left_out.contains(&electrode)).collect(),
            drives: electrodes.clone().map(drives_of).collect(),
            contact_channels: electrodes.clone().map(|electrode| contact_channels(protocol, electrode)).collect(),
            channels: electrodes.clone().map(|electrode| skin.channels_of(electrode).collect()).collect(),
            reciprocal: protocol.reciprocal_pairs(),
            contacts_ohm: electrodes.map(|electrode| skin.forward().contact_resistance_ohm(electrode)).collect(),
            part: match skin.design().sheet.touch {
                TouchEffect::ConductanceRises => PART_RISES,
                TouchEffect::ConductanceFalls => PART_FALLS,
            },
            channel_count: protocol.channel_count(),
            drive_count: drives.len(),
            drive_ends: drives,
            drive_of,
        }
    }

    /// Channels of a frame.
    pub(super) fn channel_count(&self) -> usize {
        self.channel_count
    }

    /// Drives of a frame.
    pub(super) fn drive_count(&self) -> usize {
        self.drive_count
    }

    /// The drive of a channel.
    pub(super) fn drive_of(&self, channel: usize) -> usize {
        self.drive_of[channel]
    }

    /// The drives of all channels.
    pub(super) fn drives_of_channels(&self) -> &[usize] {
        &self.drive_of
    }

    /// Whether an electrode is never used.
    pub(super) fn leaves_out(&self, electrode: usize) -> bool {
        self.left_out[electrode]
    }

    /// The channels that use an electrode which is never used.
    pub(super) fn left_out_channels(&self) -> Vec<usize> {
        let electrodes = (0..self.left_out.len()).filter(|&electrode| self.left_out[electrode]);
        let mut channels: Vec<usize> = electrodes.flat_map(|electrode| &self.channels[electrode]).copied().collect();
        channels.sort_unstable();
        channels.dedup();
        channels
    }

    /// The drives of an electrode.
    pub(super) fn drives_of(&self, electrode: usize) -> &[usize] {
        &self.drives[electrode]
    }

    /// The two electrodes of a drive.
    pub(super) fn ends_of(&self, drive: usize) -> &[usize; 2] {
        &self.drive_ends[drive]
    }

    /// Pairs of reciprocal channels, the lower number first.
    pub(super) fn reciprocal_pairs(&self) -> &[[usize; 2]] {
        &self.reciprocal
    }

    /// The channels of an electrode that do not change with its contact resistance.
    fn field_channels(&self, electrode: usize) -> impl Iterator<Item = usize> {
        let contact = &self.contact_channels[electrode];
        self.channels[electrode].iter().copied().filter(|channel| contact.iter().all(|(other, _)| other != channel))
    }

    /// Whether a measurement has a value for each channel, and either one for each drive or none.
    pub(super) fn fits(&self, frame: &Measurement) -> bool {
        frame.values_ohm.len() == self.channel_count && self.fits_loops(&frame.loops_ohm)
    }

    fn fits_loops(&self, loops_ohm: &[f64]) -> bool {
        loops_ohm.is_empty() || loops_ohm.len() == self.drive_count
    }

    /// Marks the drives of some electrodes.
    pub(super) fn mark_drives_of(&self, electrodes: impl Iterator<Item = usize>, marked: &mut [bool]) {
        for electrode in electrodes {
            self.drives[electrode].iter().for_each(|&drive| marked[drive] = true);
        }
    }

    /// Marks the channels of some electrodes.
    pub(super) fn mark_channels_of(&self, electrodes: impl Iterator<Item = usize>, marked: &mut [bool]) {
        for electrode in electrodes {
            self.channels[electrode].iter().for_each(|&channel| marked[channel] = true);
        }
    }
}

/// The channels that change with an electrode's contact resistance, with the sign of the change. For an instrument that
/// reports amplitudes, the sign of the amplitude's change.
fn contact_channels(protocol: &Protocol, electrode: usize) -> Vec<(usize, f64)> {
    let gains = protocol.contact_gains(electrode).enumerate();
    let signed = gains.map(|(channel, gain)| (channel, if protocol.amplitude_only() { gain.abs() } else { gain }));
    signed.filter(|(_, gain)| *gain != 0.0).collect()
}

/// The state of electrodes and channels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct ElectrodeMonitor {
    /// Loops with good contacts, ohm, and their noise; empty if loops are not measured.
    loops_ohm: Vec<f64>,
    loop_noise_ohm: Vec<f64>,
    /// Noise of each channel at the tare and now, ohm squared.
    tare_variance: Vec<f64>,
    variance: Vec<f64>,
    /// Standard deviation of the noise of each channel at the tare, ohm.
    noise_ohm: Vec<f64>,
    /// The last frame, ohm.
    last_ohm: Vec<f64>,
    /// Mean square difference of reciprocal channels over its expectation from their noise, smoothed.
    reciprocity: f64,
    electrodes: Vec<Electrode>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Electrode {
    /// Sound, or the confirmed fault.
    state: ElectrodeState,
    #[serde(default)]
    part: PartMonitor,
    /// Rise of its contact resistance, ohm: in this frame, and smoothed.
    #[serde(rename = "gain_ohm")]
    rise_ohm: f64,
    #[serde(rename = "smooth_ohm")]
    smooth_rise_ohm: f64,
    /// Whether a touch next to it is only seen by its own channels, which are not in use.
    #[serde(default)]
    hides_touch: bool,
    /// Whether it was bad at the tare: then its values with a good contact are unknown.
    #[serde(rename = "since_tare")]
    bad_at_tare: bool,
}

/// A change of an electrode's state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Change {
    /// The electrode.
    pub electrode: usize,
    /// Its new state.
    pub state: ElectrodeState,
}

/// The context for the noise measurement of a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct NoiseFrame<'a> {
    /// Whether there is no touch.
    pub untouched: bool,
    /// Channels that are masked.
    pub masked: &'a [bool],
    /// Drives whose current is wrong.
    pub sick_drives: &'a [bool],
    /// Time since the last frame, s.
    pub step_s: f64,
}

/// The context for the contact resistances of a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct ContactFrame<'a> {
    /// The difference from the baseline, ohm.
    pub difference: &'a [f64],
    /// Drives whose current is wrong.
    pub sick_drives: &'a [bool],
    /// Whether the frame before was untouched.
    pub is_untouched: bool,
    /// Time of the frame, s.
    pub time_s: f64,
}

impl ElectrodeMonitor {
    /// From untouched frames, the statistics of their values and their noise.
    ///
    /// # Panics
    /// If there are fewer than two frames.
    pub(super) fn new(
        topology: &ElectrodeTopology,
        untouched: &[Measurement],
        values: &Statistics,
        noise_ohm: &[f64],
    ) -> Self {
        let loops = loop_statistics(topology, untouched);
        let usual_ohm = upper_median(&loops.mean).unwrap_or(f64::NAN);
        let electrode = |(index, drives): (usize, &Vec<usize>)| {
            let loops_ohm = drives.iter().filter_map(|&drive| loops.mean.get(drive).copied());
            match topology.leaves_out(index) {
                true => Electrode::left_out(),
                false => Electrode::at_tare(loops_ohm.reduce(f64::min).map(|least_ohm| least_ohm / usual_ohm)),
            }
        };
        let electrodes = topology.drives.iter().enumerate().map(electrode).collect();
        let mut monitor = ElectrodeMonitor {
            loops_ohm: loops.mean,
            loop_noise_ohm: loops.variance.into_iter().map(f64::sqrt).collect(),
            variance: values.variance.clone(),
            noise_ohm: noise_ohm.to_vec(),
            tare_variance: values.variance.clone(),
            last_ohm: untouched[untouched.len() - 1].values_ohm.clone(),
            reciprocity: 1.0,
            electrodes,
        };
        let mut masked = vec![false; topology.channel_count];
        topology.mark_channels_of(monitor.confirmed(), &mut masked);
        // A reading out of range disagrees with its reciprocal one for that reason.
        untouched.iter().flat_map(|frame| &frame.saturated).for_each(|&channel| masked[channel] = true);
        monitor.reciprocity = monitor.mismatch(topology, &values.mean, &masked).unwrap_or(1.0);
        monitor
    }

    /// Sets the frame before the next one.
    pub(super) fn set_last(&mut self, frame: &Measurement) {
        self.last_ohm.copy_from_slice(&frame.values_ohm);
    }

    /// Mean square difference of reciprocal channels in use, over its expectation from their noise.
    fn mismatch(&self, topology: &ElectrodeTopology, values_ohm: &[f64], masked: &[bool]) -> Option<f64> {
        let used = topology.reciprocal.iter().filter(|pair| pair.iter().all(|&channel| !masked[channel]));
        let (sum, count) = used.fold((0.0, 0.0), |(sum, count), &[a, b]| {
            let variance = self.noise_ohm[a].powi(2) + self.noise_ohm[b].powi(2);
            (sum + (values_ohm[a] - values_ohm[b]).powi(2) / variance, count + 1.0)
        });
        (count > 0.0).then(|| sum / count)
    }

    /// Whether it fits a skin.
    pub(super) fn fits(&self, topology: &ElectrodeTopology) -> bool {
        let channels = [&self.tare_variance, &self.variance, &self.noise_ohm, &self.last_ohm];
        channels.iter().all(|values| values.len() == topology.channel_count)
            && topology.fits_loops(&self.loops_ohm)
            && self.loop_noise_ohm.len() == self.loops_ohm.len()
            && self.electrodes.len() == topology.drives.len()
    }

    /// Leaves electrodes out that were used when the state was written.
    pub(super) fn leave_out(&mut self, topology: &ElectrodeTopology) {
        for (electrode, _) in self.electrodes.iter_mut().zip(&topology.left_out).filter(|(_, left_out)| **left_out) {
            *electrode = Electrode::left_out();
        }
    }

    /// Completes a state that was written before electrodes had trials.
    pub(super) fn restore(&mut self) {
        for electrode in self.electrodes.iter_mut().filter(|electrode| electrode.state != ElectrodeState::Sound) {
            if !electrode.part.is_masked() {
                electrode.part = PartMonitor::out();
            }
        }
    }

    /// Standard deviation of the noise of each channel at the tare, ohm.
    pub(super) fn noise_ohm(&self) -> &[f64] {
        &self.noise_ohm
    }

    /// The loops with good contacts, ohm; empty if loops are not measured.
    pub(super) fn loops_ohm(&self) -> &[f64] {
        &self.loops_ohm
    }

    /// Updates the state of each contact with a frame, and returns the changes.
    pub(super) fn update_contacts(
        &mut self,
        topology: &ElectrodeTopology,
        frame: &Measurement,
        about: ContactFrame<'_>,
    ) -> Vec<Change> {
        if self.loops_ohm.is_empty() || frame.loops_ohm.len() != self.loops_ohm.len() {
            return Vec::new();
        }
        let rises: Vec<f64> = frame.loops_ohm.iter().zip(&self.loops_ohm).map(|(now, then)| now - then).collect();
        let common = upper_median(&rises).unwrap_or(0.0);
        let mut changes = Vec::new();
        for (index, electrode) in self.electrodes.iter_mut().enumerate() {
            let used = topology.drives[index].iter().copied().filter(|&drive| !about.sick_drives[drive]);
            let drives: Vec<usize> = used.collect();
            if drives.is_empty() || topology.left_out[index] {
                continue;
            }
            let by_loops = drives.iter().map(|&drive| rises[drive] - common).fold(f64::INFINITY, f64::min);
            let channels = topology.contact_channels[index].iter();
            let by_channels = channels
                .filter(|(channel, _)| !about.sick_drives[topology.drive_of[*channel]])
                .map(|&(channel, sign)| sign * about.difference[channel]);
            electrode.rise_ohm = by_channels.fold(by_loops, f64::min);
            electrode.smooth_rise_ohm += SMOOTH * (electrode.rise_ohm - electrode.smooth_rise_ohm);
            let least = drives.iter().map(|&drive| self.loops_ohm[drive]).fold(f64::INFINITY, f64::min);
            let noise = drives.iter().map(|&drive| self.loop_noise_ohm[drive]).fold(0.0, f64::max);
            let limit = (NOISES * noise).max(topology.part * least).max(5.0 * topology.contacts_ohm[index]);
            let open = drives.iter().all(|&drive| frame.loops_ohm[drive] > OPEN * self.loops_ohm[drive]);
            let apparent = electrode.apparent_state(open, limit);
            let is_on_trial = electrode.part.condition() == Condition::OnTrial;
            electrode.hides_touch = is_on_trial
                && electrode.part.was_short(about.time_s)
                && rms(topology
                    .field_channels(index)
                    .map(|channel| about.difference[channel] / self.noise_ohm[channel]))
                    > HIDDEN_NOISES;
            // A touch that lowers the loops hides what is left of a rise.
            let is_touched = !about.is_untouched || electrode.hides_touch;
            if is_on_trial && is_touched && electrode.rise_ohm < -0.5 * limit {
                continue;
            }
            changes.extend(electrode.update(apparent, &about).map(|state| Change { electrode: index, state }));
        }
        changes
    }

    /// Electrodes on trial with a touch next to them that no other channels see, by number.
    pub(super) fn hiding_touch(&self) -> impl Iterator<Item = usize> {
        self.numbers(|electrode| electrode.hides_touch)
    }

    /// Electrodes that are confirmed as bad, by number.
    pub(super) fn confirmed(&self) -> impl Iterator<Item = usize> {
        self.numbers(|electrode| electrode.part.is_confirmed())
    }

    /// Electrodes whose state is this, by number.
    pub(super) fn in_condition(&self, holds: fn(&PartMonitor) -> bool) -> impl Iterator<Item = usize> {
        self.numbers(move |electrode| holds(&electrode.part))
    }

    fn numbers(&self, holds: impl Fn(&Electrode) -> bool) -> impl Iterator<Item = usize> {
        self.electrodes.iter().enumerate().filter(move |(_, electrode)| holds(electrode)).map(|(index, _)| index)
    }

    /// Updates the noise with a frame. Changes under a touch are not noise.
    pub(super) fn update_noise(&mut self, topology: &ElectrodeTopology, frame: &Measurement, about: NoiseFrame<'_>) {
        let share = -(-about.step_s / NOISE_S).exp_m1();
        if about.untouched {
            for (channel, variance) in self.variance.iter_mut().enumerate() {
                // The effect of a bad contact on its channels is not noise of the other electrodes of these channels.
                let square = match about.masked[channel] {
                    true => self.tare_variance[channel],
                    false => 0.5 * (frame.values_ohm[channel] - self.last_ohm[channel]).powi(2),
                };
                *variance += share * (square - *variance);
            }
            let follow = -(-about.step_s / FOLLOW_S).exp_m1();
            for (drive, (value, now)) in self.loops_ohm.iter_mut().zip(&frame.loops_ohm).enumerate() {
                if *now < FOLLOWED * *value && !about.sick_drives[drive] {
                    *value += follow * (now - *value);
                }
            }
        }
        if let Some(mismatch) = self.mismatch(topology, &frame.values_ohm, about.masked) {
            self.reciprocity += share * (mismatch - self.reciprocity);
        }
        self.last_ohm.copy_from_slice(&frame.values_ohm);
    }

    /// Noise of all channels in use, relative to the tare.
    pub(super) fn noise_ratio(&self, masked: &[bool]) -> f64 {
        let used = |values: &[f64]| -> f64 {
            values.iter().zip(masked).filter(|(_, masked)| !**masked).map(|(value, _)| value).sum()
        };
        (used(&self.variance) / used(&self.tare_variance)).sqrt()
    }

    /// Root mean square difference of reciprocal channels over its expectation from their noise; `None` without any.
    pub(super) fn reciprocity(&self, topology: &ElectrodeTopology) -> Option<f64> {
        (!topology.reciprocal.is_empty()).then(|| self.reciprocity.sqrt())
    }

    /// The health of every electrode.
    pub(super) fn health(&self, topology: &ElectrodeTopology) -> Vec<ElectrodeHealth> {
        let is_monitored = !self.loops_ohm.is_empty();
        let health = |(index, electrode): (usize, &Electrode)| {
            let channels = &topology.channels[index];
            let sum = |values: &[f64]| channels.iter().map(|&channel| values[channel]).sum::<f64>();
            let noise = (sum(&self.variance) / sum(&self.tare_variance)).sqrt();
            ElectrodeHealth {
                state: electrode.reported_state(noise),
                contact_ohm: is_monitored.then(|| (topology.contacts_ohm[index] + electrode.smooth_rise_ohm).max(0.0)),
                noise: Some(noise).filter(|noise| noise.is_finite()),
            }
        };
        self.electrodes.iter().enumerate().map(health).collect()
    }
}

/// The statistics of the loops; empty unless every frame has them.
fn loop_statistics(topology: &ElectrodeTopology, untouched: &[Measurement]) -> Statistics {
    let are_measured = untouched.iter().all(|frame| frame.loops_ohm.len() == topology.drive_count);
    let frames = if are_measured { untouched } else { &[] };
    Statistics::of(frames.iter().map(|frame| frame.loops_ohm.as_slice()))
}

impl Electrode {
    /// Never used: as one that carries no current.
    fn left_out() -> Self {
        Electrode::at_tare(Some(f64::INFINITY))
    }

    /// At the tare; `loop_ratio`: its smallest loop over the median loop, if it is driven and loops are measured.
    fn at_tare(loop_ratio: Option<f64>) -> Self {
        let state = match loop_ratio {
            Some(ratio) if ratio > OPEN => ElectrodeState::Open,
            Some(ratio) if ratio > LOOSE_AT_TARE => ElectrodeState::Loose,
            _ => ElectrodeState::Sound,
        };
        let bad_at_tare = state != ElectrodeState::Sound;
        let part = if bad_at_tare { PartMonitor::out() } else { PartMonitor::default() };
        Electrode { state, part, rise_ohm: 0.0, smooth_rise_ohm: 0.0, hides_touch: false, bad_at_tare }
    }

    /// The state with the trial after it, and with the noise of its channels relative to the tare.
    fn reported_state(&self, noise: f64) -> ElectrodeState {
        match self.part.condition() {
            Condition::Out => self.state,
            Condition::OnTrial => ElectrodeState::OnTrial,
            Condition::Suspect => ElectrodeState::Suspect,
            Condition::Sound if noise > DOUBTFUL => ElectrodeState::Doubtful,
            Condition::Sound => ElectrodeState::Sound,
        }
    }

    /// The state that a frame shows, with hysteresis.
    fn apparent_state(&self, open: bool, limit_ohm: f64) -> ElectrodeState {
        match () {
            () if open => ElectrodeState::Open,
            () if self.rise_ohm > limit_ohm => ElectrodeState::Loose,
            () if self.part.is_confirmed() && self.rise_ohm > 0.5 * limit_ohm => self.state,
            () => ElectrodeState::Sound,
        }
    }

    /// Updates the state with that of a frame; returns the new state if it changes. A loose electrode can become open,
    /// an open one not loose.
    fn update(&mut self, apparent: ElectrodeState, about: &ContactFrame<'_>) -> Option<ElectrodeState> {
        if self.bad_at_tare {
            return None;
        }
        let before = self.state;
        self.part.update(apparent != ElectrodeState::Sound, about.is_untouched, about.time_s);
        if !self.part.is_confirmed() {
            self.state = ElectrodeState::Sound;
        } else if before != ElectrodeState::Open && apparent != ElectrodeState::Sound {
            self.state = apparent;
        }
        (self.state != before).then_some(self.state)
    }
}
