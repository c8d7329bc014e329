//! The integration tests of the crate.

mod kinematics;
mod robot;
