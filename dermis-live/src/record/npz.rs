//! A recording as arrays for NumPy.

use crate::record::RecordError;
use crate::record::convert::{Columns, Converted, Row, Rows, numbers};
use crate::ros::{CONTACT_FIELDS, Image};
use npyz::{AutoSerialize, NpyWriter, WriterBuilder};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

type Archive = ZipWriter<BufWriter<File>>;

/// Writes the arrays. Frames and images are read once more each: they may be larger than memory.
pub(super) fn write(path: &Path, to: &Path, sizes: &Converted, columns: &Columns) -> Result<(), RecordError> {
    let io = |source| RecordError::io(to, source);
    let mut archive = ZipWriter::new(BufWriter::new(File::create_new(to).map_err(io)?));
    let frames = sizes.frames as u64;
    let [rows, image_columns] = sizes.picture.map(|side| side as u64);
    pictures(path, &mut archive, ("frames", &[frames, sizes.channels as u64]), sizes, to, |row| &row.values)?;
    pictures(path, &mut archive, ("images", &[frames, rows, image_columns]), sizes, to, |row| &row.image)?;
    small(&mut archive, columns).map_err(io)?;
    let mut file = archive.finish().map_err(|error| io(error.into()))?;
    file.flush().map_err(io)
}

fn pictures(
    path: &Path,
    archive: &mut Archive,
    (name, shape): (&str, &[u64]),
    sizes: &Converted,
    to: &Path,
    pick: impl Fn(&Row) -> &Image,
) -> Result<(), RecordError> {
    let io = |source| RecordError::io(to, source);
    let mut array = begin::<f32>(archive, name, shape).map_err(io)?;
    let mut rows = Rows::open(path)?;
    let mut sizes = Converted { left_out: Vec::new(), ..sizes.clone() };
    let mut left = sizes.frames;
    // More may have been recorded since the first time.
    while left > 0
        && let Some(row) = rows.next()?
    {
        if sizes.takes(&row) {
            numbers(pick(&row)).try_for_each(|value| array.push(&value)).map_err(io)?;
            left -= 1;
        }
    }
    array.finish().map_err(io)
}

fn small(archive: &mut Archive, columns: &Columns) -> std::io::Result<()> {
    array(archive, "sequences", columns.sequences.iter().copied())?;
    array(archive, "measured_ns", columns.measured_ns.iter().copied())?;
    array(archive, "output_ns", columns.output_ns.iter().copied())?;
    array(archive, "contact_frame", columns.contact_frames.iter().copied())?;
    for (index, (field, _)) in CONTACT_FIELDS.iter().enumerate() {
        let name = format!("contact_{field}");
        let bytes = columns.contacts.iter().map(|contact| contact[index]);
        match *field {
            "id" => array(archive, &name, bytes.map(u32::from_le_bytes))?,
            _ => array(archive, &name, bytes.map(f32::from_le_bytes))?,
        }
    }
    Ok(())
}

fn array<T: AutoSerialize>(
    archive: &mut Archive,
    name: &str,
    values: impl ExactSizeIterator<Item = T>,
) -> std::io::Result<()> {
    let mut array = begin::<T>(archive, name, &[values.len() as u64])?;
    array.extend(values)?;
    array.finish()
}

fn begin<'a, T: AutoSerialize>(
    archive: &'a mut Archive,
    name: &str,
    shape: &[u64],
) -> std::io::Result<NpyWriter<T, &'a mut Archive>> {
    // Stored as it is: the last digits are noise, and NumPy reads it at once.
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored).large_file(true);
    archive.start_file(format!("{name}.npy"), options)?;
    npyz::WriteOptions::<T>::new().default_dtype().shape(shape).writer(archive).begin_nd()
}
