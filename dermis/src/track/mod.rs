//! Tracking of contacts from frame to frame with permanent ids.
//!
//! A track predicts the motion of its contact (a Kalman filter of constant velocity); predictions and contacts are
//! assigned at the smallest total distance. A contact is confirmed after it has exceeded the threshold in
//! [`TrackOptions::birth_frames`] consecutive frames, and ends after it has been below a lower threshold for
//! [`TrackOptions::absence_s`]. Two contacts too close to be resolved merge into one in the image: then both tracks
//! continue, each along its own line as far as the observed centre is consistent with it, until they separate again.
//!
//! A contact that is not seen is predicted further, but stays on the body, and moves slowly enough to stay within its
//! [gate](TrackOptions::gate_m) while it is missed; its confidence decreases linearly to zero at the time at which the
//! track ends.

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

/// Contacts with a higher approach speed than this will merge, m/s: it exceeds the apparent speed of a stationary
/// finger.
const CLOSING_M_S: f64 = 0.03;

/// Tracking options.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrackOptions {
    /// Number of consecutive frames in which a contact must be detected before it is confirmed.
    pub birth_frames: usize,
    /// A contact that is not detected for longer than this has ended, s.
    pub absence_s: f64,
    /// A confirmed contact continues while its signal exceeds this fraction of the threshold to begin.
    pub release_fraction: f64,
    /// A contact farther than this from the predicted position of a track does not belong to it, m.
    pub gate_m: f64,
    /// Contacts closer than this may be merged in the image, m: the separation that the method resolves.
    pub merge_m: f64,
    /// Two contacts that are merged for longer than this are one, s.
    pub merge_s: f64,
    /// Between two contacts, closer than [`merge_m`](Self::merge_m) to both, a third must be detected for this time
    /// before it is confirmed, s: if two touches are barely resolved, images show spots between them.
    pub between_s: f64,
}

impl Default for TrackOptions {
    fn default() -> Self {
        TrackOptions {
            birth_frames: 2,
            absence_s: 0.05,
            release_fraction: 0.7,
            // At 120 frames per second a fast stroke of 1 m/s moves 8 mm; errors change by a few mm when patches close.
            gate_m: 0.03,
            merge_m: 0.06,
            merge_s: 2.0,
            between_s: 0.15,
        }
    }
}

/// Minimum gate, m: the distance per frame of a fast stroke of 1 m/s at 120 frames per second, for any skin.
const MIN_GATE_M: f64 = 0.008;

impl TrackOptions {
    /// The options for a skin, from its pixels and its number of electrodes; for the paper's skin the default ones.
    ///
    /// Image errors and the resolved separation are proportional to the electrode spacing. Distributed uniformly over
    /// the body's area `A` in a triangular grid, `n` electrodes are `sqrt(2 A / (sqrt(3) n))` apart: this, in whole
    /// millimetres, is [`merge_m`](Self::merge_m), and half of it [`gate_m`](Self::gate_m).
    pub fn for_skin(pixels: &PixelSpace, electrode_count: usize) -> Self {
        let area_m2 = pixels.areas.iter().sum::<f64>();
        let apart_m = (2.0 * area_m2 / (3f64.sqrt() * electrode_count.max(1) as f64)).sqrt();
        let merge_m = ((1e3 * apart_m).round() / 1e3).max(2.0 * MIN_GATE_M);
        TrackOptions { merge_m, gate_m: 0.5 * merge_m, ..Self::default() }
    }
}

/// A contact found in a frame, and its signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The contact.
    pub contact: Contact,
    /// Its signal over the threshold to begin; above [`TrackOptions::release_fraction`] a contact may continue.
    pub signal: f64,
}

/// A tracked contact.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tracked {
    /// The contact with its permanent id: as last seen, moved to its predicted position while it is hidden.
    pub contact: Contact,
    /// Its velocity, m/s.
    pub velocity_m_s: Point3,
    /// Its start time, s on the clock of the frames.
    pub since_s: f64,
    /// Whether it is separate in the image; if not, it is merged with another contact or temporarily missing.
    pub seen: bool,
}

/// Tracks contacts.
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
    /// The id, once the contact is confirmed.
    id: Option<u64>,
    contact: Contact,
    /// Its current motion, used for assignment.
    motion: Motion,
    /// Its motion over a longer time, used while it is merged with another: as two contacts approach each other, their
    /// position errors grow.
    course: Motion,
    since_s: f64,
    last_seen_s: f64,
    sightings: usize,
    /// It ends unless it exceeds the threshold to begin again.
    #[serde(default)]
    must_exceed: bool,
    /// The start of the merge with another contact.
    merged: Option<Merged>,
}

impl Tracker {
    /// A tracker of contacts on a surface without edges except a cylinder's rims.
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

