//! The C implementation, written from the specification, and this crate agree on the same bytes.

use crate::specification::vectors::{Message, written};
use dermis_wire::{Decoder, Fault, Frame, Hello, Received, ScanPart, Status, ToDevice, ToHost};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

/// The program of `tests/c`, or why it is not available.
static PROGRAM: LazyLock<Result<PathBuf, String>> = LazyLock::new(|| {
    let compiler = std::env::var("CC").unwrap_or("cc".into());
    Command::new(&compiler)
        .arg("--version")
        .output()
        .map_err(|error| format!("no C compiler `{compiler}`: {error}"))?;
    let sanitizer: &[&str] = &["-fsanitize=undefined", "-fno-sanitize-recover=all"];
    Ok(compile(&compiler, sanitizer).or_else(|_| compile(&compiler, &[])).unwrap_or_else(|told| panic!("{told}")))
});

/// Compiles the program with warnings as errors.
fn compile(compiler: &str, more: &[&str]) -> Result<PathBuf, String> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/c");
    let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join("dermis_wire_c");
    let mut command = Command::new(compiler);
    command.args(["-std=c99", "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]).args(more);
    command.args([source.join("dermis_wire.c"), source.join("main.c")]).arg("-o").arg(&program);
    let output = command.output().map_err(|error| error.to_string())?;
    if output.status.success() { Ok(program) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
}

/// The output of the program for `input`; `None`, with a message, if there is no compiler.
fn run(word: &str, name: &str, input: &[u8]) -> Option<Vec<u8>> {
    let program = match &*PROGRAM {
        Ok(program) => program,
        Err(reason) => {
            eprintln!("skipped: {reason}");
            return None;
        }
    };
    // A file and not a pipe, so that neither side blocks the other.
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, input).unwrap();
    let output = Command::new(program).arg(word).stdin(File::open(&path).unwrap()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(output.stdout)
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The expected output of the program for a message.
fn line(message: Option<Message<'_>>) -> String {
    match message {
        Some(Message::Host(ToHost::Hello(hello))) => hello_line(&hello),
        Some(Message::Host(ToHost::Frame(frame))) => frame_line(&frame),
        Some(Message::Host(ToHost::Status(status))) => status_line(&status),
        Some(Message::Host(ToHost::Fault(Fault { code, text }))) => {
            format!("fault code={} text={}", u8::from(code), hex(text.as_bytes()))
        }
        Some(Message::Device(ToDevice::Identify)) => "kind 129".into(),
        Some(Message::Device(ToDevice::Start)) => "kind 130".into(),
        Some(Message::Device(ToDevice::Stop)) => "kind 131".into(),
        Some(Message::Device(ToDevice::SelfTest)) => "kind 134".into(),
        Some(Message::Device(ToDevice::Rate(rate_millihertz))) => format!("rate {rate_millihertz}"),
        Some(Message::Device(ToDevice::Scan(part))) => scan_line(&part),
        Some(Message::Empty) => "unknown 0 bytes".into(),
        None => panic!("the vectors are known"),
    }
}

fn hello_line(hello: &Hello<'_>) -> String {
    let [undriven, driven, reference] = hello.volts_per_count.map(f32::to_bits);
    format!(
        "hello version={} reading_bytes={} design={} electrodes={} slots={} reference_ohm={:08x} source_v={:08x} \
         volts_per_count={undriven:08x} volts_per_count={driven:08x} volts_per_count={reference:08x} full_scale={} \
         rate_millihertz={} highest_rate_millihertz={} baud={} serial={} boot={} name={}",
        hello.version,
        hello.reading_bytes,
        hex(&hello.design_sha256),
        hello.electrode_count,
        hello.slot_count,
        hello.reference_ohm.to_bits(),
        hello.source_v.to_bits(),
        hello.full_scale,
        hello.rate_millihertz,
        hello.highest_rate_millihertz,
        hello.baud,
        hello.serial,
        hello.boot,
        hex(hello.name.as_bytes()),
    )
}

fn frame_line(frame: &Frame<'_>) -> String {
    let wide = u8::from(frame.readings.reading_bytes() == 4);
    let readings: String = frame.readings.iter().map(|reading| format!("{reading},")).collect();
    let Frame { sequence, time_us, flags, .. } = frame;
    format!("frame sequence={sequence} time_us={time_us} flags={} wide={wide} readings={readings}", flags.bits())
}

fn status_line(status: &Status) -> String {
    let Status { uptime_ms, frames, dropped, damaged, temperature_cc, supply_mv } = status;
    format!(
        "status uptime_ms={uptime_ms} frames={frames} dropped={dropped} damaged={damaged} \
         temperature_cc={temperature_cc} supply_mv={supply_mv}"
    )
}

fn scan_line(part: &ScanPart<'_>) -> String {
    let slot = |slot: dermis_wire::Slot| {
        let [plus, minus] = slot.measure.unwrap_or([u16::MAX; 2]);
        format!("{}:{}:{plus}:{minus},", slot.source, slot.sink)
    };
    let slots: String = part.slots.iter().map(slot).collect();
    format!("scan first={} total={} slots={slots}", part.first, part.total)
}

/// The messages that this crate decodes, in the format of the program.
fn decoded(bytes: &[u8]) -> Vec<String> {
    let mut lines = Vec::new();
    Decoder::new([0; 4096]).feed(bytes, |received| match received {
        Received::Message(message) => lines.push(line(Message::parse(message))),
        Received::Damaged => lines.push("damaged".into()),
    });
    lines
}

fn assert_same(name: &str, bytes: &[u8], least: usize) {
    let Some(printed) = run("decode", name, bytes) else { return };
    let printed = String::from_utf8(printed).unwrap();
    let expected = decoded(bytes);
    assert!(expected.len() >= least);
    for (number, (printed, expected)) in printed.lines().zip(&expected).enumerate() {
        assert_eq!(printed, expected, "line {number}");
    }
    assert_eq!(printed.lines().count(), expected.len());
}

#[test]
fn c_decodes_the_vectors() {
    let vectors = written();
    let bytes: Vec<u8> = vectors.iter().flat_map(|(_, packet)| packet).copied().collect();
    assert_same("vectors.bin", &bytes, vectors.len());
}

#[test]
fn c_encodes_the_vectors() {
    let Some(bytes) = run("encode", "nothing.bin", &[]) else { return };
    let expected: Vec<u8> = written().into_iter().flat_map(|(_, packet)| packet).collect();
    assert!(bytes == expected, "C writes\n{}\nand the page\n{}", hex(&bytes), hex(&expected));
}

/// A tenth of the packets are altered, cut or joined, with noise between them.
#[test]
fn c_decodes_a_damaged_stream() {
    let rng = &mut ChaCha8Rng::seed_from_u64(3);
    let vectors = written();
    let mut stream = Vec::new();
    for _ in 0..5000 {
        let mut packet = vectors[rng.random_range(0..vectors.len())].1.clone();
        let at = rng.random_range(0..packet.len());
        match rng.random_range(0..40) {
            0 => packet[at] ^= rng.random_range(1..=255u8),
            1 => packet.truncate(at),
            2 => drop(packet.drain(..at)),
            3 => stream.extend((0..rng.random_range(1..300)).map(|_| rng.random::<u8>())),
            _ => {}
        }
        stream.extend(packet);
    }
    let lines = decoded(&stream);
    let damaged = lines.iter().filter(|line| *line == "damaged").count();
    assert!(damaged > 300 && lines.len() - damaged > 4000);
    assert_same("damaged.bin", &stream, 4500);
}
