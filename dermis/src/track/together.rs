//! Contacts that are seen as one.
//!
//! What is seen is their middle, and that tells more than it seems to: fingers keep to their line better than to their
//! speed. Each goes on from where the merge began along the line that it had, and what the middle misses is put down to
//! how far each has come on its own. Two that cross come out on the far sides, two that stop and go back come out where
//! they came from. Two that meet head on leave their middle at rest either way: they are taken to go on.

use super::motion::step_between;
use super::{Sighting, Tracker};
use crate::geom::Point3;
use crate::geom::vector::{add, cross, dot, norm, scale, sub};
use serde::{Deserialize, Serialize};

/// Standard deviation of what is seen of several contacts in one from their middle, m: the stronger ones weigh more.
const MIDDLE_M: f64 = 0.004;
/// What is seen as one with another lies within this part of [`TrackOptions::merge_m`](super::TrackOptions::merge_m) of
/// what is seen.
const SEEN_AS_ONE: f64 = 0.6;

/// Where and when a contact began to be seen as one with another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Merged {
    pub since_s: f64,
    from_m: Point3,
}

impl Tracker {
    /// Moves tracks that are seen as one.
    ///
    /// With `x_i = from_i + t v_i + s_i` and `s_i` along `v_i` of standard deviation `|t v_i|`, the steps `s_i` are the
    /// likeliest ones for a middle of the `x_i` seen with `MIDDLE_M`; what is left moves all alike. Several targets seen
    /// in their middle: Chang and Bar-Shalom 1984, DOI 10.1109/TAC.1984.1103597; noise along the track: Kirubarajan,
    /// Bar-Shalom, Pattipati and Kadar 2000, DOI 10.1109/7.826310.
    pub(super) fn see_together(&mut self, members: &[usize], seen: &Sighting, time_s: f64) {
        let seen_m = seen.contact.position_m;
        let ways_m: Vec<Point3> = members.iter().map(|&member| self.go_on(member, time_s)).collect();
        let share = 1.0 / members.len() as f64;
        let places = members.iter().map(|&member| (self.tracks[member].motion.position_m, share));
        let middle_m = self.surface.weighted_mean(seen_m, places);
        let missed_m = step_between(&self.surface, middle_m, seen_m);
        let mut spread =
            [0, 1, 2].map(|axis| [0, 1, 2].map(|other| if axis == other { MIDDLE_M.powi(2) } else { 0.0 }));
        for way_m in &ways_m {
            for (axis, row) in spread.iter_mut().enumerate() {
                *row = add(*row, scale(*way_m, share * share * way_m[axis]));
            }
        }
        let weighed = solved(spread, missed_m);
        let steps_m: Vec<Point3> = ways_m.iter().map(|&way_m| scale(way_m, share * dot(way_m, weighed))).collect();
        let left_m = steps_m.iter().fold(missed_m, |left_m, &step_m| sub(left_m, scale(step_m, share)));
        for (&member, &step_m) in members.iter().zip(&steps_m) {
            self.tracks[member].motion.shift(&self.surface, add(step_m, left_m));
            self.keep_near(member, seen_m);
        }
    }

    /// Moves a track to where it would be had it gone on as before the merge; the way that it would have gone.
    fn go_on(&mut self, member: usize, time_s: f64) -> Point3 {
        let track = &mut self.tracks[member];
        track.last_seen_s = time_s;
        if track.merged.is_none() {
            track.motion = track.course.clone();
        }
        let from_m = track.motion.position_m;
        let merged = track.merged.get_or_insert(Merged { since_s: time_s, from_m });
        track.motion.position_m = merged.from_m;
        track.motion.go_on(&self.surface, time_s - merged.since_s)
    }

    /// Farther from what is seen than this it would be told apart.
    fn keep_near(&mut self, member: usize, seen_m: Point3) {
        let motion = &mut self.tracks[member].motion;
        let off_m = step_between(&self.surface, seen_m, motion.position_m);
        let over = norm(off_m) / (SEEN_AS_ONE * self.options.merge_m) - 1.0;
        if over > 0.0 {
            motion.shift(&self.surface, scale(off_m, -over / (1.0 + over)));
        }
    }
}

/// The solution of three equations by Cramer's rule; the rows are those of a positive definite matrix.
fn solved([a, b, c]: [Point3; 3], right: Point3) -> Point3 {
    let [bc, ca, ab] = [cross(b, c), cross(c, a), cross(a, b)];
    scale(add(add(scale(bc, right[0]), scale(ca, right[1])), scale(ab, right[2])), 1.0 / dot(a, bc))
}
