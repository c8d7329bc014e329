//! Files. Those that are read have a limited size: a device such as `/dev/zero`, or a file of many gigabytes, is an error
//! and fills no memory. Those that are written are there completely or not at all.

use sha2::{Digest, Sha256};
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Error, ErrorKind, IntoInnerError, Read, Result, Write};
use std::path::{Path, PathBuf};

/// Largest file of settings, such as a recipe, a script of touches or a state, bytes.
pub const MOST_SETTINGS_BYTES: u64 = 16 << 20;

/// Reads a file of at most some bytes.
///
/// # Errors
/// As [`std::fs::read`]; a file that is larger, with the limit.
pub fn read_at_most(path: &Path, most_bytes: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // One byte more distinguishes a file of exactly that size from a larger or endless one.
    File::open(path)?.take(most_bytes + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most_bytes {
        let message = format!("it is larger than {} MiB, the most that is read", most_bytes >> 20);
        return Err(Error::new(ErrorKind::FileTooLarge, message));
    }
    Ok(bytes)
}

/// Reads a text of at most some bytes.
///
/// # Errors
/// As [`read_at_most`]; a file that is not UTF-8.
pub fn read_text_at_most(path: &Path, most_bytes: u64) -> Result<String> {
    let not_text = |error: std::string::FromUtf8Error| {
        let at = error.utf8_error().valid_up_to();
        Error::new(ErrorKind::InvalidData, format!("it is not UTF-8 text (byte {at})"))
    };
    String::from_utf8(read_at_most(path, most_bytes)?).map_err(not_text)
}

/// SHA-256 of some bytes (FIPS 180-4).
pub fn sha256(bytes: &[u8]) -> [u8; 32] {
    Sha256::digest(bytes).into()
}

/// Writes a temporary file in the same folder and renames it when it is complete. After a full disk or an interrupted
/// run, an older file is unchanged. Special files (a pipe, a device) are written directly.
///
/// # Errors
/// A folder that does not exist or cannot be written; the errors of `fill`, usually a full disk.
pub fn write_whole(path: &Path, fill: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    if std::fs::metadata(path).is_ok_and(|found| !found.is_file()) {
        let mut writer = BufWriter::new(OpenOptions::new().write(true).open(path)?);
        fill(&mut writer)?;
        return writer.flush();
    }
    let mut writer = BufWriter::new(builder(0o666).tempfile_in(folder_of(path))?);
    fill(&mut writer)?;
    let file = writer.into_inner().map_err(IntoInnerError::into_error)?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// A folder that is made beside its place and renamed when it is complete. If it is dropped before, nothing is left of it.
#[derive(Debug)]
pub struct NewFolder {
    place: PathBuf,
    beside: tempfile::TempDir,
}

impl NewFolder {
    /// An empty folder for a place.
    ///
    /// # Errors
    /// A parent folder that does not exist or cannot be written.
    pub fn beside(place: &Path) -> Result<Self> {
        let beside = builder(0o777).tempdir_in(folder_of(place))?;
        let folder = NewFolder { place: place.to_path_buf(), beside };
        std::fs::create_dir(folder.path())?;
        Ok(folder)
    }

    /// Where it is until it is complete.
    pub fn path(&self) -> PathBuf {
        self.beside.path().join("new")
    }

    /// Renames it to its place. A folder that is there is removed.
    ///
    /// # Errors
    /// A place that cannot be written.
    pub fn finish(self) -> Result<()> {
        if self.place.exists() {
            // The old folder is removed with the temporary one.
            std::fs::rename(&self.place, self.beside.path().join("old"))?;
        }
        std::fs::rename(self.path(), &self.place)
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Temporary files are private by default; the result gets the permissions of any other new file or folder.
fn builder(mode: u32) -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".dermis-");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(mode));
    #[cfg(not(unix))]
    let _ = mode;
    builder
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn larger_files_are_refused_with_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, vec![b'a'; 1 << 20]).unwrap();
        assert_eq!(read_text_at_most(&path, 1 << 20).unwrap().len(), 1 << 20);
        std::fs::write(&path, vec![b'a'; (1 << 20) + 1]).unwrap();
        let error = read_at_most(&path, 1 << 20).unwrap_err();
        assert!(error.to_string().contains("larger than 1 MiB"), "{error}");
        std::fs::write(&path, [b'a', 0xff]).unwrap();
        assert!(read_text_at_most(&path, 9).unwrap_err().to_string().contains("UTF-8 text (byte 1)"));
        if cfg!(unix) {
            assert!(read_at_most(Path::new("/dev/zero"), 1 << 20).is_err());
        }
    }
}
