//! Motion of one contact: a Kalman filter of constant velocity on the surface, with two time constants.

use crate::geom::Surface;
use crate::geom::vector::{Point3, add, dot, norm, scale, sub};
use serde::{Deserialize, Serialize};

/// Parameters of a motion model.
#[derive(Debug, Clone, Copy)]
pub(super) struct Manner {
    /// Standard deviation of the acceleration along the surface, m/s2.
    acceleration_m_s2: f64,
    /// Standard deviation of the measured position, m.
    jitter_m: f64,
}

/// Fast motion between frames: a stroke reaches 0.15 m/s in a tenth of a second, and errors change by a millimetre or
/// two between neighbouring positions, as patches close and open.
pub(super) const SUDDEN: Manner = Manner { acceleration_m_s2: 1.5, jitter_m: 0.0015 };
/// Slow motion, over `sqrt(jitter / acceleration)`, 0.14 s: touches within 50 mm of each other shift each other's spot
/// by up to 10 mm.
pub(super) const STEADY: Manner = Manner { acceleration_m_s2: 0.5, jitter_m: 0.01 };

/// Position and velocity of a contact, with one variance for all axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Motion {
    /// Position, m.
    pub position_m: Point3,
    /// In the chart of the surface (around and along; x and y), or in space if it has none.
    velocity_m_s: [f64; 3],
    /// Variance of the position, covariance, variance of the velocity.
    variance: [f64; 3],
}

impl Motion {
    pub(super) fn at_rest(position_m: Point3, manner: Manner) -> Self {
        // A finger that touches down may move at 0.3 m/s.
        Motion { position_m, velocity_m_s: [0.0; 3], variance: [manner.jitter_m.powi(2), 0.0, 0.09] }
    }

    pub(super) fn predict(&mut self, surface: &Surface, step_s: f64, manner: Manner) {
        self.extrapolate(surface, step_s);
        let [place, both, speed] = self.variance;
        let force = (manner.acceleration_m_s2 * step_s).powi(2);
        self.variance = [
            place + 2.0 * step_s * both + step_s * step_s * speed + 0.25 * force * step_s * step_s,
            both + step_s * speed + 0.5 * force * step_s,
            speed + force,
        ];
    }

    pub(super) fn correct(&mut self, surface: &Surface, seen_m: Point3, manner: Manner) {
        let missed_m = surface.step(self.position_m, seen_m);
        let [place, both, speed] = self.variance;
        let total = place + manner.jitter_m.powi(2);
        let (gain, speed_gain) = (place / total, both / total);
        self.velocity_m_s = add(self.velocity_m_s, scale(missed_m, speed_gain));
        self.position_m = moved(surface, self.position_m, scale(missed_m, gain));
        self.variance = [(1.0 - gain) * place, (1.0 - gain) * both, speed - speed_gain * both];
    }

    /// Moves at constant velocity for a time; returns the step.
    pub(super) fn extrapolate(&mut self, surface: &Surface, for_s: f64) -> Point3 {
        let step_m = scale(self.velocity_m_s, for_s);
        self.shift(surface, step_m);
        step_m
    }

    /// Moves it without a change of velocity.
    pub(super) fn shift(&mut self, surface: &Surface, step_m: Point3) {
        self.position_m = moved(surface, self.position_m, step_m);
    }

    /// Moves it by the minimum distance that brings it within a radius of a point, m.
    pub(super) fn clamp_to(&mut self, surface: &Surface, from_m: Point3, reach_m: f64) {
        let off_m = surface.step(from_m, self.position_m);
        let far_m = norm(off_m);
        if far_m > reach_m {
            self.position_m = moved(surface, from_m, scale(off_m, reach_m / far_m));
        }
    }

    /// Limits its speed.
    pub(super) fn limit_speed(&mut self, most_m_s: f64) {
        let speed_m_s = norm(self.velocity_m_s);
        if speed_m_s > most_m_s {
            self.velocity_m_s = scale(self.velocity_m_s, most_m_s / speed_m_s);
        }
    }

    /// Sets the position to that of a separate sighting after a merge, and keeps the velocity.
    pub(super) fn reset_position(&mut self, seen_m: Point3, manner: Manner) {
        self.position_m = seen_m;
        self.variance = [manner.jitter_m.powi(2), 0.0, self.variance[2].min(0.09)];
    }

    /// The approach speed to another contact, m/s.
    pub(super) fn closing_m_s(&self, other: &Motion, surface: &Surface) -> f64 {
        let between_m = surface.step(self.position_m, other.position_m);
        let apart_m = norm(between_m).max(f64::MIN_POSITIVE);
        dot(sub(self.velocity_m_s, other.velocity_m_s), between_m) / apart_m
    }

    /// Its velocity in space.
    pub(super) fn velocity_m_s(&self, surface: &Surface) -> Point3 {
        // A step of a microsecond stays on the tangent.
        const STEP_S: f64 = 1e-6;
        let next = moved(surface, self.position_m, scale(self.velocity_m_s, STEP_S));
        scale(sub(next, self.position_m), 1.0 / STEP_S)
    }
}

fn moved(surface: &Surface, from: Point3, step: Point3) -> Point3 {
    match surface {
        Surface::Free => add(from, step),
        _ => surface.walk(from, [step[0], step[1]]),
    }
}
