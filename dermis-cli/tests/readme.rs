//! The commands of the README and of the tour do what they say.
#![cfg(unix)]

use std::path::Path;
use std::process::Command;

/// The `sh` blocks of a page that call `dermis`, in order.
fn blocks(page: &str) -> Vec<&str> {
    let after_fence = page.split("```sh\n").skip(1);
    let blocks = after_fence.map(|rest| rest.split("```").next().expect("split gives one"));
    blocks.filter(|block| block.lines().any(|line| line.starts_with("dermis "))).collect()
}

/// Runs blocks as a shell would, one after the other in one new folder, `dermis` being the program under test; what they print.
fn run(blocks: &[&str]) -> String {
    let folder = tempfile::tempdir().expect("a folder");
    let binaries = Path::new(env!("CARGO_BIN_EXE_dermis")).parent().expect("a program lies in a folder");
    let path = format!("{}:{}", binaries.display(), std::env::var("PATH").unwrap_or_default());
    let mut printed = String::new();
    for block in blocks {
        let mut shell = Command::new("sh");
        let output = shell.args(["-e", "-c", block]).env("PATH", &path).env("NO_COLOR", "1").current_dir(&folder);
        let output = output.output().expect("a shell");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{block}\n{stderr}");
        printed.push_str(&String::from_utf8_lossy(&output.stdout));
    }
    printed
}

/// Text with every number as `#` and every space as one: figures may move with the defaults, what is told may not.
fn words(text: &str) -> String {
    let mut words = String::new();
    for character in text.chars() {
        let next = match character {
            '0'..='9' | '.' => '#',
            space if space.is_whitespace() => ' ',
            other => other,
        };
        if !(matches!(next, '#' | ' ') && words.ends_with(next)) {
            words.push(next);
        }
    }
    words.trim().to_owned()
}

#[test]
fn a_first_design_of_your_own() {
    let blocks = blocks(include_str!("../../README.md"));
    assert_eq!(blocks.len(), 2, "one walk from a design to a score, one live skin");
    let printed = run(&blocks[..1]);
    assert!(printed.contains("presses             2, of which 0 missed; 0 false positives"), "{printed}");
}

#[test]
fn a_live_skin() {
    let blocks = blocks(include_str!("../../README.md"));
    // It goes on for ever, and its usual port may be taken.
    let printed = run(&[&format!("{} --for 3 --serve 127.0.0.1:0 --json", blocks[1].trim())]);
    let told: serde_json::Value = serde_json::from_str(&printed).expect("JSON");
    assert!(told["frames"].as_u64() > Some(100), "{printed}");
}

#[test]
fn the_tour_prints_what_it_shows() {
    let tour = include_str!("../../docs/tour.md");
    let blocks = blocks(tour);
    assert!(blocks.len() >= 5, "{} blocks of the tour call dermis", blocks.len());
    let printed = run(&blocks);
    let shown: Vec<&str> =
        tour.split("```text\n").skip(1).map(|rest| rest.split("```").next().expect("split gives one")).collect();
    assert!(!shown.is_empty(), "the tour shows output");
    let printed = words(&printed);
    for line in shown.iter().flat_map(|block| block.lines()).filter(|line| !line.trim().is_empty()) {
        assert!(printed.contains(&words(line)), "the tour shows\n{line}\nbut its commands print\n{printed}");
    }
}
