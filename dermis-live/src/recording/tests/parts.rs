//! Recordings in parts.

use super::*;
use crate::recording::parts::{FreeSpace, Parts, RESERVE_BYTES, part_path};
use std::time::Duration;

/// A disk with plenty of room.
const FREE: FreeSpace = |_| Ok(u64::MAX);

fn create(path: &Path, limits: RecordingLimits, free_space: FreeSpace) -> Result<Parts, RecordError> {
    Parts::create(path, limits, skin().reference.clone(), &session(), free_space)
}

/// Records frames; begins the next part where one is due. Sizes are checked after every 60 frames.
fn record(parts: &mut Parts, frames: std::ops::Range<u64>) -> Result<(), RecordError> {
    for index in frames {
        parts.frame(&skin().frame(index))?;
        if index % 60 == 59 {
            parts.flush()?;
            std::thread::sleep(Duration::from_millis(110));
            if parts.check()? {
                parts.split(&session())?;
            }
        }
    }
    Ok(())
}

fn files(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn parts_hold_every_frame_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let limits = RecordingLimits { part_bytes: Some(400_000), ..RecordingLimits::default() };
    let mut parts = create(&path, limits, FREE).unwrap();
    record(&mut parts, 0..FRAMES).unwrap();
    let (written, [count, deleted, bytes]) = (parts.written(), parts.sizes());
    parts.finish().unwrap();
    assert_eq!((written.frames, deleted), (FRAMES, 0));
    assert!((written.seconds - (FRAMES - 1) as f64 / synthetic::RATE as f64).abs() < 1e-6, "{written:?}");
    assert!(count >= 3 && bytes > 800_000, "{count} parts, {bytes} bytes");
    let mut next = 0;
    for number in 0..count {
        let mut recording = Recording::open(&part_path(&path, number)).unwrap();
        assert_eq!(recording.session, session(), "part {number}");
        for item in recording.by_ref() {
            let Recorded::Frame { measured_at, message, .. } = item.unwrap() else { panic!("nothing else is in it") };
            assert_eq!((measured_at, message), (at(next), skin().frame(next).message));
            next += 1;
        }
        assert!(recording.is_whole());
        let bytes = std::fs::read(part_path(&path, number)).unwrap();
        mcap::Summary::read(&bytes).unwrap().expect("a complete file");
        // The first frame of each part has its validity, which is otherwise recorded when it changes.
        let first = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
        assert!(first.take(10).any(|message| message.channel.topic == "/dermis/validity"));
    }
    assert_eq!(next, FRAMES);
    assert_eq!(files(folder.path()).len() as u64, count);
}

#[test]
fn a_part_lasts_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let limits = RecordingLimits { part_s: Some(0.15), ..RecordingLimits::default() };
    let mut parts = create(&path, limits, FREE).unwrap();
    // No part without a frame.
    std::thread::sleep(Duration::from_millis(200));
    assert!(!parts.check().unwrap());
    record(&mut parts, 0..240).unwrap();
    parts.finish().unwrap();
    assert!((2..=5).contains(&files(folder.path()).len()), "{:?}", files(folder.path()));
}

/// The oldest parts of the recording are deleted, and no other file.
#[test]
fn all_parts_together_stay_within_their_limit() {
    const TOTAL: u64 = 1 << 20;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    for other in ["run_x.mcap", "run.mcap.old", "ru.mcap", "run_0.mcap", "run_01.mcap"] {
        std::fs::write(folder.path().join(other), other).unwrap();
    }
    let limits = RecordingLimits { total_bytes: Some(TOTAL), ..RecordingLimits::default() };
    limits.check_new(&path).unwrap();
    let mut parts = create(&path, limits, FREE).unwrap();
    for _ in 0..3 {
        record(&mut parts, 0..240).unwrap();
        let [count, deleted, bytes] = parts.sizes();
        assert!(bytes <= TOTAL, "{bytes} bytes in {} parts", count - deleted);
    }
    let [count, deleted, bytes] = parts.sizes();
    parts.finish().unwrap();
    assert!(deleted >= 3 && count - deleted >= 2 && bytes > TOTAL / 2, "{deleted} of {count}, {bytes} bytes");
    for number in 0..count {
        assert_eq!(part_path(&path, number).exists(), number >= deleted, "part {number}");
    }
    assert_eq!(files(folder.path()).len() as u64, 5 + count - deleted);
}

/// A part that was moved away is no error.
#[test]
fn a_part_may_be_moved_away() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let limits = RecordingLimits { total_bytes: Some(1 << 20), ..RecordingLimits::default() };
    let mut parts = create(&path, limits, FREE).unwrap();
    parts.frame(&skin().frame(0)).unwrap();
    parts.split(&session()).unwrap();
    std::fs::rename(&path, folder.path().join("kept")).unwrap();
    for _ in 0..2 {
        record(&mut parts, 0..FRAMES).unwrap();
    }
    parts.finish().unwrap();
    assert!(files(folder.path()).contains(&"kept".to_string()));
}

#[test]
fn files_of_parts_that_exist_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.v2.mcap");
    let split = RecordingLimits { part_s: Some(1.0), ..RecordingLimits::default() };
    std::fs::write(folder.path().join("run.v2_12.mcap"), "").unwrap();
    RecordingLimits::default().check_new(&path).unwrap();
    let error = split.check_new(&path).unwrap_err();
    assert!(matches!(&error, RecordError::Exists { path } if path.ends_with("run.v2_12.mcap")), "{error}");
    // One that comes later is not written over.
    let mut parts = create(&path, split, FREE).unwrap();
    std::fs::write(part_path(&path, 1), "other").unwrap();
    parts.frame(&skin().frame(0)).unwrap();
    assert!(matches!(parts.split(&session()), Err(RecordError::Exists { .. })));
    parts.finish().unwrap();
    assert_eq!(std::fs::read(part_path(&path, 1)).unwrap(), b"other");
    assert_eq!(frames_in_part(&path), 1);
    assert_eq!(part_path(Path::new("a/run"), 3), Path::new("a/run_3"));
}

/// A recording ends before the disk is full, and is complete.
#[test]
fn a_disk_that_is_almost_full_ends_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    // The disk has 1 MB more than the reserve at first.
    const ROOM: u64 = 1_000_000;
    let free: FreeSpace =
        |path| Ok(RESERVE_BYTES + ROOM - std::fs::metadata(path).map_or(0, |file| file.len()).min(2 * ROOM));
    let mut parts = create(&path, RecordingLimits::default(), free).unwrap();
    let error = record(&mut parts, 0..FRAMES).unwrap_err();
    let written = parts.written().frames;
    parts.finish().unwrap();
    let text = error.to_string();
    assert!(
        matches!(error, RecordError::AlmostFull { .. }) && text.contains("run.mcap") && text.contains("31 MiB"),
        "{text}"
    );
    assert!(written > 60 && frames_in(&path) == written, "{written} frames");
    let mut recording = Recording::open(&path).unwrap();
    assert_eq!(recording.by_ref().count() as u64, written);
    assert!(recording.is_whole());
    // Nothing is begun without room.
    let none = folder.path().join("none.mcap");
    assert!(matches!(create(&none, RecordingLimits::default(), |_| Ok(5)), Err(RecordError::AlmostFull { .. })));
    assert!(!none.exists());
}
