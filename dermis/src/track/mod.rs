//! Contacts followed from frame to frame, each by an id that lasts.
//!
//! A track predicts where its contact moves (a Kalman filter of constant velocity); predictions and
//! contacts are assigned at the smallest total distance. A contact counts once it has come
//! [`TrackOptions::birth_frames`] times running above the threshold, and until it has been away for
//! [`TrackOptions::absence_s`] below a lower one. Two contacts too near to be told apart become one in the image: then
//! both tracks go on, each along its own line as far as their middle says, until they part again.
//!
//! A contact that is not seen goes on along its way, but on the body, and no faster than brings it out of its
//! [gate](TrackOptions::gate_m) while it is missed; its confidence falls in a straight line to zero at the time at which
//! it is given up.

mod extent;
mod motion;
#[cfg(test)]
mod tests;
mod together;

use crate::contact::Contact;
use crate::geom::vector::distance;
use crate::geom::{Point3, Surface};
use crate::image::PixelSpace;
use crate::linalg::smallest_total;
use extent::Extent;
use motion::{Motion, STEADY, SUDDEN};
use serde::{Deserialize, Serialize};
use together::Merged;

/// Contacts that come nearer to each other faster than this will meet, m/s: more than a finger that stays seems to move.
const CLOSING_M_S: f64 = 0.03;

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
    /// Between two contacts, nearer than [`merge_m`](Self::merge_m) to both, a third must come for so long before it
    /// counts, s: where two touches are hardly told apart, images show spots between them.
    pub between_s: f64,
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
            between_s: 0.15,
        }
    }
}

/// No gate is narrower, m: a fast stroke of 1 m/s moves as far in a frame at 120 a second, whatever the skin.
const LEAST_GATE_M: f64 = 0.008;

impl TrackOptions {
    /// The options for a skin, told by its pixels and the number of its electrodes; for the paper's skin the default ones.
    ///
    /// Errors of images and the separation that they resolve go with the distance between electrodes. Spread evenly over
    /// the body's area `A` in a triangular grid, `n` electrodes are `sqrt(2 A / (sqrt(3) n))` apart: that, in whole
    /// millimetres, is [`merge_m`](Self::merge_m), and half of it [`gate_m`](Self::gate_m).
    pub fn for_skin(pixels: &PixelSpace, electrode_count: usize) -> Self {
        let area_m2 = pixels.areas.iter().sum::<f64>();
        let apart_m = (2.0 * area_m2 / (3f64.sqrt() * electrode_count.max(1) as f64)).sqrt();
        let merge_m = ((1e3 * apart_m).round() / 1e3).max(2.0 * LEAST_GATE_M);
        TrackOptions { merge_m, gate_m: 0.5 * merge_m, ..Self::default() }
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
    extent: Extent,
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
    /// How it moves now, by which it is found again.
    motion: Motion,
    /// How it has moved for a while, by which it goes on where it is seen as one with another: as two come near, their
    /// places stray.
    course: Motion,
    since_s: f64,
    last_seen_s: f64,
    sightings: usize,
    /// Where it began to be seen as one with another.
    merged: Option<Merged>,
}

impl Tracker {
    /// A tracker of contacts on a surface, which is taken to have no edges but a cylinder's rims.
    pub fn new(surface: Surface, options: TrackOptions) -> Self {
        Self::within(surface, Extent::of_surface(surface), options)
    }

    /// A tracker of contacts on the body that some pixels cover.
    pub fn on(pixels: &PixelSpace, options: TrackOptions) -> Self {
        Self::within(pixels.surface, Extent::of_pixels(pixels), options)
    }

    fn within(surface: Surface, extent: Extent, options: TrackOptions) -> Self {
        Tracker { options, surface, extent, tracks: Vec::new(), next_id: 1, last_s: None, tracked: Vec::new() }
    }

    /// Takes the contacts of the next frame in and gives those that count, the oldest first.
    pub fn update(&mut self, sightings: &[Sighting], time_s: f64) -> &[Tracked] {
        let step_s = self.last_s.map_or(0.0, |last_s| (time_s - last_s).max(0.0));
        self.last_s = Some(time_s);
        for track in &mut self.tracks {
            track.motion.predict(&self.surface, step_s, SUDDEN);
            track.course.predict(&self.surface, step_s, STEADY);
        }
        let lasts = |sighting: &&Sighting| sighting.signal >= self.options.release_fraction;
        let sightings: Vec<Sighting> = sightings.iter().filter(lasts).copied().collect();
        let owner = self.assign(&sightings);
        let hidden = self.hidden(&sightings, &owner, time_s);
        self.correct(&sightings, &owner, &hidden, time_s);
        self.end(time_s);
        self.hold_unseen(time_s);
        self.begin(&sightings, &owner, time_s);
        self.tell(time_s)
    }

    /// Ends all contacts; ids are not used again.
    pub fn clear(&mut self) {
        self.tracks.clear();
    }

