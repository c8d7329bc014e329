//! Robots from their files, and from frame to frame.

use dermis::contact::Contact;
use dermis::pipeline::{InvalidReason, PipelineFrame, Timestamp, TrackedContact, Validity};
use dermis_robot::{Cause, EventKind, Robot, RobotState, RuleEvent, UnknownReason, Zone};
use std::sync::Arc;

const URDF: &str = r#"<robot name="arm"><link name="base"/><link name="upper"/><link name="lower"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="2"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/></joint>
</robot>"#;

const ROBOT: &str = r#"
name = "arm"
description = "arm.urdf"
[[skin]]
name = "upper"
design = "skin16"
link = "upper"
source = "tcp:127.0.0.1:1"
[[skin]]
name = "lower"
design = "skin16"
link = "lower"
origin = { xyz_m = [0.1, 0, 0], rpy_rad = [0, 1.5707963267948966, 0] }
source = "tcp:127.0.0.1:2"
serial = 7
[[skin]]
name = "extra"
design = "skin16"
link = "lower"
source = "tcp:127.0.0.1:3"
required = false
[[rule]]
name = "stop"
on = ["*er"]
when = "touched"
[[rule]]
name = "push"
on = ["lower"]
when = { force_n = 5.0 }
unknown = "keep"
clear_s = 0.0
[[rule]]
name = "look"
on = ["lower"]
when = "contact"
unknown = "ignore"
"#;

fn load(text: &str) -> Result<Robot, String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("arm.urdf"), URDF).unwrap();
    let path = folder.path().join("arm.toml");
    std::fs::write(&path, text).unwrap();
    Robot::load(&path).map_err(|error| error.to_string())
}

/// A time, from a start in 2026.
fn at(ms: u64) -> Timestamp {
    Timestamp { unix_ns: 1_790_000_000_000_000_000 + ms * 1_000_000 }
}

fn frame(ms: u64, contacts: &[Contact]) -> PipelineFrame {
    let tracked = |contact: &Contact| TrackedContact {
        contact: *contact,
        centroid_m: contact.position_m,
        centre_of_pressure_m: contact.position_m,
        velocity_m_s: [0.0; 3],
        seen: true,
        since: at(ms),
        age_s: 0.0,
        zone: None,
    };
    PipelineFrame {
        sequence: ms,
        measured_at: at(ms),
        values_ohm: Vec::new(),
        image: Vec::new(),
        validity: Validity::Ok,
        touched: Some(!contacts.is_empty()),
        contacts: contacts.iter().map(tracked).collect(),
        health: Arc::default(),
    }
}

fn state() -> RobotState {
    RobotState::new(Arc::new(load(ROBOT).unwrap()))
}

/// All skins clear.
fn clear() -> RobotState {
    clear_of(ROBOT)
}

fn clear_of(text: &str) -> RobotState {
    let mut state = RobotState::new(Arc::new(load(text).unwrap()));
    state.joints(at(0), &[("shoulder", 0.0), ("elbow", 0.0)]).unwrap();
    for skin in 0..3 {
        state.connected(skin, 7, at(0));
    }
    // The rule that began because the skins were unknown ends after 0.2 s.
    for ms in (0..=210).step_by(10) {
        (0..3).for_each(|skin| drop(state.frame(skin, &frame(ms, &[]), at(ms))));
    }
    state
}

fn press(force_n: f64) -> Contact {
    Contact { force_sd_n: 0.1, sd_m: 0.001, ..Contact::truth([0.02, 0.0, 0.0], [0.0, 0.0, 1.0], force_n) }
}

