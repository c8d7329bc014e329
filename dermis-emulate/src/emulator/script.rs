//! Scripts of touches of an emulated skin.

use crate::EmulateError;
use dermis::design::SkinDesign;
use dermis::files::{MAX_SETTINGS_BYTES, read_text_at_most};
use dermis::geom::{Point3, Surface};
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis_sim::experiment::Presses;
use dermis_sim::random::sample_rng;
use dermis_sim::twin::{Press, PressOptions, TwinOptions};
use rand::RngExt;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A script of touches, as in its TOML file.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Script {
    /// Period after which the script repeats, s; without it, the script runs once.
    pub repeat_s: Option<f64>,
    /// The touches.
    #[serde(default, rename = "touch")]
    pub touches: Vec<Stroke>,
}

/// One touch: a press that is held or moved along a straight line on the surface, and lifted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Stroke {
    /// Start time, s.
    pub at_s: f64,
    /// Duration, s.
    pub for_s: f64,
    /// Start position.
    pub from: Place,
    /// End position; the start position if absent.
    pub to: Option<Place>,
    /// Force on the skin, N.
    pub force_n: f64,
    /// Rise and fall time of the force, s.
    #[serde(default = "usual_ramp_s")]
    pub ramp_s: f64,
}

fn usual_ramp_s() -> f64 {
    0.03
}

/// A position on a skin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, deny_unknown_fields)]
pub enum Place {
    /// In the body's frame, m.
    Space([f64; 3]),
    /// On a cylinder.
    Cylinder {
        /// Along the axis, m.
        z_m: f64,
        /// Around the axis, degrees.
        theta_deg: f64,
    },
}

/// Built-in scripts.
pub(crate) const NAMED: [&str; 7] = ["none", "random", "press", "slide", "cross", "four", "grid"];

impl Script {
    /// Loads a built-in script by its name, or a file. Random touches and the forces of `grid` depend on the seed;
    /// `grid` presses as the twin's experiment does.
    ///
    /// # Errors
    /// A file that cannot be read; touches that the skin cannot have.
    pub fn load(name_or_path: &str, design: &SkinDesign, twin: &TwinOptions, seed: u64) -> Result<Self, EmulateError> {
        if !Path::new(name_or_path).is_file() {
            if name_or_path == "grid" {
                return Self::grid(design, &twin.press, seed);
            }
            if let Some(script) = Self::named(name_or_path, design, seed) {
                return Ok(script);
            }
        }
        let text = read_text_at_most(Path::new(name_or_path), MAX_SETTINGS_BYTES).map_err(|error| {
            EmulateError::Given(format!(
                "cannot read the script {name_or_path}: {error}; give a file or one of {}",
                NAMED.join(", ")
            ))
        })?;
        let script: Script =
            toml::from_str(&text).map_err(|error| EmulateError::Given(format!("{name_or_path}: {error}")))?;
        script.check(design).map_err(|message| EmulateError::Given(format!("{name_or_path}: {message}")))?;
        Ok(script)
    }

    /// The presses of the paper's experiment, as `dermis experiment` records them in the set `grid` for the same twin
    /// and seed: the centre of every pixel, one after the other. The experiment has one frame per press; here each
    /// press is held for a part of the interval.
    ///
    /// # Errors
    /// A design without a mesh or pixels.
    pub(crate) fn grid(design: &SkinDesign, press: &PressOptions, seed: u64) -> Result<Self, EmulateError> {
        let mesh = Mesh::generate(design).map_err(dermis::Error::from)?;
        let pixels = PixelSpace::for_design(design, &mesh).map_err(dermis::Error::from)?;
        let set = Presses::new(design, &mesh, &pixels, *press, seed).on_grid(1);
        let interval_s = press.interval_s;
        let stroke = |(index, press): (usize, &Press)| Stroke {
            at_s: GRID_BEGINS_S + index as f64 * interval_s,
            for_s: HELD * interval_s,
            from: Place::Space(press.centre_m),
            to: None,
            force_n: press.force_n,
            ramp_s: usual_ramp_s(),
        };
        let touches: Vec<Stroke> = set.presses.iter().flatten().enumerate().map(stroke).collect();
        let repeat_s = Some(GRID_BEGINS_S + touches.len() as f64 * interval_s);
        Ok(Script { repeat_s, touches })
    }

