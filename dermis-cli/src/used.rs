//! The frames of a file that are used: those with all values.

use crate::console::warn;
use crate::failure::{Failure, Outcome};
use crate::rows::{Rows, chosen};
use dermis::frame::Frame;
use dermis::text::{counted, number_of, ranges};
use std::path::Path;

/// The rows of a file whose frames are used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Used {
    /// Their numbers in the file, ascending from 0, headers not counted.
    pub rows: Vec<usize>,
    /// The number of frames in the file.
    pub count: usize,
}

impl Used {
    /// All frames.
    pub fn all(count: usize) -> Self {
        Used { rows: (0..count).collect(), count }
    }

    /// The frames whose values are all finite; warns of the others.
    ///
    /// # Errors
    /// A channel without a value in any frame; most frames with missing values.
    pub fn of(path: &Path, frames: &[Frame]) -> Outcome<Self> {
        let is_whole = |frame: &Frame| frame.iter().all(|value| value.is_finite());
        let (rows, others): (Vec<usize>, Vec<usize>) = (0..frames.len()).partition(|&row| is_whole(&frames[row]));
        if others.is_empty() {
            return Ok(Used::all(frames.len()));
        }
        let (path, all) = (path.display(), counted(frames.len(), "frame"));
        let channels = frames.first().map_or(0, |frame| frame.len());
        let bad = |channel: usize| frames.iter().filter(|frame| !frame[channel].is_finite()).count();
        let empty: Vec<usize> = (0..channels).filter(|&channel| bad(channel) == frames.len()).collect();
        if !empty.is_empty() {
            let message =
                format!("{path}: no value in any of {all} in {} {}", number_of(empty.len(), "channel"), ranges(&empty));
            let fix = format!("record them, or leave them out in commands that take --leave-out {}", ranges(&empty));
            return Err(Failure::given(message, Some(&fix)));
        }
        if rows.len() < others.len() {
            let message = format!("{path}: {} of {all} have values that are missing or not finite", others.len());
            let worst = (0..channels).max_by_key(|&channel| bad(channel)).unwrap_or_default();
            let fix = format!(
                "record them anew; most are missing in channel {worst}, which commands with --leave-out can leave out"
            );
            return Err(Failure::given(message, Some(&fix)));
        }
        warn(&format!(
            "{path}: {} of {all} have values that are missing or not finite and are not used: {}",
            others.len(),
            ranges(&others)
        ));
        Ok(Used { rows, count: frames.len() })
    }

    /// The frames that are used here and there.
    pub fn and(mut self, other: &Used) -> Self {
        self.rows.retain(|row| other.rows.binary_search(row).is_ok());
        self
    }

    /// The rows in the file of some frames that are used.
    pub fn rows_of(&self, frames: &[usize]) -> Vec<usize> {
        frames.iter().map(|&frame| self.rows[frame]).collect()
    }

    /// What belongs to the frames that are used.
    pub fn select<T: Clone>(&self, all: &[T]) -> Vec<T> {
        self.rows.iter().map(|&row| all[row].clone()).collect()
    }

    /// Which of the frames that are used an option chooses, from 0; all of them without a choice.
    pub fn chosen(&self, rows: Option<&Rows>, option: &str) -> Outcome<Vec<usize>> {
        let rows = chosen(rows, self.count, option)?;
        let used: Vec<usize> = rows.iter().filter_map(|row| self.rows.binary_search(row).ok()).collect();
        if used.is_empty() {
            let message = format!("{option} chooses no frame that has all its values");
            return Err(Failure::given(message, Some("choose others")));
        }
        Ok(used)
    }
}
