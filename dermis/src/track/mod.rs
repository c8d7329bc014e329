//! Contacts followed from frame to frame, each by an id that lasts.
//!
//! A track predicts where its contact moves (a Kalman filter of constant velocity); predictions and
//! contacts are assigned at the smallest total distance. A contact counts once it has come
//! [`TrackOptions::birth_frames`] times running above the threshold, and until it has been away for
//! [`TrackOptions::absence_s`] below a lower one. Two contacts too near to be told apart become one in the image: then both
//! tracks go on, moved together by what is seen of them, until they part again.

mod motion;
#[cfg(test)]
mod tests;

use crate::contact::Contact;
use crate::geom::vector::{distance, norm, scale};
use crate::geom::{Point3, Surface};
use crate::linalg::smallest_total;
use motion::{Motion, step_between};
use serde::{Deserialize, Serialize};

/// Contacts that come nearer to each other faster than this will meet, m/s: more than a finger that stays seems to move.
const CLOSING_M_S: f64 = 0.03;

/// A contact that is seen as one with another lies within this part of [`TrackOptions::merge_m`] of what is seen.
const SEEN_AS_ONE: f64 = 0.6;

/// How contacts are followed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrackOptions {
    /// Frames running in which a contact must come before it counts.
    pub birth_frames: usize,
    /// A contact that does not come for longer than this has ended, s.
    pub absence_s: f64,
    /// Once it counts, a contact stays while its signal exceeds this part of what it needed to begin.
    pub release_fraction: f64,
    /// A contact farther than this from where a track is expected is not its own, m.
    pub gate_m: f64,
    /// Contacts nearer than this may be seen as one, m: the separation that the method resolves.
    pub merge_m: f64,
    /// Two contacts that are seen as one for longer than this are one, s.
    pub merge_s: f64,
}

impl Default for TrackOptions {
    fn default() -> Self {
        TrackOptions {
            birth_frames: 2,
            absence_s: 0.05,
            release_fraction: 0.7,
            // At 120 frames a second a fast stroke of 1 m/s moves 8 mm; errors jump by a few when patches close.
            gate_m: 0.03,
            merge_m: 0.06,
            merge_s: 2.0,
        }
    }
}

/// A contact found in a frame, and how far it stands out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The contact.
    pub contact: Contact,
    /// Its signal over what a contact needs to begin; from [`TrackOptions::release_fraction`] on it may go on.
    pub signal: f64,
}

/// A contact that is followed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tracked {
    /// The contact with its lasting id: as last seen, moved to where it is expected while it is hidden.
    pub contact: Contact,
    /// How it moves, m/s.
    pub velocity_m_s: Point3,
    /// When it began, s on the clock of the frames.
    pub since_s: f64,
    /// Whether the image shows it on its own; else it is behind another contact or missing for a moment.
    pub seen: bool,
}

/// Follows contacts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tracker {
    options: TrackOptions,
    surface: Surface,
    tracks: Vec<Track>,
    next_id: u64,
    last_s: Option<f64>,
    tracked: Vec<Tracked>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Track {
    /// The id, once the contact counts.
    id: Option<u64>,
    contact: Contact,
    motion: Motion,
    since_s: f64,
    last_seen_s: f64,
    sightings: usize,
    /// Since when it has been seen as one with another.
    merged_since_s: Option<f64>,
}

impl Tracker {
    /// A tracker of contacts on a surface.
    pub fn new(surface: Surface, options: TrackOptions) -> Self {
        Tracker { options, surface, tracks: Vec::new(), next_id: 1, last_s: None, tracked: Vec::new() }
    }

    /// Takes the contacts of the next frame in and gives those that count, the oldest first.
    pub fn update(&mut self, sightings: &[Sighting], time_s: f64) -> &[Tracked] {
        let step_s = self.last_s.map_or(0.0, |last_s| (time_s - last_s).max(0.0));
        self.last_s = Some(time_s);
        for track in &mut self.tracks {
            track.motion.predict(&self.surface, step_s);
        }
        let owner = self.assign(sightings);
        let hidden = self.hidden(sightings, &owner, time_s);
        self.correct(sightings, &owner, &hidden, time_s);
        self.end(time_s);
        self.begin(sightings, &owner, time_s);
        self.tell(time_s)
    }

