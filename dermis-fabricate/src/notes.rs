//! What the builder must know beyond the files.

use crate::electrical::{Electrical, Range};
use crate::grooves::{Groove, grooves};
use crate::model::Fabrication;
use dermis::design::TouchEffect;
use dermis::text::decimal;

/// Notes about a fabrication: bores that are not at their electrode, and why; channels that overlap; strain of the patches;
/// a coat that gets none; channels that exceed the range of the reader.
pub fn notes(fabrication: &Fabrication) -> Vec<String> {
    let mut notes: Vec<String> = moved_bores(fabrication).into_iter().collect();
    notes.extend(overlapping_channels(fabrication));
    notes.extend([strain(fabrication), without_patches(fabrication)].into_iter().flatten());
    // A design without an electrical model has no tables and no guide either, and their error is reported.
    if let Some((electrical, range)) = fabrication.electrical().ok().and_then(|one| Some((one, one.range.as_ref()?))) {
        notes.extend(larger_reference(fabrication, electrical, range));
        notes.extend(beyond_range(fabrication, electrical, range));
    }
    notes
}

fn overlapping_channels(fabrication: &Fabrication) -> Vec<String> {
    let Some(chart) = &fabrication.chart else { return Vec::new() };
    let note = |groove: Groove| {
        let apart_m = groove.overlapping_m?;
        let labels: Vec<&str> =
            groove.electrodes.iter().map(|&number| fabrication.electrodes[number].label.as_str()).collect();
        Some(format!(
            "the channels of {} overlap and are one groove: `channel_width_m` below {} keeps them apart",
            labels.join(", "),
            decimal(apart_m, 5)
        ))
    };
    grooves(fabrication, chart, 0.0).into_iter().filter_map(note).collect()
}

fn without_patches(fabrication: &Fabrication) -> Option<String> {
    (fabrication.design.sheet.touch == TouchEffect::ConductanceFalls).then(|| {
        "the coat conducts less where it is pressed (`touch = \"conductance_falls\"`): it lies on a membrane that stretches \
         over foam, not on the base; it gets no fabric patches, and their files are not used"
            .into()
    })
}

/// A reference resistor other than that of `reader.toml`: why, and what it costs.
fn larger_reference(fabrication: &Fabrication, electrical: &Electrical, range: &Range) -> Option<String> {
    let (reference_ohm, usual) = (electrical.electronics.reference_ohm, range.usual);
    (reference_ohm != usual.ohm).then(|| {
        format!(
            "with a reference resistor of {} kohm, that of `reader.toml`, {} of the {} channels could exceed the range of \
             {} V: this skin gets {} kohm, which leaves {:.0} % of the current and of all voltages; `guide.html` has the \
             firmware's command for it",
            decimal(1e-3 * usual.ohm, 1),
            usual.beyond_count,
            fabrication.design.protocol.channel_count(),
            decimal(range.limit_v, 3),
            decimal(1e-3 * reference_ohm, 1),
            100.0 / usual.current
        )
    })
}

/// Channels that can exceed the range of the reader, and what to do.
fn beyond_range(fabrication: &Fabrication, electrical: &Electrical, range: &Range) -> Option<String> {
    let protocol = &fabrication.design.protocol;
    let adc = electrical.electronics.adc?;
    let larger = range.without.map_or(String::new(), |one| {
        format!(
            "a reference resistor of {} kohm (`reference_ohm`), which leaves {:.0} % of the current and of all voltages, or ",
            decimal(1e-3 * one.ohm, 1),
            100.0 * one.current
        )
    });
    (!range.beyond.is_empty()).then(|| {
        format!(
            "{} of the {} channels can exceed the range of {} V, which readings without a driven electrode have with gain \
             {}; out of range they are masked: {}. To read them, too: {larger}gain 1 for all readings, with steps that are \
             {} times as large (`gain = 1.0` in `reader.toml`; in the firmware's `boards/pico/src/reader.rs` \
             `Gain::Free => 0b00`)",
            range.beyond.len(),
            protocol.channel_count(),
            decimal(range.limit_v, 3),
            adc.gain,
            channels_by_drive(fabrication, &range.beyond),
            adc.gain
        )
    })
}

/// Channels with the electrodes that they read: `E00 to E01 driven: 3 (E04 - E05)`.
fn channels_by_drive(fabrication: &Fabrication, channels: &[usize]) -> String {
    let all = fabrication.design.protocol.channels();
    let label = |electrode: usize| fabrication.electrodes[electrode].label.as_str();
    let drive = |own: &[usize]| {
        let [source, sink] = all[own[0]].drive.map(label);
        let read = own.iter().map(|&channel| {
            let [plus, minus] = all[channel].measure.map(label);
            format!("{channel} ({plus} - {minus})")
        });
        format!("{source} to {sink} driven: {}", read.collect::<Vec<_>>().join(", "))
    };
    channels.chunk_by(|&a, &b| all[a].drive == all[b].drive).map(drive).collect::<Vec<_>>().join("; ")
}

fn moved_bores(fabrication: &Fabrication) -> Option<String> {
    let moved = fabrication.electrodes.iter().filter(|electrode| electrode.bore.moved_m > 1e-9);
    let moved: Vec<(&str, f64)> = moved.map(|one| (one.label.as_str(), 1e3 * one.bore.moved_m)).collect();
    let most_mm = moved.iter().map(|(_, by_mm)| *by_mm).fold(0.0, f64::max);
    let labels: Vec<&str> = moved.iter().map(|(label, _)| *label).collect();
    (!moved.is_empty()).then(|| {
        format!(
            "the bores of {} are up to {most_mm:.2} mm inside their electrodes, which lie on or near the edge: join \
             them with silver paste, or give the base a flange (`flange_m = {}`)",
            labels.join(", "),
            fabrication.options.edge_m()
        )
    })
}

fn strain(fabrication: &Fabrication) -> Option<String> {
    fabrication.body_mesh.as_ref()?;
    let of = |pick: fn(f64, f64) -> f64, start: f64| fabrication.patches.iter().map(|one| one.strain).fold(start, pick);
    Some(format!(
        "the body does not unroll: its {} patches are round and cut one by one; laid on, their edges change by {:.2} to \
         {:.2} %",
        fabrication.patches.len(),
        100.0 * of(f64::min, f64::INFINITY),
        100.0 * of(f64::max, f64::NEG_INFINITY)
    ))
}
