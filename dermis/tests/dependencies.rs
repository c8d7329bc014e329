//! The crates compiled by a program that depends only on the sensing library, and by a robot: sensing, networks,
//! calibrations and the live pipeline with recordings and ROS 2 messages, without page, schemas and training.

use std::collections::BTreeSet;
use std::process::Command;

/// The names and versions of the crates that packages without their default features depend on, themselves included.
fn crates_of(packages: &[&str]) -> BTreeSet<String> {
    let of_package = packages.iter().flat_map(|package| ["--package", package]);
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--locked", "--offline", "--no-default-features", "--edges", "normal", "--prefix", "none"])
        .arg("--no-dedupe")
        .args(of_package)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs these tests, so it can be run");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let listed = String::from_utf8_lossy(&output.stdout);
    let name_and_version = |line: &str| line.split(' ').take(2).collect::<Vec<_>>().join(" ");
    listed.lines().map(str::trim).filter(|line| !line.is_empty()).map(name_and_version).collect()
}

/// Fails where there are more crates than that, or one of these.
fn check(crates: &BTreeSet<String>, most: usize, absent: &[&str]) {
    let names: BTreeSet<&str> = crates.iter().filter_map(|line| line.split(' ').next()).collect();
    assert!(names.contains("dermis") && names.contains("faer"), "no tree of dermis: {crates:?}");
    assert!(crates.len() <= most, "{} crates, at most {most} are allowed: {crates:#?}", crates.len());
    for absent in absent {
        assert!(!names.contains(absent), "a dependency on `{absent}`; `cargo tree -i {absent}` says through what");
    }
}

#[test]
fn sensing_alone_needs_few_crates() {
    // Servers, recordings, archives, command lines and plots belong to other crates, or are behind a feature.
    check(&crates_of(&["dermis"]), 90, &["axum", "clap", "mcap", "resvg", "tokio", "zip"]);
}

#[test]
fn a_robot_needs_neither_simulator_nor_trainer_nor_firmware() {
    let crates = crates_of(&["dermis-learn", "dermis-live"]);
    let external = crates.iter().filter(|name| !name.starts_with("dermis")).count();
    println!("{external} external crates");
    assert!(external <= 120, "{external} external crates: {crates:#?}");
    check(&crates, 130, &["axum", "clap", "dermis-emulate", "dermis-firmware", "dermis-sim", "tokio", "zip"]);
}
