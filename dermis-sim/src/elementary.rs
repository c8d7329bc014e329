//! Elementary functions with the same bits on every system.
//!
//! The standard library calls the C library of the system, and C libraries differ in the last bit. Numbers drawn from a
//! seed must not differ: simulation and training use these functions, all of them from the crate `libm`. Square roots,
//! sums and products are exact to the last bit everywhere (IEEE 754) and need no replacement.
//!
//! ```
//! use dermis_sim::elementary::{exp, ln};
//!
//! assert!((exp(ln(2.0)) - 2.0).abs() < 1e-15);
//! ```

mod lanes;

pub use lanes::{Lanes, exp_lanes, powf_lanes, replace_in_lanes};
pub use libm::{
    acos, atan2, cos, erf, erfc, exp, expf as exp_f32, expm1 as exp_m1, hypot, log as ln, log1p as ln_1p, log2,
    pow as powf, powf as powf_f32, sin, sincos as sin_cos, tanh,
};

use dermis::geom::{Elementary, Surface};
use std::f64::consts::PI;

/// The functions of this module as those of a chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Portable;

impl Elementary for Portable {
    fn atan2(y: f64, x: f64) -> f64 {
        atan2(y, x)
    }

    fn sin_cos(angle_rad: f64) -> (f64, f64) {
        sin_cos(angle_rad)
    }

    fn hypot(x: f64, y: f64) -> f64 {
        hypot(x, y)
    }
}

/// A chart with the same bits on every system.
pub type Chart = dermis::geom::Chart<Portable>;

/// The chart of a surface, with the seam opposite to theta = 0: places are up to half a turn from there.
pub fn unrolled(surface: &Surface) -> Chart {
    dermis::geom::Chart::of(surface).with_seam(-PI).with_functions()
}
