//! The input frames of a command, as differences from the untouched skin.

use crate::console::{Progress, warn};
use crate::failure::{Failure, Outcome};
use crate::format::{FormatArguments, divided};
use crate::method::MethodArguments;
use crate::skin;
use crate::used::Used;
use clap::{ArgGroup, Args};
use dermis::finding::Finding;
use dermis::fit::model_differences;
use dermis::frame::{Differences, DriveCurrents, Frame, ReadOptions, broken_channels, mean};
use dermis::plausibility::Plausibility;
use dermis::protocol::Protocol;
use dermis::reconstruct::ReconstructError;
use dermis::skin::Skin;
use dermis::text::counted;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// The value of `--baseline` for the model's own untouched frame; a file of that name is `./model`.
const MODEL: &str = "model";

/// Where frames come from.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("rest").args(["baseline", "difference"]).required(true))]
pub struct FrameArguments {
    /// Frames, one per row (CSV, NPY or NPZ; ohm, or see --unit).
    #[arg(long, value_name = "FILE")]
    pub frames: PathBuf,
    /// Untouched frames, one per row; their mean is the baseline. With 8 or more, the noise is measured from their
    /// scatter. `model` is the untouched frame of the design, scaled to the frames: see `dermis fit`.
    #[arg(long, value_name = "FILE|model")]
    pub baseline: Option<PathBuf>,
    /// The frames are differences from the untouched skin.
    #[arg(long)]
    pub difference: bool,
    #[arg(long, requires = "baseline", help = PAIRED_HELP)]
    pub paired: bool,
    /// Go on with frames that are not those of the design, or not of the baseline.
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub currents: CurrentArguments,
}

/// Help of `--paired`.
pub const PAIRED_HELP: &str = "Each row of --baseline is the untouched frame of the same row of --frames, as recordings \
    have them that go up and down at each press: slow drift cancels";

/// Help of `--currents`.
pub const CURRENTS_HELP: &str = "Measured currents of the drives (A; CSV, NPY or NPZ), a column per drive in the order \
    of the protocol: one row for all frames, or one per frame. The frames are then voltages (V, or in --unit)";

/// Measured drive currents, of instruments that record voltages.
#[derive(Debug, Clone, Args)]
pub struct CurrentArguments {
    #[arg(long, value_name = "FILE", help = CURRENTS_HELP)]
    currents: Option<PathBuf>,
    /// Currents of the untouched frames [default: the row of --currents, if it has one for all frames].
    #[arg(long, value_name = "FILE", requires = "currents", conflicts_with = "difference")]
    baseline_currents: Option<PathBuf>,
    #[command(flatten)]
    format: FormatArguments,
}

impl CurrentArguments {
    /// Whether there are any.
    pub fn are_given(&self) -> bool {
        self.currents.is_some()
    }

    /// Reads frames in ohm.
    fn read(&self, path: &Path, protocol: &Protocol, options: &ReadOptions<'_>) -> Outcome<Vec<Frame>> {
        self.format.read_divided(path, protocol, options, self.currents.as_deref())
    }

    /// Reads untouched frames in ohm.
    fn read_untouched(&self, path: &Path, protocol: &Protocol, options: &ReadOptions<'_>) -> Outcome<Vec<Frame>> {
        let frames = self.format.read(path, protocol, options, self.currents.is_some())?;
        let Some(path) = &self.currents else { return Ok(frames) };
        if let Some(path) = &self.baseline_currents {
            return divided(Some(path), protocol, frames);
        }
        // Rows of the pressed frames do not belong to the untouched ones.
        let currents = DriveCurrents::read(path, protocol, 1).map_err(|error| {
            Failure::given(error, Some("give the currents of the untouched frames with --baseline-currents"))
        })?;
        Ok(currents.frames_per_ampere(protocol, frames))
    }
}

/// Frames as they are in their files.
#[derive(Debug)]
pub struct Recorded {
    /// The frames, ohm; differences from the untouched skin where there are no untouched frames.
    pub frames: Vec<Frame>,
    /// The untouched frames, ohm.
    pub untouched: Vec<Frame>,
    /// Whether each untouched frame belongs to the frame of the same row.
    pub paired: bool,
    /// The rows of the frames in their file.
    pub used: Used,
}

