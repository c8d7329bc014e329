//! Conversion of recordings to tables.

use crate::recording::read::{Messages, ReadItem};
use crate::recording::walk::End;
use crate::recording::{RecordError, Session, npz};
use crate::sinks::ros2::{self as ros, CONTACT_COLUMNS, ContactColumn, Image, PointCloud2, Topic};
use dermis::files::NewFolder;
use dermis::text::counted;
use serde::Serialize;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Summary of a conversion.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Converted {
    /// Complete frames.
    pub frames: usize,
    /// Values per frame.
    pub channels: usize,
    /// Rows and columns of an image.
    pub picture: [usize; 2],
    /// Contacts in all frames.
    pub contacts: usize,
    /// What was skipped: damaged parts and frames, frames of another skin, and a truncated end.
    pub left_out: Vec<String>,
    /// How many of these are damaged.
    pub damaged: usize,
}

/// Converts a recording to a folder:
///
/// - `frames.csv`: the values of one frame per row, ohm, as every command of `dermis` reads them;
/// - `times.csv`: the number of each frame, and the times of its measurement and of its contacts, s since 1970;
/// - `contacts.csv`: each contact of each frame;
/// - `recording.npz`: all of these and the images, for NumPy.
///
/// The folder is created completely or not at all.
///
/// # Errors
/// A file that is not a recording of frames; a folder that exists; a system error.
pub fn convert(path: &Path, folder: &Path) -> Result<Converted, RecordError> {
    if folder.exists() {
        return Err(RecordError::Exists { path: folder.to_path_buf() });
    }
    let io = |source| RecordError::io(folder, source);
    let beside = NewFolder::beside(folder).map_err(io)?;
    let (mut converted, columns) = tables(path, &beside.path())?;
    npz::write(path, &beside.path().join("recording.npz"), &converted, &columns)?;
    converted.contacts = columns.contact_frames.len();
    beside.finish().map_err(io)?;
    Ok(converted)
}

/// Data small enough to keep in memory while the file is read.
#[derive(Default)]
pub(super) struct Columns {
    pub sequences: Vec<u32>,
    pub measured_ns: Vec<u64>,
    pub output_ns: Vec<u64>,
    /// The frame of each contact.
    pub contact_frames: Vec<u64>,
    /// The bytes of each contact, in the order of [`CONTACT_COLUMNS`].
    pub contacts: Vec<Vec<[u8; 4]>>,
}

/// A complete frame.
pub(super) struct Row {
    pub sequence: u32,
    pub measured_ns: u64,
    pub output_ns: u64,
    pub values: Image,
    pub image: Image,
    pub contacts: PointCloud2,
}

/// Reads a recording frame by frame.
pub(super) struct Rows {
    messages: Messages,
    values: Option<(mcap::records::MessageHeader, Image)>,
    image: Option<Image>,
    pub left_out: Vec<String>,
    damaged: usize,
}

impl Rows {
    pub(super) fn open(path: &Path) -> Result<Self, RecordError> {
        Ok(Rows { messages: Messages::open(path)?, values: None, image: None, left_out: Vec::new(), damaged: 0 })
    }

    /// The next complete frame. Unreadable parts are skipped and reported.
    pub(super) fn next(&mut self) -> Result<Option<Row>, RecordError> {
        while let Some(item) = self.messages.next_item(&mut Session::default())? {
            let taken = match item {
                ReadItem::Message { topic: Some(topic), header, data } => self.take(topic, header, &data),
                ReadItem::Message { .. } | ReadItem::Session => Ok(None),
                ReadItem::Damaged { at, why } => Err(format!("byte {at}: {why}")),
            };
            match taken {
                Ok(Some(row)) => return Ok(Some(row)),
                Ok(None) => {}
                Err(why) => self.leave_out(why),
            }
        }
        let bytes_of = |bytes| counted(bytes, "byte");
        self.left_out.extend(match self.messages.walk.end() {
            Some(End::Cut { at, bytes: 0 }) => {
                Some(format!("byte {at}: the recording was not finished; what came then is missing"))
            }
            Some(End::Cut { at, bytes }) => {
                Some(format!("byte {at}: the recording was cut; {} at its end are left out", bytes_of(bytes)))
            }
            Some(End::Followed { at, bytes }) => {
                Some(format!("byte {at}: {} follow the end of the recording and are left out", bytes_of(bytes)))
            }
            Some(End::Whole) | None => None,
        });
        Ok(None)
    }

    fn leave_out(&mut self, why: String) {
        self.left_out.push(why);
        self.damaged += 1;
    }

    /// A frame is complete with its contacts, which are written after its values and its image.
    fn take(&mut self, topic: Topic, header: mcap::records::MessageHeader, data: &[u8]) -> Result<Option<Row>, String> {
        let place = |error: ros::DecodeError| format!("frame {}: {error}", header.sequence);
        match topic {
            Topic::Frame => {
                self.image = None;
                self.values = Some((header, ros::decode(data).map_err(place)?));
            }
            Topic::Image => self.image = Some(ros::decode(data).map_err(place)?),
            Topic::Contacts => {
                let contacts: PointCloud2 = ros::decode(data).map_err(place)?;
                let (Some((first, values)), Some(image)) = (self.values.take(), self.image.take()) else {
                    return Ok(None);
                };
                let row = Row {
                    sequence: first.sequence,
                    measured_ns: first.log_time,
                    output_ns: first.publish_time,
                    values,
                    image,
                    contacts,
                };
                check(&row)?;
                return Ok((first.sequence == header.sequence).then_some(row));
            }
            _ => {}
        }
        Ok(None)
    }
}

