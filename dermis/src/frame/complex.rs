//! Complex values, of which a frame has one part.

use crate::frame::Table;

/// The part of complex values that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Real parts.
    Real,
    /// Imaginary parts.
    Imaginary,
    /// Magnitudes.
    Magnitude,
}

impl Part {
    /// This part of a complex value; NaN where either of its parts is.
    pub(super) fn of(self, [real, imaginary]: [f64; 2]) -> f64 {
        match self {
            _ if real.is_nan() || imaginary.is_nan() => f64::NAN,
            Part::Real => real,
            Part::Imaginary => imaginary,
            Part::Magnitude => real.hypot(imaginary),
        }
    }

    /// The first columns of pairs, or for imaginary parts the second ones. A column before the pairs stays.
    pub(super) fn of_pairs(self, mut table: Table) -> Result<Table, String> {
        let skipped = table.rows[0].len() % 2;
        let second = usize::from(self == Part::Imaginary);
        let is_chosen = |column: usize| column < skipped || (column - skipped) % 2 == second;
        let mut columns = 0..;
        table.header.iter_mut().for_each(|names| names.retain(|_| columns.next().is_some_and(is_chosen)));
        for (row, &file_row) in table.rows.iter_mut().zip(&table.file_rows) {
            let mut columns = 0..;
            row.retain(|_| columns.next().is_some_and(is_chosen));
            let negative = row[skipped..].iter().position(|value| *value < 0.0);
            if let Some(at) = negative.filter(|_| self == Part::Magnitude) {
                let column = skipped + 2 * at + 1;
                return Err(format!(
                    "row {file_row}, column {column} is negative and no magnitude: of pairs of real and imaginary parts the real \
                     ones are read, with --part real"
                ));
            }
        }
        Ok(table)
    }
}

/// A file with complex values, of which no part is chosen.
pub(super) fn without_part(count: usize) -> String {
    let values = if count == 1 { "1 complex value".to_string() } else { format!("{count} complex values") };
    format!(
        "it has {values}: choose their part with --part real, magnitude or imaginary; in a file that is not of frames, write \
         the part"
    )
}

/// The real and imaginary part of a complex number, as Python and MATLAB write it: `1.2+0.3i`, `(1.2-0.3j)`, `1.2 + 0.3*i`,
/// `0.3i`.
pub(super) fn complex(field: &str) -> Option<[f64; 2]> {
    let plain = field.trim().trim_matches(['(', ')', '"']).trim_end();
    let digits = plain.strip_suffix(['i', 'j'])?.trim_end();
    let digits: String = digits.strip_suffix('*').unwrap_or(digits).split_whitespace().collect();
    // NumPy's `savetxt` writes both signs.
    let digits = digits.replace("+-", "-");
    let is_sign = |(at, byte): (usize, u8)| {
        at > 0 && matches!(byte, b'+' | b'-') && !matches!(digits.as_bytes()[at - 1], b'e' | b'E')
    };
    let split = (0..digits.len()).rev().find(|&at| is_sign((at, digits.as_bytes()[at]))).unwrap_or(0);
    let (real, imaginary) = digits.split_at_checked(split)?;
    Some([if real.is_empty() { 0.0 } else { real.parse().ok()? }, imaginary.parse().ok()?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn complex_numbers_are_read_as_python_and_matlab_write_them() {
        for text in
            ["1.5-2e-3i", "(1.5-2e-3j)", "1.5 - 2e-3*i", " (1.5e+0-2E-3j) ", "(1.5+-2.0e-03j)", "\"1.5-0.002i\""]
        {
            assert_eq!(complex(text), Some([1.5, -2e-3]), "{text}");
        }
        assert_eq!(complex("-2e-3j"), Some([0.0, -2e-3]));
        assert_eq!(complex("-1e-2-3i"), Some([-0.01, -3.0]));
        assert!(complex("NaN+NaNi").is_some_and(|parts| parts[0].is_nan()));
        for text in ["1.5", "Vi", "i", "1.5+i2", "", "+i", "a1-2i", "µ-1i"] {
            assert_eq!(complex(text), None, "{text}");
        }
        let parts = [Part::Real, Part::Imaginary, Part::Magnitude].map(|part| part.of([3.0, -4.0]));
        assert_eq!(parts, [3.0, -4.0, 5.0]);
    }
}
