//! The range of the converter: which channels can exceed it, and the reference resistor with which few do.
//!
//! A reading without a driven electrode is amplified most: a channel beside the drive can be too large for it. Such a
//! reading is out of range, and its channel is masked. A larger reference resistor lowers the current of every drive, and
//! with it all readings.

use crate::electrical::model::SkinSensitivities;
use crate::electrical::reader::{REFERENCE_TOLERANCE, USUAL_REFERENCE_OHM};
use crate::electrical::spread::Value;
use dermis::design::{FabricationOptions, SkinDesign};
use dermis_sim::twin::electronics::ElectronicsOptions;

/// Reference resistors, ohm: the first is that of `reader.toml`, the others are the next ones of the series E6. Beyond the
/// last the bias resistors, which take 0.25 uA, would take more of the current (below 0.3 mA) than its tolerance of 0.1 %.
const REFERENCES_OHM: [f64; 7] = [USUAL_REFERENCE_OHM, 1500.0, 2200.0, 3300.0, 4700.0, 6800.0, 10_000.0];
/// Share of the channels that may exceed the range: one in fifty is missed less than the signal that a larger resistor takes
/// from all of them.
const MAX_SHARE: f64 = 0.02;

/// The channels of a skin against the range of its reader.
#[derive(Debug, Clone, PartialEq)]
pub struct Range {
    /// The largest voltage of a reading without a driven electrode, V.
    pub(crate) limit_v: f64,
    /// Channels whose limits exceed the range, ascending.
    pub beyond: Vec<usize>,
    /// The same with the reference resistor of `reader.toml`.
    pub(crate) usual: Reference,
    /// The smallest reference resistor with which no channel exceeds the range; `None` if there is none.
    pub(crate) without: Option<Reference>,
}

/// A reference resistor that was tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reference {
    /// Its resistance, ohm.
    pub(crate) ohm: f64,
    /// How many channels can exceed the range with it.
    pub(crate) beyond_count: usize,
    /// The mean current of the drives over that with the chosen resistor.
    pub(crate) current: f64,
}

/// What a skin reads with a reference resistor.
struct Candidate {
    electronics: ElectronicsOptions,
    beyond: Vec<usize>,
    current_a: f64,
}

/// The electronics with the smallest reference resistor with which few channels exceed the range, and what they read. If
/// more do with each, with the largest one.
pub(super) fn fitted(
    design: &SkinDesign,
    skin: &SkinSensitivities,
    electronics: ElectronicsOptions,
) -> (ElectronicsOptions, Option<Range>) {
    let Some(adc) = electronics.adc else { return (electronics, None) };
    let candidates = REFERENCES_OHM
        .map(|reference_ohm| Candidate::of(design, skin, ElectronicsOptions { reference_ohm, ..electronics.clone() }));
    let allowed = (MAX_SHARE * design.protocol.channel_count() as f64) as usize;
    let largest = candidates.len() - 1;
    let chosen = &candidates[candidates.iter().position(|one| one.beyond.len() <= allowed).unwrap_or(largest)];
    let reference = |one: &Candidate| Reference {
        ohm: one.electronics.reference_ohm,
        beyond_count: one.beyond.len(),
        current: one.current_a / chosen.current_a,
    };
    let range = Range {
        limit_v: adc.range_v / adc.gain,
        beyond: chosen.beyond.clone(),
        usual: reference(&candidates[0]),
        without: candidates.iter().find(|one| one.beyond.is_empty()).map(reference),
    };
    (chosen.electronics.clone(), Some(range))
}

impl Candidate {
    fn of(design: &SkinDesign, skin: &SkinSensitivities, electronics: ElectronicsOptions) -> Self {
        let options = design.fabrication_options();
        let volts = skin.volts(&design.protocol, &electronics, &options);
        let channels = volts.iter().zip(design.protocol.channels()).enumerate();
        let beyond = channels.filter(|(_, (volt, channel))| exceeds(volt, channel.touches_driven(), &electronics));
        Candidate {
            beyond: beyond.map(|(channel, _)| channel).collect(),
            current_a: mean_current_a(skin, &electronics, &options),
            electronics,
        }
    }
}

