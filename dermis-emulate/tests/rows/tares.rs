//! Touches and faults of the instrument during the tare.

use crate::rows::bench::{Bench, along, lab, place, stroke, surface_distance};
use dermis::pipeline::{InvalidReason, PipelineFrame, Settings, Validity};
use dermis_emulate::emulator::{Place, Stroke};
use dermis_sim::random::sample_rng;
use rand::RngExt;
use rand::seq::SliceRandom;

/// A press is found by a contact within this distance, m.
const NEAR_M: f64 = 0.02;
/// After a press contacts may last so long, s.
const AFTER_S: f64 = 0.3;

/// What a run showed of the presses after the tare.
#[derive(Debug, Default)]
struct Seen {
    /// Frames of the presses, and those of them with a contact there.
    pressed: u32,
    found: u32,
    /// Frames with contacts where nothing presses.
    ghosts: u32,
    /// The end of the tare, s.
    tared_s: f64,
}

/// Reads a device with a touch of some time during the tare, and two presses afterwards, of which one is at the same place.
fn after(touch: Stroke, elsewhere: Place, seed: u64) -> Seen {
    let presses = [stroke(6.0, 1.0, touch.from, None, 2.0), stroke(8.0, 1.0, elsewhere, None, 2.0)];
    let touches: Vec<Stroke> = [touch].into_iter().chain(presses.clone()).collect();
    let mut bench = Bench::before_the_tare(lab(), seed, touches.clone(), Settings::default(), &[]);
    let mut seen = Seen::default();
    while bench.time_s() < 10.0 {
        let time_s = bench.time_s();
        let frame = bench.frame();
        bench.rebuild();
        let is_tare = frame.validity == Validity::Invalid { reason: InvalidReason::Tare };
        if is_tare {
            seen.tared_s = time_s;
        }
        let is_at = |stroke: &&Stroke| time_s >= stroke.at_s && time_s < stroke.at_s + stroke.for_s + AFTER_S;
        let is_near = |press: &Stroke, frame: &PipelineFrame| {
            let at_m = along(press, press.at_s);
            frame.contacts.iter().any(|contact| surface_distance(contact.contact.position_m, at_m) < NEAR_M)
        };
        seen.ghosts += u32::from(!touches.iter().any(|stroke| is_at(&stroke)) && !frame.contacts.is_empty());
        if let Some(press) = presses.iter().find(|press| (press.at_s + 0.1..press.at_s + 0.9).contains(&time_s)) {
            seen.pressed += 1;
            seen.found += u32::from(is_near(press, &frame));
            seen.ghosts += u32::from(frame.contacts.len() > 1);
        }
    }
    seen
}

fn anywhere(rng: &mut impl RngExt) -> Place {
    place(rng.random_range(0.03..0.27), rng.random_range(0.0..360.0))
}

/// Taps of 20 to 500 ms at random times of the tare; prints what they leave.
fn taps(count: u64) {
    let mut rng = sample_rng(53, 0);
    let (mut blind, mut ghosts, mut latest_s) = (0, 0, 0.0_f64);
    for seed in 0..count {
        let tap = Stroke {
            ramp_s: 0.005,
            ..stroke(rng.random_range(0.0..0.8), 0.02 * 25f64.powf(rng.random()), anywhere(&mut rng), None, 3.0)
        };
        let seen = after(tap.clone(), anywhere(&mut rng), 500 + seed);
        let is_blind = f64::from(seen.found) < 0.99 * f64::from(seen.pressed);
        if is_blind || seen.ghosts > 0 {
            println!("tap of {:.0} ms at {:.2} s: {seen:?}", 1e3 * tap.for_s, tap.at_s);
        }
        blind += u32::from(is_blind);
        ghosts += seen.ghosts;
        latest_s = latest_s.max(seen.tared_s);
    }
    println!(
        "{count} taps of 20 to 500 ms in the tare: {blind} runs with a blind place, {ghosts} frames with false contacts, the last tare ended at {latest_s:.1} s"
    );
    assert_eq!((blind, ghosts), (0, 0));
}

#[test]
fn taps_during_the_tare_leave_nothing() {
    taps(4);
}

#[test]
#[ignore = "slow: 100 taps"]
fn a_hundred_taps_during_the_tare_leave_nothing() {
    taps(100);
}

#[test]
fn a_touch_that_lasts_through_the_tare_is_gone_after_it() {
    let mut rng = sample_rng(54, 0);
    for seed in 0..4 {
        let seen = after(stroke(0.0, 3.0, anywhere(&mut rng), None, 2.0), anywhere(&mut rng), 700 + seed);
        println!("touched for 3 s from before the tare on: {seen:?}");
        assert!((3.0..6.0).contains(&seen.tared_s), "the skin is tared again: {seen:?}");
        assert_eq!((seen.found, seen.ghosts), (seen.pressed, 0));
    }
}

/// Another order of the channels, drawn by chance.
fn shuffled(seed: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..870).collect();
    order.shuffle(&mut sample_rng(55, seed));
    order
}

/// Changes the values of every frame.
type Change<'a> = &'a dyn Fn(&mut Vec<f64>);

#[test]
fn no_frame_is_ok_while_the_instrument_is_broken_since_before_the_tare() {
    let as_it_is: Change<'_> = &|_| ();
    for (fault, reason) in [
        ("source-off", "every value"),
        ("zeros", "every value"),
        ("full-scale", "agrees with the model of the design by"),
        ("freeze", "frozen"),
        ("gain:0.0001", "every value"),
    ] {
        watch(&[&format!("{fault}@0+4")], as_it_is, reason);
    }
    for seed in 0..4 {
        let order = shuffled(seed);
        watch(&[], &|values| *values = order.iter().map(|&from| values[from]).collect(), "another order");
    }
    watch(&[], &|values| values.iter_mut().for_each(|value| *value = -*value), "with all signs turned");
    watch(&[], &|values| values.iter_mut().for_each(|value| *value = value.abs()), "without signs");
    watch(&[], &|values| values.rotate_right(1), "one value earlier");
}

/// Reads 3.5 s of a faulty device: no frame is usable, and a notice has these words.
fn watch(faults: &[&str], change: Change<'_>, reason: &str) {
    let mut bench = Bench::before_the_tare(lab(), 56, Vec::new(), Settings::default(), faults);
    let mut texts = Vec::new();
    while bench.time_s() < 3.5 {
        let frame = bench.changed(change);
        bench.rebuild();
        assert!(!frame.validity.is_usable() && frame.contacts.is_empty(), "{faults:?}, {reason}: {}", frame.sequence);
        texts.extend(bench.pipeline.take_notices().into_iter().map(|notice| notice.text));
    }
    assert!(texts.iter().any(|text| text.contains(reason)), "{faults:?}, {reason}: {texts:?}");
}
