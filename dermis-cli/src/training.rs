//! Trainings for programs that compute the steps themselves: the samples, the options and the files of `dermis train`.

use crate::command::{Command, train};
use crate::failure::CommandError;
use crate::{Arguments, failure};
use clap::Parser;
use dermis_learn::{Epoch, Input, Network, Training};
use std::ffi::OsString;
use std::path::Path;

/// A training described by the arguments of `dermis train`.
#[derive(Debug)]
pub struct TrainingRun {
    arguments: train::Arguments,
    training: Training,
}

impl TrainingRun {
    /// The training of `dermis train` with these arguments, without `dermis` and `train`.
    ///
    /// # Errors
    /// Wrong arguments, and whatever `dermis train` refuses.
    pub fn new(arguments: impl IntoIterator<Item = OsString>) -> Result<Self, CommandError> {
        let line = ["dermis", "train"].into_iter().map(OsString::from).chain(arguments);
        let parsed = Arguments::try_parse_from(line).map_err(|error| CommandError::of_arguments(&error))?;
        let Command::Train(arguments) = parsed.command else { unreachable!("the line begins with `train`") };
        let training = arguments.training().map_err(CommandError::of_failure)?;
        Ok(TrainingRun { arguments, training })
    }

    /// Skin, preset and samples.
    pub fn training(&self) -> &Training {
        &self.training
    }

    /// The folder for the model.
    pub fn output(&self) -> &Path {
        self.arguments.output()
    }

    /// Writes the plot of the losses into the folder.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn write_losses(&self, epochs: &[Epoch]) -> Result<(), CommandError> {
        train::write_losses(self.output(), epochs).map_err(CommandError::of_failure)
    }

    /// Writes the model of a trained network into the folder.
    ///
    /// # Errors
    /// A folder that cannot be written, test samples that cannot be read.
    pub fn save(&self, input: &Input, network: Network, epochs: &[Epoch]) -> Result<(), CommandError> {
        let model = self.training.model(input, network, epochs).map_err(failure::Failure::from);
        model.and_then(|model| self.arguments.save(&model)).map_err(CommandError::of_failure)
    }
}
