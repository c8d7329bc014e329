//! Contacts as markers for RViz.

use crate::LiveFrame;
use crate::sinks::ros2::{ColorRGBA, Marker, MarkerArray, Point, Pose, Reference, Vector3};
use dermis::contact::Contact;
use std::time::Duration;

const ARROW: i32 = 0;
const TEXT: i32 = 9;
const ADD: i32 = 0;
const DELETE_ALL: i32 = 3;

/// Lifetime of a marker: much longer than a frame, and short enough that a lost contact disappears soon.
const LIFETIME: Duration = Duration::from_millis(300);
/// Length of an arrow per newton: a firm press of about 5 N has an arrow as long as a finger.
const ARROW_M_PER_N: f64 = 0.01;

/// An arrow for each contact, pointing at it along its normal, with its id as text; without contacts, a message that
/// deletes all markers.
///
/// An arrow is 10 mm long per newton. Where the force is unknown, the arrow of the strongest contact has one sixth of
/// the length of the skin, and the others are scaled by the square root of their strength. All arrows are between 1/40
/// and 1/3 of the skin.
pub fn markers(reference: &Reference, live: &LiveFrame) -> MarkerArray {
    if live.result.contacts.is_empty() {
        let mut all = marker(reference, live, "contacts", 0, ARROW);
        all.action = DELETE_ALL;
        return MarkerArray { markers: vec![all] };
    }
    let extent_m = reference.space.extent_m();
    let contacts = live.result.contacts.iter().map(|tracked| &tracked.contact);
    let strongest = contacts.clone().map(|contact| contact.strength).fold(f64::MIN_POSITIVE, f64::max);
    let mut markers = Vec::with_capacity(2 * live.result.contacts.len());
    for contact in contacts {
        let length_m = if contact.force_n.is_finite() {
            ARROW_M_PER_N * contact.force_n.abs()
        } else {
            extent_m / 6.0 * (contact.strength / strongest).max(0.0).sqrt()
        };
        let length_m = length_m.max(extent_m / 40.0).min(extent_m / 3.0);
        markers.push(arrow(reference, live, contact, length_m));
        markers.push(label(reference, live, contact, length_m));
    }
    MarkerArray { markers }
}

fn arrow(reference: &Reference, live: &LiveFrame, contact: &Contact, length_m: f64) -> Marker {
    let mut arrow = marker(reference, live, "contacts", contact.id as i32, ARROW);
    arrow.points = [above(contact, length_m), contact.position_m].map(|[x, y, z]| Point { x, y, z }).to_vec();
    arrow.scale = Vector3 { x: 0.15 * length_m, y: 0.3 * length_m, z: 0.35 * length_m };
    // Vermilion of Okabe and Ito, 2008: distinguishable with any kind of colour vision.
    arrow.color = ColorRGBA { r: 0.835, g: 0.369, b: 0.0, a: 1.0 };
    arrow
}

fn label(reference: &Reference, live: &LiveFrame, contact: &Contact, length_m: f64) -> Marker {
    let height_m = reference.space.extent_m() / 25.0;
    let mut label = marker(reference, live, "ids", contact.id as i32, TEXT);
    label.pose = Pose::at(above(contact, length_m + height_m));
    label.scale.z = height_m;
    label.color = ColorRGBA { r: 1.0, g: 1.0, b: 1.0, a: 1.0 };
    label.text = contact.id.to_string();
    if contact.force_n.is_finite() {
        label.text += &format!(": {:.1} N", contact.force_n);
    }
    label
}

/// The point above a contact, outside the skin.
fn above(contact: &Contact, height_m: f64) -> [f64; 3] {
    std::array::from_fn(|axis| contact.position_m[axis] + height_m * contact.normal[axis])
}

fn marker(reference: &Reference, live: &LiveFrame, ns: &str, id: i32, kind: i32) -> Marker {
    Marker {
        header: reference.header(live.result.measured_at),
        ns: ns.into(),
        id,
        r#type: kind,
        action: ADD,
        pose: Pose::at([0.0; 3]),
        lifetime: LIFETIME.into(),
        ..Marker::default()
    }
}
