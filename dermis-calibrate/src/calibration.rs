//! A calibration: everything from raw frames to positions.

use crate::covariance::PressInput;
use crate::error::CalibrateError;
use crate::forward_map::{Hyperparameters, Samples};
use crate::lags::channel_lags;
use crate::locate::{Located, Locator, Posterior, fit_temperature};
use crate::pose::Pose;
use crate::region::Region;
use crate::sequence::{Realignment, in_units};
use crate::units::ChannelUnits;
use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::protocol::Protocol;
use dermis::skin::Skin;
use faer::Mat;
use rayon::prelude::*;
use std::ops::Range;

/// Fewest labelled presses.
pub const FEWEST_LABELS: usize = 8;
/// Unlabelled presses help below this number of labels.
const ENOUGH_LABELS: usize = 300;
/// Unlabelled presses that are used, at most: those next to the labels.
const MOST_UNLABELLED: usize = 300;
/// Rounds in which unlabelled presses are located and then used.
const ROUNDS: usize = 3;
/// Part of the unlabelled presses that is used: those located best.
const USED_PART: f64 = 0.8;
/// Factor on the stated variance of an unlabelled position.
const CAUTION: f64 = 2.0;
/// Smallest standard deviation of an unlabelled position, m.
const LEAST_SD_M: f64 = 0.001;
/// Part of the labels that follow an unlabelled frame, above which the positions of these frames are estimated.
const SCATTERED_PART: f64 = 0.1;
/// Parts of the labels for cross-validation.
const FOLDS: usize = 5;
/// A frame whose residual exceeds that of the labels by this factor is unlike any of them.
const UNLIKE: f64 = 2.0;

/// A press whose position was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Label {
    /// Index of its frame.
    pub row: usize,
    /// Its position, m.
    pub position_m: Point3,
    /// Its force, N; `NaN` if it is not known.
    pub force_n: f64,
}

/// The coordinate frame of labels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LabelFrame {
    /// The skin's own.
    Skin,
    /// A robot's: the pose of the skin in it is estimated. Flat skins only.
    Robot,
}

/// A skin calibrated with measured presses: frames to positions.
#[derive(Debug, Clone)]
pub struct Calibration {
    pub(crate) units: ChannelUnits,
    pub(crate) realignment: Realignment,
    pub(crate) locator: Locator,
    /// Residual above which a frame is unlike the labels.
    pub(crate) misfit_limit: f64,
    pub(crate) quality: Quality,
    /// Pose of the skin in the frame of the labels, where that is a robot's.
    pub(crate) pose: Option<Pose>,
}

/// What cross-validation on the labels states of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Quality {
    /// Labelled presses.
    pub labels: usize,
    /// Unlabelled presses that were used.
    pub unlabelled: usize,
    /// Mean error of labels that the map had not seen, m.
    pub mean_error_m: f64,
}

impl Calibration {
    /// Calibrates a skin with frames (differences from the untouched skin) in the order of recording and the labels of some of
    /// them.
    ///
    /// Frames without a label help to find late channels and, with fewer than 300 labels, to fit the map. The labels are in
    /// the order of their rows.
    ///
    /// # Errors
    /// Fewer than [`FEWEST_LABELS`] labels or three different positions; labels of frames that do not exist; labels in a
    /// robot's frame on a skin that is not flat; a fit without a solution.
    pub fn fit(skin: &Skin, frames: &[Frame], labels: &[Label], frame: LabelFrame) -> Result<Self, CalibrateError> {
        let protocol = &skin.design().protocol;
        check(frames, protocol, labels)?;
        if frame == LabelFrame::Skin {
            check_positions(skin, labels)?;
        }
        let region = &match frame {
            LabelFrame::Skin => Region::of_skin(skin)?,
            LabelFrame::Robot => Region::around_labels(skin, labels)?,
        };
        let units = ChannelUnits::of(frames);
        if units.varying_count() == 0 {
            let message = "no channel changes between the frames: is there one press in each, and the right baseline?";
            return Err(CalibrateError::Fit(message.into()));
        }
        let recorded = in_units(frames, &units);
        let realignment = Realignment::new(channel_lags(&recorded, protocol), &recorded)?;
        let values = realignment.apply(&recorded);
        let (fit, hyperparameters) = Fit::train(&values, labels, region, &[], Hyperparameters::estimate)?;
        let mut locator = Locator::new(&fit.samples(), &hyperparameters, region)?;
        let (quality, misfit) = fit.cross_validate(&hyperparameters, &mut locator)?;
        let pose = match frame {
            LabelFrame::Skin => None,
            LabelFrame::Robot => {
                let frames: Vec<&[f64]> = labels.iter().map(|label| values[label.row].as_slice()).collect();
                Some(Pose::estimate(skin, &frames, labels, region.middle_m())?.0)
            }
        };
        Ok(Calibration { units, realignment, locator, misfit_limit: UNLIKE * misfit, quality, pose })
    }

