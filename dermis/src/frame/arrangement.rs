//! Frames as boards and programs arrange them in tables.

use crate::frame::Table;
use crate::protocol::Protocol;
use crate::text::counted;

/// A table with a frame in each row. Any other table is returned as it is.
///
/// # Errors
/// A table that can be frames as columns as well as one drive in each row.
pub(super) fn frames_in_rows(table: Table, protocol: &Protocol) -> Result<Table, String> {
    let (rows, width, channels) = (table.rows.len(), table.rows[0].len(), protocol.channel_count());
    if width == channels || width == channels + 1 {
        return Ok(table);
    }
    let (is_columns, drives) = (rows == channels, rows_per_frame(protocol, rows, width));
    match drives {
        Some(drives) if is_columns => Err(format!(
            "{} of {} may be {width} frames as columns, or {} with one drive in each row: write a frame in each row",
            counted(rows, "row"),
            counted(width, "value"),
            counted(rows / drives, "frame"),
        )),
        Some(drives) => Ok(chosen(joined(table, drives), protocol)),
        None if is_columns => Ok(transposed(&table)),
        None => Ok(chosen(table, protocol)),
    }
}

/// The rows of a frame, if each row may be the measures of one drive: those of the protocol, or all neighbouring pairs.
fn rows_per_frame(protocol: &Protocol, rows: usize, width: usize) -> Option<usize> {
    let mut measures = protocol.channels().chunk_by(|a, b| a.drive == b.drive).map(<[_]>::len);
    let drives = measures.clone().count();
    let fits = width > 1 && drives > 1 && rows.is_multiple_of(drives);
    (fits && (width == protocol.electrode_count() || measures.all(|count| count == width))).then_some(drives)
}

fn joined(table: Table, drives: usize) -> Table {
    Table {
        header: None,
        rows: table.rows.chunks(drives).map(<[Vec<f64>]>::concat).collect(),
        file_rows: table.file_rows.into_iter().step_by(drives).collect(),
    }
}

fn transposed(table: &Table) -> Table {
    let width = table.rows[0].len();
    let column = |index: usize| table.rows.iter().map(|row| row[index]).collect();
    Table { header: None, rows: (0..width).map(column).collect(), file_rows: (1..=width).collect() }
}

/// The channels of the protocol from rows that have, for each drive, the voltages between all neighbouring electrodes: the
/// measure between electrodes m and m + 1 is the m-th of its drive.
fn chosen(table: Table, protocol: &Protocol) -> Table {
    let (channels, electrodes) = (protocol.channels(), protocol.electrode_count());
    let drives = channels.chunk_by(|a, b| a.drive == b.drive).count();
    let width = table.rows[0].len();
    if width == channels.len() || width != drives * electrodes {
        return table;
    }
    let of_drive = |(drive, channels): (usize, &[crate::protocol::Channel])| {
        let place = move |[plus, minus]: [usize; 2]| {
            let first = if (plus + 1) % electrodes == minus { Some(plus) } else { None };
            first.or_else(|| ((minus + 1) % electrodes == plus).then_some(minus)).map(|first| drive * electrodes + first)
        };
        channels.iter().map(|channel| place(channel.measure)).collect::<Vec<_>>()
    };
    let places: Option<Vec<usize>> =
        channels.chunk_by(|a, b| a.drive == b.drive).enumerate().flat_map(of_drive).collect();
    let Some(places) = places else { return table };
    let rows = table.rows.iter().map(|row| places.iter().map(|&place| row[place]).collect()).collect();
    Table { header: None, rows, file_rows: table.file_rows }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows whose values are their places in the frame.
    fn table(rows: usize, width: usize) -> Table {
        let row = |row: usize| (0..width).map(|column| (row * width + column) as f64).collect();
        Table { header: None, rows: (0..rows).map(row).collect(), file_rows: (1..=rows).collect() }
    }

    #[test]
    fn frames_are_found_however_they_lie() {
        // Eight drives of five measures: 40 channels.
        let protocol = Protocol::adjacent_undriven(8).unwrap();
        let frames = |rows, width| frames_in_rows(table(rows, width), &protocol).map(|table| table.rows);
        assert_eq!(frames(3, 40).unwrap(), table(3, 40).rows, "a frame in each row");
        assert_eq!(frames(3, 41).unwrap(), table(3, 41).rows, "with a column of times");
        assert_eq!(frames(16, 5).unwrap(), table(2, 40).rows, "a drive in each row");
        let columns = frames(40, 2).unwrap();
        assert_eq!((columns.len(), &columns[1][..3]), (2, &[1.0, 3.0, 5.0][..]), "frames as columns");
        // Five frames as columns, or five with one drive in each row.
        assert!(frames(40, 5).unwrap_err().contains("5 frames as columns, or 5 frames"));
        // All neighbouring pairs, in one row and in one for each drive: of drive 0 (electrodes 0, 1) the measures 2 to 6.
        for whole in [frames(1, 64).unwrap(), frames(8, 8).unwrap()] {
            assert_eq!((whole.len(), &whole[0][..6]), (1, &[2.0, 3.0, 4.0, 5.0, 6.0, 11.0][..]));
        }
        assert_eq!(frames(7, 5).unwrap(), table(7, 5).rows, "no whole frame: refused later");
    }
}
