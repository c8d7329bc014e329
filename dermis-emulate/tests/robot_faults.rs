//! A fault of one skin of a robot: the others go on with the same contacts, bit for bit, and the robot does not claim to be untouched.

use dermis::design::SkinDesign;
use dermis::pipeline::TrackedContact;
use dermis_emulate::EmulateError;
use dermis_emulate::emulator::{Emulator, EmulatorOptions, Script, TimedFault};
use dermis_emulate::robot::RobotDevices;
use dermis_live::recording::{Replay, Replayed};
use dermis_live::robot::{RobotLive, RobotOptions, RobotOutput};
use dermis_robot::{Robot, Zone};
use dermis_sim::twin::TwinOptions;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The skin with the fault.
const FAULTY: usize = 1;
/// How long a robot is read, s: a fault comes after 3 s.
const RUN_S: f64 = 5.0;
/// Within this time an unplugged, silent or frozen skin must be unknown, s.
const UNKNOWN_S: f64 = 0.2;

/// A simulated device of a skin; that of the faulty one has the fault.
fn device(design: &SkinDesign, serial: u32, fault: &str) -> Result<Arc<Emulator>, EmulateError> {
    let twin = TwinOptions::shipped("lab").expect("a shipped twin");
    let has_fault = serial == FAULTY as u32 + 1 && fault.contains('@');
    let seed = if serial == FAULTY as u32 + 1 && fault == "swapped" { 99 } else { u64::from(serial) };
    let options = EmulatorOptions {
        script: Script::load("random", design, &twin, seed)?,
        twin,
        seed,
        faults: has_fault.then(|| fault.parse::<TimedFault>().expect("a fault")).into_iter().collect(),
        speed: 1.0,
        prerendered: 0,
        unpaced: false,
    };
    Emulator::new(design, options)
}

/// Reads three skins, one of which has a fault.
fn check(fault: &str) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("robot.toml");
    let mut text = "name = \"three\"\n".to_string();
    for skin in 0..3 {
        let source = if skin == FAULTY && fault == "absent" { "tcp:127.0.0.1:1" } else { "emulate" };
        text += &format!(
            "[[skin]]\nname = \"s{skin}\"\ndesign = \"skin16\"\nlink = \"l{skin}\"\nsource = \"{source}\"\nserial = {}\n\
             method = \"noser\"\n",
            skin + 1
        );
        // Two devices cannot have one address.
        text = text.replace("tcp:127.0.0.1:1\"", &format!("tcp:127.0.0.1:{}\"", 1 + skin));
    }
    std::fs::write(&file, text).unwrap();
    let robot = Arc::new(Robot::load(&file).unwrap());
    let record = folder.path().join("run");
    let how = RobotOptions { record: Some(record.clone()), frames: true, ..RobotOptions::default() };
    let mut devices = RobotDevices::new(false);
    let options = |skin| devices.options(&robot, skin, false, |design, serial| device(design, serial, fault));
    let mut live = RobotLive::start::<EmulateError>(&robot, &dermis_learn::methods(), &how, options).unwrap();
    let (begun, mut frames) = (Instant::now(), vec![BTreeMap::<u64, Vec<TrackedContact>>::new(); 3]);
    let (mut last_frame, mut unknown_after_s, mut notices) = (None, None, String::new());
    while begun.elapsed() < Duration::from_secs_f64(RUN_S) {
        match live.next(Duration::from_millis(20)) {
            // A stale frame has no message.
            Some(RobotOutput::Frame(skin, frame)) if !frame.message.is_empty() => {
                frames[skin].insert(frame.result.sequence, frame.result.contacts.clone());
                if skin == FAULTY {
                    last_frame = Some(frame.result.measured_at);
                }
            }
            Some(RobotOutput::Snapshot(snapshot)) => {
                let is_unknown = matches!(snapshot.skins[FAULTY].zone, Zone::Unknown { .. });
                if is_unknown {
                    assert_ne!(snapshot.touched, Some(false), "{fault}: untouched while a skin is unknown");
                }
                let was_known = frames[FAULTY].len() > 150;
                if was_known && is_unknown && unknown_after_s.is_none() {
                    unknown_after_s = last_frame.map(|last| snapshot.at.seconds_since(last));
                }
            }
            Some(RobotOutput::Notice { notice, .. }) => notices += &notice.text,
            _ => {}
        }
    }
    assert_eq!(live.stop(), None, "{fault}");
    match fault {
        "absent" => assert!(frames[FAULTY].is_empty()),
        "swapped" => {
            assert!(notices.contains("serial number 99, of no skin of this robot, in place of 2"), "{notices}")
        }
        _ => {
            let after_s = unknown_after_s.unwrap_or_else(|| panic!("{fault}: never unknown; {notices}"));
            assert!(after_s <= UNKNOWN_S, "{fault}: unknown after {after_s} s");
        }
    }
    // Numbers that are not known are not equal to themselves.
    let said = |contacts: &[TrackedContact]| format!("{contacts:?}");
    // The other skins alone, from their recordings.
    for skin in (0..3).filter(|skin| *skin != FAULTY) {
        assert!(frames[skin].len() > 300, "{fault}: {} frames of skin {skin}", frames[skin].len());
        assert!(frames[skin].values().any(|contacts| !contacts.is_empty()), "{fault}: no contacts");
        let path = record.join(format!("skins/s{skin}.mcap"));
        let mut replay = Replay::open(&path, &dermis_learn::methods(), None).unwrap();
        let mut compared = 0;
        while let Some(replayed) = replay.step().unwrap() {
            let Replayed::Frame(frame) = replayed else { continue };
            if let Some(contacts) = frames[skin].get(&frame.result.sequence) {
                assert_eq!(
                    said(contacts),
                    said(&frame.result.contacts),
                    "{fault}: skin {skin}, frame {}",
                    frame.result.sequence
                );
                compared += 1;
            }
        }
        assert!(compared > 300, "{fault}: {compared}");
    }
}

const FAULTS: [&str; 5] = ["absent", "swapped", "unplug@3+60", "silent@3+60", "freeze@3+60"];

#[test]
fn a_fault_of_one_skin_does_not_reach_the_others() {
    FAULTS.iter().for_each(|fault| check(fault));
}

#[test]
#[ignore = "slow: 60 of each fault, half an hour"]
fn sixty_faults_of_each_kind_do_not_reach_the_others() {
    for turn in 0..60 {
        FAULTS.iter().for_each(|fault| check(fault));
        println!("{} of each", turn + 1);
    }
}
