//! NumPy's NPY files: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>.

use crate::frame::complex::{Part, without_part};
use crate::frame::table::MAX_VALUES;
use std::io::Write;

const MAGIC: &[u8] = b"\x93NUMPY";
/// Signs of the byte order of a type.
const ORDERS: [char; 4] = ['<', '>', '|', '='];

/// An array in C order.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Array {
    pub shape: Vec<usize>,
    pub values: Vec<f64>,
    /// Whether the values are parts of complex ones.
    pub is_complex: bool,
}

/// Whether some bytes are an NPY file.
pub(super) fn is_npy(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Whether some bytes are a ZIP, as an NPZ file is.
pub(super) fn is_npz(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06")
}

/// An NPY file: float64, float32, integers, booleans, or the `part` of complex values; C or Fortran order, either byte order.
pub(super) fn read_npy(bytes: &[u8], part: Option<Part>) -> Result<Array, String> {
    let short = || "the NPY header is cut short".to_string();
    let rest = bytes.strip_prefix(MAGIC).ok_or("not an NPY file")?;
    let (&major, rest) = rest.split_first().ok_or_else(short)?;
    let rest = rest.get(1..).ok_or_else(short)?;
    let (length, rest) = if major == 1 {
        let (length, rest) = rest.split_first_chunk::<2>().ok_or_else(short)?;
        (usize::from(u16::from_le_bytes(*length)), rest)
    } else {
        let (length, rest) = rest.split_first_chunk::<4>().ok_or_else(short)?;
        (u32::from_le_bytes(*length) as usize, rest)
    };
    let header = rest.get(..length).ok_or_else(short)?;
    let header = std::str::from_utf8(header).map_err(|_| "the NPY header is not text".to_string())?;
    let (kind, fortran, shape) = parse_header(header)?;
    let count = shape.iter().try_fold(1_usize, |count, &side| count.checked_mul(side));
    let byte_count = rest.len() - length;
    let is_complex = kind.trim_start_matches(ORDERS).starts_with('c');
    let longest = if is_complex { 2 * size_of::<f64>() } else { size_of::<f64>() };
    let is_large = |count: usize| count > MAX_VALUES || byte_count > longest.saturating_mul(count);
    if byte_count > MAX_VALUES && count.is_none_or(is_large) {
        return Err(format!("{byte_count} bytes of the shape {shape:?}: at most {MAX_VALUES} values are read"));
    }
    let mut values = decode(&rest[length..], &kind)?;
    if is_complex {
        let (pairs, _) = values.as_chunks::<2>();
        let part = part.ok_or_else(|| without_part(pairs.len()))?;
        values = pairs.iter().map(|parts| part.of(*parts)).collect();
    }
    if count != Some(values.len()) {
        return Err(format!("the shape is {shape:?}, but there are {} values", values.len()));
    }
    let values = if fortran { from_fortran(&values, &shape) } else { values };
    Ok(Array { shape, values, is_complex })
}

/// Type, order and shape from a header such as `{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }`.
fn parse_header(header: &str) -> Result<(String, bool, Vec<usize>), String> {
    let entry = |key: &str| {
        let at = header.find(&format!("'{key}'")).ok_or_else(|| format!("the NPY header has no `{key}`"))?;
        let rest = header[at + key.len() + 2..].trim_start();
        Ok::<&str, String>(rest.strip_prefix(':').unwrap_or(rest).trim_start())
    };
    let kind = entry("descr")?;
    let kind = kind
        .strip_prefix('\'')
        .and_then(|rest| rest.split('\'').next())
        .ok_or("the NPY file holds records, not plain numbers")?;
    let fortran = entry("fortran_order")?.starts_with("True");
    let shape =
        entry("shape")?.strip_prefix('(').and_then(|rest| rest.split_once(')')).ok_or("the NPY header has no shape")?.0;
    let side = |text: &str| text.trim().parse::<usize>().map_err(|_| format!("the NPY shape is ({shape})"));
    let shape = shape.split(',').filter(|text| !text.trim().is_empty()).map(side).collect::<Result<_, _>>()?;
    Ok((kind.to_string(), fortran, shape))
}

/// The values of a block of bytes.
fn decode(bytes: &[u8], kind: &str) -> Result<Vec<f64>, String> {
    macro_rules! numbers {
        ($type:ty) => {{
            let (chunks, rest) = bytes.as_chunks::<{ size_of::<$type>() }>();
            if !rest.is_empty() {
                return Err("the NPY file is cut short".into());
            }
            let big = kind.starts_with('>');
            let read = |chunk: &[u8; size_of::<$type>()]| {
                (if big { <$type>::from_be_bytes(*chunk) } else { <$type>::from_le_bytes(*chunk) }) as f64
            };
            Ok(chunks.iter().map(read).collect())
        }};
    }
    match kind.trim_start_matches(ORDERS) {
        "f8" | "c16" => numbers!(f64),
        "f4" | "c8" => numbers!(f32),
        "i8" => numbers!(i64),
        "i4" => numbers!(i32),
        "i2" => numbers!(i16),
        "i1" => numbers!(i8),
        "u8" => numbers!(u64),
        "u4" => numbers!(u32),
        "u2" => numbers!(u16),
        "u1" | "b1" => numbers!(u8),
        _ => Err(format!("the NPY type `{kind}` is no number; write float64")),
    }
}

/// Converts values from Fortran order (the first index runs fastest) to C order.
fn from_fortran(values: &[f64], shape: &[usize]) -> Vec<f64> {
    let mut sorted = Vec::with_capacity(values.len());
    let mut index = vec![0_usize; shape.len()];
    for _ in 0..values.len() {
        let at = index.iter().zip(shape).rev().fold(0, |at, (&i, &side)| at * side + i);
        sorted.push(values[at]);
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            if index[axis] < shape[axis] {
                break;
            }
            index[axis] = 0;
        }
    }
    sorted
}

/// The header of an NPY file of version 1.0 in C order; the type in NumPy notation, such as `<f8`.
pub fn npy_header(dtype: &str, shape: &[usize]) -> Vec<u8> {
    let sides: Vec<String> = shape.iter().map(|side| format!("{side},")).collect();
    let sides = sides.join(" ");
    let sides = if shape.len() == 1 { sides.as_str() } else { sides.trim_end_matches(',') };
    let mut text = format!("{{'descr': '{dtype}', 'fortran_order': False, 'shape': ({sides}), }}");
    // The data start at a multiple of 64 bytes: magic 6, version 2, length 2, header, newline.
    let padding = (64 - (text.len() + 11) % 64) % 64;
    text.extend(std::iter::repeat_n(' ', padding));
    text.push('\n');
    let mut header = [MAGIC, &[1, 0]].concat();
    header.extend((text.len() as u16).to_le_bytes());
    header.extend(text.into_bytes());
    header
}

/// Writes an NPY file: float64, little-endian, C order.
pub(super) fn write_npy(writer: &mut dyn Write, shape: &[usize], values: &[f64]) -> std::io::Result<()> {
    writer.write_all(&npy_header("<f8", shape))?;
    for value in values {
        writer.write_all(&value.to_le_bytes())?;
    }
    Ok(())
}
