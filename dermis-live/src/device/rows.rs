//! Frames of an instrument that sends rows of values as text: no handshake, no scan table.

use crate::LiveError;
use crate::device::line::{Address, Line, open};
use crate::device::{DeviceEvent, DeviceFacts, DeviceOptions, IncomingFrame, READ_BYTES, Stream};
use dermis::frame::{FrameLine, FrameLines, LineError};
use dermis::pipeline::{GAP_S, Measurement, Notice, Severity, Timestamp};
use dermis::skin::Skin;
use dermis::text::counted;
use std::time::{Duration, Instant};

/// If so many first rows are wrong, all are.
const FIRST_ROWS: usize = 10;
/// Wrong rows that are reported one by one; after these, one report a second.
const REPORTED_AT_ONCE: usize = 8;
/// Interval between later reports of wrong rows.
const REPORT: Duration = Duration::from_secs(1);
/// Units in which boards count times, s.
const UNITS_S: [f64; 3] = [1.0, 1e-3, 1e-6];
/// Longest text of a value, bytes; a longer line is no row.
const VALUE_BYTES: usize = 64;

/// An instrument that sends rows of values.
pub(crate) struct RowReader {
    address: Address,
    line: Box<dyn Line>,
    buffer: Vec<u8>,
    text: RowText,
    lines: FrameLines,
    facts: DeviceFacts,
    stream: Stream,
    clock: RowClock,
    /// The design's channels have no sign, and the values are no differences.
    rectified: bool,
    /// The number of the next row.
    next: u64,
    /// Rows of this connection, and those of them that are no frames.
    rows: usize,
    wrong: usize,
    unreported: usize,
    reported_at: Option<Instant>,
}

impl RowReader {
    /// Opens the connection.
    ///
    /// # Errors
    /// An instrument that cannot be reached.
    pub(super) fn connect(
        address: &Address,
        from: &Address,
        skin: &Skin,
        options: DeviceOptions,
        stream: Stream,
    ) -> Result<Self, LiveError> {
        let protocol = &skin.design().protocol;
        let line = open(from)?;
        let facts = RowMessage::facts(options.rate_hz);
        Ok(RowReader {
            address: address.clone(),
            line,
            buffer: vec![0; READ_BYTES],
            text: RowText { begun: Vec::new(), longest: (protocol.channel_count() + 1) * VALUE_BYTES, too_long: false },
            lines: FrameLines::new(protocol.channel_count()),
            facts,
            next: stream.newest.map_or(0, |newest| newest + 1),
            clock: RowClock { rate_hz: options.rate_hz, is_live: *from != Address::Stdin, ..RowClock::default() },
            rectified: protocol.amplitude_only() && !options.difference,
            stream,
            rows: 0,
            wrong: 0,
            unreported: 0,
            reported_at: None,
        })
    }

    pub(super) fn facts(&self) -> &DeviceFacts {
        &self.facts
    }

    pub(super) fn into_stream(self) -> Stream {
        self.stream
    }

    /// Reads for a short time and passes the frames on.
    ///
    /// # Errors
    /// [`LiveError::Ended`] at the end of standard input, [`LiveError::Lost`] at the end of another connection,
    /// [`LiveError::Refused`] if no row fits the design.
    pub(super) fn listen(&mut self, mut publish: impl FnMut(DeviceEvent)) -> Result<(), LiveError> {
        let count = match self.line.receive(&mut self.buffer) {
            Ok(None) => return Ok(()),
            Ok(Some(count)) => count,
            Err(error) => return Err(self.ended(&error, &mut publish)),
        };
        let received_at = crate::clock::now();
        for text in self.text.feed(&self.buffer[..count]) {
            for taken in self.lines.take(&text) {
                match taken {
                    Ok(row) => self.frame(row, received_at, &mut publish),
                    Err(error) => self.wrong(&error, received_at, &mut publish)?,
                }
            }
        }
        Ok(())
    }

