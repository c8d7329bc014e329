//! The crates compiled by a program that depends only on the sensing library.

use std::collections::BTreeSet;
use std::process::Command;

/// The crates of `cargo tree -p dermis -e normal --prefix none --no-dedupe | sort -u`, `dermis` included.
const MOST_CRATES: usize = 90;

/// Servers, recordings, archives, command lines and plots belong to other crates, or are behind a feature.
const ABSENT: &[&str] = &["axum", "clap", "mcap", "resvg", "tokio", "zip"];

#[test]
fn sensing_alone_needs_few_crates() {
    let tree = ["tree", "--locked", "--offline", "--package", "dermis", "--edges", "normal", "--prefix", "none"];
    let output = Command::new(env!("CARGO"))
        .args(tree)
        .arg("--no-dedupe")
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs these tests, so it can be run");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let listed = String::from_utf8_lossy(&output.stdout);
    let crates: BTreeSet<&str> = listed.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    let names: BTreeSet<&str> = crates.iter().filter_map(|line| line.split(' ').next()).collect();
    assert!(names.contains("dermis") && names.contains("faer"), "no tree of dermis: {listed}");
    assert!(crates.len() <= MOST_CRATES, "{} crates, at most {MOST_CRATES} are allowed:\n{listed}", crates.len());
    for absent in ABSENT {
        assert!(
            !names.contains(absent),
            "`dermis` alone depends on `{absent}`; `cargo tree -i {absent}` says through what"
        );
    }
}
