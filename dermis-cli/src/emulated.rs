//! The emulated device, from command-line options.

use crate::failure::{Failure, Outcome};
use crate::range::{count, number, parsed, seed};
use clap::Args;
use dermis::design::SkinDesign;
use dermis::files::{MAX_SETTINGS_BYTES, read_text_at_most};
use dermis_emulate::emulator::{Emulator, EmulatorOptions, MAX_PRERENDERED, Script, TimedFault};
use dermis_emulate::firmware::{FirmwareDevice, FirmwareOptions};
use dermis_sim::twin::TwinOptions;
use dermis_sim::twin::electronics::Switching;
use std::sync::Arc;

/// Charge of a closing switch, C, and aperture delay of the converter, s, as docs/firmware.md has them.
const CHARGE_C: f64 = 1e-12;
const APERTURE_S: f64 = 2e-9;

/// The emulated device.
#[derive(Debug, Clone, Args)]
pub struct EmulatorArguments {
    /// Digital twin: the path of a file, or a shipped name (ideal, lab, lab-b, lab-c, harsh).
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    twin: String,
    /// Seed of the twin, and serial number of the device.
    #[arg(long, value_name = "S", default_value_t = 1, value_parser = seed)]
    seed: u64,
    /// Touch script: the path of a file, or none, random, press, slide, cross, four, grid (the presses of `dermis
    /// experiment`).
    #[arg(long, value_name = "SCRIPT", default_value = "none")]
    touch: String,
    /// Fault and its time (s): loose:ELECTRODE[:OHM]@10, mend:ELECTRODE@20, clock-set:BY@10, or with a duration, as in
    /// zeros@10+5: noise:COUNTS, bytes:SHARE, unplug, silent, clock-stop, source-off, zeros, full-scale, freeze,
    /// references:FACTOR, reference:DRIVE:FACTOR, gain:FACTOR, offset:COUNTS, stuck:CHANNEL, saturated:CHANNEL. May be
    /// given more than once.
    #[arg(long, value_name = "FAULT", value_parser = parsed::<TimedFault>)]
    fault: Vec<TimedFault>,
    /// Speed of the simulated device or of a recording, as a multiple of real time.
    #[arg(long, value_name = "TIMES", default_value_t = 1.0, value_parser = number(0.001..=1000.0))]
    speed: f64,
    /// Compute this many frames in advance and send them repeatedly, for high rates.
    #[arg(
        long,
        value_name = "FRAMES",
        default_value_t = 0,
        hide_default_value = true,
        value_parser = count(0..=MAX_PRERENDERED)
    )]
    prerender: usize,
    /// Send frames at the full rate of the connection.
    #[arg(long)]
    unpaced: bool,
}

impl EmulatorArguments {
    /// Starts the device.
    pub fn emulator(&self, design: &SkinDesign) -> Outcome<Arc<Emulator>> {
        let twin = TwinOptions::load(&self.twin)?;
        let options = EmulatorOptions {
            script: Script::load(&self.touch, design, &twin, self.seed)?,
            twin,
            seed: self.seed,
            faults: self.fault.clone(),
            speed: self.speed,
            prerendered: self.prerender,
            unpaced: self.unpaced,
        };
        Ok(Emulator::new(design, options)?)
    }

    /// An option that is not as it is by default.
    pub fn changed(&self) -> Option<&'static str> {
        let changed = [
            ("--twin", self.twin != "lab"),
            ("--touch", self.touch != "none"),
            ("--fault", !self.fault.is_empty()),
            ("--prerender", self.prerender > 0),
            ("--speed", self.speed != 1.0),
            ("--unpaced", self.unpaced),
        ];
        changed.into_iter().find_map(|(option, is_changed)| is_changed.then_some(option))
    }

    /// The same with another seed.
    pub fn with_seed(&self, seed: u64) -> Self {
        EmulatorArguments { seed, ..self.clone() }
    }

    /// Starts a device that runs the firmware.
    pub fn firmware(&self, design: &SkinDesign) -> Outcome<Arc<FirmwareDevice>> {
        let twin = TwinOptions::load(&self.twin)?;
        let options = FirmwareOptions {
            script: Script::load(&self.touch, design, &twin, self.seed)?,
            twin,
            seed: self.seed,
            switching: Switching { charge_c: CHARGE_C, aperture_s: APERTURE_S },
            speed: self.speed,
            unpaced: self.unpaced,
        };
        Ok(FirmwareDevice::new(design, options)?)
    }

    /// Whether the readings of the twin have no noise.
    pub fn is_noise_free(&self) -> bool {
        TwinOptions::load(&self.twin).is_ok_and(|twin| twin.electronics.snr_db.is_none())
    }

    /// Speed as a multiple of real time.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// A short description.
    pub fn summary(&self) -> String {
        format!("emulator: {}, seed {}", self.twin, self.seed)
    }

    /// The text of the twin's file.
    pub fn twin_text(&self) -> Outcome<String> {
        if let (false, Some(text)) = (std::path::Path::new(&self.twin).is_file(), TwinOptions::shipped_text(&self.twin))
        {
            return Ok(text.into());
        }
        read_text_at_most(std::path::Path::new(&self.twin), MAX_SETTINGS_BYTES)
            .map_err(|error| Failure::given(format!("cannot read the twin {}: {error}", self.twin), None))
    }
}
