//! `dermis schema`: the JSON schemas of design and twin files, scripts, live frames and robots.

use crate::console::print_json;
use crate::failure::Outcome;
use clap::Args;
use dermis::design::SkinDesign;
use dermis_emulate::emulator::Script;
use dermis_live::robot::RobotOutput;
use dermis_live::sinks::jsonl::FrameLine;
use dermis_sim::twin::TwinOptions;

/// The arguments of `dermis schema`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Schema of twin files instead of design files.
    #[arg(long)]
    twin: bool,
    /// Schema of touch scripts of `dermis emulate`.
    #[arg(long, conflicts_with = "twin")]
    touch: bool,
    /// Schema of a line of `dermis live --jsonl`.
    #[arg(long, conflicts_with_all = ["twin", "touch"])]
    jsonl: bool,
    /// Schema of a line of `dermis robot run --jsonl -`.
    #[arg(long, conflicts_with_all = ["twin", "touch", "jsonl"])]
    robot: bool,
}

impl Arguments {
    /// Prints the schema.
    pub fn run(self) -> Outcome {
        print_json(&match self {
            Arguments { twin: true, .. } => TwinOptions::json_schema(),
            Arguments { touch: true, .. } => Script::json_schema(),
            Arguments { jsonl: true, .. } => FrameLine::json_schema(),
            Arguments { robot: true, .. } => RobotOutput::json_schema(),
            _ => SkinDesign::json_schema(),
        })
    }
}
