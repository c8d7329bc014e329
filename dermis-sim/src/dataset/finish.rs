//! The manifest of a finished dataset, and verification.

use crate::dataset::DatasetError;
use crate::dataset::file::Reader;
use crate::dataset::record::{FRAMES, IMAGES, REST, Record, file_name};
use crate::dataset::run::{remove_leftovers, write_durable};
use dermis::stats::sd_of_sums;
use dermis::text::counted;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Name of the manifest in a folder.
const MANIFEST: &str = "manifest.json";
/// Number of files read in parallel before their sums are added: limits the memory for sums.
const FILES_AT_ONCE: usize = 64;

/// The manifest of a finished dataset, written once all files are complete.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// The record of the dataset.
    pub record: Record,
    /// SHA-256 of the record's file, which is in the header of every file of samples.
    pub identity: String,
    /// The files, in order.
    pub files: Vec<FileRecord>,
    /// Means and standard deviations over all samples.
    pub statistics: Statistics,
}

/// A file of a finished dataset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileRecord {
    /// Its name in the folder.
    pub(crate) name: String,
    /// Its samples.
    pub(crate) samples: u64,
    /// SHA-256 of all of its bytes.
    pub(crate) sha256: String,
}

/// Means and standard deviations over all samples (divided by n, not n - 1), summed in double precision in the order of
/// the files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    /// Number of samples.
    pub samples: u64,
    /// Mean of each channel, ohm.
    pub(crate) frame_mean_ohm: Vec<f64>,
    /// Standard deviation of each channel, ohm.
    pub(crate) frame_sd_ohm: Vec<f64>,
    /// Mean of each channel's difference from the sample's own untouched frame, ohm.
    pub(crate) difference_mean_ohm: Vec<f64>,
    /// Standard deviation of this difference, ohm.
    pub(crate) difference_sd_ohm: Vec<f64>,
    /// Mean over the pixels of all images.
    pub image_mean: f64,
    /// Standard deviation over the pixels of all images.
    pub image_sd: f64,
}

/// Results of checking a folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Checked {
    /// Number of valid files.
    pub good_files: u64,
    /// Number of files of the finished dataset.
    pub file_count: u64,
    /// Whether there is a manifest that agrees with the files.
    pub finished: bool,
    /// A message for each bad file.
    pub problems: Vec<String>,
}

/// Sums over samples; the first sample's untouched frame is subtracted from frames to avoid cancellation in squares.
#[derive(Debug, Clone)]
struct Sums {
    samples: u64,
    frame: Vec<[f64; 2]>,
    difference: Vec<[f64; 2]>,
    image: [f64; 2],
    pixels: u64,
}

impl Manifest {
    /// The manifest in a folder.
    ///
    /// # Errors
    /// A folder without a manifest; a file that is not a manifest.
    pub(crate) fn read(folder: &Path) -> Result<Self, DatasetError> {
        let path = Self::path(folder);
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                // A folder without a dataset has a separate error.
                Record::read(folder)?;
                return Err(DatasetError::Unfinished { folder: folder.to_path_buf() });
            }
            Err(source) => return Err(DatasetError::Io { path, source }),
        };
        let wrong = |error| DatasetError::File { path: path.clone(), message: format!("no manifest: {error}") };
        serde_json::from_slice(&bytes).map_err(wrong)
    }

    fn path(folder: &Path) -> PathBuf {
        folder.join(MANIFEST)
    }
}

