//! A contact as it is reported: the schema of contacts in JSON.

use crate::detect::{Forces, centres};
use crate::image::Image;
use crate::pipeline::settings::Settings;
use crate::pipeline::timestamp::Timestamp;
use crate::track::Tracked;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A contact that is tracked from frame to frame. This is the schema of contacts in JSON; unknown numbers are `null`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct TrackedContact {
    /// Identifier, which lasts as long as the contact and is not used again.
    pub id: u64,
    /// Position on the surface, in the body's frame, m.
    pub position_m: [f64; 3],
    /// Outward unit normal there.
    pub normal: [f64; 3],
    /// Centre of the area where the image exceeds half of the contact's peak, m.
    pub centroid_m: [f64; 3],
    /// Mean position weighted by the image, m.
    pub centre_of_pressure_m: [f64; 3],
    /// Velocity along the surface, m/s.
    pub velocity_m_s: [f64; 3],
    /// Integral of the image over the contact: relative change of conductance (or newtons, of an image of touches) times m2.
    pub strength: f64,
    /// Area where the image exceeds half of the contact's peak, m2.
    pub area_m2: f64,
    /// Normal force on the skin, positive when pressing, N; where the skin or the method is calibrated.
    pub force_n: Option<f64>,
    /// Standard deviation of the force, N.
    pub force_sd_n: Option<f64>,
    /// Standard deviation of the position along the surface, per axis, m.
    pub sd_m: f64,
    /// Probability that a true contact lies within 20 mm.
    pub confidence: f64,
    /// Whether the image of this frame shows it on its own. Where it does not (merged with another contact, or missing for a
    /// few frames), the position is the expected one, and strength and force are the last measured.
    pub seen: bool,
    /// When the contact began.
    pub since: Timestamp,
    /// The zone that it lies in, where zones are defined.
    pub zone: Option<String>,
}

impl TrackedContact {
    /// From the tracker's contact and the image of the frame. `start` is the zero of the tracker's clock.
    pub(super) fn new(
        tracked: &Tracked,
        image: &Image,
        settings: &Settings,
        forces: Option<Forces>,
        start: Timestamp,
    ) -> Self {
        let contact = &tracked.contact;
        let [centroid_m, centre_of_pressure_m] =
            if tracked.seen { centres(image, contact) } else { [contact.position_m; 2] };
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
            force_sd_n: forces.map(|forces| forces.relative_sd * contact.force_n),
            sd_m: contact.sd_m,
            confidence: contact.confidence,
            seen: tracked.seen,
            since: start.after(Duration::from_secs_f64(tracked.since_s.max(0.0))),
            zone: settings.zone_at(contact.position_m).map(|zone| zone.name.clone()),
        }
    }
}
