//! Wavefront OBJ files: vertices and faces; polygons are split into fans of triangles.

use super::cursor::{Cursor, Problem, quote};
use super::soup::Soup;

/// Other statements of an OBJ file; they do not affect the surface's shape.
const IGNORED: [&[u8]; 13] =
    [b"vt", b"vn", b"vp", b"o", b"g", b"s", b"mg", b"usemtl", b"mtllib", b"usemap", b"maplib", b"l", b"p"];

pub(super) fn read(bytes: &[u8]) -> Result<Soup, Problem> {
    let mut soup = Soup::default();
    let mut cursor = Cursor::new(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes));
    let mut corners = Vec::new();
    while let Some(line) = cursor.line() {
        let mut words = Cursor::new(line.split(|&byte| byte == b'#').next().unwrap_or_default());
        match words.word() {
            b"" => {}
            b"v" => {
                let mut coordinate = || words.finite("a coordinate").map_err(|problem| in_line(&cursor, &problem));
                soup.points.push([coordinate()?, coordinate()?, coordinate()?]);
            }
            b"f" => {
                corners.clear();
                while !words.at_end() {
                    corners
                        .push(corner(words.word(), soup.points.len()).map_err(|problem| in_line(&cursor, &problem))?);
                }
                if corners.len() < 3 {
                    return Err(cursor.problem(format!("a face with {} corners", corners.len())));
                }
                soup.add_polygon(&corners);
            }
            word if IGNORED.contains(&word) => {}
            word => return Err(cursor.problem(format!("{} does not belong in an OBJ file", quote(word)))),
        }
    }
    Ok(soup)
}

/// Converts an error of one line to an error of the file.
fn in_line(cursor: &Cursor<'_>, problem: &Problem) -> Problem {
    cursor.problem(problem.0.strip_prefix("line 1: ").unwrap_or(&problem.0))
}

/// The vertex of `7`, `7/2`, `7/2/3` or, relative to the last, `-1`.
fn corner(word: &[u8], known: usize) -> Result<usize, Problem> {
    let digits = word.split(|&byte| byte == b'/').next().unwrap_or_default();
    let number: Option<i64> = std::str::from_utf8(digits).ok().and_then(|text| text.parse().ok());
    let Some(number) = number else { return Err(Problem(format!("{} is not a vertex", quote(word)))) };
    let index = if number < 0 { number.saturating_add_unsigned(known as u64) } else { number - 1 };
    match usize::try_from(index) {
        // A face may use vertices that are defined later; this is checked at the end.
        Ok(index) => Ok(index),
        Err(_) => Err(Problem(format!("{} is not a vertex: they are numbered from 1", quote(word)))),
    }
}
