//! The documentation: tables with figures name their command, commands and links exist, printed output is correct.
#![cfg(unix)]

use crate::pages::{Page, Shell, Table, assert_cell, assert_shown, dermis, page, pages, root, spans};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;

/// A table with a digit outside code in its body.
fn has_figures(table: &Table<'_>) -> bool {
    let outside_code =
        |cell: &String| cell.split('`').step_by(2).any(|text| text.contains(|c: char| c.is_ascii_digit()));
    table.rows.iter().flatten().any(outside_code)
}

#[test]
fn every_table_with_figures_names_its_command() {
    let mut without = Vec::new();
    for page in pages().iter().filter(|page| page.name == "README.md" || page.name.starts_with("docs/")) {
        let tables = page.tables();
        let unmarked = tables.iter().filter(|table| has_figures(table) && table.mark.is_none());
        without.extend(unmarked.map(|table| format!("{}:{}", page.name, table.line)));
    }
    assert!(
        without.is_empty(),
        "put `<!-- table: COMMAND -->` before these tables, or `<!-- table: stated -->` where nothing is measured: {without:?}"
    );
}

#[test]
fn the_commands_of_tables_exist() {
    let (helps, tests) = (Helps::new(), test_names());
    for page in &pages() {
        for table in page.tables() {
            let place = format!("{}:{}", page.name, table.line);
            match table.mark {
                None | Some("stated") => {}
                Some(mark) if mark.starts_with("once: ") => {}
                Some("each row") => {
                    for row in &table.rows {
                        let row = row.join(" ");
                        let named =
                            spans(&row).iter().filter(|span| names_a_test_or_command(span, &helps, &tests)).count();
                        assert!(named > 0, "{place}: no test or command in the row\n{row}");
                    }
                }
                Some(mark) => {
                    for command in mark.split(" | ") {
                        check_command(command, &helps, &tests)
                            .unwrap_or_else(|why| panic!("{place}: {command}: {why}"));
                    }
                }
            }
        }
    }
}

fn names_a_test_or_command(span: &str, helps: &Helps, tests: &BTreeSet<String>) -> bool {
    let is_name = span.len() > 8 && span.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
    if is_name { is_test(span, tests) } else { check_command(span, helps, tests).is_ok() }
}

fn is_test(part: &str, tests: &BTreeSet<String>) -> bool {
    tests.iter().any(|name| name.contains(part))
}

/// Whether a command is known and everything that it refers to exists.
fn check_command(command: &str, helps: &Helps, tests: &BTreeSet<String>) -> Result<(), String> {
    let mut words: Vec<&str> = command.split_whitespace().collect();
    while words.first().is_some_and(|word| *word == "time" || word.contains('=')) {
        words.remove(0);
    }
    match words[..] {
        ["dermis", ..] => helps.check(&words[1..]),
        ["cargo", "run", "--release", "--", ..] => helps.check(&words[4..]),
        ["cargo", "test", ..] => check_cargo(&words[2..], tests),
        ["cargo", "run", ..] => check_cargo(&words[2..], &BTreeSet::new()),
        ["cargo", "+nightly", "fuzz", "run", target] => exists(&format!("fuzz/fuzz_targets/{target}.rs")),
        ["node", script, ..] => exists(script),
        [script, ..] if script.contains('/') => exists(script),
        _ => Err("not a known kind of command".into()),
    }
}

fn exists(path: &str) -> Result<(), String> {
    if root().join(path).exists() { Ok(()) } else { Err(format!("there is no {path}")) }
}

/// The arguments of `cargo test` or `cargo run`: the package, its test or example, and names of tests.
fn check_cargo(words: &[&str], tests: &BTreeSet<String>) -> Result<(), String> {
    let (mut package, mut words) = (String::new(), words.iter().peekable());
    let mut is_run = tests.is_empty();
    while let Some(&word) = words.next() {
        let mut value = || words.next().copied().unwrap_or_default();
        match word {
            "-p" => package = value().replace("dermis-bench", "bench").replace("paper-study", "studies/paper"),
            "--features" | "--test-threads" => drop(value()),
            "--test" => {
                let entry = format!("[[test]]\nname = \"{}\"\n", value());
                let manifest = fs::read_to_string(root().join(&package).join("Cargo.toml")).unwrap_or_default();
                if !manifest.contains(&entry) {
                    return Err(format!("the manifest of `{package}` has no {entry}"));
                }
            }
            "--example" => {
                let example = format!("{package}/examples/{}", value());
                exists(&format!("{example}/main.rs")).or_else(|_| exists(&format!("{example}.rs")))?;
            }
            "--" if is_run => break,
            word if word.starts_with('-') => {}
            name if is_test(name, tests) => {}
            name => return Err(format!("no test has `{name}` in its name")),
        }
        is_run &= word != "--";
    }
    exists(&package)
}

