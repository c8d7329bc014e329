//! The fault campaign on the paper's skin.

use dermis::method::MethodSet;
use dermis::skin::Skin;
use dermis_live::campaign::{CampaignOptions, Score, run};
use dermis_sim::twin::TwinOptions;
use std::sync::Arc;

fn scores(skin: &str, method: &str, twin: &str, faults: usize) -> Vec<Score> {
    let methods = Arc::new(MethodSet::new(&dermis_learn::methods(), Skin::load(skin).unwrap(), None).unwrap());
    let twin = TwinOptions::shipped(twin).unwrap();
    run(&methods, &CampaignOptions { twin, method: method.into(), faults, seed: 1 }, |_| {}).unwrap()
}

fn print(scores: &[Score]) {
    for score in scores {
        println!(
            "{:24} {:3} during {:6} frames {:4} false {:4} touch {:6} invalid | after {:6} {:4} {:4} {:4} | noticed {}/{} named {} found {}/{} slowest {:.2}",
            score.kind.name(),
            score.faults,
            score.during.frames,
            score.during.false_contacts,
            score.during.wrong_touch,
            score.during.invalid,
            score.after.frames,
            score.after.false_contacts,
            score.after.wrong_touch,
            score.after.invalid,
            score.noticed,
            score.to_notice,
            score.named,
            score.found,
            score.presses,
            score.slowest_s,
        );
    }
}

#[test]
#[ignore = "slow"]
fn a_campaign() {
    let method = std::env::var("METHOD").unwrap_or("noser".into());
    print(&scores("cylinder30", &method, "lab", std::env::var("N").map_or(200, |n| n.parse().unwrap())));
}