    /// Which track each sighting belongs to. Contacts that count come first: what may be nothing takes nothing from
    /// them.
    fn assign(&self, sightings: &[Sighting]) -> Vec<Option<usize>> {
        let gate_m = |track: &Track| {
            // Where two that were seen as one part again is hardly known: on either side of what was seen.
            if track.merged.is_some() { 2.0 * self.options.merge_m } else { self.options.gate_m }
        };
        let mut owner = vec![None; sightings.len()];
        for counts in [true, false] {
            let tracks: Vec<usize> =
                (0..self.tracks.len()).filter(|&track| self.tracks[track].id.is_some() == counts).collect();
            let free: Vec<usize> = (0..sightings.len()).filter(|&sighting| owner[sighting].is_none()).collect();
            let apart_m = |track: usize, sighting: usize| {
                let (from_m, to_m) =
                    (self.tracks[tracks[track]].motion.position_m, sightings[free[sighting]].contact.position_m);
                self.surface.distance_m(from_m, to_m)
            };
            // Squares: of steps along one line the sum is the same whichever way round. Beyond the gate all cost alike:
            // a far pair does not push a near one apart.
            let cost = |track: usize, sighting: usize| {
                apart_m(track, sighting).min(2.0 * gate_m(&self.tracks[tracks[track]])).powi(2)
            };
            for (track, sighting) in smallest_total(tracks.len(), free.len(), &cost) {
                if apart_m(track, sighting) <= gate_m(&self.tracks[tracks[track]]) {
                    owner[free[sighting]] = Some(tracks[track]);
                }
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
            if let Some(merged) = &own.merged {
                return time_s - merged.since_s <= self.options.merge_s;
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
            let behind = (0..hidden.len()).filter(|&track| hidden[track] == Some(sighting));
            let members: Vec<usize> = std::iter::once(owner).chain(behind).collect();
            if members.len() == 1 {
                self.tracks[owner].see(seen, &self.surface, time_s);
            } else {
                self.see_together(&members, seen, time_s);
            }
        }
    }

    /// Keeps what is not seen on the body, and what is missed near where it was last seen.
    fn hold_unseen(&mut self, time_s: f64) {
        let most_m_s = self.options.gate_m / self.options.absence_s;
        for track in &mut self.tracks {
            if track.last_seen_s < time_s {
                let reach_m = most_m_s * (time_s - track.last_seen_s);
                track.motion.keep_within(&self.surface, track.contact.position_m, reach_m);
                track.motion.slow_to(most_m_s);
            }
            if track.last_seen_s < time_s || track.merged.is_some() {
                track.motion.position_m = self.extent.nearest(track.motion.position_m);
            }
        }
    }

    /// What is left of the confidence of a contact that is not seen on its own: less and less, none when it is given up.
    fn left_of_confidence(&self, track: &Track, time_s: f64) -> f64 {
        let (unseen_s, most_s) = match &track.merged {
            Some(merged) => (time_s - merged.since_s, self.options.merge_s),
            None => (time_s - track.last_seen_s, self.options.absence_s),
        };
        if unseen_s > 0.0 { (1.0 - unseen_s / most_s).max(0.0) } else { 1.0 }
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
                motion: Motion::at_rest(seen.contact.position_m, SUDDEN),
                course: Motion::at_rest(seen.contact.position_m, STEADY),
                since_s: time_s,
                last_seen_s: time_s,
                sightings: 1,
                merged: None,
            });
        }
        for new in 0..self.tracks.len() {
            let track = &self.tracks[new];
            let often = track.id.is_none() && track.sightings >= self.options.birth_frames;
            if often && (time_s - track.since_s >= self.options.between_s || !self.is_between(new)) {
                self.tracks[new].id = Some(self.next_id);
                self.next_id += 1;
            }
        }
    }

    /// Whether a track lies between contacts, in reach of more than one.
    fn is_between(&self, new: usize) -> bool {
        let from_m = self.tracks[new].motion.position_m;
        let counts = self.tracks.iter().filter(|track| track.id.is_some());
        let apart_m = counts.map(|track| self.surface.distance_m(from_m, track.motion.position_m));
        apart_m.filter(|&apart_m| apart_m <= self.options.merge_m).count() >= 2
    }

    fn tell(&mut self, time_s: f64) -> &[Tracked] {
        self.tracked.clear();
        for track in &self.tracks {
            let Some(id) = track.id else { continue };
            let seen = track.last_seen_s == time_s && track.merged.is_none();
            let mut contact = Contact { id, ..track.contact };
            if !seen {
                contact.position_m = track.motion.position_m;
                contact.confidence *= self.left_of_confidence(track, time_s);
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
        let seen_m = seen.contact.position_m;
        if self.merged.take().is_some() {
            self.motion.jump(seen_m, SUDDEN);
            self.course = self.motion.clone();
            self.course.jump(seen_m, STEADY);
        } else {
            self.motion.correct(surface, seen_m, SUDDEN);
            self.course.correct(surface, seen_m, STEADY);
        }
        self.contact = seen.contact;
        self.last_seen_s = time_s;
        self.sightings += 1;
    }
}
