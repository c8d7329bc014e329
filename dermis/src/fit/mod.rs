//! A design fitted to frames of the untouched skin: sheet resistance and contact impedances, by the complete electrode
//! model.
//!
//! The unknowns are logarithms of factors: one on the resistances of the sheet and its regions, one on all contact
//! impedances or one on each. They minimise the weighted squares of the difference between the mean of the frames and
//! the model's untouched frame, by Gauss-Newton steps with the derivatives of the forward model, plus a wide prior on
//! the contact impedances (a factor of [ten](PRIOR_SD)), without which values that the frames do not determine would
//! run away. A gain common to all channels is the same as a factor on all of these, so it cannot be told from them.
//!
//! The variance of a channel is that of its mean over the frames plus that of the model, equal in all channels of a
//! group: those that read a voltage at a driven electrode, where an error of the contact dominates, and the others.
//! The variance of the model is the one at which the squares in a group have their expectation (Paule and Mandel, 1982,
//! DOI 10.6028/jres.087.022). So the stated standard deviations contain what the model does not explain.
//!
//! ```
//! use dermis::design::SkinDesign;
//! use dermis::fit::{FitOptions, fit};
//! use dermis::forward::ForwardModel;
//! use dermis::mesh::Mesh;
//!
//! let guess = SkinDesign::shipped("tank16").expect("a shipped design");
//! let mut real = guess.clone();
//! real.sheet.conductance = 1.0 / 640.0;
//! let mesh = Mesh::generate(&guess)?;
//! let model = ForwardModel::new(&real, &mesh)?;
//! let untouched = model.solve(model.rest_conductivity())?; // ohm
//! let fitted = fit(&guess, &mesh, &[untouched], &FitOptions::default())?;
//! assert!((fitted.design.sheet.conductance - 1.0 / 640.0).abs() < 1e-9);
//! # Ok::<(), dermis::Error>(())
//! ```

mod absolute;
mod model;
mod solve;
#[cfg(test)]
mod tests;
mod variance;

pub use absolute::{ModelDifferences, model_differences};

use crate::design::SkinDesign;
use crate::estimate::agreement::{DOUBTFUL, agreement};
use crate::estimate::scale::least_squares;
use crate::frame::Frame;
use crate::mesh::Mesh;
use crate::protocol::Protocol;
use model::Model;
use serde::{Deserialize, Serialize};
use solve::{Data, Estimate};
use thiserror::Error;

/// Standard deviation of the prior of the logarithm of a contact impedance: a factor of ten.
pub const PRIOR_SD: f64 = std::f64::consts::LN_10;

/// A contact impedance with a larger standard deviation of its logarithm is not determined.
const UNDETERMINED_SD: f64 = 0.5;

/// The same for an electrode whose contact no channel reads. It shows only in what the electrode shunts, a small change
/// that is like the errors of a model, and these are not independent from channel to channel: on simulated frames of
/// another mesh, an impedance that was wrong by a factor of 15 had a stated deviation of 0.36.
const UNREAD_SD: f64 = 0.05;

/// The contact impedances to fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Contacts {
    /// One factor for all.
    #[default]
    Common,
    /// Each electrode's own.
    Each,
    /// None: those of the design are kept.
    Kept,
}

/// Options of a fit.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FitOptions {
    /// The contact impedances to fit.
    pub contacts: Contacts,
    /// Channels that are left out.
    pub left_out: Vec<usize>,
}

/// Frames to which a design cannot be fitted.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum FitError {
    /// No frame.
    #[error("there is no frame to fit to")]
    NoFrame,
    /// A frame of another length than the protocol's.
    #[error("frame {frame} has {got} values, but the protocol has {expected}")]
    FrameLength {
        /// Index of the frame.
        frame: usize,
        /// Its number of values.
        got: usize,
        /// Channels of the protocol.
        expected: usize,
    },
    /// A value that is not a number, or infinite.
    #[error("channel {channel} of frame {frame} is {value}: mend the frame, or leave the channel out")]
    NotFinite {
        /// Index of the frame.
        frame: usize,
        /// Index of the channel.
        channel: usize,
        /// Its value.
        value: f64,
    },
    /// A channel that does not exist.
    #[error("cannot leave channel {channel} out: the channels are 0 to {last}")]
    NoSuchChannel {
        /// Index of the channel.
        channel: usize,
        /// The last channel.
        last: usize,
    },
    /// Fewer channels than unknowns.
    #[error("{channels} channels are too few for {unknowns} unknowns: leave fewer channels out, or fit fewer contacts")]
    TooFewChannels {
        /// Channels in use.
        channels: usize,
        /// Unknowns.
        unknowns: usize,
    },
    /// Frames that are unlike the model.
    #[error(
        "the frames agree with the untouched frame of the design by {agreement:.2} (1: exactly, 0: by chance): check the order of \
         the channels, their signs (`measures_reversed`) and that the skin is untouched"
    )]
    Unlike {
        /// Agreement beyond chance with the untouched frame of the model.
        agreement: f64,
    },
}

/// Whether the frames determine a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Determination {
    /// The value is estimated, with its standard deviation.
    Determined,
    /// Only a limit: the value fits, but so do values on one side of it.
    Limit,
    /// The frames do not tell; the value of the design is kept.
    Kept,
}

