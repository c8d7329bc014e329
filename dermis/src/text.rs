//! Texts for people: counts in messages, texts of others on a terminal.

use std::borrow::Cow;
use std::fmt::Display;

/// A count and what is counted, in the singular or plural.
///
/// ```
/// use dermis::text::counted;
///
/// assert_eq!(counted(1, "frame"), "1 frame");
/// assert_eq!(counted(0, "labelled press"), "0 labelled presses");
/// ```
pub fn counted<N: Display + Copy + PartialEq + From<u8>>(count: N, noun: &str) -> String {
    format!("{count} {}", number_of(count, noun))
}

/// A regular noun in the singular for a count of 1, else in the plural.
pub fn number_of<N: PartialEq + From<u8>>(count: N, noun: &str) -> String {
    if count == N::from(1) {
        noun.into()
    } else if noun.ends_with(['s', 'x']) || noun.ends_with("ch") || noun.ends_with("sh") {
        format!("{noun}es")
    } else {
        format!("{noun}s")
    }
}

/// A text with the characters that XML and HTML reserve written as entities.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Bytes as hexadecimal digits.
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A number with at most some decimals: without trailing zeros, and without a sign before zero.
///
/// ```
/// use dermis::text::decimal;
///
/// assert_eq!([decimal(12.50, 3), decimal(-0.001, 1), decimal(20.0, 0)], ["12.5", "0", "20"]);
/// ```
pub fn decimal(value: f64, most_decimals: usize) -> String {
    let text = format!("{value:.most_decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".into() } else { text.into() }
}

/// Ascending numbers as ranges, at most eight of them.
///
/// ```
/// use dermis::text::ranges;
///
/// assert_eq!(ranges(&[0, 1, 2, 7]), "0-2, 7");
/// assert_eq!(ranges(&(0..40).filter(|number| number % 4 == 1).collect::<Vec<_>>()), "1, 5, 9, 13, 17, 21, 25, 29, ... (10 in all)");
/// ```
pub fn ranges(numbers: &[usize]) -> String {
    const MAX: usize = 8;
    let mut parts: Vec<String> = numbers
        .chunk_by(|before, after| before + 1 == *after)
        .map(|run| match run {
            [first, .., last] => format!("{first}-{last}"),
            _ => run[0].to_string(),
        })
        .collect();
    if parts.len() > MAX {
        parts.truncate(MAX);
        parts.push(format!("... ({} in all)", numbers.len()));
    }
    parts.join(", ")
}

/// A text of a device or a file on one line of a terminal. Characters that control a terminal, end a line or change the
/// direction of writing become `?`, one for each of their bytes, so that places in the text stay.
///
/// ```
/// use dermis::text::printable;
///
/// assert_eq!(printable("arm 3, 20 \u{b0}C"), "arm 3, 20 \u{b0}C");
/// assert_eq!(printable("\u{1b}[2Jarm\n"), "?[2Jarm?");
/// ```
pub fn printable(text: &str) -> Cow<'_, str> {
    replaced(text, is_unprintable)
}

/// The same for a text of several lines: line feeds and tabs stay.
pub fn printable_lines(text: &str) -> Cow<'_, str> {
    replaced(text, |character| is_unprintable(character) && !matches!(character, '\n' | '\t'))
}

/// The beginning of a text that is longer than a number of bytes, with the number of those left out.
pub fn shortened(text: &str, most_bytes: usize) -> Cow<'_, str> {
    if text.len() <= most_bytes {
        return text.into();
    }
    let shown = &text[..text.floor_char_boundary(most_bytes)];
    format!("{shown}... and {}", counted(text.len() - shown.len(), "more byte")).into()
}

/// Control characters, and the marks that end lines or reverse the direction of a text (Unicode 16, 23.2).
fn is_unprintable(character: char) -> bool {
    let is_mark =
        matches!(character, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    character.is_control() || is_mark
}

fn replaced(text: &str, is_replaced: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_replaced) {
        return text.into();
    }
    let mut clean = String::with_capacity(text.len());
    for character in text.chars() {
        match is_replaced(character) {
            true => clean.extend(std::iter::repeat_n('?', character.len_utf8())),
            false => clean.push(character),
        }
    }
    clean.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_controls_a_terminal_is_left() {
        let all: String = (0..=0x2fff).filter_map(char::from_u32).collect();
        let clean = printable(&all);
        assert_eq!(clean.len(), all.len());
        assert!(!clean.contains(char::is_control));
        assert!(!clean.contains(['\u{202e}', '\u{2028}', '\u{2066}', '\u{9b}', '\u{7f}']));
        assert!(clean.contains(['\u{e9}', '\u{4e}', '\u{3a9}']));
        let lines = printable_lines("a\tb\nc\r\u{9b}d");
        assert_eq!(lines, "a\tb\nc???d");
    }

    #[test]
    fn long_texts_say_how_much_is_left_out() {
        assert_eq!(shortened("abc", 3), "abc");
        assert_eq!(shortened("abcd", 3), "abc... and 1 more byte");
        assert_eq!(shortened("a\u{e9}\u{e9}", 2), "a... and 4 more bytes");
    }
}
