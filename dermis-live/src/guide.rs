//! Guided presses: the frames of single presses, and what people are told to do.
//!
//! ```
//! use dermis_live::guide::{Guide, GuideAction};
//! use std::time::Duration;
//!
//! let guide = Guide::default();
//! guide.change(|status| status.planned = 50);
//! guide.request(GuideAction::Skip); // as a page does
//! assert_eq!(guide.take_request(), Some(GuideAction::Skip));
//! assert_eq!(guide.status().planned, 50);
//! ```

use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::pipeline::{PipelineFrame, State, Timestamp};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What the person is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GuideStep {
    /// Leave the skin untouched: the baseline is measured.
    #[default]
    Wait,
    /// Press the place.
    Press,
    /// Hold the press.
    Hold,
    /// Lift the finger.
    Lift,
    /// Wait for the calibration.
    Fit,
    /// Nothing: the session has ended.
    Finished,
}

/// The state of a guided session, as pages and terminals show it.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct GuideStatus {
    /// What to do.
    pub step: GuideStep,
    /// The place to press, m.
    pub position_m: Option<Point3>,
    /// Presses taken.
    pub taken: usize,
    /// Presses taken and places left.
    pub planned: usize,
    /// The part of the skin's area near a press, and how near, m.
    pub coverage: f64,
    /// The distance of `coverage`, m.
    pub reach_m: f64,
    /// The mean error of the calibration by cross-validation, m, and the number of its presses, fit by fit.
    pub errors: Vec<(usize, f64)>,
    /// A calibration is being computed.
    pub fitting: bool,
    /// A remark on the last press.
    pub note: String,
}

/// What a person wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GuideAction {
    /// Leave the place out.
    Skip,
    /// Discard the last press and repeat it.
    Redo,
    /// End the session.
    Finish,
}

/// The state of a guided session, shared between threads.
#[derive(Debug, Default)]
pub struct Guide {
    status: Mutex<GuideStatus>,
    requests: Mutex<VecDeque<GuideAction>>,
}

impl Guide {
    /// The state now.
    pub fn status(&self) -> GuideStatus {
        lock(&self.status).clone()
    }

    /// Changes the state.
    pub fn change(&self, change: impl FnOnce(&mut GuideStatus)) {
        change(&mut lock(&self.status));
    }

    /// Requests an action.
    pub fn request(&self, action: GuideAction) {
        lock(&self.requests).push_back(action);
    }