    /// The pose of the skin in the robot's frame; `None` where the labels are in the skin's own frame.
    pub fn pose(&self) -> Option<&Pose> {
        self.pose.as_ref()
    }

    /// What cross-validation states.
    pub fn quality(&self) -> &Quality {
        &self.quality
    }

    /// A single frame in units of the channels, with late channels predicted from the others.
    pub(crate) fn single(&self, difference: &[f64]) -> Vec<f64> {
        self.realignment.apply(&[self.units.apply(difference)]).remove(0)
    }

    /// The number of the last press of the calibration: later frames are not extrapolated beyond it.
    pub(crate) fn last_number(&self) -> f64 {
        self.locator.map().inputs.last().map_or(0.0, |input| input.number)
    }

    /// The number of rows by which each channel is late in the recording.
    pub fn lags(&self) -> &[i32] {
        self.realignment.lags()
    }

    /// Number of channels.
    pub fn channel_count(&self) -> usize {
        self.units.channel_count()
    }

    /// Whether a located press is unlike every labelled one.
    pub fn is_unlike(&self, located: &Located) -> bool {
        located.misfit > self.misfit_limit
    }

    /// Locates the presses of frames in the order of recording, one press per frame. Each estimate enters the memory of the
    /// skin in the next frame. `first_number` is the number of the first press in the recording of the labels.
    ///
    /// # Errors
    /// Frames of another number of channels.
    pub fn locate(&self, frames: &[Frame], first_number: usize) -> Result<Vec<Located>, CalibrateError> {
        if let Some(frame) = frames.iter().find(|frame| frame.len() != self.channel_count()) {
            return Err(CalibrateError::Channels { got: frame.len(), expected: self.channel_count() });
        }
        let values = self.realignment.apply(&in_units(frames, &self.units));
        let mut previous_m = None;
        let locate = |(index, values): (usize, &Vec<f64>)| {
            let located = self.locator.locate(values, previous_m, (first_number + index) as f64);
            previous_m = Some(located.position_m);
            located
        };
        Ok(values.iter().enumerate().map(locate).collect())
    }
}

/// Refuses labels from which no map can be fitted.
pub(crate) fn check(frames: &[Frame], protocol: &Protocol, labels: &[Label]) -> Result<(), CalibrateError> {
    let expected = protocol.channel_count();
    if let Some(frame) = frames.iter().find(|frame| frame.len() != expected) {
        return Err(CalibrateError::Channels { got: frame.len(), expected });
    }
    let not_finite = |frame: &Frame| frame.iter().position(|value| !value.is_finite());
    if let Some((row, channel)) = frames.iter().enumerate().find_map(|(row, frame)| Some((row, not_finite(frame)?))) {
        let message = format!("frame {row}, channel {channel} is {}: it must be finite", frames[row][channel]);
        return Err(CalibrateError::Label(message));
    }
    if let Some(label) = labels.iter().find(|label| label.row >= frames.len()) {
        let message = format!("a label names frame {}, but there are {}", label.row, frames.len());
        return Err(CalibrateError::Label(message));
    }
    if let Some(pair) = labels.windows(2).find(|pair| pair[0].row >= pair[1].row) {
        let message = format!("the label of frame {} follows that of frame {}", pair[1].row, pair[0].row);
        return Err(CalibrateError::Label(message));
    }
    let mut places: Vec<[u64; 3]> = labels.iter().map(|label| label.position_m.map(f64::to_bits)).collect();
    places.sort_unstable();
    places.dedup();
    if labels.len() < FEWEST_LABELS || places.len() < 3 {
        return Err(CalibrateError::TooFewLabels { given: labels.len(), places: places.len(), needed: FEWEST_LABELS });
    }
    Ok(())
}

