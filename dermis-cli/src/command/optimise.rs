//! `dermis optimise`: where electrodes go, and which values are read.

mod result;
mod state;

use crate::console::Progress;
use crate::failure::Outcome;
use crate::range::{count, number, parsed, seed};
use clap::{Args, ValueEnum};
use dermis::design::SkinDesign;
use dermis::frame::write_whole;
use dermis::geom::Point3;
use dermis::protocol::Protocol;
use dermis_sim::bound::BoundOptions;
use dermis_sim::optimise::{
    Judgement, Layouts, Objective, OptimiseOptions, Optimiser, PlaceRules, Zone, design_text, judge, select_readings,
    with_noise_of,
};
use dermis_sim::twin::TwinOptions;
use rayon::prelude::*;
use result::{Pattern, Result};
use state::{Found, State};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};

/// The arguments of `dermis optimise`.
#[derive(Debug, Args)]
#[command(
    after_help = "Layouts are searched with a fast model of the bound and judged by the exact one, on a mesh that is \
    fine enough for the tip. docs/optimise.md has the formulas."
)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name. Its body, coat, protocol and first electrode's shape are kept.
    design: String,
    /// Number of electrodes, instead of the design's.
    #[arg(long, value_name = "N", value_parser = count(4..=1024usize))]
    electrodes: Option<usize>,
    /// More numbers of electrodes, for the curve.
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', value_parser = count(4..=1024usize))]
    counts: Vec<usize>,
    /// Keep the electrodes, and choose readings alone.
    #[arg(long, requires = "slots", conflicts_with_all = ["electrodes", "counts", "state"])]
    keep_electrodes: bool,
    /// Numbers of readings of a frame, those of the currents included: choose those that are worth most. The design gets
    /// the first.
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', value_parser = count(1..=2_000_000usize))]
    slots: Vec<usize>,
    /// What is made small.
    #[arg(long, value_enum, default_value_t = ObjectiveChoice::Worst)]
    objective: ObjectiveChoice,
    /// Least distance of two centres along the surface, m; without it one and a half times an electrode's extent.
    #[arg(long, value_name = "M", value_parser = number(0.0..=100.0))]
    least_distance: Option<f64>,
    /// Least distance of a centre from the body's edge, m; 0: discs may lie on the edge, cut in half.
    #[arg(long, value_name = "M", default_value_t = 0.0, value_parser = number(0.0..=100.0))]
    edge: f64,
    /// A ball without centres of electrodes: x, y, z and radius, m. May be given more than once.
    #[arg(long, value_name = "X,Y,Z,R", value_parser = parsed::<Ball>, allow_hyphen_values = true)]
    forbid: Vec<Ball>,
    /// Digital twin whose presses and noise are assumed: the path of a file, or a shipped name.
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    twin: String,
    /// Signal-to-noise ratio of a reading, instead of that of the twin, dB.
    #[arg(long, value_name = "DB", value_parser = number(-20.0..=200.0))]
    noise: Option<f64>,
    /// Force of the presses, N.
    #[arg(long, value_name = "N", default_value_t = 2.0, value_parser = number(1e-3..=1e3))]
    force: f64,
    /// Radius of the tip, m.
    #[arg(long, value_name = "M", default_value_t = 0.005, value_parser = number(1e-4..=0.1))]
    tip_radius: f64,
    /// Number of starts; the first begins at the given layout. Starts run in parallel, one on each core.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = count(1..=100_000usize))]
    starts: usize,
    /// Moves of a start for each electrode.
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = count(1..=10_000_000usize))]
    moves: usize,
    /// Rounds in which a start is improved by its exact bounds.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = count(0..=1000usize))]
    rounds: usize,
    /// Seed of the starts.
    #[arg(long, value_name = "SEED", default_value = "1", value_parser = seed)]
    seed: u64,
    /// File of the starts that are done (JSON): written after each, continued if it exists.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Design to write; its pattern is beside it.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Write the bound against the number of electrodes (.csv or .svg).
    #[arg(long, value_name = "FILE", requires = "counts")]
    curve: Option<PathBuf>,
    /// Write the bound against the number of readings (.csv or .svg).
    #[arg(long, value_name = "FILE", requires = "slots")]
    slots_curve: Option<PathBuf>,
    /// Write a map of the new design's bound (SVG).
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Write a map of the given design's bound, with the same colours (SVG).
    #[arg(long, value_name = "FILE")]
    given_map: Option<PathBuf>,
    /// Print JSON (SI units) instead of tables.
    #[arg(long)]
    json: bool,
}

