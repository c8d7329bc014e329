//! `docs/wire-protocol.md` agrees with the crate: its test vectors and its tables of baud rates are compared with it.

mod firmware_c;
mod vectors;

use dermis_wire::{Decoder, Frame, Received, bytes_per_second, smallest_baud};
use std::fmt::Write;
use vectors::{Message, page, said, written};

/// The expected text of the vectors in the document.
fn vector_block() -> String {
    let mut block = String::new();
    said(|name, message| {
        let packet = message.packet();
        for (row, bytes) in packet.chunks(32).enumerate() {
            let hex: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
            writeln!(block, "{:10} {}", if row == 0 { name } else { "" }, hex.join(" ")).unwrap();
        }
    });
    block
}

#[test]
fn the_vectors_are_what_encode_writes() {
    let expected = vector_block();
    assert!(page().contains(&format!("```text\n{expected}```")), "the page should hold\n{expected}");
}

#[test]
fn the_vectors_say_what_parse_reads() {
    let mut written = written().into_iter();
    said(|name, message| {
        let (written_name, packet) = written.next().expect("a vector for each message");
        assert_eq!(written_name, name);
        let mut found = 0;
        Decoder::new([0; 4096]).feed(&packet, |received| {
            let Received::Message(bytes) = received else { panic!("{name} is damaged") };
            assert_eq!(Message::parse(bytes), Some(message), "{name}");
            found += 1;
        });
        assert_eq!(found, 1, "{name}");
    });
    assert_eq!(written.next(), None);
}

/// The statements of the document on two vectors hold, so that the vectors show what they should.
#[test]
fn the_vectors_reach_the_edges() {
    let packet = |name| written().into_iter().find(|vector| vector.0 == name).expect("the vector is there").1;
    let full = packet("fault_254");
    assert_eq!((full.len(), full[1]), (2 + 255, 0xff), "one full block and no byte more");
    let long = packet("frame_long");
    assert!(long.windows(256).any(|bytes| bytes[0] == 0xff), "a full block");
    assert_eq!(long[1..].iter().position(|&byte| byte == 0), Some(long.len() - 2));
}

const DESIGNS: [(&str, usize); 3] = [("cylinder30", 900), ("tank16", 224), ("skin16", 208)];

/// A whole number with commas.
fn commas(number: u64) -> String {
    let digits = number.to_string();
    let groups: Vec<&str> = digits.as_bytes().rchunks(3).rev().map(|group| str::from_utf8(group).unwrap()).collect();
    groups.join(",")
}

#[test]
fn the_speeds_are_what_the_crate_computes() {
    let mut table = String::new();
    for (design, slots) in DESIGNS {
        for (bytes, rate) in [(2, 120), (4, 120), (2, 1000)] {
            let needed = bytes_per_second(slots, bytes, rate * 1000);
            let baud = smallest_baud(needed).map_or("none".into(), |baud| commas(baud.into()));
            let (packet, bits) = (commas(Frame::packet_bytes(slots, bytes) as u64), commas(10 * needed));
            writeln!(
                table,
                "| `{design}` | {slots} | {bytes} | {packet} | {} | {bits} | {baud} |",
                commas(rate.into())
            )
            .unwrap();
        }
    }
    assert!(page().contains(&format!("---:|\n{table}\n")), "the page should hold\n{table}");
}

#[test]
fn the_rates_are_what_the_crate_computes() {
    let mut table = String::new();
    for (design, slots) in DESIGNS {
        for bytes in [2, 4] {
            write!(table, "| `{design}` | {bytes} |").unwrap();
            for baud in [115_200, 460_800, 921_600, 2_000_000, 3_000_000] {
                let fits = |&rate: &u32| 10 * bytes_per_second(slots, bytes, rate * 1000) <= baud;
                let most = (1..).take_while(fits).last().unwrap_or(0);
                write!(table, " {} |", commas(most.into())).unwrap();
            }
            table.push('\n');
        }
    }
    assert!(page().contains(&format!("---:|\n{table}\n")), "the page should hold\n{table}");
}

/// By hand: 900 readings of two bytes are 16 + 1800 bytes, 4 of checksum, 8 of COBS, 2 zero bytes; a status has 28.
#[test]
fn the_speed_of_the_papers_skin_by_hand() {
    assert_eq!(Frame::packet_bytes(900, 2), 1830);
    assert_eq!(bytes_per_second(900, 2, 120_000), 1830 * 120 + 28);
    assert_eq!(smallest_baud(1830 * 120 + 28), Ok(2_500_000));
    // A partial byte is rounded up; the highest baud rate is the last, and nothing overflows.
    assert_eq!(bytes_per_second(900, 2, 1), 2 + 28);
    assert_eq!((smallest_baud(400_000), smallest_baud(400_001)), (Ok(4_000_000), Err(4_000_010)));
    assert_eq!(smallest_baud(u64::MAX), Err(u64::MAX));
    assert_eq!(smallest_baud(0), Ok(9600));
}
