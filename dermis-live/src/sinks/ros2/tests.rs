use super::*;
use crate::synthetic;
use dermis::pipeline::{ElectrodeState, InvalidReason, Validity};

/// Bytes computed by hand from the rules of CDR: numbers are aligned to multiples of their size, counted after the
/// header of four bytes.
#[test]
fn the_bytes_of_a_header_are_those_of_cdr() {
    let header = Header { stamp: Time { sec: 1, nanosec: 2 }, frame_id: "skin".into() };
    let expected = [&[0, 1, 0, 0][..], &[1, 0, 0, 0], &[2, 0, 0, 0], &[5, 0, 0, 0], b"skin\0"];
    assert_eq!(encode(&header), expected.concat());
    assert_eq!(decode::<Header>(&encode(&header)).unwrap(), header);
}

#[test]
fn numbers_of_eight_bytes_are_aligned_behind_the_encapsulation() {
    let header = Header { stamp: Time::default(), frame_id: "s".into() };
    let vector = Vector3 { x: 1.0, y: 2.0, z: 3.0 };
    let stamped = WrenchStamped { header, wrench: Wrench { force: vector, torque: vector } };
    let bytes = encode(&stamped);
    // 8 bytes of the stamp, 4 + 2 of the name, 2 of padding, six numbers.
    assert_eq!(bytes.len(), 4 + 16 + 48);
    assert_eq!(bytes[20..28], 1.0_f64.to_le_bytes());
    assert_eq!(bytes[60..68], 3.0_f64.to_le_bytes());
}

#[test]
fn an_array_of_bytes_is_its_count_and_the_bytes() {
    let array = UInt8MultiArray { layout: MultiArrayLayout::default(), data: vec![7, 8, 9] };
    assert_eq!(encode(&array), [0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 7, 8, 9]);
    assert_eq!(decode::<UInt8MultiArray>(&encode(&array)).unwrap(), array);
}

#[test]
fn every_message_comes_back() {
    let (reference, live) = synthetic::pressed();
    fn back<M: Message + PartialEq + std::fmt::Debug>(message: &M) {
        assert_eq!(&decode::<M>(&encode(message)).unwrap(), message);
    }
    back(&frame(&reference, &live));
    back(&image(&reference, &live));
    back(&contacts(&reference, &live));
    back(&wrench(&reference, &live));
    back(&markers(&reference, &live));
    back(&diagnostics(&reference, &live));
    back(&validity(&live));
}

#[test]
fn truncated_or_reordered_bytes_are_reported() {
    let bytes = encode(&Text { data: "tare".into() });
    for length in 0..bytes.len() {
        assert!(decode::<Text>(&bytes[..length]).is_err(), "{length} bytes");
    }
    let mut big = bytes.clone();
    big[1] = 0;
    let error = decode::<Text>(&big).unwrap_err();
    assert!(error.to_string().contains("[00, 00, 00, 00]"), "{error}");
}

#[test]
fn an_image_has_nothing_outside_the_body() {
    let (reference, live) = synthetic::pressed();
    let [rows, columns] = reference.picture();
    let message = image(&reference, &live);
    assert_eq!((message.height as usize, message.width as usize), (rows, columns));
    let values: Vec<f32> = message.data.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
    for (index, value) in values.iter().enumerate() {
        match reference.space.position_in_grid.iter().position(|&position| position == index) {
            Some(pixel) => assert_eq!(*value, live.result.image[pixel]),
            None => assert!(value.is_nan()),
        }
    }
    assert!(values.iter().any(|value| value.is_nan()), "a disk leaves corners");
}

#[test]
fn the_wrench_is_the_sum_of_the_presses() {
    let (reference, mut live) = synthetic::pressed();
    // 2 N down at x = 0.03, and a contact whose force is unknown: M = r x F = (0.03, 0, 0) x (0, 0, -2) = (0, 0.06, 0).
    live.result.contacts.truncate(2);
    live.result.contacts[0].contact.position_m = [0.03, 0.0, 0.0];
    live.result.contacts[0].contact.normal = [0.0, 0.0, 1.0];
    live.result.contacts[0].contact.force_n = 2.0;
    live.result.contacts[1].contact.force_n = f64::NAN;
    let Wrench { force, torque } = wrench(&reference, &live).wrench;
    assert_eq!((force.x, force.y, force.z), (0.0, 0.0, -2.0));
    assert!((torque.y - 0.06).abs() < 1e-12 && torque.x == 0.0 && torque.z == 0.0, "{torque:?}");
    live.result.contacts[0].contact.force_n = f64::NAN;
    assert!(wrench(&reference, &live).wrench.force.z.is_nan());
    live.result.contacts.clear();
    assert_eq!(wrench(&reference, &live).wrench.force.z, 0.0);
}