    /// The oldest request that was not taken yet.
    pub fn take_request(&self) -> Option<GuideAction> {
        lock(&self.requests).pop_front()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // The data behind these locks is consistent between any two operations.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Time of the two means that are compared, one after the other, s.
const AVERAGED_S: f64 = 0.3;
/// Fewest frames of an average: slow instruments take longer.
const MIN_FRAMES: usize = 3;
/// A press is steady if its mean changes by at most this part of its difference from the untouched skin, beyond noise.
const STEADY: f64 = 0.05;
/// Variance of the change of the mean, as a multiple of that of its noise, that still counts as noise.
const NOISE: f64 = 2.0;
/// A press that is not felt for this time has ended, s: as it begins, it may not be felt in every frame.
const FLICKER_S: f64 = 0.15;
/// The skin has been left for this time before the next press begins, s.
const APART_S: f64 = 0.3;

/// What happens to a press.
#[derive(Debug, Clone, PartialEq)]
pub enum PressEvent {
    /// The skin is touched. The collector needs the state of the pipeline now.
    Began,
    /// The press was released before it was steady.
    TooShort,
    /// The press is steady: the difference of one frame from the untouched skin, ohm. It is not averaged: the
    /// calibration must contain the noise of the single frames that it will locate.
    Steady(Frame),
    /// The skin was left, and may be pressed again.
    Left,
}

/// Collects the frames of single presses, as soon as they are steady.
#[derive(Debug, Clone, Default)]
pub struct PressCollector {
    phase: Phase,
    /// The untouched skin when the press began, ohm.
    baseline_ohm: Option<Vec<f64>>,
    frames: Vec<(Timestamp, Vec<f64>)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum Phase {
    #[default]
    Untouched,
    /// The press was last felt then.
    Pressed(Timestamp),
    /// The press is taken or was too short; the skin was last touched then.
    Taken(Timestamp),
}

impl PressCollector {
    /// Takes the baseline of the press that began.
    pub fn set_baseline(&mut self, state: &State) {
        self.baseline_ohm = state.baseline_ohm().map(<[f64]>::to_vec);
    }

    /// Waits until the skin is left, whether it is touched now or not.
    pub fn restart(&mut self, at: Timestamp) {
        self.frames.clear();
        self.phase = Phase::Taken(at);
    }

    /// Processes the next frame.
    pub fn take(&mut self, frame: &PipelineFrame) -> Option<PressEvent> {
        let at = frame.measured_at;
        match (self.phase, frame.touched?) {
            (Phase::Untouched, false) => None,
            (Phase::Untouched, true) => {
                self.phase = Phase::Pressed(at);
                (self.baseline_ohm, self.frames) = (None, vec![(at, frame.values_ohm.clone())]);
                Some(PressEvent::Began)
            }
            (Phase::Pressed(last), false) => (at.seconds_since(last) >= FLICKER_S).then(|| {
                self.restart(last);
                PressEvent::TooShort
            }),
            (Phase::Pressed(_), true) => {
                self.phase = Phase::Pressed(at);
                self.frames.push((at, frame.values_ohm.clone()));
                let difference = self.steady(at)?;
                self.restart(at);
                Some(PressEvent::Steady(difference))
            }
            (Phase::Taken(_), true) => {
                self.phase = Phase::Taken(at);
                None
            }
            (Phase::Taken(last), false) => (at.seconds_since(last) >= APART_S).then(|| {
                self.phase = Phase::Untouched;
                PressEvent::Left
            }),
        }
    }

    /// The difference of the press, if it is steady.
    fn steady(&mut self, now: Timestamp) -> Option<Frame> {
        let baseline = self.baseline_ohm.as_ref()?;
        let within = |seconds: f64| self.frames.iter().filter(move |(at, _)| now.seconds_since(*at) < seconds).count();
        let count = within(AVERAGED_S).max(MIN_FRAMES);
        // The first frame may be of the moment of contact.
        let begin = self.frames.len().checked_sub(2 * count + 1)?;
        self.frames.drain(..begin);
        let recent: Vec<&[f64]> = self.frames[1..].iter().map(|(_, values)| values.as_slice()).collect();
        let (before, after) = (Mean::of(&recent[..count]), Mean::of(&recent[count..]));
        let square = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        let changed = square(&after.values, &before.values);
        let noise = before.variance + after.variance;
        let limit = STEADY * STEADY * square(&after.values, baseline) + NOISE * noise;
        let last = recent.last()?;
        (changed <= limit)
            .then(|| Frame(last.iter().zip(baseline).map(|(value, untouched)| value - untouched).collect()))
    }
}

/// The mean of some frames.
struct Mean {
    values: Vec<f64>,
    /// Variance of the mean, summed over the channels.
    variance: f64,
}

impl Mean {
    fn of(frames: &[&[f64]]) -> Self {
        let count = frames.len() as f64;
        let mean = |channel: usize| frames.iter().map(|frame| frame[channel]).sum::<f64>() / count;
        let values: Vec<f64> = (0..frames[0].len()).map(mean).collect();
        let squares: f64 = frames
            .iter()
            .map(|frame| frame.iter().zip(&values).map(|(value, mean)| (value - mean).powi(2)).sum::<f64>())
            .sum();
        Mean { variance: squares / (count - 1.0) / count, values }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_sim::random::{sample_rng, standard_normal};
    use std::time::Duration;

    /// The events of frames with a level and noise, `rate_hz` frames a second, touched where the level is not zero.
    fn events(rate_hz: f64, noise: f64, levels: impl Iterator<Item = f64>) -> Vec<(usize, PressEvent)> {
        let (mut collector, mut found) = (PressCollector::default(), Vec::new());
        let mut rng = sample_rng(3, 0);
        for (number, level) in levels.enumerate() {
            let at = Timestamp::default().after(Duration::from_secs_f64(number as f64 / rate_hz));
            let values_ohm =
                (0..20).map(|channel| 5.0 + level * f64::from(channel) + noise * standard_normal(&mut rng));
            let frame = PipelineFrame {
                sequence: number as u64,
                measured_at: at,
                values_ohm: values_ohm.collect(),
                image: Vec::new(),
                validity: Default::default(),
                touched: Some(level != 0.0),
                contacts: Vec::new(),
                health: Default::default(),
            };
            if let Some(event) = collector.take(&frame) {
                if event == PressEvent::Began {
                    collector.baseline_ohm = Some(vec![5.0; 20]);
                }
                found.push((number, event));
            }
        }
        found
    }

    /// A press that rises with a time constant (s) and lasts for some seconds.
    fn press(rate_hz: f64, rise_s: f64, seconds: f64) -> impl Iterator<Item = f64> {
        let time_s = move |number: i32| f64::from(number) / rate_hz;
        (0..).map(time_s).take_while(move |time_s| *time_s < seconds + 2.0).map(move |time_s| {
            if (1.0..1.0 + seconds).contains(&time_s) { 1.0 - (-(time_s - 0.99) / rise_s).exp() } else { 0.0 }
        })
    }

    #[test]
    fn a_press_is_taken_when_it_is_steady_and_once() {
        for (rate_hz, rise_s, taken_s) in [(120.0, 0.03, 0.6..0.8), (120.0, 0.4, 1.2..2.2), (4.0, 0.03, 1.5..2.1)] {
            let found = events(rate_hz, 0.05, press(rate_hz, rise_s, 4.0));
            let [(_, PressEvent::Began), (at, PressEvent::Steady(difference)), (left, PressEvent::Left)] = &found[..]
            else {
                panic!("{found:?}")
            };
            let after_s = *at as f64 / rate_hz - 1.0;
            assert!(taken_s.contains(&after_s), "at {rate_hz} Hz after {after_s} s");
            assert!((difference[19] - 19.0).abs() < 0.06 * 19.0 && difference[0].abs() < 0.25);
            // The first frame that long after the last touched one, which is before 5 s.
            let apart_s = *left as f64 / rate_hz - (5.0 - 1.0 / rate_hz);
            assert!((APART_S - 1e-6..=APART_S + 1.0 / rate_hz).contains(&apart_s), "at {rate_hz} Hz after {apart_s} s");
        }
    }

    #[test]
    fn a_weak_press_is_taken_in_noise_and_a_short_one_is_not() {
        let found = events(120.0, 1.0, press(120.0, 0.03, 3.0).map(|level| 0.02 * level));
        assert!(matches!(found[1], (_, PressEvent::Steady(_))), "{found:?}");
        let found = events(120.0, 0.05, press(120.0, 0.03, 0.4));
        let flickering =
            (0..).zip(press(120.0, 0.03, 2.0)).map(|(number, level)| if number == 122 { 0.0 } else { level });
        let held = events(120.0, 0.05, flickering);
        assert!(matches!(held[..], [(_, PressEvent::Began), (_, PressEvent::Steady(_)), (_, PressEvent::Left)]));
        assert!(matches!(found[..], [(_, PressEvent::Began), (_, PressEvent::TooShort), (_, PressEvent::Left)]));
    }
}
