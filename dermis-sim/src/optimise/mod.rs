//! Better designs: where the electrodes go, and which values are read.
//!
//! A fast model of the bound of a press's position ([`bound`](crate::bound)) is searched by simulated annealing from many
//! starts: the fields of currents from candidate places are computed once, and a layout's readings of a weak press follow
//! from them. `docs/optimise.md` has the formulas. What comes out is a design file, to be judged by the exact bounds:
//! [`optimise`] does all of it; these are its steps.

mod error;
mod fields;
mod information;
mod judge;
mod layout;
mod local;
mod options;
mod pattern;
mod places;
mod presses;
mod run;
mod search;
mod state;
#[cfg(test)]
mod tests;
mod text;
mod touch;

pub use error::OptimiseError;
pub use judge::{Judgement, PlaceBound};
pub use options::{Objective, OptimiseOptions};
pub use places::{PlaceRules, Zone};
pub use run::{CurvePoint, JudgedDesign, Optimised, SearchOptions, optimise};

use crate::bound::BoundOptions;
use crate::random::sample_rng;
use crate::twin::TwinOptions;
use dermis::design::SkinDesign;
use dermis::geom::Point3;
use dermis::protocol::Channel;
use fields::Fields;
use information::Readings;
use judge::judge;
use layout::Layout;
use options::Start;
use places::{Places, farthest_points};
use presses::Presses;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use search::{Neighbourhood, Schedule, tour};
use text::design_text;

/// Candidates over the whole body, and around a layout.
const CANDIDATES: usize = 800;
/// Largest factor by which the exact bound of a press corrects that of the fast model.
const MAX_WEIGHT: f64 = 3.0;
/// Streams of random numbers of the refinement, apart from those of the starts.
const REFINING: u64 = 1;

/// The search for layouts on a body: what all numbers of electrodes share.
#[derive(Debug)]
struct Optimiser {
    options: OptimiseOptions,
    text: String,
    path: String,
    given: SkinDesign,
    twin: TwinOptions,
    places: Places,
    presses: Presses,
    coarse: Fields,
}

impl Optimiser {
    /// Prepares the search from the text of a design: its body, its coat, the shape of its first electrode and its
    /// protocol are kept. `path` is that of the design's file.
    fn new(text: &str, path: &str, twin: &TwinOptions, options: &OptimiseOptions) -> crate::Result<Self> {
        let given = SkinDesign::parse(text, path)?;
        let places = Places::new(&given, &options.rules)?;
        let presses = Presses::new(&given, &places, twin, &options.bound)?;
        let candidates = places.spread(CANDIDATES, 0.0);
        let coarse = Fields::new(&given, &candidates, &presses.responses, presses.edge_m)?;
        let (text, path) = (text.to_string(), path.to_string());
        let twin = twin.clone();
        Ok(Optimiser { options: options.clone(), text, path, given, twin, places, presses, coarse })
    }

    /// The search for layouts of a number of electrodes.
    fn layouts(&self, electrode_count: usize) -> crate::Result<Layouts<'_>> {
        let spread = self.places.fitting(electrode_count)?;
        let design =
            SkinDesign::parse(&design_text(&self.text, &self.path, &self.given.name, &spread, None)?, &self.path)?;
        Ok(Layouts {
            shared: self,
            electrode_count,
            readings: Readings::new(&design.protocol, self.presses.instrument),
        })
    }

    /// The given places, and allowed places around them.
    fn around(&self, found_m: &[Point3]) -> Vec<Point3> {
        let reach_m = (self.places.area_m2 / self.coarse.positions_m.len() as f64).sqrt();
        let nearest_m = |place: &Point3| {
            let away = |other: &Point3| self.places.surface.distance_m(*place, *other);
            found_m.iter().map(away).fold(f64::INFINITY, f64::min)
        };
        let near: Vec<Point3> = self
            .places
            .allowed_m
            .iter()
            .copied()
            .filter(|place| (1e-9..=reach_m).contains(&nearest_m(place)))
            .collect();
        let most = CANDIDATES.saturating_sub(found_m.len());
        let thinned = farthest_points(self.places.surface, &near, most, 0.0);
        found_m.iter().copied().chain(thinned.into_iter().map(|place| near[place])).collect()
    }
}

