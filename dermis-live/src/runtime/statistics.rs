//! Statistics of a live skin.

use super::{LiveFrame, LiveHandle};
use dermis::pipeline::{Counts, Validity};
use dermis::stats::nearest_quantiles;
use dermis::text::counted;
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// Maximum number of stored latencies: one hour at 2,000 frames per second.
const MAX: usize = 7_200_000;

/// Statistics of the frames of a live skin so far.
pub struct LiveStatistics {
    shared: Arc<LiveHandle>,
    begun: Instant,
    all_ms: Vec<f32>,
    frames: u64,
    contacts: usize,
    validity: Validity,
    touched_frames: u64,
    counts: Counts,
    rate_hz: f64,
}

/// Statistics of a run; serialised to the JSON output of `dermis live --json`.
#[derive(Debug, Clone, Serialize)]
pub struct LiveSummary {
    /// Time since the beginning, s.
    pub seconds: f64,
    /// Frames that were counted.
    pub frames: u64,
    /// Frames per second.
    pub frames_a_second: f64,
    /// Frames with contacts.
    pub frames_with_contacts: u64,
    /// Frames that were lost in transfer.
    pub lost: u64,
    /// Frames that were dropped before the pipeline.
    pub skipped: u64,
    /// Events that each sink has dropped.
    pub left_out: BTreeMap<&'static str, u64>,
    /// Frames that arrived again.
    pub repeated: u64,
    /// Frames that arrived in another order.
    pub reordered: u64,
    /// Damaged packets.
    pub damaged: u64,
    /// Number of reconnections.
    pub reconnected: u64,
    /// Events that were not counted here.
    pub uncounted: u64,
    /// Time from the last byte of a frame to its contacts, ms.
    pub latency_ms: Latency,
}

/// Quantiles of a latency, ms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Latency {
    /// The median.
    pub median: f32,
    /// The 99th percentile.
    pub p99: f32,
    /// The longest.
    pub worst: f32,
}

impl LiveStatistics {
    /// Without frames yet.
    pub fn new(shared: Arc<LiveHandle>) -> Self {
        LiveStatistics {
            shared,
            begun: Instant::now(),
            all_ms: Vec::new(),
            frames: 0,
            contacts: 0,
            validity: Validity::Ok,
            touched_frames: 0,
            counts: Counts::default(),
            rate_hz: 0.0,
        }
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: &LiveFrame) {
        if self.all_ms.len() < MAX {
            self.all_ms.push(1e3 * frame.output_at.seconds_since(frame.received_at) as f32);
        }
        self.frames += 1;
        self.show_state(frame);
        self.touched_frames += u64::from(!frame.result.contacts.is_empty());
        self.counts = frame.result.health.counts;
        self.rate_hz = frame.result.health.rate_hz;
    }

    /// Takes the contacts and the validity of a frame, or of a stale one, which is not counted.
    pub fn show_state(&mut self, frame: &LiveFrame) {
        self.contacts = frame.result.contacts.len();
        self.validity = frame.result.validity.clone();
    }

    /// A status line: rate, contacts, latency of the last thousand frames, lost frames.
    pub fn line(&self) -> String {
        let recent = &self.all_ms[self.all_ms.len().saturating_sub(1000)..];
        let [median, p99] = nearest_quantiles(recent, [0.5, 0.99]);
        let contacts = match self.validity.is_usable() {
            true => counted(self.contacts, "contact"),
            false => self.validity.to_string(),
        };
        let lost = counted(self.counts.lost + self.shared.skipped(), "frame");
        format!("{:.0} frames/s, {contacts}, {median:.2} ms (99 %: {p99:.2} ms), {lost} lost", self.rate_hz)
    }

    /// The time from the last byte of each frame to its contacts, ms; of the first hour at 2 kHz.
    pub fn latencies_ms(&self) -> &[f32] {
        &self.all_ms
    }

    /// The summary until now; `uncounted` is the number of events that were not added.
    pub fn summary(&self, uncounted: u64) -> LiveSummary {
        let seconds = self.begun.elapsed().as_secs_f64();
        let [median, p99, worst] = nearest_quantiles(&self.all_ms, [0.5, 0.99, 1.0]);
        let Counts { lost, repeated, reordered, damaged, reconnected, .. } = self.counts;
        LiveSummary {
            seconds,
            frames: self.frames,
            frames_a_second: self.frames as f64 / seconds,
            frames_with_contacts: self.touched_frames,
            lost,
            skipped: self.shared.skipped(),
            left_out: self.shared.dropped(),
            repeated,
            reordered,
            damaged,
            reconnected,
            uncounted,
            latency_ms: Latency { median, p99, worst },
        }
    }
}
