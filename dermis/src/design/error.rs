//! Errors of a design or another TOML file: what is wrong, where, and the fix.

use std::ops::Range;
use thiserror::Error;

/// An error of a design or another TOML file (such as a twin's) that cannot be read or built: place, problem and fix.
#[derive(Debug, Error)]
#[error("{}{message}{}", self.location(), self.fix.as_ref().map(|fix| format!(" ({fix})")).unwrap_or_default())]
pub struct DesignError {
    /// What is wrong, with the field and the numbers.
    pub message: String,
    /// How to fix it, if known.
    pub fix: Option<String>,
    /// The file's name and text, for an excerpt.
    pub source_text: Option<(String, String)>,
    /// Byte range of the wrong text in the file.
    pub span: Option<Range<usize>>,
}

impl DesignError {
    /// An error without a place in a file.
    pub fn new(message: impl Into<String>, fix: Option<String>) -> Self {
        DesignError { message: message.into(), fix, source_text: None, span: None }
    }

    /// 1-based line of the wrong text.
    pub fn line(&self) -> Option<usize> {
        let ((_, text), span) = (self.source_text.as_ref()?, self.span.as_ref()?);
        let before = text.as_bytes().get(..span.start)?;
        Some(1 + before.iter().filter(|&&byte| byte == b'\n').count())
    }

    fn location(&self) -> String {
        match (&self.source_text, self.line()) {
            (Some((name, _)), Some(line)) => format!("{name}:{line}: "),
            (Some((name, _)), None) => format!("{name}: "),
            _ => String::new(),
        }
    }
}

/// A TOML error with a clearer text, and the name or unit that was probably meant.
pub fn explain_toml_error(message: &str) -> (String, Option<String>) {
    if let Some((keys, known)) =
        message.strip_prefix("unexpected keys in table: ").and_then(|rest| rest.split_once(", available keys: "))
    {
        let written = keys.split(", ").next().unwrap_or(keys);
        let known: Vec<&str> = known.split(", ").collect();
        let listed: Vec<String> = known.iter().map(|name| format!("`{name}`")).collect();
        let message = format!("unknown field `{written}`, expected {}", listed.join(" or "));
        return (message, meant(written, &known));
    }
    let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    let unknown = message.starts_with("unknown field") || message.starts_with("unknown variant");
    let fix = names.split_first().filter(|_| unknown).and_then(|(written, known)| meant(written, known));
    (message.to_string(), fix)
}

/// The known name that was probably meant.
fn meant(written: &str, known: &[&str]) -> Option<String> {
    if let Some(name) = known.iter().find(|name| stem(name) == stem(written) && **name != written) {
        return Some(format!("did you mean `{name}`? The unit is part of the name"));
    }
    closest_name(written, known.iter().copied()).map(|name| format!("did you mean `{name}`?"))
}

/// Where a table gives the key that a message names: the value of that key.
pub(super) fn value_of_named_key(text: &str, table: &Range<usize>, message: &str) -> Option<Range<usize>> {
    // The span of a table of its own is that of its header.
    let before = text.get(..table.start)?.rsplit('\n').next()?;
    let is_header = !before.is_empty() && before.chars().all(|letter| letter == '[');
    let end = match is_header {
        true => text.get(table.end..)?.find("\n[").map_or(text.len(), |more| table.end + more),
        false => table.end,
    };
    let is_word = |byte: char| byte.is_alphanumeric() || byte == '_';
    let names = |key: &str| message.split(|letter| !is_word(letter)).any(|word| word == key);
    let mut begin = table.start;
    for line in text.get(table.start..end)?.split_inclusive('\n') {
        if let Some((key, value)) = line.split_once('=').filter(|_| !line.trim_start().starts_with('#')) {
            let key = key.trim_matches(|letter| !is_word(letter)).rsplit('.').next().unwrap_or_default();
            let value = value.split('#').next().unwrap_or_default().trim_matches([' ', '\r', '\n', '\t', '}', ']']);
            let at = line.find('=').unwrap_or(0);
            if names(key) && !value.is_empty() && !value.contains(['{', ',']) {
                let start = begin + at + line[at..].find(value)?;
                return Some(start..start + value.len());
            }
        }
        begin += line.len();
    }
    None
}

/// A name without its unit.
fn stem(name: &str) -> &str {
    const UNITS: [&str; 22] = [
        "_s_per_m", "_ohm_m2", "_ohm_mm2", "_ohm_cm2", "_ohm_m", "_kohm", "_ohm", "_rad", "_deg", "_degrees", "_mm",
        "_cm", "_um", "_m", "_khz", "_hz", "_mv", "_v", "_pf", "_nf", "_f", "_n",
    ];
    UNITS.iter().find_map(|unit| name.strip_suffix(unit)).unwrap_or(name)
}

/// The known name most similar to the given one, if any is similar.
pub fn closest_name<'a>(written: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    // The time grows with the product of the lengths, and a text this long is no name.
    const LONGEST: usize = 100;
    if written.len() > LONGEST {
        return None;
    }
    let (distance, name) = known.map(|name| (edit_distance(written, name), name)).min()?;
    (distance <= 1 + written.len() / 4).then_some(name)
}

/// The number of insertions, deletions and replacements between two words (Levenshtein, 1966).
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(from != to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}
