use super::*;
use crate::geom::vector::sub;

const SKIN: Surface = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
const FRAME_S: f64 = 1.0 / 120.0;

fn at(z_m: f64, round_m: f64, strength: f64) -> Sighting {
    let position_m = SKIN.at(z_m, round_m / 0.05).unwrap();
    let contact =
        Contact { strength, sd_m: 0.001, ..Contact::truth(position_m, SKIN.normal(position_m).unwrap(), 2.0) };
    Sighting { contact, signal: 2.0 }
}

fn tracker() -> Tracker {
    Tracker::new(SKIN, TrackOptions::default())
}

#[test]
fn a_contact_counts_from_its_second_frame_and_keeps_its_id_through_a_gap() {
    let mut tracker = tracker();
    let mut ids = Vec::new();
    for frame in 0..20 {
        let seen: &[Sighting] = if (8..12).contains(&frame) { &[] } else { &[at(0.1, 0.0, 1.0)] };
        let tracked = tracker.update(seen, f64::from(frame) * FRAME_S);
        assert_eq!(tracked.len(), usize::from(frame > 0), "frame {frame}");
        ids.extend(tracked.iter().map(|tracked| tracked.contact.id));
    }
    assert!(ids.iter().all(|&id| id == 1));
    assert!(tracker.update(&[], 1.0).is_empty());
    tracker.update(&[at(0.1, 0.0, 1.0)], 1.1);
    assert_eq!(tracker.update(&[at(0.1, 0.0, 1.0)], 1.1 + FRAME_S)[0].contact.id, 2, "ids are not used again");
}

#[test]
fn a_weak_signal_ends_nothing_and_begins_nothing() {
    let mut tracker = tracker();
    let weak = Sighting { signal: 0.8, ..at(0.1, 0.0, 1.0) };
    for frame in 0..5 {
        assert!(tracker.update(&[weak], f64::from(frame) * FRAME_S).is_empty());
    }
    for frame in 5..8 {
        tracker.update(&[at(0.1, 0.0, 1.0)], f64::from(frame) * FRAME_S);
    }
    for frame in 8..40 {
        assert_eq!(tracker.update(&[weak], f64::from(frame) * FRAME_S).len(), 1);
    }
}

#[test]
fn a_slide_across_the_seam_is_one_contact_of_the_right_speed() {
    let mut tracker = tracker();
    for frame in 0..240 {
        let round_m = -0.1 + 0.1 * f64::from(frame) * FRAME_S;
        let tracked = tracker.update(&[at(0.1, round_m, 1.0)], f64::from(frame) * FRAME_S);
        if frame > 0 {
            assert_eq!((tracked.len(), tracked[0].contact.id), (1, 1));
        }
        if frame > 60 {
            let speed = tracked[0].velocity_m_s.iter().map(|v| v * v).sum::<f64>().sqrt();
            assert!((speed - 0.1).abs() < 0.005, "frame {frame}: {speed} m/s");
        }
    }
}

/// Two contacts cross; within 40 mm the image shows one at their middle, with the strength of both.
#[test]
fn contacts_that_cross_keep_their_ids() {
    let mut tracker = tracker();
    for frame in 0..240 {
        let time_s = f64::from(frame) * FRAME_S;
        let (a, b) = (-0.1 + 0.1 * time_s, 0.1 - 0.1 * time_s);
        let apart = (a - b).abs();
        let seen = if apart < 0.04 {
            vec![at(0.15, 0.4 * a + 0.6 * b, 2.5)]
        } else if frame % 2 == 0 {
            vec![at(0.15, a, 1.0), at(0.15, b, 1.5)]
        } else {
            vec![at(0.15, b, 1.5), at(0.15, a, 1.0)]
        };
        let tracked = tracker.update(&seen, time_s);
        if frame > 0 {
            assert_eq!(tracked.len(), 2, "frame {frame}, {apart} m apart");
            let first = SKIN.at(0.15, a / 0.05).unwrap();
            let of_first = if tracked[0].contact.strength == 1.0 { &tracked[0] } else { &tracked[1] };
            let off_m = SKIN.distance_m(of_first.contact.position_m, first);
            assert!(off_m < 0.006, "frame {frame}: {off_m} m off");
        }
    }
    assert_eq!(tracker.next_id, 3);
}

#[test]
fn a_contact_lifted_beside_another_ends_at_once() {
    let mut tracker = tracker();
    for frame in 0..30 {
        tracker.update(&[at(0.10, 0.0, 1.0), at(0.15, 0.0, 1.0)], f64::from(frame) * FRAME_S);
    }
    for frame in 30..60 {
        tracker.update(&[at(0.10, 0.0, 1.0)], f64::from(frame) * FRAME_S);
    }
    let left: Vec<u64> = tracker.tracks.iter().filter_map(|track| track.id).collect();
    assert_eq!(left.len(), 1);
    assert!(sub(tracker.tracks[0].contact.position_m, SKIN.at(0.1, 0.0).unwrap()).iter().all(|d| d.abs() < 1e-9));
}
