//! Files. Those that are read have a limited size: a device such as `/dev/zero`, or a file of many gigabytes, is an error
//! and fills no memory. Those that are written are there completely or not at all.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Error, ErrorKind, IntoInnerError, Read, Result, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Largest file of settings, such as a recipe, a script of touches or a state, bytes.
pub const MAX_SETTINGS_BYTES: u64 = 16 << 20;

/// Reads a list of a settings file that has a fixed length. (As an array alone, what is too much of a longer list is lost.)
///
/// # Errors
/// A list of another length, or an element of another type.
pub fn exactly<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    deserializer: D,
) -> std::result::Result<[T; N], D::Error> {
    let values = Vec::<T>::deserialize(deserializer)?;
    let wrong = |values: Vec<T>| D::Error::custom(format!("the list has {} values, not {N}", values.len()));
    values.try_into().map_err(wrong)
}

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

/// The ending of a file's name in small letters; empty for none.
pub fn ending(path: &Path) -> String {
    path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
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
    let mut writer = BufWriter::new(temporary_file(folder_of(path))?);
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
    /// Locked while this process works on the folder.
    _lock: File,
}

impl NewFolder {
    /// An empty folder for a place.
    ///
    /// # Errors
    /// A parent folder that does not exist or cannot be written.
    pub fn beside(place: &Path) -> Result<Self> {
        let (beside, lock) = temporary_folder(folder_of(place))?;
        let folder = NewFolder { place: place.to_path_buf(), beside, _lock: lock };
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

/// Whether a file or folder can be written, before work on its contents begins. A folder's parents need not exist.
///
/// # Errors
/// A folder in place of a file, or a file in place of a folder; a folder that does not exist or cannot be written.
pub fn check_writable(path: &Path, is_folder: bool) -> Result<()> {
    let found = std::fs::metadata(path).ok();
    let is_of_kind = found.as_ref().is_none_or(|found| found.is_dir() == is_folder);
    if !is_of_kind {
        let (kind, wanted) = if is_folder { ("a file", "folder") } else { ("a folder", "file") };
        return Err(Error::new(ErrorKind::InvalidInput, format!("it is {kind}: name a {wanted}")));
    }
    if found.is_some_and(|found| !found.is_file() && !found.is_dir()) {
        return Ok(());
    }
    let existing = path.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("."));
    let folder = if is_folder { existing } else { folder_of(path) };
    check_folder(folder)?;
    made_in(folder, || builder(0o666).tempfile_in(folder)).map(drop)
}

/// Makes a temporary file or folder; an error names the folder and not the temporary name.
fn made_in<T>(folder: &Path, make: impl FnOnce() -> Result<T>) -> Result<T> {
    make().map_err(|error| {
        let message = format!("the folder {} cannot be written ({}): name another", folder.display(), error.kind());
        Error::new(error.kind(), message)
    })
}

/// The folder that a file or folder lies in; `.` for a mere name.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A new temporary file, locked until it is closed: the lock tells other processes that it is in use.
fn temporary_file(folder: &Path) -> Result<tempfile::NamedTempFile> {
    check_folder(folder)?;
    remove_abandoned(folder);
    loop {
        let file = made_in(folder, || builder(0o666).tempfile_in(folder))?;
        if is_kept(file.as_file(), file.path()) {
            return Ok(file);
        }
    }
}

/// The same for a folder, whose lock is a file in it.
fn temporary_folder(folder: &Path) -> Result<(tempfile::TempDir, File)> {
    check_folder(folder)?;
    remove_abandoned(folder);
    loop {
        let made = made_in(folder, || builder(0o777).tempdir_in(folder))?;
        let path = made.path().join(LOCK);
        // Without this file another process may have taken the folder for an abandoned one.
        if let Ok(lock) = File::create(&path)
            && is_kept(&lock, &path)
        {
            return Ok((made, lock));
        }
    }
}

/// A folder that is missing, by its own name instead of that of a temporary file in it.
fn check_folder(folder: &Path) -> Result<()> {
    match folder.is_dir() {
        true => Ok(()),
        false => {
            let message = format!("there is no folder {}: make it first, or name another", folder.display());
            Err(Error::new(ErrorKind::NotFound, message))
        }
    }
}

/// Locks a file that was just made; false if another process has removed it before. A file system without locks keeps
/// all files.
fn is_kept(file: &File, path: &Path) -> bool {
    let _ = file.lock();
    path.exists()
}

/// Removes what processes that were killed have left in a folder, once for each folder that this process writes to. What
/// cannot be removed stays: it is in nobody's way.
fn remove_abandoned(folder: &Path) {
    static SEEN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    if !SEEN.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_path_buf()) {
        return;
    }
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_name().to_str().is_some_and(|name| name.starts_with(PREFIX)) {
            let _ = remove_if_abandoned(&entry.path());
        }
    }
}

/// Removes a temporary file or folder unless a process holds its lock. A folder that was killed between the two steps of
/// [`NewFolder::finish`] holds the only copy of the old folder and is kept.
fn remove_if_abandoned(path: &Path) -> Result<()> {
    if std::fs::symlink_metadata(path)?.is_file() {
        OpenOptions::new().write(true).open(path)?.try_lock()?;
        return std::fs::remove_file(path);
    }
    let lock = OpenOptions::new().write(true).open(path.join(LOCK))?;
    lock.try_lock()?;
    match path.join("old").exists() && path.join("new").exists() {
        true => Ok(()),
        false => std::fs::remove_dir_all(path),
    }
}

/// Prefix of the names of temporary files and folders.
const PREFIX: &str = ".dermis-";
/// The file of a temporary folder that is locked.
const LOCK: &str = "lock";

/// Temporary files are private by default; the result gets the permissions of any other new file or folder.
fn builder(mode: u32) -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX);
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

    #[test]
    fn what_killed_processes_left_is_removed_and_what_is_in_use_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let in_use = builder(0o666).tempfile_in(folder.path()).unwrap();
        std::fs::create_dir(at(".dermis-used")).unwrap();
        let lock = File::create(at(".dermis-used").join(LOCK)).unwrap();
        [in_use.as_file(), &lock].into_iter().for_each(|file| file.lock().unwrap());
        // A killed process leaves files and folders without a lock on them.
        std::fs::write(at(".dermis-file"), "half").unwrap();
        for (name, contents) in [(".dermis-folder", &["new"][..]), (".dermis-replaced", &["new", "old"])] {
            contents.iter().for_each(|inner| std::fs::create_dir_all(at(name).join(inner)).unwrap());
            std::fs::write(at(name).join(LOCK), "").unwrap();
        }
        std::fs::write(at("other"), "").unwrap();
        write_whole(&at("written"), |out| out.write_all(b"whole")).unwrap();
        assert!(!at(".dermis-file").exists() && !at(".dermis-folder").exists());
        assert!(at(".dermis-replaced").join("old").exists() && at("other").exists() && at("written").exists());
        assert!(in_use.path().exists() && at(".dermis-used").exists());
    }
}
