mod joined;
mod parts;

use super::*;
use crate::synthetic::{self, SyntheticSkin};
use dermis::pipeline::{Notice, Severity, Timestamp};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use std::io::Write;
use std::sync::{Arc, Mutex, OnceLock};

const FRAMES: u64 = 300;

fn session() -> Session {
    Session {
        version: env!("CARGO_PKG_VERSION").into(),
        design_toml: dermis::design::SkinDesign::shipped_text("skin16").unwrap().into(),
        twin_toml: Some("[twin]\n".into()),
        model_card_json: None,
        hello: vec![1, 0xab, 0xff],
        options: json!({"threshold": 0.5}),
        state: json!({"baseline_ohm": [1.25, 2.5]}),
    }
}

fn tare() -> Event {
    Event::Command(json!({"tare": null}))
}

fn skin() -> &'static SyntheticSkin {
    static SKIN: OnceLock<SyntheticSkin> = OnceLock::new();
    SKIN.get_or_init(|| SyntheticSkin::shipped("skin16"))
}

/// A complete recording of 300 frames with an event after the hundredth, and its bytes before it was finished.
fn recorded() -> &'static (Vec<u8>, Vec<u8>) {
    static RECORDED: OnceLock<(Vec<u8>, Vec<u8>)> = OnceLock::new();
    RECORDED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("presses.mcap");
        let mut recorder = Recorder::create(&path, skin().reference.clone(), &session()).unwrap();
        for index in 0..FRAMES {
            if index == 100 {
                recorder.event(at(index), &tare()).unwrap();
            }
            recorder.frame(&skin().frame(index)).unwrap();
        }
        let cut = std::fs::read(&path).unwrap();
        let written = recorder.finish().unwrap();
        assert_eq!(written.frames, FRAMES);
        (std::fs::read(&path).unwrap(), cut)
    })
}

fn at(index: u64) -> Timestamp {
    skin().frame(index).result.measured_at
}

fn in_file(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.mcap");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// Reads the frames of a recording and compares each with the recorded one; returns their number.
fn frames_in(path: &Path) -> u64 {
    let mut next = 0;
    for recorded in Recording::open(path).unwrap() {
        match recorded.unwrap() {
            Recorded::Frame { measured_at, output_at, message } => {
                let expected = skin().frame(next);
                let times = (expected.result.measured_at, expected.output_at);
                assert_eq!((measured_at, output_at, message), (times.0, times.1, expected.message), "frame {next}");
                next += 1;
            }
            Recorded::Event { at: moment, event } => assert_eq!((moment, event), (at(100), tare())),
            Recorded::Session(_) => panic!("no other recording was joined"),
        }
    }
    next
}

#[test]
fn what_was_recorded_is_read_back() {
    let (_folder, path) = in_file(&recorded().0);
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.session, session());
    assert_eq!(frames_in(&path), FRAMES);
    let events = Recording::open(&path).unwrap().filter(|item| matches!(item, Ok(Recorded::Event { .. }))).count();
    assert_eq!(events, 1);
    let mut recording = Recording::open(&path).unwrap();
    assert_eq!(recording.by_ref().count() as u64, FRAMES + 1);
    assert!(recording.is_whole());
}

/// An independent reader: the crate `mcap`, with all checksums.
#[test]
fn another_reader_finds_every_message() {
    let bytes = &recorded().0;
    let summary = mcap::Summary::read(bytes).unwrap().unwrap();
    let stats = summary.stats.unwrap();
    assert_eq!(stats.attachment_count, 2);
    assert_eq!(stats.metadata_count, 1);
    let (mut images, mut contacts) = (0, 0);
    for message in mcap::MessageStream::new(bytes).unwrap() {
        let message = message.unwrap();
        let frame = skin().frame(u64::from(message.sequence));
        match message.channel.topic.as_str() {
            "/dermis/image" => {
                assert_eq!(message.channel.schema.as_ref().unwrap().name, "sensor_msgs/msg/Image");
                assert_eq!(message.log_time, frame.result.measured_at.unix_ns);
                let image: crate::sinks::ros2::Image = crate::sinks::ros2::decode(&message.data).unwrap();
                assert_eq!(image, crate::sinks::ros2::image(&skin().reference, &frame));
                images += 1;
            }
            "/dermis/contacts" => {
                let cloud: crate::sinks::ros2::PointCloud2 = crate::sinks::ros2::decode(&message.data).unwrap();
                contacts += u64::from(cloud.width);
            }
            _ => {}
        }
    }
    assert_eq!(images, FRAMES);
    assert_eq!(contacts, (0..FRAMES).map(|index| skin().frame(index).result.contacts.len() as u64).sum::<u64>());
}

