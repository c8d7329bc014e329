//! Measures of the source: lines, lengths of functions and files, public items and their use.
//!
//! `cargo run --manifest-path bench/code/Cargo.toml -- [FOLDER] [--list]` prints them for the workspace in FOLDER
//! (default `.`); with `--list` also the unused public items.
//!
//! - Blank lines are not counted. `code` counts the lines that contain more than a comment.
//! - Outside tests: not in `tests/`, `examples/` or `benches/`, nor in an item or a file under `#[cfg(test)]`.
//! - The length of a function is measured from its `fn` to its closing brace, both lines included.
//! - The length of a file is the number of all its lines.
//! - A public item is `pub` without restriction, in a library outside tests: an item, a method or an associated
//!   constant. It counts as used if its name occurs in another crate, or in the tests and examples of its own: an item
//!   with the same name as a used one also counts as used.

mod items;
mod source;

use items::{Public, Use};
use source::SourceFile;
use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;

/// Files longer than this are listed.
const LONG_FILE: usize = 500;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let list = arguments.iter().any(|argument| argument == "--list");
    let root = arguments.iter().find(|argument| *argument != "--list").map_or(".", String::as_str);
    let files = source::files(Path::new(root))?;
    print_lines(&files);
    print_functions(&files);
    print_files(&files);
    print_public(&files, list);
    Ok(())
}

fn print_lines(files: &[SourceFile]) {
    let mut crates: BTreeMap<&str, [usize; 3]> = BTreeMap::new();
    for file in files {
        let sums = crates.entry(&file.krate).or_default();
        for (sum, lines) in sums.iter_mut().zip([file.lines, file.code, file.test_lines]) {
            *sum += lines;
        }
    }
    println!("{:16} {:>8} {:>8} {:>8}", "lines", "outside", "code", "tests");
    let total = crates.values().fold([0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
    for (name, [lines, code, tests]) in crates.into_iter().chain([("all", total)]) {
        println!("{name:16} {lines:8} {code:8} {tests:8}");
    }
}

fn print_functions(files: &[SourceFile]) {
    let mut lengths: Vec<usize> =
        files.iter().flat_map(|file| &file.functions).map(|function| function.lines).collect();
    lengths.sort_unstable();
    let at = |share: f64| lengths[((lengths.len() - 1) as f64 * share).round() as usize];
    println!("\nfunctions outside tests: {}", lengths.len());
    println!("lines: median {}, 90 % {}, 99 % {}, longest:", at(0.5), at(0.9), at(0.99));
    let mut functions: Vec<_> = files.iter().flat_map(|file| file.functions.iter().map(move |f| (f, file))).collect();
    functions.sort_by_key(|(function, _)| std::cmp::Reverse(function.lines));
    for (function, file) in functions.into_iter().take(10) {
        println!("{:8} {} ({}:{})", function.lines, function.name, file.path.display(), function.line);
    }
}

fn print_files(files: &[SourceFile]) {
    let mut by_length: Vec<&SourceFile> = files.iter().collect();
    by_length.sort_by_key(|file| std::cmp::Reverse(file.length));
    let long = by_length.iter().filter(|file| file.length > LONG_FILE).count();
    println!("\nfiles: {}, over {LONG_FILE} lines: {long}, longest:", files.len());
    for file in by_length.into_iter().take(long.max(5)) {
        println!("{:8} {}", file.length, file.path.display());
    }
}

fn print_public(files: &[SourceFile], list: bool) {
    let public = items::public(files);
    println!("\n{:16} {:>8} {:>8} {:>8} {:>8}", "public items", "all", "crates", "tests", "unused");
    let mut crates: BTreeMap<&str, Vec<&Public>> = BTreeMap::new();
    public.iter().for_each(|item| crates.entry(&item.krate).or_default().push(item));
    for (name, items) in crates {
        let count = |of: Use| items.iter().filter(|item| item.used == of).count();
        let [crates, tests, unused] = [Use::Crates, Use::Tests, Use::Nowhere].map(count);
        println!("{name:16} {:8} {crates:8} {tests:8} {unused:8}", items.len());
    }
    for item in public.iter().filter(|item| list && item.used == Use::Nowhere) {
        println!("unused: {} in {}", item.name, item.path.display());
    }
}
