//! The starts of a search that are done, in a file.

use super::options::Start;
use super::{Judgement, Objective, OptimiseError, finite};
use dermis::files::{MAX_SETTINGS_BYTES, read_text_at_most};
use dermis::frame::write_whole;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A layout with its exact bounds; none where a place has none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct FoundLayout {
    pub(super) start: Start,
    pub(super) worst_m: Option<f64>,
    pub(super) mean_m: Option<f64>,
}

impl FoundLayout {
    pub(super) fn new(start: Start, judgement: &Judgement) -> Self {
        FoundLayout { start, worst_m: finite(judgement.worst_m), mean_m: finite(judgement.mean_m) }
    }

    pub(super) fn objective_m(&self, objective: Objective) -> f64 {
        let value = match objective {
            Objective::Worst => self.worst_m,
            Objective::Mean => self.mean_m,
        };
        value.unwrap_or(f64::INFINITY)
    }
}

/// The starts that are done, with what they depend on.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct State {
    /// Design, twin and options.
    conditions: String,
    found: Vec<FoundLayout>,
    #[serde(skip)]
    path: Option<PathBuf>,
}

impl State {
    /// The state in a file, or an empty one.
    pub(super) fn open(path: Option<&Path>, conditions: String) -> crate::Result<Self> {
        let Some(path) = path.filter(|path| path.exists()) else {
            return Ok(State { conditions, found: Vec::new(), path: path.map(Path::to_path_buf) });
        };
        let refused = |why: String, fix: &'static str| OptimiseError::State { path: path.to_path_buf(), why, fix };
        let text = read_text_at_most(path, MAX_SETTINGS_BYTES).map_err(|error| {
            refused(error.to_string(), "give a state of `dermis optimise`, or a file that does not exist")
        })?;
        let state: State = serde_json::from_str(&text).map_err(|error| {
            refused(format!("no state of a search: {error}"), "delete the file to begin again, or name another")
        })?;
        if state.conditions != conditions {
            let fix = "name another file with --state, or give the same design, twin and options";
            return Err(refused("the state is of a search with another design, twin or options".into(), fix).into());
        }
        Ok(State { path: Some(path.to_path_buf()), ..state })
    }

    fn of(&self, count: usize) -> impl Iterator<Item = &FoundLayout> {
        self.found.iter().filter(move |found| found.start.electrodes_m.len() == count)
    }

    pub(super) fn has(&self, count: usize, index: usize) -> bool {
        self.of(count).any(|found| found.start.index == index)
    }

    /// Adds a start, and writes the file.
    pub(super) fn add(&mut self, found: FoundLayout) -> crate::Result<()> {
        self.found.push(found);
        let Some(path) = &self.path else { return Ok(()) };
        let text = serde_json::to_string_pretty(self).expect("numbers and texts are JSON");
        Ok(write_whole(path, |out| out.write_all(text.as_bytes()))?)
    }

    /// The best of the first starts with a number of electrodes.
    pub(super) fn best(&self, count: usize, starts: usize, objective: Objective) -> Option<FoundLayout> {
        let first = self.of(count).filter(|found| found.start.index < starts);
        // Starts that ran in parallel are in no particular order.
        let order = |a: &&FoundLayout, b: &&FoundLayout| {
            let by_objective = a.objective_m(objective).total_cmp(&b.objective_m(objective));
            by_objective.then(a.start.index.cmp(&b.start.index))
        };
        first.min_by(order).cloned()
    }
}
