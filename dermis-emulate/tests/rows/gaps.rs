//! The pipeline after a gap in the frames, after another tare, and with an electrode that is open from the start.

use crate::rows::bench::{Bench, along, lab, methods, place, stroke, surface_distance};
use dermis::pipeline::PipelineFrame;
use dermis::pipeline::{Command, ElectrodeState, Pipeline, Settings, State};
use dermis_emulate::emulator::Stroke;

fn press(at_s: f64) -> Stroke {
    stroke(at_s, 1.0, place(0.15, 120.0), None, 2.0)
}

/// Reads frames until a device time.
pub fn until(bench: &mut Bench, time_s: f64) -> Vec<PipelineFrame> {
    let mut frames = Vec::new();
    while bench.time_s() < time_s {
        frames.push(bench.frame());
    }
    frames
}

#[test]
fn a_device_that_was_away_goes_on_with_the_old_baseline() {
    let mut bench = Bench::new(lab(), 61, vec![press(26.0)], Settings::default());
    until(&mut bench, 3.0);
    bench.next += 20 * 120;
    assert!(until(&mut bench, 26.0).iter().all(|frame| frame.touched == Some(false) && frame.contacts.is_empty()));
    let pressed = until(&mut bench, 26.8);
    assert_eq!(pressed.last().unwrap().contacts.len(), 1);
}

#[test]
fn a_program_that_was_away_goes_on_with_the_old_baseline() {
    let mut bench = Bench::new(lab(), 62, vec![press(16.0)], Settings::default());
    until(&mut bench, 3.0);
    let kept = serde_json::to_string(bench.pipeline.state()).unwrap();
    let state: State = serde_json::from_str(&kept).unwrap();
    assert_eq!(&state, bench.pipeline.state());
    // A state that does not fit the skin is rejected, whichever part is invalid.
    for part in ["values_ohm", "loops_ohm", "last_ohm", "electrodes", "untouched"] {
        let mut harmed: serde_json::Value = serde_json::from_str(&kept).unwrap();
        shorten(&mut harmed, part);
        let state: State = serde_json::from_value(harmed).unwrap();
        let told = Pipeline::resume(methods(), state).unwrap_err().to_string();
        assert!(told.contains("tare again"), "{part}: {told}");
    }
    bench.pipeline = Pipeline::resume(methods(), state).unwrap();
    bench.next += 10 * 120;
    assert!(until(&mut bench, 16.0).iter().all(|frame| frame.touched == Some(false) && frame.contacts.is_empty()));
    assert_eq!(until(&mut bench, 16.8).last().unwrap().contacts.len(), 1);
}

/// Removes the last element of every list of a name, or of the lists in it.
fn shorten(value: &mut serde_json::Value, name: &str) {
    match value {
        serde_json::Value::Object(members) => {
            for (key, member) in members {
                match member {
                    serde_json::Value::Array(list) if key == name => {
                        match list.last_mut().and_then(serde_json::Value::as_array_mut) {
                            Some(last) => drop(last.pop()),
                            None => drop(list.pop()),
                        }
                    }
                    _ => shorten(member, name),
                }
            }
        }
        serde_json::Value::Array(list) => list.iter_mut().for_each(|member| shorten(member, name)),
        _ => {}
    }
}

#[test]
fn a_contact_does_not_outlast_a_gap_and_ids_do_not_come_again() {
    let mut bench = Bench::new(lab(), 63, vec![press(1.0), press(6.0), press(10.0)], Settings::default());
    assert_eq!(until(&mut bench, 1.5).last().unwrap().contacts[0].contact.id, 1);
    // Lifted and pressed again during the gap.
    bench.next = 6 * 120 + 60;
    assert_eq!(until(&mut bench, 6.8).last().unwrap().contacts[0].contact.id, 2);
    until(&mut bench, 7.5);
    bench.pipeline.command(&Command::Tare).unwrap();
    assert_eq!(until(&mut bench, 10.8).last().unwrap().contacts[0].contact.id, 3);
}

#[test]
fn a_device_that_was_exchanged_is_tared_and_the_same_one_is_not() {
    let mut bench = Bench::new(lab(), 65, vec![press(8.0)], Settings::default());
    let device = |serial: u32| Command::Device { serial: serial.try_into().unwrap() };
    bench.pipeline.command(&device(3)).unwrap();
    bench.pipeline.command(&device(3)).unwrap();
    // From the state of a recording or of an earlier run, too.
    let text = serde_json::to_string(bench.pipeline.state()).unwrap();
    let state: State = serde_json::from_str(&text).unwrap();
    bench.pipeline = Pipeline::resume(methods(), state).unwrap();
    until(&mut bench, 2.0);
    bench.pipeline.take_notices();
    bench.pipeline.command(&device(3)).unwrap();
    assert!(until(&mut bench, 2.1).iter().all(|frame| frame.validity.is_usable()));
    bench.pipeline.command(&device(7)).unwrap();
    let texts: Vec<String> = bench.pipeline.take_notices().into_iter().map(|notice| notice.text).collect();
    assert!(texts[0].starts_with("the device is number 7, the baseline is of number 3"), "{texts:?}");
    let frames = until(&mut bench, 8.5);
    assert!(!frames[0].validity.is_usable());
    let last = frames.last().unwrap();
    assert_eq!((last.contacts.len(), last.health.device_serial.map(u32::from)), (1, Some(7)));
}

#[test]
fn an_electrode_that_is_gone_at_the_tare_is_named_and_the_rest_feels() {
    let faults = ["loose:7:1000000@0"];
    let mut bench = Bench::faulty(lab(), 64, vec![press(1.5)], Settings::default(), &faults);
    let notices: Vec<String> = bench.pipeline.take_notices().into_iter().map(|notice| notice.text).collect();
    assert!(notices.iter().any(|text| text.contains("electrode 7 ")), "{notices:?}");
    assert_eq!(notices.len(), 2, "{notices:?}");
    assert!(bench.pipeline.wants_rebuild());
    bench.pipeline.command(&Command::Rebuild).unwrap();
    let before = until(&mut bench, 1.5);
    assert!(before.iter().all(|frame| frame.touched == Some(false)));
    let states: Vec<ElectrodeState> = before.last().unwrap().health.electrodes.iter().map(|e| e.state).collect();
    let bad: Vec<usize> = (0..states.len()).filter(|&electrode| states[electrode] != ElectrodeState::Sound).collect();
    assert_eq!(bad, [7]);
    let pressed = until(&mut bench, 2.4);
    let held = &pressed[20..];
    assert!(held.iter().all(|frame| frame.contacts.len() == 1));
    let off_m = surface_distance(held[0].contacts[0].contact.position_m, along(&press(1.5), 1.6));
    assert!(off_m < 0.01, "{off_m}");
}
