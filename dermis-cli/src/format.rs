//! The units and parts of the values in files of frames.

use crate::failure::{Failure, Outcome};
use crate::range::number;
use clap::{Args, ValueEnum};
use dermis::frame::{DriveCurrents, Frame, Part, ReadOptions, read_frames_with};
use dermis::protocol::Protocol;
use std::path::Path;

/// How the values of frames are written.
#[derive(Debug, Clone, Args)]
pub struct FormatArguments {
    /// Unit of the frames. Voltages are divided by the currents of --current-a or --currents [default: V with currents, else
    /// ohm]
    #[arg(long, value_enum, requires = "frames")]
    unit: Option<Unit>,
    /// Current of every drive: the frames are then voltages (V, or in --unit).
    #[arg(long, value_name = "A", value_parser = number(1e-9..=1e3), conflicts_with = "currents", requires = "frames")]
    current_a: Option<f64>,
    /// Part to read of complex values, as `1.2+0.3i` or complex arrays. Of pairs of columns, which are magnitude and phase, or
    /// real and imaginary part, the first is read, with `imaginary` the second. Magnitudes need `amplitude_only = true` in the
    /// design.
    #[arg(long, value_enum, requires = "frames")]
    part: Option<PartChoice>,
}

/// A unit of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Unit {
    #[value(name = "ohm")]
    Ohm,
    #[value(name = "mohm", help = "0.001 ohm")]
    Milliohm,
    #[value(name = "kohm", help = "1000 ohm")]
    Kiloohm,
    #[value(name = "V")]
    Volt,
    #[value(name = "mV", help = "0.001 V")]
    Millivolt,
    #[value(name = "uV", help = "0.000001 V")]
    Microvolt,
}

impl Unit {
    /// The number of ohms or volts.
    fn factor(self) -> f64 {
        match self {
            Unit::Ohm | Unit::Volt => 1.0,
            Unit::Milliohm | Unit::Millivolt => 1e-3,
            Unit::Kiloohm => 1e3,
            Unit::Microvolt => 1e-6,
        }
    }

    fn is_voltage(self) -> bool {
        matches!(self, Unit::Volt | Unit::Millivolt | Unit::Microvolt)
    }
}

/// A part of complex values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PartChoice {
    Real,
    Magnitude,
    Imaginary,
}

impl From<PartChoice> for Part {
    fn from(choice: PartChoice) -> Self {
        match choice {
            PartChoice::Real => Part::Real,
            PartChoice::Magnitude => Part::Magnitude,
            PartChoice::Imaginary => Part::Imaginary,
        }
    }
}

impl FormatArguments {
    /// Reads frames: in ohm, or in volts where they are to be divided by measured currents.
    pub fn read(
        &self,
        path: &Path,
        protocol: &Protocol,
        options: &ReadOptions<'_>,
        has_currents: bool,
    ) -> Outcome<Vec<Frame>> {
        let factor = self.factor(has_currents)?;
        if self.part == Some(PartChoice::Magnitude) && !protocol.amplitude_only() {
            let fix = "read the real parts with --part real, or set amplitude_only = true in the design's [protocol]";
            return Err(Failure::given("magnitudes have no sign, and the values of this design have one", Some(fix)));
        }
        let options = ReadOptions { part: self.part.map(Part::from), ..*options };
        let mut frames = read_frames_with(path, protocol, &options)?;
        if factor != 1.0 {
            frames.iter_mut().flat_map(|frame| frame.iter_mut()).for_each(|value| *value *= factor);
        }
        Ok(frames)
    }

    /// [`read`](Self::read), divided by the currents of a file, if there is one: ohm.
    pub fn read_divided(
        &self,
        path: &Path,
        protocol: &Protocol,
        options: &ReadOptions<'_>,
        currents: Option<&Path>,
    ) -> Outcome<Vec<Frame>> {
        divided(currents, protocol, self.read(path, protocol, options, currents.is_some())?)
    }

    /// What the values are multiplied with.
    fn factor(&self, has_currents: bool) -> Outcome<f64> {
        let is_voltage = has_currents || self.current_a.is_some();
        match self.unit {
            Some(unit) if unit.is_voltage() && !is_voltage => Err(Failure::given(
                "voltages are no frames without the currents of the drives",
                Some(
                    "give the current with --current-a, as in --current-a 0.001, or measured currents with --currents",
                ),
            )),
            Some(unit) if !unit.is_voltage() && is_voltage => Err(Failure::given(
                "values in ohm are divided by the currents already",
                Some("leave --currents and --current-a out, or give the unit of voltages with --unit V, mV or uV"),
            )),
            unit => Ok(unit.map_or(1.0, Unit::factor) / self.current_a.unwrap_or(1.0)),
        }
    }
}

/// Frames divided by the currents of a file, if there is one.
pub fn divided(currents: Option<&Path>, protocol: &Protocol, frames: Vec<Frame>) -> Outcome<Vec<Frame>> {
    let Some(path) = currents else { return Ok(frames) };
    Ok(DriveCurrents::read(path, protocol, frames.len())?.frames_per_ampere(protocol, frames))
}
