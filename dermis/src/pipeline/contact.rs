//! The tracked contact: the schema of contacts in JSON.

use crate::contact::FieldKind::{Flag, Number};
use crate::contact::{ConductanceChange, Contact, Field, vector_or_null};
use crate::detect::centres;
use crate::image::Image;
use crate::pipeline::settings::Settings;
use crate::pipeline::timestamp::Timestamp;
use crate::track::Tracked;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A contact tracked from frame to frame. This is the schema of contacts in JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct TrackedContact {
    /// The contact with its permanent id.
    #[serde(flatten)]
    pub contact: Contact,
    /// Centre of the area where the image exceeds half of the contact's peak, m.
    #[serde(deserialize_with = "vector_or_null")]
    pub centroid_m: [f64; 3],
    /// Mean position weighted by the image, m.
    #[serde(deserialize_with = "vector_or_null")]
    pub centre_of_pressure_m: [f64; 3],
    /// Velocity along the surface, m/s.
    #[serde(deserialize_with = "vector_or_null")]
    pub velocity_m_s: [f64; 3],
    /// Whether it is separate in the image of this frame. If not (merged with another contact, or missing for a few
    /// frames), the position is the predicted one, and strength and force are the last measured.
    pub seen: bool,
    /// Start time of the contact.
    pub since: Timestamp,
    /// Time since its start, s.
    pub age_s: f64,
    /// The zone that contains it, if zones are defined.
    pub zone: Option<String>,
}

impl TrackedContact {
    /// The fields that tracking adds to [those of a contact](Contact::FIELDS).
    pub const FIELDS: [Field<Self>; 6] = [
        Field::new(
            "centroid_m",
            &["centroid_x_m", "centroid_y_m", "centroid_z_m"],
            &["cx", "cy", "cz"],
            Number,
            |tracked| tracked.centroid_m,
        ),
        Field::new(
            "centre_of_pressure_m",
            &["centre_of_pressure_x_m", "centre_of_pressure_y_m", "centre_of_pressure_z_m"],
            &["px", "py", "pz"],
            Number,
            |tracked| tracked.centre_of_pressure_m,
        ),
        Field::new(
            "velocity_m_s",
            &["velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s"],
            &["vx", "vy", "vz"],
            Number,
            |tracked| tracked.velocity_m_s,
        ),
        Field::new("seen", &["seen"], &["seen"], Flag, |tracked| [f64::from(u8::from(tracked.seen)); 3]),
        Field::new("since", &["since_s"], &[], Number, |tracked| [tracked.since.seconds(); 3]),
        Field::new("age_s", &["age_s"], &["age"], Number, |tracked| [tracked.age_s; 3]),
    ];

    /// From the tracker's contact and the image of a frame that was measured at `now`. `positive`: the change of conductance
    /// of a positive image; `start`: the zero of the tracker's clock.
    pub(super) fn new(
        tracked: &Tracked,
        image: &Image,
        positive: ConductanceChange,
        settings: &Settings,
        [start, now]: [Timestamp; 2],
    ) -> Self {
        let Tracked { contact, velocity_m_s, since_s, seen } = *tracked;
        let [centroid_m, centre_of_pressure_m] =
            if seen { centres(image, &contact, positive) } else { [contact.position_m; 2] };
        let since = start.after(Duration::from_secs_f64(since_s.max(0.0)));
        let contact = Contact { edge_m: image.space.edge_distance_m(contact.position_m), ..contact };
        TrackedContact {
            contact,
            centroid_m,
            centre_of_pressure_m,
            velocity_m_s,
            seen,
            since,
            age_s: now.seconds_since(since),
            zone: settings.zone_at(contact.position_m).map(|zone| zone.name.clone()),
        }
    }
}
