//! The check of a built skin by amplitudes, as instruments without signs give them, and by the same values with signs.

use crate::built::{checked, is_right};
use dermis::design::SkinDesign;
use dermis::skin::Skin;
use dermis_calibrate::build::BuildChecker;
use rayon::prelude::*;

/// The limits of the method were set on other skins.
const FIRST: u64 = 19001;
/// Twins of each kind.
const KINDS: [(&str, u64); 4] = [("sound", 20), ("open", 4), ("exchanged", 4), ("short", 4)];

/// The twins of each kind that are right.
fn score(design: SkinDesign) -> Vec<(&'static str, usize)> {
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
    KINDS.map(of_kind).to_vec()
}

#[test]
fn amplitudes_of_skin16_tell_its_faults() {
    let amplitudes = SkinDesign::shipped("skin16").unwrap();
    assert!(amplitudes.protocol.amplitude_only());
    let mut signed = amplitudes.clone();
    signed.protocol = signed.protocol.with_amplitude_only(false);
    for (name, design) in [("amplitudes", amplitudes), ("signed", signed)] {
        let right = score(design);
        println!("{name}: {right:?}");
        for ((kind, count), (_, right)) in KINDS.into_iter().zip(right) {
            assert_eq!(right as u64, count, "{name}, {kind}");
        }
    }
}
