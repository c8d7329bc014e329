//! Errors of pictures.

use thiserror::Error;

/// Why a picture cannot be made.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum PlotError {
    /// A body that is known only by its mesh has no flat layout.
    #[error("a body that is known only by its mesh cannot be unrolled")]
    NoFlatLayout,
    /// A PNG file that cannot be created: the picture is too large, or it is not valid SVG, which is an internal fault.
    #[cfg(feature = "png")]
    #[error("the picture cannot be rendered: {0}")]
    Render(String),
}
