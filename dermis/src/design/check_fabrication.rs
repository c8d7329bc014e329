//! Checks that a workshop can make a design: wall, bores, channels, flange, patches.

use crate::design::check::{Problem, millimetres, problem};
use crate::design::fabrication::closest_bores;
use crate::design::resolve::Place;
use crate::design::{Body, FabricationOptions, SheetKind, SkinDesign};
use crate::geom::beyond_a_turn;
use crate::protocol::MultiplexerInput;

/// Largest wall, bore, channel, flange, pitch, foam, kerf or overlap, m: larger ones are in another unit than metres.
const LARGEST_M: f64 = 1.0;
/// Smallest wall, bore, channel and pitch, m: no printer makes a thinner wall, no cutter a smaller patch.
const SMALLEST_M: f64 = 2e-4;
/// Inputs on a line: as many as a scan table can name.
const MAX_INPUTS: usize = 0xFFFF;
/// Maximum number of patches: a thousand times those of the paper's skin.
const MAX_PATCHES: f64 = 1e6;
/// Largest spread of resistances: three of it are less than the resistance itself.
const LARGEST_SPREAD: f64 = 0.33;

fn wrong(key: &'static str, message: impl Into<String>) -> Problem {
    problem(Place::Fabrication(Some(key)), message)
}

/// All checks that need no mesh.
pub(super) fn fabrication(design: &SkinDesign) -> Result<(), Problem> {
    let options = design.fabrication_options();
    if design.sheet.kind == SheetKind::Volume {
        let message = "a conductor that fills the body has no coat, and so no base, patches or foam";
        return Err(problem(Place::Fabrication(None), message).fix("give the sheet `sheet_resistance_ohm`"));
    }
    sizes(&options)?;
    wall(&design.body, &options)?;
    flange(&design.body, &options)?;
    bores(design, &options)?;
    seam(&design.body, &options)?;
    multiplexers(design)?;
    patches(&design.body, &options)
}

fn sizes(options: &FabricationOptions) -> Result<(), Problem> {
    let from = [
        ("wall_m", options.wall_m, SMALLEST_M),
        ("bore_m", options.bore_m, SMALLEST_M),
        ("channel_width_m", options.channel_width_m, SMALLEST_M),
        ("channel_depth_m", options.channel_depth_m, 0.0),
        ("flange_m", options.flange_m, 0.0),
        ("patch_pitch_m", options.patch_pitch_m, SMALLEST_M),
        ("patch_gap_m", options.patch_gap_m, 0.0),
        ("foam_thickness_m", options.foam_thickness_m, 0.0),
        ("kerf_m", options.kerf_m, 0.0),
        ("overlap_m", options.overlap_m, 0.0),
    ];
    for (key, value, least) in from {
        if !(least..=LARGEST_M).contains(&value) {
            let message = format!("{key} is {value} m: it must be between {least} and {LARGEST_M} m");
            return Err(wrong(key, message).fix("lengths are in metres"));
        }
    }
    for (key, value) in [("sheet_spread", options.sheet_spread), ("contact_spread", options.contact_spread)] {
        if !(0.0..=LARGEST_SPREAD).contains(&value) {
            let message = format!("{key} is {value}: it must be between 0 and {LARGEST_SPREAD}");
            return Err(wrong(key, message).fix("a spread is relative: 0.2 is 20 %"));
        }
    }
    if let Some(message) = beyond_a_turn("seam_theta_rad", options.seam_theta_rad) {
        return Err(wrong("seam_theta_rad", message));
    }
    Ok(())
}

fn wall(body: &Body, options: &FabricationOptions) -> Result<(), Problem> {
    let FabricationOptions { wall_m, bore_m, channel_depth_m, .. } = *options;
    if wall_m < bore_m {
        let message =
            format!("the wall ({} mm) is thinner than a bore ({} mm)", millimetres(wall_m), millimetres(bore_m));
        return Err(wrong("wall_m", message).fix("a pin then stands askew: make the wall thicker or the bores smaller"));
    }
    let least_m = FabricationOptions::MIN_LAND_M;
    if channel_depth_m > 0.0 && wall_m - channel_depth_m < least_m {
        let message = format!(
            "channels {} mm deep leave {} mm of the wall",
            millimetres(channel_depth_m),
            millimetres(wall_m - channel_depth_m)
        );
        return Err(wrong("channel_depth_m", message).fix(format!("leave {} mm or more", millimetres(least_m))));
    }
    match *body {
        Body::Cylinder { diameter_m, .. } if wall_m + least_m > 0.5 * diameter_m => {
            let message = format!(
                "a wall of {} mm fills a cylinder of {} mm diameter",
                millimetres(wall_m),
                millimetres(diameter_m)
            );
            Err(wrong("wall_m", message).fix("wires need room inside: make the wall thinner"))
        }
        _ => Ok(()),
    }
}

fn flange(body: &Body, options: &FabricationOptions) -> Result<(), Problem> {
    let FabricationOptions { flange_m, .. } = *options;
    if flange_m == 0.0 {
        return Ok(());
    }
    if matches!(body, Body::Mesh { .. }) {
        let message = "a body from a mesh file gets no flange";
        return Err(wrong("flange_m", message).fix("model it in the file, or leave `flange_m` out"));
    }
    if flange_m < options.edge_m() {
        let message = format!(
            "a flange of {} mm is too short for bores on the edge, which need {} mm",
            millimetres(flange_m),
            millimetres(options.edge_m())
        );
        return Err(wrong("flange_m", message).fix("make it longer, or 0: bores on the edge then move inward"));
    }
    Ok(())
}