#[test]
fn a_robot_is_untouched_only_if_every_required_skin_says_so() {
    let mut state = clear();
    assert_eq!(state.touched(at(212)), Some(false));
    // A skin that is not required.
    state.fault(2, UnknownReason::Lost, at(213));
    assert_eq!(state.touched(at(214)), Some(false));
    state.fault(1, UnknownReason::Lost, at(214));
    assert_eq!(state.touched(at(215)), None);
    state.frame(0, &frame(216, &[press(1.0)]), at(216));
    assert_eq!(state.touched(at(217)), Some(true));
    let snapshot = state.snapshot(at(217));
    assert_eq!((snapshot.complete, snapshot.unknown), (false, vec!["lower".to_string(), "extra".to_string()]));
    // Age: 50 ms after their frames all are unknown, whatever they said.
    assert_eq!(state.zone(0, at(266)), Zone::Touched);
    assert_eq!(state.zone(0, at(267)), Zone::Unknown { reason: UnknownReason::Late });
    assert_eq!(state.touched(at(300)), None);
}

#[test]
fn a_robot_whose_skins_are_all_optional_and_unknown_is_not_clear() {
    let text =
        ROBOT.replace("source =", "required = false\nsource =").replace("\nrequired = false\n[[rule]]", "\n[[rule]]");
    let state = RobotState::new(Arc::new(load(&text).unwrap()));
    assert_eq!(state.touched(at(0)), None);
}

/// Any faults in any order: never clear while a required skin is anything but clear and young.
#[test]
fn random_faults_never_leave_the_robot_untouched() {
    let mut state = state();
    let (mut seed, mut now, mut untouched) = (1_u64, 0, 0);
    // What the test knows of each skin: when its last sound frame without contacts was measured.
    let mut sound: [Option<u64>; 3] = [None; 3];
    for _ in 0..30_000 {
        let mut draw = |below: u64| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) % below
        };
        let skin = draw(3) as usize;
        now += draw(10);
        let delay = draw(60);
        match draw(30) {
            0 => drop(state.fault(skin, UnknownReason::Lost, at(now))),
            1 => drop(state.fault(skin, UnknownReason::Unserved, at(now))),
            2 => drop(state.connected(skin, 7, at(now))),
            3 => {
                let mut invalid = frame(now, &[]);
                (invalid.validity, invalid.touched) = (Validity::Invalid { reason: InvalidReason::Frozen }, None);
                state.frame(skin, &invalid, at(now));
            }
            4 => {
                let stale =
                    PipelineFrame { validity: Validity::Stale { age_s: 0.2 }, touched: None, ..frame(now, &[]) };
                state.frame(skin, &stale, at(now));
            }
            5..8 => {
                drop(state.tick(at(now)));
                continue;
            }
            _ => {
                let measured = now.saturating_sub(delay / 2);
                state.frame(skin, &frame(measured, &[]), at(now));
                // An older frame says nothing.
                sound[skin] = sound[skin].max(Some(measured));
                assert!(state.touched(at(now)) != Some(true));
                check_untouched(&state, now, &sound, &mut untouched);
                continue;
            }
        }
        sound[skin] = None;
        check_untouched(&state, now, &sound, &mut untouched);
    }
    assert!(untouched > 1000, "{untouched}");
}

fn check_untouched(state: &RobotState, now: u64, sound: &[Option<u64>; 3], untouched: &mut u32) {
    let is_young = |skin: usize| sound[skin].is_some_and(|measured| now - measured <= 50);
    if state.touched(at(now)) == Some(false) {
        *untouched += 1;
        assert!(is_young(0) && is_young(1), "{now} {sound:?}");
    }
}

