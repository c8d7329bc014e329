//! What the builder must know beyond the files.

use crate::model::Fabrication;

/// Notes about a fabrication: bores that are not at their electrode, and why; strain of the patches.
pub fn notes(fabrication: &Fabrication) -> Vec<String> {
    [moved_bores(fabrication), strain(fabrication)].into_iter().flatten().collect()
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
