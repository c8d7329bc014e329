//! Thresholds of the whole skin and of zones, set at the start and changed while it is read.

use crate::rows::bench::{Bench, along, lab, place, stroke};
use dermis::pipeline::PipelineFrame;
use dermis::pipeline::{Command, Settings, Zone};
use dermis_emulate::emulator::{Place, Stroke};

/// Two simultaneous presses, one in the zone.
fn presses() -> [Stroke; 2] {
    [place(0.1, 40.0), place(0.2, 200.0)].map(|at: Place| stroke(1.0, 9.0, at, None, 2.0))
}

fn zone(threshold: f64) -> Zone {
    Zone { name: "palm".into(), centre_m: along(&presses()[0], 1.0), radius_m: 0.04, threshold }
}

fn pressed(settings: Settings) -> Bench {
    let mut bench = Bench::new(lab(), 95, presses().to_vec(), settings);
    while bench.time_s() < 1.2 {
        bench.frame();
    }
    bench
}

fn zones(frame: &PipelineFrame) -> Vec<Option<&str>> {
    frame.contacts.iter().map(|contact| contact.zone.as_deref()).collect()
}

#[test]
fn a_zone_names_its_contacts_and_has_a_threshold_of_its_own() {
    let of = |zones: Vec<Zone>| Settings { zones, ..Settings::default() };
    let mut named = zones(&pressed(of(vec![zone(1.0)])).frame())
        .into_iter()
        .map(|zone| zone.map(str::to_string))
        .collect::<Vec<_>>();
    named.sort();
    assert_eq!(named, [None, Some("palm".into())]);
    // The threshold there is above the press: only the other contact remains.
    assert_eq!(zones(&pressed(of(vec![zone(1e5)])).frame()), [None]);
}

#[test]
fn thresholds_change_while_the_skin_is_read() {
    let mut bench = pressed(Settings::default());
    let mut after = |command: &Command| {
        bench.pipeline.command(command).unwrap();
        // A contact ends 50 ms after it was last detected and begins in the second frame.
        (0..10).for_each(|_| drop(bench.frame()));
        let frame = bench.frame();
        zones(&frame).into_iter().map(|zone| zone.map(str::to_string)).collect::<Vec<Option<String>>>()
    };
    assert_eq!(after(&Command::Threshold { value: 1.0 }).len(), 2);
    assert_eq!(after(&Command::Zones { zones: vec![zone(1e5)] }), [None]);
    assert_eq!(after(&Command::Zones { zones: Vec::new() }), [None, None]);
    assert!(after(&Command::Threshold { value: 1e5 }).is_empty());
    assert_eq!(after(&Command::Threshold { value: 1.0 }).len(), 2);
}

#[test]
fn a_threshold_or_zone_out_of_range_is_refused_and_changes_nothing() {
    let mut bench = pressed(Settings::default());
    let before = bench.pipeline.state().settings.clone();
    let radius = Zone { radius_m: -0.1, ..zone(1.0) };
    let centre = Zone { centre_m: [f64::NAN, 0.0, 0.0], ..zone(1.0) };
    for (command, names) in [
        (Command::Threshold { value: 0.0 }, "threshold is 0"),
        (Command::Threshold { value: f64::NAN }, "threshold is NaN"),
        (Command::Zones { zones: vec![radius] }, "zone `palm`"),
        (Command::Zones { zones: vec![centre] }, "zone `palm`"),
        (Command::Zones { zones: vec![zone(f64::INFINITY)] }, "zone `palm`"),
        (Command::Zones { zones: vec![Zone { centre_m: [0.0, 0.0, 5.0], ..zone(1.0) }] }, "lengths are in metres"),
        (Command::Method { name: "nose".into() }, "nose"),
    ] {
        let told = bench.pipeline.command(&command).unwrap_err().to_string();
        assert!(told.contains(names), "{told}");
        assert_eq!(bench.pipeline.state().settings, before);
    }
    assert_eq!(bench.frame().contacts.len(), 2);
}
