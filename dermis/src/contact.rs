//! A place where something touches the skin: one type for truth and estimate.

use crate::geom::Point3;
use serde::{Deserialize, Serialize};

/// One place where something touches the skin, true or estimated.
///
/// A quantity that is not known is `NaN` (truths have no spread, uncalibrated estimates no force).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// Number of the contact, unique within its frame; it stays while the contact lasts once contacts are tracked.
    pub id: u64,
    /// Position on the surface, in the body's frame, m.
    pub position_m: Point3,
    /// Outward unit normal there.
    pub normal: Point3,
    /// Integral of the image over the contact: relative change of conductance times area, m2.
    pub strength: f64,
    /// Area where the image exceeds half of the contact's peak, m2.
    pub area_m2: f64,
    /// Normal force on the skin, positive when pressing, N.
    pub force_n: f64,
    /// Standard deviation of the position along the surface, per axis, m.
    pub sd_m: f64,
    /// Probability that a true contact lies within 20 mm.
    pub confidence: f64,
}

impl Contact {
    /// A known touch at a place; what is not known of it is `NaN`.
    pub fn truth(position_m: Point3, normal: Point3, force_n: f64) -> Self {
        Contact {
            id: 0,
            position_m,
            normal,
            strength: f64::NAN,
            area_m2: f64::NAN,
            force_n,
            sd_m: f64::NAN,
            confidence: 1.0,
        }
    }
}