/// The names of all test functions, with their modules.
fn test_names() -> BTreeSet<String> {
    fn sources(folder: &Path, module: &str, names: &mut BTreeSet<String>) {
        for entry in fs::read_dir(folder).expect("a folder of the repository") {
            let path = entry.expect("readable").path();
            let stem = path.file_stem().and_then(|stem| stem.to_str()).expect("UTF-8");
            let inner = if stem == "mod" { module.to_owned() } else { format!("{module}{stem}::") };
            if path.is_dir() {
                sources(&path, &inner, names);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path).expect("a source file");
                for after in text.split("#[test]").skip(1) {
                    let name = after.split("fn ").nth(1).and_then(|rest| rest.split('(').next());
                    names.extend(name.map(|name| format!("{inner}{name}")));
                }
            }
        }
    }
    let mut names = BTreeSet::new();
    for entry in fs::read_dir(root()).expect("the repository") {
        let path = entry.expect("readable").path();
        for folder in ["src", "tests"].map(|folder| path.join(folder)).iter().filter(|folder| folder.is_dir()) {
            sources(folder, "", &mut names);
        }
    }
    assert!(names.len() > 300, "only {} tests found", names.len());
    names
}

/// The help of every subcommand.
struct Helps(BTreeMap<String, String>);

impl Helps {
    fn new() -> Self {
        let help = |arguments: &[&str]| {
            let output = Command::new(dermis()).args(arguments).output().expect("the program runs");
            String::from_utf8(output.stdout).expect("UTF-8")
        };
        let words = |words: &str| help(&words.split(' ').collect::<Vec<_>>());
        let names = crate::workplace::all_commands(words).into_iter();
        let helps: BTreeMap<_, _> = names.map(|name| (name.clone(), words(&format!("{name} --help")))).collect();
        assert!(helps.len() > 15, "only {} subcommands found", helps.len());
        Helps(helps)
    }

    /// Whether the subcommand and the options of a command line, without `dermis`, exist.
    fn check(&self, words: &[&str]) -> Result<(), String> {
        // Two words, as in `robot check`, or one.
        let of =
            |count: usize| words.get(..count).map(|words| words.join(" ")).and_then(|name| self.0.get_key_value(&name));
        let named = of(2).or_else(|| of(1));
        // A command of commands alone, as `robot`.
        if let [name] = words
            && self.0.keys().any(|known| known.split(' ').next() == Some(name))
        {
            return Ok(());
        }
        let (name, help) = named.ok_or_else(|| format!("there is no command `{}`", words.join(" ")))?;
        let words = words.iter().take_while(|word| !matches!(**word, "#" | "|" | "&&" | ">"));
        for option in words.filter_map(|word| word.strip_prefix("--")) {
            let option = option.split('=').next().expect("split gives one").trim_end_matches([',', ')', ']', ';', '.']);
            if !has_option(help, option) {
                return Err(format!("`dermis {name}` has no option --{option}"));
            }
        }
        Ok(())
    }
}

fn has_option(help: &str, option: &str) -> bool {
    let option = format!("--{option}");
    let ends = |rest: &str| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '-');
    help.match_indices(&option).any(|(at, _)| ends(&help[at + option.len()..]))
}

/// The `dermis` command lines of a page: in blocks of commands, and in the text.
fn command_lines(page: &Page) -> Vec<String> {
    let mut lines = Vec::new();
    for block in page.blocks() {
        if matches!(block.language, "sh" | "console" | "text") {
            let joined = block.text.replace("\\\n", " ");
            lines.extend(joined.lines().map(|line| line.trim().trim_start_matches("$ ").to_owned()));
        }
    }
    let prose: Vec<&str> = page.prose().into_iter().map(|(_, line)| line).collect();
    lines.extend(spans(&prose.join(" ")).into_iter().map(str::to_owned));
    // Two spaces: a diagram of the crates.
    let is_command = |line: &str| line.starts_with("dermis ") && !line.starts_with("dermis  ");
    lines.retain(|line| is_command(line) || line.starts_with("cargo run --release -- "));
    lines
}