/// After truncation at any byte, every finished chunk is there; a chunk takes 0.4 s.
#[test]
fn a_recording_that_is_cut_anywhere_is_recovered() {
    let whole = &recorded().0;
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let folder = tempfile::tempdir().unwrap();
    for round in 0..200 {
        let length = random.random_range(8..whole.len());
        let [from, to] = ["from", "to"].map(|name| folder.path().join(format!("{round}-{name}.mcap")));
        std::fs::write(&from, &whole[..length]).unwrap();
        let recovered = recover(&from, &to).unwrap();
        assert!(!recovered.was_whole && recovered.damaged.is_empty(), "{length} bytes: {recovered:?}");
        mcap::Summary::read(&std::fs::read(&to).unwrap()).unwrap().expect("a whole file");
        if recovered.frames > 0 {
            assert_eq!(frames_in(&to), recovered.frames);
        }
        // Bytes measure time here, because all frames have about the same length; a chunk takes 0.4 s.
        let lost_s =
            (length as f64 / whole.len() as f64 * FRAMES as f64 - recovered.frames as f64) / synthetic::RATE as f64;
        assert!(lost_s < 0.45, "{length} bytes: {lost_s} s lost");
        for path in [from, to] {
            std::fs::remove_file(path).unwrap();
        }
    }
}

#[test]
fn before_it_is_finished_the_file_lacks_half_a_second_at_most() {
    let (_folder, path) = in_file(&recorded().1);
    let lacking = FRAMES - frames_in(&path);
    assert!(lacking as f64 / (synthetic::RATE as f64) < 0.5, "{lacking} frames");
    let mut recording = Recording::open(&path).unwrap();
    assert!(recording.by_ref().all(|item| item.is_ok()));
    assert!(!recording.is_whole());
}

#[test]
fn recovering_twice_changes_nothing() {
    for bytes in [&recorded().0, &recorded().1, &recorded().0[..recorded().0.len() / 2].to_vec()] {
        let (folder, path) = in_file(bytes);
        let [once, twice] = ["once", "twice"].map(|name| folder.path().join(name));
        let first = recover(&path, &once).unwrap();
        let second = recover(&once, &twice).unwrap();
        assert!(second.was_whole);
        assert_eq!((first.messages, first.frames), (second.messages, second.frames));
        assert!(std::fs::read(&once).unwrap() == std::fs::read(&twice).unwrap(), "the same bytes");
        assert_eq!(Recording::open(&once).unwrap().session, session());
    }
}

#[test]
fn a_damaged_chunk_costs_itself_alone() {
    let mut bytes = recorded().0.clone();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    let (folder, path) = in_file(&bytes);
    let recovered = recover(&path, &folder.path().join("out")).unwrap();
    assert_eq!(recovered.damaged.len(), 1, "{recovered:?}");
    let lost = FRAMES - recovered.frames;
    assert!((1..=60).contains(&lost), "{lost} frames lost");
    let errors: Vec<_> = Recording::open(&path).unwrap().filter_map(Result::err).collect();
    assert!(matches!(errors.as_slice(), [RecordError::Damaged { .. }]), "{errors:?}");
}

/// The positions of the chunks of a recording, by the lengths of its records, and where its data end.
fn chunks(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
    let (mut at, mut chunks) = (mcap::MAGIC.len(), Vec::new());
    while bytes[at] != mcap::records::op::DATA_END {
        let end = at + 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        if bytes[at] == mcap::records::op::CHUNK {
            chunks.push(at..end);
        }
        at = end;
    }
    chunks.push(at..at);
    chunks
}

