//! Ranges of numbers in arguments: checked while the arguments are read, before any work.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Largest seed: every whole number up to it is exact in JSON and in a double, and the seeds after it do not overflow.
const LARGEST_SEED: u64 = 1 << 53;

/// A number in a range; neither NaN nor infinite.
pub fn number<T>(range: RangeInclusive<T>) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static,
{
    move |text: &str| {
        let value = text.trim().parse::<T>().ok().filter(|value| range.contains(value));
        value.ok_or_else(|| format!("it must be a number from {} to {}", range.start(), range.end()))
    }
}

/// A whole number in a range.
pub fn count<T>(range: RangeInclusive<T>) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static,
{
    let number = number(range);
    move |text: &str| number(text).map_err(|why| why.replace("a number", "a whole number"))
}

/// A seed.
pub fn seed(text: &str) -> Result<u64, String> {
    count(0..=LARGEST_SEED)(text)
}

/// An argument that has a parser of its own.
pub fn parsed<T: FromStr<Err: Display>>(text: &str) -> Result<T, String> {
    text.parse().map_err(|error: T::Err| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_outside_their_range_name_it() {
        let speed = number(0.001..=1000.0);
        assert_eq!(speed("4"), Ok(4.0));
        for wrong in ["0", "-1", "nan", "inf", "1e-300", "1e300", "", "x"] {
            assert_eq!(speed(wrong).unwrap_err(), "it must be a number from 0.001 to 1000", "{wrong}");
        }
        let frames = count(0..=10usize);
        assert_eq!(frames("10"), Ok(10));
        for wrong in ["11", "-1", "1e11", "1.5", "99999999999999999999999"] {
            assert_eq!(frames(wrong).unwrap_err(), "it must be a whole number from 0 to 10", "{wrong}");
        }
        assert_eq!(seed("9007199254740992"), Ok(LARGEST_SEED));
        assert!(seed("9007199254740993").is_err());
    }
}
