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
mod format;
mod frames;
mod guided;
mod latency;
mod method;
mod output;
mod picture;
mod press_report;
mod range;
mod rows;
mod sinks;
mod skin;
mod source;
mod twin;
mod used;
mod written;

pub use console::Verbosity;
pub use described::{DescribedArgument, DescribedCommand};
pub use failure::CommandError;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser};
use std::ffi::OsString;

/// Electrical resistance tomography (ERT) skins for robots: design, simulation, reconstruction, live contacts.
#[derive(Debug, Parser)]
#[command(
    name = "dermis",
    version,
    about = "Electrical resistance tomography (ERT) skins for robots: design, simulation, reconstruction, live contacts",
    after_long_help = "`dermis COMMAND --help` explains a command. DESIGN is the path of a design file or a shipped name: \
    cylinder30, skin16, tank16.\nExit codes: 0 success, 2 invalid input, 1 internal error.

Examples:
  dermis demo                                    simulated presses on a shipped skin, with a report
  dermis new disk --electrodes 12 -o skin.toml   a design of your own
  dermis plot skin.toml -o skin.svg              a picture of it
  dermis forward skin.toml -o untouched.csv      frames of it, simulated
  dermis contacts skin.toml --frames frames.csv --baseline untouched.csv -o -
  dermis live skin.toml                          the skin live in the browser, emulated
From Python: `pip install ./dermis-python`, then `import dermis`."
)]
struct Arguments {
    #[command(flatten)]
    verbosity: Verbosity,
    #[command(subcommand)]
    command: command::Command,
}

/// The program as declared, with its commands in groups.
fn program() -> clap::Command {
    let program = Arguments::command();
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{}Options:\n{{options}}{{after-help}}",
        groups(&program)
    );
    with_negative_numbers(program.help_template(template))
}

/// A number that begins with a minus is no option: its error is that of the value.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let command = command.mut_subcommands(with_negative_numbers);
    command.mut_args(|argument| {
        let takes_value = argument.get_action().takes_values();
        argument.allow_negative_numbers(takes_value)
    })
}

/// The commands in groups, as `--help` shows them.
fn groups(program: &clap::Command) -> String {
    let row = |name: &str| {
        let about = program.find_subcommand(name).and_then(clap::Command::get_about).map(ToString::to_string);
        format!("  {name:<16}{}\n", about.unwrap_or_default())
    };
    let group = |&(title, names): &(&str, &[&str])| {
        format!("{title}:\n{}\n", names.iter().map(|name| row(name)).collect::<String>())
    };
    command::GROUPS.iter().map(group).collect()
}

/// The arguments of a line, as clap reads them.
fn parsed(arguments: impl IntoIterator<Item = OsString>) -> Result<Arguments, clap::Error> {
    let mut program = program();
    let mut matches = program.try_get_matches_from_mut(arguments)?;
    if let Some(message) = written::refusal(&program, &matches) {
        return Err(program.error(ErrorKind::ValueValidation, message));
    }
    Arguments::from_arg_matches_mut(&mut matches).map_err(|error| error.format(&mut program))
}

/// The commands with their arguments.
pub fn commands() -> Vec<DescribedCommand> {
    let mut program = program();
    program.build();
    program
        .get_subcommands()
        .filter(|command| command.get_name() != "help")
        .flat_map(DescribedCommand::all_of)
        .collect()
}

/// Runs the program with its arguments, the first of which is its name; returns the exit code. Help and wrong arguments
/// end the process.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    // A file that reaches a limit of the system is an error of that file, and not the end of the program.
    #[cfg(unix)]
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default());
    let arguments = parsed(arguments).unwrap_or_else(|error| error.exit());
    finish(arguments).map_or_else(failure::Failure::report, |()| 0)
}

/// Runs a command as [`run`] does, for programs that call it: an error is returned, not printed.
///
/// # Errors
/// Wrong arguments, and those of the command.
pub fn try_run(arguments: impl IntoIterator<Item = OsString>) -> Result<(), CommandError> {
    match parsed(arguments) {
        Ok(arguments) => finish(arguments).map_err(CommandError::of_failure),
        // Help and version are no errors.
        Err(text) if !text.use_stderr() => console::print(&text.to_string()).map_err(CommandError::of_failure),
        Err(error) => Err(CommandError::of_arguments(&error)),
    }
}

/// Runs a study: shows its progress, prints its result or its error as a command does, and returns the exit code.
pub fn run_study(
    verbosity: Verbosity,
    study: impl FnOnce(&dyn dermis_study::Progress) -> dermis_study::Result<String>,
) -> u8 {
    guarded(verbosity, || console::print(&study(&console::StudyProgress)?))
        .map_or_else(failure::Failure::report, |()| 0)
}

/// Runs the command.
fn finish(arguments: Arguments) -> failure::Outcome {
    guarded(arguments.verbosity, || arguments.command.run())
}

/// Runs something with a verbosity. A panic is a bug: an internal error, in whichever thread it was.
fn guarded(verbosity: Verbosity, run: impl FnOnce() -> failure::Outcome) -> failure::Outcome {
    verbosity.begin();
    let before = failure::watch_panics();
    match std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)) {
        Ok(Ok(())) if failure::panics() == before => Ok(()),
        Ok(Err(failure)) => Err(failure),
        Ok(Ok(())) | Err(_) => Err(failure::panicked()),
    }
}
