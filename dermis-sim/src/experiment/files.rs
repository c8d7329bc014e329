//! The files of an experiment.

use super::{PaperExperiment, PressSet, Recording, UNTOUCHED_FRAMES, truth};
use crate::twin::TwinOptions;
use crate::twin::electronics::ElectronicsReport;
use dermis::design::SkinDesign;
use dermis::frame::{TableError, write_frames, write_truth, write_whole};
use dermis::stats::upper_median;
use serde::Serialize;
use std::path::Path;

/// The description of an experiment, stored with its frames.
#[derive(Debug, Clone, Serialize)]
pub struct ExperimentSummary {
    /// Version of this program.
    pub dermis: &'static str,
    /// Name of the design.
    pub design: String,
    /// The twin.
    pub twin: TwinOptions,
    /// The seed.
    pub seed: u64,
    /// The mesh of the simulation; never the mesh of the reconstruction.
    pub mesh_hash: String,
    /// Number of its nodes.
    pub mesh_nodes: usize,
    /// Number of untouched frames before each set.
    pub untouched_frames_before_each_set: u64,
    /// Errors of the instrument in untouched frames, before the first press.
    pub electronics: ElectronicsReport,
    /// The sets of presses.
    pub sets: Vec<SetSummary>,
}

/// A set of presses.
#[derive(Debug, Clone, Serialize)]
pub struct SetSummary {
    /// Its name, that of its folder.
    pub name: &'static str,
    /// Number of frames.
    pub frames: usize,
    /// Number of touches.
    pub touches: usize,
    /// Smallest force, N.
    pub least_force_n: f64,
    /// Greatest force, N.
    pub greatest_force_n: f64,
    /// Median of `||frame - baseline|| / ||baseline||` over the values that touch no driven electrode.
    pub median_change: f64,
    /// For two touches, the distance between them in each frame, m.
    pub separations_m: Vec<f64>,
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

impl PaperExperiment {
    /// Records all sets and writes them to a folder: frames, baseline and truth of each, and a description of all
    /// (`experiment.json`). `design` and `seed` are those that the experiment was drawn with; `on_frame` as for
    /// [`record`](PaperExperiment::record).
    ///
    /// ```no_run
    /// use dermis::skin::Skin;
    /// use dermis_sim::experiment::{PaperExperiment, Sizes};
    /// use dermis_sim::twin::TwinOptions;
    ///
    /// let (skin, lab) = (Skin::load("cylinder30")?, TwinOptions::shipped("lab").unwrap());
    /// let drawn = PaperExperiment::draw(skin.design(), skin.mesh(), skin.pixels(), &lab, 1, &Sizes::default())?;
    /// let summary = drawn.write(skin.design(), 1, "experiment".as_ref(), || ())?;
    /// println!("{} presses on the grid", summary.sets[0].touches);
    /// # Ok::<(), dermis_sim::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`record`](PaperExperiment::record); files that cannot be written.
    pub fn write(
        &self,
        design: &SkinDesign,
        seed: u64,
        folder: &Path,
        on_frame: impl Fn() + Sync,
    ) -> crate::Result<ExperimentSummary> {
        let recordings = self.record(on_frame)?;
        let mut sets = Vec::new();
        for (set, recording) in self.sets.iter().zip(recordings.iter()) {
            if !set.presses.is_empty() {
                write_set(&folder.join(set.name), design, set, recording)?;
            }
            sets.push(SetSummary::new(design, set, recording));
        }
        let summary = ExperimentSummary {
            dermis: env!("CARGO_PKG_VERSION"),
            design: design.name.clone(),
            twin: self.twin.options().clone(),
            seed,
            mesh_hash: self.twin.mesh().hash(),
            mesh_nodes: self.twin.mesh().node_count(),
            untouched_frames_before_each_set: UNTOUCHED_FRAMES,
            electronics: self.twin.report(0..UNTOUCHED_FRAMES)?,
            sets,
        };
        let text = serde_json::to_string_pretty(&summary).expect("numbers and texts are JSON");
        write_whole(&folder.join("experiment.json"), |out| writeln!(out, "{text}"))?;
        Ok(summary)
    }
}

/// Frames, baseline and truth of a set, in files that `dermis evaluate` reads.
fn write_set(folder: &Path, design: &SkinDesign, set: &PressSet, recording: &Recording) -> Result<(), TableError> {
    std::fs::create_dir_all(folder).map_err(|source| TableError::Io { path: folder.to_path_buf(), source })?;
    write_frames(&folder.join("frames.npy"), &recording.frames)?;
    write_frames(&folder.join("baseline.npy"), &recording.untouched)?;
    let surface = design.body.surface();
    let truths: Vec<_> = set.presses.iter().map(|presses| truth(&surface, presses)).collect();
    write_truth(&folder.join("truth.csv"), &surface, &truths)
}
