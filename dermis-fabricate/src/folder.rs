//! The folder of outputs: all files and their manifest, or nothing.

use crate::error::FabricateError;
use dermis::files::{NewFolder, sha256};
use dermis::text::hexadecimal;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file that lists the others.
const MANIFEST: &str = "manifest.json";

/// A file for the workshop.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputFile {
    /// Its path in the folder, with `/`.
    pub path: String,
    /// What it is for, as a phrase.
    pub purpose: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

impl OutputFile {
    /// A file.
    pub(crate) fn new(path: impl Into<String>, purpose: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Self {
        OutputFile { path: path.into(), purpose: purpose.into(), bytes: bytes.into() }
    }
}

/// The list of a folder's files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Name of the design.
    pub(crate) design: String,
    /// SHA-256 of the skin (body, electrodes and protocol), hexadecimal: devices and models report the same.
    pub(crate) skin_sha256: String,
    /// Version of the program.
    pub(crate) dermis_version: String,
    /// What the builder must know: bores that are not at their electrode, strains, parts that are left out.
    pub notes: Vec<String>,
    /// The files, in the order of their kinds.
    pub files: Vec<ManifestEntry>,
}

/// A file in the manifest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ManifestEntry {
    /// Its path in the folder.
    pub path: String,
    /// What it is for.
    pub purpose: String,
    /// Its size, bytes.
    pub(crate) bytes: u64,
    /// SHA-256 of its content, hexadecimal.
    pub(crate) sha256: String,
}

impl Manifest {
    /// The manifest of some files.
    pub fn new(design: &dermis::design::SkinDesign, notes: Vec<String>, files: &[OutputFile]) -> Self {
        let entry = |file: &OutputFile| ManifestEntry {
            path: file.path.clone(),
            purpose: file.purpose.clone(),
            bytes: file.bytes.len() as u64,
            sha256: hexadecimal(&sha256(&file.bytes)),
        };
        Manifest {
            design: design.name.clone(),
            skin_sha256: hexadecimal(&design.sha256()),
            dermis_version: env!("CARGO_PKG_VERSION").into(),
            notes,
            files: files.iter().map(entry).collect(),
        }
    }
}

/// Writes files and their manifest into a new folder. They are written beside it and renamed, so that the folder is
/// there completely or not at all.
///
/// A folder that holds something is replaced only on request, and only one with a manifest and nothing that is not listed there.
///
/// # Errors
/// A folder that exists and is not to be replaced; one that cannot be written.
pub fn write_folder(
    folder: &Path,
    replace: bool,
    manifest: &Manifest,
    files: &[OutputFile],
) -> Result<(), FabricateError> {
    check_free(folder, replace)?;
    let io = |source| FabricateError::Io { path: folder.to_path_buf(), source };
    let new = NewFolder::beside(folder).map_err(io)?;
    for file in files {
        write(&new.path().join(&file.path), &file.bytes).map_err(io)?;
    }
    let text = serde_json::to_string_pretty(manifest).expect("text and numbers are JSON") + "\n";
    write(&new.path().join(MANIFEST), text.as_bytes()).map_err(io)?;
    new.finish().map_err(io)
}

/// Refuses a folder that holds something, unless it may be replaced.
///
/// # Errors
/// As [`write_folder`].
pub fn check_free(folder: &Path, replace: bool) -> Result<(), FabricateError> {
    let is_empty = || std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none());
    match std::fs::symlink_metadata(folder) {
        Err(_) => return Ok(()),
        // Neither a link nor the folder that one is in: they cannot be replaced.
        Ok(found) if found.is_dir() && folder.file_name().is_some() && is_empty() => return Ok(()),
        Ok(_) => {}
    }
    let exists = |fix| Err(FabricateError::Exists { path: folder.to_path_buf(), fix });
    if !replace {
        return exists("name another folder with -o, or replace it with --force");
    }
    match written_before(folder) {
        true => Ok(()),
        false => exists("it holds other files than those of its manifest.json, so it is not replaced: name another"),
    }
}

/// Whether a folder holds a manifest and no file that is not listed in it.
fn written_before(folder: &Path) -> bool {
    let text = dermis::files::read_text_at_most(&folder.join(MANIFEST), dermis::files::MAX_SETTINGS_BYTES);
    let Some(manifest) = text.ok().and_then(|text| serde_json::from_str::<Manifest>(&text).ok()) else { return false };
    let mut found = Vec::new();
    if list(folder, "", &mut found).is_err() {
        return false;
    }
    let listed = |path: &String| path == MANIFEST || manifest.files.iter().any(|file| file.path == *path);
    found.iter().all(listed)
}

fn list(folder: &Path, before: &str, found: &mut Vec<String>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let path = format!("{before}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            list(&entry.path(), &format!("{path}/"), found)?;
        } else {
            found.push(path);
        }
    }
    Ok(())
}

fn write(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    std::fs::create_dir_all(path.parent().expect("a file in a folder"))?;
    std::fs::write(path, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::design::SkinDesign;

    fn files() -> Vec<OutputFile> {
        vec![OutputFile::new("a/b.txt", "a test", *b"abc"), OutputFile::new("c.txt", "another", *b"")]
    }

    #[test]
    fn a_folder_is_written_whole_and_replaced_only_if_it_is_ours() {
        let at = tempfile::tempdir().unwrap();
        let folder = at.path().join("out");
        let manifest = Manifest::new(&SkinDesign::shipped("skin16").unwrap(), Vec::new(), &files());
        // FIPS 180-2, appendix B.1.
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!((manifest.files[0].sha256.as_str(), manifest.files[0].bytes), (abc, 3));
        // One that is empty is as good as none.
        std::fs::create_dir(&folder).unwrap();
        write_folder(&folder, false, &manifest, &files()).unwrap();
        assert_eq!(std::fs::read(folder.join("a/b.txt")).unwrap(), b"abc");
        let error = write_folder(&folder, false, &manifest, &files()).unwrap_err();
        assert!(error.fix().unwrap().contains("--force"), "{error}");
        write_folder(&folder, true, &manifest, &files()).unwrap();
        std::fs::write(folder.join("mine"), "").unwrap();
        let error = write_folder(&folder, true, &manifest, &files()).unwrap_err();
        assert!(error.fix().unwrap().contains("other files"), "{error}");
        // Nothing is left beside it.
        assert_eq!(std::fs::read_dir(at.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_named() {
        let at = tempfile::tempdir().unwrap();
        let manifest = Manifest::new(&SkinDesign::shipped("skin16").unwrap(), Vec::new(), &files());
        let folder = at.path().join("missing/out");
        let error = write_folder(&folder, false, &manifest, &files()).unwrap_err().to_string();
        assert!(error.contains("missing/out cannot be written"), "{error}");
        assert_eq!(std::fs::read_dir(at.path()).unwrap().count(), 0);
    }
}