/// Refuses labels off the skin.
pub(crate) fn check_positions(skin: &Skin, labels: &[Label]) -> Result<(), CalibrateError> {
    let limits = skin.mesh().place_limits(skin.design().body.surface());
    labels.iter().try_for_each(|label| match limits.check(label.position_m) {
        Ok(_) => Ok(()),
        Err(message) => Err(CalibrateError::Label(format!("the label of frame {}: {message}", label.row))),
    })
}

/// The state of a fit: what is known of the position of each frame.
struct Fit<'a> {
    values: &'a [Vec<f64>],
    labels: &'a [Label],
    region: &'a Region,
    /// Frames that are not used, ascending.
    held_out: &'a [usize],
    /// Position of each frame and its variance per axis, where it is known or estimated.
    positions: Vec<Option<(Point3, f64)>>,
    /// Frames that the map is conditioned on, ascending.
    used: Vec<usize>,
}

impl<'a> Fit<'a> {
    /// Trains on labels, and on unlabelled frames where there are few labels. The frames in `held_out`, ascending, are not
    /// used.
    fn train(
        values: &'a [Vec<f64>],
        labels: &'a [Label],
        region: &'a Region,
        held_out: &'a [usize],
        estimate: impl Fn(&Samples) -> Result<Hyperparameters, CalibrateError>,
    ) -> Result<(Self, Hyperparameters), CalibrateError> {
        let mut positions = vec![None; values.len()];
        labels.iter().for_each(|label| positions[label.row] = Some((label.position_m, 0.0)));
        let used = labels.iter().map(|label| label.row).collect();
        let mut fit = Fit { values, labels, region, held_out, positions, used };
        let mut hyperparameters = estimate(&fit.samples())?;
        if labels.len() < ENOUGH_LABELS {
            for _ in 0..ROUNDS {
                fit.use_unlabelled(&Locator::new(&fit.samples(), &hyperparameters, region)?);
                hyperparameters = estimate(&fit.samples())?;
            }
            return Ok((fit, hyperparameters));
        }
        let before = fit.unlabelled_before_labels();
        if before.len() as f64 > SCATTERED_PART * labels.len() as f64 {
            fit.place(&before, &Locator::new(&fit.samples(), &hyperparameters, region)?);
            hyperparameters = estimate(&fit.samples())?;
        }
        Ok((fit, hyperparameters))
    }

    fn samples(&self) -> Samples {
        let known: Vec<Point3> = self.labels.iter().map(|label| label.position_m).collect();
        let centre_m = crate::covariance::Extent::of(&known).centre_m;
        let position = |row: usize| self.positions[row].expect("frames that are used have a position");
        let previous = |row: usize| row.checked_sub(1).and_then(|before| self.positions[before]);
        Samples {
            values: Mat::from_fn(self.used.len(), self.values[0].len(), |i, j| self.values[self.used[i]][j]),
            inputs: (self.used.iter())
                .map(|&row| PressInput {
                    position_m: position(row).0,
                    previous_m: previous(row).map_or(centre_m, |(position_m, _)| position_m),
                    number: row as f64,
                })
                .collect(),
            position_variance_m2: self.used.iter().map(|&row| position(row).1).collect(),
        }
    }

    /// Estimates the positions of frames; returns the variance of each per axis.
    fn place(&mut self, rows: &[usize], locator: &Locator) -> Vec<f64> {
        let place = |&row: &usize| {
            let previous_m =
                row.checked_sub(1).and_then(|before| self.positions[before]).map(|(position_m, _)| position_m);
            let located = locator.locate(&self.values[row], previous_m, row as f64);
            let variance = located.sd_m().powi(2) + LEAST_SD_M.powi(2);
            self.positions[row] = Some((located.position_m, CAUTION * variance));
            variance
        };
        rows.iter().map(place).collect()
    }

    /// The unlabelled frames before labelled ones: their presses are in the memory of the skin.
    fn unlabelled_before_labels(&self) -> Vec<usize> {
        let before = self.labels.iter().filter_map(|label| label.row.checked_sub(1));
        before.filter(|row| self.positions[*row].is_none() && self.held_out.binary_search(row).is_err()).collect()
    }

