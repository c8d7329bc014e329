//! Merged contacts.
//!
//! The sighting of merged contacts is near their centre. Fingers change their direction less than their speed. Each
//! contact therefore continues from the start of the merge along its own line, and the deviation from the observed
//! centre is assigned to the distances along these lines. Contacts that cross leave on the far sides; contacts that
//! stop and return leave on their own sides. In a head-on merge the centre is at rest in both cases: then crossing is
//! assumed.

use super::{Sighting, Tracker};
use crate::geom::Point3;
use crate::geom::vector::{add, cross, dot, norm, scale, sub};
use serde::{Deserialize, Serialize};

/// Standard deviation of the sighting of merged contacts from their centre, m: the stronger ones have a larger weight.
const MIDDLE_M: f64 = 0.004;
/// A merged contact is within this fraction of [`TrackOptions::merge_m`](super::TrackOptions::merge_m) of the sighting.
const SEEN_AS_ONE: f64 = 0.6;

/// Position and time of the start of a merge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Merged {
    pub since_s: f64,
    from_m: Point3,
}

impl Tracker {
    /// Moves merged tracks.
    ///
    /// With `x_i = from_i + t v_i + s_i` and `s_i` along `v_i` of standard deviation `|t v_i|`, the steps `s_i` are the
    /// most likely ones for a centre of the `x_i` measured with `MIDDLE_M`; the remaining deviation moves all contacts
    /// equally. Several targets measured at their centre: Chang and Bar-Shalom 1984, DOI 10.1109/TAC.1984.1103597;
    /// noise along the track: Kirubarajan, Bar-Shalom, Pattipati and Kadar 2000, DOI 10.1109/7.826310.
    pub(super) fn see_together(&mut self, members: &[usize], seen: &Sighting, time_s: f64) {
        let seen_m = seen.contact.position_m;
        let ways_m: Vec<Point3> = members.iter().map(|&member| self.predict(member, time_s)).collect();
        let share = 1.0 / members.len() as f64;
        let places = members.iter().map(|&member| (self.tracks[member].motion.position_m, share));
        let middle_m = self.surface.weighted_mean(seen_m, places);
        let missed_m = self.surface.step(middle_m, seen_m);
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

    /// Moves a track to its position extrapolated from before the merge; returns the distance from the start.
    fn predict(&mut self, member: usize, time_s: f64) -> Point3 {
        let track = &mut self.tracks[member];
        track.last_seen_s = time_s;
        if track.merged.is_none() {
            track.motion = track.course.clone();
        }
        let from_m = track.motion.position_m;
        let merged = track.merged.get_or_insert(Merged { since_s: time_s, from_m });
        track.motion.position_m = merged.from_m;
        track.motion.extrapolate(&self.surface, time_s - merged.since_s)
    }

    /// Farther from the sighting than this it would be resolved.
    fn keep_near(&mut self, member: usize, seen_m: Point3) {
        let motion = &mut self.tracks[member].motion;
        let off_m = self.surface.step(seen_m, motion.position_m);
        let over = norm(off_m) / (SEEN_AS_ONE * self.options.merge_m) - 1.0;
        if over > 0.0 {
            motion.shift(&self.surface, scale(off_m, -over / (1.0 + over)));
        }
    }
}

/// Solves three equations by Cramer's rule; the rows are those of a positive definite matrix.
fn solved([a, b, c]: [Point3; 3], right: Point3) -> Point3 {
    let [bc, ca, ab] = [cross(b, c), cross(c, a), cross(a, b)];
    scale(add(add(scale(bc, right[0]), scale(ca, right[1])), scale(ab, right[2])), 1.0 / dot(a, bc))
}
