//! Faults of an emulated device, on demand.

use crate::EmulateError;
use dermis_live::device::Role;
use dermis_sim::random::{sample_rng, standard_normal};
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// A fault and its time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TimedFault {
    /// Time, s from the start of the device.
    pub at_s: f64,
    /// The fault.
    pub fault: Fault,
}

/// A fault.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// A fault of the readings, for some time.
    Readings {
        /// The fault.
        fault: ReadingFault,
        /// Duration, s.
        for_s: f64,
    },
    /// Damage to packets with some probability: a byte changed, lost or doubled, or noise before the packet; for some
    /// time.
    Bytes {
        /// Probability for each packet.
        share: f64,
        /// Duration, s.
        for_s: f64,
    },
    /// A loose electrode: from then on, a resistance in series with it. 0 repairs it.
    Loose {
        /// The electrode.
        electrode: usize,
        /// Resistance, ohm.
        ohm: f64,
    },
    /// The device is unplugged, and plugged in again after some time.
    Unplug {
        /// Duration, s.
        for_s: f64,
    },
    /// The device sends no frames, but answers and sends its status, for some time.
    Silent {
        /// Duration, s.
        for_s: f64,
    },
    /// The clock of the device stands still for some time.
    ClockStop {
        /// Duration, s.
        for_s: f64,
    },
    /// The clock of the device is set, once.
    ClockSet {
        /// The change, s; negative for back.
        by_s: f64,
    },
}

/// A fault of the readings of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReadingFault {
    /// Additional noise on every reading, standard deviation in counts.
    Noise(f64),
    /// The source is off: readings of zero but for the noise of the converter.
    SourceOff,
    /// All readings are zero.
    Zeros,
    /// All readings are at full scale.
    FullScale,
    /// The readings of the first frame are repeated.
    Freeze,
    /// A factor on the readings of the reference resistor, for all drives.
    References(f64),
    /// The same for one drive.
    Reference(usize, f64),
    /// A factor on all readings but those of the reference resistor.
    Gain(f64),
    /// Counts added to all readings but those of the reference resistor.
    Offset(f64),
    /// The reading of a channel stays at that of the first frame.
    Stuck(usize),
    /// The reading of a channel is at full scale.
    Saturated(usize),
}

/// Default resistance of a loose contact, ohm.
const LOOSE_OHM: f64 = 1000.0;
/// The forms of a fault.
const FORMS: &str = "loose:ELECTRODE[:OHM]@SECONDS, mend:ELECTRODE@SECONDS, clock-set:BY@SECONDS, or with a duration \
                     @SECONDS+FOR: noise:COUNTS, bytes:SHARE, unplug, silent, clock-stop, source-off, zeros, full-scale, \
                     freeze, references:FACTOR, reference:DRIVE:FACTOR, gain:FACTOR, offset:COUNTS, stuck:CHANNEL, \
                     saturated:CHANNEL";

/// The largest number of a fault, in its unit.
const MAX: f64 = 1e9;

impl FromStr for TimedFault {
    type Err = EmulateError;

    /// Parses `KIND[:VALUE...]@SECONDS[+FOR]`.
    fn from_str(text: &str) -> Result<Self, EmulateError> {
        parse(text).ok_or_else(|| {
            EmulateError::Given(format!(
                "`{text}` is no fault: write {FORMS}, as in loose:7@10 or zeros@10+2, with numbers from -1e9 to 1e9"
            ))
        })
    }
}

