//! `dermis check-frames`: findings, page, mended recording, and input that is refused.

use crate::workplace::{DISK, Workplace};
use std::fmt::Write;

const PRESSES: usize = 90;

/// The rows of a CSV file.
fn rows(at: &Workplace, name: &str) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(at.path(name)).unwrap();
    text.lines().map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect()
}

fn write_rows(at: &Workplace, name: &str, rows: &[Vec<f64>]) {
    let line = |row: &Vec<f64>| row.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>().join(",");
    at.write(name, rows.iter().map(line).collect::<Vec<_>>().join("\n") + "\n");
}

/// A folder with `disk.toml`, `rest.csv`, `frames.csv` with a press in each row, and `touches.csv`.
fn recorded() -> Workplace {
    let at = Workplace::new();
    let mut touches = String::from("frame,x_m,y_m\n");
    for press in 0..PRESSES {
        // Places on a spiral by the golden angle, in an order that leaps.
        let number = (press * 37) % PRESSES;
        let (radius_m, angle) = (0.042 * (number as f64 / PRESSES as f64).sqrt(), number as f64 * 2.399_963);
        let _ = writeln!(touches, "{press},{:.6},{:.6}", radius_m * angle.cos(), radius_m * angle.sin());
    }
    at.write("touches.csv", touches);
    at.good("forward disk.toml -o rest.csv");
    at.good("forward disk.toml --touches touches.csv -o frames.csv");
    at
}

const INPUT: &str = "disk.toml --frames frames.csv --baseline rest.csv";

#[test]
fn a_sound_recording_has_no_findings_and_a_page() {
    let at = recorded();
    let text = at.good(&format!("check-frames {INPUT} --truth touches.csv -o page.html"));
    assert!(text.starts_with("disk: 90 frames, no findings\n"), "{text}");
    let page = std::fs::read_to_string(at.path("page.html")).unwrap();
    assert!(
        page.contains("No findings.") && page.matches("<svg").count() >= 5,
        "{} pictures",
        page.matches("<svg").count()
    );
    assert!(
        !page.contains("src=") && !page.replace("href=\"#", "").contains("href="),
        "the page needs nothing from elsewhere"
    );
    let json = at.json(&format!("check-frames {INPUT} --json"));
    assert_eq!((json["frames"].as_u64(), json["channels"].as_u64()), (Some(90), Some(40)));
    assert_eq!(json["findings"].as_array().unwrap().len(), 0);
    assert!(json["untouched_cosine"].as_f64().unwrap() > 0.999);
}

/// What `contacts` refuses is a finding: frames in another unit than their baseline, or with its signs turned.
#[test]
fn frames_unlike_their_baseline_are_a_finding() {
    let at = recorded();
    let frames = rows(&at, "frames.csv");
    for factor in [0.1, 1000.0, -1.0] {
        let other: Vec<Vec<f64>> = frames.iter().map(|row| row.iter().map(|value| factor * value).collect()).collect();
        write_rows(&at, "other.csv", &other);
        let json = at.json("check-frames disk.toml --frames other.csv --baseline rest.csv --json");
        let found = &json["findings"][0];
        assert_eq!(found["severity"], "error", "{factor}: {json}");
        assert!(found["evidence"].as_str().unwrap().contains("baseline"), "{factor}: {found}");
        at.refused("contacts disk.toml --frames other.csv --baseline rest.csv --method noser -o c.csv");
    }
}

#[test]
fn late_channels_are_named_and_mended() {
    let at = recorded();
    let frames = rows(&at, "frames.csv");
    let mut late = frames.clone();
    for row in 1..PRESSES {
        late[row][10..15].copy_from_slice(&frames[row - 1][10..15]);
    }
    write_rows(&at, "frames.csv", &late);
    let text = at.good(&format!("check-frames {INPUT} --realign mended.csv"));
    assert!(text.contains("1 fault") && text.contains("late, channels 10-14"), "{text}");
    let json = at.json(&format!("check-frames {INPUT} --json"));
    let finding = &json["findings"][0];
    assert_eq!((finding["kind"].as_str(), finding["lag"].as_i64()), (Some("late"), Some(1)));
    assert_eq!(json["lags"].as_array().unwrap().iter().filter(|lag| lag.as_i64() == Some(1)).count(), 5);
    let mended = rows(&at, "mended.csv");
    assert_eq!(mended[..PRESSES - 1], frames[..PRESSES - 1]);
    // The last row lacks the late channels: they are predicted from the others.
    assert_eq!((mended.len(), &mended[PRESSES - 1][15..]), (PRESSES, &frames[PRESSES - 1][15..]));
    at.good("check-frames disk.toml --frames mended.csv --baseline rest.csv");
}