/// Reads all files of a dataset, checks every bit, and writes the manifest. `on_file` is called after every file, from
/// several threads.
///
/// # Errors
/// A folder without a dataset; files that are missing, damaged or of another dataset.
pub fn finish(folder: &Path, on_file: impl Fn() + Sync) -> Result<Manifest, DatasetError> {
    let record = Record::read(folder)?;
    let identity = record.identity();
    check_complete(folder, &record)?;
    let reference = first_rest(folder, &record, &identity)?;
    let mut sums = Sums::new(&record);
    let mut files = Vec::new();
    let numbers: Vec<u64> = (0..record.file_count()).collect();
    for chunk in numbers.chunks(FILES_AT_ONCE) {
        let read = |&file: &u64| {
            let read = read_file(folder, &record, &identity, file, &reference);
            on_file();
            read
        };
        for (&file, read) in chunk.iter().zip(chunk.par_iter().map(read).collect::<Vec<_>>()) {
            let (of_file, sha256) = read?;
            sums.add(&of_file);
            files.push(FileRecord { name: file_name(file), samples: of_file.samples, sha256 });
        }
    }
    let manifest = Manifest { statistics: sums.statistics(&reference), record, identity, files };
    let mut text = serde_json::to_string_pretty(&manifest).expect("a manifest is JSON");
    text.push('\n');
    write_durable(folder, MANIFEST, text.as_bytes())?;
    remove_leftovers(folder)?;
    Ok(manifest)
}

/// Checks every bit of all existing files, and the manifest if there is one.
///
/// # Errors
/// A folder without a dataset, or with a manifest that cannot be read. Bad files are listed in the result.
pub fn verify(folder: &Path, on_file: impl Fn() + Sync) -> Result<Checked, DatasetError> {
    let record = Record::read(folder)?;
    let identity = record.identity();
    let manifest = if Manifest::path(folder).exists() { Some(Manifest::read(folder)?) } else { None };
    let zero = vec![0.0; channel_count(&record)];
    let mut checked =
        Checked { good_files: 0, file_count: record.file_count(), finished: manifest.is_some(), problems: Vec::new() };
    if let Some(manifest) = &manifest {
        let names: Vec<String> = (0..record.file_count()).map(file_name).collect();
        let listed: Vec<&String> = manifest.files.iter().map(|file| &file.name).collect();
        if manifest.record != record || listed != names.iter().collect::<Vec<_>>() {
            let path = Manifest::path(folder);
            checked.problems.push(format!("{}: it belongs to another dataset than run.json", path.display()));
            checked.finished = false;
        }
    }
    let numbers: Vec<u64> = (0..record.file_count()).filter(|&file| folder.join(file_name(file)).exists()).collect();
    let check = |&file: &u64| {
        let (_, sha256) = read_file(folder, &record, &identity, file, &zero).map_err(|error| error.to_string())?;
        on_file();
        let listed = manifest.as_ref().and_then(|manifest| manifest.files.get(file as usize));
        match listed {
            Some(listed) if listed.sha256 != sha256 => {
                let path = folder.join(file_name(file));
                Err(format!("{}: its SHA-256 is {sha256}, not {}", path.display(), listed.sha256))
            }
            _ => Ok(()),
        }
    };
    for result in numbers.par_iter().map(check).collect::<Vec<Result<(), String>>>() {
        match result {
            Ok(()) => checked.good_files += 1,
            Err(problem) => checked.problems.push(problem),
        }
    }
    if checked.finished && (numbers.len() as u64) < checked.file_count {
        checked.problems.push(format!("{} missing", counted(checked.file_count - numbers.len() as u64, "file")));
    }
    Ok(checked)
}

fn check_complete(folder: &Path, record: &Record) -> Result<(), DatasetError> {
    let mut missing = (0..record.file_count()).map(|file| folder.join(file_name(file))).filter(|path| !path.exists());
    match missing.next() {
        None => Ok(()),
        Some(path) => {
            let count = 1 + missing.count() as u64;
            Err(DatasetError::Missing { path, count, of: record.file_count() })
        }
    }
}

fn open(folder: &Path, record: &Record, identity: &str, file: u64) -> Result<Reader, DatasetError> {
    Reader::open(&folder.join(file_name(file)), &record.shapes(file), &record.label(identity, file))
}

fn channel_count(record: &Record) -> usize {
    record.tensors.iter().find(|tensor| tensor.name == FRAMES).map_or(0, |tensor| tensor.shape[0])
}

/// The first sample's untouched frame.
fn first_rest(folder: &Path, record: &Record, identity: &str) -> Result<Vec<f64>, DatasetError> {
    let mut rest = vec![0.0; channel_count(record)];
    let io = |source| DatasetError::Io { path: folder.join(file_name(0)), source };
    open(folder, record, identity, 0)?.read(&mut rest).map_err(io)?;
    Ok(rest.into_iter().map(f64::from).collect())
}

