//! Touches that move fast, and light ones, against the same frames one by one.

use crate::rows::bench::{Bench, TARE, along, methods, place, stroke, surface_distance};
use dermis::frame::{Differences, Frame};
use dermis::pipeline::{Settings, TrackedContact};
use dermis_emulate::emulator::{Place, Stroke};
use dermis_sim::random::sample_rng;
use dermis_sim::twin::TwinOptions;
use rand::RngExt;

/// A contact within this distance of the touch is the touch, m.
const NEAR_M: f64 = 0.03;
/// Frames of touches in which the method finds them by itself, those of them in which the pipeline has them, and frames in
/// which it has contacts without a touch.
fn seen(twin: &TwinOptions, seed: u64, method: &str, touches: &[Stroke]) -> [u32; 3] {
    let settings = Settings { method: method.into(), ..Settings::default() };
    let end_s = touches.iter().map(|touch| touch.at_s + touch.for_s).fold(0.0, f64::max) + 0.5;
    let mut bench = Bench::before_the_tare(twin.clone(), seed, touches.to_vec(), settings, &[]);
    let mut read = Vec::new();
    while bench.time_s() < end_s {
        let time_s = bench.time_s();
        let frame = bench.frame();
        bench.rebuild();
        read.push((time_s, frame));
    }
    let (tared, read) = read.split_at(TARE as usize);
    let untouched: Vec<Frame> = tared.iter().map(|(_, frame)| Frame(frame.values_ohm.clone())).collect();
    let frames = read.iter().map(|(_, frame)| Frame(frame.values_ohm.clone())).collect();
    let differences = Differences::new(frames, untouched);
    let set = methods();
    let method = set.method(method).unwrap().adapted(&differences).unwrap();
    let detector = method.detector_of(&differences, &set.skin().design().protocol).unwrap();
    let (mut by_method, mut by_both, mut false_frames) = (0, 0, 0);
    for ((time_s, frame), difference) in read.iter().zip(&differences.frames) {
        let touch = touches.iter().find(|touch| {
            // The tracker confirms a contact in its second frame, and the force has to rise.
            *time_s > touch.at_s + touch.ramp_s + 1.5 / twin.electronics.frame_rate_hz
                && *time_s < touch.at_s + touch.for_s
        });
        let Some(touch) = touch else {
            let is_after = touches.iter().any(|touch| (touch.at_s..touch.at_s + touch.for_s + 0.3).contains(time_s));
            false_frames += u32::from(!is_after && !frame.contacts.is_empty());
            continue;
        };
        let at_m = along(touch, *time_s);
        let found = method.contacts(difference, &detector).unwrap();
        if found.iter().any(|contact| surface_distance(contact.position_m, at_m) < NEAR_M) {
            by_method += 1;
            let is_near = |contact: &TrackedContact| surface_distance(contact.contact.position_m, at_m) < NEAR_M;
            by_both += u32::from(frame.contacts.iter().any(is_near));
        }
    }
    [by_method, by_both, false_frames]
}

/// Touches one after the other, at random places, each with a random direction and some speed, m/s.
fn slides(seed: u64, count: u32, speed_m_s: f64, force_n: f64) -> Vec<Stroke> {
    let mut rng = sample_rng(72, seed);
    let slide = |index: u32| {
        let (angle, from_m, theta_deg) =
            (std::f64::consts::TAU * rng.random::<f64>(), rng.random_range(0.08..0.22), 360.0 * rng.random::<f64>());
        // Within the ends of the body.
        let for_s = if speed_m_s > 0.0 { (0.05 / speed_m_s).clamp(0.2, 1.0) } else { 1.0 };
        let path_m = speed_m_s * for_s;
        let turn_deg = (path_m * angle.sin() / 0.047_75).to_degrees();
        let to: Place = place(from_m + path_m * angle.cos(), theta_deg + turn_deg);
        stroke(1.5 + 1.6 * f64::from(index), for_s, place(from_m, theta_deg), Some(to), force_n)
    };
    (0..count).map(slide).collect()
}

fn table(rates_hz: &[f64], count: u32) {
    let names = ["refined", "noser"];
    for twin_name in ["lab", "lab-b"] {
        for &rate_hz in rates_hz {
            for (what, speed_m_s, force_n) in [
                ("held, 0.8 N", 0.0, 0.8),
                ("20 mm/s, 0.8 N", 0.02, 0.8),
                ("50 mm/s", 0.05, 2.0),
                ("100 mm/s", 0.1, 2.0),
                ("200 mm/s", 0.2, 2.0),
            ] {
                for method in names {
                    let mut twin = TwinOptions::shipped(twin_name).unwrap();
                    twin.electronics.frame_rate_hz = rate_hz;
                    let shift_s = TARE as f64 / rate_hz;
                    let touches: Vec<Stroke> = slides((1e3 * speed_m_s) as u64, count, speed_m_s, force_n)
                        .into_iter()
                        .map(|touch| Stroke { at_s: touch.at_s + shift_s, ..touch })
                        .collect();
                    let [by_method, by_both, false_frames] = seen(&twin, 73, method, &touches);
                    println!(
                        "{twin_name}, {rate_hz} frames a second, {what}, {method}: {by_both} of {by_method} frames, {false_frames} false"
                    );
                    assert!(
                        f64::from(by_both) >= 0.95 * f64::from(by_method),
                        "{twin_name}, {rate_hz}, {what}, {method}"
                    );
                    assert_eq!(false_frames, 0, "{twin_name}, {rate_hz}, {what}, {method}");
                }
            }
        }
    }
}

#[test]
#[ignore = "slow: 800 touches; prints a table"]
fn light_and_fast_touches_are_seen_where_the_method_finds_them() {
    table(&[120.0, 20.0], 20);
}
