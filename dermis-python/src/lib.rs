//! Python bindings: the native module `dermis._dermis`.
//!
//! The Python package `dermis` (folder `python/`) names what users see; its stub file documents shapes and units.

#[macro_use]
mod stub_docs {
    include!(concat!(env!("OUT_DIR"), "/docs.rs"));
}

mod arrays;
mod calibration;
mod command;
mod contacts;
mod failure;
mod mesh;
mod method;
mod model;
mod picture;
mod pipeline;
mod robot;
mod samples;
mod simulation;
mod skin;
mod solution;
mod twin;
mod worker;

use pyo3::prelude::*;

/// The native part of `dermis`.
#[pymodule]
mod _dermis {
    #[pymodule_export]
    use super::arrays::Paired;
    #[pymodule_export]
    use super::calibration::Calibration;
    #[pymodule_export]
    use super::command::{commands_json, run_command, run_program};
    #[pymodule_export]
    use super::contacts::contact_columns;
    #[pymodule_export]
    use super::mesh::Mesh;
    #[pymodule_export]
    use super::method::Method;
    #[pymodule_export]
    use super::model::shipped_model;
    #[pymodule_export]
    use super::pipeline::{Frame, Live, Pipeline, Replay};
    #[pymodule_export]
    use super::robot::{Robot, RobotLive};
    #[pymodule_export]
    use super::samples::{Dataset, Samples};
    #[pymodule_export]
    use super::simulation::{Simulation, finish_dataset};
    #[pymodule_export]
    use super::skin::Skin;
    #[pymodule_export]
    use super::solution::Solution;
    #[pymodule_export]
    use super::twin::Twin;

    /// The version of the package.
    #[pymodule_export]
    #[expect(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
