//! The program `dermis` as a library, for the Python package, which has the same commands.
//!
//! ```no_run
//! let code = dermis_cli::run(std::env::args_os());
//! # let _ = code;
//! ```

mod build_page;
mod build_watch;
mod channels;
mod check_page;
mod command;
mod console;
mod described;
mod emulated;
mod failure;
mod fitted;
mod frames;
mod guided;
mod latency;
mod method;
mod picture;
mod press_report;
mod range;
mod rows;
mod skin;
mod source;

pub use command::train::losses;
pub use described::{DescribedArgument, DescribedCommand};
pub use failure::CommandError;

use clap::{CommandFactory, Parser};
use dermis_learn::TrainingRunOptions;
use std::ffi::OsString;

/// Electrical resistance tomography (ERT) skins for robots: design, simulation, reconstruction, live contacts.
#[derive(Debug, Parser)]
#[command(
    name = "dermis",
    version,
    about = "Electrical resistance tomography (ERT) skins for robots: design, simulation, reconstruction, live contacts",
    after_help = "DESIGN is the path of a design file or a shipped name: \
    cylinder30, skin16, tank16. Exit codes: 0 success, 2 invalid input, 1 internal error."
)]
struct Arguments {
    #[command(subcommand)]
    command: command::Command,
}

/// The program as declared, for completions and manual pages.
fn program() -> clap::Command {
    Arguments::command()
}

/// The commands with their arguments.
pub fn commands() -> Vec<DescribedCommand> {
    let mut program = program();
    program.build();
    program.get_subcommands().filter(|command| command.get_name() != "help").map(DescribedCommand::of).collect()
}

/// Runs the program with its arguments, the first of which is its name; returns the exit code. Help and wrong arguments
/// end the process.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    finish(Arguments::parse_from(arguments)).map_or_else(failure::Failure::report, |()| 0)
}

/// Runs a command as [`run`] does, for programs that call it: an error is returned, not printed.
///
/// # Errors
/// Wrong arguments, and those of the command.
pub fn try_run(arguments: impl IntoIterator<Item = OsString>) -> Result<(), CommandError> {
    match Arguments::try_parse_from(arguments) {
        Ok(arguments) => finish(arguments).map_err(CommandError::of_failure),
        // Help and version are no errors.
        Err(text) if !text.use_stderr() => console::print(&text.to_string()).map_err(CommandError::of_failure),
        Err(error) => Err(CommandError::of_arguments(&error)),
    }
}

/// The training that arguments of `dermis train` describe, without `dermis` and `train`, for programs that compute the steps
/// themselves.
///
/// # Errors
/// Wrong arguments.
pub fn training_options(arguments: impl IntoIterator<Item = OsString>) -> Result<TrainingRunOptions, CommandError> {
    let line = ["dermis", "train"].into_iter().map(OsString::from).chain(arguments);
    let parsed = Arguments::try_parse_from(line).map_err(|error| CommandError::of_arguments(&error))?;
    let command::Command::Train(arguments) = parsed.command else { unreachable!("the line begins with `train`") };
    arguments.options().map_err(CommandError::of_failure)
}

/// Runs the command. A panic is a bug: an internal error, in whichever thread it was.
fn finish(arguments: Arguments) -> failure::Outcome {
    let before = failure::watch_panics();
    match std::panic::catch_unwind(|| arguments.command.run()) {
        Ok(Ok(())) if failure::panics() == before => Ok(()),
        Ok(Err(failure)) => Err(failure),
        Ok(Ok(())) | Err(_) => Err(failure::panicked()),
    }
}