    fn frame(&mut self, row: FrameLine, received_at: Timestamp, publish: &mut impl FnMut(DeviceEvent)) {
        let mut values_ohm = row.values;
        if self.rectified {
            values_ohm.iter_mut().for_each(|value| *value = value.abs());
        }
        let (time_s, said) = self.clock.seconds(row.time_s, self.next);
        if let Some(text) = said {
            publish(DeviceEvent::Notice(Notice { level: Severity::Warning, text, at: received_at }));
        }
        let measured_at = self.clock.moment(time_s, self.next, received_at, &mut self.stream);
        let message = RowMessage { sequence: self.next, values_ohm };
        self.next += 1;
        self.rows += 1;
        let incoming = self.stream.row(message, measured_at, received_at);
        incoming.into_iter().for_each(|incoming| publish(DeviceEvent::Frame(Box::new(incoming))));
    }

    /// Counts a row that is no frame as lost, and reports it.
    fn wrong(
        &mut self,
        error: &LineError,
        at: Timestamp,
        publish: &mut impl FnMut(DeviceEvent),
    ) -> Result<(), LiveError> {
        self.rows += 1;
        self.next += 1;
        self.wrong += 1;
        if self.wrong == self.rows && self.wrong >= FIRST_ROWS && self.stream.newest.is_none() {
            let message = format!("none of its first {FIRST_ROWS} rows fits the design: {error}");
            return Err(LiveError::Refused { address: self.address.to_string(), message, identity: None });
        }
        if self.wrong > REPORTED_AT_ONCE && self.reported_at.is_some_and(|at| at.elapsed() < REPORT) {
            self.unreported += 1;
            return Ok(());
        }
        let others = match std::mem::take(&mut self.unreported) {
            0 => String::new(),
            count => format!(" (and {} before it)", counted(count, "row")),
        };
        self.reported_at = Some(Instant::now());
        let text = format!("a row of {} is lost: {error}{others}", self.address);
        publish(DeviceEvent::Notice(Notice { level: Severity::Warning, text, at }));
        Ok(())
    }

    /// The last rows, and the error at the end of the connection.
    fn ended(&mut self, error: &std::io::Error, publish: &mut impl FnMut(DeviceEvent)) -> LiveError {
        let (address, received_at) = (self.address.to_string(), crate::clock::now());
        if self.clock.is_live {
            return LiveError::Lost { address, message: error.to_string() };
        }
        let last = self.text.finish().map(|text| self.lines.take(&text)).unwrap_or_default();
        for taken in last.into_iter().chain(self.lines.finish().map(Ok)) {
            match taken {
                Ok(row) => self.frame(row, received_at, publish),
                // The input has ended anyway.
                Err(error) => drop(self.wrong(&error, received_at, publish)),
            }
        }
        if self.stream.newest.is_none() {
            let message = format!(
                "it ended after {} without a row that fits the design",
                counted(self.lines.line_count(), "line")
            );
            return LiveError::Refused { address, message, identity: None };
        }
        LiveError::Ended { address }
    }
}

/// Lines from received bytes.
struct RowText {
    /// The beginning of the next line.
    begun: Vec<u8>,
    /// Length of the longest line, bytes.
    longest: usize,
    /// The rest of a line that is too long is skipped.
    too_long: bool,
}

impl RowText {
    /// The lines that are complete with these bytes.
    fn feed(&mut self, bytes: &[u8]) -> Vec<String> {
        let mut lines = Vec::new();
        for piece in bytes.split_inclusive(|byte| *byte == b'\n') {
            self.begun.extend_from_slice(piece);
            if self.begun.len() > self.longest {
                self.begun.truncate(self.longest);
                self.too_long = true;
            }
            if piece.ends_with(b"\n") {
                lines.extend(self.finish());
            }
        }
        lines
    }

    /// The line that has begun. One that is too long is cut, so that it is not a row.
    fn finish(&mut self) -> Option<String> {
        let line = std::mem::take(&mut self.begun);
        let mut text = String::from_utf8_lossy(&line).into_owned();
        if std::mem::take(&mut self.too_long) {
            text.push_str("... (too long)");
        }
        (!text.is_empty()).then_some(text)
    }
}

