//! The stages of the study: their durations, and saved results, so that an interrupted run can continue.

use dermis::frame::write_whole;
use dermis_study::Progress;
use dermis_study::{Error, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A completed stage.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Done {
    /// Description.
    pub stage: String,
    /// Duration, s; nearly zero if its results were saved before.
    pub seconds: f64,
}

/// The stages of a run and their durations.
pub(crate) struct Schedule<'a> {
    progress: &'a dyn Progress,
    begun: Instant,
    planned: Vec<String>,
    done: Vec<Done>,
}

impl<'a> Schedule<'a> {
    /// A schedule of stages.
    pub(crate) fn new(planned: Vec<String>, progress: &'a dyn Progress) -> Self {
        Schedule { progress, begun: Instant::now(), planned, done: Vec::new() }
    }

    /// The list of stages.
    pub(crate) fn summary(&self) -> String {
        let stages = self.planned.iter().enumerate().map(|(number, stage)| format!("\n  {}  {stage}", number + 1));
        format!("stages:{}", stages.collect::<String>())
    }

    /// Runs the next stage and records its duration.
    pub(crate) fn stage<T>(&mut self, work: impl FnOnce(&Parts<'_>) -> Result<T>) -> Result<T> {
        let stage = self.planned[self.done.len()].clone();
        let begun = Instant::now();
        let result = work(&Parts::new(self.progress))?;
        let seconds = begun.elapsed().as_secs_f64();
        self.done.push(Done { stage: stage.clone(), seconds });
        self.progress.note(&format!(
            "{} of {}  {stage}: {}; {} so far",
            self.done.len(),
            self.planned.len(),
            time(seconds),
            time(self.elapsed_s())
        ));
        Ok(result)
    }

    /// The completed stages.
    pub(crate) fn done(&self) -> &[Done] {
        &self.done
    }

    /// Seconds since the start of the schedule.
    pub(crate) fn elapsed_s(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }
}

/// The parts of a stage. The remaining time is estimated from the completed parts, as soon as there is one.
pub(crate) struct Parts<'a> {
    progress: &'a dyn Progress,
    done: Cell<usize>,
    made: Cell<usize>,
    made_s: Cell<f64>,
}

impl<'a> Parts<'a> {
    fn new(progress: &'a dyn Progress) -> Self {
        Parts { progress, done: Cell::new(0), made: Cell::new(0), made_s: Cell::new(0.0) }
    }

    /// Runs one of `total` parts. Parts with saved results take no time, and are not used for the estimate.
    pub(crate) fn part<T>(&self, total: usize, work: &Work, part: impl FnOnce() -> Result<T>) -> Result<T> {
        let (made, begun) = (work.made.get(), Instant::now());
        let result = part()?;
        self.done.set(self.done.get() + 1);
        if work.made.get() > made {
            self.made.set(self.made.get() + 1);
            self.made_s.set(self.made_s.get() + begun.elapsed().as_secs_f64());
        }
        if let Some(left_s) = self.left_s(total) {
            let done = self.done.get();
            self.progress.note(&format!("    {done} of {total} parts; about {} left in this stage", time(left_s)));
        }
        Ok(result)
    }

    /// Estimated seconds for the remaining parts; `None` before the first computed part, and at the end.
    fn left_s(&self, total: usize) -> Option<f64> {
        let left = total.checked_sub(self.done.get()).filter(|&left| left > 0 && self.made.get() > 0)?;
        Some(left as f64 * self.made_s.get() / self.made.get() as f64)
    }
}

/// A duration as text.
pub(crate) fn time(seconds: f64) -> String {
    match seconds {
        s if s < 9.95 => format!("{s:.1} s"),
        s if s < 119.5 => format!("{s:.0} s"),
        s if s < 7170.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// A folder of saved results.
#[derive(Debug)]
pub(crate) struct Work {
    folder: PathBuf,
    key: String,
    /// Number of results that were computed, not read.
    made: Cell<usize>,
}

#[derive(Serialize, Deserialize)]
struct Kept<T> {
    key: String,
    value: T,
}

impl Work {
    /// A folder for results with one key: a text with all inputs of the results.
    pub(crate) fn new(folder: &Path, key: String) -> Result<Self> {
        std::fs::create_dir_all(folder).map_err(|source| Error::Folder { folder: folder.to_path_buf(), source })?;
        Ok(Work { folder: folder.to_path_buf(), key, made: Cell::new(0) })
    }

    /// Reads the saved result if its key is the same; otherwise computes and saves it. An unreadable file is computed
    /// again.
    pub(crate) fn kept<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        more_key: &str,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        let path = self.folder.join(format!("{name}.json"));
        let key = format!("{}; {more_key}", self.key);
        let there = std::fs::read(&path).ok().and_then(|bytes| serde_json::from_slice::<Kept<T>>(&bytes).ok());
        if let Some(kept) = there.filter(|kept| kept.key == key) {
            return Ok(kept.value);
        }
        let kept = Kept { key, value: make()? };
        let text = serde_json::to_string(&kept).map_err(|error| Error::Internal(error.to_string()))?;
        write_whole(&path, |out| out.write_all(text.as_bytes()))?;
        self.made.set(self.made.get() + 1);
        Ok(kept.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_is_kept_for_its_key_alone_and_a_torn_file_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let made = std::cell::Cell::new(0);
        let get = |key: &str| {
            let work = Work::new(folder.path(), key.to_string()).unwrap();
            let make = || {
                made.set(made.get() + 1);
                Ok(vec![Some(1.5), None])
            };
            work.kept("figures", "noser", make).unwrap()
        };
        assert_eq!(get("a"), vec![Some(1.5), None]);
        assert_eq!((get("a"), made.get()), (vec![Some(1.5), None], 1));
        get("b");
        assert_eq!(made.get(), 2);
        std::fs::write(folder.path().join("figures.json"), "{\"key\": \"b; noser\", \"val").unwrap();
        get("b");
        assert_eq!(made.get(), 3);
    }

    #[test]
    fn the_time_left_is_that_of_the_parts_that_were_made() {
        let folder = tempfile::tempdir().unwrap();
        let work = Work::new(folder.path(), "key".into()).unwrap();
        work.kept("0", "", || Ok(0)).unwrap();
        let parts = Parts::new(&());
        let part = |name: &str| parts.part(3, &work, || work.kept(name, "", || Ok(0))).unwrap();
        part("0");
        assert_eq!(parts.left_s(3), None, "a kept result gives no time");
        part("1");
        assert_eq!(parts.left_s(3), Some(parts.made_s.get()));
        part("2");
        assert_eq!((parts.left_s(3), parts.made.get()), (None, 2));
    }

    #[test]
    fn times_are_printed_in_suitable_units() {
        assert_eq!([0.31, 42.3, 300.0, 13_000.0].map(time), ["0.3 s", "42 s", "5 min", "3.6 h"].map(String::from));
    }
}
