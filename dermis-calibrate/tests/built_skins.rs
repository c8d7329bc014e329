//! How often the check of a built skin is right, on digital twins with one fault each.
//!
//! `cargo test --release -p dermis-calibrate --test built_skins -- --ignored --nocapture` prints the tables of
//! `docs/check-build.md`. The limits of the method were set on other seeds, 6001 to 6040.

mod built;

use built::{KINDS, checked, is_right};
use dermis::skin::Skin;
use dermis_calibrate::build::BuildChecker;

#[test]
#[ignore = "debugging"]
fn debug() {
    let text = std::env::var("CASES").unwrap();
    let parts: Vec<&str> = text.split(',').collect();
    let skin = Skin::load("cylinder30").unwrap();
    let start = std::time::Instant::now();
    let checker = BuildChecker::new(&skin).unwrap();
    println!("prepared in {:?}", start.elapsed());
    let (from, to): (u64, u64) = (parts[2].parse().unwrap(), parts[3].parse().unwrap());
    for kind in KINDS.iter().filter(|kind| parts[1] == "all" || parts[1] == **kind) {
        for seed in from..to {
            let start = std::time::Instant::now();
            let (case, frames) = built::frames(parts[0], skin.design(), kind, seed);
            let made = start.elapsed();
            let check = checker.check(&frames).unwrap();
            println!(
                "{kind} {seed} {} sound {:.2} misfit {:.2} r {:.2} u {:.3} {:?} {:.0?} made {made:.1?} total {:.1?} {}",
                if is_right(&case, &skin, &check) { "ok" } else { "WRONG" },
                check.sound_misfit, check.misfit, check.resistance_factor, check.unevenness,
                check.findings.iter().map(|f| f.kind.as_str()).collect::<Vec<_>>(),
                check.findings.iter().map(|f| f.value).collect::<Vec<_>>(), start.elapsed(),
                if is_right(&case, &skin, &check) { String::new() } else { format!("{:?} {:?} {:?}", case.cut_m, case.faults, check.faults) },
            );
        }
    }
    let _ = checked;
}
