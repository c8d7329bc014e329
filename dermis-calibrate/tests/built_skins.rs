//! How often the check of a built skin is right, on digital twins with one fault each.

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
                "{kind} {seed} {} sound {:.2} misfit {:.2} gains {:.0?} {:?} made {made:.1?} total {:.1?} {}",
                if is_right(&case, &skin, &check) { "ok" } else { "WRONG" },
                check.sound_misfit, check.misfit, check.gains, check.faults, start.elapsed(),
                if is_right(&case, &skin, &check) { String::new() } else { format!("{:?} {:?}", case.cut_m, case.faults) },
            );
        }
    }
    let _ = checked;
}
