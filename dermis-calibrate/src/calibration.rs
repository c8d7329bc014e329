//! A calibration: everything from raw frames to positions.

use crate::error::CalibrateError;
use crate::fit::fit_locator;
use crate::lags::channel_lags;
use crate::locate::{Locator, Setup};
use crate::located::Located;
use crate::pose::Pose;
use crate::region::Region;
use crate::sequence::{Realignment, in_units};
use crate::strength::{ForceLaw, UnusedForces, has_force};
use crate::units::ChannelUnits;
use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::protocol::Protocol;
use dermis::skin::Skin;
use dermis::stats::upper_median;

/// Fewest labelled presses.
pub const MIN_LABELS: usize = 8;
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

/// Gives positions on a flat skin, in the frame of a robot that pressed along its z, one z: the median. How deep a robot
/// presses is no position on the skin.
pub(crate) fn flatten<'a>(positions_m: impl IntoIterator<Item = &'a mut Point3>) {
    let mut heights_m: Vec<&mut f64> = positions_m.into_iter().map(|[_, _, z]| z).collect();
    let values: Vec<f64> = heights_m.iter().map(|z| **z).collect();
    let Some(median_m) = upper_median(&values) else { return };
    heights_m.iter_mut().for_each(|z| **z = median_m);
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
    /// The untouched frame of the labels, ohm, if it is known.
    pub(crate) rest: Option<Frame>,
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
    /// By how many standard deviations such labels are nearer to their own frames' places than those of a random order;
    /// `None` for too few labels, and in a calibration of before this was stored.
    pub evidence: Option<f64>,
    /// Mean relative error of the force of such labels, where it is located from the frame.
    pub force_error: Option<f64>,
    /// Standard deviation over mean of the estimated over the true force.
    pub force_spread: Option<f64>,
}

impl Calibration {
    /// Calibrates a skin with frames (differences from the untouched skin) in the order of recording and the labels of
    /// some of them.
    ///
    /// Frames without a label help to find late channels and, with fewer than 300 labels, to fit the map. The labels
    /// are in the order of their rows.
    ///
    /// # Errors
    /// Fewer than [`MIN_LABELS`] labels or three different positions; labels of frames that do not exist; labels in
    /// a robot's frame on a skin that is not flat; a fit without a solution.
    pub fn fit(skin: &Skin, frames: &[Frame], labels: &[Label], frame: LabelFrame) -> Result<Self, CalibrateError> {
        let protocol = &skin.design().protocol;
        check(frames, protocol, labels)?;
        if frame == LabelFrame::Skin {
            check_positions(skin, labels)?;
        }
        let mut labels = labels.to_vec();
        let region = &match frame {
            LabelFrame::Skin => Region::of_skin(skin)?,
            LabelFrame::Robot => {
                // The skin must be parallel to x and y of the robot's frame.
                Region::around_labels(skin, &labels)?;
                flatten(labels.iter_mut().map(|label| &mut label.position_m));
                check(frames, protocol, &labels)?;
                Region::around_labels(skin, &labels)?
            }
        };
        let units = ChannelUnits::of(frames);
        if units.varying_count() == 0 {
            let message = "no channel changes between the frames: is there one press in each, and the right baseline?";
            return Err(CalibrateError::Fit(message.into()));
        }
        let recorded = in_units(frames, &units);
        let realignment = Realignment::new(channel_lags(&recorded, protocol), &recorded)?;
        let measured = realignment.apply(&recorded);
        let setup =
            Setup { region: region.clone(), untouched: realignment.complete(units.untouched()), strength: None };
        let (locator, validation) = fit_locator(&measured, &labels, setup)?;
        let pose = match frame {
            LabelFrame::Skin => None,
            LabelFrame::Robot => {
                let frames: Vec<&[f64]> = labels.iter().map(|label| measured[label.row].as_slice()).collect();
                Some(Pose::estimate(skin, &frames, &labels, region.middle_m())?.0)
            }
        };
        let quality = validation.quality(&labels, locator.force_law());
        let misfit_limit = UNLIKE * validation.usual_misfit();
        Ok(Calibration { units, realignment, locator, misfit_limit, quality, pose, rest: None })
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
        self.complete(self.units.apply(difference))
    }

    /// A frame in units of the channels with its late channels predicted from the others.
    pub(crate) fn complete(&self, values: Vec<f64>) -> Vec<f64> {
        self.realignment.complete(values)
    }

    /// The force of a located press and its standard deviation, N; `NaN` where forces were not calibrated. The deviation alone
    /// is `NaN` where the force is a bound, beyond those of the labels.
    pub fn force_n(&self, located: &Located) -> [f64; 2] {
        self.locator.force_law().map_or([f64::NAN; 2], |law| law.force_n(located.amplitude))
    }

    /// Why the forces of its labels are not used; `None` where they are, or where no label has one.
    pub(crate) fn unused_forces(&self, labels: &[Label]) -> Option<UnusedForces> {
        if !has_force(labels) || self.locator.force_law().is_some() {
            return None;
        }
        Some(ForceLaw::log_forces(labels).err().unwrap_or(UnusedForces::Unrelated))
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
    pub(crate) fn channel_count(&self) -> usize {
        self.units.channel_count()
    }

    /// Whether a located press is unlike every labelled one.
    pub fn is_unlike(&self, located: &Located) -> bool {
        located.misfit > self.misfit_limit
    }

    /// A misfit over that which 99 % of the labels do not exceed.
    pub(crate) fn novelty(&self, misfit: f64) -> f64 {
        UNLIKE * misfit / self.misfit_limit
    }

    /// Locates the presses of frames in the order of recording, one press per frame. Each estimate enters the memory of
    /// the skin in the next frame. `first_number` is the number of the first press in the recording of the labels.
    ///
    /// # Errors
    /// Frames of another number of channels, values that are not finite.
    pub fn locate(&self, frames: &[Frame], first_number: usize) -> Result<Vec<Located>, CalibrateError> {
        check_frames("frame", frames, self.channel_count())?;
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
    check_frames("frame", frames, protocol.channel_count())?;
    if let Some(label) = labels.iter().find(|label| label.position_m.iter().any(|value| !value.is_finite())) {
        let message = format!("the position of the label of frame {} is {:?}", label.row, label.position_m);
        return Err(CalibrateError::Label(format!("{message}: it must be finite")));
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
    if labels.len() < MIN_LABELS || places.len() < 3 {
        return Err(CalibrateError::TooFewLabels { given: labels.len(), places: places.len(), needed: MIN_LABELS });
    }
    Ok(())
}

/// Refuses frames of another number of channels, and values that are not finite.
pub(crate) fn check_frames(what: &str, frames: &[Frame], expected: usize) -> Result<(), CalibrateError> {
    frames.iter().enumerate().try_for_each(|(row, frame)| {
        if frame.len() != expected {
            return Err(CalibrateError::Channels { got: frame.len(), expected });
        }
        frame.iter().position(|value| !value.is_finite()).map_or(Ok(()), |channel| {
            let message = format!("{what} {row}, channel {channel} is {}: it must be finite", frame[channel]);
            Err(CalibrateError::Label(message))
        })
    })
}

/// Refuses labels off the skin.
pub(crate) fn check_positions(skin: &Skin, labels: &[Label]) -> Result<(), CalibrateError> {
    let limits = skin.place_limits();
    labels.iter().try_for_each(|label| match limits.check(label.position_m) {
        Ok(_) => Ok(()),
        Err(message) => Err(CalibrateError::Label(format!("the label of frame {}: {message}", label.row))),
    })
}