#[test]
fn contacts_are_in_the_frame_of_the_base_when_they_were_measured() {
    let mut state = clear();
    // The shoulder turns by 1 rad/s; the frame was measured between two joint states.
    for (ms, shoulder) in [(300, 0.0), (310, 0.01), (320, 0.02)] {
        state.joints(at(ms), &[("elbow", std::f64::consts::FRAC_PI_2), ("shoulder", shoulder)]).unwrap();
    }
    state.frame(1, &frame(315, &[press(5.0)]), at(321));
    let contact = state.snapshot(at(321)).contacts.remove(0);
    // The skin's z is the link's x: the press is at (0.1, 0, -0.02) there, and the elbow turns x to y.
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
    assert!(near(contact.position_link_m, [0.1, 0.0, -0.02]), "{:?}", contact.position_link_m);
    assert!(near(contact.normal_link, [1.0, 0.0, 0.0]));
    let (sin, cos) = 0.015_f64.sin_cos();
    let expected = [0.3 * cos - 0.1 * sin, 0.3 * sin + 0.1 * cos, -0.02];
    assert!(near(contact.position_base_m.unwrap(), expected), "{:?}", contact.position_base_m);
    assert_eq!(contact.sd_base_m, Some(0.001));
    // After the last joint states: held, and less sure by the way that the arm goes in 20 ms, of 0.316 m at 1 rad/s.
    state.frame(1, &frame(340, &[press(5.0)]), at(341));
    let held = state.snapshot(at(341)).contacts.remove(0);
    let moved = 0.3_f64.hypot(0.1) * 0.02;
    assert!((held.sd_base_m.unwrap() - 0.001_f64.hypot(moved)).abs() < 1e-9, "{:?}", held.sd_base_m);
    // Too long after them: the position on the link alone.
    state.frame(1, &frame(380, &[press(5.0)]), at(381));
    let lost = state.snapshot(at(381)).contacts.remove(0);
    assert_eq!((lost.position_base_m, lost.sd_base_m), (None, None));
    assert!(near(lost.position_link_m, [0.1, 0.0, -0.02]));
    assert_eq!(state.snapshot(at(381)).joint_torques, None);
}

#[test]
fn torques_are_those_of_the_lever() {
    // Torques do not depend on the link in whose frame contacts are given.
    for base in ["base", "lower"] {
        torques(clear_of(
            &ROBOT.replace("[[skin]]\nname = \"upper\"", &format!("base = \"{base}\"\n[[skin]]\nname = \"upper\"")),
        ));
    }
}

fn torques(mut state: RobotState) {
    let both = [("shoulder", 0.0), ("elbow", 0.0)];
    state.joints(at(300), &both).unwrap();
    state.joints(at(310), &both).unwrap();
    for skin in [0, 2] {
        state.frame(skin, &frame(305, &[]), at(310));
    }
    // Pressed along the link's -y at x = 0.1 + 0.05: the skin's y is the link's y, its z the link's x.
    let contact = Contact::truth([0.0, 0.01, 0.05], [0.0, 1.0, 0.0], 4.0);
    state.frame(1, &frame(305, &[Contact { force_sd_n: 0.5, sd_m: 0.0, ..contact }]), at(310));
    let snapshot = state.snapshot(at(311));
    let torques = snapshot.joint_torques.unwrap();
    let (elbow, shoulder) = (&torques["elbow"], &torques["shoulder"]);
    assert!((elbow.torque_n_m + 4.0 * 0.15).abs() < 1e-12 && (shoulder.torque_n_m + 4.0 * 0.45).abs() < 1e-12);
    // The lever of the normal force, and of friction along x at y = 0.01: (mu f)^2 / 4.
    let friction = 0.5 * contact.force_n / 2.0 * 0.01;
    assert!((elbow.sd_n_m - (0.15_f64 * 0.5).hypot(friction)).abs() < 1e-12, "{}", elbow.sd_n_m);
    let wrench = snapshot.wrenches.iter().find(|wrench| wrench.link == "lower").unwrap();
    assert!(wrench.complete && (wrench.force_n[1] + 4.0).abs() < 1e-12);
    // An unknown skin of the link: its wrench is a part, torques are not known.
    state.fault(2, UnknownReason::Lost, at(312));
    let snapshot = state.snapshot(at(313));
    let wrench = snapshot.wrenches.iter().find(|wrench| wrench.link == "lower").unwrap();
    assert_eq!(
        (wrench.complete, &wrench.missing[..], snapshot.joint_torques),
        (false, &["extra".to_string()][..], None)
    );
}

