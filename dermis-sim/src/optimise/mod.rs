//! Better designs: where the electrodes go, and which values are read.
//!
//! A fast model of the bound of a press's position ([`bound`](crate::bound)) is searched by simulated annealing from many
//! starts: the fields of currents from candidate places are computed once, and a layout's readings of a weak press follow
//! from them. `docs/optimise.md` has the formulas. What comes out is a design file, to be judged by the exact bounds.
//!
//! ```no_run
//! use dermis::design::SkinDesign;
//! use dermis_sim::optimise::{OptimiseOptions, Optimiser, design_text};
//! use dermis_sim::twin::TwinOptions;
//!
//! let text = SkinDesign::shipped_text("cylinder30").unwrap();
//! let options = OptimiseOptions { electrode_count: 20, ..OptimiseOptions::default() };
//! let optimiser = Optimiser::new(text, "cylinder30", &TwinOptions::shipped("lab").unwrap(), &options)?;
//! let starts = [optimiser.start(0)?, optimiser.start(1)?];
//! let best = if starts[0].objective_m < starts[1].objective_m { &starts[0] } else { &starts[1] };
//! println!("{}", design_text(text, "cylinder30", "better20", &best.electrodes_m, None).unwrap());
//! # Ok::<(), dermis_sim::Error>(())
//! ```

mod error;
mod fields;
mod information;
mod layout;
mod local;
mod pattern;
mod places;
mod search;
#[cfg(test)]
mod tests;
mod text;
mod touch;

pub use error::OptimiseError;
pub use places::{PlaceRules, Zone};
pub use text::design_text;

use crate::bound::BoundOptions;
use crate::random::sample_rng;
use crate::twin::{Twin, TwinError, TwinOptions};
use dermis::design::SkinDesign;
use dermis::geom::Point3;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis::protocol::Channel;
use fields::Fields;
use information::{NoiseLevel, Readings};
use layout::Layout;
use places::{Places, farthest_points};
use rand::RngExt;
use rayon::prelude::*;
use search::{Neighbourhood, Schedule, tour};
use touch::{Response, Touches};
use serde::{Deserialize, Serialize};

/// Candidates over the whole body, and around a layout. A design has at most 1024 electrodes.
const CANDIDATES: usize = 800;
/// Places of presses in the search.
const PRESSES: usize = 250;
/// Cells of the mesh of the fields, about.
const CELLS: f64 = 40_000.0;
/// Point electrodes with which the answers of presses are computed.
const PROBES: usize = 48;

/// What is made small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// The bound at the worst place. In the search the generalised mean with the exponent 16: the sum of powers is smooth
    /// and hardly more than its largest term.
    Worst,
    /// The mean bound.
    Mean,
}

impl Objective {
    fn exponent(self) -> i32 {
        match self {
            Objective::Worst => 16,
            Objective::Mean => 1,
        }
    }
}

/// What is optimised, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct OptimiseOptions {
    /// Number of electrodes.
    pub electrode_count: usize,
    /// Where they may lie.
    pub rules: PlaceRules,
    /// What is made small.
    pub objective: Objective,
    /// The press, and its force.
    pub bound: BoundOptions,
    /// Moves of a start for each electrode.
    pub moves: usize,
    /// Seed of the starts.
    pub seed: u64,
    /// Whether the noise is that of the given design in ohm, instead of the twin's ratio to the untouched frame of each
    /// layout.
    pub same_noise: bool,
}

impl Default for OptimiseOptions {
    /// 30 electrodes for the worst place, with 200 moves each.
    fn default() -> Self {
        OptimiseOptions {
            electrode_count: 30,
            rules: PlaceRules::default(),
            objective: Objective::Worst,
            bound: BoundOptions::default(),
            moves: 200,
            seed: 1,
            same_noise: false,
        }
    }
}

/// The layout that a start ends at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// Its index: it depends on this and the seed alone.
    pub index: usize,
    /// The objective in the fast model, m.
    pub objective_m: f64,
    /// Centres of the electrodes in the order of their numbers, m.
    pub electrodes_m: Vec<Point3>,
}

/// The search for a design: what all starts share.
#[derive(Debug)]
pub struct Optimiser {
    options: OptimiseOptions,
    /// With as many electrodes as wanted.
    design: SkinDesign,
    /// The given electrodes, if they are as many as wanted.
    given_m: Option<Vec<Point3>>,
    places: Places,
    presses: Vec<Response>,
    edge_m: f64,
    readings: Readings,
    coarse: Fields,
}

