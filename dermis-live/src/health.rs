//! How the electrodes and the channels are, frame by frame.
//!
//! A contact that comes loose shows in two ways that a touch does not. Every loop that goes through it (source, skin, sink)
//! gains the same resistance, and so does every channel that measures at it while it is driven; all others keep their values.
//! The least gain over an electrode's loops and such channels is what its contact has gained. A touch that raises the
//! conductance lowers all of them; one that lowers it raises them by far less than a third.

use crate::meter::Measures;
use crate::report::{ElectrodeHealth, ElectrodeState};
use crate::skin::LiveSkin;
use crate::untouched::Statistics;
use dermis::design::TouchEffect;
use dermis::stats::upper_median;
use serde::{Deserialize, Serialize};

/// Frames running in which a contact must look loose, so that a single bad reading names nobody: 42 ms at 120 frames a
/// second.
const FRAMES_TO_NAME: u32 = 5;
/// Frames running in which it must look sound again.
const FRAMES_TO_CLEAR: u32 = 120;
/// What a contact's gain must exceed, in standard deviations of a reading's noise.
const NOISES: f64 = 6.0;
/// The same as a part of the smallest loop: where touches lower loops, and where they raise them.
const PART_RISES: f64 = 0.01;
const PART_FALLS: f64 = 0.3;
/// A loop of more than this many times its resistance at the tare is open.
const OPEN: f64 = 20.0;
/// The share of a frame in the gain that is told.
const SMOOTH: f64 = 0.02;
/// Time constant of the noise, s.
const NOISE_S: f64 = 1.0;
/// Time constant at which the reference of sound contacts follows, s.
const FOLLOW_S: f64 = 60.0;
/// An electrode each of whose loops is so many times the median loop at the tare is hardly connected.
const HARDLY: f64 = 3.0;
/// An untouched electrode this many times noisier than at the tare is doubtful.
const DOUBTFUL: f64 = 4.0;

/// What does not change while a skin is read.
#[derive(Debug, Clone)]
pub struct ElectrodeTopology {
    /// For each electrode the drives that it is part of.
    drives: Vec<Vec<usize>>,
    /// For each electrode the channels that gain the resistance of its contact, with the sign of the gain.
    own: Vec<Vec<(usize, f64)>>,
    /// For each electrode all channels that it is part of.
    channels: Vec<Vec<usize>>,
    /// Channels that read the same by reciprocity.
    reciprocal: Vec<[usize; 2]>,
    contacts_ohm: Vec<f64>,
    part: f64,
    channel_count: usize,
    drive_count: usize,
}

impl ElectrodeTopology {
    /// Of a skin.
    pub fn of(skin: &LiveSkin) -> Self {
        let protocol = &skin.design.protocol;
        let (drives, _) = protocol.drives();
        let electrodes = 0..skin.design.electrodes.len();
        let own = |electrode: usize| {
            let gains = skin.contact_gains(electrode);
            // An instrument without signs tells the gain of a value's size.
            let signed = gains.enumerate().map(|(channel, gain)| match protocol.amplitude_only() {
                true => (channel, gain.abs()),
                false => (channel, gain),
            });
            signed.filter(|(_, gain)| *gain != 0.0).collect()
        };
        ElectrodeTopology {
            drives: electrodes
                .clone()
                .map(|electrode| (0..drives.len()).filter(|&drive| drives[drive].contains(&electrode)).collect())
                .collect(),
            own: electrodes.clone().map(own).collect(),
            channels: electrodes.clone().map(|electrode| skin.channels_of(electrode).collect()).collect(),
            reciprocal: reciprocal(protocol),
            contacts_ohm: electrodes.map(|electrode| skin.contact_ohm(electrode)).collect(),
            part: match skin.design.sheet.touch {
                TouchEffect::ConductanceRises => PART_RISES,
                TouchEffect::ConductanceFalls => PART_FALLS,
            },
            channel_count: protocol.channel_count(),
            drive_count: drives.len(),
        }
    }

