//! `dermis experiment`: the paper's indentation experiment on a digital twin.

use crate::console::{Progress, print, print_json, warn};
use crate::failure::{Failure, Outcome};
use crate::range::{count, number, seed};
use crate::twin::TwinArguments;
use clap::{Args, ValueEnum};
use dermis::design::SkinDesign;
use dermis::files::{NewFolder, folder_of};
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis_plot::report::Table;
use dermis_sim::experiment::{ExperimentSummary, PaperExperiment, Sizes};
use std::path::{Path, PathBuf};

/// The arguments of `dermis experiment`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    twin: TwinArguments,
    /// Seed of the twin, the presses and the noise.
    #[arg(long, value_name = "S", value_parser = seed)]
    seed: u64,
    /// Frames of each set, at most [default: a press at every pixel, 900 at random, 3000 pairs, 500 fours]
    #[arg(long, value_name = "N", value_parser = count(1..=1_000_000usize))]
    presses: Option<usize>,
    /// Sets to simulate.
    #[arg(long, value_enum, value_name = "SET,...", value_delimiter = ',', default_value = "grid,random,two,four")]
    sets: Vec<SetName>,
    /// Touches at once in the set `four`; the set is called `several` where they are not four [default: 4]
    #[arg(long, value_name = "N", value_parser = count(2..=16usize))]
    touches: Option<usize>,
    /// Least distance of these touches from each other, m [default: 0.06]
    #[arg(long, value_name = "M", value_parser = number(1e-3..=1.0))]
    apart: Option<f64>,
    /// Folder to write; it must not exist, or be empty.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
}

/// What to do where touches are too far apart for a body.
const FEWER: &str = "choose a smaller distance with --apart, fewer --touches, or other --sets";

/// A set of presses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SetName {
    /// A press at each pixel.
    Grid,
    /// Presses at random places.
    Random,
    /// Two touches at once.
    Two,
    /// Several touches at once.
    Four,
}

impl Arguments {
    /// Simulates the presses and writes the frames.
    pub fn run(self) -> Outcome {
        if (self.touches.is_some() || self.apart.is_some()) && !self.sets.contains(&SetName::Four) {
            let fix = "add `four` to --sets, or leave them out";
            return Err(Failure::given("--touches and --apart are those of the set `four`", Some(fix)));
        }
        let design = SkinDesign::load(&self.design)?;
        let options = self.twin.load()?;
        let folder = new_folder(&self.output)?;
        let mesh = Mesh::generate(&design)?;
        let pixels = PixelSpace::for_design(&design, &mesh)?;
        let sizes = self.sizes(pixels.len());
        let experiment = {
            let _waiting = Progress::waiting("preparing the twin");
            PaperExperiment::draw(&design, &mesh, &pixels, &options, self.seed, &sizes)?
        };
        if experiment.frame_count() == 0 {
            return Err(Failure::given(format!("{}: none of the presses fits on the body", self.design), Some(FEWER)));
        }
        let progress = Progress::new("pressing", experiment.frame_count());
        let summary = experiment.write(&design, self.seed, &folder.path(), || progress.step())?;
        drop(progress);
        folder.finish().map_err(|error| not_made(&self.output, &error))?;
        self.warn_of_missing(&summary, &sizes);
        if self.json { print_json(&summary) } else { print(&self.summary(&summary)) }
    }

    /// The number of frames of each set on a skin with some pixels.
    fn sizes(&self, pixels: usize) -> Sizes {
        let all = Sizes::default();
        let most = self.presses.unwrap_or(usize::MAX);
        let of = |set: SetName, frames: usize| if self.sets.contains(&set) { frames.min(most) } else { 0 };
        let grid = of(SetName::Grid, pixels);
        // As many pairs at each distance; fewer pairs than distances are at the first ones.
        let pairs = of(SetName::Two, all.pairs * all.separations_m.len());
        let distances = all.separations_m.len().min(pairs);
        Sizes {
            grid_step: if grid == 0 { 0 } else { pixels.div_ceil(grid) },
            random: of(SetName::Random, all.random),
            pairs: pairs.checked_div(distances).unwrap_or(0),
            fours: of(SetName::Four, all.fours),
            touches: self.touches.unwrap_or(all.touches),
            apart_m: self.apart.unwrap_or(all.apart_m),
            separations_m: all.separations_m[..distances].to_vec(),
        }
    }

    /// Warns of sets with fewer frames than were asked for.
    fn warn_of_missing(&self, summary: &ExperimentSummary, sizes: &Sizes) {
        let asked = [("two", sizes.pairs * sizes.separations_m.len()), ("four", sizes.fours), ("several", sizes.fours)];
        for set in &summary.sets {
            let missing = asked.iter().find(|(name, frames)| *name == set.name && *frames > set.frames);
            if let Some((name, frames)) = missing {
                warn(&format!(
                    "the set `{name}` has {} of {frames} frames: the body has no room for touches so far apart; {FEWER}",
                    set.frames
                ));
            }
        }
    }

    fn summary(&self, summary: &ExperimentSummary) -> String {
        let mut table = Table::new(&["set", "frames", "touches", "forces, N", "median change"]);
        for set in summary.sets.iter().filter(|set| set.frames > 0) {
            table.row([
                set.name.to_string(),
                set.frames.to_string(),
                set.touches.to_string(),
                format!("{:.2} to {:.2}", set.least_force_n, set.greatest_force_n),
                format!("{:.2} %", 100.0 * set.median_change),
            ]);
        }
        let mut text = format!(
            "{}: twin `{}` of {} (seed {}), a mesh of {} nodes\n\n{}\n",
            self.output.display(),
            summary.twin.name,
            summary.design,
            summary.seed,
            summary.mesh_nodes,
            table.to_text(),
        );
        if let Some(set) = summary.sets.iter().find(|set| set.frames > 0) {
            let folder = self.output.join(set.name);
            text += &format!(
                "\nscore it: dermis evaluate {} --frames {1}/frames.npy --baseline {1}/baseline.npy --truth {1}/truth.csv\n",
                self.design,
                folder.display()
            );
        }
        text
    }
}

/// A new folder for a place that is free, or an empty folder.
fn new_folder(path: &Path) -> Outcome<NewFolder> {
    let taken = std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some()) || path.is_file();
    if taken {
        let message = format!("{} exists and is not empty", path.display());
        return Err(Failure::given(message, Some("give another folder with -o, or remove this one")));
    }
    let folder = folder_of(path);
    std::fs::create_dir_all(folder).map_err(|error| not_made(folder, &error))?;
    NewFolder::beside(path).map_err(|error| not_made(path, &error))
}

fn not_made(path: &Path, error: &std::io::Error) -> Failure {
    Failure::given(format!("the folder {} cannot be created: {error}", path.display()), None)
}
