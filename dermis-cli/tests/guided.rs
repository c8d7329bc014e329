//! `dermis calibrate --live`: a guided session without a page, pressed by a script.

use crate::workplace::Workplace;
use dermis::skin::Skin;
use dermis_calibrate::Places;
use std::fmt::Write as _;

const PRESSES: usize = 10;
/// Time between two presses, s.
const EVERY_S: f64 = 2.2;

/// A script that presses the places of a session one after the other, after the tare.
fn script(at: &Workplace, skin: &Skin, presses: std::ops::Range<usize>) {
    let places = Places::spread(skin, PRESSES).positions_m;
    let mut text = "repeat_s = 1000\n".to_string();
    for (number, [x, y, z]) in places[presses].iter().enumerate() {
        let at_s = 2.0 + EVERY_S * number as f64;
        writeln!(text, "[[touch]]\nat_s = {at_s}\nfor_s = 1.4\nforce_n = 2\nfrom = [{x:?}, {y:?}, {z:?}]").unwrap();
    }
    at.write("script.toml", text);
}

#[test]
fn a_session_takes_every_press_and_goes_on_later() {
    let at = Workplace::new();
    let skin = Skin::load(at.path("disk.toml").to_str().unwrap()).unwrap();
    let session = |presses: usize| {
        let run =
            format!("calibrate disk.toml --live --serve off --touch script.toml --json -o own --presses {presses}");
        let mut command = at.command(&run);
        let output = command.stdin(std::process::Stdio::null()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{said}");
        let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        (result, said)
    };
    script(&at, &skin, 0..4);
    let (result, said) = session(4);
    assert_eq!(
        (&result["presses"], &result["left"], &result["quality"]),
        (&4.into(), &0.into(), &serde_json::Value::Null)
    );
    assert!(said.contains("press with about 2 N at x") && said.contains("4 of 4 presses"), "{said}");
    assert!(!at.path("own/calibration.json").exists());

    script(&at, &skin, 4..PRESSES);
    let (result, said) = session(PRESSES);
    assert_eq!((&result["presses"], &result["coverage"]), (&PRESSES.into(), &1.0.into()), "{said}");
    let error_m = result["quality"]["mean_error_m"].as_f64().unwrap();
    assert!(error_m < 0.03, "{error_m} m");
    assert_eq!(result["quality"]["labels"], PRESSES);

    // So few presses are worse than the skin's own method, which both ways say. They give the same calibration, and it locates them.
    let worse = "noser without a calibration to";
    assert!(said.contains(worse), "{said}");
    let calibrate = "calibrate disk.toml --frames own/frames.csv --difference --truth own/presses.csv -o again --json";
    assert!(at.refused(calibrate).contains(worse));
    let again = at.run(&format!("{calibrate} --force"));
    assert!(again.status.success(), "{}", String::from_utf8_lossy(&again.stderr));
    // Too few presses for the correction of a method.
    assert_eq!(result["method"], "forward-map");
    for name in ["calibration.json", "weights.npy", "whitening.npy"] {
        let read = |folder: &str| std::fs::read(at.path(&format!("{folder}/{name}"))).unwrap();
        assert!(read("own") == read("again"), "{name}");
    }
    let score = at
        .json("evaluate disk.toml --frames own/frames.csv --difference --truth own/presses.csv --method ./own --json");
    assert!(score["localisation_m"]["mean"].as_f64().unwrap() < 0.01, "{score}");
}

#[test]
fn sessions_that_cannot_be_say_why() {
    let at = Workplace::new();
    let refused = |arguments: &str, words: &[&str]| {
        let said = at.refused(&format!("calibrate disk.toml -o own {arguments}"));
        words.iter().for_each(|word| assert!(said.contains(word), "no `{word}` in: {said}"));
    };
    refused("", &["--frames", "--truth"]);
    refused("--live --presses 0", &["--presses", "1 to 1000000"]);
    refused("--live --presses 3 --places x.csv", &["--places"]);
    refused("--live --frames x.csv", &["--frames", "--live"]);
    refused("--presses 3 --frames x.csv --difference --truth y.csv", &["--live"]);
    refused("--live --source replay:x.mcap", &["a recording cannot be pressed"]);
    at.write("places.csv", "0.01,0.02\n");
    refused("--live --places places.csv", &["places.csv", "x_m,y_m"]);
    at.write("places.csv", "x_m,y_m\n10,20\n");
    refused("--live --places places.csv", &["places.csv, row 2", "millimetres"]);
    std::fs::create_dir(at.path("own")).ok();
    at.write("own/frames.csv", "1,2,3\n");
    at.write("own/presses.csv", "frame,x_m,y_m\n0,0.01,0.02\n");
    refused("--live", &["own/frames.csv", "3"]);
    // Whole frames, of a recording of the user's own.
    at.good("forward disk.toml -o own/frames.csv");
    refused("--live", &["own/frames.csv", "no file of a session", "whole frames"]);
    at.write("own/calibration.json", "{\"camera\": [1, 2]}");
    let said = at.refused("calibrate disk.toml --frames own/frames.csv --difference --truth own/presses.csv -o own");
    assert!(said.contains("own/calibration.json") && said.contains("no calibration of this program"), "{said}");
}
