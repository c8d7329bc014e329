//! The check of a built skin by amplitudes, as instruments without signs give them, and by the same values with signs.

use crate::built::{checked, is_right};
use dermis::design::SkinDesign;
use dermis::skin::Skin;
use dermis_calibrate::build::BuildChecker;
use rayon::prelude::*;

/// The limits of the method were set on other skins.
const FIRST: u64 = 19001;
/// Kinds of twins, and how many of each.
type Kinds = [(&'static str, u64); 4];
const FEW: Kinds = [("sound", 4), ("open", 1), ("exchanged", 1), ("short", 1)];
const MANY: Kinds = [("sound", 20), ("open", 10), ("exchanged", 10), ("short", 10)];

/// The twins of each kind that are right.
fn score(design: SkinDesign, kinds: Kinds) -> Vec<(&'static str, usize)> {
    let skin = Skin::new(design).unwrap();
    let checker = BuildChecker::new(&skin).unwrap();
    let of_kind = |(kind, count): (&'static str, u64)| {
        let right = (FIRST..FIRST + count).into_par_iter().filter(|&seed| {
            let (case, check) = checked(&checker, &skin, "lab", kind, seed);
            let right = is_right(&case, &skin, &check);
            if !right {
                let findings: Vec<_> = check.findings.iter().map(|found| (found.kind, &found.evidence)).collect();
                let [sound, found] = [check.sound_misfit, check.misfit];
                println!("{kind} {seed}: {:?}: misfit {sound:.2}, {found:.2}, {findings:?}", case.faults);
            }
            right
        });
        let right = right.count();
        println!("{kind}: {right} of {count}");
        (kind, right)
    };
    kinds.map(of_kind).to_vec()
}

fn faults_are_told(kinds: Kinds) {
    let amplitudes = SkinDesign::shipped("skin16").unwrap();
    assert!(amplitudes.protocol.amplitude_only());
    let mut signed = amplitudes.clone();
    signed.protocol = signed.protocol.with_amplitude_only(false);
    for (name, design) in [("amplitudes", amplitudes), ("signed", signed)] {
        let right = score(design, kinds);
        println!("{name}: {right:?}");
        for ((kind, count), (_, right)) in kinds.into_iter().zip(right) {
            assert_eq!(right as u64, count, "{name}, {kind}");
        }
    }
}

#[test]
fn amplitudes_of_skin16_tell_its_faults() {
    faults_are_told(FEW);
}

#[test]
#[ignore = "slow: some minutes"]
fn amplitudes_of_fifty_skins_tell_their_faults() {
    faults_are_told(MANY);
}
