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
        value.ok_or_else(|| format!("it must be a number from {} to {}", short(range.start()), short(range.end())))
    }
}

/// A limit as text; with a power of ten where it has more than the 20 digits of the largest whole numbers.
fn short(limit: &impl Display) -> String {
    let text = limit.to_string();
    match text.parse::<f64>() {
        Ok(value) if text.len() > 20 => format!("{value:e}"),
        _ => text,
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

/// Units of sizes, bytes.
const SIZES: [(&str, f64); 7] = [
    ("MB", 1e6),
    ("GB", 1e9),
    ("TB", 1e12),
    ("KiB", 1024.0),
    ("MiB", 1_048_576.0),
    ("GiB", 1_073_741_824.0),
    ("TiB", 1_099_511_627_776.0),
];
/// Units of times, s.
const TIMES: [(&str, f64); 3] = [("s", 1.0), ("min", 60.0), ("h", 3600.0)];
const SMALLEST_BYTES: f64 = 1_048_576.0;
const LARGEST_BYTES: f64 = 1024.0 * 1_099_511_627_776.0;
const LONGEST_S: f64 = 1000.0 * 3600.0;

/// A size of a file, bytes, with its unit.
pub fn size(text: &str) -> Result<u64, String> {
    let bytes = with_unit(text, &SIZES).filter(|bytes| (SMALLEST_BYTES..=LARGEST_BYTES).contains(bytes));
    bytes.map(|bytes| bytes as u64).ok_or_else(|| format!("it must be {SIZE}"))
}

const SIZE: &str = "a size from 1MiB to 1024TiB, as in 500MB or 1GiB";

/// The size or the time of a part of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Part {
    Bytes(u64),
    Seconds(f64),
}

/// A size or a time with its unit.
pub fn part(text: &str) -> Result<Part, String> {
    let time = with_unit(text, &TIMES).filter(|seconds| (1.0..=LONGEST_S).contains(seconds));
    let part = size(text).map(Part::Bytes).ok().or(time.map(Part::Seconds));
    part.ok_or_else(|| format!("it must be {SIZE}, or a time from 1s to 1000h, as in 10min"))
}

fn with_unit(text: &str, units: &[(&str, f64)]) -> Option<f64> {
    let (number, unit) = text.trim().split_at(text.trim().find(|character: char| character.is_ascii_alphabetic())?);
    let (_, factor) = units.iter().find(|(name, _)| *name == unit)?;
    Some(number.trim().parse::<f64>().ok()? * factor)
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
        assert_eq!(number(1e-60..=1e60)("foo").unwrap_err(), "it must be a number from 1e-60 to 1e60");
        let frames = count(0..=10usize);
        assert_eq!(frames("10"), Ok(10));
        for wrong in ["11", "-1", "1e11", "1.5", "99999999999999999999999"] {
            assert_eq!(frames(wrong).unwrap_err(), "it must be a whole number from 0 to 10", "{wrong}");
        }
        assert_eq!(seed("9007199254740992"), Ok(LARGEST_SEED));
        assert!(seed("9007199254740993").is_err());
    }

    #[test]
    fn sizes_and_times_have_units() {
        assert_eq!(size("1GiB"), Ok(1 << 30));
        assert_eq!(size(" 1.5 MB"), Ok(1_500_000));
        for (text, seconds) in [("10min", 600.0), ("1s", 1.0), ("0.5h", 1800.0)] {
            assert_eq!(part(text), Ok(Part::Seconds(seconds)));
        }
        assert_eq!(part("2048KiB"), Ok(Part::Bytes(1 << 21)));
        for wrong in
            ["", "5", "GiB", "0GiB", "-1GiB", "nanMB", "infMB", "1e9TiB", "1gib", "0.5s", "1e9h", "1MiB1", "1m"]
        {
            assert!(part(wrong).unwrap_err().contains("a time from 1s to 1000h"), "{wrong}");
            assert!(size(wrong).unwrap_err().contains("from 1MiB to 1024TiB"), "{wrong}");
        }
    }
}