    /// A built-in script; `None` for an unknown name.
    fn named(name: &str, design: &SkinDesign, seed: u64) -> Option<Self> {
        let at = |part: f64, turn: f64| place(design, part, turn);
        let stroke = |at_s: f64, for_s: f64, from: Place, to: Option<Place>| Stroke {
            at_s,
            for_s,
            from,
            to,
            force_n: 2.0,
            ramp_s: usual_ramp_s(),
        };
        let touches = match name {
            "none" => Vec::new(),
            "press" => vec![stroke(1.0, 2.0, at(0.5, 0.25), None)],
            "slide" => vec![stroke(1.0, 2.0, at(0.5, 0.83), Some(at(0.5, 1.17)))],
            "cross" => vec![
                stroke(1.0, 2.0, at(0.25, 0.5), Some(at(0.75, 0.5))),
                stroke(1.0, 2.0, at(0.5, 0.33), Some(at(0.5, 0.67))),
            ],
            "four" => [(0.25, 0.01), (0.72, 0.18), (0.35, 0.41), (0.75, 0.72)]
                .map(|(part, turn)| stroke(1.0, 2.0, at(part, turn), None))
                .to_vec(),
            "random" => {
                let mut rng = sample_rng(seed, RANDOM_STREAM);
                let mut draw = |index: u32| Stroke {
                    force_n: 5f64.powf(rng.random()),
                    ..stroke(1.0 + 1.6 * f64::from(index), 1.0, at(rng.random(), rng.random()), None)
                };
                (0..RANDOM_TOUCHES).map(&mut draw).collect()
            }
            _ => return None,
        };
        let repeat_s = match name {
            "none" => None,
            "random" => Some(1.6 * f64::from(RANDOM_TOUCHES)),
            _ => Some(4.0),
        };
        Some(Script { repeat_s, touches })
    }

    fn check(&self, design: &SkinDesign) -> Result<(), String> {
        if let Some(repeat_s) = self.repeat_s.filter(|repeat_s| !(*repeat_s > 0.0 && repeat_s.is_finite())) {
            return Err(format!("repeat_s is {repeat_s}: it must be positive"));
        }
        for (index, stroke) in self.touches.iter().enumerate() {
            stroke.check(design).map_err(|message| format!("touch {index}: {message}"))?;
        }
        Ok(())
    }

    /// JSON schema of a script file.
    pub fn json_schema() -> serde_json::Value {
        schemars::schema_for!(Script).to_value()
    }

    /// The presses at a time, s, with a tip of the given radius.
    pub(crate) fn presses(&self, time_s: f64, surface: &Surface, tip_radius_m: f64) -> Vec<Press> {
        let time_s = self.repeat_s.map_or(time_s, |repeat_s| time_s.rem_euclid(repeat_s));
        self.touches.iter().filter_map(|stroke| stroke.press(time_s, surface, tip_radius_m)).collect()
    }
}

/// The random stream of touches; frames use the streams of their numbers.
const RANDOM_STREAM: u64 = u64::MAX - 16;
/// Time of the first press of the grid, s: after a tare.
const GRID_BEGINS_S: f64 = 1.0;
/// Part of an experiment's interval for which a press is held.
const HELD: f64 = 0.6;
/// Number of random touches before they repeat.
const RANDOM_TOUCHES: u32 = 500;
/// Smallest force of a press, N: the force while it rises from zero.
const MIN_N: f64 = 0.01;

impl Stroke {
    fn check(&self, design: &SkinDesign) -> Result<(), String> {
        for (name, value) in [("at_s", self.at_s), ("ramp_s", self.ramp_s)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(format!("{name} is {value}: it must not be negative"));
            }
        }
        for (name, value) in [("for_s", self.for_s), ("force_n", self.force_n)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(format!("{name} is {value}: it must be positive"));
            }
        }
        for place in [Some(self.from), self.to].into_iter().flatten() {
            let Some(point) = place.point(&design.body.surface()) else {
                return Err("z_m and theta_deg are for cylinders: write [x, y, z]".into());
            };
            if !point.iter().all(|value| value.is_finite()) || !design.body.holds(point) {
                return Err(format!("{point:?} m is off the skin"));
            }
        }
        Ok(())
    }

    fn press(&self, time_s: f64, surface: &Surface, tip_radius_m: f64) -> Option<Press> {
        let since_s = time_s - self.at_s;
        if !(0.0..self.for_s).contains(&since_s) {
            return None;
        }
        let ramp = (since_s.min(self.for_s - since_s) / self.ramp_s).min(1.0);
        let force_n = self.force_n * if ramp.is_nan() { 1.0 } else { ramp };
        let from = self.from.point(surface)?;
        let centre_m = match self.to {
            None => from,
            Some(to) => {
                let part = since_s / self.for_s;
                match (surface, self.from, to) {
                    (
                        Surface::Cylinder { .. },
                        Place::Cylinder { z_m: a, theta_deg: b },
                        Place::Cylinder { z_m: c, theta_deg: d },
                    ) => surface.at(a + part * (c - a), (b + part * (d - b)).to_radians())?,
                    _ => {
                        let step = surface.chart(from, to.point(surface)?);
                        surface.walk(from, step.map(|value| part * value))
                    }
                }
            }
        };
        (force_n >= MIN_N).then_some(Press { centre_m, force_n, tip_radius_m })
    }
}

