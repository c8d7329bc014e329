//! How frames compare with the true presses.

use crate::campaign::draw::{Drawn, FaultKind};
use crate::emulator::{Fault, ReadingFault, TimedFault};
use dermis::geom::Surface;
use dermis::pipeline::{PipelineFrame, Validity};
use dermis_sim::twin::Press;
use serde::Serialize;
use std::collections::BTreeSet;
use std::ops::AddAssign;

/// A contact farther than this from every press is false, m.
const FALSE_M: f64 = 0.03;
/// After a press has ended, its contact may last for so long, s.
const ENDING_S: f64 = 0.12;
/// A press that lasts for so long within the time of a row must be found, s.
const FINDABLE_S: f64 = 0.3;
/// Presses must be found from this time after the end of a fault on, s.
const RECOVERED_S: f64 = 1.0;
/// A fault must be noticed within this time, s.
const NOTICED_S: f64 = 0.1;

/// Counts of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct FrameCounts {
    /// Frames.
    pub frames: u64,
    /// Frames with a contact where nothing is pressed. Frames that have one without the fault, too, do not count.
    pub false_contacts: u64,
    /// Frames that are said to be touched while nothing is pressed. Frames that are without the fault, too, do not count.
    pub wrong_touch: u64,
    /// Invalid frames.
    pub invalid: u64,
}

/// The score of the faults of one kind.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Score {
    /// The kind.
    pub kind: FaultKind,
    /// Number of faults.
    pub faults: u64,
    /// During the faults.
    pub during: FrameCounts,
    /// Afterwards, until the next fault.
    pub after: FrameCounts,
    /// Faults that must be noticed, and those that were, within 0.1 s.
    pub to_notice: u64,
    /// Noticed within 0.1 s.
    pub noticed: u64,
    /// Faults for which what was noticed was named rightly.
    pub named: u64,
    /// Presses from one second after the fault on, and those that were found.
    pub presses: u64,
    /// Found presses.
    pub found: u64,
    /// Longest time after a fault until a frame was ok, s.
    pub slowest_s: f64,
}

/// A fault of a campaign and what came of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FaultRun {
    /// Number of the device.
    pub device: u64,
    /// Begin of the fault, s of device time.
    pub begin_s: f64,
    /// End of the fault, s of device time.
    pub end_s: f64,
    /// The faults of the emulated device; two for a loose electrode, which is repaired.
    pub faults: Vec<TimedFault>,
    /// Time from the begin until a frame was not ok, s.
    pub noticed_s: Option<f64>,
    /// Times of the frames with false contacts, s of device time.
    pub false_contacts_s: Vec<f64>,
    /// The score.
    pub score: Score,
}

impl AddAssign for FrameCounts {
    fn add_assign(&mut self, other: Self) {
        self.frames += other.frames;
        self.false_contacts += other.false_contacts;
        self.wrong_touch += other.wrong_touch;
        self.invalid += other.invalid;
    }
}

impl FrameCounts {
    /// What the same frames without faults do not have.
    fn beyond(self, control: FrameCounts) -> Self {
        FrameCounts {
            false_contacts: self.false_contacts.saturating_sub(control.false_contacts),
            wrong_touch: self.wrong_touch.saturating_sub(control.wrong_touch),
            ..self
        }
    }
}

impl AddAssign<&Score> for Score {
    fn add_assign(&mut self, other: &Score) {
        self.faults += other.faults;
        self.during += other.during;
        self.after += other.after;
        self.to_notice += other.to_notice;
        self.noticed += other.noticed;
        self.named += other.named;
        self.presses += other.presses;
        self.found += other.found;
        self.slowest_s = self.slowest_s.max(other.slowest_s);
    }
}

/// A press that must be found.
struct Expected {
    press: Press,
    since_s: f64,
    until_s: f64,
    is_found: bool,
}

/// Scores the frames of one fault.
pub(super) struct Scorer<'a> {
    fault: &'a Drawn,
    surface: Surface,
    score: Score,
    noticed_s: Option<f64>,
    is_named: bool,
    recovered_s: Option<f64>,
    false_contacts_s: Vec<f64>,
    expected: Vec<Expected>,
    /// Presses of the last frames, with their last times.
    recent: Vec<(f64, Press)>,
}

impl<'a> Scorer<'a> {
    pub(super) fn new(fault: &'a Drawn, surface: Surface) -> Self {
        let score = Score {
            kind: fault.kind,
            faults: u64::from(!fault.faults.is_empty()),
            during: FrameCounts::default(),
            after: FrameCounts::default(),
            to_notice: 0,
            noticed: 0,
            named: 0,
            presses: 0,
            found: 0,
            slowest_s: 0.0,
        };
        Scorer {
            fault,
            surface,
            score,
            noticed_s: None,
            is_named: false,
            recovered_s: None,
            false_contacts_s: Vec::new(),
            expected: Vec::new(),
            recent: Vec::new(),
        }
    }

