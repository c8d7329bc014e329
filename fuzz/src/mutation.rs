//! Seeded mutations of valid files, for the ordinary tests: bits flipped, bytes overwritten, numbers made extreme, lines and
//! parts removed, duplicated, moved between files.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Words that have caused failures in readers.
const WORDS: [&[u8]; 22] = [
    b"-1",
    b"0",
    b"18446744073709551615",
    b"9223372036854775808",
    b"2147483648",
    b"4294967296",
    b"1e308",
    b"-1e-320",
    b"nan",
    b"inf",
    b"\xff\xff\xff\xff",
    b"\x00\x00\x00\x80",
    b"\xff\xff\xff\xff\xff\xff\xff\x7f",
    b"\x00",
    b"\n",
    b"\r\n",
    b"\xef\xbb\xbf",
    b"\"",
    b"$End",
    b"]]",
    b"\xe2\x88\x9e",
    b",",
];

/// One to four changes of a valid file.
pub fn mutated(seeds: &[Vec<u8>], random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = seeds[random.random_range(0..seeds.len())].clone();
    for _ in 0..random.random_range(1..=4) {
        if bytes.is_empty() {
            break;
        }
        let at = random.random_range(0..bytes.len());
        match random.random_range(0..9) {
            0 => bytes[at] ^= 1 << random.random_range(0..8),
            1 => bytes[at] = random.random(),
            2 => bytes.truncate(at),
            3 => {
                let end = (at + random.random_range(1..64)).min(bytes.len());
                bytes.drain(at..end);
            }
            4 => {
                let end = (at + random.random_range(1..200)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                let to = random.random_range(0..=bytes.len());
                bytes.splice(to..to, piece);
            }
            5 => {
                let other = &seeds[random.random_range(0..seeds.len())];
                bytes.truncate(at);
                bytes.extend_from_slice(&other[at.min(other.len())..]);
            }
            6 => {
                let word = WORDS[random.random_range(0..WORDS.len())];
                let end = (at + word.len()).min(bytes.len());
                bytes.splice(at..end, word.iter().copied());
            }
            7 => replace_number(&mut bytes, at, WORDS[random.random_range(0..10)]),
            _ => {
                let line =
                    |from: usize| bytes[from..].iter().position(|&b| b == b'\n').map_or(bytes.len(), |k| from + k + 1);
                let (start, end) = (line(at), line(line(at)));
                let copy = bytes[start..end].to_vec();
                bytes.splice(start..end, if random.random() { [copy.clone(), copy].concat() } else { Vec::new() });
            }
        }
    }
    bytes
}

/// Replaces the number in a text at or after a position.
fn replace_number(bytes: &mut Vec<u8>, at: usize, with: &[u8]) {
    let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit).map(|offset| at + offset) else { return };
    let length = bytes[start..].iter().take_while(|&&b| b.is_ascii_digit() || b == b'.').count();
    bytes.splice(start..start + length, with.iter().copied());
}
