//! The files that a design names, carried in its text.
//!
//! After the last table comes a line `[files]`, then a line for each file: its name as in the design, and its contents as
//! hexadecimal digits.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// The line before the files.
const HEAD: &str = "[files]";
/// Longest name of a file, bytes.
const MAX_NAME: usize = 4096;

/// The contents of files by their names in the design.
#[derive(Debug, Default)]
pub(super) struct CarriedFiles(BTreeMap<String, Arc<[u8]>>);

/// A line that is not the name and the contents of a file: its number, from 1.
#[derive(Debug)]
pub(super) struct WrongLine(pub(super) usize);

impl CarriedFiles {
    /// The text without its files, and the files.
    pub(super) fn split(text: &str) -> Result<(&str, Self), WrongLine> {
        let mut end = 0;
        let mut lines = text.split_inclusive('\n').enumerate();
        if !lines.any(|(_, line)| {
            end += line.len();
            line.trim_end() == HEAD
        }) {
            return Ok((text, CarriedFiles::default()));
        }
        let design = &text[..end];
        let design = &design[..design.rfind(HEAD).expect("the line that ends here")];
        let mut files = BTreeMap::new();
        for (index, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
            let (name, contents) = file(line.trim_end()).ok_or(WrongLine(index + 1))?;
            files.insert(name, contents);
        }
        Ok((design, CarriedFiles(files)))
    }

    /// The contents of a file, if the text carries it.
    pub(super) fn get(&self, name: &Path) -> Option<Arc<[u8]>> {
        self.0.get(name.to_str()?).cloned()
    }

    /// Adds a file.
    pub(super) fn insert(&mut self, name: &Path, contents: Vec<u8>) {
        self.0.insert(name.to_string_lossy().into_owned(), contents.into());
    }

    /// A design's text, followed by the files.
    pub(super) fn join(&self, design: &str) -> String {
        if self.0.is_empty() {
            return design.to_string();
        }
        let line = |(name, contents): (&String, &Arc<[u8]>)| {
            format!("\"{}\" = \"{}\"\n", escaped(name), crate::text::hexadecimal(contents))
        };
        let lines: String = self.0.iter().map(line).collect();
        format!("{}\n\n{HEAD}\n{lines}", design.trim_end())
    }
}

/// A name as TOML writes it between quotation marks.
fn escaped(name: &str) -> String {
    let escape = |c: char| match c {
        '"' | '\\' => format!("\\{c}"),
        _ if c.is_control() => format!("\\u{:04x}", u32::from(c)),
        _ => c.to_string(),
    };
    name.chars().map(escape).collect()
}

/// The name and the contents of a line.
fn file(line: &str) -> Option<(String, Arc<[u8]>)> {
    let (name, digits) = line.rsplit_once(" = ")?;
    let digits = digits.strip_prefix('"')?.strip_suffix('"')?.as_bytes();
    if name.len() > MAX_NAME || !digits.len().is_multiple_of(2) {
        return None;
    }
    let names: BTreeMap<String, String> = toml::from_str(&format!("{name} = ''")).ok()?;
    let digit = |digit: u8| (digit as char).to_digit(16).map(|value| value as u8);
    let byte = |pair: &[u8]| Some(16 * digit(pair[0])? + digit(pair[1])?);
    let contents: Option<Vec<u8>> = digits.chunks_exact(2).map(byte).collect();
    Some((names.into_keys().next()?, contents?.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_come_back_as_they_were() {
        let mut files = CarriedFiles::default();
        let contents: Vec<u8> = (0..=255).collect();
        let names = ["arm.stl", "a \"b\" = c\\d.csv", "ärmel [files].ply", "a\u{a0}b\tc.stl"];
        names.iter().for_each(|name| files.insert(Path::new(name), contents.clone()));
        let text = "name = \"[files]\"\n";
        let joined = files.join(text);
        let (design, back) = CarriedFiles::split(&joined).unwrap();
        assert_eq!(design.trim_end(), text.trim_end());
        names.iter().for_each(|name| assert_eq!(back.get(Path::new(name)).as_deref(), Some(&contents[..])));
        assert_eq!(back.join(design), joined);
        let (design, none) = CarriedFiles::split(text).unwrap();
        assert_eq!((design, none.join(design).as_str()), (text, text));
    }

    #[test]
    fn a_damaged_line_is_named() {
        for line in ["\"a\" = \"0\"", "\"a\" = \"0g\"", "\"a\" = 00", "a", "[a] = \"00\"", "\"a\"\"b\" = \"00\""] {
            let error = CarriedFiles::split(&format!("name = 'x'\n[files]\n\n{line}\n")).unwrap_err();
            assert_eq!(error.0, 4, "{line}");
        }
    }
}
