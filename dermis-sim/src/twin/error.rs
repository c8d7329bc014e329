//! Errors of digital twins.

use dermis::geom::Point3;
use thiserror::Error;

/// A twin that cannot be built, or a press that it cannot simulate.
#[derive(Debug, Error, Clone, PartialEq)]
#[non_exhaustive]
pub enum TwinError {
    /// A number that is invalid for a twin.
    #[error("`{field}` is {value}: it must be {must} ({fix})")]
    OutOfRange {
        /// The field as written in the twin's file.
        field: &'static str,
        /// Its value.
        value: f64,
        /// The allowed values.
        must: String,
        /// The fix.
        fix: String,
    },
    /// Patches that do not fit on the body.
    #[error(
        "`patches.{count_field}` = {count} patches of `pitch_m` {pitch_m} m take {taken_m:.4} m, but the body has \
         {size_m:.4} m there: {fix}"
    )]
    PatchesMisfit {
        /// "rows" or "columns".
        count_field: &'static str,
        /// Their number.
        count: usize,
        /// Distance from one to the next, m.
        pitch_m: f64,
        /// Their total size, m.
        taken_m: f64,
        /// The available size on the body, m.
        size_m: f64,
        /// The fix.
        fix: String,
    },
    /// A body without rows and columns.
    #[error(
        "patches lie in rows and columns, which a body known only by a mesh file does not have (use a cylinder, a \
         rectangle or a disk, or Gaussian touches)"
    )]
    NoChart,
    /// A fault of an electrode that the skin does not have.
    #[error("`{field}` names electrode {electrode}, but the skin has electrodes 0 to {}", electrode_count - 1)]
    NoSuchElectrode {
        /// The field as written in the twin's file.
        field: &'static str,
        /// The electrode.
        electrode: usize,
        /// Number of electrodes of the skin.
        electrode_count: usize,
    },
    /// A cut on a body without a chart.
    #[error("`faults.cuts` needs a cylinder, a disk or a rectangle, but the body is a mesh file (leave the cuts out)")]
    CutOnMesh,
    /// Displaced electrodes that are parts of a mesh file.
    #[error(
        "`electrodes.displacement_rms_m` cannot move electrodes that are groups of a mesh file (write 0, or place \
         electrodes by position)"
    )]
    GroupsStay,
    /// A press that does not touch the skin.
    #[error("a press at {centre_m:?} m is not on the skin, {skin}")]
    OffTheSkin {
        /// The position of the press.
        centre_m: Point3,
        /// The position of the skin.
        skin: String,
    },
    /// A tip whose indentation exceeds the foam thickness.
    #[error(
        "a force of {force_n} N on a tip of radius {tip_radius_m} m sinks {depth_mm:.2} mm into foam of \
         {thickness_mm} mm (press less, with a larger tip, or through thicker or stiffer foam: `foam.thickness_m`, \
         `foam.modulus_pa`)"
    )]
    FoamCrushed {
        /// The force, N.
        force_n: f64,
        /// Radius of the tip, m.
        tip_radius_m: f64,
        /// The indentation depth, mm.
        depth_mm: f64,
        /// Thickness of the foam, mm.
        thickness_mm: f64,
    },
}

impl TwinError {
    /// The wrong field as written in the twin's file, if the error is in one field.
    pub fn field(&self) -> Option<&'static str> {
        match self {
            TwinError::OutOfRange { field, .. } | TwinError::NoSuchElectrode { field, .. } => Some(field),
            TwinError::CutOnMesh => Some("faults.cuts"),
            TwinError::GroupsStay => Some("electrodes.displacement_rms_m"),
            TwinError::PatchesMisfit { count_field, .. } => Some(count_field),
            TwinError::NoChart => Some("touch"),
            TwinError::OffTheSkin { .. } | TwinError::FoamCrushed { .. } => None,
        }
    }
}

/// # Errors
/// A value that is not positive and finite.
pub(super) fn check_positive(field: &'static str, value: f64, fix: &str) -> Result<(), TwinError> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(TwinError::OutOfRange { field, value, must: "positive and finite".into(), fix: fix.into() })
}

/// # Errors
/// A value outside a closed range.
pub(super) fn check_between(
    field: &'static str,
    value: f64,
    [low, high]: [f64; 2],
    fix: &str,
) -> Result<(), TwinError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(TwinError::OutOfRange { field, value, must: format!("from {low} to {high}"), fix: fix.into() })
}
