//! Files and hands of users at live skins, which run at the pace of the clock: see `field_cases.rs`.

use crate::workplace::Workplace;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Stdio;

/// The states of the frames of a live skin, and how many have contacts.
fn lived(at: &Workplace, arguments: &str, input: Option<&Path>) -> (BTreeMap<String, usize>, usize, String) {
    let mut command = at.command(&format!("live {arguments} --serve off --jsonl -"));
    if let Some(path) = input {
        command.stdin(Stdio::from(std::fs::File::open(path).unwrap()));
    }
    let output = command.output().unwrap();
    let (mut states, mut touched) = (BTreeMap::new(), 0);
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        let Ok(frame) = serde_json::from_str::<serde_json::Value>(line) else { continue };
        let Some(state) = frame["validity"]["state"].as_str() else { continue };
        let reason = frame["validity"]["reason"].as_str().unwrap_or_default();
        *states.entry(format!("{state} {reason}").trim().to_string()).or_insert(0) += 1;
        touched += usize::from(!frame["contacts"].as_array().unwrap().is_empty());
    }
    (states, touched, String::from_utf8_lossy(&output.stderr).into_owned())
}

/// Does the same with each of some cases, two at a time: live skins leave half of the processor's time unused.
fn two_at_once<T: Copy + Send + Sync>(cases: &[T], of_case: impl Fn(T) + Sync) {
    let of_case = &of_case;
    for pair in cases.chunks(2) {
        std::thread::scope(|threads| pair.iter().for_each(|&case| _ = threads.spawn(move || of_case(case))));
    }
}

#[test]
fn a_touch_in_the_tare_blinds_no_place_and_leaves_no_false_contact() {
    let Some(at) = Workplace::of_field_case("live-01-touch-during-tare") else { return };
    let scripts = [
        ("control", ""),
        ("tap40ms", ""),
        ("tap200ms", "no tare yet"),
        ("half", "no tare yet"),
        ("whole", "a touch has ended that was there at the tare"),
    ];
    let check = |(script, warning): (&str, &str)| {
        let (states, touched, said) =
            lived(&at, &format!("cylinder30 --touch {script}.toml --method noser --for 9"), None);
        // Two presses of 1.5 s: 360 frames.
        assert!((340..=380).contains(&touched), "{script}: {touched} of 360 frames, {states:?}");
        assert!(said.contains(warning), "{script}: {said}");
    };
    two_at_once(&scripts, check);
}

#[test]
fn an_instrument_that_is_dead_or_frozen_is_never_ok() {
    let Some(at) = Workplace::of_field_case("live-02-dead-instrument-ok") else { return };
    two_at_once(&["zeros", "gain:0", "freeze"], |fault| {
        let arguments = format!("cylinder30 --method noser --for 3 --touch p10.toml --fault {fault}@0+60");
        let (states, touched, said) = lived(&at, &arguments, None);
        // A busy computer may stop for so long that a frame is stale, too.
        let is_unusable = states.keys().all(|state| state == "invalid tare" || state == "stale");
        let invalid = states.get("invalid tare").copied().unwrap_or_default();
        assert!(is_unusable && invalid >= 300 && touched == 0, "{fault}: {states:?}");
        assert!(said.contains("no tare: "), "{fault}: {said}");
    });
}

#[test]
fn a_touch_that_moves_is_no_noise() {
    let Some(at) = Workplace::of_field_case("05-live-moving-touch-invalid-noise") else { return };
    for (design, rows) in [("disk.toml", "live_circ4.csv"), ("iirc.toml", "iirc_live_n.csv")] {
        let (_, _, said) = lived(&at, &format!("{design} --source csv:- --rate 20"), Some(&at.path(rows)));
        // Of the summary: a busy computer leaves lines out, not frames.
        let count = said.lines().find_map(|line| line.strip_prefix("of them with contacts")?.trim().parse().ok());
        assert!(count.is_some_and(|count: u64| count >= 90), "{design}: contacts in {count:?} of 99 frames\n{said}");
    }
}
