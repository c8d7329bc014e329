//! STL files, ASCII and binary.

use super::cursor::{Cursor, Problem, quote};
use super::soup::Soup;

/// Bytes before the triangles of a binary file: a header of 80 and their number.
const HEADER: usize = 84;
/// Bytes of a triangle: a normal, three corners and two spare bytes.
const TRIANGLE: usize = 50;

pub(super) fn read(bytes: &[u8]) -> Result<Soup, Problem> {
    let claimed = bytes.get(80..HEADER).map(|n| u32::from_le_bytes([n[0], n[1], n[2], n[3]]) as usize);
    // Some binary files also start with "solid": only their length identifies them.
    if let Some(count) = claimed.filter(|count| bytes.len() == HEADER + TRIANGLE * count) {
        return Ok(binary(bytes, count));
    }
    let is_solid = bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    // No text has a zero byte.
    if is_solid && !bytes.contains(&0) {
        return ascii(bytes);
    }
    let what = |promised: usize| match bytes.len() < promised {
        _ if !is_solid => "not an STL file, or a damaged binary one",
        true => "cut short",
        false => "a wrong number of triangles",
    };
    Err(Problem(match claimed {
        Some(count) => format!(
            "{}: as a binary file its header promises {count} triangles, but there are {}: write it again",
            what(HEADER + TRIANGLE * count),
            (bytes.len() - HEADER) / TRIANGLE,
        ),
        None if is_solid => "cut short: a binary STL file that ends within its header".into(),
        None => "not an STL file: it does not start with `solid`, and is too short for a binary file".into(),
    }))
}

fn binary(bytes: &[u8], count: usize) -> Soup {
    let mut soup = Soup::default();
    for triangle in bytes[HEADER..].chunks_exact(TRIANGLE).take(count) {
        let mut numbers = triangle[12..48].as_chunks::<4>().0.iter().map(|&bytes| f64::from(f32::from_le_bytes(bytes)));
        let start = soup.points.len();
        for _ in 0..3 {
            soup.points.push([(); 3].map(|()| numbers.next().unwrap_or(f64::NAN)));
        }
        soup.triangles.push([start, start + 1, start + 2]);
    }
    soup
}

fn ascii(bytes: &[u8]) -> Result<Soup, Problem> {
    let mut soup = Soup::default();
    let mut cursor = Cursor::new(bytes);
    let mut corners = 0;
    let mut is_open = false;
    while !cursor.at_end() {
        let word = cursor.word().to_ascii_lowercase();
        match word.as_slice() {
            b"solid" => {
                is_open = true;
                cursor.line();
            }
            b"endsolid" => {
                is_open = false;
                cursor.line();
            }
            b"facet" | b"outer" => {
                cursor.line();
            }
            b"endfacet" => {}
            b"vertex" => {
                soup.points.push([cursor.finite(COORDINATE)?, cursor.finite(COORDINATE)?, cursor.finite(COORDINATE)?]);
                corners += 1;
            }
            b"endloop" if corners == 3 => {
                let end = soup.points.len();
                soup.triangles.push([end - 3, end - 2, end - 1]);
                corners = 0;
            }
            b"endloop" => return Err(cursor.problem(format!("a facet with {corners} corners: it must have 3"))),
            _ => return Err(cursor.problem(format!("{} does not belong in an STL file", quote(&word)))),
        }
    }
    if is_open {
        return Err(cursor.problem("the file ends without `endsolid`"));
    }
    Ok(soup)
}

const COORDINATE: &str = "a coordinate";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_binary_file_of_another_length_is_told_with_both_numbers() {
        let file = |start: &str, count: u32, triangles: usize| {
            let mut bytes = format!("{start:<80}").into_bytes();
            bytes.extend(count.to_le_bytes());
            bytes.resize(HEADER + TRIANGLE * triangles, 0);
            read(&bytes).map(|soup| soup.triangles.len()).map_err(|problem| problem.0)
        };
        for start in ["solid CAD", "CAD"] {
            assert_eq!(file(start, 12, 12), Ok(12));
            for count in [12, 5] {
                let error = file(start, count, 7).unwrap_err();
                assert!(error.contains(&format!("promises {count} triangles, but there are 7")), "{error}");
            }
        }
        assert!(file("solid CAD", 12, 7).unwrap_err().starts_with("cut short"));
    }
}
