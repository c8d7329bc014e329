//! `dermis calibrate` and what its folder gives: evaluations press by press, their pictures, contacts in a robot's
//! frame.

use crate::workplace::{DISK, Workplace};
use std::fmt::Write;

const PRESSES: usize = 60;
const INPUT: &str = "disk.toml --frames frames.csv --baseline rest.csv";

/// Places on a spiral by the golden angle, in an order that leaps, m.
fn place(press: usize) -> [f64; 2] {
    let number = (press * 37) % PRESSES;
    let (radius_m, angle) = (0.042 * ((number as f64 + 0.5) / PRESSES as f64).sqrt(), number as f64 * 2.399_963);
    [radius_m * angle.cos(), radius_m * angle.sin()]
}

/// A folder with `disk.toml`, `rest.csv`, `frames.csv` with a press of 2 N in each row, and `touches.csv`.
fn recorded() -> Workplace {
    let at = Workplace::new();
    let mut touches = String::from("frame,x_m,y_m,force_n\n");
    for press in 0..PRESSES {
        let [x, y] = place(press);
        let _ = writeln!(touches, "{press},{x:.6},{y:.6},2");
    }
    at.write("touches.csv", touches);
    at.good("forward disk.toml -o rest.csv");
    at.good("forward disk.toml --touches touches.csv -o frames.csv");
    at
}

/// The header and the rows of a CSV file.
fn table(at: &Workplace, name: &str) -> (String, Vec<Vec<Option<f64>>>) {
    let text = std::fs::read_to_string(at.path(name)).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let row = |line: &str| line.split(',').map(|field| field.parse().ok()).collect();
    (header.to_string(), rows.lines().map(row).collect())
}

const HEADER: &str = "frame,true_x_m,true_y_m,true_z_m,x_m,y_m,z_m,error_m,sd_m,confidence,true_force_n,force_n,force_sd_n,\
    misfit,unlike,true_theta_rad,theta_rad";

#[test]
fn every_method_is_evaluated_press_by_press() {
    let at = recorded();
    let text = at.good(&format!("calibrate {INPUT} --truth touches.csv --labels 0..40 --method forward-map -o map"));
    assert!(text.contains("not used: their standard deviation is below 5 %"), "{text}");
    let corrected =
        at.json(&format!("calibrate {INPUT} --truth touches.csv --labels 0..40 --method noser -o noser --json"));
    let unused = "their standard deviation is below 5 %";
    assert_eq!((&corrected["method"], &corrected["unused_forces"]), (&"noser".into(), &unused.into()));
    assert!(corrected["quality"]["found"].as_u64().unwrap() >= 30, "{corrected}");
    for method in ["noser", "./noser", "./map"] {
        let run = format!("evaluate {INPUT} --truth touches.csv --method {method} --rows 40..60");
        let score = at.json(&format!("{run} -o report.csv --picture errors.svg --json"));
        assert_eq!(score["presses"], 20, "{method}");
        let (header, rows) = table(&at, "report.csv");
        assert_eq!((&header[..], rows.len()), (HEADER, 20), "{method}");
        assert!(rows.iter().enumerate().all(|(k, row)| row[0] == Some(40.0 + k as f64) && row.len() == 17), "{method}");
        let found: Vec<f64> = rows.iter().filter_map(|row| row[7]).collect();
        let mean_m = found.iter().sum::<f64>() / found.len() as f64;
        assert!((mean_m - score["localisation_m"]["mean"].as_f64().unwrap()).abs() < 1e-9, "{method}: {mean_m}");
        for row in rows.iter().filter(|row| row[7].is_some()) {
            let [x, y, u, v] = [1, 2, 4, 5].map(|column| row[column].unwrap());
            assert!(((x - u).hypot(y - v) - row[7].unwrap()).abs() < 1e-6, "{method}");
            let [true_x, true_y] = place(row[0].unwrap() as usize);
            assert!((x - true_x).hypot(y - true_y) < 1e-6, "{method}");
            assert_eq!((row[10], row[15]), (Some(2.0), None), "a force, and no angle on a disk");
            assert_eq!(row[13].is_some(), method == "./map", "only forward maps have a misfit");
        }
        let picture = std::fs::read_to_string(at.path("errors.svg")).unwrap();
        let texts = ["disk: errors of 20 presses", "error (mm)", "fraction of presses", "95th percentile", "electrode"];
        texts.iter().for_each(|text| assert!(picture.contains(text), "{method}: {text}"));
    }
    let report = std::fs::read_to_string(at.path("report.csv")).unwrap();
    assert!(report.lines().skip(1).all(|row| ["0", "1"].contains(&row.split(',').nth(14).unwrap())), "{report}");
    // Equal forces teach nothing of others.
    at.good(&format!("evaluate {INPUT} --truth touches.csv --method ./noser -o report.csv"));
    let (_, rows) = table(&at, "report.csv");
    assert_eq!(rows.iter().filter_map(|row| row[11]).count(), 0);
}

