//! The commands: each a module with its arguments and what it does with them.

mod new;
mod schema;

use crate::failure::Outcome;
use clap::Subcommand;

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write a commented design file to start from.
    New(new::Arguments),
    /// Print the JSON schema of design files.
    Schema,
}

impl Command {
    /// Does it.
    pub fn run(self) -> Outcome {
        match self {
            Command::New(arguments) => arguments.run(),
            Command::Schema => schema::run(),
        }
    }
}
