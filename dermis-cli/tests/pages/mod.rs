//! The pages of the documentation, their blocks and tables, and a shell to run their commands.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// A Markdown file of the repository.
pub struct Page {
    /// Its path from the root of the repository.
    pub name: String,
    pub text: String,
}

/// A fenced block.
pub struct Block<'a> {
    /// `sh`, `text`, `console`, ...
    pub language: &'a str,
    pub text: &'a str,
    /// The line before the fence, if it is a comment.
    pub mark: Option<&'a str>,
}

/// A table.
pub struct Table<'a> {
    /// Its first line, from 1.
    pub line: usize,
    /// The text after `table:` in the comment before it, or in `<!-- tables: stated -->` for all tables of the page.
    pub mark: Option<&'a str>,
    pub head: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

/// The root of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the crate lies in the workspace").to_owned()
}

/// One page.
pub fn page(name: &str) -> Page {
    let text = fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    Page { name: name.to_owned(), text }
}

/// README.md, the other pages in the same folder, and the book.
pub fn pages() -> Vec<Page> {
    let mut names: Vec<String> =
        ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "data/README.md"]
            .map(String::from)
            .into();
    for folder in ["docs", "docs/decisions", "docs/images"] {
        for entry in fs::read_dir(root().join(folder)).expect("the book is in the repository") {
            let file = entry.expect("readable").file_name().into_string().expect("ASCII names");
            if file.ends_with(".md") {
                names.push(format!("{folder}/{file}"));
            }
        }
    }
    names.sort();
    names.iter().map(|name| page(name)).collect()
}

impl Page {
    /// The fenced blocks, in order.
    pub fn blocks(&self) -> Vec<Block<'_>> {
        let mut blocks = Vec::new();
        let mut open: Option<(&str, usize, Option<&str>)> = None;
        let (mut at, mut before) = (0, None);
        for line in self.text.split_inclusive('\n') {
            let content = line.trim();
            match (content.strip_prefix("```"), open) {
                (Some(language), None) => open = Some((language, at + line.len(), before)),
                (Some(_), Some((language, from, mark))) => {
                    blocks.push(Block { language, text: &self.text[from..at], mark });
                    open = None;
                }
                _ => {}
            }
            before = (content.starts_with("<!--") && content.ends_with("-->")).then_some(content);
            at += line.len();
        }
        blocks
    }

    /// The lines outside fenced blocks, with their numbers from 1.
    pub fn prose(&self) -> Vec<(usize, &str)> {
        let mut inside = false;
        let mut lines = Vec::new();
        for (index, line) in self.text.lines().enumerate() {
            let fence = line.trim_start().starts_with("```");
            inside ^= fence;
            if !inside && !fence {
                lines.push((index + 1, line));
            }
        }
        lines
    }

    /// The tables, in order.
    pub fn tables(&self) -> Vec<Table<'_>> {
        let of_page = self.text.contains("<!-- tables: stated -->").then_some("stated");
        let mut tables: Vec<Table<'_>> = Vec::new();
        let (mut mark, mut last) = (None, 0);
        for (line, text) in self.prose() {
            let text = text.trim();
            if text.starts_with('|') {
                if tables.is_empty() || last + 1 != line {
                    tables.push(Table { line, mark: mark.or(of_page), head: cells(text), rows: Vec::new() });
                } else if !text.starts_with("|-") {
                    tables.last_mut().expect("just looked").rows.push(cells(text));
                }
                last = line;
            }
            if !text.is_empty() {
                mark = text.strip_prefix("<!-- table: ").and_then(|rest| rest.strip_suffix(" -->"));
            }
        }
        tables
    }
}

/// The cells of a row; `\|` is an escaped character.
fn cells(row: &str) -> Vec<String> {
    let row = row.replace("\\|", "\u{1}");
    row.trim_matches('|').split('|').map(|cell| cell.trim().replace('\u{1}', "|")).collect()
}

/// The code spans of a text.
pub fn spans(text: &str) -> Vec<&str> {
    text.split('`').skip(1).step_by(2).collect()
}

/// The program under test.
pub fn dermis() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_dermis"))
}

/// A folder in which commands run in sequence.
pub struct Shell {
    folder: TempDir,
}

impl Shell {
    pub fn new() -> Self {
        Shell { folder: tempfile::tempdir().expect("a folder") }
    }

    /// Runs a script with `dermis` on the path; returns its output.
    pub fn run(&self, script: &str) -> String {
        let folder = dermis().parent().expect("a program lies in a folder");
        let path = format!("{}:{}", folder.display(), std::env::var("PATH").unwrap_or_default());
        let mut shell = Command::new("sh");
        let shell = shell.args(["-e", "-c", script]).env("PATH", path).env("NO_COLOR", "1").current_dir(&self.folder);
        let Output { status, stdout, stderr } = shell.output().expect("a shell");
        assert!(status.success(), "{script}\n{}", String::from_utf8_lossy(&stderr));
        String::from_utf8(stdout).expect("UTF-8")
    }
}