#[test]
fn commands_use_options_that_exist() {
    let helps = Helps::new();
    let mut wrong = Vec::new();
    for page in &pages() {
        for line in command_lines(page) {
            let words: Vec<&str> = line.split_whitespace().filter(|word| *word != "...").collect();
            let arguments = if words[0] == "dermis" { &words[1..] } else { &words[4..] };
            // `new cylinder|disk` and similar stand for several commands.
            if let Err(why) = helps.check(arguments) {
                wrong.push(format!("{}: {line}: {why}", page.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn no_page_includes_a_file_and_copies_are_equal() {
    let mut copies = 0;
    for page in &pages() {
        assert!(!page.text.contains("{{#"), "{}: shown literally outside the book", page.name);
        for block in page.blocks() {
            let path = block.mark.and_then(|mark| mark.strip_prefix("<!-- file: ")?.strip_suffix(" -->"));
            if let Some(path) = path {
                let file = fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
                assert_eq!(block.text, file, "{} has another {path}", page.name);
                copies += 1;
            }
        }
    }
    assert!(copies > 0, "no page has a copy of a file");
}

/// The anchor of a heading on GitHub and in the book.
fn anchor(heading: &str) -> String {
    let kept = heading.trim_start_matches('#').trim().to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

#[test]
fn links_between_pages_lead_somewhere() {
    let mut wrong = Vec::new();
    for from in &pages() {
        let text: String = from.prose().into_iter().map(|(_, line)| format!("{line}\n")).collect();
        let targets = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        for target in targets.filter(|target| !target.contains("://")) {
            let (path, place) = target.split_once('#').unwrap_or((target, ""));
            let folder = root().join(&from.name).parent().expect("in a folder").to_owned();
            let file = if path.is_empty() { root().join(&from.name) } else { folder.join(path) };
            let found = file.exists()
                && (place.is_empty() || {
                    let text = fs::read_to_string(&file).unwrap_or_default();
                    text.lines().any(|line| line.starts_with('#') && anchor(line) == place)
                });
            if !found {
                wrong.push(format!("{}: {target}", from.name));
            }
        }
    }
    assert!(wrong.is_empty(), "links that lead nowhere:\n{}", wrong.join("\n"));
}

/// Runs the `console` blocks with the given mark on all pages, page by page, and compares the output.
fn run_console_blocks(mark: Option<&str>) -> usize {
    let mut count = 0;
    for page in &pages() {
        let shell = Shell::new();
        for block in page.blocks().iter().filter(|block| block.language == "console" && block.mark == mark) {
            for part in block.text.split("$ ").skip(1) {
                let (command, shown) = part.split_once('\n').expect("a command and its output");
                assert!(command.starts_with("dermis "), "{}: {command}", page.name);
                assert_shown(shown, &shell.run(command), &format!("{}: {command}", page.name));
                count += 1;
            }
        }
    }
    count
}

#[test]
fn console_blocks_print_what_they_show() {
    assert!(run_console_blocks(None) >= 4, "the tour has four");
}

/// Parts of a page between `<!-- generated: COMMAND -->` and `<!-- end -->`: what `dermis` prints, or a text that the named
/// test compares. `DERMIS_WRITE=1` writes the former.
#[test]
fn generated_parts_are_what_their_commands_print() {
    let (helps, tests) = (Helps::new(), test_names());
    let mut outputs = 0;
    for page in &pages() {
        let mut text = page.text.clone();
        for part in page.text.split("<!-- generated: ").skip(1) {
            let (command, rest) = part.split_once(" -->\n").expect("a command");
            let place = format!("{}: {command}", page.name);
            let (shown, _) = rest.split_once("<!-- end -->").unwrap_or_else(|| panic!("{place}: has no end"));
            if command.starts_with("dermis ") {
                let expected = generated(command);
                text = text.replace(&format!("{command} -->\n{shown}"), &format!("{command} -->\n{expected}"));
                outputs += 1;
            } else {
                check_command(command, &helps, &tests).unwrap_or_else(|why| panic!("{place}: {why}"));
            }
        }
        if std::env::var_os("DERMIS_WRITE").is_some() && text != page.text {
            fs::write(root().join(&page.name), &text).expect("the page can be written");
        } else {
            let how = "write it: DERMIS_WRITE=1 cargo test --release -p dermis-cli generated_parts";
            assert_eq!(text, page.text, "{}: {how}", page.name);
        }
    }
    assert!(outputs > 2, "commands, keys of designs and of twins");
}

/// The text of a generated part: a table of the keys of a JSON schema, or the output as it is.
fn generated(command: &str) -> String {
    let printed = Shell::new().run(command);
    if !command.starts_with("dermis schema") {
        return format!("\n```text\n{}\n```\n\n", printed.trim());
    }
    let schema: Value = serde_json::from_str(&printed).expect("JSON");
    let mut rows = Vec::new();
    keys(&schema, &schema, "", &mut rows);
    let rows: String = rows.iter().map(|(key, meaning)| format!("| `{key}` | {meaning} |\n")).collect();
    format!("\n| key | meaning |\n|---|---|\n{rows}\n")
}

/// The keys below a node of a schema, with their meanings; the alternative that a key is of tells the meaning of one without.
fn keys(schema: &Value, node: &Value, path: &str, rows: &mut Vec<(String, String)>) {
    for node in variants(schema, node) {
        let alternative = if path.is_empty() { "" } else { node["description"].as_str().unwrap_or_default() };
        for (name, property) in node["properties"].as_object().into_iter().flatten() {
            let key = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            if rows.iter().all(|(known, _)| *known != key) {
                let meaning = property["description"].as_str().unwrap_or(alternative).replace('\n', " ");
                rows.push((key.clone(), meaning.replace('|', "\\|") + &words(schema, property)));
            }
            keys(schema, property, &key, rows);
        }
        if node["items"].is_object() {
            keys(schema, &node["items"], &format!("{path}[]"), rows);
        }
    }
}

/// A node and its alternatives, with references followed.
fn variants<'a>(schema: &'a Value, node: &'a Value) -> Vec<&'a Value> {
    let mut all = vec![node];
    if let Some(name) = node["$ref"].as_str().and_then(|path| path.strip_prefix("#/$defs/")) {
        all.extend(variants(schema, &schema["$defs"][name]));
    }
    for kind in ["oneOf", "anyOf", "allOf"] {
        all.extend(node[kind].as_array().into_iter().flatten().flat_map(|node| variants(schema, node)));
    }
    all
}

/// The words that a key may have.
fn words(schema: &Value, property: &Value) -> String {
    let nodes = variants(schema, property);
    let words = nodes.iter().flat_map(|node| {
        node["enum"].as_array().into_iter().flatten().chain(std::iter::once(&node["const"])).filter_map(Value::as_str)
    });
    let words: Vec<String> = words.map(|word| format!("`\"{word}\"`")).collect();
    if words.is_empty() { String::new() } else { format!(" Words: {}.", words.join(", ")) }
}

/// The tables of `dermis benchmark`: a row for each figure, a column for each run with `mean (worst twin)`.
fn benchmark_tables(page: &Page) -> Vec<Table<'_>> {
    let mut tables = page.tables();
    tables.retain(|table| {
        table.mark.is_some_and(|mark| mark.starts_with("dermis benchmark")) && table.head[0] == "figure"
    });
    tables
}

/// The runs of such a table, and the number of their columns.
fn runs<'a>(table: &'a Table<'a>) -> (Vec<&'a str>, usize) {
    let runs: Vec<&str> = table.mark.expect("chosen by it").split(" | ").collect();
    (runs.clone(), table.head.len() - runs.len())
}

#[test]
fn the_rows_of_benchmark_tables_are_figures() {
    let ledger = page("docs/validation-ledger.md");
    let tables = benchmark_tables(&ledger);
    assert_eq!(tables.len(), 3, "linear methods, networks, refined contacts");
    for table in tables {
        for row in &table.rows {
            let known = dermis_study::metrics::figures().any(|figure| figure.name == row[0]);
            assert!(known, "docs/validation-ledger.md:{}: `dermis benchmark` prints no `{}`", table.line, row[0]);
        }
    }
}

#[test]
#[ignore = "slow: `dermis benchmark` on ten twins, eleven times, about half an hour"]
fn benchmark_tables_hold_what_the_commands_print() {
    let ledger = page("docs/validation-ledger.md");
    for table in benchmark_tables(&ledger) {
        let (runs, first) = runs(&table);
        for (column, command) in runs.iter().enumerate() {
            let printed = Shell::new().run(command);
            for row in &table.rows {
                let line = printed.lines().find(|line| line.trim_start().starts_with(&row[0]));
                let line = line.unwrap_or_else(|| panic!("{command} prints no `{}`\n{printed}", row[0]));
                let values: Vec<&str> = line.trim_start()[row[0].len()..].split_whitespace().collect();
                assert_cell(&row[first + column], &values, &format!("{command}: {}", row[0]));
            }
        }
    }
}
