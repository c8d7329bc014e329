//! Frames as boards and programs arrange them in tables.

use crate::frame::Table;
use crate::frame::names::{ColumnName, by_number};
use crate::protocol::{Channel, Protocol};
use crate::text::counted;

/// Sum of the voltages round a ring over the sum of their magnitudes: more is no ring. Boards print four digits or more.
const MAX_RING_SUM: f64 = 1e-2;

/// A table with a frame in each row. Any other table is returned as it is.
///
/// # Errors
/// A table that can be read in two ways; columns that are no frames.
pub(super) fn frames_in_rows(table: Table, protocol: &Protocol) -> Result<Table, String> {
    let (rows, width, channels) = (table.rows.len(), table.rows[0].len(), protocol.channel_count());
    if width == channels || width == channels + 1 {
        return Ok(table);
    }
    let table = without_drive_numbers(table, protocol)?;
    let joined = joined(&table, protocol)?;
    match (joined, rows == channels) {
        (Some(joined), true) => Err(format!(
            "{} of {} may be frames as columns, or {} with one drive in each row: write a frame in each row",
            counted(rows, "row"),
            counted(width, "value"),
            counted(joined.rows.len(), "frame"),
        )),
        (Some(joined), false) => Ok(joined),
        (None, true) => transposed(table),
        (None, false) => match chosen(&table, protocol) {
            Some(chosen) => Ok(chosen),
            None => wrong_width(table, protocol),
        },
    }
}

/// A table that has no arrangement of frames.
///
/// # Errors
/// Rows whose length is that of some arrangement, but not their values.
fn wrong_width(table: Table, protocol: &Protocol) -> Result<Table, String> {
    let (drives, electrodes, channels) = (drives(protocol), protocol.electrode_count(), protocol.channel_count());
    let (rows, width) = (table.rows.len(), table.rows[0].len());
    let are_drives = drives.len() > 1 && rows > 1 && rows.is_multiple_of(drives.len());
    if (drives.len() > 1 && width == drives.len() * electrodes && width != 2 * channels)
        || (are_drives && width == electrodes)
    {
        return Err(format!(
            "too many values: {}, but frames of this protocol have {channels}: they may be those between all neighbouring \
             electrodes, but do not add up to zero for each drive, as amplitudes: leave the pairs with driven electrodes out",
            if width == electrodes { drives.len() * width } else { width }
        ));
    }
    if are_drives && drives.iter().all(|channels| channels.len() + 1 == width) {
        return Err(format!(
            "rows of {width} values, one more than a drive has: if the first is the drive's number, count from 0 or 1 in each frame"
        ));
    }
    Ok(table)
}

fn drives(protocol: &Protocol) -> Vec<&[Channel]> {
    protocol.channels().chunk_by(|a, b| a.drive == b.drive).collect()
}

/// Frames from rows of one drive each, if these can be that: the measures of the protocol, or all neighbouring pairs.
///
/// # Errors
/// Rows that are missing, by their number or by lines between them.
fn joined(table: &Table, protocol: &Protocol) -> Result<Option<Table>, String> {
    let (drives, width) = (drives(protocol), table.rows[0].len());
    let are_measures = drives.iter().all(|channels| channels.len() == width);
    let rows = table.rows.len();
    if width < 2 || drives.len() < 2 {
        return Ok(None);
    }
    if !rows.is_multiple_of(drives.len()) {
        return match are_measures && rows > drives.len() {
            true => Err(format!(
                "{} of {width} values, one drive each, are no whole number of frames of {}: mend or remove the frame that lacks some",
                counted(rows, "row"),
                counted(drives.len(), "row"),
            )),
            false => Ok(None),
        };
    }
    let blocks: Vec<&[usize]> = table.file_rows.chunk_by(|a, b| b - a == 1).collect();
    let is_whole = |block: &&&[usize]| block.len().is_multiple_of(drives.len());
    if 2 * blocks.iter().filter(is_whole).count() >= blocks.len()
        && let Some(block) = blocks.iter().find(|block| !is_whole(block))
    {
        return Err(format!(
            "frames have {} of one drive each, but the rows {} to {}, between lines without values, are {}: mend or remove them",
            counted(drives.len(), "row"),
            block[0],
            block[block.len() - 1],
            block.len(),
        ));
    }
    let whole = Table {
        header: None,
        rows: table.rows.chunks(drives.len()).map(<[Vec<f64>]>::concat).collect(),
        file_rows: table.file_rows.iter().copied().step_by(drives.len()).collect(),
    };
    Ok(if are_measures { Some(whole) } else { chosen(&whole, protocol) })
}

