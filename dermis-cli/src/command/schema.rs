//! `dermis schema`: the JSON schemas of design and twin files.

use crate::console::print_json;
use crate::failure::Outcome;
use clap::Args;
use dermis::design::SkinDesign;
use dermis::twin::TwinOptions;

/// The arguments of `dermis schema`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The schema of twin files in place of design files.
    #[arg(long)]
    twin: bool,
}

impl Arguments {
    /// Prints the schema.
    pub fn run(self) -> Outcome {
        print_json(&if self.twin { TwinOptions::json_schema() } else { SkinDesign::json_schema() })
    }
}
