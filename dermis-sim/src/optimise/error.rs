//! Errors of an optimisation.

use dermis::geom::Point3;
use std::path::PathBuf;
use thiserror::Error;

/// Why a design cannot be optimised.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum OptimiseError {
    /// The body is filled with conductor.
    #[error("the conductor fills the body: electrodes are placed on coatings only (give `sheet_resistance_ohm`)")]
    Volume,
    /// The electrodes are groups of a mesh file.
    #[error(
        "the electrodes are groups of a mesh file, which cannot be moved: give them as `positions` with a disc as `shape`"
    )]
    Groups,
    /// Arcs that must keep a distance from the edge.
    #[error(
        "arcs lie on the edge of the body, and keep no distance from it: leave it out, or give the electrodes discs as `shape`"
    )]
    EdgeOfArcs,
    /// No place obeys the rules.
    #[error(
        "no place is left for an electrode: {zones} forbidden zones and {edge_m} m from the edge leave nothing of the body; \
         make the zones smaller or the distance shorter"
    )]
    NoPlace {
        /// Number of forbidden zones.
        zones: usize,
        /// Least distance from the edge, m.
        edge_m: f64,
    },
    /// Fewer places than electrodes.
    #[error(
        "only {fitting} of {wanted} electrodes fit on the body, {distance_m} m apart and outside the forbidden zones: ask \
         for fewer electrodes or a shorter distance"
    )]
    TooFewPlaces {
        /// Electrodes that fit.
        fitting: usize,
        /// Electrodes wanted.
        wanted: usize,
        /// Least distance of two centres, m.
        distance_m: f64,
    },
    /// The least distance of two centres makes electrodes overlap.
    #[error("electrodes {distance_m} m apart overlap: they are {size_m} m across; give a longer distance")]
    Overlap {
        /// Least distance of two centres, m.
        distance_m: f64,
        /// Extent of an electrode, m.
        size_m: f64,
    },
    /// A pattern without enough values.
    #[error(
        "{slots} readings are fewer than the unknowns of a press: its place, force and width need at least {least}, the \
         reading of a current included"
    )]
    TooFewSlots {
        /// Readings wanted.
        slots: usize,
        /// Least number.
        least: usize,
    },
    /// A pattern with more readings than the protocol has.
    #[error("{slots} readings, but the protocol has only {most} with those of its currents: ask for fewer")]
    TooManySlots {
        /// Readings wanted.
        slots: usize,
        /// Readings of the whole protocol.
        most: usize,
    },
    /// A file that is no state of this search.
    #[error("{}: {why}", path.display())]
    State {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
        /// What to do.
        fix: &'static str,
    },
    /// A place that no method can find.
    #[error(
        "no bound exists at {place_m:?} m: no current of the protocol reaches it, or too few readings change; check that \
         the body is in one piece and that electrodes may lie near it"
    )]
    NoCurrent {
        /// The place.
        place_m: Point3,
    },
}

impl OptimiseError {
    /// What to do, where the message does not say it.
    pub fn fix(&self) -> Option<&'static str> {
        match self {
            OptimiseError::State { fix, .. } => Some(fix),
            _ => None,
        }
    }
}