/// The quantity that was fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Resistance of the sheet (ohm per square) or resistivity of a volume (ohm m), its regions in proportion.
    Resistance,
    /// Contact impedance of all electrodes (ohm m2, ohm m).
    CommonContact,
    /// Contact impedance of one electrode.
    Contact(
        /// The electrode.
        usize,
    ),
}

/// A fitted quantity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FittedQuantity {
    /// The quantity.
    pub quantity: Quantity,
    /// Value in the design; of contact impedances that differ, the mean.
    pub initial: f64,
    /// Fitted value.
    pub value: f64,
    /// Standard deviation of its logarithm, about that of the value over the value.
    pub relative_sd: f64,
    /// Whether the frames determine it.
    pub determination: Determination,
}

/// What the fit leaves in a group of channels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Misfit {
    /// Number of channels.
    pub channels: usize,
    /// Root mean square of the mean frame, ohm.
    pub rms_ohm: f64,
    /// Root mean square of the mean frame minus the model's, ohm.
    pub misfit_ohm: f64,
    /// Standard deviation of the median channel of one frame
    /// ([`ChannelNoise`](crate::estimate::noise::ChannelNoise)), ohm.
    pub noise_ohm: f64,
    /// Standard deviation of a channel's model, ohm.
    pub model_sd_ohm: f64,
}

/// The constant part of a channel that the model does not explain.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Offset {
    /// Index of the channel.
    pub channel: usize,
    /// Mean of the frames minus the model, shrunk by the noise of the mean, ohm.
    pub offset_ohm: f64,
    /// Its standard deviation, ohm.
    pub sd_ohm: f64,
}

/// A fitted design.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The design with the fitted values.
    pub design: SkinDesign,
    /// The fitted quantities.
    pub quantities: Vec<FittedQuantity>,
    /// The misfit of the channels that read a voltage at a driven electrode; `None` without such a channel.
    pub driven: Option<Misfit>,
    /// The misfit of the others; `None` without any.
    pub others: Option<Misfit>,
    /// The offset of each channel in use.
    pub offsets: Vec<Offset>,
    /// Number of frames.
    pub frames: usize,
}

/// Fits a design to frames of the untouched skin, ohm, on a mesh of it. Of an amplitude-only protocol, amplitudes are
/// fitted.
///
/// # Errors
/// Frames that do not fit the protocol or are unlike the model, too few channels, a forward problem without a solution.
pub fn fit(design: &SkinDesign, mesh: &Mesh, frames: &[Frame], options: &FitOptions) -> crate::Result<Fit> {
    check(&design.protocol, frames, &options.left_out)?;
    let model = Model::new(design, mesh, options.contacts)?;
    let data = Data::new(&design.protocol, frames, &options.left_out);
    if data.channels.len() < model.unknowns() {
        return Err(FitError::TooFewChannels { channels: data.channels.len(), unknowns: model.unknowns() }.into());
    }
    let (estimate, determinations) = solve::determined(&model, &data)?;
    Ok(Fit {
        design: model.design_at(&estimate.unknowns),
        quantities: quantities(&model, &estimate, &determinations),
        driven: data.misfit(&estimate, true),
        others: data.misfit(&estimate, false),
        offsets: data.offsets(&estimate),
        frames: frames.len(),
    })
}

fn quantities(model: &Model<'_>, estimate: &Estimate, determinations: &[Determination]) -> Vec<FittedQuantity> {
    let list = model.quantities().into_iter().zip(&estimate.unknowns).zip(&estimate.sd).zip(determinations);
    list.map(|((((quantity, initial), unknown), &relative_sd), &determination)| FittedQuantity {
        quantity,
        initial,
        value: initial * unknown.exp(),
        relative_sd,
        determination,
    })
    .collect()
}

/// The factor from a frame of the model to measured values in some channels, by least squares.
///
/// # Errors
/// Values that are unlike the model.
fn factor(measured: &[f64], model: &[f64], channels: &[usize]) -> Result<f64, FitError> {
    let used = |values: &[f64]| channels.iter().map(|&channel| values[channel]).collect::<Vec<f64>>();
    let (measured, model) = (used(measured), used(model));
    let agreement = agreement(measured.iter().copied(), model.iter().copied());
    if agreement < DOUBTFUL { Err(FitError::Unlike { agreement }) } else { Ok(least_squares(&measured, &model)) }
}

/// Refuses frames that do not fit the protocol.
fn check(protocol: &Protocol, frames: &[Frame], left_out: &[usize]) -> Result<(), FitError> {
    let expected = protocol.channel_count();
    if frames.is_empty() {
        return Err(FitError::NoFrame);
    }
    if let Some(&channel) = left_out.iter().find(|&&channel| channel >= expected) {
        return Err(FitError::NoSuchChannel { channel, last: expected - 1 });
    }
    for (frame, values) in frames.iter().enumerate() {
        if values.len() != expected {
            return Err(FitError::FrameLength { frame, got: values.len(), expected });
        }
        let bad = |&channel: &usize| !values[channel].is_finite() && !left_out.contains(&channel);
        if let Some(channel) = (0..expected).find(bad) {
            return Err(FitError::NotFinite { frame, channel, value: values[channel] });
        }
    }
    Ok(())
}
