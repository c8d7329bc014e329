//! Frames that are no new measurements, as they repeat earlier ones.

use crate::pipeline::frame::Measurement;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// A device that sends no new measurements repeats one of so many frames.
const REMEMBERED: usize = 16;
/// The chance at which a frame of a sound instrument is called a repeated one: once in three months at 120 frames a second.
const BY_CHANCE: f64 = 1e-9;
/// Standard deviations by which values may change less often than at the tare.
const DEVIATIONS: f64 = 3.0;

/// Tells a device that repeats frames from one whose noise is less than a step of its converter, whose frames are equal now and
/// then by chance.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct RepeatMonitor {
    /// Minus the logarithm of the chance that two frames of a sound instrument are equal; 0 if they may always be.
    surprise: f64,
    /// Checksums of the last frames, the newest first.
    last: VecDeque<u64>,
    /// For each of them, how many frames in a row were equal to the one that was as long before.
    counts: [u32; REMEMBERED],
}

impl RepeatMonitor {
    /// From untouched frames, and the drive of each channel. Where all are equal, as those of a simulation without noise, no frame
    /// is called a repeated one.
    ///
    /// The values of one drive change together, with its current; the drives are independent. Where noise is less than a step, a
    /// few values change by one step and the others stay. Each of the few adds half to the logarithm on average, and their number
    /// varies like a Poisson variable: the variance of the logarithm is half of it.
    pub(super) fn new(drive_of: &[usize], untouched: &[Measurement]) -> Self {
        let drive_count = drive_of.iter().max().map_or(0, |last| last + 1);
        let of_drives = |frame: &Measurement| {
            let mut sums = vec![NO_WORDS; drive_count];
            for (&drive, &value) in drive_of.iter().zip(&frame.values_ohm) {
                sums[drive] = with_word(sums[drive], value);
            }
            sums
        };
        let sums: Vec<Vec<u64>> = untouched.iter().map(of_drives).collect();
        let pairs: Vec<[usize; 2]> = (0..sums.len()).flat_map(|b| (0..b).map(move |a| [a, b])).collect();
        let of_drive = |drive: usize| {
            let equal = pairs.iter().filter(|&&[a, b]| sums[a][drive] == sums[b][drive]).count();
            // What happens in none of the pairs may happen in one of as many others.
            (pairs.len().max(1) as f64 / equal.max(1) as f64).ln()
        };
        let surprise: f64 = (0..drive_count).map(of_drive).sum();
        RepeatMonitor {
            surprise: (surprise - DEVIATIONS * (0.5 * surprise).sqrt()).max(0.0),
            last: untouched.iter().rev().take(REMEMBERED).map(checksum).collect(),
            counts: [0; REMEMBERED],
        }
    }

    /// Whether a frame, and those before it, repeat earlier ones more often than by chance.
    pub(super) fn check(&mut self, frame: &Measurement) -> bool {
        let checksum = checksum(frame);
        for (count, before) in self.counts.iter_mut().zip(&self.last) {
            *count = if *before == checksum { count.saturating_add(1) } else { 0 };
        }
        self.last.push_front(checksum);
        self.last.truncate(REMEMBERED);
        let most = self.counts.iter().copied().max().unwrap_or(0);
        f64::from(most) * self.surprise > (REMEMBERED as f64 / BY_CHANCE).ln()
    }
}

fn checksum(frame: &Measurement) -> u64 {
    frame.values_ohm.iter().chain(&frame.loops_ohm).fold(NO_WORDS, |sum, value| with_word(sum, *value))
}

/// The FNV-1a hash (Fowler, Noll and Vo; RFC 9923), word by word.
const NO_WORDS: u64 = 0xcbf2_9ce4_8422_2325;
fn with_word(sum: u64, value: f64) -> u64 {
    (sum ^ value.to_bits()).wrapping_mul(0x0100_0000_01b3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const DRIVES: usize = 12;

    /// An instrument that reads steps, of 12 drives with 12 values each, with noise in steps.
    struct Instrument {
        rng: ChaCha8Rng,
        values: Vec<f64>,
        noise: f64,
    }

    impl Instrument {
        fn new(seed: u64, noise: f64) -> Self {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let values = (0..DRIVES * DRIVES).map(|_| 100.0 * rng.random::<f64>()).collect();
            Instrument { rng, values, noise }
        }

        fn frame(&mut self) -> Measurement {
            let noise = self.noise;
            let mut read = |value: &f64| {
                let parts: f64 = (0..12).map(|_| self.rng.random::<f64>()).sum();
                (value + noise * (parts - 6.0)).round()
            };
            Measurement { values_ohm: self.values.iter().map(&mut read).collect(), ..Measurement::default() }
        }

        fn monitor(&mut self) -> RepeatMonitor {
            let drive_of: Vec<usize> = (0..DRIVES * DRIVES).map(|channel| channel / DRIVES).collect();
            RepeatMonitor::new(&drive_of, &(0..100).map(|_| self.frame()).collect::<Vec<_>>())
        }
    }

    /// After how many frames a device that repeats its last few frames is noticed.
    fn noticed_after(monitor: &mut RepeatMonitor, ring: &[Measurement]) -> Option<usize> {
        (0..200).find(|index| monitor.check(&ring[index % ring.len()]))
    }

    #[test]
    fn frames_that_are_equal_by_chance_are_measurements() {
        let mut equal = 0;
        for seed in 0..10 {
            let mut instrument = Instrument::new(seed, 0.02);
            let mut monitor = instrument.monitor();
            // Another temperature: other values are between two steps.
            for _ in 0..20 {
                instrument.values.iter_mut().for_each(|value| *value *= 1.001);
                for _ in 0..100 {
                    assert!(!monitor.check(&instrument.frame()), "{seed}: {monitor:?}");
                    equal += usize::from(monitor.counts.iter().any(|count| *count > 0));
                }
            }
        }
        assert!(equal > 100, "{equal}");
    }

    #[test]
    fn a_device_that_repeats_frames_is_noticed() {
        for (noise, most) in [(0.05, 16), (1.0, 0)] {
            for length in [1, 7, REMEMBERED] {
                let mut instrument = Instrument::new(3, noise);
                let mut monitor = instrument.monitor();
                let ring: Vec<Measurement> = (0..length).map(|_| instrument.frame()).collect();
                assert!(ring.iter().all(|frame| !monitor.check(frame)));
                let after = noticed_after(&mut monitor, &ring);
                assert!(after.is_some_and(|after| after <= most), "{noise} {length}: {after:?} {}", monitor.surprise);
            }
        }
        // A simulation without noise.
        let mut instrument = Instrument::new(3, 0.0);
        let mut monitor = instrument.monitor();
        assert_eq!(noticed_after(&mut monitor, &[instrument.frame()]), None);
    }
}