/// What becomes of frames with values that are missing or not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Incomplete {
    /// They are errors: what the command writes has a row for each frame.
    Refused,
    /// They are not used, with a warning.
    LeftOut,
}

impl FrameArguments {
    /// Reads the frames for a method and subtracts the baseline. Channels that are left out need no values and are 0. Frames
    /// that cannot be those of the skin are refused.
    pub fn read(&self, skin: &Skin, method: &MethodArguments) -> Outcome<Differences> {
        self.read_some(skin, method, Incomplete::Refused).map(|(differences, _)| differences)
    }

    /// [`read`](Self::read) without incomplete frames, with the rows of the others.
    pub fn read_complete(&self, skin: &Skin, method: &MethodArguments) -> Outcome<(Differences, Used)> {
        self.read_some(skin, method, Incomplete::LeftOut)
    }

    fn read_some(&self, skin: &Skin, method: &MethodArguments, incomplete: Incomplete) -> Outcome<(Differences, Used)> {
        let left_out = &method.left_out(&skin.design().protocol)?[..];
        let recorded = self.read_recorded(skin, left_out, incomplete)?;
        let is_doubtful = self.check(skin, &recorded, left_out, method.calibration().is_none())?;
        if method.depends_on_size()
            && !self.is_of_model()
            && let Some(baseline) = mean(&recorded.untouched)
        {
            let check = Plausibility::new(&skin.design().protocol, skin.untouched()?, left_out);
            self.report(self.baseline.as_deref().unwrap_or(&self.frames), check.of_size(&baseline), true)?;
        }
        let used = recorded.used.clone();
        Ok((Differences { is_doubtful, ..recorded.into_differences() }, used))
    }

    /// Refuses frames that cannot be those of the skin, and warns of doubtful ones; where contacts do not depend on the model,
    /// it warns of a baseline that is not the model's. Returns whether all frames are doubtful.
    pub fn check(&self, skin: &Skin, recorded: &Recorded, left_out: &[usize], needs_model: bool) -> Outcome<bool> {
        skin::warn_if_ambiguous(skin)?;
        let Recorded { frames, untouched, used, .. } = recorded;
        let mut unused = [left_out, &broken_channels(untouched)].concat();
        unused.sort_unstable();
        let model = skin.untouched()?;
        let check = Plausibility::new(&skin.design().protocol, model, &unused);
        if self.is_of_model() {
            return self.report(&self.frames, in_file(check.of_model_differences(frames), used), true);
        }
        let Some(baseline) = mean(untouched) else {
            return self.report(&self.frames, in_file(check.of_differences(frames), used), true);
        };
        if !self.paired {
            warn_if_unlike(&check, untouched);
        }
        let path = self.baseline.as_deref().unwrap_or(&self.frames);
        let is_unlike = self.report(path, check.of_baseline(&baseline), needs_model)? && needs_model;
        let found = check.of_touched(frames, untouched, &baseline, skin)?;
        Ok(self.report(&self.frames, in_file(found, used), true)? || is_unlike)
    }

    /// An error of a finding that is certain, a warning of any other. Returns whether it is about all frames.
    fn report(&self, path: &Path, found: Option<Finding>, is_needed: bool) -> Outcome<bool> {
        let Some(found) = found else { return Ok(false) };
        let rows = if found.rows.is_empty() { String::new() } else { format!(", {}", found.title()) };
        let message = format!("{}{rows}: {}", path.display(), found.evidence);
        if found.is_fault() && is_needed && !self.force {
            return Err(Failure::given(message, Some(&format!("{}; --force goes on all the same", found.fix))));
        }
        warn(&format!("{message}; {}", found.fix));
        Ok(Plausibility::is_doubtful([&found]))
    }

    /// Whether the baseline is the untouched frame of the design.
    pub fn is_of_model(&self) -> bool {
        self.baseline.as_deref().is_some_and(|path| path.as_os_str() == MODEL)
    }

