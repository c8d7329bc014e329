use super::*;
use crate::geom::vector::{norm, sub};

const SKIN: Surface = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
const FRAME_S: f64 = 1.0 / 120.0;

fn at(z_m: f64, round_m: f64, strength: f64) -> Sighting {
    let position_m = SKIN.at(z_m, round_m / 0.05).unwrap();
    let contact =
        Contact { strength, sd_m: 0.001, ..Contact::truth(position_m, SKIN.normal(position_m).unwrap(), 2.0) };
    Sighting { contact, signal: 2.0 }
}

fn contact_at(position_m: Point3) -> Contact {
    Contact::truth(position_m, [0.0, 0.0, 1.0], 2.0)
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
fn a_weak_signal_ends_nothing_and_begins_nothing_and_a_weaker_one_is_none() {
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
    let gone = Sighting { signal: 0.69, ..weak };
    let left: Vec<usize> = (40..50).map(|frame| tracker.update(&[gone], f64::from(frame) * FRAME_S).len()).collect();
    assert_eq!(left[9], 0, "{left:?}");
}

#[test]
fn contacts_since_a_time_have_to_exceed_the_threshold_again() {
    let weak = |z_m| Sighting { signal: 0.8, ..at(z_m, 0.0, 1.0) };
    let mut tracker = tracker();
    let strong = [at(0.1, 0.0, 1.0), at(0.2, 0.0, 1.0), at(0.28, 0.0, 1.0)];
    (0..5).for_each(|frame| drop(tracker.update(&strong[..1], f64::from(frame) * FRAME_S).to_vec()));
    (5..10).for_each(|frame| drop(tracker.update(&strong, f64::from(frame) * FRAME_S).to_vec()));
    tracker.begin_again(5.0 * FRAME_S);
    assert!(tracker.has_older(5.0 * FRAME_S) && !tracker.has_older(0.0));
    let mut left = Vec::new();
    for frame in 10..30 {
        let third = if frame < 12 { strong[2] } else { weak(0.28) };
        let tracked = tracker.update(&[weak(0.1), weak(0.2), third], f64::from(frame) * FRAME_S);
        left = tracked.iter().map(|tracked| tracked.contact.id).collect();
    }
    let names: Vec<f64> = tracker.tracks.iter().map(|track| track.contact.position_m[2]).collect();
    assert_eq!(left.len(), 2, "{names:?}");
    assert_eq!(left[0], 1, "the older one continues, and the one that exceeded the threshold");
    assert!(names.iter().all(|z_m| (z_m - 0.2).abs() > 0.01), "{names:?}");
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

/// Two contacts cross; within 40 mm the image shows one at their centre, with the strength of both.
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
fn a_contact_lifted_next_to_another_ends_immediately() {
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

/// Two contacts with given positions along the axis and around it, seen as one in their centre within 35 mm: returns
/// whether each keeps its id after they separate.
fn keep_ids(
    seconds: f64,
    places: impl Fn(f64) -> [[f64; 2]; 2],
    seen_at: impl Fn([[f64; 2]; 2]) -> [[f64; 2]; 2],
) -> bool {
    let mut tracker = tracker();
    let mut kept = true;
    for frame in 0..(seconds / FRAME_S) as usize {
        let time_s = frame as f64 * FRAME_S;
        let truth = places(time_s);
        let apart_m = (truth[0][0] - truth[1][0]).hypot(truth[0][1] - truth[1][1]);
        let spot = |[along_m, round_m]: [f64; 2], strength| at(0.15 + along_m, round_m, strength);
        let [a, b] = seen_at(truth);
        let seen = if apart_m < 0.035 {
            vec![spot([0, 1].map(|axis| 0.5 * (a[axis] + b[axis])), 2.0)]
        } else if frame % 2 == 0 {
            vec![spot(a, 1.0), spot(b, 1.0)]
        } else {
            vec![spot(b, 1.0), spot(a, 1.0)]
        };
        let tracked = tracker.update(&seen, time_s);
        if frame > 0 {
            let first = spot(a, 1.0).contact.position_m;
            let off_m = |tracked: &Tracked| SKIN.distance_m(tracked.contact.position_m, first);
            kept &= tracked.len() == 2 && (seen.len() == 1 || off_m(&tracked[0]) < off_m(&tracked[1]));
        }
    }
    kept && tracker.next_id == 3
}

/// The position of a finger after a given distance along its path, at an angle to the axis.
fn on_way(angle: f64, way_m: f64) -> [f64; 2] {
    [way_m * angle.cos(), way_m * angle.sin()]
}

#[test]
fn contacts_that_meet_at_an_angle_keep_their_ids_whether_they_go_on_or_back() {
    for degrees in [45.0f64, 70.0, 90.0, 120.0, 150.0] {
        let angle = 0.5 * degrees.to_radians();
        let pair = |way_m: f64| [on_way(angle, way_m), on_way(-angle, way_m)];
        assert!(keep_ids(1.6, |time_s| pair(-0.08 + 0.1 * time_s), |truth| truth), "on, {degrees} degrees");
        // Until they are 16 mm apart, 0.3 s there, and back.
        let near_m = 0.008 / angle.sin();
        let turn_s = (0.08 - near_m) / 0.1;
        let back = |time_s: f64| {
            let way_s = if time_s < turn_s + 0.3 { time_s.min(turn_s) } else { 2.0 * turn_s + 0.3 - time_s };
            pair(-0.08 + 0.1 * way_s)
        };
        assert!(keep_ids(2.0 * turn_s + 0.3, back, |truth| truth), "back, {degrees} degrees");
    }
}

#[test]
fn a_contact_slides_past_one_that_rests_or_overtakes_one_that_is_slower() {
    for past_m in [0.0, 0.01, 0.02] {
        assert!(keep_ids(1.6, |time_s| [[-0.08 + 0.1 * time_s, 0.0], [0.0, past_m]], |truth| truth), "{past_m} m");
        let slower = |time_s: f64| [[-0.08 + 0.15 * time_s, 0.0], [-0.02 + 0.05 * time_s, past_m]];
        assert!(keep_ids(1.2, slower, |truth| truth), "{past_m} m");
    }
}

/// As two touches approach each other the position error of the weaker spot grows, here up to 12 mm, before they merge.
#[test]
fn a_place_that_strays_before_a_merge_exchanges_nothing() {
    for degrees in [60.0f64, 90.0, 120.0] {
        let angle = 0.5 * degrees.to_radians();
        let places = |time_s: f64| [on_way(angle, -0.08 + 0.1 * time_s), on_way(-angle, -0.08 + 0.1 * time_s)];
        for side in [-1.0, 1.0] {
            let strays = |[a, b]: [[f64; 2]; 2]| {
                let apart_m = (a[0] - b[0]).hypot(a[1] - b[1]);
                let near = ((0.055 - apart_m) / 0.02).clamp(0.0, 1.0);
                let before = a[0] < 0.0 && apart_m > 0.035;
                [[a[0] + if before { side * 0.012 * near } else { 0.0 }, a[1]], b]
            };
            assert!(keep_ids(1.6, places, strays), "{degrees} degrees, side {side}");
        }
    }
}

#[test]
fn a_spot_between_two_contacts_counts_only_once_it_lasts() {
    let mut tracker = tracker();
    for frame in 0..60 {
        let mut seen = vec![at(0.12, 0.0, 1.0), at(0.17, 0.0, 1.0)];
        // First for a tenth of a second, later permanently.
        if (10..22).contains(&frame) || frame >= 30 {
            seen.push(at(0.145, 0.002, 1.0));
        }
        let count = tracker.update(&seen, f64::from(frame) * FRAME_S).len();
        assert_eq!(count, if frame == 0 { 0 } else { 2 + usize::from(frame >= 48) }, "frame {frame}");
    }
    // Next to only one contact it is confirmed immediately.
    for frame in 60..64 {
        let seen = [at(0.12, 0.0, 1.0), at(0.17, 0.0, 1.0), at(0.145, 0.002, 1.0), at(0.22, 0.0, 1.0)];
        assert_eq!(tracker.update(&seen, f64::from(frame) * FRAME_S).len(), 3 + usize::from(frame > 60));
    }
}

#[test]
fn what_does_not_count_yet_takes_nothing_from_what_does() {
    let mut tracker = tracker();
    for frame in 0..10 {
        tracker.update(&[at(0.10, 0.0, 1.0)], f64::from(frame) * FRAME_S);
    }
    tracker.update(&[at(0.10, 0.0, 1.0), at(0.11, 0.0, 1.0)], 10.0 * FRAME_S);
    let tracked = tracker.update(&[at(0.106, 0.0, 1.0)], 11.0 * FRAME_S);
    assert_eq!((tracked.len(), tracked[0].contact.id, tracked[0].seen), (1, 1, true));
}

/// With the sum of distances one would stay and the other would jump over it.
#[test]
fn contacts_that_jump_along_their_line_stay_in_order() {
    for turned in [false, true] {
        let mut tracker = tracker();
        for frame in 0..10 {
            tracker.update(&[at(0.10, 0.0, 1.0), at(0.11, 0.003, 2.0)], f64::from(frame) * FRAME_S);
        }
        let mut seen = [at(0.112, 0.003, 1.0), at(0.122, 0.0, 2.0)];
        if turned {
            seen.reverse();
        }
        let strengths: Vec<f64> =
            tracker.update(&seen, 10.0 * FRAME_S).iter().map(|tracked| tracked.contact.strength).collect();
        assert_eq!(strengths, [1.0, 2.0]);
    }
}

#[test]
fn merged_contacts_that_stop_stay_within_the_merge_distance() {
    let mut tracker = tracker();
    for frame in 0..180 {
        let time_s = f64::from(frame) * FRAME_S;
        let way_m = (0.1 * time_s).min(0.06);
        let seen = if way_m < 0.06 {
            vec![at(0.09 + way_m, 0.0, 1.0), at(0.21 - way_m, 0.0, 1.0)]
        } else {
            vec![at(0.15, 0.0, 2.0)]
        };
        let tracked = tracker.update(&seen, time_s);
        let middle = SKIN.at(0.15, 0.0).unwrap();
        let off_m = |tracked: &Tracked| SKIN.distance_m(tracked.contact.position_m, middle);
        assert!(frame == 0 || tracked.len() == 2, "frame {frame}");
        assert!(way_m < 0.06 || tracked.iter().all(|tracked| off_m(tracked) < 0.0361), "frame {frame}");
    }
}

#[test]
fn what_is_missed_stays_on_the_body_near_where_it_was_and_loses_confidence() {
    let design = crate::design::SkinDesign::shipped("skin16").unwrap();
    let mesh = crate::mesh::Mesh::generate(&design).unwrap();
    let pixels = crate::image::PixelSpace::for_design(&design, &mesh).unwrap();
    let options = TrackOptions::for_skin(&pixels, design.electrodes.len());
    let mut tracker = Tracker::on(&pixels, options);
    let at = |x_m: f64| Sighting {
        contact: Contact { sd_m: 0.001, confidence: 0.8, ..contact_at([x_m, 0.0, 0.0]) },
        signal: 2.0,
    };
    // Two noise spots make a contact that seems to move outwards at 0.6 m/s or more.
    for (frame, x_m) in [0.024, 0.030, 0.036].into_iter().enumerate() {
        tracker.update(&[at(x_m)], frame as f64 * FRAME_S);
    }
    let mut before = 0.8;
    for frame in 3..8 {
        let tracked = tracker.update(&[], f64::from(frame) * FRAME_S)[0];
        let contact = tracked.contact;
        assert!(!tracked.seen && norm(contact.position_m) < 0.0415, "{:?}", contact.position_m);
        assert!(contact.sd_m < options.gate_m + 0.001 && contact.confidence < before, "{contact:?}");
        before = contact.confidence;
    }
    assert!(before < 0.2 * 0.8, "most of the confidence is gone when it is given up: {before}");
    assert!(tracker.update(&[], 1.0).is_empty());
}

#[test]
fn lengths_follow_the_electrodes_and_those_of_the_papers_skin_are_the_default_ones() {
    let lengths = |name: &str| {
        let design = crate::design::SkinDesign::shipped(name).unwrap();
        let mesh = crate::mesh::Mesh::generate(&design).unwrap();
        let pixels = crate::image::PixelSpace::for_design(&design, &mesh).unwrap();
        TrackOptions::for_skin(&pixels, design.electrodes.len())
    };
    assert_eq!(lengths("cylinder30"), TrackOptions::default());
    for (name, merge_m) in [("skin16", 0.019), ("tank16", 0.048)] {
        let options = lengths(name);
        assert!((options.merge_m - merge_m).abs() < 1e-9 && options.gate_m == 0.5 * options.merge_m, "{options:?}");
    }
}
