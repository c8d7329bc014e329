//! NumPy's NPY and NPZ files: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>.

use std::io::{Cursor, Read, Seek, Write};
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

const MAGIC: &[u8] = b"\x93NUMPY";

/// An array in C order.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Array {
    pub shape: Vec<usize>,
    pub values: Vec<f64>,
}

/// Whether some bytes are an NPY file.
pub(super) fn is_npy(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Whether some bytes are a ZIP, as an NPZ file is.
pub(super) fn is_npz(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06")
}

/// The one array of an NPZ file, or the one called `name` if there are several.
pub(super) fn read_npz(bytes: &[u8], name: &str) -> Result<Array, String> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| format!("not an NPZ file: {error}"))?;
    let names: Vec<String> = archive.file_names().filter_map(|name| Some(name.ok()?.into_owned())).collect();
    let wanted = format!("{name}.npy");
    let chosen = match names.as_slice() {
        [only] => only.clone(),
        _ if names.contains(&wanted) => wanted,
        _ => {
            let listed: Vec<&str> = names.iter().map(|name| name.trim_end_matches(".npy")).collect();
            return Err(format!("no array `{name}` among {}: {}", names.len(), listed.join(", ")));
        }
    };
    let mut file = archive.by_name(&chosen).map_err(|error| format!("{chosen}: {error}"))?;
    let mut array = Vec::new();
    file.read_to_end(&mut array).map_err(|error| format!("{chosen}: {error}"))?;
    read_npy(&array)
}

/// An NPY file: float64, float32, integers or booleans, C or Fortran order, either byte order.
pub(super) fn read_npy(bytes: &[u8]) -> Result<Array, String> {
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
    let values = decode(&rest[length..], &kind)?;
    if count != Some(values.len()) {
        return Err(format!("the shape is {shape:?}, but there are {} values", values.len()));
    }
    let values = if fortran { from_fortran(&values, &shape) } else { values };
    Ok(Array { shape, values })
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
    match kind.trim_start_matches(['<', '>', '|', '=']) {
        "f8" => numbers!(f64),
        "f4" => numbers!(f32),
        "i8" => numbers!(i64),
        "i4" => numbers!(i32),
        "i2" => numbers!(i16),
        "i1" => numbers!(i8),
        "u8" => numbers!(u64),
        "u4" => numbers!(u32),
        "u2" => numbers!(u16),
        "u1" | "b1" => numbers!(u8),
        _ => Err(format!("the NPY type `{kind}` is no real number; write float64")),
    }
}

/// Values in Fortran order (the first index runs fastest) brought into C order.
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

/// Writes an NPY file of version 1.0: float64, little-endian, C order.
pub(super) fn write_npy(writer: &mut dyn Write, shape: &[usize], values: &[f64]) -> std::io::Result<()> {
    let sides: Vec<String> = shape.iter().map(|side| format!("{side},")).collect();
    let sides = sides.join(" ");
    let sides = if shape.len() == 1 { sides.as_str() } else { sides.trim_end_matches(',') };
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({sides}), }}");
    // The data begin at a multiple of 64 bytes: magic 6, version 2, length 2, header, newline.
    let padding = (64 - (header.len() + 11) % 64) % 64;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    writer.write_all(MAGIC)?;
    writer.write_all(&[1, 0])?;
    writer.write_all(&(header.len() as u16).to_le_bytes())?;
    writer.write_all(header.as_bytes())?;
    for value in values {
        writer.write_all(&value.to_le_bytes())?;
    }
    Ok(())
}

/// Writes an NPZ file with one array, compressed.
pub(super) fn write_npz(writer: &mut dyn Write, name: &str, shape: &[usize], values: &[f64]) -> std::io::Result<()> {
    let mut buffer = Cursor::new(Vec::new());
    let mut archive = ZipWriter::new(&mut buffer);
    // The date of a file would make equal results differ.
    let options = SimpleFileOptions::default().last_modified_time(zip::DateTime::default()).large_file(true);
    archive.start_file(format!("{name}.npy"), options).map_err(std::io::Error::other)?;
    write_npy(&mut archive, shape, values)?;
    archive.finish().map_err(std::io::Error::other)?;
    buffer.rewind()?;
    writer.write_all(buffer.get_ref())
}
