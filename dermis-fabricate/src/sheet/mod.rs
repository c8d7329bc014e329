//! Sheets for cutters: outlines in layers, as SVG and DXF.

use crate::error::FabricateError;
use crate::folder::OutputFile;
use crate::model::Fabrication;

/// A text with the characters that XML reserves written as entities.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// The cut patterns.
///
/// # Errors
/// None yet.
pub fn files(_fabrication: &Fabrication) -> Result<Vec<OutputFile>, FabricateError> {
    Ok(Vec::new())
}
