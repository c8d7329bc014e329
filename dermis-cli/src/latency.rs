//! Latency statistics of a live skin.

use crate::console::print_json;
use crate::failure::Outcome;
use dermis::frame::write_whole;
use dermis::pipeline::{Counts, Validity};
use dermis::stats::nearest_quantiles;
use dermis::text::counted;
use dermis_live::{LiveFrame, LiveHandle};
use dermis_plot::chart::Histogram;
use dermis_plot::report::Table;
use serde_json::json;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Latency statistics of a live skin.
pub struct Latencies {
    shared: Arc<LiveHandle>,
    begun: Instant,
    /// From the last byte of a frame to its contacts, ms.
    all_ms: Vec<f32>,
    frames: u64,
    contacts: usize,
    validity: Validity,
    touched_frames: u64,
    counts: Counts,
    rate_hz: f64,
    /// Frames that were not counted.
    pub missed: u64,
}

/// Maximum number of stored latencies: one hour at 2,000 frames per second.
const MAX: usize = 7_200_000;

impl Latencies {
    /// Without frames yet.
    pub fn new(shared: Arc<LiveHandle>) -> Self {
        Latencies {
            shared,
            begun: Instant::now(),
            all_ms: Vec::new(),
            frames: 0,
            contacts: 0,
            validity: Validity::Ok,
            touched_frames: 0,
            counts: Counts::default(),
            rate_hz: 0.0,
            missed: 0,
        }
    }

    /// Adds a frame.
    pub fn take(&mut self, frame: &LiveFrame) {
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

    /// A status line.
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

    /// Prints the final statistics.
    pub fn show(self, picture: Option<&Path>, as_json: bool) -> Outcome {
        let seconds = self.begun.elapsed().as_secs_f64();
        if let Some(path) = picture {
            self.draw(path)?;
        }
        let [median, p99, worst] = nearest_quantiles(&self.all_ms, [0.5, 0.99, 1.0]);
        let Counts { lost, repeated, reordered, damaged, reconnected, .. } = self.counts;
        let (skipped, dropped) = (self.shared.skipped(), self.shared.dropped());
        if as_json {
            return print_json(&json!({
                "seconds": seconds,
                "frames": self.frames,
                "frames_a_second": self.frames as f64 / seconds,
                "frames_with_contacts": self.touched_frames,
                "lost": lost,
                "skipped": skipped,
                "left_out": dropped,
                "repeated": repeated,
                "reordered": reordered,
                "damaged": damaged,
                "reconnected": reconnected,
                "uncounted": self.missed,
                "latency_ms": { "median": median, "p99": p99, "worst": worst },
            }));
        }
        let mut table = Table::new(&["quantity", "value"]);
        table.pair("frames", format!("{} in {seconds:.1} s", self.frames));
        table.pair("of them with contacts", self.touched_frames);
        table.pair("lost in transfer", lost);
        table.pair("dropped before the pipeline", skipped);
        for (sink, count) in dropped {
            table.pair(&format!("dropped by {sink}"), count);
        }
        table.pair("repeated; reordered", format!("{repeated}; {reordered}"));
        table.pair("damaged packets", damaged);
        table.pair("from last byte to contacts, median", format!("{median:.3} ms"));
        table.pair("the same, 99 % within", format!("{p99:.3} ms"));
        table.pair("the same, longest", format!("{worst:.3} ms"));
        // Standard output may carry lines of JSON, and its writer may hold the lock while a reader does not read.
        eprintln!("\n{}", table.to_text());
        Ok(())
    }

    fn draw(&self, path: &Path) -> Outcome {
        let [median, p99] = nearest_quantiles(&self.all_ms, [0.5, 0.99]).map(f64::from);
        // Rare outliers would compress the rest of the histogram.
        let shown: Vec<f64> = self.all_ms.iter().map(|&ms| f64::from(ms)).filter(|&ms| ms <= 3.0 * p99).collect();
        let marks = vec![(median, format!("median {median:.2} ms")), (p99, format!("99 % within {p99:.2} ms"))];
        let histogram = Histogram {
            title: &counted(self.all_ms.len(), "frame"),
            label: "from the last byte of a frame to its contacts (ms)",
            values: &shown,
            counted: "frames",
            step: (p99 / 40.0).max(0.005),
            marks,
        };
        Ok(write_whole(path, |out| out.write_all(histogram.draw().to_svg().as_bytes()))?)
    }
}