/// Times of rows on the host's clock.
#[derive(Default)]
struct RowClock {
    /// Rows a second, where they have no times.
    rate_hz: Option<f64>,
    /// The rows come as they are measured; otherwise they may come from a file, faster.
    is_live: bool,
    /// The first time of a row with its number, and the unit of times, s, once they have risen.
    first: Option<(f64, u64)>,
    unit_s: Option<f64>,
    /// The first time and its host time.
    anchor: Option<(f64, Timestamp)>,
    last: Timestamp,
}

impl RowClock {
    /// The time of a row in seconds, and what is to be said of it once. Boards count seconds, milliseconds or microseconds: the unit
    /// is that in which the rows come at the stated rate, or else with the longest interval that is no gap. Times that do not rise
    /// are none.
    fn seconds(&mut self, time: Option<f64>, number: u64) -> (Option<f64>, Option<String>) {
        let Some(time) = time else { return (None, None) };
        if let Some(unit_s) = self.unit_s {
            return (Some(unit_s * time), None);
        }
        let Some((first, first_number)) = self.first else {
            self.first = Some((time, number));
            return (Some(time), None);
        };
        let is_second = number == first_number + 1;
        let step = (time - first) / (number - first_number) as f64;
        if step <= 0.0 {
            let text = "the times of its first rows do not rise: they are left out until they do";
            return (None, is_second.then(|| text.into()));
        }
        let found = match self.rate_hz {
            Some(rate_hz) => {
                let off = |unit_s: f64| (unit_s * step * rate_hz).ln().abs();
                UNITS_S.into_iter().min_by(|a, b| off(*a).total_cmp(&off(*b)))
            }
            None => UNITS_S.into_iter().find(|unit_s| unit_s * step <= GAP_S),
        };
        let unit_s = found.unwrap_or(UNITS_S[2]);
        self.unit_s = Some(unit_s);
        self.anchor = self.anchor.filter(|_| is_second).map(|(_, at)| (unit_s * first, at));
        let names = if unit_s == 1e-3 { "milliseconds" } else { "microseconds" };
        let hz = 1.0 / (unit_s * step);
        let text =
            format!("the times of its rows rise by {step} a row: they are taken for {names}, {hz:.0} rows a second");
        (Some(unit_s * time), (unit_s < 1.0).then_some(text))
    }

    /// The host time of a row: from its time or number, else when it was received.
    fn moment(&mut self, time_s: Option<f64>, number: u64, received_at: Timestamp, stream: &mut Stream) -> Timestamp {
        let Some(time_s) = time_s.or(self.rate_hz.map(|rate_hz| number as f64 / rate_hz)) else {
            self.last = self.last.max(received_at);
            return self.last;
        };
        let (first_s, first_at) = *self.anchor.get_or_insert((time_s, received_at));
        let since = Duration::try_from_secs_f64(time_s - first_s).ok();
        self.last = match since {
            Some(since) if self.is_live => stream.clock.moment(since.as_micros() as u64, received_at),
            Some(since) if first_at.after(since) >= self.last => first_at.after(since),
            _ => {
                // The instrument was restarted.
                stream.clock.restart();
                let now = received_at.max(self.last);
                self.anchor = Some((time_s, now));
                now
            }
        };
        self.last
    }
}

/// A row as recordings store it, in place of the message of a device: the byte `HELLO[0] + 1`, the number of the row
/// (`u64`) and the values (`f64`, ohm), little-endian. The hello is the byte `HELLO[0]` alone. No message of the wire
/// protocol begins with these bytes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RowMessage {
    /// Number of the row.
    pub sequence: u64,
    /// Its values, ohm.
    pub values_ohm: Vec<f64>,
}

impl RowMessage {
    /// The hello of an instrument that sends rows.
    pub(crate) const HELLO: [u8; 1] = [0xF0];
    const ROW: u8 = 0xF1;

