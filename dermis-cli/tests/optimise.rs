//! `dermis optimise`, as scripts use it.

use crate::workplace::{DISK, Workplace};
use dermis::design::SkinDesign;

/// Discs on a disk, which may go anywhere.
fn discs() -> String {
    let positions = "layout.positions = [{ x_m = 0.03, y_m = 0 }, { x_m = 0.02, y_m = 0.02 }, { x_m = 0, y_m = 0.03 }, \
                     { x_m = -0.02, y_m = 0.02 }, { x_m = -0.03, y_m = 0 }, { x_m = -0.02, y_m = -0.02 }, \
                     { x_m = 0, y_m = -0.03 }, { x_m = 0.02, y_m = -0.02 }]";
    DISK.replace("layout.rim.count = 8", positions)
        .replace("shape.arc.length_m = 0.005", "shape.disc.radius_m = 0.003")
        .replace("contact_impedance_ohm_m = 0.01", "contact_impedance_ohm_m2 = 2e-5")
}

const QUICK: &str = "--twin ideal --noise 60 --moves 4 --starts 2 --rounds 1";

#[test]
fn a_better_design_is_written_with_its_bounds() {
    let at = Workplace::new();
    at.write("discs.toml", discs());
    let files = "--counts 6 --curve curve.csv --map new.svg --given-map old.svg";
    let command = format!("optimise discs.toml {QUICK} -o better.toml --state state.json {files} --json");
    let told = at.json(&command);
    let [given, new] = ["given", "optimised"].map(|key| told[key]["worst_m"].as_f64().unwrap());
    assert!(new < given, "{given} {new}: the edge of the disk is far from the electrodes");
    let path = at.path("better.toml");
    let design = SkinDesign::load(path.to_str().unwrap()).unwrap();
    assert_eq!((design.name.as_str(), design.electrodes.len()), ("better", 8));
    assert_eq!(at.json("bound better.toml --twin ideal --noise 60 --separation-step 0 --json")["design"], "better");
    let curve = std::fs::read_to_string(at.path("curve.csv")).unwrap();
    let rows: Vec<&str> = curve.lines().collect();
    assert!(rows.len() == 3 && rows[1].starts_with("6,") && rows[2].starts_with("8,"), "{curve}");
    for picture in ["new.svg", "old.svg"] {
        assert!(std::fs::read_to_string(at.path(picture)).unwrap().starts_with("<svg"), "{picture}");
    }
    // All starts are in the state: the same command finds the same, and writes no start again.
    let state = std::fs::read(at.path("state.json")).unwrap();
    assert_eq!(at.json(&command), told);
    assert_eq!(std::fs::read(at.path("state.json")).unwrap(), state);
    let other = at.refused(&command.replace("--noise 60", "--noise 50"));
    assert!(other.contains("state.json") && other.contains("another design"), "{other}");
}

/// Ten moves cannot improve a layout that a search has found.
#[test]
fn a_layout_that_is_not_improved_is_kept() {
    let at = Workplace::new();
    at.write("discs.toml", discs());
    at.good("optimise discs.toml --twin ideal --noise 60 --moves 60 --starts 1 --rounds 3 -o good.toml");
    let again = "optimise good.toml --twin ideal --noise 60 --moves 1 --starts 1 --rounds 0 -o kept.toml";
    let told = at.json(&format!("{again} --json"));
    assert_eq!((&told["given_kept"], &told["optimised"]["worst_m"]), (&true.into(), &told["given"]["worst_m"]));
    assert!(at.good(again).contains("No better layout was found"));
    // A zone about an electrode forbids the given layout.
    let electrode = SkinDesign::load(at.path("good.toml").to_str().unwrap()).unwrap().electrodes[0].centre_m;
    let zone = format!("{},{},0,0.002", electrode[0], electrode[1]);
    assert_eq!(at.json(&format!("{again} --forbid {zone} --json"))["given_kept"], false);
}

#[test]
fn readings_are_chosen_for_the_given_electrodes() {
    let at = Workplace::new();
    at.write("discs.toml", discs());
    let command = "optimise discs.toml --keep-electrodes --twin ideal --noise 60 --slots 28,48 -o part.toml --json";
    let told = at.json(&format!("{command} --slots-curve curve.svg"));
    let mean = |index: usize| told["readings"][index]["mean_m"].as_f64().unwrap();
    assert!(mean(0) > mean(1), "48 readings are all there are: 40 values and 8 currents");
    assert_eq!(told["optimised"]["mean_m"], told["readings"][0]["mean_m"]);
    let table = std::fs::read_to_string(at.path("part-pattern.csv")).unwrap();
    assert!(table.lines().count() < 28, "{table}");
    at.good("scan-table part.toml");
    assert!(std::fs::read_to_string(at.path("curve.svg")).unwrap().starts_with("<svg"));
}

#[test]
fn what_cannot_be_optimised_is_refused() {
    let at = Workplace::new();
    at.write("discs.toml", discs());
    let refused = |options: &str| at.refused(&format!("optimise discs.toml {QUICK} -o new.toml {options}"));
    let told = refused("--electrodes 40 --least-distance 0.04");
    assert!(told.contains("of 40 electrodes fit") && told.contains("0.04 m apart"), "{told}");
    assert!(refused("--forbid 0,0,0,0.2").contains("no place is left"));
    assert!(refused("--forbid 0,0,0").contains("four numbers"));
    assert!(refused("--least-distance 0.004").contains("overlap"));
    assert!(refused("--slots 4").contains("4 readings are fewer than the unknowns"));
    assert!(refused("--counts 6 --curve curve.txt").contains("curve.txt"));
    let quiet = at.refused("optimise discs.toml --twin ideal -o new.toml");
    assert!(quiet.contains("without noise every bound is zero"), "{quiet}");
    at.write("state.json", "{}");
    assert!(refused("--state state.json").contains("no state of a search"));
    // A body of 1 m whose places for electrodes all lie at one end: no current flows at the other.
    let long =
        DISK.replace("[body.disk]\ndiameter_m = 0.1", "[body.rectangle]\nwidth_m = 1.0\nheight_m = 0.05").replace(
            "layout.rim.count = 8",
            "layout.positions = [{ x_m = 0, y_m = 0.025 }, { x_m = 0.03, y_m = 0 }, \
                 { x_m = 0.06, y_m = 0 }, { x_m = 0.06, y_m = 0.05 }, { x_m = 0.03, y_m = 0.05 }]",
        );
    at.write("long.toml", long);
    let told = at.refused(&format!("optimise long.toml {QUICK} -o new.toml --forbid 0.6,0,0,0.5"));
    assert!(told.contains("no bound exists"), "{told}");
    assert!(!at.path("new.toml").exists());
}