/// Checks a frame against the sizes that it states.
fn check(row: &Row) -> Result<(), String> {
    let cells = |image: &Image| u64::from(image.height) * u64::from(image.width) * 4;
    let fits = |image: &Image| image.encoding == "32FC1" && cells(image) == image.data.len() as u64;
    let points = u64::from(row.contacts.width) * u64::from(row.contacts.point_step);
    if fits(&row.values) && fits(&row.image) && points == row.contacts.data.len() as u64 {
        Ok(())
    } else {
        Err(format!("frame {}: its arrays have other sizes than it says", row.sequence))
    }
}

/// The values of an image message.
pub(super) fn numbers(image: &Image) -> impl Iterator<Item = f32> {
    image.data.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes))
}

/// Writes the CSV files.
fn tables(path: &Path, folder: &Path) -> Result<(Converted, Columns), RecordError> {
    let create = |name: &str| {
        let file = folder.join(name);
        File::create_new(&file).map(BufWriter::new).map_err(|source| RecordError::io(&file, source))
    };
    let [mut frames, mut times, mut contacts] = [create("frames.csv")?, create("times.csv")?, create("contacts.csv")?];
    let io = |source| RecordError::io(folder, source);
    let names: Vec<&str> = CONTACT_COLUMNS.iter().map(|column| column.column).collect();
    writeln!(times, "sequence,measured_s,output_s").map_err(io)?;
    writeln!(contacts, "frame,measured_s,{}", names.join(",")).map_err(io)?;
    let mut rows = Rows::open(path)?;
    let (mut converted, mut columns) = (Converted::default(), Columns::default());
    while let Some(row) = rows.next()? {
        if !converted.takes(&row) {
            rows.left_out.push(format!("frame {}: of another size than the first", row.sequence));
            continue;
        }
        frame_line(&mut frames, &row.values).map_err(io)?;
        writeln!(times, "{},{},{}", row.sequence, seconds(row.measured_ns), seconds(row.output_ns)).map_err(io)?;
        contact_lines(&mut contacts, converted.frames, &row, &mut columns).map_err(io)?;
        columns.sequences.push(row.sequence);
        columns.measured_ns.push(row.measured_ns);
        columns.output_ns.push(row.output_ns);
        converted.frames += 1;
    }
    for mut file in [frames, times, contacts] {
        file.flush().map_err(io)?;
    }
    (converted.left_out, converted.damaged) = (rows.left_out, rows.damaged);
    if converted.frames == 0 {
        return Err(RecordError::lacks(path, "holds no frame: nothing was recorded, or not by `dermis live`"));
    }
    Ok((converted, columns))
}

impl Converted {
    /// Whether a frame has the same size as the first.
    pub(super) fn takes(&mut self, row: &Row) -> bool {
        let (channels, picture) = (row.values.width as usize, [row.image.height as usize, row.image.width as usize]);
        if self.frames == 0 {
            (self.channels, self.picture) = (channels, picture);
        }
        (self.channels, self.picture) == (channels, picture)
    }
}

fn frame_line(file: &mut impl Write, values: &Image) -> std::io::Result<()> {
    for (index, value) in numbers(values).enumerate() {
        let comma = if index == 0 { "" } else { "," };
        write!(file, "{comma}{value:?}")?;
    }
    writeln!(file)
}

fn contact_lines(file: &mut impl Write, frame: usize, row: &Row, columns: &mut Columns) -> std::io::Result<()> {
    let offsets: Vec<Option<usize>> = CONTACT_COLUMNS.iter().map(|column| offset(column, &row.contacts)).collect();
    for point in row.contacts.data.chunks_exact((row.contacts.point_step as usize).max(1)) {
        write!(file, "{frame},{}", seconds(row.measured_ns))?;
        let bytes = |offset: &Option<usize>| point.get((*offset)?..)?.first_chunk().copied();
        let contact = offsets.iter().map(|offset| bytes(offset).unwrap_or(f32::NAN.to_le_bytes())).collect();
        for (column, &bytes) in CONTACT_COLUMNS.iter().zip(&contact) {
            match column.is_count {
                true => write!(file, ",{}", u32::from_le_bytes(bytes))?,
                // What is not known is empty in a table.
                false if f32::from_le_bytes(bytes).is_nan() => write!(file, ",")?,
                false => write!(file, ",{:?}", f32::from_le_bytes(bytes))?,
            }
        }
        writeln!(file)?;
        columns.contact_frames.push(frame as u64);
        columns.contacts.push(contact);
    }
    Ok(())
}

/// Where a point cloud has a number of a contact; `None` in a recording of a version without it.
fn offset(column: &ContactColumn, contacts: &PointCloud2) -> Option<usize> {
    // Its name in recordings of earlier versions.
    let earlier = if column.ros == "conductance" { "sign" } else { column.ros };
    let field = contacts.fields.iter().find(|field| field.name == column.ros || field.name == earlier)?;
    Some(field.offset as usize)
}

/// Seconds with nine decimals, which a 64-bit float would not represent.
fn seconds(ns: u64) -> String {
    format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}
