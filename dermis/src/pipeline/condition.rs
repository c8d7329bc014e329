//! The state of a part of the instrument that can fail and come back: an electrode, a drive, a channel, the whole.

use serde::{Deserialize, Serialize};

/// Bad frames, less a quarter of the good ones, after which a suspect part is out: 42 ms at 120 frames per second.
const FRAMES_TO_CONFIRM: f64 = 5.0;
/// Good frames that cancel one bad frame of a suspect part.
const GOOD_PER_BAD: f64 = 4.0;
/// Trial of a part whose first fault has ended, s. It doubles with each further fault.
const TRIAL_S: f64 = 0.25;
/// Longest trial, s.
const LONGEST_TRIAL_S: f64 = 32.0;
/// A part that was bad for longer comes back only while the skin is untouched, s: the baseline follows the drift of
/// sound parts with this time constant.
const SHORT_S: f64 = 10.0;
/// Faults before a part was sound for this time do not count, s.
const FORGOTTEN_S: f64 = 3.0;

/// The state of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Condition {
    /// In use.
    #[default]
    Sound,
    /// Bad in the last frames, not yet confirmed; not used.
    Suspect,
    /// Confirmed as bad; not used.
    Out,
    /// Good again, but not yet for long enough; not used.
    OnTrial,
}

/// Follows the state of a part, frame by frame:
///
/// ```text
/// sound -> suspect (bad frame) -> out (five bad frames) -> on trial (good frame) -> sound (trial passed)
/// ```
///
/// A bad frame on trial puts the part out again. Each time out doubles the next trial, so that a part that flickers stays
/// out.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct PartMonitor {
    condition: Condition,
    /// Evidence against a suspect part, bad frames.
    bad_frames: f64,
    /// Start of the trial, or of the time in which it has been sound, s.
    since_s: f64,
    /// How often it was out.
    times_out: i32,
    /// Time of the first confirmation of the last fault, s.
    #[serde(default)]
    bad_since_s: f64,
}

impl PartMonitor {
    /// A part that is bad from the start.
    pub(super) fn out() -> Self {
        PartMonitor { condition: Condition::Out, times_out: 1, ..Self::default() }
    }

    /// Its state.
    pub(super) fn condition(&self) -> Condition {
        self.condition
    }

    /// Whether it is not used.
    pub(super) fn is_masked(&self) -> bool {
        self.condition != Condition::Sound
    }

    /// Whether it is not used, and not on trial.
    pub(super) fn is_blocked(&self) -> bool {
        matches!(self.condition, Condition::Suspect | Condition::Out)
    }

    /// Whether it is confirmed as bad and has not passed its trial.
    pub(super) fn is_confirmed(&self) -> bool {
        matches!(self.condition, Condition::Out | Condition::OnTrial)
    }

    /// Whether the last fault was short: the old baseline still holds.
    pub(super) fn was_short(&self, time_s: f64) -> bool {
        time_s - self.bad_since_s <= SHORT_S
    }

    /// Takes a frame in which the part is bad or not. After a short fault it can return during a touch, with its old
    /// baseline; after a long one its trial is in untouched frames, whose mean is its new baseline.
    pub(super) fn update(&mut self, is_bad: bool, is_untouched: bool, time_s: f64) {
        match (self.condition, is_bad) {
            (Condition::Sound, false) => self.forget(time_s),
            (Condition::Sound | Condition::Suspect, true) => self.suspect(self.bad_frames + 1.0, time_s),
            (Condition::Suspect, false) => self.suspect(self.bad_frames - 1.0 / GOOD_PER_BAD, time_s),
            (Condition::Out, true) => {}
            (Condition::Out, false) => self.enter(Condition::OnTrial, time_s),
            (Condition::OnTrial, true) => self.enter(Condition::Out, time_s),
            (Condition::OnTrial, false) if !is_untouched && !self.was_short(time_s) => self.since_s = time_s,
            (Condition::OnTrial, false) if time_s - self.since_s >= self.trial_s() => {
                self.enter(Condition::Sound, time_s);
            }
            (Condition::OnTrial, false) => {}
        }
    }

    fn suspect(&mut self, bad_frames: f64, time_s: f64) {
        self.bad_frames = bad_frames.max(0.0);
        match self.bad_frames {
            bad if bad >= FRAMES_TO_CONFIRM => self.enter(Condition::Out, time_s),
            bad if bad > 0.0 => self.condition = Condition::Suspect,
            _ => self.condition = Condition::Sound,
        }
    }

    fn enter(&mut self, condition: Condition, time_s: f64) {
        if self.condition == Condition::Suspect {
            self.bad_since_s = time_s;
        }
        (self.condition, self.since_s, self.bad_frames) = (condition, time_s, 0.0);
        self.times_out += i32::from(condition == Condition::Out);
    }

    fn forget(&mut self, time_s: f64) {
        if time_s - self.since_s > FORGOTTEN_S {
            self.times_out = 0;
        }
    }

    fn trial_s(&self) -> f64 {
        (TRIAL_S * 2f64.powi(self.times_out - 1)).min(LONGEST_TRIAL_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 1.0 / 120.0;

    /// The states over frames that are bad or not.
    fn states(bad: impl Fn(usize) -> bool, frames: usize) -> Vec<Condition> {
        let mut part = PartMonitor::default();
        let state = |frame: usize| {
            part.update(bad(frame), true, frame as f64 * STEP_S);
            part.condition()
        };
        (0..frames).map(state).collect()
    }

    #[test]
    fn a_single_bad_frame_is_masked_and_confirms_nothing() {
        let states = states(|frame| frame == 10, 60);
        assert_eq!(
            states[9..15],
            [
                Condition::Sound,
                Condition::Suspect,
                Condition::Suspect,
                Condition::Suspect,
                Condition::Suspect,
                Condition::Sound
            ]
        );
        assert!(!states.contains(&Condition::Out));
    }

    #[test]
    fn a_fault_is_confirmed_in_five_frames_and_over_a_third_of_a_second_after_its_end() {
        let states = states(|frame| (10..40).contains(&frame), 100);
        let first = |state: Condition| states.iter().position(|other| *other == state).unwrap();
        assert_eq!((first(Condition::Suspect), first(Condition::Out), first(Condition::OnTrial)), (10, 14, 40));
        assert_eq!(states[40..].iter().position(|state| *state == Condition::Sound), Some(30));
    }

    #[test]
    fn a_short_fault_ends_under_a_touch_and_a_long_one_afterwards() {
        let returns = |bad_frames: usize| {
            let mut part = PartMonitor::default();
            let is_sound = |frame: usize| {
                part.update(frame < bad_frames, frame > 3000, frame as f64 * STEP_S);
                part.condition() == Condition::Sound
            };
            (0..4000).position(is_sound).unwrap()
        };
        assert_eq!((returns(120), returns(1800)), (150, 3030));
    }

    #[test]
    fn a_part_that_flickers_is_held_out() {
        let states = states(|frame| frame % 60 < 6 && frame < 6000, 12_000);
        let used = states[600..6000].iter().filter(|state| **state == Condition::Sound).count();
        assert!(used < 60, "used in {used} frames");
        assert_eq!(states[11_999], Condition::Sound, "the fault has ended for good");
    }
}