    /// Values of a frame.
    pub fn channel_count(&self) -> usize {
        self.channel_count
    }
}

/// Pairs of channels that read the same by reciprocity, the lower first.
fn reciprocal(protocol: &dermis::protocol::Protocol) -> Vec<[usize; 2]> {
    let index: std::collections::HashMap<_, _> =
        protocol.channels().iter().enumerate().map(|(index, channel)| (*channel, index)).collect();
    let pair = |(own, channel): (usize, &dermis::protocol::Channel)| {
        index.get(&channel.reciprocal()).filter(|&&other| own < other).map(|&other| [own, other])
    };
    protocol.channels().iter().enumerate().filter_map(pair).collect()
}

/// How electrodes and channels are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ElectrodeMonitor {
    /// Loops of sound contacts, ohm, and their noise.
    loops_ohm: Vec<f64>,
    loop_noise_ohm: Vec<f64>,
    /// Noise of each channel at the tare and now, ohm squared.
    tare_variance: Vec<f64>,
    variance: Vec<f64>,
    /// Deviation of the noise of each channel at the tare, ohm.
    noise_ohm: Vec<f64>,
    last_ohm: Vec<f64>,
    /// Mean square by which reciprocal channels differ over what their noise explains, smoothed.
    reciprocity: f64,
    electrodes: Vec<Electrode>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Electrode {
    state: ElectrodeState,
    /// What its contact has gained, ohm: in this frame, and smoothed.
    gain_ohm: f64,
    smooth_ohm: f64,
    /// Frames running in which it looked otherwise than its state says.
    against: u32,
    /// Whether it was bad at the tare: then nothing is known of how it would read if it were sound.
    since_tare: bool,
}

/// What a frame changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Change {
    /// The electrode.
    pub electrode: usize,
    /// What it is from now on.
    pub state: ElectrodeState,
}

impl ElectrodeMonitor {
    /// From untouched frames and the statistics of their values.
    ///
    /// # Panics
    /// Without two of them.
    pub fn new(topology: &ElectrodeTopology, untouched: &[Measures], values: &Statistics) -> Self {
        let loops = Statistics::of(untouched.iter().map(|frame| frame.loops_ohm.as_slice()));
        let usual_ohm = upper_median(&loops.mean).unwrap_or(0.0);
        let electrode = |drives: &Vec<usize>| {
            let least_ohm = drives.iter().map(|&drive| loops.mean[drive]).fold(f64::INFINITY, f64::min);
            let state = match least_ohm / usual_ohm {
                _ if drives.is_empty() => ElectrodeState::Sound,
                times if times > OPEN => ElectrodeState::Open,
                times if times > HARDLY => ElectrodeState::Loose,
                _ => ElectrodeState::Sound,
            };
            let since_tare = state != ElectrodeState::Sound;
            Electrode { state, gain_ohm: 0.0, smooth_ohm: 0.0, against: 0, since_tare }
        };
        let electrodes = topology.drives.iter().map(electrode).collect();
        let mut watch = ElectrodeMonitor {
            loops_ohm: loops.mean,
            loop_noise_ohm: loops.variance.into_iter().map(f64::sqrt).collect(),
            variance: values.variance.clone(),
            noise_ohm: values.deviations(),
            tare_variance: values.variance.clone(),
            last_ohm: untouched[untouched.len() - 1].values_ohm.clone(),
            reciprocity: 1.0,
            electrodes,
        };
        let masked = masked(topology, watch.bad());
        watch.reciprocity = watch.mismatch(topology, &values.mean, &masked).unwrap_or(1.0);
        watch
    }

    /// Takes a frame for the one before the next.
    pub fn forget_last(&mut self, frame: &Measures) {
        self.last_ohm.copy_from_slice(&frame.values_ohm);
    }

