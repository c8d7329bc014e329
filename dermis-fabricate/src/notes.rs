//! What the builder must know beyond the files.

use crate::grooves::{Groove, grooves};
use crate::model::Fabrication;
use dermis::design::TouchEffect;
use dermis::text::decimal;

/// Notes about a fabrication: bores that are not at their electrode, and why; channels that overlap; strain of the patches;
/// a coat that gets none.
pub fn notes(fabrication: &Fabrication) -> Vec<String> {
    let mut notes: Vec<String> = moved_bores(fabrication).into_iter().collect();
    notes.extend(overlapping_channels(fabrication));
    notes.extend([strain(fabrication), without_patches(fabrication)].into_iter().flatten());
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
        "the coat conducts less where it is pressed (`touch = \"conductance_falls\"`): it gets no fabric patches, and their \
         files are not used"
            .into()
    })
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
