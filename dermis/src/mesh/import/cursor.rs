//! A position in a file's bytes, with readers of lines, words and binary numbers that assume nothing about the content.

use std::fmt;
use std::str::FromStr;

/// An error in a file's content, with its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Problem(pub String);

impl Problem {
    pub(super) fn new(message: impl Into<String>) -> Self {
        Problem(message.into())
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The byte order of a binary number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ByteOrder {
    Little,
    Big,
}

/// A reading position in a file's bytes. It never allocates memory by a count that the file only states.
#[derive(Debug, Clone)]
pub(crate) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Cursor { bytes, at: 0 }
    }

    pub(super) fn rest(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    pub(super) fn skip_space(&mut self) {
        while self.bytes.get(self.at).is_some_and(u8::is_ascii_whitespace) {
            self.at += 1;
        }
    }

    /// Whether only white space is left.
    pub(super) fn at_end(&mut self) -> bool {
        self.skip_space();
        self.at == self.bytes.len()
    }

    /// The rest of the line, without its end; `None` at the end of the file.
    pub(super) fn line(&mut self) -> Option<&'a [u8]> {
        if self.at == self.bytes.len() {
            return None;
        }
        let rest = self.rest();
        let length = rest.iter().position(|&byte| byte == b'\n').unwrap_or(rest.len());
        self.at += (length + 1).min(rest.len());
        Some(rest[..length].strip_suffix(b"\r").unwrap_or(&rest[..length]))
    }

    /// The next word between white space; empty at the end of the file.
    pub(super) fn word(&mut self) -> &'a [u8] {
        self.skip_space();
        let rest = self.rest();
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.at += length;
        &rest[..length]
    }

    /// The next word as a number.
    pub(super) fn parse<T: FromStr>(&mut self, what: &str) -> Result<T, Problem> {
        let word = self.word();
        match std::str::from_utf8(word).ok().and_then(|text| text.parse().ok()) {
            Some(value) => Ok(value),
            None if word.is_empty() => Err(self.problem(format!("the file ends where {what} should be"))),
            None => Err(self.problem(format!("{} is not {what}", quote(word)))),
        }
    }

    /// The next word as a finite number.
    pub(super) fn finite(&mut self, what: &str) -> Result<f64, Problem> {
        let value: f64 = self.parse(what)?;
        if value.is_finite() { Ok(value) } else { Err(self.problem(format!("{what} is {value}"))) }
    }

    /// The next bytes.
    pub(super) fn take<const N: usize>(&mut self, what: &str) -> Result<[u8; N], Problem> {
        match self.rest().first_chunk::<N>() {
            Some(&bytes) => {
                self.at += N;
                Ok(bytes)
            }
            None => Err(Problem(format!("byte {}: the file ends where {what} should be", self.bytes.len()))),
        }
    }

    pub(super) fn i32(&mut self, order: ByteOrder, what: &str) -> Result<i32, Problem> {
        let bytes = self.take(what)?;
        Ok(if order == ByteOrder::Little { i32::from_le_bytes(bytes) } else { i32::from_be_bytes(bytes) })
    }

    pub(super) fn u64(&mut self, order: ByteOrder, what: &str) -> Result<u64, Problem> {
        let bytes = self.take(what)?;
        Ok(if order == ByteOrder::Little { u64::from_le_bytes(bytes) } else { u64::from_be_bytes(bytes) })
    }

    pub(super) fn f64(&mut self, order: ByteOrder, what: &str) -> Result<f64, Problem> {
        Ok(f64::from_bits(self.u64(order, what)?))
    }

    /// The next bytes as a finite number.
    pub(super) fn finite_f64(&mut self, order: ByteOrder, what: &str) -> Result<f64, Problem> {
        let value = self.f64(order, what)?;
        if value.is_finite() { Ok(value) } else { Err(Problem(format!("byte {}: {what} is {value}", self.at - 8))) }
    }

    /// A problem at the line just read.
    pub(super) fn problem(&self, message: impl fmt::Display) -> Problem {
        // The end of a line belongs to that line.
        let read = &self.bytes[..self.at.saturating_sub(1)];
        let line = 1 + read.iter().filter(|&&byte| byte == b'\n').count();
        Problem(format!("line {line}: {message}"))
    }

    /// Moves behind the next occurrence of `mark`; false if there is none.
    pub(super) fn skip_past(&mut self, mark: &[u8]) -> bool {
        let found = self.rest().windows(mark.len()).position(|window| window == mark);
        if let Some(offset) = found {
            self.at += offset + mark.len();
        }
        found.is_some()
    }
}

/// A word of a file for a message: shortened, and printable in all cases.
pub(crate) fn quote(word: &[u8]) -> String {
    let text: String = String::from_utf8_lossy(&word[..word.len().min(40)]).escape_debug().collect();
    format!("`{text}`")
}
