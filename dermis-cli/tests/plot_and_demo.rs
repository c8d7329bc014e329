//! `dermis plot` and `dermis demo`, as users run them.

use std::path::Path;
use std::process::{Command, Output};

fn dermis(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_dermis")).args(arguments).current_dir(folder).output().expect("dermis runs")
}

fn ok(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn refused(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(2), "a mistake of the user's ends with code 2");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn every_kind_of_picture_is_drawn_in_both_views() {
    let folder = tempfile::tempdir().unwrap();
    for what in ["mesh", "electrodes", "sensitivity"] {
        for view in ["unrolled", "3d"] {
            ok(&dermis(folder.path(), &["plot", "tank16", "--what", what, "--view", view, "-o", "p.png"]));
            assert!(std::fs::read(folder.path().join("p.png")).unwrap().starts_with(b"\x89PNG"));
            ok(&dermis(folder.path(), &["plot", "tank16", "--what", what, "--view", view, "-o", "p.svg"]));
            assert!(std::fs::read_to_string(folder.path().join("p.svg")).unwrap().starts_with("<svg"));
        }
    }
}

/// A frame of `tank16` as a difference, with nonzero first values.
fn difference(folder: &Path) {
    let row: Vec<String> = (0..208).map(|channel| if channel < 13 { "0.5".into() } else { "0".to_string() }).collect();
    std::fs::write(folder.join("d.csv"), row.join(",") + "\n").unwrap();
}

#[test]
fn images_and_localisation_are_drawn_from_frames() {
    let folder = tempfile::tempdir().unwrap();
    difference(folder.path());
    let from = ["--frames", "d.csv", "--difference", "-o", "p.svg"];
    ok(&dermis(folder.path(), &[&["plot", "tank16", "--what", "image"], &from[..]].concat()));
    let svg = std::fs::read_to_string(folder.path().join("p.svg")).unwrap();
    assert!(svg.contains("relative") && svg.contains("one-step"));
    std::fs::write(folder.path().join("t.csv"), "frame,x_m,y_m\n0,0.05,0.02\n").unwrap();
    let what = ["plot", "tank16", "--what", "localisation", "--truth", "t.csv"];
    ok(&dermis(folder.path(), &[&what[..], &from[..]].concat()));
    assert!(std::fs::read_to_string(folder.path().join("p.svg")).unwrap().contains("true position"));
    let what = ["plot", "tank16", "--what", "image", "--truth", "t.csv"];
    ok(&dermis(folder.path(), &[&what[..], &from[..]].concat()));
    assert!(std::fs::read_to_string(folder.path().join("p.svg")).unwrap().contains("true position"));
    let images = ["reconstruct", "tank16", "--frames", "d.csv", "--difference", "-o", "i.npy"];
    ok(&dermis(folder.path(), &images));
    ok(&dermis(folder.path(), &["plot", "tank16", "--what", "image", "--images", "i.npy", "-o", "q.svg"]));
}

#[test]
fn what_cannot_be_drawn_is_refused_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    difference(folder.path());
    let says = |arguments: &[&str], words: &[&str]| {
        let message = refused(&dermis(folder.path(), arguments));
        for word in words {
            assert!(message.contains(word), "`{word}` is missing in: {message}");
        }
    };
    says(&["plot", "tank16", "-o", "p.jpg"], &["p.jpg", ".svg", ".png"]);
    says(&["plot", "tank16", "-o", "no/such/folder.svg"], &["folder.svg"]);
    says(&["plot", "tank16", "--what", "image", "-o", "p.svg"], &["--images", "--frames"]);
    says(&["plot", "tank16", "--what", "image", "--frames", "d.csv", "-o", "p.svg"], &["--baseline", "--difference"]);
    let frame =
        ["plot", "tank16", "--what", "image", "--frames", "d.csv", "--difference", "--frame", "1", "-o", "p.svg"];
    says(&frame, &["no image 1", "there are 1"]);
    let place = ["plot", "tank16", "--what", "localisation", "--frames", "d.csv", "--difference", "-o", "p.svg"];
    says(&place, &["--truth"]);
    says(&["plot", "cylinder30", "--what", "image", "--images", "d.csv", "-o", "p.svg"], &["[1, 208]", "cells"]);
    assert!(!folder.path().join("p.svg").exists());
}

#[test]
fn the_tanks_objects_stand_at_the_electrodes_that_their_recordings_name() {
    let folder = tempfile::tempdir().unwrap();
    let text = ok(&dermis(folder.path(), &["demo", "tank", "-o", "t/tank.html"]));
    println!("{text}");
    assert!(text.contains("18 of 18 objects") && text.contains("tank.html"));
    let json: serde_json::Value =
        serde_json::from_str(&ok(&dermis(folder.path(), &["demo", "tank", "--json"]))).unwrap();
    let recordings = json["recordings"].as_array().unwrap();
    assert_eq!(recordings.len(), 6);
    for object in recordings.iter().flat_map(|recording| recording["objects"].as_array().unwrap()) {
        assert!(object["off_spacings"].as_f64().unwrap().abs() <= 0.5, "{object}");
    }
    let page = std::fs::read_to_string(folder.path().join("t/tank.html")).unwrap();
    assert_eq!(page.matches("<svg xmlns").count(), 6);
}

#[test]
fn the_demo_finds_every_press_and_writes_a_page_that_needs_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let json: serde_json::Value = serde_json::from_str(&ok(&dermis(folder.path(), &["demo", "--json"]))).unwrap();
    println!("demo: {json}");
    assert_eq!(json["presses"], 900);
    assert_eq!(json["simulated"], true);
    // The default method: a broken pipeline is far outside these limits.
    assert!(json["misses"].as_u64().unwrap() <= 9 && json["false_positives"].as_u64().unwrap() <= 9);
    let means_m = json["methods"].as_array().unwrap().iter().map(|of| of["localisation_m"]["mean"].as_f64().unwrap());
    let means_m: Vec<f64> = means_m.collect();
    assert!(means_m[0] > 2e-4 && means_m[0] < 2e-3 && means_m[0] < 0.5 * means_m[1], "{means_m:?}");
    assert!(json["simulation_nodes"].as_u64().unwrap() > 2 * json["reconstruction_nodes"].as_u64().unwrap());
    let page = std::fs::read_to_string(folder.path().join("out/demo/index.html")).unwrap();
    assert!(page.matches("<svg xmlns").count() >= 8, "the pictures are in the page");
    assert!(page.contains("SIMULATED") && page.contains("measured"));
    let page = page.replace("href=\"#", "");
    for foreign in ["src=", "href=", "url(", "<script"] {
        assert!(!page.contains(foreign), "{foreign}");
    }
}