impl Optimiser {
    /// Prepares the search from the text of a design: its body, its coat, the shape of its first electrode and its
    /// protocol are kept. `path` is that of the design's file.
    ///
    /// # Errors
    /// A design that cannot be read or whose electrodes cannot be moved; rules that leave too few places; a twin without
    /// noise; a body on which a place has no bound.
    pub fn new(text: &str, path: &str, twin: &TwinOptions, options: &OptimiseOptions) -> crate::Result<Self> {
        let given = SkinDesign::parse(text, path)?;
        let places = Places::new(&given, &options.rules)?;
        let spread = places.spread(options.electrode_count)?;
        let design = SkinDesign::parse(&design_text(text, path, &given.name, &spread, None)?, path)?;
        let Prepared { presses, edge_m, readings } = Prepared::new(&given, &design, &places, twin, options)?;
        let candidates = farthest_points(places.surface, &places.allowed_m, 0, CANDIDATES, 0.0);
        let candidates: Vec<Point3> = candidates.into_iter().map(|place| places.allowed_m[place]).collect();
        let coarse = Fields::new(&design, &candidates, &presses, edge_m)?;
        let is_as_many = given.electrodes.len() == options.electrode_count;
        let given_m = is_as_many.then(|| given.electrodes.iter().map(|electrode| electrode.centre_m).collect());
        Ok(Optimiser { options: options.clone(), design, given_m, places, presses, edge_m, readings, coarse })
    }

    /// The layout of a start: annealed over the whole body, then on finer places around what was found. Start 0 begins at
    /// the given layout if it has as many electrodes, the others at random places.
    ///
    /// # Errors
    /// A place that no reading locates.
    pub fn start(&self, index: usize) -> crate::Result<Start> {
        let mut rng = sample_rng(self.options.seed, index as u64);
        let first = match &self.given_m {
            Some(given) if index == 0 => self.nearest(given),
            _ => self.random(&mut rng),
        };
        let moves = self.options.moves * self.options.electrode_count;
        let schedule = Schedule { moves, temperatures: [0.03, 5e-4] };
        let found = self.annealed(&self.coarse, first, schedule, &mut rng)?;
        let found_m: Vec<Point3> = found.iter().map(|&place| self.coarse.positions_m[place]).collect();
        let fine = Fields::new(&self.design, &self.around(&found_m), &self.presses, self.edge_m)?;
        let schedule = Schedule { moves: moves / 2, temperatures: [2e-3, 1e-4] };
        let chosen = self.annealed(&fine, (0..found_m.len()).collect(), schedule, &mut rng)?;
        let layout = Layout::new(&fine, &self.readings, self.options.objective, chosen.clone());
        Ok(Start {
            index,
            objective_m: layout.objective_m(),
            electrodes_m: chosen.into_iter().map(|place| fine.positions_m[place]).collect(),
        })
    }

    /// The bound of the fast model at each of its places for a design with these electrodes, m.
    ///
    /// # Errors
    /// Electrodes off the body.
    pub fn model_bounds(&self, electrodes_m: &[Point3]) -> crate::Result<Vec<(Point3, f64)>> {
        let fields = Fields::new(&self.design, electrodes_m, &self.presses, self.edge_m)?;
        let chosen = (0..electrodes_m.len()).collect();
        let layout = Layout::new(&fields, &self.readings, Objective::Mean, chosen);
        let rest = self.readings.rest(&fields.impedance_ohm, layout.chosen());
        let sd = |change: &[[f32; touch::PARAMETERS]]| {
            information::position_sd_m(&self.readings.information(change, &rest))
        };
        Ok(fields.presses().iter().map(|press| press.place_m).zip(layout.changes().map(sd)).collect())
    }

    fn annealed(
        &self,
        fields: &Fields,
        first: Vec<usize>,
        schedule: Schedule,
        rng: &mut rand_chacha::ChaCha8Rng,
    ) -> crate::Result<Vec<usize>> {
        let mut layout = Layout::new(fields, &self.readings, self.options.objective, first);
        if let Some(press) = layout.unlocated() {
            return Err(OptimiseError::NoCurrent { place_m: self.presses[press].around.place_m }.into());
        }
        Ok(Neighbourhood::new(&self.places, &fields.positions_m).anneal(&mut layout, schedule, rng))
    }

    /// The candidates nearest to some places, each once.
    fn nearest(&self, given_m: &[Point3]) -> Vec<usize> {
        let mut chosen: Vec<usize> = Vec::new();
        for &place in given_m {
            let away = |&index: &usize| self.places.surface.distance_m(place, self.coarse.positions_m[index]);
            let free = (0..self.coarse.positions_m.len()).filter(|index| !chosen.contains(index));
            chosen.extend(free.min_by(|a, b| away(a).total_cmp(&away(b))));
        }
        chosen
    }

    /// Places that are spread over a random half of the candidates, numbered along a tour.
    fn random(&self, rng: &mut rand_chacha::ChaCha8Rng) -> Vec<usize> {
        let count = self.options.electrode_count;
        let all: Vec<usize> = (0..self.coarse.positions_m.len()).collect();
        let half: Vec<usize> = all.iter().copied().filter(|_| rng.random::<f64>() < 0.5).collect();
        let spread = |from: &[usize]| -> Vec<usize> {
            let positions: Vec<Point3> = from.iter().map(|&index| self.coarse.positions_m[index]).collect();
            let least_m = self.places.least_distance_m;
            let places = farthest_points(self.places.surface, &positions, 0, count, least_m);
            places.into_iter().map(|place| from[place]).collect()
        };
        let mut chosen = if half.is_empty() { Vec::new() } else { spread(&half) };
        if chosen.len() < count {
            chosen = spread(&all);
        }
        let positions: Vec<Point3> = chosen.iter().map(|&index| self.coarse.positions_m[index]).collect();
        tour(&self.places, &positions, 0).into_iter().map(|index| chosen[index]).collect()
    }