#[test]
fn rules_begin_at_once_and_end_after_their_time() {
    let mut state = clear();
    assert!(state.tick(at(215)).is_empty());
    let events = state.frame(0, &frame(220, &[press(f64::NAN)]), at(221));
    assert_eq!(events.len(), 1);
    assert_eq!((events[0].rule.as_str(), events[0].event), ("stop", EventKind::Begins));
    assert_eq!(events[0].cause, Cause::Touched { skin: "upper".into() });
    // A force that is too small, then large enough.
    let events = state.frame(1, &frame(222, &[press(4.9)]), at(223));
    assert_eq!(events.iter().map(|event| event.rule.as_str()).collect::<Vec<_>>(), ["look"]);
    let events = state.frame(1, &frame(224, &[press(5.0)]), at(225));
    assert_eq!(events.iter().map(|event| event.rule.as_str()).collect::<Vec<_>>(), ["push"]);
    // Lost while pressed: `keep` goes on, `ignore` begins to end, `stop` holds, as the other skin becomes too old.
    let said = |events: Vec<RuleEvent>| events.into_iter().map(|event| (event.rule, event.event)).collect::<Vec<_>>();
    let changes = |rule: &str| (rule.to_string(), EventKind::Changes);
    assert_eq!(said(state.fault(1, UnknownReason::Lost, at(230))), [changes("push")]);
    assert_eq!(said(state.tick(at(431))), [changes("stop"), ("look".to_string(), EventKind::Ends)]);
    let rules = state.snapshot(at(431)).rules;
    assert_eq!(rules["push"], Cause::Unknown { skin: "lower".into(), reason: Some(UnknownReason::Lost) });
    // Found again and clear.
    state.connected(1, 7, at(440));
    let events = state.frame(1, &frame(441, &[]), at(441));
    assert_eq!(
        events.iter().map(|event| (event.rule.as_str(), event.event)).collect::<Vec<_>>(),
        [("push", EventKind::Ends)]
    );
}

/// The rules of a snapshot are those of its time, whether or not time was told to pass.
#[test]
fn a_snapshot_knows_the_rules_that_hold_now() {
    let mut state = state();
    let absent = Cause::Unknown { skin: "upper".into(), reason: Some(UnknownReason::Absent) };
    assert_eq!(state.snapshot(at(0)).rules["stop"], absent);
    state = clear();
    assert!(state.snapshot(at(215)).rules.is_empty());
    let late = Cause::Unknown { skin: "upper".into(), reason: Some(UnknownReason::Late) };
    assert_eq!(state.snapshot(at(5000)).rules["stop"], late);
}

#[test]
fn an_older_frame_says_nothing() {
    let mut state = clear();
    state.frame(0, &frame(230, &[press(1.0)]), at(231));
    state.frame(0, &frame(220, &[]), at(232));
    assert_eq!(state.zone(0, at(233)), Zone::Touched);
    // A clock that was set back goes on.
    let mut state = clear();
    state.frame(0, &frame(5000, &[press(1.0)]), at(5001));
    state.frame(0, &frame(300, &[]), at(301));
    assert_eq!(state.zone(0, at(302)), Zone::Clear);
}

/// Joint states of a clock that is ahead give no place in the frame of the base.
#[test]
fn joint_states_from_the_future_give_no_place() {
    for (ahead_ms, is_known) in [(0, true), (40, true), (300, false)] {
        let mut state = clear();
        state.joints(at(230 + ahead_ms), &[("shoulder", 0.0), ("elbow", 0.0)]).unwrap();
        state.frame(0, &frame(230, &[press(1.0)]), at(231));
        let contacts = state.snapshot(at(231)).contacts;
        assert_eq!(contacts[0].position_base_m.is_some(), is_known, "{ahead_ms} ms ahead");
    }
}

#[test]
fn another_device_says_nothing_of_this_skin() {
    let mut state = clear();
    state.connected(1, 8, at(220));
    state.frame(1, &frame(221, &[]), at(221));
    assert_eq!(state.zone(1, at(222)), Zone::Unknown { reason: UnknownReason::OtherDevice });
    state.connected(1, 7, at(223));
    assert_eq!(state.zone(1, at(224)), Zone::Unknown { reason: UnknownReason::Absent });
    state.frame(1, &frame(225, &[]), at(225));
    assert_eq!(state.zone(1, at(226)), Zone::Clear);
}