/// The network of the paper's skin, corrected with presses on its model.
#[test]
fn the_best_network_is_corrected() {
    let at = Workplace::empty();
    let mut touches = String::from("frame,z_m,theta_rad,force_n\n");
    for press in 0..32 {
        let (z_m, theta_rad) = (0.01 + 0.28 * f64::from(press * 7 % 32) / 31.0, 0.2 + 2.4 * f64::from(press) % 6.0);
        let _ = writeln!(touches, "{press},{z_m:.5},{theta_rad:.5},{}", 1 + press % 3);
    }
    at.write("touches.csv", touches);
    at.good("forward cylinder30 -o rest.npy");
    at.good("forward cylinder30 --touches touches.csv -o frames.npy");
    let input = "cylinder30 --frames frames.npy --baseline rest.npy --truth touches.csv";
    let json = at.json(&format!("calibrate {input} --labels 0..24 --method spots -o corrected --json"));
    assert_eq!((&json["method"], json["quality"]["labels"].as_u64()), (&"spots".into(), Some(24)), "{json}");
    let score = at.json(&format!("evaluate {input} --method ./corrected --rows 24..32 -o report.csv --json"));
    assert!(score["localisation_m"]["mean"].as_f64().unwrap() < 0.004, "{score}");
    let (_, rows) = table(&at, "report.csv");
    let off = |row: &Vec<Option<f64>>| (row[15].unwrap() - row[16].unwrap()).abs();
    assert!(rows.len() == 8 && rows.iter().all(|row| off(row) < 0.2 && row[11].is_some()), "{rows:?}");
}

#[test]
fn a_missed_press_has_no_estimate() {
    let at = recorded();
    let rest = std::fs::read_to_string(at.path("rest.csv")).unwrap();
    let frames = std::fs::read_to_string(at.path("frames.csv")).unwrap();
    at.write("frames.csv", [rest.trim(), frames.trim()].join("\n"));
    at.write("one.csv", "frame,x_m,y_m\n0,0.01,0.02\n60,0.01,0.02\n");
    at.good(&format!("evaluate {INPUT} --truth one.csv --rows 0 --method noser -o report.csv --picture errors.png"));
    let (_, rows) = table(&at, "report.csv");
    assert_eq!(rows, [[vec![Some(0.0), Some(0.01), Some(0.02), Some(0.0)], vec![None; 13]].concat()]);
    let png = std::fs::read(at.path("errors.png")).unwrap();
    assert_eq!(&png[1..4], b"PNG");
}

#[test]
fn labels_that_help_are_suggested() {
    let at = recorded();
    let calibrate = format!("calibrate {INPUT} --truth touches.csv --labels 0..32 --method forward-map");
    let outlook = &at.json(&format!("{calibrate} --suggest 3 -o map --json"))["outlook"];
    let suggested = outlook["suggested_m"].as_array().unwrap();
    let radius_m = |place: &serde_json::Value| place[0].as_f64().unwrap().hypot(place[1].as_f64().unwrap());
    assert!(suggested.len() == 3 && suggested.iter().all(|place| radius_m(place) < 0.051), "{outlook}");
    let labels: Vec<u64> =
        outlook["learning_curve"].as_array().unwrap().iter().map(|p| p["labels"].as_u64().unwrap()).collect();
    assert_eq!(labels, [8, 16, 32]);
    let text = at.good(&format!("{calibrate} --suggest 2 -o map"));
    assert!(text.contains("press next: x, mm") && text.contains("64 (expected)"), "{text}");
}

#[test]
fn wrong_options_of_a_calibration_are_named() {
    let at = recorded();
    let calibrate = format!("calibrate {INPUT} --truth touches.csv -o map");
    let neither = at.refused("calibrate disk.toml --frames frames.csv --truth touches.csv -o map");
    assert!(neither.contains("--baseline") && neither.contains("--difference"), "{neither}");
    let refused = |arguments: &str| at.refused(&format!("{calibrate} {arguments}"));
    assert!(refused("--suggest 0").contains("--suggest"));
    assert!(refused("--suggest few").contains("--suggest"));
    assert!(refused("--labels 0..90").contains("--labels"));
    assert!(refused("--labels 5..5").contains("--labels"));
    assert!(refused("--labels 0..5").contains("5 labelled presses"));
    for method in ["spots", "forwardmap", "./no-such-folder"] {
        let refused = refused(&format!("--method {method}"));
        assert!(refused.contains(&format!("--method {method}: ")) && refused.contains("forward-map"), "{refused}");
    }
    let suggest = refused("--method noser --suggest 3");
    assert!(suggest.contains("--suggest") && suggest.contains("--method forward-map"), "{suggest}");
    assert!(!at.path("map").exists(), "nothing is written");
    let evaluate = format!("evaluate {INPUT} --truth touches.csv --method noser");
    let refused = |arguments: &str| at.refused(&format!("{evaluate} {arguments}"));
    assert!(refused("--rows 50..70").contains("--rows"));
    assert!(refused("--rows last").contains("--rows"));
    assert!(refused("-o report.xlsx").contains("--output report.xlsx"));
    assert!(refused("--picture errors.pdf").contains("errors.pdf"));
    assert!(refused("-o no/such/report.csv").contains("no/such/report.csv"));
    assert!(refused("--coordinates robot").contains("--coordinates"));
}

