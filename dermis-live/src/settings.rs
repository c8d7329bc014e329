//! What may be changed while a skin is read, and what a pipeline may be told.

use crate::LiveError;
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::image::PixelSpace;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What may be changed while frames come.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// The method by its name; empty for the best one for the skin.
    pub method: String,
    /// What a contact's signal must exceed, times the method's own.
    pub threshold: f64,
    /// Parts of the skin with a name and a threshold of their own.
    pub zones: Vec<Zone>,
    /// Frames of a tare.
    pub tare_frames: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { method: String::new(), threshold: 1.0, zones: Vec::new(), tare_frames: 100 }
    }
}

/// A part of the skin: what lies in a ball.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Zone {
    /// Its name, which contacts in it carry.
    pub name: String,
    /// Centre of the ball, m.
    pub centre_m: [f64; 3],
    /// Its radius, m.
    pub radius_m: f64,
    /// What a contact's signal there must exceed, times that of the rest of the skin.
    pub threshold: f64,
}

impl Settings {
    /// What is wrong with them on a skin of some pixels.
    ///
    /// # Errors
    /// The setting and its value.
    pub fn check(&self, pixels: &PixelSpace) -> Result<(), LiveError> {
        let possible = |value: f64| value > 0.0 && value <= 1e6;
        if !possible(self.threshold) {
            return Err(LiveError::Given(format!(
                "the threshold is {}: it must be above 0 and at most 1e6",
                self.threshold
            )));
        }
        if !(8..=100_000).contains(&self.tare_frames) {
            let message = format!("a tare of {} frames: it must be from 8 to 100,000", self.tare_frames);
            return Err(LiveError::Given(message));
        }
        for Zone { name, centre_m, radius_m, threshold } in &self.zones {
            let ball = centre_m.iter().all(|value| value.is_finite()) && *radius_m > 0.0;
            if !ball || !possible(*threshold) {
                let must = "its centre must be finite, its radius positive, its threshold above 0 and at most 1e6";
                return Err(LiveError::Given(format!("zone `{name}`: {must}")));
            }
            if !pixels.centres_m.iter().any(|&place| distance(*centre_m, place) <= *radius_m) {
                let box_m = pixels.box_m().map(|[least, most]| format!("{least:.3} to {most:.3}"));
                return Err(LiveError::Given(format!(
                    "zone `{name}` holds nothing of the skin, whose pixels lie from {} m in x, y and z: lengths are in metres",
                    box_m.join(", ")
                )));
            }
        }
        Ok(())
    }

    /// The zone that a place lies in: the first one that holds it.
    pub fn zone_at(&self, place: Point3) -> Option<&Zone> {
        self.zones.iter().find(|zone| distance(zone.centre_m, place) <= zone.radius_m)
    }

    /// What a contact's signal must exceed at a place, times the method's own.
    pub fn threshold_at(&self, place: Point3) -> f64 {
        self.threshold * self.zone_at(place).map_or(1.0, |zone| zone.threshold)
    }

    /// The least threshold anywhere.
    pub fn least(&self) -> f64 {
        self.threshold * self.zones.iter().map(|zone| zone.threshold).fold(1.0, f64::min)
    }
}

/// What a pipeline may be told between two frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Command {
    /// Take the untouched frame anew.
    Tare,
    /// Change the threshold of all contacts.
    Threshold {
        /// Times the method's own.
        value: f64,
    },
    /// Make images otherwise.
    Method {
        /// The method's name.
        name: String,
    },
    /// Name parts of the skin.
    Zones {
        /// All of them.
        zones: Vec<Zone>,
    },
    /// Make the method anew without the channels that are left out now.
    Rebuild,
}