/// Steps of the progress bar for each number of readings.
const STEPS_PER_PATTERN: usize = 100;

/// What is made small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ObjectiveChoice {
    /// The bound at the worst place.
    Worst,
    /// The mean bound.
    Mean,
}

impl From<ObjectiveChoice> for Objective {
    fn from(choice: ObjectiveChoice) -> Self {
        match choice {
            ObjectiveChoice::Worst => Objective::Worst,
            ObjectiveChoice::Mean => Objective::Mean,
        }
    }
}

/// A zone as an argument.
#[derive(Debug, Clone, Copy)]
struct Ball(Zone);

impl FromStr for Ball {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let values: Option<Vec<f64>> = text.split(',').map(|value| value.trim().parse().ok()).collect();
        match values.as_deref() {
            Some(&[x, y, z, radius_m]) if [x, y, z].iter().all(|value| value.is_finite()) && radius_m > 0.0 => {
                Ok(Ball(Zone { centre_m: [x, y, z], radius_m }))
            }
            _ => Err("it must be four numbers, x, y, z and a radius above 0, m, as in 0.05,0,0.1,0.02".into()),
        }
    }
}

impl Arguments {
    /// Searches, and writes the best design.
    pub fn run(self) -> Outcome {
        for path in [&self.curve, &self.slots_curve].into_iter().flatten() {
            result::CurveFormat::of(path)?;
        }
        let text = SkinDesign::text_of(&self.design)?;
        let given = SkinDesign::parse(&text, &self.design)?;
        let mut twin = TwinOptions::load(&self.twin)?;
        twin.electronics.snr_db = self.noise.or(twin.electronics.snr_db);
        let (found, electrodes_m) = match self.keep_electrodes {
            true => (Vec::new(), given.electrodes.iter().map(|electrode| electrode.centre_m).collect()),
            false => {
                let found = self.search(&text, &given, &twin)?;
                let wanted = self.count(&given);
                let best = found.iter().find(|one| one.start.electrodes_m.len() == wanted);
                let electrodes_m = best.map(|one| one.start.electrodes_m.clone()).unwrap_or_default();
                (found, electrodes_m)
            }
        };
        let patterns = self.patterns(&text, &twin, &electrodes_m)?;
        let table = match patterns.first() {
            Some(pattern) => Some(self.write_table(&pattern.protocol)?),
            None => None,
        };
        let new_text = self.text(&text, &electrodes_m, table.as_deref())?;
        write_whole(&self.output, |out| out.write_all(new_text.as_bytes()))?;
        let new = SkinDesign::parse(&new_text, &self.output.to_string_lossy())?;
        let bounds = [self.judge(&given, &twin)?, self.judged(&new, &patterns, &twin)?];
        self.tell(&Result { given: &given, new: &new, bounds, found, patterns })
    }

    fn count(&self, given: &SkinDesign) -> usize {
        self.electrodes.unwrap_or(given.electrodes.len())
    }

    fn bound(&self) -> BoundOptions {
        BoundOptions { force_n: self.force, tip_radius_m: self.tip_radius, ..BoundOptions::default() }
    }

    fn options(&self) -> OptimiseOptions {
        OptimiseOptions {
            rules: PlaceRules {
                least_distance_m: self.least_distance,
                edge_m: self.edge,
                forbidden: self.forbid.iter().map(|ball| ball.0).collect(),
            },
            objective: self.objective.into(),
            bound: self.bound(),
            moves: self.moves,
            seed: self.seed,
        }
    }