    /// Ends all contacts; ids are not used again.
    pub fn clear(&mut self) {
        self.tracks.clear();
    }

    /// Which track each sighting belongs to.
    fn assign(&self, sightings: &[Sighting]) -> Vec<Option<usize>> {
        let gate_m = self.options.gate_m;
        let apart_m = |track: usize, sighting: usize| {
            self.surface.distance_m(self.tracks[track].motion.position_m, sightings[sighting].contact.position_m)
        };
        // Beyond the gate all distances cost alike: a far pair does not push a near one apart.
        let cost = |track: usize, sighting: usize| apart_m(track, sighting).min(2.0 * gate_m);
        let mut owner = vec![None; sightings.len()];
        for (track, sighting) in smallest_total(self.tracks.len(), sightings.len(), &cost) {
            // Where two that were seen as one part again is hardly known: on either side of what was seen.
            let gate_m = if self.tracks[track].merged_since_s.is_some() { 2.0 * self.options.merge_m } else { gate_m };
            if apart_m(track, sighting) <= gate_m {
                owner[sighting] = Some(track);
            }
        }
        owner
    }

    /// For each track that was not seen the sighting that may be it and its neighbour in one.
    ///
    /// A contact that hides another is stronger than it was alone, or has moved from where it is expected towards the
    /// middle of both, or the two were closing in on each other; one whose neighbour was lifted is none of these.
    fn hidden(&self, sightings: &[Sighting], owner: &[Option<usize>], time_s: f64) -> Vec<Option<usize>> {
        let merges = |track: usize, sighting: usize| {
            let (own, seen) = (&self.tracks[track], &sightings[sighting].contact);
            let Some(other) = owner[sighting].map(|other| &self.tracks[other]) else { return false };
            if own.id.is_none() || other.id.is_none() {
                return false;
            }
            if let Some(since_s) = own.merged_since_s {
                return time_s - since_s <= self.options.merge_s;
            }
            let apart_m = self.surface.distance_m(own.motion.position_m, other.motion.position_m);
            let towards_m = self.surface.distance_m(seen.position_m, other.motion.position_m);
            let stronger = seen.strength >= other.contact.strength + 0.5 * own.contact.strength;
            let closing_m_s = own.motion.closing_m_s(&other.motion, &self.surface);
            apart_m <= self.options.merge_m && (stronger || towards_m > 0.25 * apart_m || closing_m_s > CLOSING_M_S)
        };
        (0..self.tracks.len())
            .map(|track| {
                if owner.contains(&Some(track)) {
                    return None;
                }
                let from = self.tracks[track].motion.position_m;
                let away_m = |&sighting: &usize| self.surface.distance_m(from, sightings[sighting].contact.position_m);
                let near = (0..sightings.len()).filter(|sighting| away_m(sighting) <= self.options.merge_m);
                near.filter(|&sighting| merges(track, sighting)).min_by(|a, b| away_m(a).total_cmp(&away_m(b)))
            })
            .collect()
    }

    fn correct(&mut self, sightings: &[Sighting], owner: &[Option<usize>], hidden: &[Option<usize>], time_s: f64) {
        for (sighting, owner) in owner.iter().enumerate() {
            let Some(owner) = *owner else { continue };
            let seen = &sightings[sighting];
            let behind: Vec<usize> = (0..hidden.len()).filter(|&track| hidden[track] == Some(sighting)).collect();
            if behind.is_empty() {
                self.tracks[owner].see(seen, &self.surface, time_s);
            } else {
                self.see_together(owner, &behind, &seen.contact, time_s);
            }
        }
    }