fn seam(body: &Body, options: &FabricationOptions) -> Result<(), Problem> {
    if body.chart().is_some_and(|chart| chart.period_m().is_some()) {
        return Ok(());
    }
    for (key, value) in [("seam_theta_rad", options.seam_theta_rad), ("overlap_m", options.overlap_m)] {
        if value != 0.0 {
            let message =
                format!("`{key}` is {value}, but the patterns of this body have no seam: a cylinder's have one");
            return Err(wrong(key, message).fix(format!("leave `{key}` out")));
        }
    }
    Ok(())
}

/// Bores that meet, or that leave hardly anything between them, at the surface or at the inner face of the wall.
fn bores(design: &SkinDesign, options: &FabricationOptions) -> Result<(), Problem> {
    let Some(bores) = design.bores() else { return Ok(()) };
    let Some((i, j, land_m)) = closest_bores(&bores, options) else { return Ok(()) };
    match land_m < FabricationOptions::MIN_LAND_M {
        true => {
            Err(wrong("bore_m", bores_meet(i, j, land_m)).fix("make the bores smaller or move the electrodes apart"))
        }
        false => Ok(()),
    }
}

/// What is wrong with two bores that are too close.
pub fn bores_meet(i: usize, j: usize, land_m: f64) -> String {
    if land_m <= 0.0 {
        return format!("the bores of electrodes {i} and {j} meet: they overlap by {} mm", millimetres(-land_m));
    }
    format!(
        "the bores of electrodes {i} and {j} nearly meet: {} mm are left between them, and the least is {} mm",
        millimetres(land_m),
        millimetres(FabricationOptions::MIN_LAND_M)
    )
}

/// Electrodes without an input of the multiplexers, and inputs with two. Every reader of a design checks this: the firmware
/// that scans a skin has its inputs too.
pub(super) fn multiplexers(design: &SkinDesign) -> Result<(), Problem> {
    let Some(options) = &design.fabrication else { return Ok(()) };
    let (count, per_one) = (design.electrodes.len(), MultiplexerInput::PER_MULTIPLEXER);
    if let Some(given) = options.inputs.as_ref().map(Vec::len).filter(|given| *given != count) {
        let message = format!("{given} inputs for {count} electrodes");
        return Err(wrong("inputs", message).fix("give one for each electrode, in the order of their numbers"));
    }
    let largest = MAX_INPUTS / per_one;
    if let Some(given) = options.multiplexers.filter(|given| *given > largest) {
        let message = format!("{given} multiplexers on a line: the firmware's table has room for {largest}");
        return Err(wrong("multiplexers", message).fix("leave `multiplexers` out: it is then as many as needed"));
    }
    let most = options.multiplexers.map_or(usize::MAX, |multiplexers| multiplexers * per_one);
    if count >= most {
        let message = format!(
            "{count} electrodes are more than {} free inputs of {most}: the reference resistor takes one",
            most.saturating_sub(1)
        );
        return Err(wrong("multiplexers", message).fix("give more multiplexers, or leave `multiplexers` out"));
    }
    let mut electrode_at = std::collections::HashMap::new();
    for (electrode, place) in design.multiplexer_inputs().into_iter().enumerate() {
        let number = place.number();
        let message = match electrode_at.insert(number, electrode) {
            Some(other) => format!("electrodes {other} and {electrode} are both on input {number}"),
            None if place == MultiplexerInput::REFERENCE => {
                format!("electrode {electrode} is on input {number}, which the reference resistor takes")
            }
            None if number >= most.min(MAX_INPUTS) => {
                format!("electrode {electrode} is on input {number}, but the last is {}", most.min(MAX_INPUTS) - 1)
            }
            None => continue,
        };
        return Err(wrong("inputs", message).fix("give each electrode an input of its own"));
    }
    Ok(())
}

fn patches(body: &Body, options: &FabricationOptions) -> Result<(), Problem> {
    let FabricationOptions { patch_pitch_m, patch_gap_m, kerf_m, .. } = *options;
    if patch_gap_m >= patch_pitch_m {
        let message = format!(
            "with gaps of {} mm nothing is left of patches {} mm apart",
            millimetres(patch_gap_m),
            millimetres(patch_pitch_m)
        );
        return Err(wrong("patch_gap_m", message).fix("make the gaps narrower than the pitch"));
    }
    if kerf_m > patch_gap_m {
        let message = format!(
            "a cut of {} mm is wider than the gaps of {} mm between patches",
            millimetres(kerf_m),
            millimetres(patch_gap_m)
        );
        return Err(wrong("kerf_m", message).fix("make the gaps at least as wide as the cut"));
    }
    let Some(sides_m) = body.chart().map(|chart| chart.size_m()) else { return Ok(()) };
    let least_m = sides_m[0].min(sides_m[1]);
    if patch_pitch_m > least_m {
        let message = format!(
            "patches {} mm apart do not fit on a body of {} mm",
            millimetres(patch_pitch_m),
            millimetres(least_m)
        );
        return Err(wrong("patch_pitch_m", message).fix("make the pitch smaller"));
    }
    let count = sides_m.iter().map(|side_m| (side_m / patch_pitch_m).round()).product::<f64>();
    if count > MAX_PATCHES {
        let message = format!("{count:.0} patches are too many: a skin has at most {MAX_PATCHES:.0}");
        return Err(wrong("patch_pitch_m", message).fix("make the pitch larger"));
    }
    Ok(())
}
