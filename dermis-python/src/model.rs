//! The files of shipped networks.

use crate::failure::{Failure, Outcome};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// The card (JSON) and the weights (safetensors) of a shipped network.
#[pyfunction]
pub fn shipped_model<'py>(py: Python<'py>, name: &str) -> Outcome<(Bound<'py, PyBytes>, Bound<'py, PyBytes>)> {
    let (card, weights) = dermis_learn::shipped_files(name).ok_or_else(|| {
        Failure::with_hint(
            format!("no network {name:?} is shipped"),
            "give spots, paper or shapes, or the path of a folder",
        )
    })?;
    Ok((PyBytes::new(py, card), PyBytes::new(py, weights)))
}
