//! Progress of long work, as a program may show it.
//!
//! ```
//! use dermis_study::progress::{Progress, Task};
//!
//! // `()` shows nothing; a program shows a bar here.
//! let task = ().begin("reconstructing", 900);
//! task.advance(900);
//! ```

/// Shows the progress of long work. The unit type shows nothing.
pub trait Progress: Sync {
    /// Begins a task of `total` steps; it ends when the returned value is dropped.
    fn begin(&self, what: &str, total: usize) -> Box<dyn Task + '_>;

    /// Shows a line of text at once, such as the end of a stage.
    fn note(&self, line: &str);
}

/// A task in progress.
pub trait Task: Sync {
    /// Counts further steps as done.
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
