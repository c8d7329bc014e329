//! The bytes of a file in order, and the starts of further recordings in it.

use mcap::MAGIC;
use mcap::records::op;
use std::io::{BufReader, Read, Result};

/// Length of the prefix of a record: its opcode and its length.
pub(super) const PREFIX_BYTES: usize = 9;
/// Length of what identifies the start of a recording: the magic bytes and the prefix of the header.
const START_BYTES: usize = MAGIC.len() + PREFIX_BYTES;
/// Length of what identifies a chunk: its prefix, its fields with the name of the compression, and the length of its records.
const LONGEST_START: usize = PREFIX_BYTES + 40 + 4;
/// Longest header of a recording: two short texts.
const LONGEST_HEADER: u64 = 0xffff;
/// Bytes that are searched at a time.
const BLOCK_BYTES: u64 = 1 << 16;

/// A file of known length.
pub(super) struct Source<R> {
    input: BufReader<R>,
    length: u64,
    /// Number of bytes taken.
    at: u64,
    /// Bytes that were put back, and how many of them were taken again.
    ahead: Vec<u8>,
    taken: usize,
    /// Number of bytes put back, which are read twice.
    reread: u64,
}

/// The bytes before the next place from which on a file can be read.
pub(super) struct Skipped {
    /// The first of them, as many as were wanted.
    pub first: Vec<u8>,
    /// Their number.
    pub bytes: u64,
    /// What begins after them; `None` if they extend to the end of the file.
    pub found: Option<Next>,
}

/// What begins after skipped bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Next {
    /// Another recording.
    Recording,
    /// A chunk of the same recording.
    Chunk,
}

impl<R: Read> Source<R> {
    pub(super) fn new(input: R, length: u64) -> Self {
        let input = BufReader::with_capacity(BLOCK_BYTES as usize, input);
        Source { input, length, at: 0, ahead: Vec::new(), taken: 0, reread: 0 }
    }

    /// Number of bytes taken.
    pub(super) fn at(&self) -> u64 {
        self.at
    }

    /// Number of bytes up to the end.
    pub(super) fn left(&self) -> u64 {
        self.length.saturating_sub(self.at)
    }

    /// The next bytes; fewer at the end of the file.
    pub(super) fn take(&mut self, count: u64) -> Result<Vec<u8>> {
        let count = count.min(self.left()) as usize;
        let mut bytes = Vec::with_capacity(count);
        let put_back = &self.ahead[self.taken..];
        bytes.extend_from_slice(&put_back[..put_back.len().min(count)]);
        self.taken += bytes.len();
        if self.taken == self.ahead.len() {
            (self.ahead, self.taken) = (Vec::new(), 0);
        }
        (&mut self.input).take((count - bytes.len()) as u64).read_to_end(&mut bytes)?;
        self.at += bytes.len() as u64;
        Ok(bytes)
    }

    /// Puts bytes back that were taken last.
    pub(super) fn put_back(&mut self, mut bytes: Vec<u8>) {
        self.at -= bytes.len() as u64;
        self.reread += bytes.len() as u64;
        bytes.extend_from_slice(&self.ahead[self.taken..]);
        (self.ahead, self.taken) = (bytes, 0);
    }

    /// The next bytes, which stay to be taken.
    fn peek(&mut self, count: usize) -> Result<Vec<u8>> {
        let bytes = self.take(count as u64)?;
        self.put_back(bytes.clone());
        self.reread -= bytes.len() as u64;
        Ok(bytes)
    }

    /// The next byte, which stays to be taken.
    pub(super) fn next_byte(&mut self) -> Result<Option<u8>> {
        Ok(self.peek(1)?.first().copied())
    }

    /// Whether another recording begins here.
    pub(super) fn begins(&mut self) -> Result<bool> {
        Ok(start(&self.peek(START_BYTES)?).is_some())
    }

