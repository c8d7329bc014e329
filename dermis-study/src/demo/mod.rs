//! Demonstrations: 900 simulated presses on the paper's skin, and a real tank.
//!
//! ```no_run
//! let output = dermis_study::demo::presses("demo.html".as_ref(), 1, &())?;
//! println!("{}", output.text);
//! # Ok::<(), dermis_study::Error>(())
//! ```

mod page;
mod presses;
mod tank;

use crate::to_json;
use crate::{Error, Progress, Result, StudyOutput};
use dermis_plot::report::Report;
use dermis_sim::evaluate::Score;
use presses::Demo;
use serde::Serialize;
use std::path::Path;

/// A result in the paper, measured on its real skin (900 indentations; Eqs. 11 and 12).
#[derive(Debug, Clone, Copy, Serialize)]
struct PaperRow {
    /// Mean localisation error, m.
    mean_m: f64,
    /// Its standard deviation, m.
    sd_m: f64,
    /// Spread of the sensitivity.
    sensitivity_spread: f64,
}

/// Result of its linear method.
const PAPER_LINEAR: PaperRow = PaperRow { mean_m: 5.5e-3, sd_m: 3.2e-3, sensitivity_spread: 0.45 };
/// Result of its network.
const PAPER_NETWORK: PaperRow = PaperRow { mean_m: 5.2e-3, sd_m: 3.3e-3, sensitivity_spread: 0.39 };

/// Simulates a press on every pixel of the paper's skin and a final frame with four touches, and writes the report
/// page.
///
/// # Errors
/// A page that cannot be written.
pub fn presses(output: &Path, seed: u64, progress: &dyn Progress) -> Result<StudyOutput> {
    let demo = Demo::run(seed, progress)?;
    write_page(output, &page::report(&demo)?)?;
    let text = format!(
        "{}\n{}\n{}\n\nThe report with all pictures: {}\n",
        demo.heading(),
        demo.table().to_text(),
        presses::CAVEAT,
        output.display()
    );
    Ok(StudyOutput { text, json: to_json(&Summary::of(&demo, output))? })
}

/// Localises the objects in recordings of a real saline tank, and writes the report page.
///
/// # Errors
/// A page that cannot be written.
pub fn tank(output: &Path) -> Result<StudyOutput> {
    tank::run(output)
}

/// Writes a page and creates its folder.
fn write_page(path: &Path, report: &Report) -> Result<()> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(|source| Error::Folder { folder: folder.to_path_buf(), source })?;
    }
    Ok(report.write(path)?)
}

/// The demonstration as JSON.
#[derive(Serialize)]
struct Summary<'a> {
    #[serde(flatten)]
    score: &'a Score,
    simulated: bool,
    seed: u64,
    twin: &'static str,
    force_n: f64,
    simulation_nodes: usize,
    reconstruction_nodes: usize,
    seconds: f64,
    methods: Vec<&'a Score>,
    paper_linear_measured: PaperRow,
    paper_network_measured: PaperRow,
    report: &'a Path,
}

impl<'a> Summary<'a> {
    fn of(demo: &'a Demo, report: &'a Path) -> Self {
        Summary {
            score: &demo.first().score,
            simulated: true,
            seed: demo.seed,
            twin: presses::TWIN,
            force_n: presses::FORCE_N,
            simulation_nodes: demo.simulation_nodes,
            reconstruction_nodes: demo.skin.mesh().node_count(),
            seconds: demo.seconds,
            methods: demo.shown.iter().map(|shown| &shown.score).collect(),
            paper_linear_measured: PAPER_LINEAR,
            paper_network_measured: PAPER_NETWORK,
            report,
        }
    }
}