/// Rows of one drive each without a first column of the drives' numbers, which count from 0 or 1 in each frame.
///
/// # Errors
/// A number that does not follow the one before.
fn without_drive_numbers(mut table: Table, protocol: &Protocol) -> Result<Table, String> {
    let drives = drives(protocol);
    let width = table.rows[0].len();
    let are_measures = |channels: &&[Channel]| channels.len() + 1 == width || protocol.electrode_count() + 1 == width;
    let has_one_more = drives.len() > 1 && drives.iter().all(are_measures);
    let first = table.rows[0][0];
    let is_number = |row: &Vec<f64>| row[0].fract() == 0.0 && (0.0..=drives.len() as f64).contains(&row[0]);
    if !has_one_more || !(first == 0.0 || first == 1.0) || !table.rows.iter().all(is_number) {
        return Ok(table);
    }
    for (index, (row, file_row)) in table.rows.iter_mut().zip(&table.file_rows).enumerate() {
        let (number, expected) = (row.remove(0), first + (index % drives.len()) as f64);
        if number != expected {
            return Err(format!(
                "row {file_row} is of the drive {number}, where {expected} follows: mend or remove the rows of its frame"
            ));
        }
    }
    table.header = None;
    Ok(table)
}

/// A row for each column. A first column of channel numbers, which may have any order, is obeyed and dropped.
///
/// # Errors
/// A first column that is named as that and is not; columns of whole numbers.
fn transposed(mut table: Table) -> Result<Table, String> {
    let whole = |row: &Vec<f64>| (row[0] >= 0.0 && row[0].fract() == 0.0).then_some(row[0] as usize);
    let numbers: Option<Vec<usize>> = table.rows.iter().map(whole).collect();
    let order = numbers.and_then(|numbers| by_number(numbers.into_iter(), table.rows.len()));
    let name = table.header.as_ref().and_then(|header| header.first());
    let is_number =
        |name: &&String| ColumnName::of(name) == ColumnName::RowNumbers || name.eq_ignore_ascii_case("channel");
    match (order, name.filter(is_number)) {
        _ if table.rows[0].len() == 1 => {}
        (Some(order), _) => table.rows = order.iter().map(|&row| table.rows[row][1..].to_vec()).collect(),
        (None, Some(name)) => {
            return Err(format!(
                "the first column, `{name}`, must have the number of each channel once, from 0 or 1, as there is a row for each"
            ));
        }
        (None, None) => {}
    }
    let width = table.rows[0].len();
    let column = |index: usize| -> Vec<f64> { table.rows.iter().map(|row| row[index]).collect() };
    let columns: Vec<Vec<f64>> = (0..width).map(column).collect();
    if columns.iter().any(|column| column.iter().all(|value| value.fract() == 0.0)) {
        let rows = counted(table.rows.len(), "row");
        return Err(format!(
            "{rows}, as many as channels, but a column of whole numbers is no frame: keep the columns of values, with decimal \
             points, or write a frame in each row"
        ));
    }
    Ok(Table { header: None, file_rows: (1..=width).collect(), rows: columns })
}

