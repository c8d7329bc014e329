//! A recording in parts, each of them a complete recording.

use crate::LiveFrame;
use crate::recording::{RecordError, Recorder, Session, Written, event::Event};
use crate::sinks::ros2::Reference;
use dermis::files::folder_of;
use dermis::pipeline::Timestamp;
use std::collections::VecDeque;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval at which the sizes of the parts and of the disk are checked.
const CHECK: Duration = Duration::from_millis(100);
/// A recording ends before the disk has less room than this, bytes: the end of the file needs some, and other programs do.
pub(super) const RESERVE_BYTES: u64 = 32 << 20;
/// What a part may grow by until the next check, bytes: two chunks.
const MARGIN_BYTES: u64 = 2 << 20;

/// Limits of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RecordingLimits {
    /// A part that has this size, bytes, is finished, and the next one begins.
    pub part_bytes: Option<u64>,
    /// The same for a time, s.
    pub part_s: Option<f64>,
    /// The oldest parts are deleted before all parts together have this size, bytes.
    pub total_bytes: Option<u64>,
}

impl RecordingLimits {
    /// The size of a part, bytes: no more than half of what all parts may have, and by default an eighth.
    fn part_bytes(&self) -> Option<u64> {
        let most = self.total_bytes.map(|total| match (self.part_bytes, self.part_s) {
            (None, None) => total / 8,
            _ => total / 2,
        });
        self.part_bytes.into_iter().chain(most).min()
    }

    /// Whether a recording has more than one part.
    fn splits(&self) -> bool {
        self.part_bytes().is_some() || self.part_s.is_some()
    }

    /// Refuses to record into files that exist.
    ///
    /// # Errors
    /// A file of that name, or a part of a recording of that name.
    pub fn check_new(&self, path: &Path) -> Result<(), RecordError> {
        let exists = |path: PathBuf| Err(RecordError::Exists { path });
        if path.exists() {
            return exists(path.into());
        }
        let folder = folder_of(path);
        // A folder that cannot be read is an error of the first file.
        let Some(entries) = folder.read_dir().ok().filter(|_| self.splits()) else { return Ok(()) };
        let taken = entries.flatten().find(|entry| is_part(path, &entry.file_name().to_string_lossy()));
        taken.map_or(Ok(()), |entry| exists(entry.path()))
    }
}

/// The file of a part: `run.mcap`, `run_1.mcap`, `run_2.mcap`.
pub(super) fn part_path(first: &Path, number: u64) -> PathBuf {
    if number == 0 {
        return first.into();
    }
    let mut name: OsString = first.file_stem().unwrap_or_default().into();
    name.push(format!("_{number}"));
    if let Some(extension) = first.extension() {
        name.push(".");
        name.push(extension);
    }
    first.with_file_name(name)
}

/// Whether a file has the name of a part after the first.
fn is_part(first: &Path, name: &str) -> bool {
    let number = name.rsplit_once('_').map(|(_, rest)| rest.split_once('.').map_or(rest, |(number, _)| number));
    let number = number.and_then(|number| number.parse().ok()).filter(|&number| number > 0);
    number.is_some_and(|number| part_path(first, number).file_name().is_some_and(|part| part == name))
}

/// The free space on the disk of a file, bytes.
pub(super) type FreeSpace = fn(&Path) -> std::io::Result<u64>;

/// Free space, as the system tells it.
pub(super) fn free_space(path: &Path) -> std::io::Result<u64> {
    let folder = folder_of(path);
    #[cfg(unix)]
    return Ok(rustix::fs::statvfs(folder).map(|disk| disk.f_bavail * disk.f_frsize)?);
    #[cfg(not(unix))]
    return fs4::available_space(folder);
}

/// A recording in parts.
pub(super) struct Parts {
    first: PathBuf,
    limits: RecordingLimits,
    free_space: FreeSpace,
    reference: Reference,
    recorder: Recorder,
    /// When the current part began.
    begun: Instant,
    checked: Instant,
    /// Parts that were finished, the oldest first, and their sizes, bytes.
    finished: VecDeque<(PathBuf, u64)>,
    /// Parts so far, and those that were deleted.
    count: u64,
    deleted: u64,
    /// Contents of the finished parts, and the first frame.
    written: Written,
    first_frame: Option<Timestamp>,
    last_frame: Option<Timestamp>,
    /// Waits until the system has written the last finished part.
    syncing: Option<JoinHandle<Result<(), RecordError>>>,
}

