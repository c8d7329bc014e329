//! The program `dermis`.

use std::process::ExitCode;

fn main() -> ExitCode {
    dermis_cli::run(std::env::args_os()).into()
}