fn parse(text: &str) -> Option<TimedFault> {
    let number = |text: &str| text.parse::<f64>().ok().filter(|value| value.abs() <= MAX);
    let positive = |text: &str| number(text).filter(|value| *value >= 0.0);
    let (what, when) = text.split_once('@')?;
    let (at_s, for_s) = match when.split_once('+') {
        Some((at_s, for_s)) => (positive(at_s)?, Some(positive(for_s)?)),
        None => (positive(when)?, None),
    };
    let parts: Vec<&str> = what.split(':').collect();
    let fault = match (&parts[..], for_s) {
        (["bytes", share], Some(for_s)) => {
            Fault::Bytes { share: positive(share).filter(|share| *share <= 1.0)?, for_s }
        }
        (["loose", electrode], None) => Fault::Loose { electrode: electrode.parse().ok()?, ohm: LOOSE_OHM },
        (["loose", electrode, ohm], None) => Fault::Loose { electrode: electrode.parse().ok()?, ohm: positive(ohm)? },
        (["mend", electrode], None) => Fault::Loose { electrode: electrode.parse().ok()?, ohm: 0.0 },
        (["clock-set", by_s], None) => Fault::ClockSet { by_s: number(by_s)? },
        (["unplug"], Some(for_s)) => Fault::Unplug { for_s },
        (["silent"], Some(for_s)) => Fault::Silent { for_s },
        (["clock-stop"], Some(for_s)) => Fault::ClockStop { for_s },
        (["noise", counts], Some(for_s)) => Fault::Readings { fault: ReadingFault::Noise(positive(counts)?), for_s },
        (_, Some(for_s)) => Fault::Readings { fault: reading_fault(&parts, number)?, for_s },
        _ => return None,
    };
    Some(TimedFault { at_s, fault })
}

fn reading_fault(parts: &[&str], number: impl Fn(&str) -> Option<f64>) -> Option<ReadingFault> {
    Some(match *parts {
        ["source-off"] => ReadingFault::SourceOff,
        ["zeros"] => ReadingFault::Zeros,
        ["full-scale"] => ReadingFault::FullScale,
        ["freeze"] => ReadingFault::Freeze,
        ["references", factor] => ReadingFault::References(number(factor)?),
        ["reference", drive, factor] => ReadingFault::Reference(drive.parse().ok()?, number(factor)?),
        ["gain", factor] => ReadingFault::Gain(number(factor)?),
        ["offset", counts] => ReadingFault::Offset(number(counts)?),
        ["stuck", channel] => ReadingFault::Stuck(channel.parse().ok()?),
        ["saturated", channel] => ReadingFault::Saturated(channel.parse().ok()?),
        _ => return None,
    })
}

impl TimedFault {
    /// Whether a fault with this duration lasts at a time, s.
    pub(super) fn lasts(&self, for_s: f64, time_s: f64) -> bool {
        (self.at_s..self.at_s + for_s).contains(&time_s)
    }
}

/// The random stream of the noise of faults.
const NOISE_STREAM: u64 = 1 << 60;

/// The readings of a frame that a fault changes.
pub(super) struct FaultyReadings<'a> {
    /// The readings, counts.
    pub counts: &'a mut [i32],
    /// Their meaning.
    pub roles: &'a [Role],
    /// The highest count.
    pub full_scale: i32,
    /// Seed and number of the frame, for noise.
    pub seed: u64,
    /// Number of the frame.
    pub index: u64,
}

impl ReadingFault {
    /// Whether the readings of the first frame of the fault are needed.
    pub(super) fn needs_first(&self) -> bool {
        matches!(self, ReadingFault::Freeze | ReadingFault::Stuck(_))
    }

