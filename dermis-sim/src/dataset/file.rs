//! One file of a dataset, in the safetensors format.
//!
//! Eight bytes with the length of a JSON header, the header, then the tensors' values in little-endian order (Hugging
//! Face, safetensors). The only key of its metadata identifies the file: its dataset, its place in the dataset, and the
//! SHA-256 of its values.

use crate::dataset::DatasetError;
use dermis::text::hexadecimal;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Our key of a file's metadata.
const KEY: &str = "dermis";
/// Maximum length of a header: a few hundred bytes are usual.
const LONGEST_HEADER: u64 = 1 << 20;
/// Number of values converted to bytes at a time.
const PIECE: usize = 1 << 14;

/// A tensor's name, shape and values, row-major.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tensor {
    pub name: String,
    pub shape: Vec<usize>,
    pub values: Vec<f32>,
}

/// The metadata in a file's header.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Label {
    /// The dataset's identity: the SHA-256 of its record.
    pub dataset: String,
    /// Number of its first sample.
    pub first_sample: u64,
    /// SHA-256 of all bytes after the header.
    pub sha256: String,
}

/// The header of some tensors, padded so that the values start at a multiple of eight bytes.
///
/// Written without `serde_json`, whose maps have their keys in an order that depends on the build options of that
/// crate.
fn header(shapes: &[(&str, Vec<usize>)], label: &Label) -> Vec<u8> {
    let text = Value::String(serde_json::to_string(label).expect("a label is JSON"));
    let mut header = format!("{{\"__metadata__\":{{\"{KEY}\":{text}}}");
    let mut start = 0;
    for (name, shape) in shapes {
        let end = start + 4 * shape.iter().product::<usize>();
        let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
        let shape = shape.join(",");
        header += &format!(",\"{name}\":{{\"dtype\":\"F32\",\"shape\":[{shape}],\"data_offsets\":[{start},{end}]}}");
        start = end;
    }
    header.push('}');
    let mut bytes = header.into_bytes();
    bytes.resize(bytes.len().next_multiple_of(8), b' ');
    bytes
}

/// Length of a file with tensors of these shapes, in bytes.
pub(super) fn file_bytes(shapes: &[(&str, Vec<usize>)], label: &Label) -> u64 {
    let values: usize = shapes.iter().map(|(_, shape)| shape.iter().product::<usize>()).sum();
    8 + header(shapes, label).len() as u64 + 4 * values as u64
}

/// Writes tensors to a file at `path`, synced to the disk. The checksum of `label` is not used.
pub(super) fn write(path: &Path, tensors: &[Tensor], label: &Label) -> std::io::Result<()> {
    let mut file = File::create(path)?;
    let shapes: Vec<(&str, Vec<usize>)> = tensors.iter().map(|t| (t.name.as_str(), t.shape.clone())).collect();
    // The length of the header does not depend on the digits of the checksum, so the values are written first.
    let blank = Label { sha256: "0".repeat(64), ..label.clone() };
    let length = header(&shapes, &blank).len();
    file.seek(SeekFrom::Start(8 + length as u64))?;
    let mut digest = Sha256::new();
    let mut bytes = Vec::with_capacity(4 * PIECE);
    for piece in tensors.iter().flat_map(|tensor| tensor.values.chunks(PIECE)) {
        bytes.clear();
        piece.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
        digest.update(&bytes);
        file.write_all(&bytes)?;
    }
    let header = header(&shapes, &Label { sha256: hexadecimal(&digest.finalize()), ..label.clone() });
    file.seek(SeekFrom::Start(0))?;
    file.write_all(&(length as u64).to_le_bytes())?;
    file.write_all(&header)?;
    file.sync_all()
}

/// An opened file of a dataset with a valid header.
#[derive(Debug)]
pub(super) struct Reader {
    reader: BufReader<File>,
    label: Label,
    header_bytes: u64,
    /// Hash of the values read.
    digest: Sha256,
    /// Hash of all bytes read.
    whole: Sha256,
}

impl Reader {
    /// Opens a file that should contain tensors of these shapes with this label (without its checksum).
    ///
    /// # Errors
    /// A file that cannot be read, has another length, or has other metadata in its header.
    pub(super) fn open(path: &Path, shapes: &[(&str, Vec<usize>)], expected: &Label) -> Result<Self, DatasetError> {
        let io = |source| DatasetError::Io { path: path.to_path_buf(), source };
        let wrong = |message: &str| DatasetError::File {
            path: path.to_path_buf(),
            message: format!("{message}; move it away and run `dermis simulate` again"),
        };
        let file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let mut reader = BufReader::with_capacity(1 << 20, file);
        let mut start = [0; 8];
        reader.read_exact(&mut start).map_err(|_| wrong("too short for a file of a dataset"))?;
        let header_length = u64::from_le_bytes(start);
        if header_length > LONGEST_HEADER.min(length) {
            return Err(wrong("not a safetensors file of `dermis simulate`"));
        }
        let mut bytes = vec![0; header_length as usize];
        reader.read_exact(&mut bytes).map_err(|_| wrong("too short for its own header"))?;
        let label = label_of(&bytes).ok_or_else(|| wrong("not a safetensors file of `dermis simulate`"))?;
        if label.dataset != expected.dataset {
            return Err(wrong("it belongs to another dataset"));
        }
        if bytes != header(shapes, &Label { sha256: label.sha256.clone(), ..expected.clone() }) {
            return Err(wrong("it holds other samples than those of its name"));
        }
        if length != file_bytes(shapes, &label) {
            return Err(wrong("it is damaged: its length is not the one in its header"));
        }
        let whole = Sha256::new().chain_update(start).chain_update(&bytes);
        let header_bytes = 8 + header_length;
        Ok(Reader { reader, label, header_bytes, digest: Sha256::new(), whole })
    }

