//! The stages of a reproduction: how long each takes, and results kept so that a run that was stopped goes on.

use crate::progress::Progress;
use crate::{Error, Result};
use dermis::frame::write_whole;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A stage that is done.
#[derive(Debug, Clone, Serialize)]
pub struct Done {
    /// What was done.
    pub stage: String,
    /// How long it took, s; nearly nothing where its results were there.
    pub seconds: f64,
    /// How long it was expected to take, s.
    pub estimate_s: f64,
}

/// The time budget.
pub struct Budget<'a> {
    progress: &'a dyn Progress,
    begun: Instant,
    planned: Vec<(String, f64)>,
    done: Vec<Done>,
}

impl<'a> Budget<'a> {
    /// A budget of stages with the seconds that each is expected to take.
    pub fn new(planned: Vec<(String, f64)>, progress: &'a dyn Progress) -> Self {
        Budget { progress, begun: Instant::now(), planned, done: Vec::new() }
    }

    /// The stages and what each is expected to take, for people.
    pub fn summary(&self) -> String {
        let stages = self.planned.iter().map(|(stage, seconds)| format!("  {:>7}  {stage}\n", time(*seconds)));
        let whole = self.planned.iter().fold(0.0, |sum, stage| sum + stage.1);
        format!("expected on two cores:\n{}  {:>7}  in all", stages.collect::<String>(), time(whole))
    }

    /// Carries out the next stage of the plan and tells how the budget stands.
    pub fn stage<T>(&mut self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let number = self.done.len();
        let (stage, estimate_s) = self.planned[number].clone();
        let begun = Instant::now();
        let result = work()?;
        let seconds = begun.elapsed().as_secs_f64();
        self.done.push(Done { stage: stage.clone(), seconds, estimate_s });
        // From nought: the sum of nothing is minus zero.
        let left = self.planned[number + 1..].iter().fold(0.0, |sum, stage| sum + stage.1);
        self.progress.note(&format!(
            "{} of {}  {stage}: {} (expected {}); {} so far, about {} left",
            number + 1,
            self.planned.len(),
            time(seconds),
            time(estimate_s),
            time(self.begun.elapsed().as_secs_f64()),
            time(left)
        ));
        Ok(result)
    }

    /// The stages that are done.
    pub fn done(&self) -> &[Done] {
        &self.done
    }

    /// Seconds since the budget began.
    pub fn elapsed_s(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }
}

/// A time for people.
pub fn time(seconds: f64) -> String {
    match seconds {
        s if s < 9.95 => format!("{s:.1} s"),
        s if s < 119.5 => format!("{s:.0} s"),
        s if s < 7170.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// A folder of results that are done.
#[derive(Debug)]
pub struct Work {
    folder: PathBuf,
    key: String,
}

#[derive(Serialize, Deserialize)]
struct Kept<T> {
    key: String,
    value: T,
}

impl Work {
    /// A folder for results of one key: everything that they depend on, written out.
    pub fn new(folder: &Path, key: String) -> Result<Self> {
        std::fs::create_dir_all(folder).map_err(|source| Error::Folder { folder: folder.to_path_buf(), source })?;
        Ok(Work { folder: folder.to_path_buf(), key })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// A result that was kept, where it depends on the same; else it is made and kept. A file that cannot be read as one
    /// is made again.
    pub fn kept<T: Serialize + DeserializeOwned>(
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
    fn times_are_told_in_what_people_count_by() {
        assert_eq!([0.31, 42.3, 300.0, 13_000.0].map(time), ["0.3 s", "42 s", "5 min", "3.6 h"].map(String::from));
    }
}
