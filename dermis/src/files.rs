//! Files of limited size: a device such as `/dev/zero`, or a file of many gigabytes, is an error and fills no memory.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

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