    /// The best layout for each number of electrodes, in ascending order.
    fn search(&self, text: &str, given: &SkinDesign, twin: &TwinOptions) -> Outcome<Vec<Found>> {
        let mut counts = self.counts.clone();
        counts.push(self.count(given));
        counts.sort_unstable();
        counts.dedup();
        let options = self.options();
        let state =
            State::open(self.state.as_deref(), format!("{text}\n{twin:?}\n{options:?}\n{} rounds", self.rounds))?;
        let waiting = Progress::waiting("preparing");
        let optimiser = Optimiser::new(text, &self.design, twin, &options)?;
        // What does not fit is refused before any start.
        let layouts: Vec<Layouts<'_>> =
            counts.iter().map(|&count| optimiser.layouts(count)).collect::<dermis_sim::Result<_>>()?;
        drop(waiting);
        let progress = Progress::new("layouts", counts.len() * self.starts * (1 + self.rounds));
        let state = Mutex::new(state);
        let locked = || state.lock().unwrap_or_else(PoisonError::into_inner);
        let all: Vec<(usize, &Layouts<'_>, usize)> = (counts.iter().zip(&layouts))
            .flat_map(|(&count, layouts)| (0..self.starts).map(move |index| (count, layouts, index)))
            .collect();
        all.into_par_iter().with_max_len(1).try_for_each(|(count, layouts, index)| -> Outcome {
            if locked().has(count, index) {
                progress.steps(1 + self.rounds as u64);
                return Ok(());
            }
            let (start, judgement) = layouts.refine(layouts.start(index)?, self.rounds, || progress.step())?;
            locked().add(Found::new(start, &judgement))
        })?;
        Ok(counts.iter().filter_map(|&count| locked().best(count, self.starts, options.objective)).collect())
    }

    fn judge(&self, design: &SkinDesign, twin: &TwinOptions) -> Outcome<Judgement> {
        Ok(judge(design, twin, &self.bound())?)
    }

    /// The bounds of the new design: with a pattern under the noise of all readings.
    fn judged(&self, new: &SkinDesign, patterns: &[Pattern], twin: &TwinOptions) -> Outcome<Judgement> {
        match patterns.first() {
            Some(pattern) => Ok(pattern.judgement.clone()),
            None => self.judge(new, twin),
        }
    }

    /// The name of the new design: that of its file.
    fn text(&self, text: &str, electrodes_m: &[Point3], table: Option<&str>) -> Outcome<String> {
        let name = self.output.file_stem().map_or("optimised".into(), |stem| stem.to_string_lossy());
        Ok(design_text(text, &self.design, &name, electrodes_m, table)?)
    }

    fn parsed(&self, text: &str, electrodes_m: &[Point3]) -> Outcome<SkinDesign> {
        Ok(SkinDesign::parse(&self.text(text, electrodes_m, None)?, &self.design)?)
    }

    /// The readings that are worth most, for each number of them.
    fn patterns(&self, text: &str, twin: &TwinOptions, electrodes_m: &[Point3]) -> Outcome<Vec<Pattern>> {
        if self.slots.is_empty() {
            return Ok(Vec::new());
        }
        let whole = self.parsed(text, electrodes_m)?;
        let progress = Progress::new("patterns", STEPS_PER_PATTERN * self.slots.len());
        let pattern = |&slots: &usize| {
            let mut done = 0;
            let advance = |share: f64| {
                let now = (share * STEPS_PER_PATTERN as f64) as u64;
                progress.steps(now - done);
                done = now;
            };
            let channels = select_readings(&whole, twin, &self.bound(), self.objective.into(), slots, advance)?;
            let protocol = Protocol::new(whole.electrodes.len(), channels).map_err(dermis::Error::from)?;
            let design = SkinDesign { protocol: protocol.clone(), ..whole.clone() };
            let judgement = self.judge(&design, &with_noise_of(twin, &design, &whole)?)?;
            progress.steps(STEPS_PER_PATTERN as u64 - done);
            let rate_hz = twin.electronics.slot_rate_hz / slots as f64;
            Ok(Pattern { slots, rate_hz, protocol, judgement })
        };
        self.slots.iter().map(pattern).collect()
    }

    /// Writes the channel table beside the design; returns its name there.
    fn write_table(&self, protocol: &Protocol) -> Outcome<String> {
        let stem = self.output.file_stem().unwrap_or_default().to_string_lossy();
        let name = format!("{stem}-pattern.csv");
        let path = self.output.parent().unwrap_or(Path::new("")).join(&name);
        write_whole(&path, |out| out.write_all(protocol.to_csv().as_bytes()))?;
        Ok(name)
    }
}
