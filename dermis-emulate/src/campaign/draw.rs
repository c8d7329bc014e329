//! Random faults.

use crate::emulator::{Fault, ReadingFault, TimedFault};
use dermis::design::SkinDesign;
use dermis_sim::random::{log_uniform, sample_rng, uniform};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

/// Interval between two faults, s.
const INTERVAL_S: f64 = 6.0;
/// The first fault, s.
const FIRST_S: f64 = 4.0;
/// Longest and shortest fault, s.
const LENGTHS_S: [f64; 2] = [0.05, 2.5];
/// Part of the faults that two kinds share at once.
const TWO_AT_ONCE: f64 = 0.1;

/// Resistance that is left in series with an electrode after its repair, ohm.
const REPAIRED_OHM: [f64; 2] = [0.01, 2.0];

/// Kinds of faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// A resistance in series with an electrode, 100 ohm to 1 Gohm.
    Loose,
    /// A wrong current of one drive: a factor of 0 to 0.5, or 2.
    Reference,
    /// Wrong currents of all drives.
    References,
    /// The source is off.
    SourceOff,
    /// All readings are zero.
    Zeros,
    /// All readings are at full scale.
    FullScale,
    /// The readings do not change.
    Freeze,
    /// A factor on all voltages.
    Gain,
    /// 20 to 2,000 counts added to all voltages.
    Offset,
    /// Noise of 20 to 2,000 times one count.
    Noise,
    /// A voltage at full scale.
    Saturated,
    /// A voltage that does not change.
    Stuck,
    /// The clock of the device stands still.
    ClockStop,
    /// The clock of the device is set.
    ClockSet,
    /// Two of these at once.
    Two,
    /// No fault: the same presses on a device without faults.
    Control,
}

impl FaultKind {
    const SINGLE: [FaultKind; 14] = [
        FaultKind::Loose,
        FaultKind::Reference,
        FaultKind::References,
        FaultKind::SourceOff,
        FaultKind::Zeros,
        FaultKind::FullScale,
        FaultKind::Freeze,
        FaultKind::Gain,
        FaultKind::Offset,
        FaultKind::Noise,
        FaultKind::Saturated,
        FaultKind::Stuck,
        FaultKind::ClockStop,
        FaultKind::ClockSet,
    ];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            FaultKind::Loose => "loose electrode",
            FaultKind::Reference => "current of a drive",
            FaultKind::References => "currents of all drives",
            FaultKind::SourceOff => "source off",
            FaultKind::Zeros => "all zero",
            FaultKind::FullScale => "all at full scale",
            FaultKind::Freeze => "frozen",
            FaultKind::Gain => "gain",
            FaultKind::Offset => "offset",
            FaultKind::Noise => "noise",
            FaultKind::Saturated => "saturated channel",
            FaultKind::Stuck => "stuck channel",
            FaultKind::ClockStop => "clock stopped",
            FaultKind::ClockSet => "clock set",
            FaultKind::Two => "two at once",
            FaultKind::Control => "no fault",
        }
    }
}

/// A fault of the campaign.
#[derive(Debug, Clone)]
pub(super) struct Drawn {
    pub kind: FaultKind,
    pub begin_s: f64,
    pub end_s: f64,
    /// The faults of the device, two for a loose electrode: it is mended.
    pub faults: Vec<TimedFault>,
}

impl Drawn {
    /// The time without a fault.
    pub(super) fn control() -> Self {
        Drawn { kind: FaultKind::Control, begin_s: FIRST_S, end_s: FIRST_S, faults: Vec::new() }
    }
}

/// Draws the faults of one device, after each other.
pub(super) fn faults(design: &SkinDesign, seed: u64, device: u64, count: usize) -> Vec<Drawn> {
    let mut rng = sample_rng(seed, device);
    let begin_s = |index: usize, part: f64| FIRST_S + INTERVAL_S * (index as f64 + 0.4 * part);
    (0..count).map(|index| draw(design, begin_s(index, rng.random()), &mut rng)).collect()
}

/// The end of the time after the fault with this number, s.
pub(super) fn end_s(index: usize) -> f64 {
    FIRST_S + INTERVAL_S * (index as f64 + 1.0)
}

fn draw(design: &SkinDesign, begin_s: f64, rng: &mut ChaCha8Rng) -> Drawn {
    let length_s = log_uniform(rng, LENGTHS_S);
    let [first, second] = two_kinds(rng);
    let [mut faults, others] = [first, second].map(|kind| of_kind(design, kind, begin_s, length_s, rng));
    let is_double = rng.random_bool(TWO_AT_ONCE);
    if is_double {
        faults.extend(others);
    }
    Drawn { kind: if is_double { FaultKind::Two } else { first }, begin_s, end_s: begin_s + length_s, faults }
}

/// Two kinds. They differ, because two faults of one kind can cancel, or are two loose electrodes.
fn two_kinds(rng: &mut ChaCha8Rng) -> [FaultKind; 2] {
    let count = FaultKind::SINGLE.len();
    let first = rng.random_range(0..count);
    let least = usize::from(FaultKind::SINGLE[first] != FaultKind::Loose);
    let second = (first + rng.random_range(least..count)) % count;
    [FaultKind::SINGLE[first], FaultKind::SINGLE[second]]
}

/// The faults of the device for a kind.
fn of_kind(design: &SkinDesign, kind: FaultKind, at_s: f64, for_s: f64, rng: &mut ChaCha8Rng) -> Vec<TimedFault> {
    let channel = rng.random_range(0..design.protocol.channel_count());
    let drive = rng.random_range(0..design.protocol.drives().0.len());
    let factor = [0.0, 0.1, 0.5, 2.0][rng.random_range(0..4)];
    let readings = |fault: ReadingFault| vec![TimedFault { at_s, fault: Fault::Readings { fault, for_s } }];
    match kind {
        FaultKind::Loose => {
            let electrode = rng.random_range(0..design.electrodes.len());
            let ohm = log_uniform(rng, [100.0, 1e9]);
            let repaired = Fault::Loose { electrode, ohm: log_uniform(rng, REPAIRED_OHM) };
            vec![
                TimedFault { at_s, fault: Fault::Loose { electrode, ohm } },
                TimedFault { at_s: at_s + for_s, fault: repaired },
            ]
        }
        FaultKind::Reference => readings(ReadingFault::Reference(drive, factor)),
        FaultKind::References => readings(ReadingFault::References(factor)),
        FaultKind::SourceOff => readings(ReadingFault::SourceOff),
        FaultKind::Zeros => readings(ReadingFault::Zeros),
        FaultKind::FullScale => readings(ReadingFault::FullScale),
        FaultKind::Freeze => readings(ReadingFault::Freeze),
        FaultKind::Gain => readings(ReadingFault::Gain(if factor == 0.1 { 4.0 } else { factor })),
        FaultKind::Offset => readings(ReadingFault::Offset(log_uniform(rng, [20.0, 2000.0]))),
        FaultKind::Noise => readings(ReadingFault::Noise(log_uniform(rng, [20.0, 2000.0]))),
        FaultKind::Saturated => readings(ReadingFault::Saturated(channel)),
        FaultKind::Stuck => readings(ReadingFault::Stuck(channel)),
        FaultKind::ClockStop => vec![TimedFault { at_s, fault: Fault::ClockStop { for_s } }],
        FaultKind::ClockSet => vec![TimedFault { at_s, fault: Fault::ClockSet { by_s: uniform(rng, [-20.0, 20.0]) } }],
        // They have no fault of their own.
        FaultKind::Two | FaultKind::Control => Vec::new(),
    }
}