    /// The facts of an instrument that sends rows.
    pub(crate) fn facts(rate_hz: Option<f64>) -> DeviceFacts {
        let (name, hello) = ("rows of values".into(), Self::HELLO.to_vec());
        DeviceFacts { name, serial: 0, rate_hz: rate_hz.unwrap_or(0.0), hello }
    }

    fn encode(&self) -> Vec<u8> {
        let values = self.values_ohm.iter().flat_map(|value| value.to_le_bytes());
        [Self::ROW].into_iter().chain(self.sequence.to_le_bytes()).chain(values).collect()
    }

    /// The row of a message; `None` for any other message.
    pub(crate) fn parse(message: &[u8]) -> Option<Self> {
        let (&kind, rest) = message.split_first()?;
        let (sequence, values) = rest.split_first_chunk::<8>()?;
        let (values, end) = values.as_chunks::<8>();
        (kind == Self::ROW && end.is_empty()).then(|| RowMessage {
            sequence: u64::from_le_bytes(*sequence),
            values_ohm: values.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect(),
        })
    }
}

impl Stream {
    /// Converts a row; `None` for one that is not new or of another size.
    pub(crate) fn row(
        &mut self,
        row: RowMessage,
        measured_at: Timestamp,
        received_at: Timestamp,
    ) -> Option<IncomingFrame> {
        if row.values_ohm.len() != self.skin.design().protocol.channel_count() {
            self.damaged += 1;
            return None;
        }
        let message = row.encode();
        let measurement = Measurement { values_ohm: row.values_ohm, ..Measurement::default() };
        let newest = self.arrived(row.sequence as u32)?;
        let input = self.input(newest, measured_at, measurement);
        Some(IncomingFrame { input, received_at, message })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_stored_bit_for_bit() {
        let row = RowMessage { sequence: 7 << 40, values_ohm: vec![1.0 / 3.0, -0.0, 1e-300] };
        assert_eq!(RowMessage::parse(&row.encode()), Some(row.clone()));
        assert_eq!(RowMessage::parse(&row.encode()[..20]), None);
        assert!(dermis_wire::ToHost::parse(&row.encode()).is_err());
        assert!(dermis_wire::ToHost::parse(&RowMessage::HELLO).is_err());
    }

    #[test]
    fn bytes_in_any_pieces_give_the_same_lines() {
        let bytes = b"1,2\r\n\n3,4\n\xff5\nlonger than eighteen bytes\n6";
        let read = |size: usize| {
            let mut text = RowText { begun: Vec::new(), longest: 18, too_long: false };
            let mut lines: Vec<String> = bytes.chunks(size).flat_map(|piece| text.feed(piece)).collect();
            lines.extend(text.finish());
            lines
        };
        assert_eq!(read(1).len(), 6);
        assert!(read(1)[4].ends_with("(too long)"));
        assert!((1..60).all(|size| read(size) == read(1)));
    }

    #[test]
    fn times_are_seconds_unless_rows_are_then_gaps_apart_or_at_another_rate() {
        let unit = |rate_hz: Option<f64>, times: [f64; 3]| {
            let mut clock = RowClock { rate_hz, ..RowClock::default() };
            let read: Vec<_> = (0..).zip(times).map(|(number, time)| clock.seconds(Some(time), number)).collect();
            (read[2].0, read.iter().filter(|(_, said)| said.is_some()).count())
        };
        assert_eq!(unit(None, [7.0, 7.05, 7.1]), (Some(7.1), 0));
        assert_eq!(unit(None, [0.0, 1.5, 3.0]), (Some(3.0), 0));
        assert_eq!(unit(None, [1203.0, 1253.0, 1303.0]), (Some(1.303), 1));
        assert_eq!(unit(None, [5e6, 5.05e6, 5.1e6]), (Some(5.1), 1));
        assert_eq!(unit(Some(800.0), [0.0, 1.0, 3.0]), (Some(0.003), 1));
        assert_eq!(unit(Some(20.0), [4.0, 4.0, 4.0]), (None, 1));
    }
}
