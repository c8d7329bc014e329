//! Files that were joined, whole or truncated.

use super::*;
use crate::sinks::ros2::Topic;
use mcap::{WriteOptions, Writer};
use std::collections::BTreeMap;

/// Repairs a file, and checks that a second repair changes nothing.
fn repaired(bytes: &[u8]) -> (RecoveryReport, Vec<u8>) {
    let repair = |bytes: &[u8]| {
        let mut out = Vec::new();
        let report = recover_into(bytes, bytes.len() as u64, Path::new("joined.mcap"), &mut out).unwrap();
        (report, out)
    };
    let (report, out) = repair(bytes);
    let (second, again) = repair(&out);
    assert!(second.was_whole && second.recordings == 1 && second.messages == report.messages, "{second:?}");
    assert!(out == again, "the same bytes");
    (report, out)
}

/// The frames of a file by their messages, and the positions of further sessions among them.
fn items(bytes: &[u8]) -> (Vec<Vec<u8>>, Vec<usize>) {
    let (_folder, path) = in_file(bytes);
    let (mut frames, mut sessions) = (Vec::new(), Vec::new());
    for item in Recording::open(&path).unwrap() {
        match item {
            Ok(Recorded::Frame { message, .. }) => frames.push(message),
            Ok(Recorded::Session(other)) => {
                assert_eq!(*other, session());
                sessions.push(frames.len());
            }
            Ok(Recorded::Event { .. }) | Err(RecordError::Damaged { .. }) => {}
            Err(error) => panic!("{error}"),
        }
    }
    (frames, sessions)
}

#[test]
fn both_of_two_joined_recordings_are_recovered() {
    let (whole, (one, _)) = (&recorded().0, repaired(&recorded().0));
    let (report, out) = repaired(&[whole.as_slice(), whole].concat());
    assert!(report.was_whole && report.recordings == 2 && report.cut_bytes == 0, "{report:?}");
    assert_eq!((report.frames, report.messages), (2 * FRAMES, 2 * one.messages));
    let (frames, sessions) = items(&out);
    let expected: Vec<_> = (0..FRAMES).map(|index| skin().frame(index).message).collect();
    assert!(frames == [expected.as_slice(), &expected].concat());
    assert_eq!(sessions, [FRAMES as usize]);
    // The reader gives the same without a repair.
    assert!(items(&[whole.as_slice(), whole].concat()) == (frames, sessions));
    let stats = mcap::Summary::read(&out).unwrap().unwrap().stats.unwrap();
    assert_eq!((stats.message_count, stats.channel_count), (report.messages, Topic::COUNT as u32));
    let (report, _) = repaired(&whole.repeat(5));
    assert!(report.was_whole && report.recordings == 5 && report.frames == 5 * FRAMES, "{report:?}");
}

/// The first one truncated anywhere: nothing of the second is lost, and what is left out has its position and size.
#[test]
fn a_recording_after_a_truncated_one_is_recovered() {
    let whole = &recorded().0;
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let mut cuts: Vec<usize> = (0..50).map(|_| random.random_range(8..whole.len())).collect();
    // The footer and its magic bytes, and the summary.
    cuts.extend(whole.len() - 40..whole.len());
    cuts.extend((0..20).map(|_| whole.len() - random.random_range(40..3000)));
    for length in cuts {
        let cut = &whole[..length];
        let (alone, joined) = (repaired(cut).0, repaired(&[cut, whole].concat()));
        let (report, out) = joined;
        let left_out = format!("({} {})", alone.cut_bytes, if alone.cut_bytes == 1 { "byte" } else { "bytes" });
        assert!(matches!(report.damaged.as_slice(), [place] if place.ends_with(&left_out)), "{length}: {report:?}");
        assert!(!report.was_whole && report.was_finished && report.recordings == 2 && report.cut_bytes == 0);
        assert_eq!(report.frames, alone.frames + FRAMES, "{length} bytes");
        let sessions = if alone.frames > 0 { vec![alone.frames as usize] } else { Vec::new() };
        assert_eq!(items(&out).1, sessions);
    }
}

