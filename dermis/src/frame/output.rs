//! Output files that are written completely or not at all.

use crate::frame::TableError;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes a temporary file in the same folder and renames it when it is complete. After a full disk or an interrupted
/// run, an older file is unchanged. Special files (a pipe, a device) are written directly.
///
/// # Errors
/// A folder that does not exist or cannot be written; the errors of `fill`, usually a full disk.
pub fn write_whole(path: &Path, fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<(), TableError> {
    let in_place = std::fs::metadata(path).is_ok_and(|found| !found.is_file());
    let written = if in_place { write_in_place(path, fill) } else { write_beside(path, fill) };
    written.map_err(|source| TableError::Io { path: path.to_path_buf(), source })
}

fn write_in_place(path: &Path, fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    let mut writer = BufWriter::new(std::fs::OpenOptions::new().write(true).open(path)?);
    fill(&mut writer)?;
    writer.flush()
}

fn write_beside(path: &Path, fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".dermis-");
    // Temporary files are private by default; the result gets the permissions of any other new file.
    #[cfg(unix)]
    let builder = builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut writer = BufWriter::new(builder.tempfile_in(folder)?);
    fill(&mut writer)?;
    let file = writer.into_inner().map_err(std::io::IntoInnerError::into_error)?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}