/// The search for layouts of a number of electrodes.
#[derive(Debug)]
struct Layouts<'a> {
    shared: &'a Optimiser,
    electrode_count: usize,
    readings: Readings,
}

impl Layouts<'_> {
    /// The layout of a start: annealed over the whole body, then on finer places around what was found. Start 0 begins at
    /// the given layout if it has as many electrodes, the others at random places.
    fn start(&self, index: usize) -> crate::Result<Start> {
        let Optimiser { options, given, coarse, presses, .. } = self.shared;
        let mut rng = sample_rng(options.seed, index as u64);
        let first = match index == 0 && given.electrodes.len() == self.electrode_count {
            true => self.nearest(&centres_m(given)),
            false => self.random(&mut rng),
        };
        let moves = options.moves * self.electrode_count;
        let schedule = Schedule { moves, temperatures: [0.03, 5e-4] };
        let weights = vec![1.0; presses.responses.len()];
        let found = self.annealed(coarse, first, &weights, schedule, &mut rng);
        let found_m: Vec<Point3> = found.chosen().iter().map(|&place| coarse.positions_m[place]).collect();
        self.near(index, &found_m, &weights, &mut rng)
    }

    /// A start improved in rounds: where the exact bound exceeds that of the fast model, presses count more in the next
    /// search near the layout. The exact bounds of the best of all are returned with it; `judged` takes the best so far after
    /// each round. Start 0 continues from the given layout if that has a better bound.
    fn refine(
        &self,
        start: Start,
        rounds: usize,
        of_given: &Judgement,
        mut judged: impl FnMut(&Start, &Judgement) -> crate::Result<()>,
    ) -> crate::Result<(Start, Judgement)> {
        let Optimiser { options, text, path, given, twin, presses, .. } = self.shared;
        let exact = |start: &Start| {
            let text = design_text(text, path, &given.name, &start.electrodes_m, None)?;
            judge(&SkinDesign::parse(&text, path)?, twin, &options.bound)
        };
        let mut rng = sample_rng(options.seed, (REFINING << 32) + start.index as u64);
        let judged_exactly = |start: Start| Ok::<_, crate::Error>((start.clone(), exact(&start)?));
        let mut best = judged_exactly(start)?;
        if let (0, Some(given)) = (best.0.index, self.given()?)
            && of_given.of(options.objective) <= best.1.of(options.objective)
        {
            best = (given, of_given.clone());
        }
        let mut weights = vec![1.0f64; presses.responses.len()];
        let mut next = best.clone();
        judged(&best.0, &best.1)?;
        for _ in 0..rounds {
            let model = self.model_bounds(&next.0.electrodes_m)?;
            for (weight, (place_m, model_m)) in weights.iter_mut().zip(&model) {
                let exact = next.1.places.iter().find(|place| place.position_m == *place_m);
                let exact_m = exact.map_or(*model_m, |place| place.sd_m);
                *weight = weight.max((exact_m / model_m).clamp(1.0, MAX_WEIGHT));
            }
            next = judged_exactly(self.near(best.0.index, &best.0.electrodes_m, &weights, &mut rng)?)?;
            if next.1.of(options.objective) < best.1.of(options.objective) {
                best = next.clone();
            }
            judged(&best.0, &best.1)?;
        }
        Ok(best)
    }

    /// The given layout, as the start 0, if it has as many electrodes and obeys the rules.
    fn given(&self) -> crate::Result<Option<Start>> {
        let Optimiser { options, given, places, .. } = self.shared;
        if given.electrodes.len() != self.electrode_count || !places.allow_given {
            return Ok(None);
        }
        let electrodes_m = centres_m(given);
        let fields = self.fields(&electrodes_m)?;
        let objective_m = self.numbered(&fields, options.objective).objective_m();
        Ok(Some(Start { index: 0, objective_m, electrodes_m }))
    }

    /// The best layout near another, on finer places.
    fn near(&self, index: usize, found_m: &[Point3], weights: &[f64], rng: &mut ChaCha8Rng) -> crate::Result<Start> {
        let fine = self.fields(&self.shared.around(found_m))?;
        let moves = self.shared.options.moves * self.electrode_count / 2;
        let schedule = Schedule { moves, temperatures: [2e-3, 1e-4] };
        let layout = self.annealed(&fine, (0..found_m.len()).collect(), weights, schedule, rng);
        layout.check()?;
        let electrodes_m = layout.chosen().iter().map(|&place| fine.positions_m[place]).collect();
        Ok(Start { index, objective_m: layout.objective_m(), electrodes_m })
    }

    /// The bound of the fast model for electrodes at some places, m, at each place of its presses.
    fn model_bounds(&self, electrodes_m: &[Point3]) -> crate::Result<Vec<(Point3, f64)>> {
        let fields = self.fields(electrodes_m)?;
        let bounds_m = self.numbered(&fields, Objective::Mean).bounds_m();
        Ok(fields.presses().iter().map(|press| press.place_m).zip(bounds_m).collect())
    }

    fn fields(&self, candidates_m: &[Point3]) -> crate::Result<Fields> {
        let Optimiser { given, presses, .. } = self.shared;
        Fields::new(given, candidates_m, &presses.responses, presses.edge_m)
    }

    /// The layout of all candidates, in their order.
    fn numbered<'a>(&'a self, fields: &'a Fields, objective: Objective) -> Layout<'a> {
        Layout::new(fields, &self.readings, objective, (0..fields.positions_m.len()).collect())
    }

    fn annealed<'a>(
        &'a self,
        fields: &'a Fields,
        first: Vec<usize>,
        weights: &[f64],
        schedule: Schedule,
        rng: &mut ChaCha8Rng,
    ) -> Layout<'a> {
        let of = |chosen| Layout::weighted(fields, &self.readings, self.shared.options.objective, chosen, weights);
        let best = Neighbourhood::new(&self.shared.places, &fields.positions_m).anneal(&mut of(first), schedule, rng);
        of(best)
    }

    /// The candidates nearest to some places, each once.
    fn nearest(&self, given_m: &[Point3]) -> Vec<usize> {
        let positions_m = &self.shared.coarse.positions_m;
        let mut chosen: Vec<usize> = Vec::new();
        for &place in given_m {
            let away = |&index: &usize| self.shared.places.surface.distance_m(place, positions_m[index]);
            let free = (0..positions_m.len()).filter(|index| !chosen.contains(index));
            chosen.extend(free.min_by(|a, b| away(a).total_cmp(&away(b))));
        }
        chosen
    }

    /// Places that are spread over a random half of the candidates, numbered along a tour.
    fn random(&self, rng: &mut ChaCha8Rng) -> Vec<usize> {
        let Optimiser { coarse, places, .. } = self.shared;
        let all: Vec<usize> = (0..coarse.positions_m.len()).collect();
        let half: Vec<usize> = all.iter().copied().filter(|_| rng.random::<f64>() < 0.5).collect();
        let spread = |from: &[usize]| -> Vec<usize> {
            let positions: Vec<Point3> = from.iter().map(|&index| coarse.positions_m[index]).collect();
            let chosen = farthest_points(places.surface, &positions, self.electrode_count, places.least_distance_m);
            chosen.into_iter().map(|place| from[place]).collect()
        };
        let mut chosen = spread(&half);
        if chosen.len() < self.electrode_count {
            chosen = spread(&all);
        }
        let positions: Vec<Point3> = chosen.iter().map(|&index| coarse.positions_m[index]).collect();
        tour(places, &positions, 0).into_iter().map(|index| chosen[index]).collect()
    }
}

/// A number that JSON has.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn centres_m(design: &SkinDesign) -> Vec<Point3> {
    design.electrodes.iter().map(|electrode| electrode.centre_m).collect()
}

/// The readings of a design's protocol that are worth most for a number of readings, those of the currents included:
/// channels in the protocol's order. `progress` is called with the share of the work that is done.
fn select_readings(
    design: &SkinDesign,
    twin: &TwinOptions,
    bound: &BoundOptions,
    objective: Objective,
    slots: usize,
    progress: impl FnMut(f64),
) -> crate::Result<Vec<Channel>> {
    let places = Places::new(design, &PlaceRules::default())?;
    let presses = Presses::new(design, &places, twin, bound)?;
    let electrodes_m = centres_m(design);
    let fields = Fields::new(design, &electrodes_m, &presses.responses, presses.edge_m)?;
    let readings = Readings::new(&design.protocol, presses.instrument);
    let layout = Layout::new(&fields, &readings, objective, (0..electrodes_m.len()).collect());
    layout.check()?;
    Ok(pattern::select(&layout, &readings, objective, slots, progress)?)
}
