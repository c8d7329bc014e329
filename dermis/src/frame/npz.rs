//! NPZ files: ZIP archives of NPY files.

use crate::frame::complex::Part;
use crate::frame::npy::{Array, read_npy, write_npy};
use crate::frame::read::BASELINE;
use crate::frame::table::LARGEST_FILE;
use std::io::{Cursor, Read, Write};
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

const FRAMES: &str = "frames.npy";

/// The only array of an NPZ file, or the one called `name` if there are several; without a `baseline`, `frames`.
pub(super) fn read_npz(bytes: &[u8], name: &str, part: Option<Part>) -> Result<Array, String> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| format!("not an NPZ file: {error}"))?;
    let names: Vec<String> = archive.file_names().filter_map(|name| Some(name.ok()?.into_owned())).collect();
    let wanted = format!("{name}.npy");
    let chosen = match names.as_slice() {
        [only] => only.clone(),
        _ if names.contains(&wanted) => wanted,
        _ if name == BASELINE && names.iter().any(|name| name == FRAMES) => FRAMES.into(),
        _ => {
            let listed: Vec<&str> = names.iter().map(|name| name.trim_end_matches(".npy")).collect();
            return Err(format!("no array `{name}` among {}: {}", names.len(), listed.join(", ")));
        }
    };
    let file = archive.by_name(&chosen).map_err(|error| format!("{chosen}: {error}"))?;
    let mut array = Vec::new();
    file.take(LARGEST_FILE + 1).read_to_end(&mut array).map_err(|error| format!("{chosen}: {error}"))?;
    if array.len() as u64 > LARGEST_FILE {
        return Err(format!("{chosen} is larger than {} MiB, the most that is read", LARGEST_FILE >> 20));
    }
    read_npy(&array, part)
}

/// Writes an NPZ file with one array, compressed.
pub(super) fn write_npz(writer: &mut dyn Write, name: &str, shape: &[usize], values: &[f64]) -> std::io::Result<()> {
    let mut buffer = Cursor::new(Vec::new());
    let mut archive = ZipWriter::new(&mut buffer);
    // A fixed date, so that equal results give equal files.
    let options = SimpleFileOptions::default().last_modified_time(zip::DateTime::default()).large_file(true);
    archive.start_file(format!("{name}.npy"), options).map_err(std::io::Error::other)?;
    write_npy(&mut archive, shape, values)?;
    archive.finish().map_err(std::io::Error::other)?;
    writer.write_all(buffer.get_ref())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 300 MB of zeros in an archive of less than one.
    #[test]
    fn a_small_archive_with_a_large_array_is_refused() {
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        archive.start_file("frames.npy", SimpleFileOptions::default()).unwrap();
        (0..300).for_each(|_| archive.write_all(&vec![0; 1 << 20]).unwrap());
        let bytes = archive.finish().unwrap().into_inner();
        assert!(bytes.len() < 1 << 20);
        let error = read_npz(&bytes, "frames", None).unwrap_err();
        assert!(error.contains("larger than 256 MiB"), "{error}");
    }
}
