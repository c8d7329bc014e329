//! The contact as reported: the schema of contacts in JSON.

use crate::contact::ConductanceChange;
use crate::detect::centres;
use crate::image::Image;
use crate::pipeline::settings::Settings;
use crate::pipeline::timestamp::Timestamp;
use crate::track::Tracked;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A contact tracked from frame to frame. This is the schema of contacts in JSON; unknown numbers are `null`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct TrackedContact {
    /// Identifier, constant while the contact lasts and never used again.
    pub id: u64,
    /// Position on the surface, in the body's frame, m.
    pub position_m: [f64; 3],
    /// Outward unit normal at the position.
    pub normal: [f64; 3],
    /// Centre of the area where the image exceeds half of the contact's peak, m.
    pub centroid_m: [f64; 3],
    /// Mean position weighted by the image, m.
    pub centre_of_pressure_m: [f64; 3],
    /// Velocity along the surface, m/s.
    pub velocity_m_s: [f64; 3],
    /// Integral of the image over the contact: relative change of conductance (or newtons, for images of touches) times
    /// m2.
    pub strength: f64,
    /// Area where the image exceeds half of the contact's peak, m2.
    pub area_m2: f64,
    /// Normal force on the skin, positive when pressing, N; only if the skin or the method is calibrated.
    pub force_n: Option<f64>,
    /// Standard deviation of the force, N; `null` with a force that is a lower bound, because it is larger than the
    /// calibration can tell.
    pub force_sd_n: Option<f64>,
    /// Standard deviation of the position along the surface, per axis, m.
    pub sd_m: f64,
    /// Probability that a true contact is within 20 mm.
    pub confidence: f64,
    /// The sign of the conductance change, if contacts of both signs are looked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conductance: Option<ConductanceChange>,
    /// Whether it is separate in the image of this frame. If not (merged with another contact, or missing for a few
    /// frames), the position is the predicted one, and strength and force are the last measured.
    pub seen: bool,
    /// Start time of the contact.
    pub since: Timestamp,
    /// The zone that contains it, if zones are defined.
    pub zone: Option<String>,
}

impl TrackedContact {
    /// From the tracker's contact and the image of the frame. `positive`: the change of conductance of a positive image;
    /// `start`: the zero of the tracker's clock.
    pub(super) fn new(
        tracked: &Tracked,
        image: &Image,
        positive: ConductanceChange,
        settings: &Settings,
        start: Timestamp,
    ) -> Self {
        let contact = &tracked.contact;
        let [centroid_m, centre_of_pressure_m] =
            if tracked.seen { centres(image, contact, positive) } else { [contact.position_m; 2] };
        let known = |value: f64| Some(value).filter(|value| value.is_finite());
        TrackedContact {
            id: contact.id,
            position_m: contact.position_m,
            normal: contact.normal,
            centroid_m,
            centre_of_pressure_m,
            velocity_m_s: tracked.velocity_m_s,
            strength: contact.strength,
            area_m2: contact.area_m2,
            force_n: known(contact.force_n),
            force_sd_n: known(contact.force_sd_n),
            sd_m: contact.sd_m,
            confidence: contact.confidence,
            conductance: contact.conductance,
            seen: tracked.seen,
            since: start.after(Duration::from_secs_f64(tracked.since_s.max(0.0))),
            zone: settings.zone_at(contact.position_m).map(|zone| zone.name.clone()),
        }
    }
}
