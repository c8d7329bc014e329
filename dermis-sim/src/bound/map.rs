//! The bounds over a whole skin.

use super::detection::FORCES_N;
use super::{BoundError, BoundOptions, Bounds};
use crate::twin::TwinOptions;
use dermis::design::SkinDesign;
use dermis::geom::Point3;
use dermis::image::PixelSpace;
use dermis::skin::Skin;
use dermis::stats::{mean, quantile, sorted};
use rayon::prelude::*;
use serde::Serialize;
use std::io::Write;

/// Time over which the frames of the second map are averaged, s.
const LONG_S: f64 = 0.1;

/// What is computed over a skin.
#[derive(Debug, Clone, PartialEq)]
pub struct MapOptions {
    /// Press, drift and what is known of the patches. The numbers of frames are those of the maps.
    pub bound: BoundOptions,
    /// Electrodes whose values are left out, as if they were disconnected.
    pub without_electrodes: Vec<usize>,
    /// The separation of two presses is computed at every n-th pixel; 0: nowhere.
    pub separation_step: usize,
}

impl Default for MapOptions {
    /// All electrodes, and the separation at every 29th pixel.
    fn default() -> Self {
        MapOptions { bound: BoundOptions::default(), without_electrodes: Vec::new(), separation_step: 29 }
    }
}

/// The bounds at a place; none where the skin allows none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PlaceBounds {
    /// The centre of a pixel, m.
    pub position_m: Point3,
    /// Standard deviation of the position, m.
    pub sd_m: Option<f64>,
    /// Standard deviation of the force, N.
    pub force_sd_n: Option<f64>,
    /// Smallest force that is found in 90 % of the frames, N.
    pub smallest_force_n: Option<f64>,
    /// Smallest distance at which two presses are told from one in 90 % of the cases, m; none where it is not computed.
    pub separation_m: Option<f64>,
}

/// Statistics of a bound over the places that have it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// The median.
    pub median: f64,
    /// The 95th percentile.
    pub p95: f64,
    /// The largest.
    pub largest: f64,
    /// Number of places with a value.
    pub places: usize,
}

impl Spread {
    fn of(places: &[PlaceBounds], value: fn(&PlaceBounds) -> Option<f64>) -> Option<Self> {
        let values = sorted(places.iter().filter_map(value));
        let largest = *values.last()?;
        let (median, p95) = (quantile(&values, 0.5), quantile(&values, 0.95));
        Some(Spread { mean: mean(&values), median, p95, largest, places: values.len() })
    }
}

/// The bounds at every pixel for the mean of some frames; a statistic is none where no place has the bound.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BoundMap {
    /// Number of frames.
    pub frames: usize,
    /// Standard deviation of the position, m.
    pub sd_m: Option<Spread>,
    /// Standard deviation of the force, N.
    pub force_sd_n: Option<Spread>,
    /// Smallest force, N.
    pub smallest_force_n: Option<Spread>,
    /// Separation of two presses, m.
    pub separation_m: Option<Spread>,
    /// The bounds of each pixel.
    pub places: Vec<PlaceBounds>,
}

impl BoundMap {
    fn of(frames: usize, places: Vec<PlaceBounds>) -> Self {
        BoundMap {
            frames,
            sd_m: Spread::of(&places, |place| place.sd_m),
            force_sd_n: Spread::of(&places, |place| place.force_sd_n),
            smallest_force_n: Spread::of(&places, |place| place.smallest_force_n),
            separation_m: Spread::of(&places, |place| place.separation_m),
            places,
        }
    }

    /// Writes a row for each place (CSV): its position, m, and its bounds, empty where it has none.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write_csv(&self, out: &mut dyn Write) -> std::io::Result<()> {
        writeln!(out, "x_m,y_m,z_m,sd_m,force_sd_n,smallest_force_n,separation_m")?;
        let text = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
        self.places.iter().try_for_each(|place| {
            let [x, y, z] = place.position_m;
            let values = [place.sd_m, place.force_sd_n, place.smallest_force_n, place.separation_m].map(text);
            writeln!(out, "{x},{y},{z},{}", values.join(","))
        })
    }
}

