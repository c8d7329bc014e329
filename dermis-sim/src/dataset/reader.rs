//! Samples of a finished dataset, read in any order.

use crate::dataset::DatasetError;
use crate::dataset::file::Reader;
use crate::dataset::finish::Manifest;
use crate::dataset::record::{FRAMES, IMAGES, REST, TOUCHES, file_name};
use crate::dataset::sample::{SampleTouch, TOUCH_COLUMNS};
use std::fs::File;
use std::path::{Path, PathBuf};

/// A finished dataset, open for reading. The operating system caches frequently read parts; nothing else is kept in
/// memory.
#[derive(Debug)]
pub struct Dataset {
    folder: PathBuf,
    manifest: Manifest,
    files: Vec<File>,
    /// The start of each tensor of each file, and the number of values of one of its rows.
    tensors: Vec<[Rows; 4]>,
}

/// The layout of the rows of a tensor.
#[derive(Debug, Clone, Copy)]
struct Rows {
    start: u64,
    count: usize,
    width: usize,
}

/// The tensors of a file, in the order of [`NAMES`].
#[derive(Debug, Clone, Copy)]
enum Values {
    Rest,
    Frames,
    Images,
    Touches,
}

/// The tensors in the order of [`Dataset::tensors`].
const NAMES: [&str; 4] = [REST, FRAMES, IMAGES, TOUCHES];

impl Dataset {
    /// Opens the dataset of a folder, and checks the header of every file. Damaged values are found by
    /// [`verify`](crate::dataset::verify).
    ///
    /// # Errors
    /// A folder without a manifest; a file that is missing, truncated or of another dataset.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let manifest = Manifest::read(folder)?;
        let (mut files, mut tensors) = (Vec::new(), Vec::new());
        for file in 0..manifest.record.file_count() {
            let path = folder.join(file_name(file));
            let shapes = manifest.record.shapes(file);
            let header_bytes =
                Reader::open(&path, &shapes, &manifest.record.label(&manifest.identity, file))?.header_bytes();
            files.push(File::open(&path).map_err(|source| DatasetError::Io { path, source })?);
            let rows = |name: &str| {
                let mut start = header_bytes;
                for (other, shape) in &shapes {
                    let (count, width) = (shape[0], shape[1..].iter().product());
                    if *other == name {
                        return Rows { start, count, width };
                    }
                    start += 4 * (count * width) as u64;
                }
                unreachable!("the record names all four tensors")
            };
            tensors.push(NAMES.map(rows));
        }
        Ok(Dataset { folder: folder.to_path_buf(), manifest, files, tensors })
    }

    /// Its record and statistics.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Values of a frame.
    pub fn channel_count(&self) -> usize {
        self.tensors.first().map_or(0, |tensors| tensors[Values::Frames as usize].width)
    }

    /// Values of an image.
    pub fn pixel_count(&self) -> usize {
        self.tensors.first().map_or(0, |tensors| tensors[Values::Images as usize].width)
    }

    /// Number of samples.
    pub fn len(&self) -> u64 {
        self.manifest.record.recipe.samples
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The untouched frame of a sample's skin, ohm.
    ///
    /// # Errors
    /// A file that cannot be read.
    ///
    /// # Panics
    /// Here as in the other readers: a sample that does not exist, or memory of another size than a row's.
    pub fn rest_into(&self, sample: u64, values: &mut [f32]) -> Result<(), DatasetError> {
        self.row(Values::Rest, sample, values)
    }

    /// The frame of a sample during its touches, ohm.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn frame_into(&self, sample: u64, values: &mut [f32]) -> Result<(), DatasetError> {
        self.row(Values::Frames, sample, values)
    }

    /// The image of a sample.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn image_into(&self, sample: u64, values: &mut [f32]) -> Result<(), DatasetError> {
        self.row(Values::Images, sample, values)
    }

    /// The touches of a sample.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn touches(&self, sample: u64) -> Result<Vec<SampleTouch>, DatasetError> {
        let recipe = &self.manifest.record.recipe;
        let mut values = vec![0.0; recipe.most_touches() * TOUCH_COLUMNS];
        self.row(Values::Touches, sample, &mut values)?;
        Ok(SampleTouch::from_rows(&values, recipe.has_presses()))
    }

    fn row(&self, tensor: Values, sample: u64, values: &mut [f32]) -> Result<(), DatasetError> {
        let per_file = self.manifest.record.samples_per_file;
        let file = (sample / per_file) as usize;
        let Rows { start, count, width } = self.tensors[file][tensor as usize];
        assert_eq!(values.len(), width, "memory for a row");
        // One row for all samples, or one for each.
        let row = if count == 1 { 0 } else { sample % per_file };
        let mut bytes = vec![0; 4 * width];
        read_at(&self.files[file], &mut bytes, start + 4 * row * width as u64)
            .map_err(|source| DatasetError::Io { path: self.folder.join(file_name(file as u64)), source })?;
        for (value, bytes) in values.iter_mut().zip(bytes.chunks_exact(4)) {
            *value = f32::from_le_bytes(bytes.try_into().expect("four bytes"));
        }
        Ok(())
    }
}

#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], offset: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

#[cfg(windows)]
fn read_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> std::io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, offset)? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            count => (bytes, offset) = (&mut bytes[count..], offset + count as u64),
        }
    }
    Ok(())
}
