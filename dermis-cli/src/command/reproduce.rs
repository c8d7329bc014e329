//! `dermis reproduce`: the paper's sections II to IV on digital twins.

use crate::console::{StudyProgress, print};
use crate::failure::{Failure, Outcome};
use clap::{Args, ValueEnum};
use dermis_study::reproduce::{self, Reproduction};
use std::path::PathBuf;

/// The arguments of `dermis reproduce`.
#[derive(Debug, Args)]
#[command(after_help = "Results are kept in the folder `work` beside the page: a run that was stopped continues from \
    them when it is started again.")]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    #[arg(default_value = "cylinder30")]
    design: String,
    /// Digital twin: the path of a file, or a shipped name (ideal, lab, lab-b, lab-c, harsh).
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    twin: String,
    /// Folder of a network of `dermis train` to compare with the linear methods; may be given more than once. Without
    /// it, scale `paper` trains its own networks and the others use the shipped ones.
    #[arg(long = "method", value_name = "FOLDER")]
    models: Vec<PathBuf>,
    /// Scale of the reproduction.
    #[arg(long, value_enum, default_value = "quick")]
    scale: Scale,
    /// Folder for index.html and report.json.
    #[arg(short, long, value_name = "DIR", default_value = "report")]
    output: PathBuf,
    /// Print the numbers as JSON instead of tables.
    #[arg(long)]
    json: bool,
}

/// Scale of a reproduction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Scale {
    /// One twin and a few dozen presses, in seconds: a preview of the page, not for its figures.
    Glance,
    /// Two twins, the whole grid and a third of everything else; at most five minutes on two cores.
    Quick,
    /// Ten twins, every press of the paper and more.
    Paper,
}

impl Arguments {
    /// Computes the numbers and writes the page.
    pub fn run(self) -> Outcome {
        let program = std::env::current_exe();
        let program =
            program.map_err(|error| Failure::Ours(format!("the path of this program is unknown: {error}")))?;
        let scale = match self.scale {
            Scale::Glance => reproduce::Scale::Glance,
            Scale::Quick => reproduce::Scale::Quick,
            Scale::Paper => reproduce::Scale::Paper,
        };
        let Arguments { design, twin, models, output, .. } = self;
        let output = Reproduction { design, twin, models, scale, output, program }.run(&StudyProgress)?;
        print(if self.json { &output.json } else { &output.text })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_training_step_is_a_command_that_this_program_takes() {
        let work = tempfile::tempdir().unwrap();
        let steps = reproduce::training_steps("cylinder30", "lab", work.path()).unwrap();
        assert_eq!(steps.iter().filter(|step| step.model.is_some()).count(), 2);
        for step in &steps {
            let line = ["dermis".to_string()].into_iter().chain(step.arguments.iter().cloned());
            let parsed = <crate::Arguments as clap::Parser>::try_parse_from(line);
            assert!(parsed.is_ok(), "{}: {}", step.summary(), parsed.unwrap_err());
        }
    }
}