#[test]
fn markers_point_at_contacts_and_go_with_the_last() {
    let (reference, mut live) = synthetic::pressed();
    let drawn = markers(&reference, &live).markers;
    assert_eq!(drawn.len(), 2 * live.result.contacts.len());
    let [x, y, z] = live.result.contacts[0].contact.position_m;
    assert_eq!(drawn[0].points[1], Point { x, y, z });
    let mut due = Due::default();
    assert!(due.markers(&live) && due.markers(&live));
    live.result.contacts.clear();
    assert!(due.markers(&live), "once more, to take them away");
    assert!(!due.markers(&live));
    assert_eq!(markers(&reference, &live).markers[0].action, 3);
}

#[test]
fn diagnostics_come_once_a_second_and_when_an_electrode_fails() {
    use std::sync::Arc;
    let (reference, mut live) = synthetic::pressed();
    let mut due = Due::default();
    let step = std::time::Duration::from_millis(10);
    let mut sent = 0;
    for _ in 0..250 {
        sent += usize::from(due.diagnostics(&live));
        live.result.measured_at = live.result.measured_at.after(step);
    }
    assert_eq!(sent, 3, "at 0, 1 and 2 s");
    Arc::make_mut(&mut live.result.health).electrodes[3].state = ElectrodeState::Loose;
    assert!(due.diagnostics(&live) && !due.diagnostics(&live));
    let status = &diagnostics(&reference, &live).status[1];
    assert_eq!((status.level, status.message.as_str()), (2, "electrode 3 is loose"));
}

#[test]
fn diagnostics_compare_the_rate_with_the_nominal_one() {
    use std::sync::Arc;
    let (reference, mut live) = synthetic::pressed();
    let mut at = |rate_hz: f64, nominal_rate_hz| {
        let health = Arc::make_mut(&mut live.result.health);
        (health.rate_hz, health.nominal_rate_hz) = (rate_hz, nominal_rate_hz);
        let status = diagnostics(&reference, &live).status.remove(2);
        let target = status.values.iter().find(|pair| pair.key == "Target frequency (Hz)");
        (status.level, target.map(|pair| pair.value.clone()))
    };
    assert_eq!(at(119.0, Some(120.0)), (0, Some("120".into())));
    assert_eq!(at(100.0, Some(120.0)).0, 1);
    assert_eq!(at(140.0, Some(120.0)).0, 1);
    assert_eq!(at(140.0, None), (0, None));
    live.result.validity = Validity::Stale { age_s: 0.2 };
    assert_eq!(diagnostics(&reference, &live).status[2].level, 3);
}

#[test]
fn an_invalid_frame_is_told_at_once_and_has_no_wrench() {
    let (reference, mut live) = synthetic::pressed();
    let mut due = Due::default();
    assert!(due.diagnostics(&live) && !due.diagnostics(&live));
    live.result.contacts.clear();
    live.result.validity = Validity::Invalid { reason: InvalidReason::Frozen };
    assert!(due.diagnostics(&live) && !due.diagnostics(&live));
    assert!(wrench(&reference, &live).wrench.force.z.is_nan());
    assert_eq!(validity(&live).data, r#"{"state":"invalid","reason":"frozen"}"#);
    assert_eq!(diagnostics(&reference, &live).status[0].level, 2);
    live.result.validity = Validity::Stale { age_s: 0.2 };
    assert_eq!(diagnostics(&reference, &live).status[0].level, 3);
}

#[test]
fn definitions_hold_all_that_they_need() {
    let text = definition("sensor_msgs/msg/PointCloud2");
    let names: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("MSG: ")).collect();
    assert_eq!(names, ["std_msgs/Header", "sensor_msgs/PointField", "builtin_interfaces/Time"]);
    assert!(text.starts_with("std_msgs/Header header\n"));
    for topic in Topic::all() {
        assert!(!definition(topic.type_name()).is_empty());
    }
    assert_eq!(Topic::Contacts.absolute("/arm/"), "/arm/dermis/contacts");
    assert_eq!(Topic::Diagnostics.absolute("/arm"), "/diagnostics");
}
