//! `dermis bound`, as scripts use it.

use crate::workplace::{DISK, Workplace};

#[test]
fn the_bounds_of_a_skin_are_told_in_a_table_and_in_files() {
    let at = Workplace::new();
    let files =
        "-o bounds.csv --map map.svg --force-map force.svg --separation-map far.svg --separation-curve curve.svg";
    let text = at.good(&format!("bound disk.toml --twin ideal --noise 60 --json {files}"));
    let told: serde_json::Value = serde_json::from_str(&text).unwrap();
    let [one, mean] = [0, 1].map(|index| &told["bounds"][index]);
    assert_eq!((&one["frames"], &mean["frames"]), (&1.into(), &12.into()), "120 frames a second, 0.1 s");
    // Nothing drifts on `ideal`: the noise of the mean of twelve frames is smaller by the root of 12.
    let ratio = one["sd_m"]["mean"].as_f64().unwrap() / mean["sd_m"]["mean"].as_f64().unwrap();
    assert!((ratio / 12f64.sqrt() - 1.0).abs() < 0.05, "{ratio}");
    let places = one["places"].as_array().unwrap();
    let table = std::fs::read_to_string(at.path("bounds.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + places.len());
    let first = table.lines().nth(1).unwrap();
    assert_eq!(first.split(',').nth(3).unwrap().parse::<f64>().unwrap(), places[0]["sd_m"].as_f64().unwrap());
    for picture in ["map.svg", "force.svg", "far.svg", "curve.svg"] {
        assert!(std::fs::read_to_string(at.path(picture)).unwrap().starts_with("<svg"), "{picture}");
    }
    let text = at.good("bound disk.toml --twin ideal --noise 60 --separation-step 20");
    assert!(text.contains("position, standard deviation (mm)"), "{text}");
}

#[test]
fn more_noise_makes_every_bound_worse() {
    let at = Workplace::new();
    let of = |noise: &str| -> serde_json::Value {
        serde_json::from_str(&at.good(&format!("bound disk.toml --noise {noise} --separation-step 20 --json"))).unwrap()
    };
    let (quiet, loud) = (of("70"), of("50"));
    for key in ["sd_m", "smallest_force_n", "separation_m"] {
        let [a, b] = [&quiet, &loud].map(|told| told["bounds"][0][key]["median"].as_f64().unwrap());
        assert!(a < b, "{key}: {a} {b}");
    }
}

#[test]
fn a_disconnected_electrode_makes_every_bound_worse() {
    let at = Workplace::new();
    let of = |without: &str| -> serde_json::Value {
        let told = at.good(&format!("bound disk.toml --noise 60 --separation-step 0 --json {without}"));
        serde_json::from_str(&told).unwrap()
    };
    let (all, fewer) = (of(""), of("--without-electrode 3"));
    for key in ["sd_m", "smallest_force_n"] {
        let at = |told: &serde_json::Value, place: usize| told["bounds"][0]["places"][place][key].as_f64().unwrap();
        let worse = |place: usize| at(&fewer, place) >= at(&all, place) * (1.0 - 1e-9);
        let places = all["bounds"][0]["places"].as_array().unwrap().len();
        assert!((0..places).all(worse) && (0..places).any(|place| at(&fewer, place) > 1.5 * at(&all, place)), "{key}");
    }
    let error = at.refused("bound disk.toml --without-electrode 8");
    assert!(error.contains("no electrode 8") && error.contains("0 to 7"), "{error}");
    let five = "--without-electrode ".to_string() + &["0", "1", "2", "3", "4"].join(" --without-electrode ");
    let error = at.refused(&format!("bound disk.toml {five}"));
    assert!(error.contains("no value is left"), "{error}");
}

#[test]
fn bounds_that_do_not_exist_are_refused() {
    let at = Workplace::new();
    let rows = "channel,drive_source,drive_sink,measure_plus,measure_minus\n0,0,1,2,3\n1,0,1,4,5\n";
    at.write("two.csv", rows);
    at.write("two.toml", DISK.replace("pattern = \"adjacent_undriven\"", "pattern.table = \"two.csv\""));
    let message = at.refused("bound two.toml --separation-step 0");
    assert!(message.contains("does not tell the place") && message.contains("2 values"), "{message}");
    assert!(at.refused("bound disk.toml --coat-drift 0.01").contains("--contact-drift"));
    assert!(at.refused("bound disk.toml --separation-step 0 --separation-map a.svg").contains("--separation-map"));
    assert!(at.refused("bound disk.toml --force 900").contains("foam"));
    assert!(at.refused("bound disk.toml --twin ideal").contains("without noise every bound is zero"));
    assert!(at.refused("bound disk.toml --twin nosuch").contains("nosuch"));
}