fn mean_current_a(skin: &SkinSensitivities, electronics: &ElectronicsOptions, options: &FabricationOptions) -> f64 {
    let current_a = |of: &crate::electrical::Sensitivities| {
        of.in_loop(electronics).reference(options, REFERENCE_TOLERANCE).nominal / electronics.reference_ohm
    };
    skin.drives.iter().map(current_a).sum::<f64>() / skin.drives.len() as f64
}

/// Whether a voltage can be outside the range with the gain that its reading has.
fn exceeds(volt: &Value, is_driven: bool, electronics: &ElectronicsOptions) -> bool {
    electronics.adc.is_some_and(|adc| {
        let gain = if is_driven { adc.gain_driven } else { adc.gain };
        volt.limits().iter().any(|limit| limit.abs() > adc.range_v / gain)
    })
}

#[cfg(test)]
mod tests {
    use crate::electrical::Electrical;
    use dermis::design::SkinDesign;
    use dermis_sim::twin::electronics::ElectronicsOptions;

    const RECTANGLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../dermis-cli/src/command/new/rectangle.toml");
    const FOREARM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../dermis/designs/forearm.toml");

    fn electrical(design: &str) -> Electrical {
        Electrical::new(&SkinDesign::load(design).unwrap(), &[]).unwrap()
    }

    /// Slots without a driven electrode whose limits exceed half a volt, counted in the readings as they are written.
    fn counted(electrical: &Electrical) -> Vec<usize> {
        let beyond = |reading: &crate::electrical::Reading| {
            let (inputs, channel) = reading.slot.measure?;
            let is_free = !inputs.iter().any(|input| reading.slot.drive.contains(input));
            let exceeds = reading.volt.limits().iter().any(|limit| limit.abs() > 0.5);
            (is_free && exceeds).then_some(channel)
        };
        electrical.readings.iter().filter_map(beyond).collect()
    }

    /// A few channels of the paper's skin are left out, and the resistor of `reader.toml` stays; of the rectangle nearly a
    /// quarter would be, so it gets a larger one.
    #[test]
    fn the_reference_resistor_is_the_smallest_with_which_few_channels_exceed_the_range() {
        let skins = [
            ("cylinder30", 3, 1000.0, 3),
            ("skin16", 0, 1000.0, 0),
            (RECTANGLE, 92, 10_000.0, 4),
            (FOREARM, 5, 1000.0, 5),
        ];
        for (design, usual, chosen_ohm, left) in skins {
            let electrical = electrical(design);
            let range = electrical.range.as_ref().unwrap();
            let ElectronicsOptions { reference_ohm, .. } = electrical.electronics;
            println!(
                "{design}: {} channels can exceed the range with 1 kohm, {} with {reference_ohm} ohm and {:.2} of the current; \
                 none with {:?}",
                range.usual.beyond_count,
                range.beyond.len(),
                1.0 / range.usual.current,
                range.without.map(|one| one.ohm)
            );
            assert_eq!(range.beyond, counted(&electrical), "{design}");
            assert_eq!(
                (range.usual.beyond_count, reference_ohm, range.beyond.len()),
                (usual, chosen_ohm, left),
                "{design}"
            );
        }
    }

    /// The stated resistor is enough, and the next smaller one is not; the current falls as the loops say.
    #[test]
    fn the_resistor_that_brings_all_below_the_range_is_stated() {
        let range = electrical("cylinder30").range.unwrap();
        let without = range.without.unwrap();
        assert_eq!((range.beyond.as_slice(), without.ohm), ([289, 434, 579].as_slice(), 3300.0));
        // Loops are 1.87 to 3.56 kohm with 1 kohm, and 2.3 kohm more with the other.
        assert!((1.87 / 4.17..3.56 / 5.86).contains(&without.current), "{without:?}");
        assert_eq!(range.usual.current, 1.0);
    }
}
