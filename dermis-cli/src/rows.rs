//! Rows of a table, as arguments name them.

use crate::failure::{Failure, Outcome};
use std::str::FromStr;

/// Rows by number, from 0: `0..500` (the end is not included), `7`, or several of these separated by commas.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rows(Vec<usize>);

/// A table of more rows is a mistake.
const MAX_ROWS: usize = 10_000_000;

impl FromStr for Rows {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| {
            text.trim().parse::<usize>().map_err(|_| format!("`{}` is not the number of a row", text.trim()))
        };
        let mut rows = Vec::new();
        for part in text.split(',') {
            let (first, end) = match part.split_once("..") {
                Some((first, end)) => (number(first)?, number(end)?),
                None => (number(part)?, number(part)?.saturating_add(1)),
            };
            if end <= first || end - first > MAX_ROWS {
                return Err(format!("`{part}` is not a range of rows: write 0..500 for the rows 0 to 499"));
            }
            rows.extend(first..end);
            if rows.len() > MAX_ROWS {
                return Err(format!("the ranges name more than {MAX_ROWS} rows"));
            }
        }
        rows.sort_unstable();
        rows.dedup();
        Ok(Rows(rows))
    }
}

/// The rows that an option chooses of `count`, ascending; all of them without a choice.
pub fn chosen(rows: Option<&Rows>, count: usize, option: &str) -> Outcome<Vec<usize>> {
    let Some(rows) = rows else { return Ok((0..count).collect()) };
    let chosen = rows.of(count).map_err(|message| Failure::given(message, Some(&format!("choose other {option}"))))?;
    Ok(chosen.to_vec())
}

impl Rows {
    /// The rows, ascending, where there are `count`.
    fn of(&self, count: usize) -> Result<&[usize], String> {
        match self.0.iter().find(|row| **row >= count) {
            Some(row) if count == 0 => Err(format!("row {row} does not exist: there are no rows")),
            Some(row) => Err(format!("row {row} does not exist: the rows are 0 to {}", count - 1)),
            None => Ok(&self.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_and_numbers_are_read() {
        let rows: Rows = "3..6,1, 4..5".parse().unwrap();
        assert_eq!(rows.of(6), Ok(&[1, 3, 4, 5][..]));
        assert_eq!(rows.of(5).unwrap_err(), "row 5 does not exist: the rows are 0 to 4");
        // The first one that is missing.
        let rows: Rows = "5..9".parse().unwrap();
        assert_eq!(rows.of(2).unwrap_err(), "row 5 does not exist: the rows are 0 to 1");
        assert_eq!(rows.of(0).unwrap_err(), "row 5 does not exist: there are no rows");
        for wrong in ["", "5..5", "a..b", "1-3", "-1"] {
            assert!(wrong.parse::<Rows>().is_err(), "{wrong}");
        }
    }
}