    /// Whether another recording begins in the body of a record that was taken last: the record was truncated, and files
    /// were joined. Not if the recording is within the record, such as a file in a message: it ends in the record, and
    /// a record follows.
    pub(super) fn contains_start(&mut self, body: &[u8]) -> Result<bool> {
        // A file of many starts would be read many times.
        if self.reread > 2 * self.length {
            return Ok(false);
        }
        let after = self.peek(START_BYTES - 1)?;
        let across = body.len().saturating_sub(START_BYTES - 1);
        let begins_across = || start(&[&body[across..], &after].concat()).is_some_and(|at| across + at < body.len());
        let Some(at) = start(body) else { return Ok(begins_across()) };
        let ends = body[at + START_BYTES..].windows(MAGIC.len()).any(|bytes| bytes == MAGIC);
        let follows = match after.first_chunk::<PREFIX_BYTES>() {
            Some(&[kind, ref length @ ..]) => {
                is_opcode(kind) && u64::from_le_bytes(*length) <= self.left() - PREFIX_BYTES as u64
            }
            None => after.is_empty(),
        };
        Ok(!(ends && follows))
    }

    /// Whether a record begins here that may follow another one.
    pub(super) fn continues(&mut self) -> Result<bool> {
        let next = self.peek(LONGEST_START)?;
        let Some(&[kind, ref length @ ..]) = next.first_chunk::<PREFIX_BYTES>() else { return Ok(next.is_empty()) };
        let fits = u64::from_le_bytes(*length) <= self.left() - PREFIX_BYTES as u64;
        let is_known = (op::HEADER..=op::DATA_END).contains(&kind);
        Ok(start(&next) == Some(0) || fits && is_known && (kind != op::CHUNK || is_chunk(&next)))
    }

    /// Takes the bytes up to the start of another recording, or of a chunk where these are looked for, or up to the end; the
    /// first `keep` bytes are returned.
    pub(super) fn skip_to_start(&mut self, keep: u64, chunks: bool) -> Result<Skipped> {
        let (mut first, mut bytes) = (Vec::new(), 0);
        let mut window: Vec<u8> = Vec::new();
        loop {
            let block = self.take(BLOCK_BYTES)?;
            let is_end = block.is_empty();
            window.extend(block);
            let recording = start(&window).map(|at| (at, Next::Recording));
            // The bytes skipped begin with what is damaged.
            let from = usize::from(bytes == 0);
            let chunk = || (from..window.len()).find(|&at| window[at] == op::CHUNK && is_chunk(&window[at..]));
            let chunk = if chunks { chunk().map(|at| (at, Next::Chunk)) } else { None };
            let found = [recording, chunk].into_iter().flatten().min_by_key(|found| found.0);
            // A start may extend into the next block.
            let done = match (found, is_end) {
                (Some((at, _)), _) => at,
                (None, true) => window.len(),
                (None, false) => window.len().saturating_sub(LONGEST_START - 1),
            };
            let rest = window.split_off(done);
            let kept = (window.len() as u64).min(keep - first.len() as u64);
            first.extend_from_slice(&window[..kept as usize]);
            bytes += done as u64;
            window = rest;
            if found.is_some() || is_end {
                self.put_back(window);
                return Ok(Skipped { first, bytes, found: found.map(|found| found.1) });
            }
        }
    }
}

/// Whether some bytes begin with a chunk: its length is that of its fields and its records, and its compression is known.
fn is_chunk(bytes: &[u8]) -> bool {
    let number = |at: usize| bytes.get(at..)?.first_chunk().map(|bytes| u64::from_le_bytes(*bytes));
    let read = || {
        // The prefix; start and end time, length of the records unpacked; checksum.
        let (length, from, to) = (number(1)?, number(9)?, number(17)?);
        let compression = bytes.get(37..)?.first_chunk().map(|bytes| u32::from_le_bytes(*bytes))?;
        let name = bytes.get(41..41 + usize::try_from(compression).ok().filter(|length| *length <= 4)?)?;
        let packed = number(41 + name.len())?;
        let is_known = [&b""[..], b"lz4", b"zstd"].contains(&name);
        Some(is_known && from <= to && packed.checked_add(40 + name.len() as u64) == Some(length))
    };
    bytes.first() == Some(&op::CHUNK) && read().unwrap_or(false)
}