impl Place {
    /// The point on a surface; `None` for a cylinder position on another body.
    pub(crate) fn point(&self, surface: &Surface) -> Option<Point3> {
        match *self {
            Place::Space(point) => Some(point),
            Place::Cylinder { z_m, theta_deg } => surface.at(z_m, theta_deg.to_radians()),
        }
    }
}

/// A position by fractions of the length of a skin and of a turn around it. On a flat skin, the fractions are those of
/// a circle around its centre; on any other body, they select an electrode.
fn place(design: &SkinDesign, part: f64, turn: f64) -> Place {
    match (design.body.surface(), &design.body) {
        (Surface::Cylinder { length_m, .. }, _) => Place::Cylinder { z_m: part * length_m, theta_deg: 360.0 * turn },
        (_, dermis::design::Body::Disk { diameter_m }) => {
            let radius_m = 0.4 * diameter_m * part;
            let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
            Place::Space([radius_m * cos, radius_m * sin, 0.0])
        }
        (_, dermis::design::Body::Rectangle { width_m, height_m }) => {
            Place::Space([turn.rem_euclid(1.0) * width_m, part * height_m, 0.0])
        }
        _ => {
            let index = (turn.rem_euclid(1.0) * design.electrodes.len() as f64) as usize;
            Place::Space(design.electrodes[index.min(design.electrodes.len() - 1)].centre_m)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_sim::experiment::{PaperExperiment, Sizes};

    #[test]
    fn a_script_presses_when_and_where_it_says() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let surface = design.body.surface();
        let text = "repeat_s = 4.0\n[[touch]]\nat_s = 1.0\nfor_s = 2.0\nforce_n = 3.0\nramp_s = 0.5\n\
                    from = { z_m = 0.1, theta_deg = 350.0 }\nto = { z_m = 0.1, theta_deg = 370.0 }\n";
        let script: Script = toml::from_str(text).unwrap();
        script.check(&design).unwrap();
        assert!(script.presses(0.9, &surface, 0.005).is_empty());
        let press = script.presses(6.0, &surface, 0.005)[0];
        assert_eq!(press.force_n, 3.0);
        assert!(surface.distance_m(press.centre_m, surface.at(0.1, 0.0).unwrap()) < 1e-9);
        assert_eq!(script.presses(1.25, &surface, 0.005)[0].force_n, 1.5);
        let twin = TwinOptions::shipped("lab").unwrap();
        for name in NAMED {
            Script::load(name, &design, &twin, 1).unwrap().check(&design).unwrap();
        }
        let off = text.replace("0.1,", "0.4,");
        assert!(toml::from_str::<Script>(&off).unwrap().check(&design).unwrap_err().contains("off the skin"));
    }
    /// The same presses as the experiment, in its order: positions, forces and number.
    #[test]
    fn the_grid_is_that_of_the_experiment_and_each_press_is_held() {
        let design = SkinDesign::shipped("skin16").unwrap();
        let (surface, twin) = (design.body.surface(), TwinOptions::shipped("lab").unwrap());
        let mesh = Mesh::generate(&design).unwrap();
        let pixels = PixelSpace::for_design(&design, &mesh).unwrap();
        let sizes = Sizes { random: 0, separations_m: vec![], pairs: 0, fours: 0, ..Sizes::default() };
        let experiment = PaperExperiment::draw(&design, &mesh, &pixels, &twin, 7, &sizes).unwrap();
        let script = Script::load("grid", &design, &twin, 7).unwrap();
        assert_eq!(script.touches.len(), experiment.sets.grid.presses.len());
        let interval_s = twin.press.interval_s;
        for (index, pressed) in experiment.sets.grid.presses.iter().enumerate() {
            for held_s in [0.1, 0.5 * HELD * interval_s, HELD * interval_s - 0.1] {
                let time_s = GRID_BEGINS_S + index as f64 * interval_s + held_s;
                assert_eq!(&script.presses(time_s, &surface, twin.press.tip_radius_m), pressed, "press {index}");
            }
            let between_s = GRID_BEGINS_S + (index as f64 + 0.9) * interval_s;
            assert!(script.presses(between_s, &surface, twin.press.tip_radius_m).is_empty());
        }
        assert_ne!(script, Script::load("grid", &design, &twin, 8).unwrap(), "forces depend on the seed");
    }
}
