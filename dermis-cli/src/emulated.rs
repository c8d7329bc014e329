//! The emulated device, as asked for on the command line.

use crate::failure::{Failure, Outcome};
use clap::Args;
use dermis::design::SkinDesign;
use dermis_live::emulator::{Emulator, EmulatorOptions, Script, TimedFault};
use dermis_sim::twin::TwinOptions;
use std::sync::Arc;

/// What is emulated.
#[derive(Debug, Clone, Args)]
pub struct EmulatorArguments {
    /// Digital twin: the path of a file, or a shipped name (ideal, lab, harsh).
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    twin: String,
    /// Its seed, which is the number of the device too.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// What touches it: a script's file, or none, random, press, slide, cross, four, grid (the presses of `dermis experiment`, one
    /// after the other, each held).
    #[arg(long, value_name = "SCRIPT", default_value = "none")]
    touch: String,
    /// What goes wrong, and when (s): loose:ELECTRODE[:OHM]@10, mend:ELECTRODE@20, noise:COUNTS@10+5, bytes:SHARE@0+60,
    /// unplug@10+3. May be given several times.
    #[arg(long, value_name = "FAULT")]
    fault: Vec<String>,
    /// Seconds of the device (of `live`: or of a recording) that pass in one of ours.
    #[arg(long, value_name = "TIMES", default_value_t = 1.0)]
    speed: f64,
    /// Make so many frames beforehand and send them over and over, to try high rates.
    #[arg(long, value_name = "FRAMES", default_value_t = 0, hide_default_value = true)]
    prerender: usize,
    /// Send frames as fast as the line takes them.
    #[arg(long)]
    unpaced: bool,
}

impl EmulatorArguments {
    /// Powers the device up.
    pub fn emulator(&self, design: &SkinDesign) -> Outcome<Arc<Emulator>> {
        let faults = self.fault.iter().map(|fault| fault.parse()).collect::<Result<Vec<TimedFault>, _>>();
        let twin = TwinOptions::load(&self.twin)?;
        let options = EmulatorOptions {
            script: Script::load(&self.touch, design, &twin, self.seed)?,
            twin,
            seed: self.seed,
            faults: faults?,
            speed: self.speed,
            prerendered: self.prerender,
            unpaced: self.unpaced,
        };
        Ok(Emulator::new(design, options)?)
    }

    /// Seconds of the device, or of a recording in its place, that pass in one of ours.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// It in words.
    pub fn summary(&self) -> String {
        format!("emulator: {}, seed {}", self.twin, self.seed)
    }

    /// The text of the twin's file.
    pub fn twin_text(&self) -> Outcome<String> {
        if let (false, Some(text)) = (std::path::Path::new(&self.twin).is_file(), TwinOptions::shipped_text(&self.twin))
        {
            return Ok(text.into());
        }
        std::fs::read_to_string(&self.twin)
            .map_err(|error| Failure::given(format!("cannot read the twin {}: {error}", self.twin), None))
    }
}
