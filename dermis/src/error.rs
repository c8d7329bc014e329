//! The crate's error: one variant per module.

use thiserror::Error as ThisError;

/// Shorthand for a result with the crate's [`enum@Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// All errors of this crate, by module.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum Error {
    /// A design that cannot be read or cannot be built.
    #[error(transparent)]
    Design(#[from] crate::design::DesignError),
    /// A protocol that does not fit its electrodes.
    #[error(transparent)]
    Protocol(#[from] crate::protocol::ProtocolError),
    /// A table of numbers (frames, conductivities, truths, images) that cannot be read or written.
    #[error(transparent)]
    Table(#[from] crate::frame::TableError),
    /// A mesh that cannot be generated, read or used.
    #[error(transparent)]
    Mesh(#[from] crate::mesh::MeshError),
    /// A forward problem without a solution.
    #[error(transparent)]
    Forward(#[from] crate::forward::ForwardError),
    /// Equations of an estimation that do not determine an unknown.
    #[error("the equations of the estimation have no solution ({0}): check that the values are of an untouched skin")]
    Estimate(#[from] crate::linalg::NotPositiveDefinite),
    /// Frames to which a design cannot be fitted.
    #[error(transparent)]
    Fit(#[from] crate::fit::FitError),
    /// A skin that cannot be identified.
    #[error(transparent)]
    Identify(#[from] crate::identify::IdentifyError),
    /// A skin on which contacts cannot be refined.
    #[error(transparent)]
    Refine(#[from] crate::refine::RefineError),
    /// A reconstruction that cannot be set up or carried out.
    #[error(transparent)]
    Reconstruct(#[from] crate::reconstruct::ReconstructError),
}
