//! Tests whose result depends on the clock: devices, frames in time, waits, limits of time. `./check` runs them when nothing
//! else runs.

mod bounded;
mod field_cases_live;
mod guided;
#[cfg(feature = "ros2")]
#[path = "../../dermis-live/tests/interpreter/mod.rs"]
mod interpreter;
mod large_files;
mod live;
mod mutated_files;
mod ranges;
mod robot_live;
mod rows;
mod workplace;