    /// What is wrong with differences from the untouched frame of the design, where that is the baseline.
    pub fn of_model(&self, skin: &Skin, differences: &[Frame]) -> Outcome<Option<Finding>> {
        if !self.is_of_model() {
            return Ok(None);
        }
        let model = skin.untouched()?;
        Ok(Plausibility::new(&skin.design().protocol, model, &[]).of_model_differences(differences))
    }

    /// All frames, and which of them are used.
    fn read_frames(
        &self,
        protocol: &Protocol,
        left_out: &[usize],
        incomplete: Incomplete,
    ) -> Outcome<(Vec<Frame>, Used)> {
        let keep_incomplete = incomplete == Incomplete::LeftOut;
        let options = ReadOptions { left_out, keep_incomplete, ..ReadOptions::default() };
        let frames = self.currents.read(&self.frames, protocol, &options)?;
        let used = Used::of(&self.frames, &frames)?;
        Ok((frames, used))
    }

    /// Reads the frames. Channels that are left out need no values and are 0. Untouched frames that are incomplete are not used.
    /// With the untouched frame of the design, the differences from it are returned.
    pub fn read_recorded(&self, skin: &Skin, left_out: &[usize], incomplete: Incomplete) -> Outcome<Recorded> {
        let protocol = &skin.design().protocol;
        let (frames, mut used) = self.read_frames(protocol, left_out, incomplete)?;
        if self.is_of_model() {
            if self.paired {
                return Err(Failure::given("the model is one untouched frame", Some("leave --paired out")));
            }
            let model = skin.untouched()?;
            let frames = model_differences(protocol, model, &used.select(&frames), left_out)?.frames;
            return Ok(Recorded { frames, untouched: Vec::new(), paired: false, used });
        }
        let Some(path) = &self.baseline else {
            return Ok(Recorded { frames: used.select(&frames), untouched: Vec::new(), paired: false, used });
        };
        let keep_incomplete = incomplete == Incomplete::LeftOut || !self.paired;
        let options = ReadOptions { left_out, keep_incomplete, untouched: true, ..ReadOptions::default() };
        let untouched = self.currents.read_untouched(path, protocol, &options)?;
        if untouched.is_empty() {
            return Err(Failure::given(format!("{} holds no frame", path.display()), None));
        }
        if self.paired && untouched.len() != frames.len() {
            let (path, rows) = (path.display(), counted(untouched.len(), "row"));
            let message = format!("{path} has {rows}, and there are {}", counted(frames.len(), "frame"));
            return Err(Failure::given(message, Some("give an untouched frame for each frame, or leave --paired out")));
        }
        let mut rest = Used::of(path, &untouched)?;
        if self.paired {
            used = used.and(&rest);
            rest = used.clone();
        }
        if used.rows.is_empty() {
            let message = format!("no row is complete in {} and in {}", self.frames.display(), path.display());
            return Err(Failure::given(message, Some("mend the frames, or leave --paired out")));
        }
        Ok(Recorded { frames: used.select(&frames), untouched: rest.select(&untouched), paired: self.paired, used })
    }
}

/// A finding with the rows of the file.
fn in_file(found: Option<Finding>, used: &Used) -> Option<Finding> {
    found.map(|mut found| {
        found.rows = used.rows_of(&found.rows);
        found
    })
}

impl Recorded {
    /// The frames minus the untouched ones: their mean, or each its own.
    pub fn into_differences(self) -> Differences {
        let subtract = if self.paired { Differences::paired } else { Differences::new };
        subtract(self.frames, self.untouched)
    }
}

/// What a method finds in each difference.
pub fn of_each<T: Send>(
    differences: &[Frame],
    find: impl Fn(&Frame) -> Result<T, ReconstructError> + Sync,
) -> Outcome<Vec<T>> {
    let progress = Progress::new("reconstructing", differences.len());
    let step = |difference| {
        let found = find(difference);
        progress.step();
        found
    };
    Ok(differences.par_iter().map(step).collect::<Result<Vec<T>, _>>()?)
}

/// Warns of untouched frames that are not like the others.
pub fn warn_if_unlike(check: &Plausibility<'_>, untouched: &[Frame]) {
    if let Some(Finding { evidence, fix, .. }) = check.of_untouched(untouched) {
        warn(&format!("{evidence}; {fix}"));
    }
}