#[test]
fn an_order_and_a_unit_are_named_and_calibrate_warns() {
    let at = recorded();
    at.write("turned.toml", DISK.replace("pattern = ", "measures_reversed = true\npattern = "));
    let input = INPUT.replace("disk.toml", "turned.toml");
    let text = at.good(&format!("check-frames {input}"));
    assert!(text.contains("\nsign_turned\n") && text.contains("measures_reversed = false"), "{text}");
    let output = at.run(&format!("calibrate {input} --truth touches.csv -o calibrated"));
    let warning = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && warning.contains("measures_reversed = false"), "{warning}");
    let small: Vec<Vec<f64>> =
        rows(&at, "frames.csv").into_iter().map(|row| row.into_iter().map(|value| 1e-3 * value).collect()).collect();
    write_rows(&at, "small.csv", &small);
    let rest: Vec<f64> = rows(&at, "rest.csv")[0].iter().map(|value| 1e-3 * value).collect();
    write_rows(&at, "small_rest.csv", &[rest]);
    let text = at.good("check-frames disk.toml --frames small.csv --baseline small_rest.csv");
    assert!(text.contains("magnitude") && text.contains("multiply the values by 1000"), "{text}");
}

/// Frames of the design itself leave nothing but touches; the untouched frame of another skin is in all of them.
#[test]
fn the_untouched_frame_of_the_design_is_a_baseline() {
    let at = recorded();
    let text = at.good("check-frames disk.toml --frames frames.csv --baseline model");
    assert!(text.starts_with("disk: 90 frames, no findings\n"), "{text}");
    let mut frames = rows(&at, "frames.csv");
    frames.iter_mut().flat_map(|frame| frame.iter_mut().step_by(3)).for_each(|value| *value *= 1.3);
    write_rows(&at, "other.csv", &frames);
    let json = at.json("check-frames disk.toml --frames other.csv --baseline model --json");
    assert_eq!(json["findings"][0]["kind"].as_str(), Some("unlike_model"), "{json}");
    let error = at.refused("check-frames disk.toml --frames frames.csv --baseline model --paired");
    assert!(error.contains("leave --paired out"), "{error}");
}

#[test]
fn input_that_cannot_be_checked_is_refused() {
    let at = recorded();
    let check = |arguments: &str| at.refused(&format!("check-frames disk.toml {arguments}"));
    let neither = check("--frames frames.csv");
    assert!(neither.contains("--baseline") && neither.contains("--difference"), "{neither}");
    at.write("empty.csv", "");
    assert!(check("--frames empty.csv --difference").contains("the file is empty"));
    assert!(check("--frames frames.csv --baseline empty.csv").contains("empty.csv"));
    let mut frames = rows(&at, "frames.csv");
    frames[4][2] = f64::NAN;
    write_rows(&at, "bad.csv", &frames);
    // What is realigned has a row for each frame; else the others are checked.
    assert!(check("--frames bad.csv --difference --realign m.csv").contains("bad.csv, row 5: channel 2 is NaN"));
    let output = at.run("check-frames disk.toml --frames bad.csv --difference --json");
    assert!(output.status.success());
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(told.contains("1 of 90 frames have values that are missing or not finite and are not used: 4"), "{told}");
    at.write("short.csv", "1,2,3\n");
    assert!(check("--frames short.csv --difference").contains("too few values: 3"));
    at.write("robot.csv", "0.1,0.2,0.3\n0.1,0.2,0.4\n");
    assert!(check("--frames frames.csv --baseline rest.csv --truth robot.csv").contains("robot.csv"));
    at.write("few.csv", "frame,x_m,y_m\n0,0.01,0.01\n");
    assert!(check("--frames frames.csv --baseline rest.csv --truth few.csv").contains("frame 1 has 0 touches"));
    assert!(check("--frames frames.csv --baseline rest.csv -o page.pdf").contains(".html"));
    assert!(check("--frames frames.csv --baseline rest.csv -o no/such/page.html").contains("no/such/page.html"));
    assert!(!at.path("page.pdf").exists());
}
