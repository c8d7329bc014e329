//! What is wrong with a twin, and how to mend it.

use thiserror::Error;

/// A twin that cannot be built, or a press that it cannot answer.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum TwinError {
    /// A number that no twin can have.
    #[error("`{field}` is {value}: it must be {must} ({fix})")]
    OutOfRange {
        /// The field as it is written in the twin's file.
        field: &'static str,
        /// The value it has.
        value: f64,
        /// The values it may have.
        must: String,
        /// How to mend it.
        fix: String,
    },
}
