//! Generation of the files of a dataset, by several processes that may be killed and continued.

use crate::dataset::DatasetError;
use crate::dataset::file::{self, Reader, Tensor};
use crate::dataset::generator::{Generator, Rows, UNIT, Worker};
use crate::dataset::record::{FRAMES, IMAGES, REST, Record, TOUCHES, file_name};
use crate::dataset::sample::TOUCH_COLUMNS;
use rayon::prelude::*;
use serde::Serialize;
use std::fs::{File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Free space left on a disk in addition to the dataset, bytes: manifest, locks, and other files.
const SPARE_BYTES: u128 = 16 << 20;

/// The part of a dataset that one process generates: the files `k` with `k mod count = index`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    index: u64,
    count: u64,
}

impl Shard {
    /// All files.
    pub const WHOLE: Shard = Shard { index: 0, count: 1 };

    /// The shard with a given index and count.
    ///
    /// # Errors
    /// An index that is not below the count.
    pub fn new(index: u64, count: u64) -> Result<Self, DatasetError> {
        if index < count { Ok(Shard { index, count }) } else { Err(DatasetError::Shard { index, count }) }
    }

    /// Its files among a number of files.
    fn files(self, file_count: u64) -> impl Iterator<Item = u64> {
        (self.index..file_count).step_by(usize::try_from(self.count).unwrap_or(usize::MAX))
    }

    /// The number of its files.
    fn count_of(self, file_count: u64) -> u64 {
        file_count.saturating_sub(self.index).div_ceil(self.count)
    }
}

/// The result of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct RunReport {
    /// Number of generated samples.
    pub made_samples: u64,
    /// Number of generated files.
    pub made_files: u64,
    /// Number of files of its shard that already existed.
    pub found_files: u64,
}

/// A run that has checked the folder and determined what to generate.
#[derive(Debug)]
pub struct Run<'a> {
    generator: &'a Generator,
    record: &'a Record,
    identity: String,
    folder: PathBuf,
    shard: Shard,
    found_files: u64,
    missing_samples: u64,
}

/// A file locked by this process, from before its first sample is generated until it is renamed.
struct Claim {
    file: u64,
    /// The operating system releases the lock when the process ends.
    lock: File,
}

impl<'a> Run<'a> {
    /// Starts a dataset in a folder, or prepares to continue it.
    ///
    /// # Errors
    /// A folder that cannot be written or contains another dataset; a file in it that does not belong to the dataset; a
    /// disk that is too small.
    pub fn new(
        generator: &'a Generator,
        record: &'a Record,
        folder: &Path,
        shard: Shard,
    ) -> Result<Self, DatasetError> {
        let io = |source| DatasetError::Io { path: folder.to_path_buf(), source };
        let whole = shard.count_of(record.file_count());
        // Before anything is created, so that a refusal leaves no files; the size of existing files is subtracted
        // below.
        let existing = existing_ancestor(folder);
        let identity = record.identity();
        if Record::path(folder).exists() {
            Record::read(folder)?.check_same(record, &Record::path(folder))?;
        } else {
            refuse_strays(folder, record)?;
            check_space(&existing, u128::from(whole) * bytes_of_a_file(record, &identity))?;
        }
        std::fs::create_dir_all(folder).map_err(io)?;
        claim_folder(folder, record)?;
        let mut run = Run {
            generator,
            record,
            identity,
            folder: folder.to_path_buf(),
            shard,
            found_files: 0,
            missing_samples: 0,
        };
        run.scan_folder()?;
        let missing = u128::from(whole - run.found_files);
        check_space(folder, missing * bytes_of_a_file(record, &run.identity))?;
        Ok(run)
    }

    /// The number of samples missing from its shard.
    pub fn missing_samples(&self) -> u64 {
        self.missing_samples
    }

