//! A short fault campaign on the paper's skin. `dermis fault-campaign` runs long ones.

use dermis::method::MethodSet;
use dermis::skin::Skin;
use dermis_emulate::campaign::{CampaignOptions, FaultKind, Score, run, scores};
use dermis_sim::twin::TwinOptions;
use std::sync::Arc;

#[test]
fn faults_cause_no_contacts_and_end() {
    let methods = MethodSet::new(&dermis_learn::methods(), Skin::load("cylinder30").unwrap(), None).unwrap();
    let twin = TwinOptions::shipped("lab").unwrap();
    let options = CampaignOptions { twin, method: "noser".into(), faults: 60, seed: 11 };
    let mut scores = scores(&run(&Arc::new(methods), &options, |_| {}).unwrap());
    scores.retain(|score| score.kind != FaultKind::Control);
    assert_eq!(scores.iter().map(|score| score.faults).sum::<u64>(), 60);
    let sum = |of: fn(&Score) -> u64| scores.iter().map(of).sum::<u64>();
    let during = sum(|score| score.during.frames);
    assert!(during > 3000 && scores.iter().any(|score| score.kind == FaultKind::Loose));
    // So few faults have 4,000 frames: a contact that lasts after a press has five.
    assert!(500 * sum(|score| score.during.false_contacts) <= during, "{scores:?}");
    // A false contact of the method itself is no effect of a fault.
    assert!(1000 * sum(|score| score.after.false_contacts) <= sum(|score| score.after.frames), "{scores:?}");
    assert_eq!(sum(|score| score.noticed), sum(|score| score.to_notice), "{scores:?}");
    assert!(20 * sum(|score| score.named) >= 19 * sum(|score| score.to_notice), "{scores:?}");
    assert_eq!(sum(|score| score.found), sum(|score| score.presses), "{scores:?}");
}
