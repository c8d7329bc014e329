//! Tests whose result depends on the clock: devices, frames in time, waits. `./check` runs them when nothing else runs.

mod emulated;
mod handshake;
mod idle_sockets;
mod page;
mod playback;
mod robot_faults;
mod slow_recording;
