//! Damaged frames in transit: only the damaged frame is lost, and the contacts of all others do not change.

use crate::rows::bench::{Bench, TARE, lab, place, stroke};
use dermis::pipeline::PipelineFrame;
use dermis::pipeline::Settings;
use dermis_emulate::emulator::Stroke;
use dermis_sim::random::sample_rng;
use dermis_wire::{Decoder, Frame, FrameFlags, Readings, Received, ToHost};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;

/// Frames that repeat: ten seconds of presses.
const CYCLE: u64 = 1200;

#[test]
fn damaged_frames_do_not_affect_others() {
    survives(12_000);
}

#[test]
#[ignore = "slow: a million frames through two pipelines"]
fn a_million_frames_with_one_percent_damaged() {
    survives(1_000_000);
}

/// Damage applied to a stream.
#[derive(Debug, Default, PartialEq)]
struct Done {
    lost: u64,
    repeated: u64,
}

/// Reads the same frames with and without damage and compares the results.
fn survives(count: u64) {
    let mut whole = Bench::new(lab(), 91, presses(), Settings::default());
    let mut harmed = Bench::new(lab(), 91, presses(), Settings::default());
    let cycle: Vec<Vec<i16>> = (TARE..TARE + CYCLE).map(|index| readings(&whole, index)).collect();
    let (mut rng, mut done) = (sample_rng(92, 0), Done::default());
    // Frames since the last lost one, and the number of differences.
    let (mut since, mut late) = (u64::MAX, 0);
    let (mut contacts, mut moved, mut farthest_m) = (0u64, 0u64, 0f64);
    for index in TARE..TARE + count {
        let packet = packet(&cycle[((index - TARE) % CYCLE) as usize], index);
        let expected = frames(&mut whole, &packet, index).pop().expect("a whole frame");
        let bytes = harm(&packet, &mut rng, &mut done);
        let Some(found) = frames(&mut harmed, &bytes, index).pop() else {
            since = 0;
            continue;
        };
        since = since.saturating_add(1);
        assert_eq!(found.sequence, expected.sequence);
        assert_eq!(found.values_ohm, expected.values_ohm);
        let [a, b] = [&found, &expected]
            .map(|frame| frame.contacts.iter().map(|contact| contact.contact.id).collect::<Vec<u64>>());
        if a != b {
            // A contact is reported from its second frame on and ends 50 ms after its last one: if one of these frames
            // is lost, it begins or ends one frame earlier or later.
            assert!(since <= 8, "frame {index}: contacts {a:?} in place of {b:?}, {since} frames after a lost one");
            late += 1;
            continue;
        }
        for (a, b) in found.contacts.iter().zip(&expected.contacts) {
            let off_m = dermis::geom::vector::distance(a.contact.position_m, b.contact.position_m);
            contacts += 1;
            moved += u64::from(off_m > 1e-5);
            farthest_m = farthest_m.max(off_m);
        }
    }
    let counts = harmed.stream.counts();
    println!(
        "{count} frames, {} lost, {} doubled, {} stretches of other bytes: of {contacts} contacts of the others {moved} lie farther \
         than 0.01 mm from where they would, {:.2} mm at most; in {late} frames one began or ended a frame sooner or later",
        done.lost,
        done.repeated,
        harmed.damaged,
        1e3 * farthest_m
    );
    assert_eq!(Done { lost: counts.lost, repeated: counts.repeated }, done);
    assert!(done.lost > count / 400 && done.repeated > 0 && harmed.damaged > done.lost);
    // The position of an occluded or just lifted contact is predicted with its velocity, which depends on every frame.
    assert!(late < done.lost && moved * 100 < contacts && farthest_m < 2e-3);
}

fn presses() -> Vec<Stroke> {
    let at = |index: u32| place(0.05 + 0.02 * f64::from(index), 75.0 * f64::from(index));
    (0..9).map(|index| stroke(1.0 + f64::from(index), 1.4, at(index), None, 2.0)).collect()
}

fn readings(bench: &Bench, index: u64) -> Vec<i16> {
    let mut readings = Vec::new();
    Decoder::new(vec![0; 1 << 16]).feed(&bench.emulator.frame_packet(index).unwrap(), |received| {
        let Received::Message(message) = received else { panic!("a damaged packet") };
        let Ok(ToHost::Frame(frame)) = ToHost::parse(message) else { panic!("no frame") };
        readings.extend(frame.readings.iter().map(|reading| reading as i16));
    });
    readings
}

fn packet(readings: &[i16], index: u64) -> Vec<u8> {
    let mut packet = vec![0; Frame::packet_bytes(readings.len(), 2)];
    let time_us = (index as f64 / 120.0 * 1e6) as u64;
    let (sequence, flags) = (index as u32, FrameFlags::default());
    let frame = Frame { sequence, time_us, flags, readings: Readings::I16(readings) };
    let length = ToHost::Frame(frame).encode(&mut packet).unwrap();
    packet.truncate(length);
    packet
}

fn frames(bench: &mut Bench, bytes: &[u8], index: u64) -> Vec<PipelineFrame> {
    let heard = bench.receive(bytes, index);
    heard.into_iter().map(|incoming| bench.pipeline.process(incoming.input).unwrap()).collect()
}

/// Damages one packet in a hundred: altered, cut, doubled, or preceded by noise; never its last byte, which ends it.
fn harm(packet: &[u8], rng: &mut ChaCha8Rng, done: &mut Done) -> Vec<u8> {
    let mut bytes = packet.to_vec();
    if !rng.random_bool(0.01) {
        return bytes;
    }
    match rng.random_range(0..4) {
        0 => {
            let at = rng.random_range(1..bytes.len() - 1);
            bytes[at] ^= rng.random_range(1..=255u8);
            done.lost += 1;
        }
        1 => {
            let from = rng.random_range(1..bytes.len() - 1);
            let to = rng.random_range(from + 1..bytes.len());
            bytes.drain(from..to);
            done.lost += 1;
        }
        2 => {
            bytes.extend_from_slice(packet);
            done.repeated += 1;
        }
        _ => {
            let mut noise = vec![0; rng.random_range(1..300)];
            rng.fill_bytes(&mut noise);
            bytes.splice(0..0, noise);
        }
    }
    bytes
}