#[test]
fn labels_of_a_robot_give_contacts_in_its_frame() {
    let at = recorded();
    // The skin at (0.2, -0.1, 0.05) m, turned by 0.5 rad, seen mirrored.
    let (sin, cos) = 0.5_f64.sin_cos();
    let robot = |[x, y]: [f64; 2]| [0.2 + cos * x + sin * y, -0.1 + sin * x - cos * y, 0.05];
    let rows: Vec<String> =
        (0..PRESSES).map(|press| robot(place(press)).map(|value| format!("{value:.6}")).join(",")).collect();
    at.write("robot.csv", rows.join("\n") + "\n");
    at.good(&format!("calibrate {INPUT} --truth robot.csv -o map"));
    let position = |name: &str, row: usize| {
        let row = &table(&at, name).1[row];
        ([2, 3, 4].map(|column| row[column].unwrap()), [5, 6, 7].map(|column| row[column].unwrap()))
    };
    for (coordinates, name) in [("robot", "robot_contacts.csv"), ("skin", "skin_contacts.csv")] {
        at.good(&format!("contacts {INPUT} --method ./map --coordinates {coordinates} -o {name}"));
        let (_, rows) = table(&at, name);
        assert_eq!(rows.len(), PRESSES);
    }
    for press in [3, 20, 41] {
        let ([x, y, z], normal) = position("robot_contacts.csv", press);
        let [true_x, true_y, _] = robot(place(press));
        assert!((x - true_x).hypot(y - true_y) < 0.004 && (z - 0.05).abs() < 1e-6, "{press}: {x} {y} {z}");
        assert!((normal[2] - 1.0).abs() < 1e-12, "{normal:?}");
        let ([x, y, z], _) = position("skin_contacts.csv", press);
        let [true_x, true_y] = place(press);
        assert!((x - true_x).hypot(y - true_y) < 0.006 && z == 0.0, "{press}: {x} {y} {z}");
    }
    at.good(&format!("contacts {INPUT} --method ./map --coordinates robot -o contacts.jsonl"));
    let refused = at.refused(&format!("contacts {INPUT} --method noser --coordinates robot -o a.csv"));
    assert!(refused.contains("--coordinates robot") && !at.path("a.csv").exists(), "{refused}");
    // Presses in the robot's frame are evaluated there, by the calibration and by alignment.
    let run = format!("evaluate {INPUT} --truth robot.csv");
    for how in ["--method ./map --rows 40..60", "--align 40"] {
        at.good(&format!("{run} {how} -o report.csv --picture errors.svg"));
        let (header, rows) = table(&at, "report.csv");
        assert_eq!((&header[..], rows.len(), rows[0][0]), (HEADER, 20, Some(40.0)));
        let [x, y] = [1, 2].map(|column| rows[0][column].unwrap());
        assert!((x - robot(place(40))[0]).hypot(y - robot(place(40))[1]) < 1e-5);
        assert!(rows.iter().all(|row| row[7].unwrap() < 0.02), "{how}");
    }
    assert!(at.refused(&format!("{run} --align 20 --draws 3 -o report.csv")).contains("--output"));
}

#[test]
fn reversed_axes_are_named_before_a_fit() {
    let at = recorded();
    let mirrored: String = (0..PRESSES)
        .map(|press| {
            let [x, y] = place(press);
            format!("{press},{x:.6},{:.6}\n", -y)
        })
        .collect();
    at.write("mirrored.csv", format!("frame,x_m,y_m\n{mirrored}"));
    let text = at.good(&format!("check-frames {INPUT} --truth mirrored.csv"));
    assert!(
        text.contains("1 fault") && text.contains("truth_axes") && text.contains("write -y_m in place of y_m"),
        "{text}"
    );
    let output = at.run(&format!("calibrate {INPUT} --truth mirrored.csv --method forward-map -o map"));
    let warning = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && warning.contains("write -y_m in place of y_m"), "{warning}");
    assert!(at.good(&format!("check-frames {INPUT} --truth touches.csv")).contains("no findings"));
}

#[test]
fn a_design_reads_a_scan_table() {
    let at = recorded();
    at.good("scan-table disk.toml -o scan.csv");
    at.write("table.toml", DISK.replace("pattern = \"adjacent_undriven\"", "pattern.table = \"scan.csv\""));
    at.good("forward table.toml -o table_rest.csv");
    assert_eq!(std::fs::read(at.path("table_rest.csv")).unwrap(), std::fs::read(at.path("rest.csv")).unwrap());
    let scan = std::fs::read_to_string(at.path("scan.csv")).unwrap();
    at.write("scan.csv", scan.replacen("\n3,", "\n4,", 1));
    assert!(at.refused("forward table.toml -o b.csv").contains("scan.csv, line 5: slot 4, but 3 comes next"));
}