/// Whether records of this kind exist; others may be added by programs.
fn is_opcode(kind: u8) -> bool {
    (op::HEADER..=op::DATA_END).contains(&kind) || kind >= 0x80
}

/// The position of the first start of a recording.
fn start(bytes: &[u8]) -> Option<usize> {
    let is_start = |bytes: &[u8]| {
        bytes.starts_with(MAGIC)
            && bytes[MAGIC.len()] == op::HEADER
            && bytes[MAGIC.len() + 1..]
                .first_chunk()
                .is_some_and(|length| u64::from_le_bytes(*length) <= LONGEST_HEADER)
    };
    bytes.windows(START_BYTES).position(is_start)
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: &[u8] = b"\x89MCAP0\r\n\x01\x08\0\0\0\0\0\0\0";

    /// Wherever the start is, across the blocks that are searched too.
    #[test]
    fn a_start_is_found_at_any_position() {
        let block = BLOCK_BYTES as usize;
        for before in [0, 1, 100, block - 17, block - 16, block - 3, block, block + 5, 3 * block - 1] {
            let mut bytes = vec![0x89; before];
            bytes.extend_from_slice(START);
            bytes.extend([7; 40]);
            let mut source = Source::new(&bytes[..], bytes.len() as u64);
            let skipped = source.skip_to_start(50, true).unwrap();
            assert!(skipped.found == Some(Next::Recording) && skipped.bytes == before as u64, "{before}");
            assert_eq!(skipped.first.len(), before.min(50));
            assert_eq!(source.at(), before as u64);
            assert_eq!(source.take(START.len() as u64).unwrap(), START);
            let rest = source.skip_to_start(1000, true).unwrap();
            assert!(rest.found.is_none() && rest.first == [7; 40] && source.left() == 0);
        }
    }

    #[test]
    fn a_chunk_is_found_at_any_position() {
        let fields = |name: &[u8], packed: u64| {
            let times = [5u64.to_le_bytes(), 9u64.to_le_bytes(), 1000u64.to_le_bytes()].concat();
            let name = [&(name.len() as u32).to_le_bytes(), name].concat();
            [
                &[op::CHUNK][..],
                &(packed + 36 + name.len() as u64).to_le_bytes(),
                &times,
                &[1; 4],
                &name,
                &packed.to_le_bytes(),
            ]
            .concat()
        };
        for name in [&b""[..], b"lz4", b"zstd"] {
            let chunk = [fields(name, 70), vec![3; 70]].concat();
            for before in [1, 60, BLOCK_BYTES as usize - 53, BLOCK_BYTES as usize - 20, BLOCK_BYTES as usize] {
                let bytes = [&vec![op::CHUNK; before][..], &chunk].concat();
                let mut source = Source::new(&bytes[..], bytes.len() as u64);
                let skipped = source.skip_to_start(0, true).unwrap();
                assert_eq!((skipped.found, skipped.bytes), (Some(Next::Chunk), before as u64), "{name:?} {before}");
                assert!(source.continues().unwrap());
            }
        }
        assert!(!is_chunk(&fields(b"none", 70)) && !is_chunk(&fields(b"lz4", 70)[..30]));
    }

    #[test]
    fn a_start_within_a_record_is_one_unless_the_recording_ends_there_too() {
        let next = [&[op::CHANNEL][..], &3u64.to_le_bytes(), &[0; 3]].concat();
        let (other, cut) = (&[0x7f; 12][..], &[2; 8][..]);
        for (inner, body_bytes, follow, expected) in [
            (cut, 45, other, true),
            (cut, 45, &next, true),
            (MAGIC, 45, &next, false),
            (MAGIC, 45, &[], false),
            (MAGIC, 45, other, true),
            (cut, 28, other, true),
            (cut, 21, other, true),
            (cut, 20, other, false),
        ] {
            let all = [&[1; 20][..], START, inner, follow].concat();
            let mut source = Source::new(&all[..], all.len() as u64);
            let body = source.take(body_bytes).unwrap();
            assert_eq!(source.contains_start(&body).unwrap(), expected, "{inner:?} {body_bytes} {follow:?}");
            assert_eq!(source.at(), body_bytes);
        }
    }
}