    /// Bytes before the values.
    pub(super) fn header_bytes(&self) -> u64 {
        self.header_bytes
    }

    /// The next values, in the order of the tensors.
    pub(super) fn read(&mut self, values: &mut [f32]) -> std::io::Result<()> {
        let mut bytes = vec![0; 4 * values.len().min(PIECE)];
        for piece in values.chunks_mut(PIECE) {
            let bytes = &mut bytes[..4 * piece.len()];
            self.reader.read_exact(bytes)?;
            self.digest.update(&*bytes);
            self.whole.update(&*bytes);
            for (value, bytes) in piece.iter_mut().zip(bytes.chunks_exact(4)) {
                *value = f32::from_le_bytes(bytes.try_into().expect("four bytes"));
            }
        }
        Ok(())
    }

    /// The SHA-256 of the file after all values have been read; `None` if they do not have the checksum in the header.
    pub(super) fn sha256(self) -> Option<String> {
        (hexadecimal(&self.digest.finalize()) == self.label.sha256).then(|| hexadecimal(&self.whole.finalize()))
    }
}

fn label_of(header: &[u8]) -> Option<Label> {
    let header: Value = serde_json::from_slice(header).ok()?;
    serde_json::from_str(header.get("__metadata__")?.get(KEY)?.as_str()?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn tensors() -> Vec<Tensor> {
        let counted = |count: usize| (0..count).map(|value| value as f32 - 2.5).collect();
        vec![
            Tensor { name: "frames".into(), shape: vec![3, 4], values: counted(12) },
            Tensor { name: "touches".into(), shape: vec![3, 1, 5], values: vec![f32::NAN; 15] },
        ]
    }

    fn label() -> Label {
        Label { dataset: "d".repeat(64), first_sample: 8192, sha256: String::new() }
    }

    fn shapes(tensors: &[Tensor]) -> Vec<(&str, Vec<usize>)> {
        tensors.iter().map(|tensor| (tensor.name.as_str(), tensor.shape.clone())).collect()
    }

    #[test]
    fn what_is_written_is_read_and_every_damage_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let (tensors, label) = (tensors(), label());
        let shapes = shapes(&tensors);
        write(&path, &tensors, &label).unwrap();
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(whole.len() as u64, file_bytes(&shapes, &Label { sha256: "0".repeat(64), ..label.clone() }));
        let read = |expected: &Label| {
            let mut reader = Reader::open(&path, &shapes, expected)?;
            let mut values = vec![0.0; 27];
            reader.read(&mut values).unwrap();
            assert_eq!(values[..12], tensors[0].values[..]);
            assert_eq!(reader.sha256().unwrap(), hexadecimal(&Sha256::digest(&whole)));
            Ok::<bool, DatasetError>(values[12..].iter().all(|value| value.is_nan()))
        };
        assert!(read(&label).unwrap());
        for (other, expected) in [
            (Label { dataset: "e".repeat(64), ..label.clone() }, "another dataset"),
            (Label { first_sample: 0, ..label.clone() }, "other samples"),
        ] {
            assert!(read(&other).unwrap_err().to_string().contains(expected));
        }
        for length in [0, 7, 60, whole.len() - 1] {
            std::fs::write(&path, &whole[..length]).unwrap();
            let message = read(&label).unwrap_err().to_string();
            assert!(message.contains("a.safetensors") && message.contains("move it away"), "{message}");
        }
        let mut flipped = whole.clone();
        *flipped.last_mut().unwrap() ^= 1;
        std::fs::write(&path, &flipped).unwrap();
        let mut reader = Reader::open(&path, &shapes, &label).unwrap();
        reader.read(&mut [0.0; 27]).unwrap();
        assert_eq!(reader.sha256(), None);
    }

    #[test]
    fn the_header_is_what_the_format_asks_for() {
        let (tensors, label) = (tensors(), label());
        let bytes = header(&shapes(&tensors), &label);
        assert_eq!(bytes.len() % 8, 0);
        let header: Value = serde_json::from_slice(&bytes).unwrap();
        assert_eq!(header["__metadata__"].as_object().unwrap().len(), 1);
        assert_eq!(header["frames"], json!({ "dtype": "F32", "shape": [3, 4], "data_offsets": [0, 48] }));
        assert_eq!(header["touches"]["data_offsets"], json!([48, 108]));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_an_error() {
        let error = write(Path::new("/dev/full"), &tensors(), &label()).unwrap_err();
        assert_eq!(error.kind(), std::io::ErrorKind::StorageFull);
    }
}