#[test]
fn joint_states_that_cannot_be_are_refused() {
    let mut state = state();
    let mut given = |ms: u64, positions: &[(&str, f64)]| state.joints(at(ms), positions).map_err(|error| error.clone());
    assert!(given(0, &[("a", 0.0)]).unwrap_err().contains("as those of another robot"));
    assert!(given(0, &[("Shoulder", 0.0), ("elbow", 0.0)]).unwrap_err().contains("they have Shoulder, elbow"));
    assert!(given(0, &[("shoulder", f64::NAN), ("elbow", 0.0)]).unwrap_err().contains("`shoulder` is NaN"));
    assert_eq!(given(0, &[("shoulder", 0.0), ("elbow", 3.1), ("gripper", 9.0)]), Ok(()));
    assert_eq!(given(0, &[("shoulder", 0.0), ("elbow", 3.1)]), Ok(()), "the same again");
    assert!(given(5, &[("shoulder", 1e300), ("elbow", 0.0)]).unwrap_err().contains("`shoulder` is 1e300"));
    assert!(given(5, &[("shoulder", 0.0), ("elbow", 0.0), ("elbow", 1.0)]).unwrap_err().contains("`elbow` twice"));
    let error = given(5, &[("shoulder", 30.0), ("elbow", 3.1)]).unwrap_err();
    assert!(error.contains("the position 30 of the joint `shoulder` is beyond its limits, -2 to 2"), "{error}");
    // A joint without limits passes its seam.
    assert_eq!(given(10, &[("shoulder", 0.0), ("elbow", -3.1)]), Ok(()));
    assert!(given(9, &[("shoulder", 0.0), ("elbow", -3.1)]).unwrap_err().contains("0.001 s older than"));
    let error = given(20, &[("shoulder", 1.0), ("elbow", -3.1)]).unwrap_err();
    assert!(error.contains("`shoulder` jumped: 100.0 rad/s, of at most 2.0"), "{error}");
    assert_eq!(given(30, &[("shoulder", 1.0), ("elbow", -3.1)]), Ok(()));
}

#[test]
fn wrong_files_are_named_with_the_line_and_the_fix() {
    for (from, to, expected) in [
        ("link = \"upper\"", "link = \"uper\"", "arm.toml:7: the robot has no link `uper` (did you mean `upper`?)"),
        ("link = \"upper\"\n", "", "the skin `upper` is on no link"),
        ("arm.urdf", "leg.urdf", "cannot read the robot description"),
        ("design = \"skin16\"", "design = \"skin61\"", "arm.toml:6"),
        ("tcp:127.0.0.1:2", "tcp:127.0.0.1:1", "`upper` and `lower` read one device"),
        ("name = \"extra\"", "name = \"lower\"", "two skins are called `lower`"),
        ("name = \"extra\"", "name = \"a/b\"", "is no name of a skin"),
        ("rpy_rad = [0, 1.5707963267948966, 0]", "quaternion = [0, 0, 0, 2]", "the quaternion has the length 2.000"),
        ("rpy_rad = [0, 1.57", "quaternion = [0, 0, 0, 1], rpy_rad = [0, 1.57", "two rotations"),
        ("xyz_m = [0.1, 0, 0]", "xyz_m = [100, 0, 0]", "xyz_m is in metres"),
        ("xyz_m = [0.1, 0, 0]", "xyz_m = [0.1, 0, 0, 7]", "the list has 4 values, not 3"),
        ("rpy_rad = [0, 1.5707963267948966, 0]", "rpy_rad = [0, 90, 0]", "angles are in radians"),
        ("rpy_rad = [0, 1.5707963267948966, 0]", "quaternion = [0, 0, 0, 1, 0]", "the list has 5 values, not 4"),
        ("tcp:127.0.0.1:1", "robot:7440", "`7440` is no address"),
        ("xyz_m =", "xyz =", "unknown field `xyz`"),
        ("on = [\"*er\"]", "on = [\"arm_*\"]", "no skin is called `arm_*`"),
        ("name = \"push\"", "name = \"stop\"", "two rules are called `stop`"),
        ("name = \"arm\"", "name = \"arm\"\njoints = \"udp:127.0.0.1:99999\"", "is no source of joint states"),
        ("on = [\"*er\"]", "on = []", "is about no skin"),
        ("force_n = 5.0", "force_n = -5.0", "a force of -5 N"),
        ("clear_s = 0.0", "clear_s = 1e9", "`clear_s` is 1000000000"),
        ("name = \"arm\"", "name = \"arm\"\njoints = \"can0\"", "`can0` is no source of joint states"),
        ("name = \"arm\"", "name = \"arm\"\nage_s = 0.0", "`age_s` is 0"),
        ("name = \"arm\"", "name = \"arm\"\nbase = \"world\"", "no link `world`"),
        ("description = \"arm.urdf\"", "base = \"base\"", "a base without a robot description"),
    ] {
        let text = ROBOT.replacen(from, to, 1);
        assert_ne!(text, ROBOT, "{from}");
        let error = load(&text).unwrap_err();
        assert!(error.contains(expected), "{to}: {error}");
    }
}