    /// Takes a frame and the true presses; returns its counts. `control`: the counts of the same frame of a device
    /// without faults, which are subtracted.
    pub(super) fn take(
        &mut self,
        time_s: f64,
        frame: &PipelineFrame,
        presses: &[Press],
        control: FrameCounts,
    ) -> FrameCounts {
        self.recent.retain(|(last_s, press)| time_s - last_s < ENDING_S && !presses.contains(press));
        self.recent.extend(presses.iter().map(|press| (time_s, *press)));
        let is_during = (self.fault.begin_s..self.fault.end_s).contains(&time_s);
        let counted = self.counted(frame).beyond(control);
        if time_s < self.fault.begin_s {
            return counted;
        }
        if counted.false_contacts > 0 {
            self.false_contacts_s.push(time_s);
        }
        *(if is_during { &mut self.score.during } else { &mut self.score.after }) += counted;
        if is_during {
            self.notice(time_s, frame);
        } else {
            self.recover(time_s, frame, presses);
        }
        counted
    }

    /// The counts of one frame.
    fn counted(&self, frame: &PipelineFrame) -> FrameCounts {
        let is_false = |position_m| {
            self.recent.iter().all(|(_, press)| self.surface.distance_m(position_m, press.centre_m) > FALSE_M)
        };
        let is_pressed = !self.recent.is_empty();
        FrameCounts {
            frames: 1,
            false_contacts: u64::from(frame.contacts.iter().any(|contact| is_false(contact.contact.position_m))),
            wrong_touch: u64::from(frame.touched == Some(true) && !is_pressed),
            invalid: u64::from(!frame.validity.is_usable()),
        }
    }

    fn notice(&mut self, time_s: f64, frame: &PipelineFrame) {
        if frame.validity == Validity::Ok {
            return;
        }
        self.noticed_s.get_or_insert(time_s - self.fault.begin_s);
        self.is_named |= are_named(&self.fault.faults, frame);
    }

    fn recover(&mut self, time_s: f64, frame: &PipelineFrame, presses: &[Press]) {
        let since_s = time_s - self.fault.end_s;
        if frame.validity == Validity::Ok {
            self.recovered_s.get_or_insert(since_s);
        }
        if since_s < RECOVERED_S {
            return;
        }
        for press in presses {
            let near = frame
                .contacts
                .iter()
                .any(|contact| self.surface.distance_m(contact.contact.position_m, press.centre_m) <= FALSE_M);
            match self.expected.iter_mut().find(|known| known.press.centre_m == press.centre_m) {
                Some(known) => {
                    known.until_s = time_s;
                    known.is_found |= near;
                }
                None => {
                    self.expected.push(Expected { press: *press, since_s: time_s, until_s: time_s, is_found: near })
                }
            }
        }
    }

    pub(super) fn finish(mut self, device: u64) -> FaultRun {
        let findable = |expected: &&Expected| expected.until_s - expected.since_s >= FINDABLE_S;
        self.score.presses = self.expected.iter().filter(findable).count() as u64;
        self.score.found = self.expected.iter().filter(findable).filter(|expected| expected.is_found).count() as u64;
        self.score.slowest_s = self.recovered_s.unwrap_or(f64::INFINITY);
        let is_short = self.fault.end_s - self.fault.begin_s < NOTICED_S;
        if self.fault.faults.iter().any(|timed| must_be_noticed(&timed.fault)) && !is_short {
            self.score.to_notice = 1;
            self.score.noticed = u64::from(self.noticed_s.is_some_and(|since_s| since_s <= NOTICED_S));
            self.score.named = u64::from(self.is_named);
        }
        FaultRun {
            device,
            begin_s: self.fault.begin_s,
            end_s: self.fault.end_s,
            faults: self.fault.faults.clone(),
            noticed_s: self.noticed_s,
            false_contacts_s: self.false_contacts_s,
            score: self.score,
        }
    }
}

/// Whether a fault shows in the frames: a reading that does not change shows in no untouched frame, and a clock is
/// replaced by that of the host.
fn must_be_noticed(fault: &Fault) -> bool {
    !matches!(
        fault,
        Fault::ClockStop { .. } | Fault::ClockSet { .. } | Fault::Readings { fault: ReadingFault::Stuck(_), .. }
    )
}

/// Whether a frame names these faults: that it is invalid, if one of them concerns the whole frame, or else exactly these
/// electrodes and drives, and these channels. A fault that does not show in the frames need not be named.
fn are_named(faults: &[TimedFault], frame: &PipelineFrame) -> bool {
    let (mut electrodes, mut drives, mut channels) = (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
    for timed in faults.iter().filter(|timed| must_be_noticed(&timed.fault)) {
        match timed.fault {
            Fault::Loose { electrode, .. } => drop(electrodes.insert(electrode)),
            Fault::Readings { fault: ReadingFault::Reference(drive, _), .. } => drop(drives.insert(drive)),
            Fault::Readings { fault: ReadingFault::Saturated(channel), .. } => drop(channels.insert(channel)),
            _ => return !frame.validity.is_usable(),
        }
    }
    let states = frame.health.electrodes.iter().enumerate();
    let bad: BTreeSet<usize> = states.filter(|(_, health)| health.state.is_bad()).map(|(index, _)| index).collect();
    bad == electrodes
        && frame.health.bad_drives.iter().copied().eq(drives)
        && channels.iter().all(|&channel| is_masked(channel, frame))
}

fn is_masked(channel: usize, frame: &PipelineFrame) -> bool {
    matches!(&frame.validity, Validity::Degraded(degradation) if degradation.channels.contains(&channel))
}
