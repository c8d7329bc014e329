//! How often the check of a built skin is right, on digital twins with one fault each.
//!
//! `cargo test --release -p dermis-calibrate --test integration built_skins:: -- --ignored --nocapture` prints the tables of
//! `docs/check-build.md`. The limits of the method were set on other seeds, 6001 to 6040.

use crate::built::{KINDS, checked, is_right};
use dermis::skin::Skin;
use dermis_calibrate::build::BuildChecker;
use rayon::prelude::*;

/// First seed of the tables, of each twin.
const SEEDS: [(&str, u64); 2] = [("lab", 18001), ("harsh", 18001)];
/// Skins with each fault. `DERMIS_BUILT_SKINS` sets another number.
const FAULTY: u64 = 40;
/// Sound skins for each of these.
const SOUND: u64 = 5;

fn is_sound(kind: &str) -> bool {
    ["sound", "varied"].contains(&kind)
}

fn faulty() -> u64 {
    std::env::var("DERMIS_BUILT_SKINS").ok().and_then(|text| text.parse().ok()).unwrap_or(FAULTY)
}

/// The skins of each kind that are right, of those checked; prints each row, and the skins that are not right.
fn score(twin: &str, first: u64, [faulty, sound]: [u64; 2]) -> Vec<(&'static str, usize, u64)> {
    let skin = Skin::load("cylinder30").unwrap();
    let checker = BuildChecker::new(&skin).unwrap();
    let of_kind = |kind: &'static str| {
        let count = if is_sound(kind) { sound } else { faulty };
        let right = (first..first + count).into_par_iter().filter(|&seed| {
            let (case, check) = checked(&checker, &skin, twin, kind, seed);
            let right = is_right(&case, &skin, &check);
            if !right {
                eprintln!(
                    "{twin} {kind} {seed}: {:?} found {:?}, misfit {:.2}, {:?}",
                    case.faults,
                    check.faults,
                    check.misfit,
                    check.findings.iter().map(|found| found.kind).collect::<Vec<_>>()
                );
            }
            right
        });
        let right = right.count();
        println!("| {twin} | {kind} | {right} | {count} |");
        (kind, right, count)
    };
    // Sound skins last: they are the most.
    KINDS.into_iter().rev().map(of_kind).collect()
}

#[test]
#[ignore = "slow: half an hour, 800 twins"]
fn faults_of_twins_are_named_with_their_places() {
    println!("| twin | kind | right | of |\n|---|---|---|---|");
    let mut short = Vec::new();
    for (twin, first) in SEEDS {
        let table = score(twin, first, [faulty(), SOUND * faulty()]);
        let (sound, faulty): (Vec<_>, Vec<_>) = table.into_iter().partition(|(kind, ..)| is_sound(kind));
        let right: usize = faulty.iter().map(|(_, right, _)| right).sum();
        let of: u64 = faulty.iter().map(|(.., of)| of).sum();
        // A skin that a builder has varied is harder than one of small tolerances.
        let most = |kind: &str| if kind == "sound" { 1 } else { 2 };
        let is_false = |&(kind, silent, of): &(&str, usize, u64)| 100 * (of - silent as u64) > most(kind) * of;
        if 100 * (right as u64) < 95 * of || sound.iter().any(is_false) {
            short.push(format!("{twin}: {right} of {of} faults are right, sound skins: {sound:?}"));
        }
    }
    assert!(short.is_empty(), "{short:?}");
}

/// One skin of each kind, in every run of the tests.
#[test]
fn one_twin_of_each_kind() {
    for (kind, right, of) in score("lab", 6001, [1, 1]) {
        assert_eq!(right as u64, of, "{kind}");
    }
}
