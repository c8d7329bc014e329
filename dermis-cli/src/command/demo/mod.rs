//! `dermis demo`: the main job, seen to work.

mod page;
mod presses;

use crate::console::{print, print_json};
use crate::failure::{Failure, Outcome};
use crate::report::Report;
use clap::Args;
use dermis::frame::write_whole;
use presses::Demo;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The arguments of `dermis demo`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The page to write.
    #[arg(short, long, default_value = "out/demo/index.html")]
    output: PathBuf,
    /// Seed of the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print the results as JSON.
    #[arg(long)]
    json: bool,
}

/// The paper's result of its linear method, measured on its real skin (900 indentations; Eqs. 11 and 12).
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PaperRow {
    /// Mean localisation error, m.
    pub mean_m: f64,
    /// Its standard deviation, m.
    pub sd_m: f64,
    /// Spread of the sensitivity.
    pub sensitivity_spread: f64,
}

/// See [`PaperRow`].
pub const PAPER_LINEAR: PaperRow = PaperRow { mean_m: 5.5e-3, sd_m: 3.2e-3, sensitivity_spread: 0.45 };

impl Arguments {
    /// Presses the paper's skin 900 times, prints the score and writes the page.
    pub fn run(self) -> Outcome {
        let demo = Demo::run(self.seed)?;
        write_page(&self.output, &page::report(&demo)?)?;
        if self.json {
            return print_json(&Summary { demo: &demo, report: &self.output });
        }
        print(&format!(
            "{}\n{}\n{}\n\nThe report with all pictures: {}\n",
            demo.heading(),
            demo.table().to_text(),
            presses::CAVEAT,
            self.output.display()
        ))
    }
}

/// Writes a page, with the folder that holds it.
fn write_page(path: &Path, report: &Report) -> Outcome {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(|error| {
            let message = format!("the folder {} cannot be made: {error}", folder.display());
            Failure::given(message, Some("choose another place with -o"))
        })?;
    }
    Ok(write_whole(path, |writer| writer.write_all(report.to_html().as_bytes()))?)
}

struct Summary<'a> {
    demo: &'a Demo,
    report: &'a Path,
}

impl Serialize for Summary<'_> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Flat<'a> {
            #[serde(flatten)]
            score: &'a dermis::evaluate::Score,
            simulated: bool,
            seed: u64,
            snr_db: f64,
            touch_amplitude: f64,
            touch_width_m: f64,
            simulation_nodes: usize,
            reconstruction_nodes: usize,
            seconds: f64,
            paper_linear_measured: PaperRow,
            report: &'a Path,
        }
        let demo = self.demo;
        Flat {
            score: &demo.score,
            simulated: true,
            seed: demo.conditions.seed,
            snr_db: demo.conditions.snr_db,
            touch_amplitude: presses::AMPLITUDE,
            touch_width_m: presses::WIDTH_M,
            simulation_nodes: demo.simulation_nodes,
            reconstruction_nodes: demo.mesh.node_count(),
            seconds: demo.seconds,
            paper_linear_measured: PAPER_LINEAR,
            report: self.report,
        }
        .serialize(serializer)
    }
}
