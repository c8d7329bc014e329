//! The program `dermis` and its commands.

use crate::failure::Outcome;
use pyo3::prelude::*;
use std::ffi::OsString;

/// Runs the program `dermis` with its arguments; returns the exit code.
#[pyfunction]
pub fn run_program(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| dermis_cli::run(arguments))
}

/// Runs the program `dermis` with its arguments; an error is raised, not printed.
#[pyfunction]
pub fn run_command(py: Python<'_>, arguments: Vec<OsString>) -> Outcome<()> {
    Ok(py.detach(|| dermis_cli::try_run(arguments))?)
}

/// The commands of the program with their arguments, JSON.
#[pyfunction]
pub fn commands_json() -> String {
    serde_json::to_string(&dermis_cli::commands()).expect("names and texts are JSON")
}
