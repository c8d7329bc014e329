//! Errors of calibrations.

use dermis::text::counted;
use std::path::PathBuf;
use thiserror::Error;

/// A calibration that cannot be made, stored or used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// Fewer labelled presses than a fit needs.
    #[error(
        "{} at {}: at least {needed} presses at 3 positions are needed",
        counted(*given, "labelled press"),
        counted(*places, "different position")
    )]
    TooFewLabels {
        /// Labelled presses.
        given: usize,
        /// Different positions among them.
        places: usize,
        /// Fewest that can be fitted.
        needed: usize,
    },
    /// A correction of a method that does not find the labelled presses.
    #[error(
        "{method} finds {found} different presses within 20 mm, of {}: a correction needs {}",
        counted(*labels, "labelled frame"),
        crate::correction::MIN_FOUND
    )]
    TooFewFound {
        /// The method.
        method: String,
        /// Presses that it finds; frames with one label are of one press.
        found: usize,
        /// Labelled presses.
        labels: usize,
        /// Its mean error without a correction, m; presses that it does not find count as 20 mm.
        uncalibrated_m: f64,
    },
    /// A correction of contacts that cannot be refined.
    #[error("the contacts cannot be refined: {why}")]
    NotRefined {
        /// Why.
        why: String,
    },
    /// A correction with labels in a robot's frame.
    #[error("a correction of {method} needs labels on the skin, not in the frame of a robot")]
    CorrectionFrame {
        /// The method.
        method: String,
    },
    /// A method that cannot be prepared.
    #[error(transparent)]
    Method(Box<dermis::method::MethodError>),
    /// A label that does not fit the frames.
    #[error("{0}")]
    Label(String),
    /// A frame without exactly one press.
    #[error("{}: frame {frame} has {touches} touches", path.display())]
    NotOnePress {
        /// The file.
        path: PathBuf,
        /// The frame, from 0.
        frame: usize,
        /// Its touches.
        touches: usize,
    },
    /// Presses in another frame of reference than the labels of a calibration.
    #[error(
        "the calibration is in {}, but {} is in {}",
        reference(*is_robot),
        path.display(),
        reference(!is_robot)
    )]
    OtherFrame {
        /// The file of the presses.
        path: PathBuf,
        /// Whether the labels are in the frame of a robot.
        is_robot: bool,
    },
    /// Frames of another number of channels than the calibration's.
    #[error(
        "the frames have {}, but the calibration has {expected}: it was made with another protocol",
        counted(*got, "channel")
    )]
    Channels {
        /// Channels of the frames.
        got: usize,
        /// Channels of the calibration.
        expected: usize,
    },
    /// A skin or model that cannot be used.
    #[error(transparent)]
    Dermis(#[from] dermis::Error),
    /// A body on which presses cannot be located.
    #[error("{0}")]
    Body(String),
    /// A fit without a solution.
    #[error("the forward map cannot be fitted: {0}")]
    Fit(String),
    /// A folder that cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// A table that cannot be read or written.
    #[error(transparent)]
    Table(dermis::frame::TableError),
    /// A file of a calibration that is invalid.
    #[error("{}: {message}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong, and the fix.
        message: String,
    },
}

fn reference(is_robot: bool) -> &'static str {
    if is_robot { "a robot's frame" } else { "the skin's own frame" }
}

impl CalibrateError {
    /// What to do, where the message does not say it.
    pub fn fix(&self) -> Option<&'static str> {
        match self {
            CalibrateError::NotOnePress { touches: 0, .. } => {
                Some("give a row for each frame, or leave the frames without one out: --rows selects frames")
            }
            CalibrateError::NotOnePress { .. } => Some("give frames with one press each"),
            CalibrateError::OtherFrame { .. } => Some("give a truth in the same coordinates as the labels"),
            CalibrateError::CorrectionFrame { .. } => Some("name the columns of --truth in its first row"),
            _ => None,
        }
    }
}

/// Boxed: its size would enlarge every result of this crate.
impl From<dermis::method::MethodError> for CalibrateError {
    fn from(error: dermis::method::MethodError) -> Self {
        CalibrateError::Method(Box::new(error))
    }
}
