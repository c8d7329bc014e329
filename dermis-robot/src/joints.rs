//! Positions of joints over time.

use crate::file::Robot;
use crate::kinematics::{JointKind, Kinematics};
use dermis::pipeline::Timestamp;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// How long samples are kept, s: longer than any frame waits.
pub(crate) const KEPT_S: f64 = 1.0;
/// Largest position, rad or m: 160 turns.
const MAX_POSITION: f64 = 1e3;
/// How far a joint may be beyond its limits, as a part of their distance: limits are of commands.
const BEYOND: f64 = 0.1;
/// A joint that is faster than this multiple of its limit has jumped: limits are of commands, and messages have jitter.
const JUMP: f64 = 3.0;

/// The positions of all joints at some times.
#[derive(Debug, Clone, Default)]
pub(crate) struct JointHistory {
    samples: VecDeque<(Timestamp, Vec<f64>)>,
}

/// The positions at a time.
#[derive(Debug, Clone)]
pub(crate) struct JointsAt {
    pub positions: Vec<f64>,
    /// Speeds of the joints, rad/s or m/s; zeros if they are not known.
    pub speeds: Vec<f64>,
    /// How long before that time the positions were measured, s; 0 between two samples.
    pub gap_s: f64,
}

impl JointHistory {
    /// Adds positions by the names of the joints; unknown names are left out.
    ///
    /// # Errors
    /// Positions that are not finite or beyond the limits of a joint; a joint that a skin depends on is missing; times that do not increase; a joint that
    /// has jumped, which also forgets the samples before.
    pub(crate) fn add(&mut self, robot: &Robot, at: Timestamp, given: &[(&str, f64)]) -> Result<(), String> {
        let Some(kinematics) = robot.kinematics() else {
            return Err("joint states need a robot description: write description = \"robot.urdf\"".into());
        };
        let mut positions = vec![f64::NAN; kinematics.movable().len()];
        for (place, name) in kinematics.joint_names().enumerate() {
            let mut of_joint = given.iter().filter(|(given, _)| *given == name);
            if let Some((_, position)) = of_joint.next() {
                if of_joint.next().is_some() {
                    return Err(format!("the joint states have the joint `{name}` twice"));
                }
                if !(-MAX_POSITION..=MAX_POSITION).contains(position) {
                    return Err(format!("the position of the joint `{name}` is {position:?}"));
                }
                if let Some([lower, upper]) = kinematics.movable().nth(place).and_then(|joint| joint.limits)
                    && !(lower - BEYOND * (upper - lower)..=upper + BEYOND * (upper - lower)).contains(position)
                {
                    return Err(format!(
                        "the position {position} of the joint `{name}` is beyond its limits, {lower} to {upper}: positions are in rad \
                         and m"
                    ));
                }
                positions[place] = *position;
            }
        }
        let missing = robot.needed_joints().iter().copied().find(|&place| positions[place].is_nan());
        if let Some(place) = missing {
            let name = kinematics.joint_names().nth(place).unwrap_or_default();
            let came: Vec<&str> = given.iter().map(|(given, _)| *given).collect();
            return Err(format!(
                "the joint states have no joint `{name}`, as those of another robot or of a part of it; they have {}; a message \
                 must have every joint between the base and a skin",
                if came.is_empty() { "none".into() } else { came.join(", ") }
            ));
        }
        if self.newest() == Some(at) {
            // The same states again.
            return Ok(());
        }
        self.check_after(kinematics, at, &positions)?;
        while self.samples.front().is_some_and(|(first, _)| at.seconds_since(*first) > KEPT_S) {
            self.samples.pop_front();
        }
        self.samples.push_back((at, positions));
        Ok(())
    }

    /// Refuses a sample that does not follow the last one.
    fn check_after(&mut self, kinematics: &Kinematics, at: Timestamp, positions: &[f64]) -> Result<(), String> {
        let Some((last, before)) = self.samples.back() else { return Ok(()) };
        let passed_s = at.seconds_since(*last);
        if passed_s < -KEPT_S {
            // The clock was set back.
            self.samples.clear();
            return Ok(());
        }
        if passed_s <= 0.0 {
            return Err(format!("joint states are {:.3} s older than the ones before", -passed_s));
        }
        let jumped = kinematics.movable().enumerate().find_map(|(place, joint)| {
            let moved = difference(joint.kind, before[place], positions[place]).abs();
            let limit = joint.speed_limit?;
            (passed_s < KEPT_S && moved > JUMP * limit * passed_s.max(0.001)).then(|| {
                let speed = moved / passed_s;
                let unit = if joint.kind == JointKind::Prismatic { "m/s" } else { "rad/s" };
                format!(
                    "the joint `{}` jumped: {speed:.1} {unit}, of at most {limit:.1}; positions are in rad and m",
                    joint.name
                )
            })
        });
        if jumped.is_some() {
            self.samples.clear();
        }
        jumped.map_or(Ok(()), Err)
    }

    /// The time of the newest sample.
    pub(crate) fn newest(&self) -> Option<Timestamp> {
        self.samples.back().map(|(at, _)| *at)
    }

    /// The positions at a time: between two samples, linear; after the newest one, that one for at most `held_s`. Never
    /// extrapolated.
    pub(crate) fn at(&self, kinematics: &Kinematics, time: Timestamp, held_s: f64) -> Option<JointsAt> {
        let next = self.samples.partition_point(|(at, _)| *at < time);
        let at_next = self.samples.get(next);
        if let Some((_, positions)) = at_next.filter(|(at, _)| *at == time) {
            return Some(JointsAt { speeds: vec![0.0; positions.len()], positions: positions.clone(), gap_s: 0.0 });
        }
        // The last sample before the time.
        let previous = next.checked_sub(1)?;
        let (earlier, from) = &self.samples[previous];
        let kinds = || kinematics.movable().map(|joint| joint.kind);
        let rates = |a: &(Timestamp, Vec<f64>), b: &(Timestamp, Vec<f64>)| -> Vec<f64> {
            let passed_s = b.0.seconds_since(a.0);
            kinds().enumerate().map(|(place, kind)| difference(kind, a.1[place], b.1[place]) / passed_s).collect()
        };
        let passed_s = time.seconds_since(*earlier);
        let Some(later) = at_next else {
            let speeds = match previous.checked_sub(1) {
                Some(before) => rates(&self.samples[before], &self.samples[previous]),
                None => vec![0.0; from.len()],
            };
            let held = JointsAt { positions: from.clone(), speeds, gap_s: passed_s };
            return Some(held).filter(|held| held.gap_s <= held_s);
        };
        // A gap between samples is no motion that is known.
        if later.0.seconds_since(*earlier) > KEPT_S {
            return None;
        }
        let speeds = rates(&self.samples[previous], later);
        let positions = from.iter().zip(&speeds).map(|(from, speed)| from + speed * passed_s).collect();
        Some(JointsAt { positions, speeds, gap_s: 0.0 })
    }
}

/// The way from one position to another: of a joint without limits the shorter one.
fn difference(kind: JointKind, from: f64, to: f64) -> f64 {
    let way = to - from;
    match kind {
        JointKind::Revolute { wraps: true } => way - TAU * (way / TAU).round(),
        _ => way,
    }
}
