//! The digital twin of a command.

use crate::failure::Outcome;
use crate::range::number;
use clap::Args;
use dermis_sim::twin::TwinOptions;

/// The arguments that choose a digital twin.
#[derive(Debug, Args)]
pub struct TwinArguments {
    /// Digital twin: the path of a file, or a shipped name (ideal, lab, lab-b, lab-c, harsh).
    #[arg(long = "twin", value_name = "TWIN", default_value = "lab")]
    pub name: String,
    /// Signal-to-noise ratio of a reading, instead of that of the twin, dB.
    #[arg(long, value_name = "DB", value_parser = number(-20.0..=200.0))]
    noise: Option<f64>,
}

impl TwinArguments {
    /// The twin's options.
    pub fn load(&self) -> Outcome<TwinOptions> {
        let mut options = TwinOptions::load(&self.name)?;
        options.electronics.snr_db = self.noise.or(options.electronics.snr_db);
        Ok(options)
    }
}
