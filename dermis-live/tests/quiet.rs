//! Tests whose result depends on the clock: devices, frames in time, waits. `./check` runs them when nothing else runs.

mod killed;
mod synthetic;
