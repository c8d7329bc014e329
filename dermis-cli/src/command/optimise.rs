//! `dermis optimise`: where electrodes go, and which values are read.

mod result;

use crate::console::Progress;
use crate::failure::Outcome;
use crate::picture::picture;
use crate::range::{count, number, parsed, seed};
use crate::twin::TwinArguments;
use clap::{Args, ValueEnum};
use dermis::design::SkinDesign;
use dermis_sim::bound::BoundOptions;
use dermis_sim::optimise::{Objective, OptimiseOptions, PlaceRules, SearchOptions, Zone, optimise};
use std::path::PathBuf;
use std::str::FromStr;

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
    #[command(flatten)]
    twin: TwinArguments,
    /// Force of the presses, N.
    #[arg(long, value_name = "N", default_value_t = 2.0, value_parser = number(1e-3..=1e3))]
    force: f64,
    /// Radius of the tip, m.
    #[arg(long, value_name = "M", default_value_t = 0.005, value_parser = number(1e-4..=0.1))]
    tip_radius: f64,
    /// Number of starts; the first begins at the given layout. Starts run in parallel, one on each core.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = count(1..=100_000usize))]
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
    /// Design to write; its pattern is beside it. The best so far is written as soon as it is found.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Write the bound against the number of electrodes (.csv or .svg).
    #[arg(long, value_name = "FILE", requires = "counts")]
    curve: Option<PathBuf>,
    /// Write the bound against the number of readings (.csv or .svg).
    #[arg(long, value_name = "FILE", requires = "slots")]
    slots_curve: Option<PathBuf>,
    /// Write a map of the new design's bound (SVG, PNG).
    #[arg(long, value_name = "FILE", value_parser = picture())]
    map: Option<PathBuf>,
    /// Write a map of the given design's bound, with the same colours (SVG, PNG).
    #[arg(long, value_name = "FILE", value_parser = picture())]
    given_map: Option<PathBuf>,
    /// Print JSON (SI units) instead of tables.
    #[arg(long)]
    json: bool,
}

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

    fn from_str(text: &str) -> Result<Self, String> {
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
            result::is_picture(path)?;
        }
        let given = SkinDesign::load(&self.design)?;
        let twin = self.twin.load()?;
        let options = self.options();
        let progress = Progress::new("searching", options.steps(&given));
        let found = optimise(&self.design, &twin, &options, &self.output, || progress.step())?;
        drop(progress);
        self.show(&found)
    }

    fn options(&self) -> SearchOptions {
        let bound = BoundOptions { force_n: self.force, tip_radius_m: self.tip_radius, ..BoundOptions::default() };
        SearchOptions {
            optimise: OptimiseOptions {
                rules: PlaceRules {
                    least_distance_m: self.least_distance,
                    edge_m: self.edge,
                    forbidden: self.forbid.iter().map(|ball| ball.0).collect(),
                },
                objective: self.objective.into(),
                bound,
                moves: self.moves,
                seed: self.seed,
            },
            electrodes: self.electrodes,
            counts: self.counts.clone(),
            keep_electrodes: self.keep_electrodes,
            slots: self.slots.clone(),
            starts: self.starts,
            rounds: self.rounds,
            state: self.state.clone(),
        }
    }
}
