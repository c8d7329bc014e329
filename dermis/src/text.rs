//! Counts in messages.

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
