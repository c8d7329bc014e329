//! NPZ files in a build without support for them.

use crate::frame::complex::Part;
use crate::frame::npy::Array;
use std::io::Write;

const WITHOUT: &str = "NPZ files need the feature `npz` of the crate `dermis`; NPY files do not";

pub(super) fn read_npz(_: &[u8], _: &str, _: Option<Part>) -> Result<Array, String> {
    Err(WITHOUT.into())
}

pub(super) fn write_npz(_: &mut dyn Write, _: &str, _: &[usize], _: &[f64]) -> std::io::Result<()> {
    Err(std::io::Error::new(std::io::ErrorKind::Unsupported, WITHOUT))
}