/// Checks that all shown lines are in the output, in order: the same words, and numbers equal within their printed
/// precision. `...` stands for any lines; elapsed times are not compared.
pub fn assert_shown(shown: &str, printed: &str, place: &str) {
    let mut rest = printed.lines();
    let is_rule = |line: &str| line.chars().all(|c| c == '-' || c.is_whitespace());
    for line in shown.lines().filter(|line| line.trim() != "..." && !is_rule(line)) {
        let expected = tokens(line);
        assert!(
            rest.any(|line| agree(&expected, &tokens(line))),
            "{place} shows\n{line}\nwhich is not in what follows of the output\n{printed}"
        );
    }
}

#[derive(Debug)]
enum Token<'a> {
    Text(&'a str),
    Number { value: f64, decimals: usize },
}

/// Words, punctuation and numbers of a line.
fn tokens(line: &str) -> Vec<Token<'_>> {
    let is_word = |c: char| c.is_alphanumeric() || c == '.' || c == '_';
    let mut tokens = Vec::new();
    for part in line.split_whitespace() {
        let mut rest = part;
        while !rest.is_empty() {
            let length = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
            let end = if length > 0 { length } else { rest.find(is_word).unwrap_or(rest.len()) };
            tokens.push(token(rest[..end].trim_end_matches('.')));
            rest = &rest[end..];
        }
    }
    tokens
}

fn token(text: &str) -> Token<'_> {
    match text.parse::<f64>() {
        Ok(value) if text.starts_with(|c: char| c.is_ascii_digit()) => {
            Token::Number { value, decimals: text.split_once('.').map_or(0, |(_, decimals)| decimals.len()) }
        }
        _ => Token::Text(text),
    }
}

fn agree(shown: &[Token<'_>], printed: &[Token<'_>]) -> bool {
    let is_text = |at: Option<&Token<'_>>, text: &str| matches!(at, Some(Token::Text(is)) if *is == text);
    shown.len() == printed.len()
        && shown.iter().zip(printed).enumerate().all(|(at, pair)| match pair {
            (Token::Text(a), Token::Text(b)) => a == b,
            (&Token::Number { value: a, decimals }, &Token::Number { value: b, decimals: more }) => {
                let is_duration = at > 0 && is_text(shown.get(at - 1), "in") && is_text(shown.get(at + 1), "s");
                is_duration || (a - b).abs() <= precision(a, decimals, more)
            }
            _ => false,
        })
}

/// Half a unit of the last decimal if the page has fewer decimals than the output, else one unit. Counts are exact.
/// Numbers printed in full may differ by rounding between processors.
fn precision(value: f64, decimals: usize, printed: usize) -> f64 {
    const FULL: usize = 7;
    let unit = 10f64.powi(-i32::try_from(decimals).expect("few decimals"));
    match decimals {
        0 if printed == 0 => 0.0,
        decimals if decimals >= FULL => 1e-4 * value.abs(),
        decimals if printed > decimals => 0.501 * unit,
        _ => 1.001 * unit,
    }
}

/// Compares the numbers of a cell such as `4.25 (4.32)` with printed numbers, within its precision.
pub fn assert_cell(cell: &str, printed: &[&str], place: &str) {
    let shown: Vec<&str> = cell.split([' ', '(', ')', '*']).filter(|word| !word.is_empty()).collect();
    assert!(!shown.is_empty() && shown.len() <= printed.len(), "{place}: `{cell}`");
    for (shown, printed) in shown.iter().zip(printed) {
        assert!(agree(&tokens(shown), &tokens(printed)), "{place}: the page has {shown}, the command prints {printed}");
    }
}

#[test]
fn planted_differences_are_found() {
    let shown = "a: 2.5 +- 2.0 mm, 900 of 900 (alpha 0.44)\n...\nin 12 s.";
    assert_shown(shown, "b\na:  2.5 +-  1.9 mm, 900 of 900 (alpha 0.44)\nx\nin 9 s.", "here");
    let agree_on = |a, b| agree(&tokens(a), &tokens(b));
    assert!(!agree_on("2.5 mm", "2.7 mm") && !agree_on("900", "899") && !agree_on("+0.1", "-0.1"));
    assert!(!agree_on("hash 34ea", "hash 34eb") && !agree_on("two words", "two"));
    let page =
        Page { name: "x".into(), text: "<!-- table: a -->\n| a |\n|---|\n| 1 |\n\n| b |\n|---|\n| `2` |\n".into() };
    let tables = page.tables();
    assert_eq!(tables.iter().map(|table| table.mark).collect::<Vec<_>>(), [Some("a"), None]);
    assert_eq!((tables[0].rows.len(), tables[1].rows[0][0].as_str()), (1, "`2`"));
}