    /// Processes the contacts of the next frame and returns the confirmed ones, the oldest first.
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
        self.report(time_s)
    }

    /// Ends contacts that have begun since `since_s`, unless they exceed the threshold to begin again within
    /// [`TrackOptions::absence_s`].
    pub fn begin_again(&mut self, since_s: f64) {
        let begun = self.tracks.iter_mut().filter(|track| track.since_s >= since_s);
        begun.for_each(|track| track.must_exceed = true);
    }

    /// Whether it has contacts that had begun before `time_s`.
    pub fn has_older(&self, time_s: f64) -> bool {
        self.tracks.iter().any(|track| track.id.is_some() && track.since_s < time_s)
    }

    /// Ends all contacts; ids are not used again.
    pub fn clear(&mut self) {
        self.tracks.clear();
    }

    /// The track of each sighting. Confirmed contacts are assigned first, so that an unconfirmed one takes no sighting
    /// from them.
    fn assign(&self, sightings: &[Sighting]) -> Vec<Option<usize>> {
        let gate_m = |track: &Track| {
            // The positions of two contacts after a merge are uncertain: on either side of the merged sighting.
            if track.merged.is_some() { 2.0 * self.options.merge_m } else { self.options.gate_m }
        };
        let mut owner = vec![None; sightings.len()];
        for counts in [true, false] {
            let tracks: Vec<usize> =
                (0..self.tracks.len()).filter(|&track| self.tracks[track].id.is_some() == counts).collect();
            let free: Vec<usize> = (0..sightings.len()).filter(|&sighting| owner[sighting].is_none()).collect();
            let apart_m = |track: usize, sighting: usize| {
                let (track, seen) = (&self.tracks[tracks[track]], &sightings[free[sighting]].contact);
                match track.contact.conductance == seen.conductance {
                    true => self.surface.distance_m(track.motion.position_m, seen.position_m),
                    false => f64::INFINITY,
                }
            };
            // Squared distances: for steps along one line the plain sum is the same for both assignments. Beyond the
            // gate all costs are equal: a distant pair does not affect the assignment of a close one.
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

    /// For each unseen track the sighting that may be itself and its neighbour merged.
    ///
    /// A sighting of two merged contacts is stronger than the single contact was, or has moved from its predicted
    /// position towards the centre of both, or the two were approaching each other; if the neighbour was lifted, none
    /// of these is true.
    fn hidden(&self, sightings: &[Sighting], owner: &[Option<usize>], time_s: f64) -> Vec<Option<usize>> {
        let merges = |track: usize, sighting: usize| {
            let (own, seen) = (&self.tracks[track], &sightings[sighting].contact);
            let Some(other) = owner[sighting].map(|other| &self.tracks[other]) else { return false };
            if own.id.is_none() || other.id.is_none() || own.contact.conductance != seen.conductance {
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

    /// Keeps unseen contacts on the body, and missed contacts near the position where they were last seen.
    fn hold_unseen(&mut self, time_s: f64) {
        let most_m_s = self.options.gate_m / self.options.absence_s;
        for track in &mut self.tracks {
            if track.last_seen_s < time_s {
                let reach_m = most_m_s * (time_s - track.last_seen_s);
                track.motion.clamp_to(&self.surface, track.contact.position_m, reach_m);
                track.motion.limit_speed(most_m_s);
            }
            if track.last_seen_s < time_s || track.merged.is_some() {
                track.motion.position_m = self.extent.nearest(track.motion.position_m);
            }
        }
    }

    /// The remaining confidence of a contact that is not seen separately: it decreases to zero at the end of the track.
    fn left_of_confidence(&self, track: &Track, time_s: f64) -> f64 {
        let (unseen_s, most_s) = match &track.merged {
            Some(merged) => (time_s - merged.since_s, self.options.merge_s),
            None => (time_s - track.last_seen_s, self.options.absence_s),
        };
        if unseen_s > 0.0 { (1.0 - unseen_s / most_s).max(0.0) } else { 1.0 }
    }

    /// Ends tracks that have been absent too long, and unconfirmed tracks without a detection.
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
                must_exceed: false,
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

    /// Whether a track is between contacts, within the merge distance of more than one.
    fn is_between(&self, new: usize) -> bool {
        let from_m = self.tracks[new].motion.position_m;
        let counts = self.tracks.iter().filter(|track| track.id.is_some());
        let apart_m = counts.map(|track| self.surface.distance_m(from_m, track.motion.position_m));
        apart_m.filter(|&apart_m| apart_m <= self.options.merge_m).count() >= 2
    }

    fn report(&mut self, time_s: f64) -> &[Tracked] {
        self.tracked.clear();
        for track in &self.tracks {
            let Some(id) = track.id else { continue };
            let seen = track.last_seen_s == time_s && track.merged.is_none();
            let mut contact = Contact { id, ..track.contact };
            if !seen {
                contact.position_m = track.motion.position_m;
                contact.confidence *= self.left_of_confidence(track, time_s);
                contact.normal = self.surface.normal(contact.position_m).unwrap_or(contact.normal);
                // It is between its last seen and its predicted position.
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
    /// Update of a track that is seen separately.
    fn see(&mut self, seen: &Sighting, surface: &Surface, time_s: f64) {
        if (self.id.is_none() || self.must_exceed) && seen.signal < 1.0 {
            return;
        }
        self.must_exceed = false;
        let seen_m = seen.contact.position_m;
        if self.merged.take().is_some() {
            self.motion.reset_position(seen_m, SUDDEN);
            self.course = self.motion.clone();
            self.course.reset_position(seen_m, STEADY);
        } else {
            self.motion.correct(surface, seen_m, SUDDEN);
            self.course.correct(surface, seen_m, STEADY);
        }
        self.contact = seen.contact;
        self.last_seen_s = time_s;
        self.sightings += 1;
    }
}