impl Parts {
    pub(super) fn create(
        path: &Path,
        limits: RecordingLimits,
        reference: Reference,
        session: &Session,
        free_space: FreeSpace,
    ) -> Result<Self, RecordError> {
        check_space(path, free_space)?;
        let now = Instant::now();
        Ok(Parts {
            recorder: Recorder::create(path, reference.clone(), session)?,
            first: path.into(),
            limits,
            free_space,
            reference,
            begun: now,
            checked: now,
            finished: VecDeque::new(),
            count: 1,
            deleted: 0,
            written: Written::default(),
            first_frame: None,
            last_frame: None,
            syncing: None,
        })
    }

    pub(super) fn frame(&mut self, frame: &LiveFrame) -> Result<(), RecordError> {
        self.first_frame.get_or_insert(frame.result.measured_at);
        self.last_frame = Some(frame.result.measured_at);
        self.recorder.frame(frame)
    }

    pub(super) fn event(&mut self, at: Timestamp, event: &Event) -> Result<(), RecordError> {
        self.recorder.event(at, event)
    }

    pub(super) fn flush(&mut self) -> Result<(), RecordError> {
        self.recorder.flush()
    }

    /// The contents of all parts, those that were deleted too.
    pub(super) fn written(&self) -> Written {
        let current = self.recorder.written();
        let span = self.first_frame.zip(self.last_frame);
        Written {
            frames: self.written.frames + current.frames,
            messages: self.written.messages + current.messages,
            seconds: span.map_or(0.0, |(first, last)| last.seconds_since(first)),
        }
    }

    /// Parts so far, those that were deleted, and the bytes of the others.
    pub(super) fn sizes(&self) -> [u64; 3] {
        [self.count, self.deleted, self.bytes()]
    }

    fn bytes(&self) -> u64 {
        size(self.recorder.path()) + self.finished.iter().map(|(_, bytes)| bytes).sum::<u64>()
    }

    /// Deletes parts as the limit requires. Returns whether the next part is due; it needs the state of the pipeline.
    ///
    /// # Errors
    /// A disk that is almost full: finish the recording.
    pub(super) fn check(&mut self) -> Result<bool, RecordError> {
        if self.checked.elapsed() < CHECK {
            return Ok(false);
        }
        self.checked = Instant::now();
        self.delete_oldest()?;
        check_space(&self.first, self.free_space)?;
        let is_long = self.limits.part_s.is_some_and(|most| self.begun.elapsed().as_secs_f64() >= most);
        let is_large = self.limits.part_bytes().is_some_and(|most| size(self.recorder.path()) >= most);
        Ok((is_long || is_large) && self.recorder.written().frames > 0)
    }

    fn delete_oldest(&mut self) -> Result<(), RecordError> {
        let Some(total) = self.limits.total_bytes else { return Ok(()) };
        while self.bytes() + MARGIN_BYTES.min(total / 8) > total {
            let Some((path, _)) = self.finished.pop_front() else { break };
            match std::fs::remove_file(&path) {
                // It was moved away.
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
                deleted => {
                    deleted.map_err(|source| RecordError::io(&path, source))?;
                    self.deleted += 1;
                }
            }
        }
        Ok(())
    }

    /// Finishes the part, and begins the next one.
    pub(super) fn split(&mut self, session: &Session) -> Result<(), RecordError> {
        let path = part_path(&self.first, self.count);
        let next = Recorder::create(&path, self.reference.clone(), session)?;
        let recorder = std::mem::replace(&mut self.recorder, next);
        self.count += 1;
        self.begun = Instant::now();
        let path = recorder.path().to_path_buf();
        let Written { frames, messages, .. } = recorder.close()?;
        self.written.frames += frames;
        self.written.messages += messages;
        self.finished.push_back((path.clone(), size(&path)));
        self.await_sync()?;
        // The disk may take seconds, in which frames come.
        let thread = std::thread::Builder::new().name("dermis-sync".into());
        let syncing = thread.spawn(move || Recorder::sync(&path));
        self.syncing = Some(syncing.map_err(|source| RecordError::io(&self.first, source))?);
        self.delete_oldest()
    }

    fn await_sync(&mut self) -> Result<(), RecordError> {
        // A thread that panicked has printed its message already.
        self.syncing.take().map_or(Ok(()), |thread| thread.join().unwrap_or(Ok(())))
    }

    /// Completes the last part.
    pub(super) fn finish(mut self) -> Result<(), RecordError> {
        self.await_sync()?;
        self.recorder.finish().map(drop)
    }
}

fn size(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |file| file.len())
}

fn check_space(path: &Path, free_space: FreeSpace) -> Result<(), RecordError> {
    // A system that does not tell its free space tells when there is none.
    match free_space(path) {
        Ok(left_bytes) if left_bytes < RESERVE_BYTES => {
            Err(RecordError::AlmostFull { path: path.into(), left_mib: left_bytes >> 20 })
        }
        _ => Ok(()),
    }
}
