//! Text of tables and logs, as programs and boards write it: its encoding, and what stands before the values of a line.

use std::borrow::Cow;

/// The text of a file: UTF-8, UTF-16 with a byte-order mark, or any other extension of ASCII. Line ends are `\n` or `\r`.
///
/// # Errors
/// A file that is no text, with the fix.
pub(super) fn decode(bytes: &[u8]) -> Result<Cow<'_, str>, String> {
    let utf16 = |of: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = bytes[2..].as_chunks::<2>().0.iter().map(|pair| of(*pair)).collect();
        String::from_utf16(&units).map_err(|_| "not UTF-16 text, as its first bytes say".to_string())
    };
    let text = match bytes {
        [0x1f, 0x8b, ..] => return Err("a gzip file; unpack it, as with `gunzip`".into()),
        _ if bytes.starts_with(b"MATLAB ") || bytes.starts_with(b"\x89HDF") => {
            return Err("a MATLAB file; write a table with `writematrix(frames, 'frames.csv')`".into());
        }
        [0xff, 0xfe, ..] => Cow::Owned(utf16(u16::from_le_bytes)?),
        [0xfe, 0xff, ..] => Cow::Owned(utf16(u16::from_be_bytes)?),
        // Every second byte of numbers is 0.
        _ if 3 * bytes.iter().filter(|byte| **byte == 0).count() > bytes.len() => {
            return Err("UTF-16 text without a byte-order mark, or no text; save it as UTF-8, NPY or NPZ".into());
        }
        _ if bytes.trim_ascii_start().starts_with(b"<") => {
            return Err("a page of HTML or XML, such as the error of a download; give a table: CSV, NPY or NPZ".into());
        }
        _ => match std::str::from_utf8(bytes) {
            Ok(text) => Cow::Borrowed(text.strip_prefix('\u{feff}').unwrap_or(text)),
            // Numbers are ASCII in all of them.
            Err(error) if bytes.contains(&0) => {
                return Err(format!("not text (byte {}); write CSV (UTF-8), NPY or NPZ", error.valid_up_to()));
            }
            Err(_) => Cow::Owned(bytes.iter().map(|&byte| char::from(byte)).collect()),
        },
    };
    Ok(if text.contains('\r') && !text.contains('\n') { Cow::Owned(text.replace('\r', "\n")) } else { text })
}

/// A line in two parts: a time of day or a date before the values (`12:00:01.5 -> 1.2`, `2024-05-01 12:00:00,1.2`) or a word
/// with a colon (`frame: 1.2`), and the values. The brackets of a list are dropped.
pub(super) fn values_of(line: &str) -> (&str, &str) {
    // A tab is an empty field.
    let mut rest = line.trim_start_matches(' ');
    if let Some((before, after)) = line.split_once("->")
        && before.split_whitespace().any(is_time)
    {
        rest = after.trim_start();
    }
    while let Some((word, after)) = rest.split_once([',', ';', '\t', ' '])
        && (is_time(word) || (is_label(word) && !has_labels(after)))
        && !after.trim().is_empty()
    {
        rest = after.trim_start_matches(' ');
    }
    let before = &line[..line.len() - rest.len()];
    let list = rest.trim_end().trim_end_matches(',');
    let inner = list.strip_prefix('[').and_then(|list| list.strip_suffix(']')).filter(|inner| !inner.contains('['));
    (before, inner.unwrap_or(rest))
}

/// Whether a word is a time of day or a date; neither is a number.
fn is_time(word: &str) -> bool {
    let word = word.trim_matches('"');
    let digits = word.bytes().filter(u8::is_ascii_digit).count();
    let marks = word.bytes().filter(|byte| b":-/.".contains(byte)).count();
    let is_plain = word.bytes().all(|byte| byte.is_ascii_digit() || b":-/.+TZ".contains(&byte));
    digits >= 3 && is_plain && word.as_bytes()[0].is_ascii_digit() && word.parse::<f64>().is_err() && marks >= 2
}

/// Whether values have names of their own, as in `a: 1.5, b: 2.5`: a name follows a value.
fn has_labels(values: &str) -> bool {
    let words = values.split([',', ';', '\t', ' ']).filter(|word| !word.is_empty());
    words.skip_while(|word| is_time(word) || is_label(word)).any(is_label)
}

/// Whether a word names the values that follow.
fn is_label(word: &str) -> bool {
    word.len() > 1 && word.ends_with(':') && word.starts_with(|first: char| first.is_alphabetic())
}

/// Whether the commas in a line are decimal commas: it has words of one number each, and no comma at an end of a word.
pub(super) fn has_decimal_commas(line: &str) -> bool {
    let is_number = |word: &str| {
        word.replacen(',', ".", 1).parse::<f64>().is_ok() && !word.starts_with(',') && !word.ends_with(',')
    };
    let mut words = line.split_whitespace();
    line.contains(',') && line.split_whitespace().count() > 1 && words.all(is_number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings_are_told_apart() {
        let utf16 = |of: fn(u16) -> [u8; 2]| "\u{feff}1,2\r\n".encode_utf16().flat_map(of).collect::<Vec<u8>>();
        for bytes in [utf16(u16::to_le_bytes), utf16(u16::to_be_bytes), b"\xef\xbb\xbf1,2\r\n".to_vec()] {
            assert_eq!(decode(&bytes).unwrap(), "1,2\r\n");
        }
        assert_eq!(decode(b"# 23 \xb0C\n1,2").unwrap(), "# 23 \u{b0}C\n1,2");
        assert_eq!(decode(b"1,2\r3,4\r").unwrap(), "1,2\n3,4\n");
        assert!(decode(&[0x1f, 0x8b, 8, 0]).unwrap_err().contains("gunzip"));
        assert!(decode(b"1\xff\0").unwrap_err().contains("not text (byte 1)"));
    }

    #[test]
    fn what_stands_before_the_values_is_no_value() {
        for (line, before) in [
            ("12:00:01.123 -> 1.5,2.5", "12:00:01.123 -> "),
            ("2024-05-01T12:00:00.1Z,1.5,2.5", "2024-05-01T12:00:00.1Z,"),
            ("05/01/2024 12:00:00:123;1.5,2.5", "05/01/2024 12:00:00:123;"),
            ("1.5.2024 1.5,2.5", "1.5.2024 "),
            ("magnitudes: 1.5,2.5", "magnitudes: "),
            ("log: magnitudes: 1.5,2.5", "log: magnitudes: "),
            ("[1.5,2.5],", ""),
            ("1.5,2.5", ""),
        ] {
            assert_eq!(values_of(line), (before, "1.5,2.5"), "{line}");
        }
        for line in ["-1.5-2,3", "1e-5,2", "1.5-2.5i,3+4i", "a,b", "a: 1.5, b: 2.5", "1 -> 2", "[1,2],[3,4]"] {
            assert_eq!(values_of(line), ("", line), "{line}");
        }
    }

    #[test]
    fn decimal_commas_are_told_from_separators() {
        assert!(["-93,581\t-41,439", "1,5 2 3,25", "1,5e-3 2,5"].into_iter().all(has_decimal_commas));
        assert!(!["1,2", "1, 2, 3", "1 ,2 ,3", "1,2,3 4,5,6", "1 2", "a,1 2,3"].into_iter().any(has_decimal_commas));
    }
}
