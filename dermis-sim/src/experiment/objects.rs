//! Objects of other forms than a ball: families of touches for benchmarks.

use super::{MAX_DRAWS, Presses, truth};
use crate::random::{log_uniform, uniform};
use crate::twin::Press;
use dermis::contact::Contact;
use rand::{Rng, RngExt};
use serde::Serialize;
use std::f64::consts::TAU;

/// The random streams of objects follow those of the other sets.
const FIRST_SET: u64 = 8;
/// Distance of the balls that make up an edge and a palm, m, and the radii of those balls, m.
const EDGE_STEP_M: f64 = 3e-3;
const EDGE_RADIUS_M: f64 = 3e-3;
const PALM_STEP_M: f64 = 5e-3;
const PALM_RADIUS_M: f64 = 8e-3;

/// Objects of one kind. Each is made of balls, so that all laws of a twin's contact hold for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// Balls of 2 mm radius with 0.4 to 1.2 N.
    Pins,
    /// Balls of 5 to 15 mm radius with 1 to 3 N.
    Balls,
    /// Ellipses of 28 to 44 mm by 18 to 28 mm with 5 to 20 N.
    Palms,
    /// Edges of 16 to 50 mm with 2 to 8 N.
    Edges,
    /// Two fingertips of 7 mm radius, 25 to 60 mm apart, with 1 to 3 N each.
    Fingers,
}

/// The objects of a frame: the balls that they consist of, and the contacts that they are.
#[derive(Debug, Clone, PartialEq)]
pub struct Objects {
    /// All balls.
    pub presses: Vec<Press>,
    /// One contact for each object. Half length and half width are those of the rectangle with the same variances; unknown
    /// for balls.
    pub truth: Vec<Contact>,
}

/// An offset from the centre of an object: along it and across, m.
type Offset = [f64; 2];

impl Family {
    /// All families, in the order of tables.
    pub const ALL: [Family; 5] = [Family::Pins, Family::Balls, Family::Palms, Family::Edges, Family::Fingers];

    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Family::Pins => "pins",
            Family::Balls => "balls",
            Family::Palms => "palms",
            Family::Edges => "edges",
            Family::Fingers => "two fingers",
        }
    }
}

impl Presses<'_> {
    /// Objects of a family at random positions, whole on the skin, a list for each frame; frames without enough space are
    /// omitted.
    pub(crate) fn of_family(&self, family: Family, count: usize) -> Vec<Objects> {
        let frame = |number| {
            let mut rng = self.rng(FIRST_SET + family as u64, number);
            (0..MAX_DRAWS).find_map(|_| self.objects(family, &mut rng))
        };
        (0..count as u64).filter_map(frame).collect()
    }

    /// `None` if an object is not whole on the skin.
    fn objects(&self, family: Family, rng: &mut impl Rng) -> Option<Objects> {
        let (centre_m, angle_rad) = (self.place(rng), rng.random::<f64>() * TAU);
        let ball = |centre_m, force_n, tip_radius_m| Press { centre_m, force_n, tip_radius_m };
        let (offsets, force_n, radius_m, half): (Vec<Offset>, f64, f64, Offset) = match family {
            Family::Pins | Family::Balls => {
                let [force_n, radius_m] = match family {
                    Family::Pins => [log_uniform(rng, [0.4, 1.2]), 2e-3],
                    _ => [log_uniform(rng, [1.0, 3.0]), log_uniform(rng, [5e-3, 15e-3])],
                };
                return Some(self.of_balls(vec![ball(centre_m, force_n, radius_m)]));
            }
            Family::Fingers => {
                let other_m = self.walk(centre_m, angle_rad, uniform(rng, [25e-3, 60e-3]))?;
                let force_n = |rng: &mut _| log_uniform(rng, [1.0, 3.0]);
                let both = [centre_m, other_m].map(|centre_m| ball(centre_m, force_n(rng), 7e-3));
                return Some(self.of_balls(both.to_vec()));
            }
            Family::Edges => {
                let half_m = uniform(rng, [8e-3, 25e-3]);
                let steps = (half_m / EDGE_STEP_M).round() as i32;
                let step_m = half_m / f64::from(steps);
                let offsets = (-steps..=steps).map(|step| [step_m * f64::from(step), 0.0]).collect();
                (offsets, log_uniform(rng, [2.0, 8.0]), EDGE_RADIUS_M, [half_m, 0.0])
            }
            Family::Palms => {
                let axes_m = [uniform(rng, [14e-3, 22e-3]), uniform(rng, [9e-3, 14e-3])];
                let most = (axes_m[0] / PALM_STEP_M) as i32;
                let lines = (-most..=most).map(|line| PALM_STEP_M * f64::from(line));
                let grid: Vec<f64> = lines.collect();
                let all = grid.iter().flat_map(|&x| grid.iter().map(move |&y| [x, y]));
                let is_inside = |[x, y]: &Offset| (x / axes_m[0]).powi(2) + (y / axes_m[1]).powi(2) <= 1.0;
                // The variance of an ellipse is a quarter of its half axis squared, that of a rectangle a third.
                let half = axes_m.map(|axis_m| 0.75f64.sqrt() * axis_m);
                (all.filter(is_inside).collect(), log_uniform(rng, [5.0, 20.0]), PALM_RADIUS_M, half)
            }
        };
        let each_n = force_n / offsets.len() as f64;
        let at = |[along, across]: Offset| {
            let place = self.walk(centre_m, angle_rad + across.atan2(along), along.hypot(across))?;
            Some(ball(place, each_n, radius_m))
        };
        let presses: Option<Vec<Press>> = offsets.into_iter().map(at).collect();
        let mut truth = truth(&self.surface, &[ball(centre_m, force_n, radius_m)]);
        [truth[0].half_length_m, truth[0].half_width_m] = half;
        Some(Objects { presses: presses?, truth })
    }

    /// Each ball is an object.
    fn of_balls(&self, presses: Vec<Press>) -> Objects {
        Objects { truth: truth(&self.surface, &presses), presses }
    }
}