/// Random damage from one bit to some chunks, of lengths and of contents; the topics are declared in the first chunk.
#[test]
fn damage_anywhere_costs_the_damaged_chunks_alone() {
    let whole = &recorded().0;
    let mut chunks = chunks(whole);
    let data_end = chunks.pop().unwrap().start;
    let of_chunk: Vec<u64> = chunks[1..]
        .iter()
        .map(|chunk| {
            let mut without = whole.clone();
            without[chunk.start + 60] ^= 0xff;
            let (folder, path) = in_file(&without);
            FRAMES - recover(&path, &folder.path().join("out")).unwrap().frames
        })
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for case in 0..200 {
        let mut bytes = whole.clone();
        let at = rng.random_range(chunks[1].start..data_end);
        let length = if case % 2 == 0 { 1 } else { 1 << rng.random_range(0..14) };
        let damaged = at..(at + length).min(data_end);
        match length {
            1 => bytes[at] ^= 1 << rng.random_range(0..8),
            _ => bytes[damaged.clone()].iter_mut().for_each(|byte| *byte = rng.random()),
        }
        let touches = |chunk: &std::ops::Range<usize>| chunk.start < damaged.end && damaged.start < chunk.end;
        // What indexes a chunk follows it.
        let lost: u64 =
            chunks[1..].iter().zip(&of_chunk).filter(|(chunk, _)| touches(chunk)).map(|(_, frames)| frames).sum();
        let (folder, path) = in_file(&bytes);
        let recovered = recover(&path, &folder.path().join("out")).unwrap();
        assert!(recovered.frames >= FRAMES - lost, "case {case}, {damaged:?}: {} of {lost}", FRAMES - recovered.frames);
        assert!(recovered.frames == FRAMES || !recovered.was_whole, "case {case}: {recovered:?}");
    }
}

#[test]
fn what_is_no_recording_is_refused() {
    let (folder, path) = in_file(b"sequence,measured_s\n");
    let to = folder.path().join("out");
    assert!(matches!(recover(&path, &to), Err(RecordError::NoRecording { .. })));
    assert!(matches!(Recording::open(&path), Err(RecordError::NoRecording { .. })));
    std::fs::write(&path, b"").unwrap();
    let error = recover(&path, &to).unwrap_err().to_string();
    assert!(error.contains("recording.mcap") && error.contains("empty"), "{error}");
    std::fs::write(&path, &recorded().0[..5]).unwrap();
    assert!(recover(&path, &to).unwrap_err().to_string().contains("ends after 5 bytes"));
    assert!(!to.exists());
    assert!(matches!(recover(&folder.path().join("none"), &to), Err(RecordError::Io { .. })));
    // A file of another program.
    let mut foreign = mcap::Writer::new(std::io::Cursor::new(Vec::new())).unwrap();
    foreign.finish().unwrap();
    std::fs::write(&path, foreign.into_inner().into_inner()).unwrap();
    assert!(matches!(Recording::open(&path), Err(RecordError::Lacks { .. })));
    assert!(matches!(convert(&path, &to), Err(RecordError::Lacks { .. })));
    assert!(!to.exists());
}

