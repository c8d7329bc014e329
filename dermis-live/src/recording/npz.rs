//! A recording as arrays for NumPy.

use crate::recording::RecordError;
use crate::recording::convert::{Columns, Converted, Row, Rows};
use crate::sinks::ros2::{CONTACT_COLUMNS, Image};
use dermis::frame::npy_header;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

type Archive = ZipWriter<BufWriter<File>>;

/// Writes the arrays. Frames and images are read again for each array, because they may exceed the memory.
pub(super) fn write(path: &Path, to: &Path, sizes: &Converted, columns: &Columns) -> Result<(), RecordError> {
    let io = |source| RecordError::io(to, source);
    let mut archive = ZipWriter::new(BufWriter::new(File::create_new(to).map_err(io)?));
    let (frames, [rows, image_columns]) = (sizes.frames, sizes.picture);
    pictures(path, &mut archive, ("frames", &[frames, sizes.channels]), sizes, to, |row| &row.values)?;
    pictures(path, &mut archive, ("images", &[frames, rows, image_columns]), sizes, to, |row| &row.image)?;
    small(&mut archive, columns).map_err(io)?;
    let mut file = archive.finish().map_err(|error| io(error.into()))?;
    file.flush().map_err(io)
}

fn pictures(
    path: &Path,
    archive: &mut Archive,
    (name, shape): (&str, &[usize]),
    sizes: &Converted,
    to: &Path,
    pick: impl Fn(&Row) -> &Image,
) -> Result<(), RecordError> {
    let io = |source| RecordError::io(to, source);
    begin(archive, name, "<f4", shape).map_err(io)?;
    let mut rows = Rows::open(path)?;
    let mut sizes = Converted { left_out: Vec::new(), ..sizes.clone() };
    let mut left = sizes.frames;
    // Frames may have been recorded since the first pass.
    while left > 0
        && let Some(row) = rows.next()?
    {
        if sizes.takes(&row) {
            archive.write_all(&pick(&row).data).map_err(io)?;
            left -= 1;
        }
    }
    Ok(())
}

fn small(archive: &mut Archive, columns: &Columns) -> std::io::Result<()> {
    array(archive, "sequences", "<u4", columns.sequences.iter().map(|value| value.to_le_bytes()))?;
    array(archive, "measured_ns", "<u8", columns.measured_ns.iter().map(|value| value.to_le_bytes()))?;
    array(archive, "output_ns", "<u8", columns.output_ns.iter().map(|value| value.to_le_bytes()))?;
    array(archive, "contact_frame", "<u8", columns.contact_frames.iter().map(|value| value.to_le_bytes()))?;
    for (index, column) in CONTACT_COLUMNS.iter().enumerate() {
        let dtype = if column.is_count { "<u4" } else { "<f4" };
        let name = format!("contact_{}", column.column);
        array(archive, &name, dtype, columns.contacts.iter().map(|contact| contact[index]))?;
    }
    Ok(())
}

/// Writes one array, given the little-endian bytes of its values.
fn array<const N: usize>(
    archive: &mut Archive,
    name: &str,
    dtype: &str,
    mut values: impl ExactSizeIterator<Item = [u8; N]>,
) -> std::io::Result<()> {
    begin(archive, name, dtype, &[values.len()])?;
    values.try_for_each(|value| archive.write_all(&value))
}

fn begin(archive: &mut Archive, name: &str, dtype: &str, shape: &[usize]) -> std::io::Result<()> {
    // Stored uncompressed: the last digits are noise, and NumPy reads it faster.
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored).large_file(true);
    archive.start_file(format!("{name}.npy"), options)?;
    archive.write_all(&npy_header(dtype, shape))
}
