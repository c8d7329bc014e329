//! Whether presses still look like those of the method's calibration.

use crate::stats::upper_median;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Presses that are compared.
const PRESSES: usize = 20;
/// Below this median the skin is again as calibrated.
const AS_CALIBRATED: f64 = 0.7;

/// The [novelty](crate::reconstruct::Reconstruct::novelty) of the last presses. Each counts with its least novel frame,
/// as its begin and its end are weaker than a calibrated press.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct NoveltyMonitor {
    /// Of the present press.
    lowest: Option<f64>,
    recent: VecDeque<f64>,
    aged: bool,
}

impl NoveltyMonitor {
    /// Takes a frame. Returns the median novelty of the last presses when it has risen above that of nearly all labels.
    pub(super) fn update(&mut self, touched: bool, novelty: impl FnOnce() -> Option<f64>) -> Option<f64> {
        if touched {
            let lowest = self.lowest.unwrap_or(f64::INFINITY);
            self.lowest = novelty().map(|novelty| novelty.min(lowest)).or(self.lowest);
            return None;
        }
        self.recent.push_back(self.lowest.take()?);
        if self.recent.len() > PRESSES {
            self.recent.pop_front();
        }
        let median = upper_median(self.recent.make_contiguous())?;
        let rises = self.recent.len() == PRESSES && median > 1.0 && !self.aged;
        self.aged = rises || (self.aged && median > AS_CALIBRATED);
        rises.then_some(median)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Presses of three frames, the first of them weak and thus novel, with a pause after each.
    fn press(monitor: &mut NoveltyMonitor, novelty: f64) -> Option<f64> {
        let of_frame = |frame: usize| if frame == 0 { 9.0 } else { novelty };
        let during = (0..3).filter_map(|frame| monitor.update(true, || Some(of_frame(frame)))).last();
        assert_eq!(during, None, "a press is judged when it has ended");
        (0..5).filter_map(|_| monitor.update(false, || panic!("an untouched frame has no novelty"))).last()
    }

    #[test]
    fn a_skin_that_has_aged_is_reported_once() {
        let mut monitor = NoveltyMonitor::default();
        let usual = (0..200).filter_map(|k| press(&mut monitor, if k % 10 == 0 { 3.0 } else { 0.4 })).count();
        assert_eq!(usual, 0, "single unusual presses are no ageing");
        let reports: Vec<f64> = (0..100).filter_map(|_| press(&mut monitor, 2.5)).collect();
        assert_eq!(reports, [2.5]);
        (0..40).for_each(|_| assert_eq!(press(&mut monitor, 0.5), None));
        assert_eq!((0..100).filter_map(|_| press(&mut monitor, 2.5)).count(), 1, "aged again");
    }

    #[test]
    fn methods_without_a_calibration_report_nothing() {
        let mut monitor = NoveltyMonitor::default();
        for frame in 0..1000 {
            assert_eq!(monitor.update(frame % 20 < 10, || None), None);
        }
    }
}
