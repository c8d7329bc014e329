//! `dermis check-build`: findings, page, a device, and input that is refused.

use crate::workplace::{self, Workplace};

/// The untouched frame of the disk, in `rest.csv`.
fn measured() -> (Workplace, Vec<f64>) {
    let at = Workplace::new();
    at.good("forward disk.toml -o rest.csv");
    let text = std::fs::read_to_string(at.path("rest.csv")).unwrap();
    let values = text.lines().next().unwrap().split(',').map(|field| field.parse().unwrap()).collect();
    (at, values)
}

fn write_frame(at: &Workplace, name: &str, values: &[f64]) {
    let fields: Vec<String> = values.iter().map(|value| format!("{value:?}")).collect();
    at.write(name, fields.join(",") + "\n");
}

#[test]
fn a_sound_skin_has_no_findings_and_a_report_to_sign() {
    let (at, values) = measured();
    // Another sheet resistance is no fault.
    write_frame(&at, "untouched.csv", &values.iter().map(|value| 2.2 * value).collect::<Vec<_>>());
    let text = at.good("check-build disk.toml --frames untouched.csv -o report.html");
    assert!(text.starts_with("disk: 1 untouched frame, sound, no findings\n"), "{text}");
    let page = std::fs::read_to_string(at.path("report.html")).unwrap();
    assert!(page.contains("is sound") && page.contains("signature") && page.matches("<figure").count() == 2);
    assert!(
        !page.contains("src=") && !page.replace("href=\"#", "").contains("href="),
        "the page needs nothing from elsewhere"
    );
    let json = at.json("check-build disk.toml --frames untouched.csv --json");
    assert_eq!((json["sound"].as_bool(), json["contacts"].as_array().unwrap().len()), (Some(true), 8));
    let factor = json["resistance_factor"].as_f64().unwrap();
    assert!((factor - 2.2).abs() < 0.05, "{factor}");
}

#[test]
fn a_factor_of_all_values_is_named_as_what_it_may_be() {
    let (at, values) = measured();
    write_frame(&at, "untouched.csv", &values.iter().map(|value| 20.0 * value).collect::<Vec<_>>());
    let text = at.good("check-build disk.toml --frames untouched.csv");
    assert!(text.contains("resistance\n") && text.contains("the frame cannot tell these apart"), "{text}");
}

#[test]
fn a_drive_with_another_reference_resistor_is_named() {
    let (at, mut values) = measured();
    // Five values for each drive.
    values[15..20].iter_mut().for_each(|value| *value *= 0.5);
    write_frame(&at, "untouched.csv", &values);
    let json = at.json("check-build disk.toml --frames untouched.csv --json");
    let findings = json["findings"].as_array().unwrap();
    assert_eq!((findings[0]["kind"].as_str(), findings[0]["drive"].as_u64()), (Some("reference"), Some(3)));
    assert!((json["faults"][0]["factor"].as_f64().unwrap() - 2.0).abs() < 0.1, "{}", json["faults"][0]);
    assert_eq!(json["sound"].as_bool(), Some(false));
}

#[test]
fn a_scan_table_in_another_order_is_told_by_its_order() {
    let (at, values) = measured();
    // Drives in descending order.
    let turned: Vec<f64> = values.chunks(5).rev().flatten().copied().collect();
    write_frame(&at, "untouched.csv", &turned.iter().map(|value| -value).collect::<Vec<_>>());
    let json = at.json("check-build disk.toml --frames untouched.csv --json");
    assert_eq!(json["sound"].as_bool(), Some(false), "{json}");
}

#[test]
fn amplitudes_are_checked() {
    let (at, values) = measured();
    at.write("amplitudes.toml", workplace::DISK.replace("[protocol]", "[protocol]\namplitude_only = true"));
    write_frame(&at, "untouched.csv", &values.iter().map(|value| value.abs()).collect::<Vec<_>>());
    let text = at.good("check-build amplitudes.toml --frames untouched.csv");
    assert!(text.starts_with("amplitudes: 1 untouched frame, sound, no findings\n"), "{text}");
}

#[test]
fn what_cannot_be_checked_is_refused_with_its_place() {
    let (at, values) = measured();
    let refused = |arguments: &str| at.refused(arguments);
    write_frame(&at, "short.csv", &values[..39]);
    let error = refused("check-build disk.toml --frames short.csv");
    assert!(error.contains("short.csv") && error.contains("39") && error.contains("40"), "{error}");
    let mut broken = values.clone();
    broken[7] = f64::NAN;
    write_frame(&at, "broken.csv", &broken);
    let error = refused("check-build disk.toml --frames broken.csv");
    assert!(error.contains("broken.csv") && error.contains("row 1: channel 7 is NaN"), "{error}");
    at.write("empty.csv", "");
    let error = refused("check-build disk.toml --frames empty.csv");
    assert!(error.contains("empty.csv"), "{error}");
    let error = refused("check-build disk.toml --frames rest.csv -o report.pdf");
    assert!(error.contains("report.pdf") && error.contains(".html"), "{error}");
    at.write("bare.toml", workplace::DISK.replace("contact_impedance_ohm_m = 0.01\n", ""));
    let error = refused("check-build bare.toml --frames rest.csv");
    assert!(error.contains("contact_impedance"), "{error}");
    let error = refused("check-build disk.toml --frames rest.csv --source tcp:127.0.0.1:9");
    assert!(error.contains("--source"), "{error}");
}

#[test]
fn a_device_is_read_and_checked() {
    let at = Workplace::new();
    let text = at.good("check-build disk.toml --source emulate --twin ideal --take 8 --json");
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((json["sound"].as_bool(), json["frames"].as_u64()), (Some(true), Some(8)), "{text}");
}

#[test]
fn live_reports_the_findings_as_notices() {
    let at = Workplace::new();
    let live = "live disk.toml --source emulate --twin ideal --check-build --serve off --for 6";
    let said = |arguments: &str| String::from_utf8(at.run(arguments).stderr).unwrap();
    let text = said(live);
    assert!(text.contains("the skin is as designed"), "{text}");
    let text = said(&format!("{live} --fault reference:3:0.5@0+60"));
    assert!(text.contains("reference, drive 3") && text.contains("Fix: "), "{text}");
    let error = at.refused("live disk.toml --source replay:none.mcap --check-build");
    assert!(error.contains("check-build"), "{error}");
    let error = at.refused("live disk.toml --source csv:- --difference --check-build");
    assert!(error.contains("'--difference' cannot be used with '--check-build'"), "{error}");
}
