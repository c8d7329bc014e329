//! Folders for a workshop: their files, and what is refused.

use crate::workplace::{DISK, Workplace};
use serde_json::Value;

fn count(at: &Workplace) -> usize {
    std::fs::read_dir(at.folder()).unwrap().count()
}

#[test]
fn a_folder_holds_what_its_manifest_lists_and_is_the_same_each_time() {
    let at = Workplace::new();
    let shown = at.good("fabricate disk.toml -o one");
    for part in ["base.stl", "base to print", "patterns/patches.dxf", "note: the bores of E0, E1"] {
        assert!(shown.contains(part), "{part} in\n{shown}");
    }
    let manifest: Value = serde_json::from_str(&at.good("fabricate disk.toml -o two --json")).unwrap();
    let files = manifest["files"].as_array().unwrap();
    assert!(files.len() > 10);
    for name in files.iter().map(|file| file["path"].as_str().unwrap()).chain(["manifest.json"]) {
        let [one, two] = ["one", "two"].map(|folder| std::fs::read(at.path(folder).join(name)).unwrap());
        assert!(one == two && !one.is_empty(), "{name}");
    }
    assert!(at.refused("fabricate disk.toml -o one").contains("--force"));
    at.good("fabricate disk.toml -o one --force");
    assert_eq!(count(&at), 3);
}

#[test]
fn a_folder_that_cannot_be_written_and_one_with_other_files_are_left_alone() {
    let at = Workplace::new();
    assert!(at.refused("fabricate disk.toml -o no/such/folder").contains("no/such/folder cannot be written"));
    std::fs::create_dir(at.path("mine")).unwrap();
    at.write("mine/letter.txt", "dear");
    assert!(at.refused("fabricate disk.toml -o mine --force").contains("mine exists already"));
    assert_eq!(std::fs::read_to_string(at.path("mine/letter.txt")).unwrap(), "dear");
    assert_eq!(count(&at), 2);
}

#[test]
fn what_no_workshop_can_make_is_an_error_with_its_line() {
    let at = Workplace::empty();
    let line = DISK.lines().count() + 2;
    let cases = [
        ("wall_m = 0.002", "thinner than a bore"),
        ("wall_m = 5", "between 0.0002 and 1 m"),
        ("bore_m = 0.04\nwall_m = 0.05", "meet: they overlap by"),
        ("channel_depth_m = 0.0045", "leave 0.5 mm of the wall"),
        ("flange_m = 0.001", "too short for bores on the edge, which need 2.5 mm"),
        ("patch_pitch_m = 0.2", "do not fit on a body of 100 mm"),
        ("patch_gap_m = 0.01", "nothing is left of patches"),
        ("kerf_m = 0.002", "wider than the gaps"),
        ("seam_theta_rad = 90", "seam_theta_rad is 90, more than one turn: angles are in radians"),
        ("wall_mm = 5", "did you mean `wall_m`?"),
        ("sheet_spread = 20", "sheet_spread is 20: it must be between 0 and 0.33"),
        ("multiplexers = 0", "8 electrodes are more than 0 free inputs of 0"),
        ("inputs = [0, 1]", "2 inputs for 8 electrodes"),
        ("inputs = [0, 1, 2, 3, 4, 5, 6, 3]", "electrodes 3 and 7 are both on input 3"),
        ("inputs = [0, 1, 2, 3, 4, 5, 6, 31]", "electrode 7 is on input 31, which the reference resistor takes"),
        ("multiplexers = 1\ninputs = [0, 1, 2, 3, 4, 5, 6, 32]", "electrode 7 is on input 32, but the last is 31"),
    ];
    for (key, message) in cases {
        at.write("wrong.toml", format!("{DISK}[fabrication]\n{key}\n"));
        let said = at.refused("fabricate wrong.toml -o out");
        assert!(said.contains(message), "{key}: {said}");
        let line = line + key.lines().position(|one| one.starts_with("inputs")).unwrap_or(0);
        assert!(said.contains(&format!("wrong.toml:{line}:")), "{key}: {said}");
        assert_eq!(count(&at), 1, "{key}: something was written");
    }
    // Without the table the same is found, but only where it is made.
    let narrow = DISK
        .replace("diameter_m = 0.1", "diameter_m = 0.006")
        .replace("0.005", "0.001")
        .replace("[mesh]\nmax_edge_m = 0.01\nelectrode_edge_m = 0.0025\n", "");
    at.write("narrow.toml", narrow);
    assert!(at.refused("fabricate narrow.toml -o out").contains("meet"));
    at.good("mesh narrow.toml -o narrow.vtu");
}

#[test]
fn a_coat_that_does_not_settle_and_electrodes_without_an_input_are_refused() {
    let at = Workplace::empty();
    let coat = |ohm: &str| DISK.replace("sheet_resistance_ohm = 1000", &format!("sheet_resistance_ohm = {ohm}"));
    assert_ne!(coat("2000"), DISK);
    at.write("slow.toml", coat("1e8"));
    let said = at.refused("fabricate slow.toml -o out");
    assert!(said.contains("with a sheet resistance of 100000000 ohm per square the reading of slot"), "{said}");
    assert!(said.contains("and the reader waits 10 ms at most"), "{said}");
    let many = DISK.replace("count = 8", "count = 32").replace("length_m = 0.005", "length_m = 0.003");
    at.write("many.toml", format!("{many}[fabrication]\nbore_m = 0.001\nmultiplexers = 1\n"));
    let said = at.refused("fabricate many.toml -o out");
    assert!(said.contains("32 electrodes are more than 31 free inputs of 32"), "{said}");
    assert_eq!(count(&at), 2);
}

#[test]
fn the_scan_table_of_the_folder_is_that_of_the_command() {
    let at = Workplace::empty();
    let inputs = "inputs = [40, 1, 2, 3, 4, 5, 6, 0]";
    at.write("other.toml", format!("{DISK}[fabrication]\n{inputs}\n"));
    at.good("fabricate other.toml -o out");
    at.good("scan-table other.toml -o scan.csv");
    at.good("scan-table other.toml --header -o scan.h");
    for (ours, theirs) in [("scan.csv", "out/tables/scan-table.csv"), ("scan.h", "out/tables/scan_table.h")] {
        assert_eq!(std::fs::read_to_string(at.path(ours)).unwrap(), std::fs::read_to_string(at.path(theirs)).unwrap());
    }
    // Electrode 0 is on input 8 of multiplexer 1.
    let scan = std::fs::read_to_string(at.path("scan.csv")).unwrap();
    assert!(scan.lines().nth(1).unwrap().starts_with("0,0,1,,,,1,8,0,1,0,31,0,31"), "{scan}");
    let parts = std::fs::read_to_string(at.path("out/tables/parts.csv")).unwrap();
    assert!(parts.contains("multiplexer,ADG732 (32 to 1),8,pieces"), "{parts}");
}

#[test]
fn new_designs_can_be_made() {
    let at = Workplace::empty();
    for body in ["cylinder", "disk", "rectangle"] {
        at.good(&format!("new {body}"));
        at.good(&format!("fabricate {body}.toml -o {body}"));
    }
}