    /// The given places, and allowed places around them.
    fn around(&self, found_m: &[Point3]) -> Vec<Point3> {
        let reach_m = (self.places.area_m2 / self.coarse.positions_m.len() as f64).sqrt();
        let nearest_m = |place: &Point3| {
            let away = |other: &Point3| self.places.surface.distance_m(*place, *other);
            found_m.iter().map(away).fold(f64::INFINITY, f64::min)
        };
        let near: Vec<Point3> =
            self.places.allowed_m.iter().copied().filter(|place| (1e-9..=reach_m).contains(&nearest_m(place))).collect();
        let most = CANDIDATES.saturating_sub(found_m.len());
        let thinned = if near.is_empty() { Vec::new() } else { farthest_points(self.places.surface, &near, 0, most, 0.0) };
        found_m.iter().copied().chain(thinned.into_iter().map(|place| near[place])).collect()
    }
}

/// The readings of a design's protocol that are worth most for a number of readings, those of the currents included:
/// channels in the protocol's order.
///
/// # Errors
/// Fewer readings than unknowns, or more than the protocol has; a twin without noise; electrodes in groups of a file.
pub fn select_readings(
    design: &SkinDesign,
    twin: &TwinOptions,
    bound: &BoundOptions,
    objective: Objective,
    slots: usize,
) -> crate::Result<Vec<Channel>> {
    let places = Places::new(design, &PlaceRules::default())?;
    let options = OptimiseOptions { bound: *bound, objective, ..OptimiseOptions::default() };
    let Prepared { presses, edge_m, readings } = Prepared::new(design, design, &places, twin, &options)?;
    let electrodes_m: Vec<Point3> = design.electrodes.iter().map(|electrode| electrode.centre_m).collect();
    let fields = Fields::new(design, &electrodes_m, &presses, edge_m)?;
    let layout = Layout::new(&fields, &readings, objective, (0..electrodes_m.len()).collect());
    if let Some(press) = layout.unlocated() {
        return Err(OptimiseError::NoCurrent { place_m: fields.presses()[press].place_m }.into());
    }
    let rest = readings.rest(&fields.impedance_ohm, layout.chosen());
    Ok(pattern::select(&layout, &readings, rest, objective, slots)?)
}

/// The presses of the search and the readings.
struct Prepared {
    presses: Vec<Response>,
    edge_m: f64,
    readings: Readings,
}

impl Prepared {
    /// For the protocol of `design`, and the skin and the noise of `given`.
    fn new(
        given: &SkinDesign,
        design: &SkinDesign,
        places: &Places,
        twin: &TwinOptions,
        options: &OptimiseOptions,
    ) -> crate::Result<Self> {
        let edge_m = (0.5 * options.bound.tip_radius_m).max((2.0 * places.area_m2 / CELLS).sqrt());
        let pixels = PixelSpace::for_design(given, &Mesh::generate(given)?)?;
        let spread = farthest_points(places.surface, &pixels.centres_m, 0, PRESSES, 0.0);
        let probes = farthest_points(places.surface, &places.allowed_m, 0, PROBES, 0.0);
        let probes_m: Vec<Point3> = probes.into_iter().map(|place| places.allowed_m[place]).collect();
        let radius_m = options.bound.tip_radius_m.max(2.0 * edge_m);
        let touches = Touches::new(given, &probes_m, twin, &options.bound, radius_m)?;
        let press = |pixel: usize| touches.response(pixels.centres_m[pixel], pixels.normals[pixel]);
        let level = noise_level(given, twin, options.same_noise)?;
        Ok(Prepared {
            presses: spread.into_par_iter().map(press).collect::<crate::Result<_>>()?,
            edge_m,
            readings: Readings::new(&design.protocol, level, twin.electronics.reference_ohm, touches.known()),
        })
    }
}

fn noise_level(design: &SkinDesign, twin: &TwinOptions, same_noise: bool) -> crate::Result<NoiseLevel> {
    let snr_db = twin.electronics.snr_db.ok_or_else(|| TwinError::OutOfRange {
        field: "electronics.snr_db",
        value: f64::INFINITY,
        must: "finite".into(),
        fix: "without noise every bound is zero; give the noise of the instrument".into(),
    })?;
    if !same_noise {
        return Ok(NoiseLevel::Ratio(crate::elementary::powf(10.0, snr_db / 20.0)));
    }
    let skin = Twin::new(design, &twin.as_designed(), 0)?;
    Ok(NoiseLevel::Fixed(skin.noise().map_or(f64::INFINITY, |noise| noise.sd_ohm)))
}
