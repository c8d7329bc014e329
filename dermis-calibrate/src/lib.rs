//! Calibration of a real skin with measured presses.
//!
//! A few presses at known positions (labels) determine a forward map from positions to the values of all channels, a
//! Gaussian process; a frame is then located by the likelihood of the map over the skin. The map includes what a press
//! leaves behind for the next one (viscoelastic skins) and slow drift. No model of the skin is needed, and no network
//! is trained: a fit takes seconds.

#![warn(unreachable_pub)]

pub mod build;
mod calibration;
pub mod checks;
mod correction;
mod covariance;
mod error;
mod evaluate;
mod fit;
mod fitted;
mod folder;
mod forward_map;
mod gaussian_process;
mod lags;
mod locate;
mod located;
mod matching;
mod method;
mod minimize;
mod places;
mod pose;
mod posterior;
mod region;
mod ridge;
mod sequence;
mod session;
mod shrinkage;
mod strength;
mod suggest;
mod touches;
mod units;

pub use calibration::{Calibration, Label, LabelFrame, MIN_LABELS, Quality};
pub use correction::{Correction, CorrectionQuality};
pub use error::CalibrateError;
pub use evaluate::{CalibrationScore, Presses};
pub use fitted::{Alternatives, Fitted};
pub use located::Located;
pub use method::Calibrations;
pub use places::Places;
pub use pose::Pose;
pub use region::Region;
pub use session::{Session, SessionFit};
pub use strength::UnusedForces;
pub use suggest::{LearningPoint, expected_error_m, learning_curve};