/// The sums of a file, and its checksum.
fn read_file(
    folder: &Path,
    record: &Record,
    identity: &str,
    file: u64,
    reference: &[f64],
) -> Result<(Sums, String), DatasetError> {
    let path = folder.join(file_name(file));
    let io = |source| DatasetError::Io { path: path.clone(), source };
    let mut reader = open(folder, record, identity, file)?;
    let mut sums = Sums { samples: record.samples_of(file) as u64, ..Sums::new(record) };
    let mut rest: Vec<f32> = Vec::new();
    for (name, shape) in record.shapes(file) {
        let width: usize = shape[1..].iter().product();
        if name == REST {
            rest = vec![0.0; shape[0] * width];
            reader.read(&mut rest).map_err(io)?;
            continue;
        }
        let mut row = vec![0.0; width];
        for index in 0..shape[0] {
            reader.read(&mut row).map_err(io)?;
            match name {
                FRAMES => sums.add_frame(&row, &rest[if rest.len() > width { index * width } else { 0 }..], reference),
                IMAGES => sums.add_image(&row),
                _ => {}
            }
        }
    }
    let damaged = || DatasetError::File {
        path: path.clone(),
        message: "it is damaged: its values do not have the checksum that was written with them; remove it and run \
                  `dermis simulate` again"
            .into(),
    };
    let sha256 = reader.sha256().ok_or_else(damaged)?;
    Ok((sums, sha256))
}

impl Sums {
    fn new(record: &Record) -> Self {
        let channels = channel_count(record);
        Sums {
            samples: 0,
            frame: vec![[0.0; 2]; channels],
            difference: vec![[0.0; 2]; channels],
            image: [0.0; 2],
            pixels: 0,
        }
    }

    fn add_frame(&mut self, frame: &[f32], rest: &[f32], reference: &[f64]) {
        let sums = self.frame.iter_mut().zip(&mut self.difference);
        for ((((frame_sums, difference_sums), &value), &rest), reference) in sums.zip(frame).zip(rest).zip(reference) {
            accumulate(frame_sums, f64::from(value) - reference);
            accumulate(difference_sums, f64::from(value) - f64::from(rest));
        }
    }

    fn add_image(&mut self, image: &[f32]) {
        image.iter().for_each(|&value| accumulate(&mut self.image, f64::from(value)));
        self.pixels += image.len() as u64;
    }

    fn add(&mut self, other: &Sums) {
        let add = |sums: &mut [f64; 2], other: &[f64; 2]| {
            sums[0] += other[0];
            sums[1] += other[1];
        };
        self.samples += other.samples;
        self.pixels += other.pixels;
        add(&mut self.image, &other.image);
        self.frame.iter_mut().zip(&other.frame).for_each(|(sums, other)| add(sums, other));
        self.difference.iter_mut().zip(&other.difference).for_each(|(sums, other)| add(sums, other));
    }

    fn statistics(&self, reference: &[f64]) -> Statistics {
        let count = self.samples as f64;
        let means = |sums: &[[f64; 2]]| sums.iter().map(|sum| sum[0] / count).collect::<Vec<f64>>();
        let sds = |sums: &[[f64; 2]]| sums.iter().map(|&[sum, squares]| sd_of_sums(sum, squares, count)).collect();
        Statistics {
            samples: self.samples,
            frame_mean_ohm: means(&self.frame).iter().zip(reference).map(|(mean, rest)| mean + rest).collect(),
            frame_sd_ohm: sds(&self.frame),
            difference_mean_ohm: means(&self.difference),
            difference_sd_ohm: sds(&self.difference),
            image_mean: self.image[0] / self.pixels as f64,
            image_sd: sd_of_sums(self.image[0], self.image[1], self.pixels as f64),
        }
    }
}

fn accumulate(sums: &mut [f64; 2], value: f64) {
    sums[0] += value;
    sums[1] += value * value;
}
