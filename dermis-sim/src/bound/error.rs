//! Errors of bounds.

use dermis::text::counted;
use thiserror::Error;

/// Why a skin has no bounds.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BoundError {
    /// An electrode to be left out that does not exist.
    #[error("there is no electrode {electrode}")]
    NoElectrode {
        /// Its number.
        electrode: usize,
        /// Name of the design.
        design: String,
        /// Number of electrodes of the design.
        count: usize,
    },
    /// Every value uses an electrode that is left out.
    #[error("no value is left")]
    NoValue,
    /// Fewer values than a press has unknowns.
    #[error(
        "the frame does not tell the place of a press anywhere on the skin: it has {}", counted(*values, "value")
    )]
    NoPlace {
        /// Number of values of a frame.
        values: usize,
    },
}

impl BoundError {
    /// What to do.
    pub fn fix(&self) -> String {
        match self {
            BoundError::NoElectrode { design, count, .. } => {
                format!("the electrodes of {design} are 0 to {}", count - 1)
            }
            BoundError::NoValue => "leave out fewer electrodes".into(),
            BoundError::NoPlace { .. } => {
                "read more values: a press has four unknowns, two of its place, its force and its tip".into()
            }
        }
    }
}