    /// Moves tracks that are seen as one by what their middle misses of what is seen. Their
    /// velocities stay: the sum tells nothing of how the parts move against each other.
    fn see_together(&mut self, owner: usize, behind: &[usize], seen: &Contact, time_s: f64) {
        let members: Vec<usize> = std::iter::once(owner).chain(behind.iter().copied()).collect();
        let origin = self.tracks[owner].motion.position_m;
        // Their last strengths tell nothing of their weights: near each other one takes from the other.
        let places = members.iter().map(|&member| (self.tracks[member].motion.position_m, 1.0));
        let middle = self.surface.weighted_mean(origin, places);
        // What is seen is their middle, or the stronger one alone: whichever is nearer to what was expected.
        let steps_m = [middle, origin].map(|expected| step_between(&self.surface, expected, seen.position_m));
        let shift_m = if norm(steps_m[0]) <= norm(steps_m[1]) { steps_m[0] } else { steps_m[1] };
        for &member in &members {
            self.tracks[member].motion.shift(&self.surface, shift_m);
        }
        for member in members {
            // Farther apart than this they would be told apart.
            let step_m = step_between(&self.surface, seen.position_m, self.tracks[member].motion.position_m);
            let over = norm(step_m) / (SEEN_AS_ONE * self.options.merge_m) - 1.0;
            if over > 0.0 {
                self.tracks[member].motion.shift(&self.surface, scale(step_m, -over / (1.0 + over)));
            }
            let track = &mut self.tracks[member];
            track.merged_since_s.get_or_insert(time_s);
            track.last_seen_s = time_s;
        }
    }

    /// Ends what has been away too long, and what never counted and did not come.
    fn end(&mut self, time_s: f64) {
        let options = self.options;
        self.tracks.retain(|track| match track.id {
            Some(_) => time_s - track.last_seen_s <= options.absence_s,
            None => track.last_seen_s == time_s,
        });
    }

    fn begin(&mut self, sightings: &[Sighting], owner: &[Option<usize>], time_s: f64) {
        for (seen, _) in sightings.iter().zip(owner).filter(|(seen, owner)| owner.is_none() && seen.signal >= 1.0) {
            self.tracks.push(Track {
                id: None,
                contact: seen.contact,
                motion: Motion::at_rest(seen.contact.position_m),
                since_s: time_s,
                last_seen_s: time_s,
                sightings: 1,
                merged_since_s: None,
            });
        }
        for track in &mut self.tracks {
            if track.id.is_none() && track.sightings >= self.options.birth_frames {
                track.id = Some(self.next_id);
                self.next_id += 1;
            }
        }
    }

    fn tell(&mut self, time_s: f64) -> &[Tracked] {
        self.tracked.clear();
        for track in &self.tracks {
            let Some(id) = track.id else { continue };
            let seen = track.last_seen_s == time_s && track.merged_since_s.is_none();
            let mut contact = Contact { id, ..track.contact };
            if !seen {
                contact.position_m = track.motion.position_m;
                contact.normal = self.surface.normal(contact.position_m).unwrap_or(contact.normal);
                // It is somewhere between what was last seen of it and where it is expected.
                contact.sd_m = contact.sd_m.hypot(distance(track.contact.position_m, contact.position_m));
            }
            let velocity_m_s = track.motion.velocity_m_s(&self.surface);
            self.tracked.push(Tracked { contact, velocity_m_s, since_s: track.since_s, seen });
        }
        self.tracked.sort_by_key(|tracked| tracked.contact.id);
        &self.tracked
    }
}

impl Track {
    /// It is seen on its own.
    fn see(&mut self, seen: &Sighting, surface: &Surface, time_s: f64) {
        if self.id.is_none() && seen.signal < 1.0 {
            return;
        }
        if self.merged_since_s.take().is_some() {
            self.motion.jump(seen.contact.position_m);
        } else {
            self.motion.correct(surface, seen.contact.position_m);
        }
        self.contact = seen.contact;
        self.last_seen_s = time_s;
        self.sightings += 1;
    }
}
