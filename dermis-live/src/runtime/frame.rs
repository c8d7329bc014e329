//! A processed frame with what the device sent and when, as every sink receives it.

use crate::clock;
use dermis::pipeline::{PipelineFrame, Timestamp, Validity};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A processed frame, with its message and the times on its way.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveFrame {
    /// The frame and its contacts.
    pub result: PipelineFrame,
    /// When its last byte was received.
    pub received_at: Timestamp,
    /// When its contacts were computed.
    pub output_at: Timestamp,
    /// The message of the device ([`dermis_wire::Frame`]): with the session's hello all that a replay needs.
    pub message: Vec<u8>,
}

impl LiveFrame {
    /// The same frame some time after it: stale, without contacts and image.
    pub(super) fn stale(&self, age_s: f64) -> Self {
        let mut stale = LiveFrame { output_at: clock::now(), message: Vec::new(), ..self.clone() };
        let PipelineFrame { validity, touched, contacts, image, .. } = &mut stale.result;
        (*validity, *touched) = (Validity::Stale { age_s }, None);
        contacts.clear();
        image.fill(0.0);
        stale
    }
}

/// Shortest time without a frame after which the last one is stale.
const STALE: Duration = Duration::from_millis(150);
/// The same as a multiple of the interval between frames.
const INTERVALS: f64 = 3.0;
/// Interval at which a stale frame is reported again.
const AGAIN: Duration = Duration::from_millis(200);
/// Weight of an interval between two frames in their mean.
const SMOOTH: f64 = 0.1;

/// Notices that frames stop.
#[derive(Debug)]
pub(super) struct StaleWatch {
    last: Option<Arc<LiveFrame>>,
    arrived: Instant,
    /// Mean interval between frames, s.
    interval_s: f64,
    reported: Option<Instant>,
}

impl StaleWatch {
    pub(super) fn new() -> Self {
        StaleWatch { last: None, arrived: Instant::now(), interval_s: 0.0, reported: None }
    }

    /// Takes a frame; returns whether the one before was stale.
    pub(super) fn take(&mut self, frame: &Arc<LiveFrame>) -> bool {
        let now = Instant::now();
        let interval_s = now.duration_since(self.arrived).as_secs_f64();
        let was_stale = self.reported.take().is_some();
        if self.last.is_some() && !was_stale {
            self.interval_s += SMOOTH * (interval_s - self.interval_s);
        }
        self.last = Some(Arc::clone(frame));
        self.arrived = now;
        was_stale
    }

    /// No frame is expected before now.
    pub(super) fn rest(&mut self) {
        self.arrived = Instant::now();
    }

    /// The stale frame to report now, and whether it is the first report.
    pub(super) fn check(&mut self) -> Option<(LiveFrame, bool)> {
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