/// The channels of the protocol from rows that have, for each drive, the voltages between all neighbouring electrodes: the
/// measure between electrodes m and m + 1 is the m-th of its drive. Such voltages add up to zero.
fn chosen(table: &Table, protocol: &Protocol) -> Option<Table> {
    let (drives, electrodes) = (drives(protocol), protocol.electrode_count());
    if table.rows[0].len() != drives.len() * electrodes {
        return None;
    }
    let is_ring = |ring: &[f64]| {
        ring.iter().sum::<f64>().abs() <= MAX_RING_SUM * ring.iter().map(|value| value.abs()).sum::<f64>()
    };
    // Missing values hide the sum of their ring.
    let is_whole = |ring: &&[f64]| ring.iter().all(|value| value.is_finite());
    let mut rings = table.rows.iter().flat_map(|row| row.chunks_exact(electrodes)).filter(is_whole).peekable();
    if rings.peek().is_none() || !rings.all(is_ring) {
        return None;
    }
    let place = |drive: usize, [plus, minus]: [usize; 2]| {
        let is_next = |a: usize, b: usize| (a + 1) % electrodes == b;
        let first = if is_next(plus, minus) { Some(plus) } else { is_next(minus, plus).then_some(minus) };
        first.map(|first| drive * electrodes + first)
    };
    let measures =
        drives.iter().enumerate().flat_map(|(drive, channels)| channels.iter().map(move |c| (drive, c.measure)));
    let places: Vec<usize> = measures.map(|(drive, measure)| place(drive, measure)).collect::<Option<_>>()?;
    let rows = table.rows.iter().map(|row| places.iter().map(|&place| row[place]).collect()).collect();
    Some(Table { header: None, rows, file_rows: table.file_rows.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows whose values are their places in the frame, and a half.
    fn table(rows: usize, width: usize) -> Table {
        let row = |row: usize| (0..width).map(|column| (row * width + column) as f64 + 0.5).collect();
        Table { header: None, rows: (0..rows).map(row).collect(), file_rows: (1..=rows).collect() }
    }

    #[test]
    fn frames_are_found_however_they_lie() {
        // Eight drives of five measures: 40 channels.
        let protocol = Protocol::adjacent_undriven(8).unwrap();
        let read = |table| frames_in_rows(table, &protocol);
        let frames = |rows, width| read(table(rows, width)).unwrap().rows;
        assert_eq!(frames(3, 40), table(3, 40).rows, "a frame in each row");
        assert_eq!(frames(3, 41), table(3, 41).rows, "with a column of times");
        assert_eq!(frames(16, 5), table(2, 40).rows, "a drive in each row");
        let mut numbered = table(16, 6);
        numbered.rows.iter_mut().enumerate().for_each(|(row, values)| values[0] = (row % 8) as f64);
        assert_eq!(read(numbered).unwrap().rows.len(), 2, "with the drive's number");
        assert_eq!(frames(1, 5), table(1, 5).rows, "no whole frame: refused later");
        // Voltages between potentials: a row of all pairs, and a row of them for each drive.
        let mut rings = table(8, 8);
        let potential = |drive: usize, electrode: usize| ((3 * drive + 1) as f64 * electrode as f64).sin();
        let voltage = |drive, m| potential(drive, m) - potential(drive, (m + 1) % 8);
        rings.rows = (0..8).map(|drive| (0..8).map(|m| voltage(drive, m)).collect()).collect();
        let one_row = Table { rows: vec![rings.rows.concat()], file_rows: vec![1], header: None };
        let mut numbered = rings.clone();
        numbered.rows.iter_mut().enumerate().for_each(|(drive, row)| row.insert(0, 1.0 + drive as f64));
        for whole in [rings, numbered, one_row] {
            let frames = read(whole).unwrap().rows;
            // Of drive 0 (electrodes 0, 1) the measures 2 to 6, of drive 1 the measures 3 to 7.
            assert_eq!((frames.len(), frames[0].len()), (1, 40));
            assert_eq!((frames[0][0], frames[0][5]), (voltage(0, 2), voltage(1, 3)));
        }
        // Amplitudes are not around a ring; a frame lacks a row; numbers of drives in another way.
        for (rows, width, message) in [
            (1, 64, "too many values: 64, but frames of this protocol have 40"),
            (16, 8, "leave the pairs with driven electrodes out"),
            (15, 5, "15 rows of 5 values, one drive each, are no whole number of frames of 8 rows"),
            (16, 6, "count from 0 or 1 in each frame"),
        ] {
            let error = read(table(rows, width)).unwrap_err();
            assert!(error.contains(message), "{error}");
        }
    }

    #[test]
    fn frames_as_columns_are_told_from_lists() {
        let protocol = Protocol::adjacent_undriven(8).unwrap();
        let read = |table| frames_in_rows(table, &protocol);
        let columns = read(table(40, 2)).unwrap().rows;
        assert_eq!((columns.len(), &columns[1][..3]), (2, &[1.5, 3.5, 5.5][..]));
        // A first column of channel numbers.
        let mut numbered = table(40, 3);
        numbered.rows.iter_mut().enumerate().for_each(|(channel, row)| row[0] = channel as f64);
        assert_eq!(read(numbered.clone()).unwrap().rows.len(), 2);
        // In another order; and twice the same.
        let expected = read(numbered.clone()).unwrap().rows;
        numbered.rows.swap(3, 30);
        assert_eq!(read(numbered.clone()).unwrap().rows, expected);
        numbered.header = Some(["channel", "a", "b"].map(String::from).into());
        numbered.rows[5][0] = 7.0;
        assert!(read(numbered).unwrap_err().contains("`channel`, must have the number of each channel once"));
        // Five frames as columns, or five with one drive in each row.
        assert!(read(table(40, 5)).unwrap_err().contains("frames as columns, or 5 frames"));
        // A list of electrodes and values; decimal commas.
        let mut list = table(40, 3);
        list.rows.iter_mut().enumerate().for_each(|(channel, row)| (row[0], row[1]) = ((channel / 5) as f64, 3.0));
        assert!(read(list).unwrap_err().contains("a column of whole numbers is no frame"));
    }
}