/// The bounds at a pixel for one frame and for the mean of several, which share all changes of the frame.
fn place(
    bounds: &[Bounds; 2],
    pixels: &PixelSpace,
    pixel: usize,
    separation_step: usize,
) -> crate::Result<[PlaceBounds; 2]> {
    let (position_m, normal) = (pixels.centres_m[pixel], pixels.normals[pixel]);
    let press = bounds[0].press(position_m);
    let response = bounds[0].response(&press, normal)?;
    let is_separated = bounds[0].has_chart() && separation_step > 0 && pixel.is_multiple_of(separation_step);
    // What is enough for one frame is enough for the mean of several.
    let (mut enough_m, mut enough_n) = ([None; 2], FORCES_N[1]);
    let mut of = |bounds: &Bounds| -> crate::Result<PlaceBounds> {
        let position = bounds.position_from(&press, &response);
        let mut separation_m = None;
        if is_separated {
            let found = bounds.separations_m(position_m, enough_m)?;
            separation_m = found[0].zip(found[1]).map(|(first, second)| first.max(second));
            enough_m = found;
        }
        let smallest_force_n = bounds.smallest_force_up_to(position_m, pixels.len(), enough_n)?;
        enough_n = smallest_force_n.unwrap_or(enough_n);
        Ok(PlaceBounds {
            position_m,
            sd_m: position.map(|bound| bound.sd_m),
            force_sd_n: position.map(|bound| bound.force_sd_n),
            smallest_force_n,
            separation_m,
        })
    };
    Ok([of(&bounds[0])?, of(&bounds[1])?])
}

/// The bounds of a skin.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SkinBounds {
    /// Name of the design.
    pub design: String,
    /// Name of the twin.
    pub twin: String,
    /// Electrodes whose values are left out.
    pub without_electrodes: Vec<usize>,
    /// For one frame, and for the mean of the frames of 0.1 s.
    pub bounds: [BoundMap; 2],
}

/// The bounds at every pixel of a skin, for one frame and for the mean of the frames of 0.1 s. `step` is called for each
/// pixel, from several threads.
///
/// ```no_run
/// use dermis::skin::Skin;
/// use dermis_sim::bound::{MapOptions, map_bounds};
/// use dermis_sim::twin::TwinOptions;
///
/// let skin = Skin::load("cylinder30")?;
/// let found = map_bounds(&skin, &TwinOptions::shipped("lab").unwrap(), &MapOptions::default(), || ())?;
/// let [one, averaged] = found.bounds.map(|map| map.sd_m.expect("places have bounds").median);
/// assert!(averaged < one);
/// # Ok::<(), dermis_sim::Error>(())
/// ```
///
/// # Errors
/// As [`Bounds::new`]; electrodes that do not exist; values that do not tell the place of a press anywhere.
pub fn map_bounds(
    skin: &Skin,
    twin: &TwinOptions,
    options: &MapOptions,
    step: impl Fn() + Sync,
) -> crate::Result<SkinBounds> {
    let design = without_electrodes(skin.design(), &options.without_electrodes)?;
    let one = Bounds::new(&design, twin, &BoundOptions { frames: 1, ..options.bound })?;
    let long = ((LONG_S * twin.electronics.frame_rate_hz).round() as usize).max(1);
    let averaged = one.averaged(long)?;
    let bounds = [one, averaged];
    let at = |pixel: usize| {
        let places = place(&bounds, skin.pixels(), pixel, options.separation_step);
        step();
        places
    };
    let places: Vec<[PlaceBounds; 2]> =
        (0..skin.pixels().len()).into_par_iter().map(at).collect::<crate::Result<_>>()?;
    let map =
        |which: usize| BoundMap::of(bounds[which].options.frames, places.iter().map(|both| both[which]).collect());
    let (one, averaged) = (map(0), map(1));
    if one.sd_m.is_none() {
        return Err(BoundError::NoPlace { values: design.protocol.channel_count() }.into());
    }
    let (design, twin) = (design.name, twin.name.clone());
    Ok(SkinBounds { design, twin, without_electrodes: options.without_electrodes.clone(), bounds: [one, averaged] })
}

/// A design without the values of some electrodes.
fn without_electrodes(design: &SkinDesign, left_out: &[usize]) -> Result<SkinDesign, BoundError> {
    let (count, mut design) = (design.electrodes.len(), design.clone());
    if let Some(&electrode) = left_out.iter().find(|electrode| **electrode >= count) {
        return Err(BoundError::NoElectrode { electrode, design: design.name, count });
    }
    design.protocol = design.protocol.without_electrodes(left_out).map_err(|_| BoundError::NoValue)?;
    Ok(design)
}
