//! Progress of long computations.
//!
//! ```
//! use dermis_study::progress::{Progress, Task};
//!
//! // `()` shows nothing; a program shows a bar here.
//! let task = ().begin("reconstructing", 900);
//! task.advance(900);
//! ```

/// Displays the progress of long computations. The unit type displays nothing.
pub trait Progress: Sync {
    /// Begins a task with `total` steps; it ends when the returned value is dropped.
    fn begin(&self, what: &str, total: usize) -> Box<dyn Task + '_>;

    /// Displays a line of text immediately, for example at the end of a stage.
    fn note(&self, line: &str);
}

/// A task in progress.
pub trait Task: Sync {
    /// Marks further steps as done.
    fn advance(&self, steps: usize);
}

impl Progress for () {
    fn begin(&self, _what: &str, _total: usize) -> Box<dyn Task + '_> {
        Box::new(())
    }

    fn note(&self, _line: &str) {}
}

impl Task for () {
    fn advance(&self, _steps: usize) {}
}
