//! The thread that notices that frames stop: the pipeline may be busy with one of them.

use crate::recording::Playback;
use crate::runtime::notice_limit::NoticeLimit;
use crate::runtime::{Event, LiveFrame, LiveHandle, POLL, lock};
use dermis::pipeline::{Severity, Validity};
use dermis::text::counted;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Shortest time without a frame after which the last one is stale.
const STALE: Duration = Duration::from_millis(150);
/// The same as a multiple of the interval between frames.
const INTERVALS: f64 = 3.0;
/// Interval at which a stale frame is reported again.
const AGAIN: Duration = Duration::from_millis(200);
/// Weight of an interval between two frames in their mean.
const SMOOTH: f64 = 0.1;
/// Interruptions of the frames that are reported in an interval; of the others only their number. On a busy machine frames can
/// stop several times a second.
const GAPS: u32 = 2;
const GAP_INTERVAL: Duration = Duration::from_secs(10);

/// Publishes frames, and reports the last one as stale while no other comes.
pub(super) struct StaleWatch {
    shared: Arc<LiveHandle>,
    frames: Mutex<Frames>,
}

/// The last frame, and how often frames come.
struct Frames {
    last: Option<Arc<LiveFrame>>,
    arrived: Instant,
    /// Mean interval between frames that were computed in time, s.
    interval_s: f64,
    reported: Option<Instant>,
    gaps: NoticeLimit,
    /// Whether the end of an interruption is reported, as its start was.
    tells_end: bool,
}

impl StaleWatch {
    pub(super) fn new(shared: Arc<LiveHandle>) -> Arc<Self> {
        let frames = Frames {
            last: None,
            arrived: Instant::now(),
            interval_s: 0.0,
            reported: None,
            gaps: NoticeLimit::new(GAPS, GAP_INTERVAL),
            tells_end: false,
        };
        Arc::new(StaleWatch { shared, frames: Mutex::new(frames) })
    }

    /// Watches until no more events come.
    pub(super) fn run(&self) {
        while !self.shared.is_ended() {
            std::thread::sleep(POLL);
            self.report();
        }
    }

    /// Publishes a frame. No report of the one before comes after it.
    pub(super) fn publish(&self, frame: LiveFrame) {
        let mut frames = lock(&self.frames);
        let frame = Arc::new(frame);
        if frames.take(&frame) && frames.tells_end {
            self.shared.notice(Severity::Info, "frames are computed again".into());
        }
        self.shared.publish(&Event::Frame(frame));
    }

    /// No frame is expected before now.
    pub(super) fn rest(&self) {
        lock(&self.frames).arrived = Instant::now();
    }

    /// Reports that frames have stopped, unless people have stopped them.
    fn report(&self) {
        let mut frames = lock(&self.frames);
        if self.shared.playback().is_some_and(Playback::is_paused) {
            frames.arrived = Instant::now();
            return;
        }
        if let Some((frame, is_first)) = frames.stale() {
            if is_first {
                frames.tells_end = frames.gaps.passes(Instant::now());
                if frames.tells_end {
                    let why = if self.shared.has_work() {
                        "the computer is too slow for the frames that arrive"
                    } else {
                        "no frames arrive"
                    };
                    self.shared.notice(
                        Severity::Error,
                        format!("{why}: contacts and touch are unknown until one is computed"),
                    );
                }
            }
            self.shared.publish(&Event::Stale(Arc::new(frame)));
        }
        self.report_gaps(&mut frames, false);
    }

    /// Reports the interruptions that were only counted, before the end.
    pub(super) fn end(&self) {
        self.report_gaps(&mut lock(&self.frames), true);
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
    /// Takes a frame; returns whether the one before was stale.
    fn take(&mut self, frame: &Arc<LiveFrame>) -> bool {
        let now = Instant::now();
        let interval_s = now.duration_since(self.arrived).as_secs_f64();
        let was_stale = self.reported.take().is_some();
        let is_late = matches!(frame.result.validity, Validity::Stale { .. });
        if self.last.is_some() && !was_stale && !is_late {
            self.interval_s += SMOOTH * (interval_s - self.interval_s);
        }
        self.last = Some(Arc::clone(frame));
        self.arrived = now;
        was_stale
    }

    /// The stale frame to report now, and whether it is the first report.
    fn stale(&mut self) -> Option<(LiveFrame, bool)> {
        let age = self.arrived.elapsed();
        let limit = STALE.max(Duration::from_secs_f64(INTERVALS * self.interval_s));
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
