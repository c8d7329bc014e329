//! A method that depends on the untouched skin: adapted by a job after the tare, while frames are processed without it.

use crate::rows::bench::{Bench, TARE, along, lab, methods, place, stroke, surface_distance};
use crate::rows::gaps::until;
use dermis::method::Methods;
use dermis::pipeline::{Command, Pipeline, PipelineFrame, Settings, State};
use dermis_emulate::emulator::Stroke;

fn press() -> Stroke {
    stroke(1.0, 3.0, place(0.15, 120.0), None, 2.0)
}

fn bench(method: &str) -> Bench {
    Bench::new(lab(), 65, vec![press()], Settings { method: method.into(), ..Settings::default() })
}

/// As text, in which what is unknown is equal.
fn contacts(frames: &[PipelineFrame]) -> Vec<String> {
    frames.iter().map(|frame| format!("{:?}", frame.contacts)).collect()
}

#[test]
fn frames_are_processed_without_it_until_it_is_ready() {
    let (mut plain, mut bench) = (bench("spots"), bench(Methods::REFINED));
    assert!(bench.pipeline.wants_rebuild() && !plain.pipeline.wants_rebuild());
    let [without, before] = [&mut plain, &mut bench].map(|bench| until(bench, 2.0));
    assert_eq!(contacts(&without), contacts(&before));
    bench.rebuild();
    assert!(!bench.pipeline.wants_rebuild());
    let [without, after] = [&mut plain, &mut bench].map(|bench| until(bench, 3.0));
    let last = |frames: &[PipelineFrame]| frames.last().unwrap().contacts[0].contact.position_m;
    assert_ne!(last(&without), last(&after));
    // Twice the 95th percentile over all places.
    let off_m = surface_distance(last(&after), along(&press(), 3.0));
    assert!(off_m < 4e-3, "{off_m}");
}

#[test]
fn a_stored_state_goes_on_with_it() {
    let mut bench = bench(Methods::REFINED);
    bench.rebuild();
    until(&mut bench, 1.5);
    // The health is computed at once while there are notices, and otherwise every few frames.
    bench.pipeline.take_notices();
    let kept = serde_json::to_string(bench.pipeline.state()).unwrap();
    let state: State = serde_json::from_str(&kept).unwrap();
    let mut resumed = Pipeline::resume(methods(), state).unwrap();
    assert!(!resumed.wants_rebuild());
    for _ in 0..60 {
        let next = bench.next;
        let packet = bench.emulator.frame_packet(next).unwrap();
        let input = bench.receive(&packet, next).pop().expect("a whole frame").input;
        bench.next += 1;
        let (frame, again) = (bench.pipeline.process(input.clone()).unwrap(), resumed.process(input).unwrap());
        assert_eq!(frame.contacts.len(), 1, "{:?}", frame.contacts);
        // As text, in which what is unknown is equal.
        assert_eq!(format!("{frame:?}"), format!("{again:?}"), "the same, to the last bit");
    }
}

#[test]
fn a_job_of_the_tare_before_is_not_used() {
    let mut bench = bench(Methods::REFINED);
    bench.rebuild();
    let late = bench.pipeline.rebuild_job().run().unwrap();
    bench.pipeline.command(&Command::Tare).unwrap();
    assert!(!bench.pipeline.wants_rebuild(), "nothing is known yet");
    // A touch may begin or end in the tare, which takes longer then.
    (0..4 * TARE).find(|_| {
        drop(bench.frame());
        bench.pipeline.wants_rebuild()
    });
    assert!(bench.pipeline.wants_rebuild());
    assert!(!bench.pipeline.install_method(late) && bench.pipeline.wants_rebuild());
    bench.rebuild();
    assert!(!bench.pipeline.wants_rebuild());
}
