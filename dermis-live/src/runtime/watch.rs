//! The watch of frames, on a thread of its own: a frame that is computed for seconds leaves the one before stale, as frames do
//! that do not arrive.

use crate::recording::Playback;
use crate::runtime::notice_limit::NoticeLimit;
use crate::runtime::{Event, Input, LiveFrame, LiveHandle, POLL, lock};
use dermis::pipeline::{Severity, Validity};
use dermis::stats::upper_median;
use dermis::text::counted;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Shortest time without a frame after which the last one is stale.
pub(super) const STALE: Duration = Duration::from_millis(150);
/// The same as a multiple of the interval between frames.
const INTERVALS: f64 = 3.0;
/// Time without the first frame of a connected device after which people are told.
const FIRST: Duration = Duration::from_secs(2);
/// Interval at which a stale frame is reported again.
const AGAIN: Duration = Duration::from_millis(200);
/// Last intervals between frames of which the median counts: an interruption is one of them.
const LAST: usize = 5;
/// Interruptions of the frames that are reported in an interval; of the others only their number. On a busy machine frames can
/// stop several times a second.
const GAPS: u32 = 2;
const GAP_INTERVAL: Duration = Duration::from_secs(10);

/// Publishes the frames, and notices that they stop.
pub(super) struct Watch {
    shared: Arc<LiveHandle>,
    /// Whether frames do not wait for the pipeline: what is computed late is stale.
    is_live: bool,
    is_busy: AtomicBool,
    frames: Mutex<Frames>,
}

/// The frames that were published.
struct Frames {
    last: Option<Arc<LiveFrame>>,
    arrived: Instant,
    /// The last intervals between frames, s.
    intervals_s: VecDeque<f64>,
    /// When the last frame was reported as stale.
    reported: Option<Instant>,
    /// Whether the absence of the first one was reported.
    is_missing_told: bool,
    gaps: NoticeLimit,
    /// Whether the end of an interruption is reported, as its start was.
    tells_end: bool,
}

impl Watch {
    pub(super) fn new(shared: Arc<LiveHandle>, input: Input) -> Self {
        let frames = Frames {
            last: None,
            arrived: Instant::now(),
            intervals_s: VecDeque::new(),
            reported: None,
            is_missing_told: false,
            gaps: NoticeLimit::new(GAPS, GAP_INTERVAL),
            tells_end: false,
        };
        let is_live = input == Input::Device;
        Watch { shared, is_live, is_busy: AtomicBool::new(false), frames: Mutex::new(frames) }
    }

    /// Watches until no more frames come.
    pub(super) fn run(&self) {
        while !self.shared.is_ended() {
            std::thread::sleep(POLL);
            self.report();
        }
    }

    /// Whether the pipeline computes, rather than waits for a frame.
    pub(super) fn set_busy(&self, is_busy: bool) {
        self.is_busy.store(is_busy, Ordering::Relaxed);
    }

    /// Publishes a frame. The lock is held meanwhile: a stale frame never follows a newer one.
    pub(super) fn publish(&self, frame: LiveFrame) {
        let mut frames = lock(&self.frames);
        let frame = Arc::new(frame);
        let interval_s = frames.arrived.elapsed().as_secs_f64();
        // One that comes too late ends nothing, and is no measure of the others.
        let is_late = matches!(frame.result.validity, Validity::Stale { .. });
        let was_stale = !is_late && frames.reported.take().is_some();
        if frames.last.is_some() && !is_late {
            frames.intervals_s.push_back(interval_s);
            let more = frames.intervals_s.len().saturating_sub(LAST);
            frames.intervals_s.drain(..more);
        }
        (frames.last, frames.arrived) = (Some(Arc::clone(&frame)), Instant::now());
        if was_stale && frames.tells_end {
            self.shared.notice(Severity::Info, "frames arrive in time again".into());
        }
        self.shared.publish(&Event::Frame(frame));
    }

    /// No frame is expected before now.
    pub(super) fn rest(&self) {
        lock(&self.frames).arrived = Instant::now();
    }

    /// Reports the interruptions that were only counted.
    pub(super) fn end(&self) {
        self.report_gaps(&mut lock(&self.frames), true);
    }

    /// Reports that frames have stopped, unless people have stopped them or the next one waits for what is computed.
    fn report(&self) {
        let mut frames = lock(&self.frames);
        let is_busy = self.is_busy.load(Ordering::Relaxed);
        // What could not be relied on anyway, as before the tare, needs no warning while a method is prepared.
        let was_invalid =
            frames.last.as_ref().is_some_and(|last| matches!(last.result.validity, Validity::Invalid { .. }));
        if is_busy && (!self.is_live || was_invalid) || self.shared.playback().is_some_and(Playback::is_paused) {
            frames.arrived = Instant::now();
            return;
        }
        if frames.last.is_none() && self.shared.facts().is_none() {
            // Nothing is connected yet.
            frames.arrived = Instant::now();
        }
        let is_missing = frames.last.is_none() && !is_busy && frames.arrived.elapsed() > FIRST;
        if is_missing && self.is_live && !frames.is_missing_told {
            frames.is_missing_told = true;
            let text = "the device is connected, but no frame has arrived for 2 s: does it measure, and is its format the \
                        stated one?";
            self.shared.notice(Severity::Warning, text.into());
        }
        if let Some((stale, is_first)) = frames.stale() {
            if is_first {
                frames.tells_end = frames.gaps.passes(Instant::now());
                if frames.tells_end {
                    let text = match is_busy {
                        true => {
                            "the computer is too slow: contacts and touch are unknown until a frame is computed in time"
                        }
                        false => "no frames arrive: contacts and touch are unknown until they do",
                    };
                    self.shared.notice(Severity::Error, text.into());
                }
            }
            self.shared.publish(&Event::Stale(Arc::new(stale)));
        }
        self.report_gaps(&mut frames, false);
    }

    fn report_gaps(&self, frames: &mut Frames, is_end: bool) {
        if let Some(count) = frames.gaps.take_omitted(Instant::now(), is_end) {
            let text = format!(
                "the frames stopped {}: is the computer, or the device, too slow?",
                counted(count, "more time")
            );
            self.shared.notice(Severity::Warning, text);
        }
    }
}

impl Frames {
    /// The stale frame to report now, and whether it is the first report.
    fn stale(&mut self) -> Option<(LiveFrame, bool)> {
        let age = self.arrived.elapsed();
        let nominal_hz = self.last.as_ref().and_then(|last| last.result.health.nominal_rate_hz).unwrap_or(0.0);
        // A device that states its rate is not waited for longer because frames were lost.
        let usual_s = upper_median(self.intervals_s.make_contiguous()).unwrap_or(0.0).min(1.0 / nominal_hz);
        let limit = STALE.max(Duration::from_secs_f64(INTERVALS * usual_s));
        let is_due = self.reported.is_none_or(|at| at.elapsed() >= AGAIN);
        let last = self.last.as_ref().filter(|_| age > limit && is_due)?;
        let is_first = self.reported.replace(Instant::now()).is_none();
        let age_s = age.as_secs_f64();
        let mut stale = last.stale(age_s);
        // At most one frame has arrived in this time.
        let health = Arc::make_mut(&mut stale.result.health);
        health.rate_hz = health.rate_hz.min(1.0 / age_s);
        Some((stale, is_first))
    }
}
