//! `dermis experiment`: the paper's indentation experiment on a digital twin.

use crate::console::{Progress, print, print_json};
use crate::failure::{Failure, Outcome};
use crate::range::seed;
use clap::Args;
use dermis::design::SkinDesign;
use dermis::files::NewFolder;
use dermis::frame::{write_frames, write_truth, write_whole};
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis::stats::upper_median;
use dermis_plot::report::Table;
use dermis_sim::experiment::{PaperExperiment, PressSet, Recording, Sizes, UNTOUCHED_FRAMES, truth};
use dermis_sim::twin::TwinOptions;
use dermis_sim::twin::electronics::ElectronicsReport;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The arguments of `dermis experiment`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Digital twin: the path of a file, or a shipped name (ideal, lab, lab-b, lab-c, harsh).
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    twin: String,
    /// Seed of the twin, the presses and the noise.
    #[arg(long, value_name = "S", value_parser = seed)]
    seed: u64,
    /// Folder to write; it must not exist, or be empty.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
}

/// The description of an experiment, stored with its frames.
#[derive(Debug, Serialize)]
struct Summary {
    dermis: &'static str,
    design: String,
    twin: TwinOptions,
    seed: u64,
    /// The mesh of the simulation; never the mesh of the reconstruction.
    mesh_hash: String,
    mesh_nodes: usize,
    untouched_frames_before_each_set: u64,
    /// Errors of the instrument in untouched frames, before the first press.
    electronics: ElectronicsReport,
    sets: Vec<SetSummary>,
}

/// A set of presses.
#[derive(Debug, Serialize)]
struct SetSummary {
    name: &'static str,
    frames: usize,
    touches: usize,
    least_force_n: f64,
    greatest_force_n: f64,
    /// Median of `||frame - baseline|| / ||baseline||` over the values that touch no driven electrode.
    median_change: f64,
    /// For two touches, the distance between them in each frame, m.
    separations_m: Vec<f64>,
}

impl Arguments {
    /// Simulates the presses and writes the frames.
    pub fn run(self) -> Outcome {
        let design = SkinDesign::load(&self.design)?;
        let options = TwinOptions::load(&self.twin)?;
        let folder = new_folder(&self.output)?;
        let summary = self.record(&design, &options, &folder.path())?;
        let text = serde_json::to_string_pretty(&summary).map_err(|error| Failure::Ours(error.to_string()))?;
        write_whole(&folder.path().join("experiment.json"), |out| writeln!(out, "{text}"))?;
        folder.finish().map_err(|error| not_made(&self.output, &error))?;
        if self.json { print_json(&summary) } else { print(&self.summary(&summary)) }
    }

    fn record(&self, design: &SkinDesign, options: &TwinOptions, folder: &Path) -> Outcome<Summary> {
        let mesh = Mesh::generate(design)?;
        let pixels = PixelSpace::for_design(design, &mesh)?;
        let experiment = {
            let _waiting = Progress::waiting("preparing the twin");
            PaperExperiment::draw(design, &mesh, &pixels, options, self.seed, &Sizes::default())?
        };
        let progress = Progress::new("pressing", experiment.frame_count());
        let recordings = experiment.record(|| progress.step())?;
        drop(progress);
        let mut summaries = Vec::new();
        for (set, recording) in experiment.sets.iter().zip(recordings.iter()) {
            write_set(&folder.join(set.name), design, set, recording)?;
            summaries.push(SetSummary::new(design, set, recording));
        }
        let twin = &experiment.twin;
        Ok(Summary {
            dermis: env!("CARGO_PKG_VERSION"),
            design: design.name.clone(),
            twin: twin.options().clone(),
            seed: self.seed,
            mesh_hash: twin.mesh().hash(),
            mesh_nodes: twin.mesh().node_count(),
            untouched_frames_before_each_set: UNTOUCHED_FRAMES,
            electronics: twin.report(0..UNTOUCHED_FRAMES)?,
            sets: summaries,
        })
    }

    fn summary(&self, summary: &Summary) -> String {
        let mut table = Table::new(&["set", "frames", "touches", "forces, N", "median change"]);
        for set in &summary.sets {
            if set.frames == 0 {
                table.row([set.name, "0", "0", "", ""].map(String::from));
                continue;
            }
            table.row([
                set.name.to_string(),
                set.frames.to_string(),
                set.touches.to_string(),
                format!("{:.2} to {:.2}", set.least_force_n, set.greatest_force_n),
                format!("{:.2} %", 100.0 * set.median_change),
            ]);
        }
        format!(
            "{}: twin `{}` of {} (seed {}), a mesh of {} nodes\n\n{}\n\nscore it: dermis evaluate {} --frames {}/grid/frames.npy --baseline \
             {}/grid/baseline.npy --truth {}/grid/truth.csv\n",
            self.output.display(),
            summary.twin.name,
            summary.design,
            summary.seed,
            summary.mesh_nodes,
            table.to_text(),
            self.design,
            self.output.display(),
            self.output.display(),
            self.output.display(),
        )
    }
}

/// Frames, baseline and truth of a set, in files that `dermis evaluate` reads.
fn write_set(folder: &Path, design: &SkinDesign, set: &PressSet, recording: &Recording) -> Outcome {
    make_folder(folder)?;
    write_frames(&folder.join("frames.npy"), &recording.frames)?;
    write_frames(&folder.join("baseline.npy"), &recording.untouched)?;
    let surface = design.body.surface();
    let truths: Vec<_> = set.presses.iter().map(|presses| truth(&surface, presses)).collect();
    Ok(write_truth(&folder.join("truth.csv"), &surface, &truths)?)
}

impl SetSummary {
    fn new(design: &SkinDesign, set: &PressSet, recording: &Recording) -> Self {
        let (protocol, baseline) = (&design.protocol, &recording.baseline);
        let rest = protocol.undriven_rms(baseline);
        let changes: Vec<f64> =
            recording.frames.iter().map(|frame| protocol.undriven_rms(&(frame - baseline)) / rest).collect();
        let forces = || set.presses.iter().flatten().map(|press| press.force_n);
        SetSummary {
            name: set.name,
            frames: set.presses.len(),
            touches: forces().count(),
            least_force_n: forces().fold(f64::INFINITY, f64::min),
            greatest_force_n: forces().fold(0.0, f64::max),
            median_change: upper_median(&changes).unwrap_or(f64::NAN),
            separations_m: set.separations_m.clone(),
        }
    }
}

/// A new folder for a place that is free, or an empty folder.
fn new_folder(path: &Path) -> Outcome<NewFolder> {
    let taken = std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some()) || path.is_file();
    if taken {
        let message = format!("{} exists and is not empty", path.display());
        return Err(Failure::given(message, Some("give another folder with -o, or remove this one")));
    }
    path.parent().map_or(Ok(()), make_folder)?;
    NewFolder::beside(path).map_err(|error| not_made(path, &error))
}

fn make_folder(path: &Path) -> Outcome {
    std::fs::create_dir_all(path).map_err(|error| not_made(path, &error))
}

fn not_made(path: &Path, error: &std::io::Error) -> Failure {
    Failure::given(format!("the folder {} cannot be created: {error}", path.display()), None)
}
