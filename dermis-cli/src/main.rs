//! The program `dermis`.

mod calibrated;
mod channels;
mod check_page;
mod command;
mod console;
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

use clap::{CommandFactory, Parser};
use std::process::ExitCode;

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

fn main() -> ExitCode {
    failure::watch_panics();
    let arguments = Arguments::parse();
    // A panic is a bug: exit code 1, as for every internal error, in whichever thread it was.
    match std::panic::catch_unwind(|| arguments.command.run()) {
        Ok(Ok(())) if !failure::has_panicked() => ExitCode::SUCCESS,
        Ok(Err(failure)) => failure.report(),
        Ok(Ok(())) | Err(_) => failure::report_panic(),
    }
}
