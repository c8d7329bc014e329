//! Touches over the seam of two skins, and the ids of a robot's contacts.

use crate::file::Robot;
use crate::pose::Pose;
use dermis::contact::Contact;
use dermis::geom::vector::{add, distance, dot, norm, scale, sub};
use dermis::pipeline::TrackedContact;
use std::collections::BTreeMap;

/// Skins whose edges are farther apart than this have no seam, m.
pub const SEAM_M: f64 = 0.015;
/// Standard deviations within which two places agree.
const SDS: f64 = 2.0;
/// Cosine of the largest angle of two skins at their seam: beyond it they are the two faces of a plate.
const FACES: f64 = -0.5;
/// Cosine of the smallest angle of the normals of two skins that touch each other.
const OPPOSED: f64 = -0.7;
/// Largest distance of two skins that touch each other, across them, m: their foams are pressed, and they are mounted to some
/// millimetres.
const FACES_M: f64 = 0.01;

/// A contact of a skin: the skin by index, and the contact's id there.
pub(crate) type Key = (usize, u64);

/// Which contacts of skins that are fixed to each other are one touch over their seam.
///
/// Each skin sees the part of a touch that lies on it. Two contacts are one touch if each reaches the edge of its skin, and if the
/// two are opposite each other: their distance is that of both to their edges and of the seam between, up to the extent of
/// the contacts along it. They stay one while one of them reaches its edge.
///
/// The flank of a Gaussian touch whose half width at half its peak is `h` holds at most the share `s = 2^(-(c/h)^2) / 2` beyond the
/// distance `c` from its middle (Chernoff's bound of the normal distribution): a part with the share `s` of the strength of both is
/// that of a touch whose middle is within `h sqrt(log2(1 / 2s))` of the edge.
#[derive(Debug, Clone, Default)]
pub(crate) struct Seams {
    /// Skins that are fixed to each other, and the pose of the second's frame in the first's.
    pairs: Vec<(usize, usize, Pose)>,
    joined: Vec<[Key; 2]>,
    /// The contacts of each touch, the oldest first.
    touches: Vec<Vec<Key>>,
    ids: BTreeMap<Key, u64>,
    last_id: u64,
}

impl Seams {
    pub(crate) fn new(robot: &Robot) -> Self {
        let pairs = robot.fixed_pairs();
        Seams { pairs, joined: Vec::new(), touches: Vec::new(), ids: BTreeMap::new(), last_id: 0 }
    }

    /// Takes the contacts of each skin; of a skin that is unknown none.
    pub(crate) fn update(&mut self, contacts: &[&[TrackedContact]]) {
        self.joined = self.pairs.iter().flat_map(|pair| self.joined_over(pair, contacts)).collect();
        let mut keys: Vec<(Key, &TrackedContact)> = Vec::new();
        for (skin, contacts) in contacts.iter().enumerate() {
            keys.extend(contacts.iter().map(|tracked| ((skin, tracked.contact.id), tracked)));
        }
        keys.sort_by_key(|(key, tracked)| (tracked.since, *key));
        self.touches = keys.iter().map(|(key, _)| vec![*key]).collect();
        for pair in &self.joined {
            let place = |key: &Key| self.touches.iter().position(|touch| touch.contains(key));
            if let [Some(a), Some(b)] = pair.each_ref().map(place)
                && a != b
            {
                let later = self.touches.remove(a.max(b));
                self.touches[a.min(b)].extend(later);
            }
        }
        self.number();
    }

    /// Gives each touch an id that no other one has had: that of its oldest contact.
    fn number(&mut self) {
        let known = std::mem::take(&mut self.ids);
        let mut given: Vec<u64> = Vec::new();
        for touch in &self.touches {
            let before = touch.iter().filter_map(|key| known.get(key)).min();
            let id = *before.filter(|id| !given.contains(id)).unwrap_or(&(self.last_id + 1));
            self.last_id = self.last_id.max(id);
            given.push(id);
            self.ids.extend(touch.iter().map(|key| (*key, id)));
        }
    }

    /// The contacts of two skins that are one touch each, each contact with one of the other skin at most.
    fn joined_over(&self, (a, b, pose): &(usize, usize, Pose), contacts: &[&[TrackedContact]]) -> Vec<[Key; 2]> {
        let mut found: Vec<(bool, f64, [Key; 2])> = Vec::new();
        for first in contacts[*a] {
            for second in contacts[*b] {
                let keys = [(*a, first.contact.id), (*b, second.contact.id)];
                let is_new = !self.joined.contains(&keys);
                if let Some(apart_m) = are_one(&first.contact, &second.contact, pose, is_new) {
                    found.push((is_new, apart_m, keys));
                }
            }
        }
        // Those that are one already, then the nearest.
        found.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut pairs: Vec<[Key; 2]> = Vec::new();
        for (.., keys) in found {
            if !pairs.iter().flatten().any(|key| keys.contains(key)) {
                pairs.push(keys);
            }
        }
        pairs
    }

    /// Whether two skins are fixed to each other.
    pub(crate) fn are_fixed(&self, a: usize, b: usize) -> bool {
        self.pairs.iter().any(|(first, second, _)| (*first, *second) == (a.min(b), a.max(b)))
    }

    /// The contacts of each touch, the oldest first.
    pub(crate) fn touches(&self) -> &[Vec<Key>] {
        &self.touches
    }