    /// Mean square by which reciprocal channels that are in use differ over what their noise explains.
    fn mismatch(&self, topology: &ElectrodeTopology, values_ohm: &[f64], masked: &[bool]) -> Option<f64> {
        let kept = topology.reciprocal.iter().filter(|pair| pair.iter().all(|&channel| !masked[channel]));
        let (sum, count) = kept.fold((0.0, 0.0), |(sum, count), &[a, b]| {
            let variance = self.noise_ohm[a].powi(2) + self.noise_ohm[b].powi(2);
            (sum + (values_ohm[a] - values_ohm[b]).powi(2) / variance, count + 1.0)
        });
        (count > 0.0).then(|| sum / count)
    }

    /// Whether it is that of a skin.
    pub fn fits(&self, topology: &ElectrodeTopology) -> bool {
        let ElectrodeMonitor {
            loops_ohm,
            loop_noise_ohm,
            tare_variance,
            variance,
            noise_ohm,
            last_ohm,
            electrodes,
            ..
        } = self;
        let channels = [tare_variance, variance, noise_ohm, last_ohm];
        channels.iter().all(|values| values.len() == topology.channel_count)
            && [loops_ohm, loop_noise_ohm].iter().all(|values| values.len() == topology.drive_count)
            && electrodes.len() == topology.drives.len()
    }

    /// Standard deviation of the noise of each channel at the tare, ohm.
    pub fn noise_ohm(&self) -> &[f64] {
        &self.noise_ohm
    }

    /// Takes a frame in: what it says of each contact, before anything is made of the frame.
    pub fn contacts(&mut self, topology: &ElectrodeTopology, frame: &Measures, difference: &[f64]) -> Vec<Change> {
        let gains: Vec<f64> = frame.loops_ohm.iter().zip(&self.loops_ohm).map(|(now, then)| now - then).collect();
        let common = upper_median(&gains).unwrap_or(0.0);
        let mut changes = Vec::new();
        for (index, electrode) in self.electrodes.iter_mut().enumerate() {
            let drives = &topology.drives[index];
            if drives.is_empty() {
                continue;
            }
            let by_loops = drives.iter().map(|&drive| gains[drive] - common).fold(f64::INFINITY, f64::min);
            let own = topology.own[index].iter().map(|&(channel, sign)| sign * difference[channel]);
            electrode.gain_ohm = own.fold(by_loops, f64::min);
            electrode.smooth_ohm += SMOOTH * (electrode.gain_ohm - electrode.smooth_ohm);
            let least = drives.iter().map(|&drive| self.loops_ohm[drive]).fold(f64::INFINITY, f64::min);
            let noise = drives.iter().map(|&drive| self.loop_noise_ohm[drive]).fold(0.0, f64::max);
            let limit = (NOISES * noise).max(topology.part * least).max(5.0 * topology.contacts_ohm[index]);
            let open = drives.iter().all(|&drive| frame.loops_ohm[drive] > OPEN * self.loops_ohm[drive]);
            let looks = match () {
                () if open => ElectrodeState::Open,
                () if electrode.gain_ohm > limit => ElectrodeState::Loose,
                () if electrode.is_bad() && electrode.gain_ohm > 0.5 * limit => electrode.state,
                () => ElectrodeState::Sound,
            };
            changes.extend(electrode.look(looks).map(|state| Change { electrode: index, state }));
        }
        changes
    }

    /// Whether an electrode looked bad in the last frame, named or not yet.
    pub fn is_suspect(&self, electrode: usize) -> bool {
        let electrode = &self.electrodes[electrode];
        electrode.is_bad() || electrode.against > 0
    }

    /// Electrodes whose readings are to be left out, by number.
    pub fn bad(&self) -> impl Iterator<Item = usize> {
        self.electrodes.iter().enumerate().filter(|(_, electrode)| electrode.is_bad()).map(|(index, _)| index)
    }

