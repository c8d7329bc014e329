//! Tests whose result depends on the clock: devices, frames in time, waits. `./check` runs them when nothing else runs.

mod field_cases_live;
mod guided;
mod live;
mod ranges;
mod rows;
mod workplace;