    /// The numbers of the files missing from its shard.
    pub fn missing_files(&self) -> impl Iterator<Item = u64> + '_ {
        self.shard.files(self.record.file_count()).filter(|&file| !self.path(file).exists())
    }

    /// Generates what is missing, in the current thread pool. `on_samples` is called from several threads with the
    /// number of samples generated since the last call; its error ends the run, without the file in progress.
    ///
    /// A file that another process is generating is skipped, and reported as an error after the others are finished.
    ///
    /// # Errors
    /// A full disk, files that another process is generating, a forward problem without a solution; that of `on_samples`.
    pub fn make<E: From<crate::Error> + Send>(
        &self,
        on_samples: impl Fn(u64) -> Result<(), E> + Sync,
    ) -> Result<RunReport, E> {
        let mut report = RunReport { found_files: self.found_files, ..RunReport::default() };
        let mut busy: Option<(u64, u64)> = None;
        let workers = Mutex::new(Vec::new());
        std::thread::scope(|scope| {
            // At most one file waits: two are in memory.
            let (sender, receiver) = sync_channel(0);
            let writer = scope.spawn(move || self.write_all(&receiver));
            let made = self.make_all(&sender, &workers, &on_samples, &mut report, &mut busy);
            drop(sender);
            let written = writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            written.map_err(crate::Error::from)?;
            made
        })?;
        match busy {
            Some((first, count)) => {
                Err(crate::Error::from(DatasetError::Busy { path: self.path(first), count }).into())
            }
            None => Ok(report),
        }
    }

    fn make_all<'g, E: From<crate::Error> + Send>(
        &'g self,
        sender: &SyncSender<(Claim, Vec<Tensor>)>,
        workers: &Mutex<Vec<Worker<'g>>>,
        on_samples: &(impl Fn(u64) -> Result<(), E> + Sync),
        report: &mut RunReport,
        busy: &mut Option<(u64, u64)>,
    ) -> Result<(), E> {
        for file in self.shard.files(self.record.file_count()) {
            if self.path(file).exists() {
                continue;
            }
            let Some(claim) = self.claim(file).map_err(crate::Error::from)? else {
                *busy = Some(busy.map_or((file, 1), |(first, count)| (first, count + 1)));
                continue;
            };
            if self.path(file).exists() {
                // Another process finished it between the two checks.
                self.release(claim);
                continue;
            }
            let tensors = self.fill(file, workers, on_samples)?;
            if sender.send((claim, tensors)).is_err() {
                // The writer has stopped with its own error.
                return Ok(());
            }
            report.made_files += 1;
            report.made_samples += self.record.samples_of(file) as u64;
        }
        Ok(())
    }

    /// The values of a file.
    fn fill<'g, E: From<crate::Error> + Send>(
        &'g self,
        file: u64,
        workers: &Mutex<Vec<Worker<'g>>>,
        on_samples: &(impl Fn(u64) -> Result<(), E> + Sync),
    ) -> Result<Vec<Tensor>, E> {
        let mut tensors = self.record.tensors(file);
        let [rest, frames, images, touches] = tensors.as_mut_slice() else { panic!("four tensors") };
        debug_assert_eq!([&rest.name, &frames.name, &images.name, &touches.name], [REST, FRAMES, IMAGES, TOUCHES]);
        let first = file * self.record.samples_per_file;
        let generator = self.generator;
        let channels = generator.channel_count();
        let own_rest: &mut [f32] = if generator.has_own_rest() { &mut rest.values } else { &mut [] };
        let mut rest_chunks = own_rest.chunks_mut(UNIT * channels);
        let units: Vec<Rows<'_>> = (frames.values.chunks_mut(UNIT * channels))
            .zip(images.values.chunks_mut(UNIT * generator.pixel_count()))
            .zip(touches.values.chunks_mut(UNIT * generator.recipe().most_touches() * TOUCH_COLUMNS))
            .map(|((frames, images), touches)| Rows {
                rest: rest_chunks.next().unwrap_or_default(),
                frames,
                images,
                touches,
            })
            .collect();
        units.into_par_iter().enumerate().try_for_each(|(unit, mut rows)| {
            let count = rows.frames.len() / channels;
            let idle = workers.lock().expect("no thread panics while it holds the lock").pop();
            let mut worker = idle.unwrap_or_else(|| generator.worker());
            worker.make(first + (unit * UNIT) as u64, count, &mut rows)?;
            workers.lock().expect("no thread panics while it holds the lock").push(worker);
            on_samples(count as u64)
        })?;
        if !generator.has_own_rest() {
            rest.values.copy_from_slice(generator.rest());
        }
        Ok(tensors)
    }

    /// Counts the existing files of the dataset, and refuses other files.
    fn scan_folder(&mut self) -> Result<(), DatasetError> {
        for file in self.shard.files(self.record.file_count()) {
            let path = self.path(file);
            if path.exists() {
                Reader::open(&path, &self.record.shapes(file), &self.record.label(&self.identity, file))?;
                self.found_files += 1;
                // The lock of a process that was killed after it had renamed the file.
                remove(&self.lock_path(file))?;
            } else {
                self.missing_samples += self.record.samples_of(file) as u64;
            }
        }
        Ok(())
    }

    fn path(&self, file: u64) -> PathBuf {
        self.folder.join(file_name(file))
    }

    fn lock_path(&self, file: u64) -> PathBuf {
        self.folder.join(format!("{LOCK}{file:05}"))
    }

    fn claim(&self, file: u64) -> Result<Option<Claim>, DatasetError> {
        Ok(lock(&self.lock_path(file))?.map(|lock| Claim { file, lock }))
    }

    /// Releases the lock of a finished file.
    fn release(&self, claim: Claim) {
        // What cannot be removed now is removed by the next run or by `--finish`.
        let _ = std::fs::remove_file(self.lock_path(claim.file));
        drop(claim.lock);
    }

    fn write_all(&self, receiver: &Receiver<(Claim, Vec<Tensor>)>) -> Result<(), DatasetError> {
        for (claim, tensors) in receiver {
            let part = self.folder.join(format!("{PART}{:05}", claim.file));
            let path = self.path(claim.file);
            let label = self.record.label(&self.identity, claim.file);
            let written = file::write(&part, &tensors, &label).and_then(|()| rename(&part, &path));
            if let Err(source) = written {
                let _ = std::fs::remove_file(&part);
                return Err(DatasetError::Io { path, source });
            }
            self.release(claim);
        }
        Ok(())
    }
}