/// Two plates side by side: the second begins 2 mm behind the first, whose edge is at x = 0.1 m.
fn plates() -> RobotState {
    let text = r#"
name = "plates"
[[skin]]
name = "a"
design = "skin16"
link = "plate"
source = "tcp:127.0.0.1:1"
[[skin]]
name = "b"
design = "skin16"
link = "plate"
origin = { xyz_m = [0.102, 0, 0] }
source = "tcp:127.0.0.1:2"
"#;
    RobotState::new(Arc::new(load(text).unwrap()))
}

/// The part of a touch of the radius 10 mm that a plate sees: it lies where the touch lies, but on the plate.
fn part(id: u64, from_edge_m: f64, x_m: f64, y_m: f64, force_n: f64) -> Contact {
    let truth = Contact::truth([x_m, y_m, 0.0], [0.0, 0.0, 1.0], force_n);
    Contact { id, edge_m: from_edge_m, half_length_m: 0.01, half_width_m: 0.01, sd_m: 0.002, force_sd_n: 0.1, ..truth }
}

#[test]
fn a_slide_over_a_seam_is_one_contact_with_one_id() {
    let mut state = plates();
    let mut ids = Vec::new();
    for step in 0..=40 {
        let (ms, x_m) = (10 * step, 0.08 + 0.001 * step as f64);
        // From 10 mm before the edge on, the second plate sees a part, and the first one as far behind it.
        let on_second = ((x_m - 0.09) / 0.02).clamp(0.0, 1.0);
        let first = part(5, (0.1 - x_m).max(0.001), x_m.min(0.099), 0.03, 4.0 * (1.0 - on_second));
        let second = part(9, (x_m - 0.102).max(0.001), (x_m - 0.102).max(0.001), 0.03, 4.0 * on_second);
        let of = |contact: Contact| if contact.force_n > 0.0 { vec![contact] } else { Vec::new() };
        state.frame(0, &frame(ms, &of(first)), at(ms));
        state.frame(1, &frame(ms, &of(second)), at(ms));
        let snapshot = state.snapshot(at(ms));
        let [contact] = snapshot.contacts.as_slice() else { panic!("{x_m}: {:?}", snapshot.contacts) };
        assert_eq!(contact.parts.len(), if on_second > 0.0 && on_second < 1.0 { 2 } else { 1 }, "{x_m}");
        assert!((contact.contact.contact.force_n - 4.0).abs() < 1e-9, "{x_m}: {contact:?}");
        let [x, y, _] = contact.position_link_m;
        assert!((x - x_m).abs() < 0.006 && (y - 0.03).abs() < 1e-9, "{x_m}: {x}");
        ids.push(contact.contact.contact.id);
    }
    ids.dedup();
    assert_eq!(ids, [1]);
}