    /// Locates unlabelled frames next to the labels and uses those located best.
    fn use_unlabelled(&mut self, locator: &Locator) {
        let labelled: Vec<usize> = self.labels.iter().map(|label| label.row).collect();
        let rows = self.unlabelled_rows(&labelled);
        let variances = self.place(&rows, locator);
        let mut found: Vec<(usize, f64)> = rows.into_iter().zip(variances).collect();
        found.sort_by(|a, b| a.1.total_cmp(&b.1));
        found.truncate((USED_PART * found.len() as f64) as usize);
        self.used = labelled.into_iter().chain(found.into_iter().map(|(row, _)| row)).collect();
        self.used.sort_unstable();
    }

    /// The unlabelled frames nearest to the labels, ascending.
    fn unlabelled_rows(&self, labelled: &[usize]) -> Vec<usize> {
        let is_free = |row: &usize| labelled.binary_search(row).is_err() && self.held_out.binary_search(row).is_err();
        let mut rows: Vec<usize> = (0..self.values.len()).filter(is_free).collect();
        let apart = |row: &usize| {
            let next = labelled.partition_point(|label| label < row);
            let after = labelled.get(next).map_or(usize::MAX, |label| label - row);
            let before = next.checked_sub(1).map_or(usize::MAX, |before| row - labelled[before]);
            after.min(before)
        };
        rows.sort_by_key(apart);
        rows.truncate(MOST_UNLABELLED);
        rows.sort_unstable();
        rows
    }

    /// Locates each label by a map that has not seen it, sets the temperature of the locator so that regions hold, and
    /// returns what was found with the residual that 99 % of the labels do not exceed.
    fn cross_validate(
        &self,
        hyperparameters: &Hyperparameters,
        locator: &mut Locator,
    ) -> Result<(Quality, f64), CalibrateError> {
        let folds: Vec<Range<usize>> =
            (0..FOLDS).map(|fold| fold * self.labels.len() / FOLDS..(fold + 1) * self.labels.len() / FOLDS).collect();
        let without = |fold: &Range<usize>| {
            let held_out: Vec<usize> = self.labels[fold.clone()].iter().map(|label| label.row).collect();
            let kept = [&self.labels[..fold.start], &self.labels[fold.end..]].concat();
            let estimate = |samples: &Samples| Hyperparameters::with_covariance(samples, hyperparameters.covariance);
            let (fit, hyperparameters) = Fit::train(self.values, &kept, self.region, &held_out, estimate)?;
            Locator::new(&fit.samples(), &hyperparameters, self.region)
        };
        let locators = folds.par_iter().map(without).collect::<Result<Vec<Locator>, CalibrateError>>()?;
        let posterior = |index: usize| {
            let fold = folds.iter().position(|fold| fold.contains(&index)).expect("the folds cover all labels");
            let row = self.labels[index].row;
            // As in use: the press before is only estimated.
            let locator = &locators[fold];
            let located = |before: usize| locator.locate(&self.values[before], None, before as f64);
            let previous_m = row.checked_sub(1).map(|before| located(before).position_m);
            locator.posterior(&self.values[row], previous_m, row as f64)
        };
        let posteriors: Vec<Posterior<'_>> = (0..self.labels.len()).into_par_iter().map(posterior).collect();
        let truth_m: Vec<Point3> = self.labels.iter().map(|label| label.position_m).collect();
        locator.temperature = fit_temperature(&posteriors, &truth_m);
        let located: Vec<Located> =
            posteriors.par_iter().map(|posterior| posterior.located(locator.temperature)).collect();
        let errors = located
            .iter()
            .zip(&truth_m)
            .map(|(located, truth_m)| dermis::geom::vector::distance(located.position_m, *truth_m));
        let count = self.labels.len() as f64;
        let quality = Quality {
            labels: self.labels.len(),
            unlabelled: self.used.len() - self.labels.len(),
            mean_error_m: errors.sum::<f64>() / count,
        };
        let mut misfits: Vec<f64> = located.iter().map(|located| located.misfit).collect();
        misfits.sort_by(f64::total_cmp);
        Ok((quality, dermis::stats::quantile(&misfits, 0.99)))
    }
}
