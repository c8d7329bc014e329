//! Sections II to IV of the paper “An ERT-based Robotic Skin with Sparsely Distributed Electrodes” on digital twins: its
//! figures beside ours, as a page and as JSON.

mod bench;
mod benchmarked;
mod bias;
mod choose;
mod controls;
mod gallery;
mod page;
mod reproduction;
mod results;
mod scale;
mod stage;
mod stated;

use clap::Parser;
use scale::Scale;
use std::path::PathBuf;
use std::process::ExitCode;

/// Reproduce sections II to IV of the paper on digital twins, compare its figures and pictures with the results, and write a
/// report.
#[derive(Debug, Parser)]
#[command(after_help = "Results are kept in the folder `work` beside the page: a run that was stopped continues from \
    them when it is started again.")]
struct Arguments {
    #[command(flatten)]
    verbosity: dermis_cli::Verbosity,
    /// Design: the path of a file, or a shipped name.
    #[arg(default_value = "cylinder30")]
    design: String,
    /// Digital twin: the path of a file, or a shipped name (ideal, lab, lab-b, lab-c, harsh).
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    twin: String,
    /// Folder of a network of `dermis train` to compare with the linear methods, in place of the shipped networks; may be
    /// given more than once.
    #[arg(long = "method", value_name = "FOLDER")]
    models: Vec<PathBuf>,
    /// Scale of the study.
    #[arg(long, value_enum, default_value = "quick")]
    scale: Scale,
    /// Folder for index.html and report.json.
    #[arg(short, long, value_name = "DIR", default_value = "report")]
    output: PathBuf,
    /// Print the numbers as JSON instead of tables.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    dermis_cli::run_study(arguments.verbosity, |progress| {
        let output = arguments.run(progress)?;
        Ok(if arguments.json { output.json } else { output.text })
    })
    .into()
}
