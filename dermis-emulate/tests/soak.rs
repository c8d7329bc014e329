//! Hours and days of operation, simulated as fast as the machine allows. Run with
//! `cargo test --release -p dermis-emulate --all-features --test soak -- --ignored --nocapture`.

use dermis::geom::Point3;
use dermis::method::MethodSet;
use dermis::pipeline::{Pipeline, PipelineFrame, Settings};
use dermis::skin::Skin;
use dermis_emulate::emulator::{EmulatorOptions, Place, Script, Stroke};
use dermis_emulate::offline::OfflineSession;
use dermis_sim::random::{sample_rng, uniform};
use dermis_sim::twin::{DriftOptions, TwinOptions};
use std::sync::Arc;

/// A contact within this distance is that of a press, m.
const NEAR_M: f64 = 0.03;

/// A session of the paper's skin with NOSER.
fn session(twin: TwinOptions, touches: Vec<Stroke>) -> OfflineSession {
    let skin = Skin::load("cylinder30").unwrap();
    let methods = Arc::new(MethodSet::new(&dermis_learn::methods(), skin, None).unwrap());
    let settings = Settings { method: "noser".into(), ..Settings::default() };
    let script = Script { repeat_s: None, touches };
    let device = EmulatorOptions { twin, seed: 7, script, faults: vec![], speed: 1.0, prerendered: 0, unpaced: true };
    OfflineSession::new(device, Pipeline::new(methods, settings).unwrap()).unwrap()
}

/// Presses at random places, of 1 to 4 N.
fn presses(count: usize, first_s: f64, interval_s: f64, for_s: f64) -> Vec<Stroke> {
    let mut rng = sample_rng(71, 0);
    let press = |index: usize| Stroke {
        at_s: first_s + interval_s * index as f64,
        for_s,
        from: Place::Cylinder { z_m: uniform(&mut rng, [0.02, 0.28]), theta_deg: uniform(&mut rng, [0.0, 360.0]) },
        to: None,
        force_n: uniform(&mut rng, [1.0, 4.0]),
        ramp_s: 0.05,
    };
    (0..count).map(press).collect()
}

/// What a run has shown.
#[derive(Debug, Default)]
struct Run {
    frames: u64,
    invalid: u64,
    /// Untouched frames, and those of them with a contact, or said to be touched.
    untouched: u64,
    with_contacts: u64,
    said_touched: u64,
    /// Presses in each half of the run, and those of them that were found.
    presses: [usize; 2],
    found: [usize; 2],
    /// Resident memory after a tenth of the run and at its end, MB.
    memory_mb: [f64; 2],
}

/// Runs until a device time; contacts may last for `ending_s` after a press.
fn run(session: &mut OfflineSession, until_s: f64, ending_s: f64) -> Run {
    let surface = session.pipeline.skin().pixels().surface;
    let is_near = |frame: &PipelineFrame, at_m: Point3| {
        frame.contacts.iter().any(|contact| surface.distance_m(contact.contact.position_m, at_m) < NEAR_M)
    };
    let (mut run, mut pressed_s, mut press) = (Run::default(), f64::NEG_INFINITY, None);
    while session.time_s() < until_s {
        let (time_s, presses) = (session.time_s(), session.presses());
        let half = usize::from(time_s > 0.5 * until_s);
        let frame = session.frame().unwrap().expect("every frame is whole");
        session.rebuild();
        if run.memory_mb[0] == 0.0 && time_s > 0.1 * until_s {
            run.memory_mb[0] = resident_mb();
        }
        if frame.sequence < 100 {
            continue;
        }
        run.frames += 1;
        run.invalid += u64::from(!frame.validity.is_usable());
        if let [now] = presses[..] {
            pressed_s = time_s;
            let (place, is_found) = press.take_if(|(at_m, _)| *at_m == now.centre_m).unwrap_or_else(|| {
                run.presses[half] += 1;
                (now.centre_m, false)
            });
            run.found[half] += usize::from(!is_found && is_near(&frame, place));
            press = Some((place, is_found || is_near(&frame, place)));
        } else if time_s - pressed_s > ending_s {
            run.untouched += 1;
            run.with_contacts += u64::from(!frame.contacts.is_empty());
            run.said_touched += u64::from(frame.touched == Some(true));
        }
    }
    run.memory_mb[1] = resident_mb();
    run
}

/// Resident memory of this process, MB.
fn resident_mb() -> f64 {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let resident = pages.split(' ').nth(1).and_then(|pages| pages.parse::<f64>().ok());
    resident.map_or(0.0, |pages| pages * 4096.0 / 1e6)
}

/// `harsh` after it has warmed up.
fn harsh() -> TwinOptions {
    TwinOptions::shipped("harsh").unwrap()
}

#[test]
fn five_minutes_at_ten_frames_a_second_with_presses() {
    let mut twin = harsh();
    twin.electronics.frame_rate_hz = 10.0;
    let mut session = session(twin, presses(28, 15.0, 10.0, 2.0));
    let run = run(&mut session, 300.0, 0.5);
    println!("{run:?}");
    assert!(run.presses == [14; 2] && run.found.iter().sum::<usize>() + 1 >= 28, "{run:?}");
    assert_eq!(run.invalid, 0);
}

/// Runs a session on `harsh` with the figures that hold at 120 frames per second.
fn normal_operation(touches: Vec<Stroke>, until_s: f64) -> Run {
    let run = run(&mut session(harsh(), touches), until_s, 0.12);
    println!("harsh: {run:?}");
    assert!(run.invalid <= 1, "{run:?}");
    assert!(run.memory_mb[1] - run.memory_mb[0] < 5.0, "{run:?}");
    run
}

#[test]
#[ignore = "slow: an hour at 120 frames per second"]
fn an_hour_untouched() {
    let run = normal_operation(vec![], 3600.0);
    assert_eq!((run.with_contacts, run.said_touched), (0, 0));
}

#[test]
#[ignore = "slow: 25 minutes at 120 frames per second"]
fn a_thousand_presses() {
    let run = normal_operation(presses(1000, 3.0, 1.5, 0.7), 1505.0);
    // NOSER misses some weak presses of this twin: see docs/validation.md.
    assert!(run.found.iter().sum::<usize>() > 900, "{run:?}");
}

#[test]
#[ignore = "slow: a day at 2 frames per second"]
fn a_day_of_drift_warming_ageing_contacts_and_presses() {
    let mut twin = harsh();
    // The time matters, not the number of frames.
    twin.electronics.frame_rate_hz = 2.0;
    twin.drift = Some(DriftOptions { conductance_rms: 0.03, contact_rms: 0.5, time_constant_s: 20_000.0 });
    let mut session = session(twin, presses(1438, 60.0, 60.0, 10.0));
    let run = run(&mut session, 86_400.0, 5.0);
    println!("a day: {run:?}");
    assert!(run.invalid <= 24 && run.with_contacts == 0, "{run:?}");
    let missed = [0, 1].map(|half| (run.presses[half] - run.found[half]) as f64 / run.presses[half] as f64);
    assert!(missed[0] < 0.1 && missed[1] < missed[0] + 0.03, "{run:?}");
    assert!(run.memory_mb[1] - run.memory_mb[0] < 5.0, "{run:?}");
}
