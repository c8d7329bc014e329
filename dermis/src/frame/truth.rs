//! Ground truth of touches.

use crate::contact::Contact;
use crate::frame::TableError;
use crate::frame::table::{Table, read_table};
use crate::frame::write_whole;
use crate::geom::{PlaceLimits, Point3, Surface};
use crate::text::counted;
use std::path::Path;

/// More touches of a frame are a mistake: electrodes are at most 1,024, and no skin tells as many touches apart. The time to
/// simulate them and to match them with contacts stays below seconds.
const MAX_TOUCHES: usize = 1_000;

/// Ground truth of touches.
#[derive(Debug, Clone, PartialEq)]
pub enum Truth {
    /// The touches of each frame, in the body's frame.
    OnSkin(Vec<Vec<Contact>>),
    /// One press per frame in another coordinate frame (of a robot), to be aligned.
    Elsewhere {
        /// Positions, m.
        positions_m: Vec<Point3>,
        /// Force of each press, N; `NaN` if it is not known.
        forces_n: Vec<f64>,
    },
}

/// Reads a ground truth, one row per touch: `frame,z_m,theta_rad[,force_n]` on a cylinder, `frame,x_m,y_m[,force_n]` on
/// a flat skin, `frame,x_m,y_m,z_m[,force_n]` on any other body; `frame` counts from 0. A file without a header
/// contains x, y, z (m) and optionally the force (N) of one press for each frame in turn, in its own coordinate frame.
///
/// # Errors
/// As [`read_table`]; columns that are missing or unknown; a frame that does not exist, or has more than 1,000 touches; values that are not finite; a
/// position off the body, with the unit in which it is probably given.
pub fn read_truth(path: &Path, limits: &PlaceLimits, frame_count: usize) -> Result<Truth, TableError> {
    let table = read_table(path, "truth")?;
    for (row, &file_row) in table.rows.iter().zip(&table.file_rows) {
        if let Some(column) = row.iter().position(|value| !value.is_finite()) {
            let message = format!("the value is {}: it must be finite", row[column]);
            return Err(TableError::Cell {
                path: path.to_path_buf(),
                row: file_row,
                column: Some(column + 1),
                message,
            });
        }
    }
    match &table.header {
        Some(header) => on_skin(path, &table, header, limits, frame_count),
        None => elsewhere(path, &table, frame_count),
    }
}

/// Reads places on the skin, one per row, from a file with the columns of [`read_truth`]; `frame` and `force_n` are not
/// used and may be missing.
///
/// # Errors
/// As [`read_truth`]; a file without a header.
pub fn read_places(path: &Path, limits: &PlaceLimits) -> Result<Vec<Point3>, TableError> {
    let table = read_table(path, "places")?;
    let Some(header) = &table.header else {
        let columns = place_columns(&limits.surface).join(",");
        let message = format!("it has no header: begin with a line `{columns}`, lengths in m");
        return Err(TableError::File { path: path.to_path_buf(), message });
    };
    let columns = Columns::find(path, &table, header, &limits.surface, false)?;
    let place = |(row, &file_row): (&Vec<f64>, &usize)| {
        let path = path.to_path_buf();
        let touch = columns.touch(row, limits);
        touch.map(|touch| touch.position_m).map_err(|message| TableError::Cell {
            path,
            row: file_row,
            column: None,
            message,
        })
    };
    table.rows.iter().zip(&table.file_rows).map(place).collect()
}

/// Writes the touches of each frame in the format of [`read_truth`]; known forces as `force_n`.
///
/// # Errors
/// A file that cannot be written.
pub fn write_truth(path: &Path, surface: &Surface, truth: &[Vec<Contact>]) -> Result<(), TableError> {
    let force = truth.iter().flatten().all(|touch| touch.force_n.is_finite());
    write_whole(path, |out| {
        writeln!(out, "frame,{}{}", place_columns(surface).join(","), if force { ",force_n" } else { "" })?;
        for (frame, touches) in truth.iter().enumerate() {
            for touch in touches {
                let [x, y, z] = touch.position_m;
                match surface {
                    Surface::Cylinder { .. } => {
                        write!(out, "{frame},{z},{}", surface.theta_rad(touch.position_m).unwrap_or(0.0))?
                    }
                    Surface::Plane => write!(out, "{frame},{x},{y}")?,
                    Surface::Free => write!(out, "{frame},{x},{y},{z}")?,
                }
                if force {
                    write!(out, ",{}", touch.force_n)?;
                }
                writeln!(out)?;
            }
        }
        Ok(())
    })
}

/// The columns with the position of a touch on a surface.
fn place_columns(surface: &Surface) -> &'static [&'static str] {
    match surface {
        Surface::Cylinder { .. } => &["z_m", "theta_rad"],
        Surface::Plane => &["x_m", "y_m"],
        Surface::Free => &["x_m", "y_m", "z_m"],
    }
}