#[test]
fn a_truncated_recording_after_another_is_recovered() {
    let whole = &recorded().0;
    for length in [17, 500, whole.len() / 3, whole.len() / 2, whole.len() - 1] {
        let (alone, joined) = (repaired(&whole[..length]).0, repaired(&[whole, &whole[..length]].concat()).0);
        assert_eq!((joined.recordings, joined.cut_bytes, joined.damaged.len()), (2, alone.cut_bytes, 0), "{length}");
        assert_eq!(joined.frames, FRAMES + alone.frames);
    }
    // Less than the start of a recording.
    let (report, _) = repaired(&[whole, &whole[..12]].concat());
    assert_eq!((report.recordings, report.cut_bytes, report.was_whole, report.frames), (1, 12, false, FRAMES));
}

#[test]
fn bytes_between_and_after_recordings_are_reported() {
    let whole = &recorded().0;
    let (report, _) = repaired(&[whole, [0x89; 1000].as_slice(), whole].concat());
    let place = format!("byte {}: no record, between two recordings (1000 bytes)", whole.len());
    assert_eq!((report.damaged, report.frames, report.was_whole), (vec![place], 2 * FRAMES, false));
    let (report, _) = repaired(&[whole.as_slice(), b"text"].concat());
    assert_eq!((report.cut_bytes, report.was_whole, report.was_finished, report.frames), (4, false, false, FRAMES));
    let (folder, path) = in_file(&[whole.as_slice(), b"text", whole].concat());
    let converted = convert(&path, &folder.path().join("tables")).unwrap();
    assert_eq!((converted.frames as u64, converted.damaged), (2 * FRAMES, 1), "{:?}", converted.left_out);
}

/// A recording without chunks and checksums, with messages on topics whose numbers depend on `first`.
fn foreign(first: &str, count: u32) -> Vec<u8> {
    let options = WriteOptions::new().use_chunks(false).calculate_data_section_crc(false);
    let mut writer = Writer::with_options(std::io::Cursor::new(Vec::new()), options).unwrap();
    let topics = [first, "/a", "/b"];
    let channels = topics.map(|topic| {
        let schema = writer.add_schema(&format!("type of {topic}"), "ros2msg", topic.as_bytes()).unwrap();
        writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
    });
    for sequence in 0..count {
        for (topic, channel_id) in topics.iter().zip(channels) {
            let header = mcap::records::MessageHeader { channel_id, sequence, log_time: 1, publish_time: 1 };
            writer.write_to_known_channel(&header, topic.as_bytes()).unwrap();
        }
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// The numbers of channels differ between joined files: messages stay on their topics. Without checksums, a truncated
/// message is not completed with bytes of the next recording.
#[test]
fn messages_of_joined_recordings_stay_on_their_topics() {
    const COUNT: u32 = 20;
    let [one, other] = [foreign("/z", COUNT), foreign("/b", COUNT)];
    for length in (300..one.len() - 60).step_by(5).chain(one.len() - 60..=one.len()) {
        let (report, out) = repaired(&[&one[..length], &other].concat());
        let (mut all, mut second) = (0, 0);
        for message in mcap::MessageStream::new(&out).unwrap() {
            let message = message.unwrap();
            assert_eq!(message.data, message.channel.topic.as_bytes(), "{length} bytes");
            let schema = message.channel.schema.as_ref().unwrap();
            assert_eq!(schema.data, message.channel.topic.as_bytes());
            all += 1;
            second += u32::from(message.channel.topic == "/b");
        }
        assert!(
            report.messages == all && report.recordings == 2 && all >= u64::from(3 * COUNT),
            "{length}: {report:?}"
        );
        assert!(second >= 2 * COUNT, "{length} bytes: {second} messages on /b");
        assert_eq!(report.was_whole, length == one.len(), "{length} bytes");
    }
}

/// A recording within a message of another one is not another recording.
#[test]
fn a_recording_in_a_message_stays_in_it() {
    let inner = foreign("/z", 3);
    let options = WriteOptions::new().use_chunks(false);
    let mut writer = Writer::with_options(std::io::Cursor::new(Vec::new()), options).unwrap();
    let channel_id = writer.add_channel(0, "/file", "bytes", &BTreeMap::new()).unwrap();
    for sequence in 0..3 {
        let header = mcap::records::MessageHeader { channel_id, sequence, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, &inner).unwrap();
    }
    writer.finish().unwrap();
    let (report, out) = repaired(&writer.into_inner().into_inner());
    assert_eq!((report.messages, report.recordings, report.was_whole), (3, 1, true));
    assert!(mcap::MessageStream::new(&out).unwrap().all(|message| message.unwrap().data == inner));
}
