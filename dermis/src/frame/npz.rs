//! NPZ files: ZIP archives of NPY files.

use crate::frame::npy::{Array, read_npy, write_npy};
use std::io::{Cursor, Read, Write};
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

/// The only array of an NPZ file, or the one called `name` if there are several.
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