    /// The id of the touch that a contact is part of.
    pub(crate) fn id(&self, key: Key) -> Option<u64> {
        self.ids.get(&key).copied()
    }

    /// The pose of the frame of a skin in that of another one to which it is fixed.
    fn pose(&self, of: usize, within: usize) -> Pose {
        let found = self.pairs.iter().find_map(|(a, b, pose)| match (*a == within, *b == of) {
            (true, true) => Some(*pose),
            _ if *b == within && *a == of => Some(pose.inverse()),
            _ => None,
        });
        found.unwrap_or(Pose::IDENTITY)
    }

    /// A touch of several skins, in the frame of the first: the mean place, weighted by force, or by strength where a force is
    /// unknown, and the sums of forces, strengths and areas. The deviations are those of errors that the skins have in common.
    /// It has no edge any more, and its form is not known.
    pub(crate) fn joined(&self, parts: &[(usize, &TrackedContact)]) -> Option<TrackedContact> {
        let (&(first, oldest), _) = parts.split_first()?;
        let has_forces = parts.iter().all(|(_, part)| part.contact.force_n > 0.0);
        let weight =
            |part: &TrackedContact| if has_forces { part.contact.force_n } else { part.contact.strength.abs() };
        let total: f64 = parts.iter().map(|(_, part)| weight(part)).sum();
        let share = |part: &TrackedContact| if total > 0.0 { weight(part) / total } else { 1.0 / parts.len() as f64 };
        let mean = |of: &dyn Fn(&TrackedContact, &Pose) -> [f64; 3]| {
            let of_part = |(skin, part): &(usize, &TrackedContact)| {
                let pose = if *skin == first { Pose::IDENTITY } else { self.pose(*skin, first) };
                scale(of(part, &pose), share(part))
            };
            parts.iter().map(of_part).fold([0.0; 3], add)
        };
        let sum = |of: fn(&Contact) -> f64| parts.iter().map(|(_, part)| of(&part.contact)).sum::<f64>();
        let normal = mean(&|part, pose| pose.vector(part.contact.normal));
        Some(TrackedContact {
            contact: Contact {
                position_m: mean(&|part, pose| pose.point(part.contact.position_m)),
                normal: scale(normal, 1.0 / norm(normal)),
                force_n: sum(|contact| contact.force_n),
                force_sd_n: sum(|contact| contact.force_sd_n),
                strength: sum(|contact| contact.strength),
                area_m2: sum(|contact| contact.area_m2),
                direction: [f64::NAN; 3],
                half_length_m: f64::NAN,
                half_width_m: f64::NAN,
                edge_m: f64::NAN,
                sd_m: parts.iter().map(|(_, part)| share(part) * part.contact.sd_m).sum(),
                confidence: parts.iter().map(|(_, part)| part.contact.confidence).fold(0.0, f64::max),
                ..oldest.contact
            },
            centroid_m: mean(&|part, pose| pose.point(part.centroid_m)),
            centre_of_pressure_m: mean(&|part, pose| pose.point(part.centre_of_pressure_m)),
            velocity_m_s: mean(&|part, pose| pose.vector(part.velocity_m_s)),
            seen: parts.iter().any(|(_, part)| part.seen),
            ..oldest.clone()
        })
    }
}

/// Whether two contacts, in one frame, are where their skins touch each other.
pub(crate) fn are_faces(a: &Contact, b: &Contact) -> bool {
    let apart = sub(b.position_m, a.position_m);
    let across_m = dot(apart, a.normal);
    let along_m = norm(sub(apart, scale(a.normal, across_m)));
    across_m.abs() <= FACES_M && along_m <= offset_m(a, b) && dot(a.normal, b.normal) < OPPOSED
}

/// How far two contacts may be apart along a surface and be at one place, m: by their extent and deviations.
fn offset_m(a: &Contact, b: &Contact) -> f64 {
    extent_m(a).max(extent_m(b)) + SDS * known(a.sd_m).hypot(known(b.sd_m))
}

/// The extent of a contact; of one without a form the radius of the disc of its area.
fn extent_m(contact: &Contact) -> f64 {
    let disc_m = (known(contact.area_m2) / std::f64::consts::PI).sqrt();
    let form_m = contact.half_length_m.max(contact.half_width_m);
    if form_m.is_finite() { form_m } else { disc_m }
}

fn known(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

/// The distance of two contacts that are one touch over a seam, m; `pose` is that of the second's frame in the first's.
fn are_one(a: &Contact, b: &Contact, pose: &Pose, is_new: bool) -> Option<f64> {
    let reaches = |contact: &Contact, other: &Contact| {
        let share = other.strength.abs() / (contact.strength.abs() + other.strength.abs());
        // A share of a quarter or more, and an unknown one, are that of a touch of which the edge cuts more than a flank.
        let far = (-(2.0 * share).log2()).sqrt().max(1.0);
        contact.edge_m <= far * extent_m(contact) + SDS * known(contact.sd_m)
    };
    let is_at_edge = if is_new { reaches(a, b) && reaches(b, a) } else { reaches(a, b) || reaches(b, a) };
    let apart_m = distance(a.position_m, pose.point(b.position_m));
    let along_m = offset_m(a, b);
    let is_opposite = apart_m <= (a.edge_m + b.edge_m + SEAM_M).hypot(along_m);
    let meets = dot(a.normal, pose.vector(b.normal)) > FACES;
    (is_at_edge && is_opposite && meets).then_some(apart_m)
}
