//! The commands of the README and of the tour work as described.
#![cfg(unix)]

use crate::pages::{Page, Shell, assert_shown, page};

/// The `sh` blocks that call `dermis`, in order.
fn commands(page: &Page) -> Vec<&str> {
    let calls = |text: &str| text.lines().any(|line| line.starts_with("dermis "));
    page.blocks().iter().filter(|block| block.language == "sh" && calls(block.text)).map(|block| block.text).collect()
}

#[test]
fn the_first_design_of_the_readme() {
    let readme = page("README.md");
    let commands = commands(&readme);
    assert_eq!(commands.len(), 2, "one walk from a design to a score, one live skin");
    let printed = Shell::new().run(commands[0]);
    assert!(printed.contains("presses             2, of which 0 missed; 0 false positives"), "{printed}");
}

#[test]
fn the_live_skin_of_the_readme() {
    let readme = page("README.md");
    // It runs until interrupted, and its default port may be in use.
    let command = format!("{} --for 3 --serve 127.0.0.1:0 --json", commands(&readme)[1].trim());
    let printed = Shell::new().run(&command);
    let summary: serde_json::Value = serde_json::from_str(&printed).expect("JSON");
    assert!(summary["frames"].as_u64() > Some(100), "{printed}");
}

#[test]
fn the_tour_prints_what_it_shows() {
    let tour = page("docs/tour.md");
    let commands = commands(&tour);
    assert!(commands.len() >= 5, "{} blocks of the tour call dermis", commands.len());
    let shell = Shell::new();
    let printed: String = commands.iter().map(|command| shell.run(command)).collect();
    let shown: String = tour.blocks().iter().filter(|block| block.language == "text").map(|block| block.text).collect();
    assert!(shown.lines().count() > 10, "the tour shows output");
    assert_shown(&shown, &printed, "the tour");
}