    /// Applies the fault to the readings of a frame; `first`: those of the first frame of the fault.
    pub(super) fn apply(&self, readings: &mut FaultyReadings<'_>, first: &[i32]) {
        let FaultyReadings { counts, roles, full_scale, seed, index } = readings;
        let full = f64::from(*full_scale);
        let clip = |value: f64| value.round().clamp(-full - 1.0, full) as i32;
        let mut rng = sample_rng(*seed, NOISE_STREAM | *index);
        for (slot, (count, role)) in counts.iter_mut().zip(roles.iter()).enumerate() {
            let value = f64::from(*count);
            *count = match (*self, *role) {
                (ReadingFault::Noise(sd), _) => clip(value + sd * standard_normal(&mut rng)),
                (ReadingFault::SourceOff, _) => clip(standard_normal(&mut rng)),
                (ReadingFault::Zeros, _) => 0,
                (ReadingFault::FullScale, _) => *full_scale,
                (ReadingFault::Freeze, _) => first[slot],
                (ReadingFault::References(factor), Role::Current(_)) => clip(factor * value),
                (ReadingFault::Reference(drive, factor), Role::Current(own)) if own == drive => clip(factor * value),
                (ReadingFault::Gain(factor), Role::Channel(_)) => clip(factor * value),
                (ReadingFault::Offset(added), Role::Channel(_)) => clip(value + added),
                (ReadingFault::Stuck(channel), Role::Channel(own)) if own == channel => first[slot],
                (ReadingFault::Saturated(channel), Role::Channel(own)) if own == channel => *full_scale,
                _ => *count,
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_as_they_are_written() {
        let read = |text: &str| text.parse::<TimedFault>().unwrap();
        assert_eq!(read("loose:7@10"), TimedFault { at_s: 10.0, fault: Fault::Loose { electrode: 7, ohm: 1000.0 } });
        assert_eq!(read("loose:7:50@1").fault, Fault::Loose { electrode: 7, ohm: 50.0 });
        assert_eq!(read("mend:7@1.5").fault, Fault::Loose { electrode: 7, ohm: 0.0 });
        assert_eq!(read("bytes:0.01@0+60").fault, Fault::Bytes { share: 0.01, for_s: 60.0 });
        assert_eq!(read("unplug@20+3").fault, Fault::Unplug { for_s: 3.0 });
        assert_eq!(read("clock-set:-5@3").fault, Fault::ClockSet { by_s: -5.0 });
        let of_readings = |fault: ReadingFault| Fault::Readings { fault, for_s: 2.0 };
        assert_eq!(read("zeros@1+2").fault, of_readings(ReadingFault::Zeros));
        assert_eq!(read("reference:3:0.5@1+2").fault, of_readings(ReadingFault::Reference(3, 0.5)));
        for wrong in [
            "",
            "loose@1",
            "bytes:2@0+1",
            "noise:5@1",
            "noise:-5@1+1",
            "noise:1e300@0+1",
            "unplug@nan+1",
            "unplug@1",
            "loose:x@1",
            "loose:1:2:3@1",
            "fire@1",
            "fire@1+2",
            "zeros@1",
            "zeros:2@1+2",
            "gain:nan@1+2",
        ] {
            assert!(wrong.parse::<TimedFault>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_fault_changes_the_readings_that_it_names() {
        let roles = [Role::Current(0), Role::Channel(0), Role::Channel(1), Role::Current(1)];
        let after = |fault: ReadingFault| {
            let mut counts = [100, 200, 300, 400];
            let mut readings =
                FaultyReadings { counts: &mut counts, roles: &roles, full_scale: 1000, seed: 1, index: 5 };
            fault.apply(&mut readings, &[1, 2, 3, 4]);
            counts
        };
        assert_eq!(after(ReadingFault::Zeros), [0; 4]);
        assert_eq!(after(ReadingFault::FullScale), [1000; 4]);
        assert_eq!(after(ReadingFault::Freeze), [1, 2, 3, 4]);
        assert_eq!(after(ReadingFault::References(0.5)), [50, 200, 300, 200]);
        assert_eq!(after(ReadingFault::Reference(1, 0.0)), [100, 200, 300, 0]);
        assert_eq!(after(ReadingFault::Gain(4.0)), [100, 800, 1000, 400]);
        assert_eq!(after(ReadingFault::Offset(-10.0)), [100, 190, 290, 400]);
        assert_eq!(after(ReadingFault::Stuck(1)), [100, 200, 3, 400]);
        assert_eq!(after(ReadingFault::Saturated(0)), [100, 1000, 300, 400]);
        let noisy = after(ReadingFault::Noise(3.0));
        assert!(
            noisy != [100, 200, 300, 400] && noisy.iter().zip([100, 200, 300, 400]).all(|(a, b)| (a - b).abs() < 20)
        );
    }
}