/// Prefix of the names of locks and of unfinished files.
const LOCK: &str = ".lock-";
const PART: &str = ".part-";

/// A lock on a file created for it; `None` if another process holds it.
fn lock(path: &Path) -> Result<Option<File>, DatasetError> {
    let io = |source| DatasetError::Io { path: path.to_path_buf(), source };
    let file = File::options().create(true).truncate(false).write(true).open(path).map_err(io)?;
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => Ok(None),
        Err(TryLockError::Error(source)) => Err(io(source)),
    }
}

/// Renames a finished file and syncs the folder to the disk.
fn rename(part: &Path, path: &Path) -> std::io::Result<()> {
    std::fs::rename(part, path)?;
    if let Some(folder) = path.parent() {
        // Some systems cannot open a folder; then the durability of the name depends on the system.
        if let Ok(folder) = File::open(folder) {
            folder.sync_all()?;
        }
    }
    Ok(())
}

/// Writes a small file completely or not at all, synced to the disk. The caller holds the necessary locks.
pub(super) fn write_durable(folder: &Path, name: &str, bytes: &[u8]) -> Result<(), DatasetError> {
    let (part, path) = (folder.join(format!("{PART}{name}")), folder.join(name));
    let written = File::create(&part)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| rename(&part, &path));
    written.map_err(|source| {
        let _ = std::fs::remove_file(&part);
        DatasetError::Io { path, source }
    })
}

/// Writes the record into a folder, or checks the existing one. If several processes start at the same time, one of
/// them writes it.
fn claim_folder(folder: &Path, record: &Record) -> Result<(), DatasetError> {
    let path = Record::path(folder);
    let lock_path = folder.join(format!("{LOCK}run.json"));
    let io = |source| DatasetError::Io { path: lock_path.clone(), source };
    let lock = File::options().create(true).truncate(false).write(true).open(&lock_path).map_err(io)?;
    lock.lock().map_err(io)?;
    if path.exists() {
        return Record::read(folder)?.check_same(record, &path);
    }
    write_durable(folder, "run.json", &record.to_bytes())
}

/// Refuses a folder with files of samples but without a record.
fn refuse_strays(folder: &Path, record: &Record) -> Result<(), DatasetError> {
    for name in [file_name(0), file_name(record.file_count() - 1)] {
        let path = folder.join(name);
        if path.exists() {
            let message = "it belongs to a dataset whose run.json is gone; take another folder".into();
            return Err(DatasetError::File { path, message });
        }
    }
    Ok(())
}

/// Removes the temporary files of killed runs; for a folder whose files are complete.
pub(super) fn remove_leftovers(folder: &Path) -> Result<(), DatasetError> {
    let io = |source| DatasetError::Io { path: folder.to_path_buf(), source };
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let name = entry.map_err(io)?.file_name();
        let ours = |name: &str| name.starts_with(LOCK) || name.starts_with(PART);
        if name.to_str().is_some_and(ours) {
            remove(&folder.join(name))?;
        }
    }
    Ok(())
}

fn remove(path: &Path) -> Result<(), DatasetError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(DatasetError::Io { path: path.to_path_buf(), source })
        }
        _ => Ok(()),
    }
}

/// Length of a complete file, bytes.
fn bytes_of_a_file(record: &Record, identity: &str) -> u128 {
    u128::from(file::file_bytes(&record.shapes(0), &record.label(identity, 0)))
}

fn check_space(folder: &Path, needed_bytes: u128) -> Result<(), DatasetError> {
    let io = |source| DatasetError::Io { path: folder.to_path_buf(), source };
    let available_bytes = fs4::available_space(folder).map_err(io)?;
    if needed_bytes == 0 || needed_bytes + SPARE_BYTES <= u128::from(available_bytes) {
        return Ok(());
    }
    let needed_bytes = u64::try_from(needed_bytes).unwrap_or(u64::MAX);
    Err(DatasetError::Space { folder: folder.to_path_buf(), available_bytes, needed_bytes })
}

/// The nearest existing parent folder, which is on the same disk.
fn existing_ancestor(folder: &Path) -> PathBuf {
    let found = folder.ancestors().find(|path| !path.as_os_str().is_empty() && path.exists());
    found.map_or_else(|| PathBuf::from("."), Path::to_path_buf)
}