/// The frames after the last touch of a ground truth.
///
/// A ground truth may omit frames without a touch, but extra frames at the end are more often a mistake in counting.
pub fn frames_after_last_touch(truth: &[Vec<Contact>]) -> std::ops::Range<usize> {
    let end = truth.iter().rposition(|touches| !touches.is_empty()).map_or(0, |last| last + 1);
    end..truth.len()
}

/// The indices of the columns of a ground truth.
struct Columns {
    /// Missing in a file of places.
    frame: Option<usize>,
    place: Vec<usize>,
    force: Option<usize>,
}

impl Columns {
    fn find(
        path: &Path,
        table: &Table,
        header: &[String],
        surface: &Surface,
        needs_frame: bool,
    ) -> Result<Self, TableError> {
        let place = place_columns(surface);
        let known = |name: &str| name == "frame" || name == "force_n" || place.contains(&name);
        let wrong_header = |message: String| {
            let message = format!("{message}; the columns are frame,{}[,force_n]", place.join(","));
            TableError::Cell { path: path.to_path_buf(), row: 1, column: None, message }
        };
        if let Some(name) = header.iter().find(|name| !known(name)) {
            return Err(wrong_header(format!("unknown column `{name}`")));
        }
        let column = |name: &str| header.iter().position(|column| column == name);
        let needed = |name: &str| column(name).ok_or_else(|| wrong_header(format!("no column `{name}`")));
        let columns = Columns {
            frame: if needs_frame { Some(needed("frame")?) } else { column("frame") },
            place: place.iter().map(|name| needed(name)).collect::<Result<Vec<_>, _>>()?,
            force: column("force_n"),
        };
        if table.rows[0].len() != header.len() {
            return Err(wrong_header(format!("{} names over {} values", header.len(), table.rows[0].len())));
        }
        Ok(columns)
    }

    /// The frame of a row.
    fn frame(&self, row: &[f64], frame_count: usize) -> Result<usize, String> {
        let frame = self.frame.map_or(f64::NAN, |column| row[column]);
        if frame.fract() == 0.0 && frame >= 0.0 && frame < frame_count as f64 {
            return Ok(frame as usize);
        }
        Err(match frame_count {
            0 => format!("frame {frame}, but there are no frames"),
            _ => format!("frame {frame} does not exist: the frames are 0 to {}", frame_count - 1),
        })
    }

    /// The touch of a row.
    fn touch(&self, row: &[f64], limits: &PlaceLimits) -> Result<Contact, String> {
        let position_m = match *self.place.as_slice() {
            [z, theta] if matches!(limits.surface, Surface::Cylinder { .. }) => {
                limits.check_on_cylinder(row[z], row[theta]).expect("the surface is a cylinder")?
            }
            [x, y] => limits.check([row[x], row[y], 0.0])?,
            _ => limits.check([0, 1, 2].map(|axis| row[self.place[axis]]))?,
        };
        let normal = limits.surface.normal(position_m).unwrap_or([f64::NAN; 3]);
        Ok(Contact::truth(position_m, normal, self.force.map_or(f64::NAN, |column| row[column])))
    }
}

fn on_skin(
    path: &Path,
    table: &Table,
    header: &[String],
    limits: &PlaceLimits,
    frame_count: usize,
) -> Result<Truth, TableError> {
    let columns = Columns::find(path, table, header, &limits.surface, true)?;
    let mut touches = vec![Vec::new(); frame_count];
    for (values, &row) in table.rows.iter().zip(&table.file_rows) {
        let cell = |column: Option<usize>, message| TableError::Cell { path: path.to_path_buf(), row, column, message };
        let frame = columns
            .frame(values, frame_count)
            .map_err(|message| cell(columns.frame.map(|column| column + 1), message))?;
        let touch = columns.touch(values, limits).map_err(|message| cell(None, message))?;
        let frame_touches: &mut Vec<Contact> = &mut touches[frame];
        if frame_touches.len() == MAX_TOUCHES {
            let message = format!("frame {frame} has more than {MAX_TOUCHES} touches, the most that a frame can have");
            return Err(cell(columns.frame.map(|column| column + 1), message));
        }
        let id = frame_touches.len() as u64;
        frame_touches.push(Contact { id, ..touch });
    }
    Ok(Truth::OnSkin(touches))
}

fn elsewhere(path: &Path, table: &Table, frame_count: usize) -> Result<Truth, TableError> {
    let wrong = |message: String| TableError::File { path: path.to_path_buf(), message };
    if !(3..=4).contains(&table.rows[0].len()) {
        let message = format!(
            "a truth without a header has x, y, z and optionally a force in each row, not {} values",
            table.rows[0].len()
        );
        return Err(wrong(message));
    }
    if table.rows.len() != frame_count {
        let message = format!(
            "{} for {}: there must be one press in each frame",
            counted(table.rows.len(), "press"),
            counted(frame_count, "frame")
        );
        return Err(wrong(message));
    }
    let press = |row: &Vec<f64>| ([row[0], row[1], row[2]], row.get(3).copied().unwrap_or(f64::NAN));
    let (positions_m, forces_n) = table.rows.iter().map(press).unzip();
    Ok(Truth::Elsewhere { positions_m, forces_n })
}
