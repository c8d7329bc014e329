//! Settings and commands of a pipeline.

use crate::geom::Point3;
use crate::geom::vector::distance;
use crate::image::PixelSpace;
use crate::method::{Method, MethodSet};
use crate::pipeline::error::PipelineError;
use crate::skin::Skin;
use serde::{Deserialize, Serialize};
use std::num::NonZeroU32;

/// Settings that can change between two frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Name of the method; empty for the default method of the skin.
    pub method: String,
    /// Detection threshold of a contact's signal, relative to the method's own.
    pub threshold: f64,
    /// Zones: parts of the skin with their own name and threshold.
    pub zones: Vec<Zone>,
    /// Number of frames of a tare.
    pub tare_frames: usize,
    /// Whether contacts that raise and contacts that lower the conductance are looked for, each with its
    /// [sign](crate::contact::Contact::conductance). Linear methods only.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub both_signs: bool,
    /// Electrodes that are not used, as if they were disconnected: the channels of each are masked, and its state is open.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub left_out_electrodes: Vec<usize>,
    /// Whether a tare accepts frames that are unlike the model of the design, as differences from the untouched skin, and frames
    /// that are all the same, as those of a simulation without noise. The end of a touch and drift are not told by the model then.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub force_tare: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            method: String::new(),
            threshold: 1.0,
            zones: Vec::new(),
            tare_frames: 100,
            both_signs: false,
            left_out_electrodes: Vec::new(),
            force_tare: false,
        }
    }
}

/// A part of the skin: the part inside a ball.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Zone {
    /// Name, reported with the contacts in the zone.
    pub name: String,
    /// Centre of the ball, m.
    pub centre_m: [f64; 3],
    /// Radius of the ball, m.
    pub radius_m: f64,
    /// Detection threshold in the zone, relative to that of the rest of the skin.
    pub threshold: f64,
}

/// The range of thresholds.
fn is_threshold(value: f64) -> bool {
    (1e-6..=1e6).contains(&value)
}

impl Settings {
    /// Checks the settings for a skin.
    ///
    /// # Errors
    /// A setting out of its range, with its value.
    pub fn check(&self, skin: &Skin) -> Result<(), PipelineError> {
        let count = skin.design().electrodes.len();
        if let Some(electrode) = self.left_out_electrodes.iter().find(|&&electrode| electrode >= count) {
            let message = format!("electrode {electrode} is left out, but the skin has electrodes 0 to {}", count - 1);
            return Err(PipelineError::Setting(message));
        }
        if !is_threshold(self.threshold) {
            let message = format!("the threshold is {}: it must be from 1e-6 to 1e6", self.threshold);
            return Err(PipelineError::Setting(message));
        }
        if !(8..=100_000).contains(&self.tare_frames) {
            let message = format!("a tare of {} frames: it must be from 8 to 100,000", self.tare_frames);
            return Err(PipelineError::Setting(message));
        }
        self.zones.iter().try_for_each(|zone| zone.check(skin.pixels()))
    }

    /// The method of this name, if it can find what the settings ask for.
    pub(crate) fn method_of<'a>(&self, methods: &'a MethodSet, name: &str) -> Result<&'a Method, PipelineError> {
        let method = methods.method(name)?;
        if self.both_signs {
            method.check_both_signs()?;
        }
        Ok(method)
    }

    /// The zone of a position: the first one that contains it.
    pub(crate) fn zone_at(&self, position_m: Point3) -> Option<&Zone> {
        self.zones.iter().find(|zone| zone.contains(position_m))
    }

    /// The detection threshold at a position, relative to the method's own.
    pub(crate) fn threshold_at(&self, position_m: Point3) -> f64 {
        self.threshold * self.zone_at(position_m).map_or(1.0, |zone| zone.threshold)
    }

    /// The lowest detection threshold on the skin.
    pub(crate) fn lowest_threshold(&self) -> f64 {
        self.threshold * self.zones.iter().map(|zone| zone.threshold).fold(1.0, f64::min)
    }
}

impl Zone {
    fn contains(&self, position_m: Point3) -> bool {
        distance(self.centre_m, position_m) <= self.radius_m
    }

    fn check(&self, pixels: &PixelSpace) -> Result<(), PipelineError> {
        let refused = |message: String| Err(PipelineError::Setting(format!("zone `{}` {message}", self.name)));
        let is_ball = self.centre_m.iter().all(|value| value.is_finite()) && self.radius_m > 0.0;
        if !is_ball || !is_threshold(self.threshold) {
            let must = "must have a finite centre, a positive radius, and a threshold from 1e-6 to 1e6";
            return refused(must.into());
        }
        if !pixels.centres_m.iter().any(|&centre_m| self.contains(centre_m)) {
            let box_m = pixels.box_m().map(|[least, most]| format!("{least:.3} to {most:.3}"));
            let box_m = box_m.join(", ");
            return refused(format!(
                "contains no pixel of the skin: they lie at {box_m} m in x, y and z; lengths are in metres"
            ));
        }
        Ok(())
    }
}

/// A command that a pipeline executes between two frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Command {
    /// Measure the baseline again, from the next frames.
    Tare,
    /// Change the detection threshold of all contacts.
    Threshold {
        /// Threshold relative to the method's own.
        value: f64,
    },
    /// Change the method.
    Method {
        /// Name of the method.
        name: String,
    },
    /// Replace the zones.
    Zones {
        /// The new zones.
        zones: Vec<Zone>,
    },
    /// Prepare the method again without the masked channels.
    Rebuild,
    /// The frames that follow are those of a device with this serial number. Another one than that of the baseline begins a
    /// tare: the readings of two instruments differ by more than a touch changes them.
    Device {
        /// Its serial number.
        serial: NonZeroU32,
    },
}
