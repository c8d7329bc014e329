//! `dermis demo`: the main job, seen to work.

mod page;
mod presses;
mod tank;

use crate::console::{print, print_json};
use crate::failure::{Failure, Outcome};
use crate::report::Report;
use clap::{Args, ValueEnum};
use dermis::frame::write_whole;
use presses::Demo;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The arguments of `dermis demo`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// What to show.
    #[arg(value_enum, default_value = "presses")]
    what: What,
    /// The page to write; out/demo/index.html or out/demo/tank.html without it.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Seed of the simulated noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print the results as JSON.
    #[arg(long)]
    json: bool,
}

/// What the demo shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum What {
    /// The paper's skin pressed 900 times, simulated.
    Presses,
    /// Real frames of a saline tank with metal and plastic in it.
    Tank,
}

/// A result of the paper, measured on its real skin (900 indentations; Eqs. 11 and 12).
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PaperRow {
    /// Mean localisation error, m.
    pub mean_m: f64,
    /// Its standard deviation, m.
    pub sd_m: f64,
    /// Spread of the sensitivity.
    pub sensitivity_spread: f64,
}

/// Of its linear method.
pub const PAPER_LINEAR: PaperRow = PaperRow { mean_m: 5.5e-3, sd_m: 3.2e-3, sensitivity_spread: 0.45 };
/// Of its network.
pub const PAPER_NETWORK: PaperRow = PaperRow { mean_m: 5.2e-3, sd_m: 3.3e-3, sensitivity_spread: 0.39 };

impl Arguments {
    /// Does the main job, prints what came of it and writes a page with the pictures.
    pub fn run(self) -> Outcome {
        let named = |name: &str| self.output.clone().unwrap_or_else(|| Path::new("out/demo").join(name));
        match self.what {
            What::Presses => run_presses(&named("index.html"), self.seed, self.json),
            What::Tank => tank::run(&named("tank.html"), self.json),
        }
    }
}

fn run_presses(output: &Path, seed: u64, json: bool) -> Outcome {
    let demo = Demo::run(seed)?;
    write_page(output, &page::report(&demo)?)?;
    if json {
        return print_json(&Summary { demo: &demo, report: output });
    }
    print(&format!(
        "{}\n{}\n{}\n\nThe report with all pictures: {}\n",
        demo.heading(),
        demo.table().to_text(),
        presses::CAVEAT,
        output.display()
    ))
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
            score: &'a dermis_sim::evaluate::Score,
            simulated: bool,
            seed: u64,
            snr_db: f64,
            touch_amplitude: f64,
            touch_width_m: f64,
            simulation_nodes: usize,
            reconstruction_nodes: usize,
            seconds: f64,
            methods: Vec<&'a dermis_sim::evaluate::Score>,
            paper_linear_measured: PaperRow,
            paper_network_measured: PaperRow,
            report: &'a Path,
        }
        let demo = self.demo;
        Flat {
            score: &demo.first().score,
            simulated: true,
            seed: demo.seed,
            snr_db: presses::SNR_DB,
            touch_amplitude: presses::AMPLITUDE,
            touch_width_m: presses::WIDTH_M,
            simulation_nodes: demo.simulation_nodes,
            reconstruction_nodes: demo.mesh.node_count(),
            seconds: demo.seconds,
            methods: demo.shown.iter().map(|shown| &shown.score).collect(),
            paper_linear_measured: PAPER_LINEAR,
            paper_network_measured: PAPER_NETWORK,
            report: self.report,
        }
        .serialize(serializer)
    }
}