#[test]
fn nothing_is_written_over() {
    let (folder, path) = in_file(&recorded().0);
    let error = Recorder::create(&path, skin().reference.clone(), &session()).err().expect("refused");
    assert!(error.to_string().contains("exists already"), "{error}");
    assert!(matches!(recover(&path, &path), Err(RecordError::Exists { .. })));
    assert!(matches!(convert(&path, folder.path()), Err(RecordError::Exists { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), recorded().0);
    let missing = folder.path().join("missing/recording.mcap");
    let error = Recorder::create(&missing, skin().reference.clone(), &session()).err().expect("refused");
    assert!(matches!(error, RecordError::Io { .. }), "{error}");
}

/// A disk with room for a number of bytes.
struct Disk {
    room: usize,
    holds: Arc<Mutex<Vec<u8>>>,
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if self.room == 0 {
            return Err(std::io::ErrorKind::StorageFull.into());
        }
        let count = bytes.len().min(self.room);
        self.room -= count;
        self.holds.lock().unwrap().extend_from_slice(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_reported_and_its_data_are_kept() {
    let holds = Arc::default();
    let disk = Disk { room: recorded().0.len() / 2, holds: Arc::clone(&holds) };
    let path = Path::new("presses.mcap");
    let mut recorder = Recorder::begin(path, Box::new(disk), skin().reference.clone(), &session()).unwrap();
    let failed = (0..FRAMES).find_map(|index| Some((index, recorder.frame(&skin().frame(index)).err()?)));
    let (index, error) = failed.expect("the disk is too small");
    let text = error.to_string();
    assert!(
        matches!(error, RecordError::DiskFull { .. }) && text.contains("presses.mcap") && text.contains("recover"),
        "{text}"
    );
    assert!(recorder.frame(&skin().frame(index)).is_err(), "and stays so");
    drop(recorder);
    let (_folder, path) = in_file(&holds.lock().unwrap());
    let lacking = index - frames_in_part(&path);
    assert!(lacking as f64 / (synthetic::RATE as f64) < 0.5, "{lacking} frames");
}

fn frames_in_part(path: &Path) -> u64 {
    let items = Recording::open(path).unwrap().map(Result::unwrap);
    items.filter(|item| matches!(item, Recorded::Frame { .. })).count() as u64
}

#[test]
fn events_come_back_as_they_were() {
    let notice = Notice { level: Severity::Warning, text: "electrode 3 is loose".into(), at: at(0) };
    for event in [Event::Hello(vec![0, 1, 0xfe]), tare(), Event::Notice(notice)] {
        let text = serde_json::to_string(&event).unwrap();
        assert_eq!(serde_json::from_str::<Event>(&text).unwrap(), event, "{text}");
    }
    assert_eq!(serde_json::to_value(Event::Hello(vec![0, 0xfe])).unwrap(), json!({"kind": "hello", "value": "00fe"}));
    assert_eq!(event::from_hex("0g"), None);
    assert_eq!(event::from_hex("012"), None);
}

#[test]
fn tables_hold_what_was_recorded() {
    let (folder, path) = in_file(&recorded().0);
    let out = folder.path().join("tables");
    let converted = convert(&path, &out).unwrap();
    let channels = skin().design.protocol.channel_count();
    assert_eq!((converted.frames, converted.channels), (FRAMES as usize, channels));
    assert!(converted.left_out.is_empty(), "{:?}", converted.left_out);
    for name in ["frames.csv", "recording.npz"] {
        let table = dermis::frame::read_frames(&out.join(name), &skin().design.protocol).unwrap();
        assert_eq!(table.len(), FRAMES as usize, "{name}");
        let expected: Vec<f64> =
            skin().frame(77).result.values_ohm.iter().map(|&value| f64::from(value as f32)).collect();
        assert!(table[77].0.iter().zip(&expected).all(|(a, b)| (a - b).abs() <= 1e-6 * b.abs()), "{name}");
    }
    let (shape, images) = dermis::frame::read_array(&out.join("recording.npz"), "images").unwrap();
    assert_eq!(shape[1..], converted.picture);
    let pixel = skin().reference.space.position_in_grid[5];
    assert_eq!(images[pixel], f64::from(skin().frame(0).result.image[5]));
    let (_, ids) = dermis::frame::read_array(&out.join("recording.npz"), "contact_id").unwrap();
    assert_eq!((ids.len(), ids[0], ids[1]), (converted.contacts, 7.0, 8.0));
    let contacts = std::fs::read_to_string(out.join("contacts.csv")).unwrap();
    assert_eq!(contacts.lines().count(), converted.contacts + 1);
    let header = "frame,measured_s,x_m,y_m,z_m,normal_x,normal_y,normal_z,force_n,force_sd_n,strength,area_m2,direction_x,\
                  direction_y,direction_z,half_length_m,half_width_m,edge_m,sd_m,confidence,conductance,";
    assert!(contacts.starts_with(header), "{contacts}");
    let times = std::fs::read_to_string(out.join("times.csv")).unwrap();
    assert_eq!(times.lines().nth(1), Some("0,1767225600.000000000,1767225600.000300000"));
}

#[test]
fn tables_of_a_cut_recording_say_what_they_lack() {
    let cut = &recorded().0[..recorded().0.len() / 2];
    let (folder, path) = in_file(cut);
    let converted = convert(&path, &folder.path().join("tables")).unwrap();
    assert!((100..200).contains(&converted.frames));
    assert!(converted.left_out.iter().any(|why| why.contains("was cut")), "{:?}", converted.left_out);
    assert_eq!(converted.damaged, 0);
    let names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 2, "nothing else is left: {names:?}");
}