#[test]
fn two_fingers_at_a_seam_are_two_and_their_ids_are_never_used_again() {
    let mut state = plates();
    let mut take = |ms: u64, first: &[Contact], second: &[Contact]| {
        state.frame(0, &frame(ms, first), at(ms));
        state.frame(1, &frame(ms, second), at(ms));
        let mut ids: Vec<u64> =
            state.snapshot(at(ms)).contacts.iter().map(|contact| contact.contact.contact.id).collect();
        ids.sort_unstable();
        ids
    };
    // Across the seam, 60 mm apart.
    assert_eq!(take(0, &[part(1, 0.03, 0.07, 0.03, 2.0)], &[part(1, 0.028, 0.028, 0.03, 2.0)]), [1, 2]);
    // Along it, 60 mm apart, both at the edge; the first plate has another contact now.
    assert_eq!(take(10, &[part(2, 0.002, 0.098, 0.0, 2.0)], &[part(1, 0.002, 0.002, 0.06, 2.0)]), [2, 3]);
    // Opposite each other they are one, and one each again when both have left the edge.
    assert_eq!(take(20, &[part(2, 0.002, 0.098, 0.06, 2.0)], &[part(1, 0.002, 0.002, 0.06, 2.0)]), [2]);
    assert_eq!(take(30, &[part(2, 0.03, 0.07, 0.06, 2.0)], &[part(1, 0.03, 0.03, 0.06, 2.0)]), [2, 4]);
    // A skin that is unknown has no contacts; it comes back with another one.
    assert_eq!(take(40, &[], &[part(1, 0.03, 0.03, 0.06, 2.0)]), [4]);
    assert_eq!(take(50, &[part(2, 0.03, 0.07, 0.06, 2.0)], &[part(1, 0.03, 0.03, 0.06, 2.0)]), [4, 5]);
}

#[test]
fn a_robot_that_touches_itself_says_so_and_rules_can_ignore_it() {
    let ignoring = ROBOT.replace("name = \"look\"\n", "name = \"look\"\nself = \"ignore\"\n");
    let mut state = RobotState::new(Arc::new(load(&ignoring).unwrap()));
    let contact = |id: u64, position_m: [f64; 3], normal: [f64; 3]| Contact {
        id,
        half_length_m: 0.01,
        half_width_m: 0.01,
        sd_m: 0.001,
        ..Contact::truth(position_m, normal, 2.0)
    };
    // The frame of `lower` is turned: its contact lies at x = 0.41 m and looks along x, that of `upper` 2 mm before it, against it.
    let lower = contact(1, [0.0, 0.0, 0.01], [0.0, 0.0, 1.0]);
    let mut seen = |ms: u64, upper: Contact| {
        state.joints(at(ms), &[("shoulder", 0.0), ("elbow", 0.0)]).unwrap();
        state.frame(0, &frame(ms, &[upper]), at(ms));
        state.frame(1, &frame(ms, &[lower]), at(ms));
        let snapshot = state.snapshot(at(ms));
        let links: Vec<Option<String>> = snapshot.contacts.iter().map(|contact| contact.self_link.clone()).collect();
        (links, snapshot.rules.contains_key("look"))
    };
    let own = |links: [&str; 2]| links.map(|link| Some(link.to_string())).to_vec();
    assert_eq!(seen(0, contact(1, [0.412, 0.0, 0.005], [-1.0, 0.0, 0.0])), (own(["lower", "upper"]), false));
    // Something between them, beside it, or two faces that look the same way.
    for (ms, place, normal) in [
        (10, [0.44, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        (20, [0.412, 0.03, 0.0], [-1.0, 0.0, 0.0]),
        (30, [0.412, 0.0, 0.0], [1.0, 0.0, 0.0]),
    ] {
        assert_eq!(seen(ms, contact(1, place, normal)), (vec![None, None], true), "{ms}");
    }
}
