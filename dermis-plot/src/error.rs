//! Errors of pictures.

use thiserror::Error;

/// Why a picture cannot be made.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum PlotError {
    /// A body from a mesh file has no flat layout, unless it is flat.
    #[error("a body from a mesh file cannot be unrolled, unless it lies in a plane across one of the axes")]
    NoFlatLayout,
    /// A PNG file that cannot be created: the picture is too large, or it is not valid SVG, which is an internal fault.
    #[cfg(feature = "png")]
    #[error("the picture cannot be rendered: {0}")]
    Render(String),
}
