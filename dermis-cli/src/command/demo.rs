//! `dermis demo`: demonstrations of the complete pipeline.

use crate::console::{StudyProgress, print};
use crate::failure::Outcome;
use crate::range::seed;
use clap::{Args, ValueEnum};
use dermis_study::demo;
use std::path::{Path, PathBuf};

/// The arguments of `dermis demo`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// What to show.
    #[arg(value_enum, default_value = "presses")]
    what: What,
    /// Page to write [default: out/demo/index.html or out/demo/tank.html]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Seed of the simulated noise.
    #[arg(long, default_value_t = 1, value_parser = seed)]
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

impl Arguments {
    /// Runs the demonstration, prints its results and writes its page.
    pub fn run(self) -> Outcome {
        let page = |name: &str| self.output.clone().unwrap_or_else(|| Path::new("out/demo").join(name));
        let output = match self.what {
            What::Presses => demo::presses(&page("index.html"), self.seed, &StudyProgress)?,
            What::Tank => demo::tank(&page("tank.html"))?,
        };
        print(if self.json { &output.json } else { &output.text })
    }
}