    /// Takes the noise of a frame in. Under a touch what changes is not noise.
    pub fn noise(&mut self, topology: &ElectrodeTopology, frame: &Measures, touch: Untouched<'_>) {
        let share = -(-touch.step_s / NOISE_S).exp_m1();
        if touch.untouched {
            for (channel, variance) in self.variance.iter_mut().enumerate() {
                // What a bad contact does to a channel is no noise of the others that are part of it.
                let square = match touch.masked[channel] {
                    true => self.tare_variance[channel],
                    false => 0.5 * (frame.values_ohm[channel] - self.last_ohm[channel]).powi(2),
                };
                *variance += share * (square - *variance);
            }
            let follow = -(-touch.step_s / FOLLOW_S).exp_m1();
            for (value, now) in self.loops_ohm.iter_mut().zip(&frame.loops_ohm) {
                // A loop that opens is followed by nobody.
                if *now < 2.0 * *value {
                    *value += follow * (now - *value);
                }
            }
        }
        if let Some(mismatch) = self.mismatch(topology, &frame.values_ohm, touch.masked) {
            self.reciprocity += share * (mismatch - self.reciprocity);
        }
        self.last_ohm.copy_from_slice(&frame.values_ohm);
    }

    /// The noise of all channels in use over that at the tare.
    pub fn noise_ratio(&self, masked: &[bool]) -> f64 {
        let used = |values: &[f64]| -> f64 {
            values.iter().zip(masked).filter(|(_, masked)| !**masked).map(|(value, _)| value).sum()
        };
        (used(&self.variance) / used(&self.tare_variance)).sqrt()
    }

    /// Root mean square by which reciprocal channels differ over what their noise explains; `None` without any.
    pub fn reciprocity(&self, topology: &ElectrodeTopology) -> Option<f64> {
        (!topology.reciprocal.is_empty()).then(|| self.reciprocity.sqrt())
    }

    /// Every electrode as it is told.
    pub fn told(&self, topology: &ElectrodeTopology) -> Vec<ElectrodeHealth> {
        let told = |(index, electrode): (usize, &Electrode)| {
            let channels = &topology.channels[index];
            let sum = |values: &[f64]| channels.iter().map(|&channel| values[channel]).sum::<f64>();
            let noise = (sum(&self.variance) / sum(&self.tare_variance)).sqrt();
            let doubtful = electrode.state == ElectrodeState::Sound && noise > DOUBTFUL;
            ElectrodeHealth {
                state: if doubtful { ElectrodeState::Doubtful } else { electrode.state },
                contact_ohm: Some((topology.contacts_ohm[index] + electrode.smooth_ohm).max(0.0)),
                noise: Some(noise).filter(|noise| noise.is_finite()),
            }
        };
        self.electrodes.iter().enumerate().map(told).collect()
    }
}

/// What is known of a frame when its noise is taken in.
#[derive(Debug, Clone, Copy)]
pub struct Untouched<'a> {
    /// Whether nothing touches.
    pub untouched: bool,
    /// Channels that are left out.
    pub masked: &'a [bool],
    /// Since the last frame, s.
    pub step_s: f64,
}

impl Electrode {
    fn is_bad(&self) -> bool {
        matches!(self.state, ElectrodeState::Loose | ElectrodeState::Open)
    }

    /// Takes in how it looks in a frame; what it is from now on, where that changes.
    fn look(&mut self, looks: ElectrodeState) -> Option<ElectrodeState> {
        if looks == self.state || self.since_tare {
            self.against = 0;
            return None;
        }
        self.against += 1;
        let needed = if looks == ElectrodeState::Sound { FRAMES_TO_CLEAR } else { FRAMES_TO_NAME };
        if self.against < needed {
            return None;
        }
        self.against = 0;
        self.state = looks;
        Some(looks)
    }
}

/// Channels that some electrodes are part of.
pub fn masked(topology: &ElectrodeTopology, electrodes: impl Iterator<Item = usize>) -> Vec<bool> {
    let mut masked = vec![false; topology.channel_count];
    for electrode in electrodes {
        topology.channels[electrode].iter().for_each(|&channel| masked[channel] = true);
    }
    masked
}
