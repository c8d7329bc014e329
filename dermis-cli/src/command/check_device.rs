//! `dermis check-device`: whether a device conforms to the wire protocol.

use crate::console::{Progress, print, print_json};
use crate::failure::{Failure, Outcome};
use crate::range::{count, number};
use clap::Args;
use dermis::design::SkinDesign;
use dermis::finding::Finding;
use dermis::frame::write_whole;
use dermis::text::counted;
use dermis_emulate::conformance::{Conformance, ConformanceOptions, check_device, write_readings};
use dermis_live::ScanTable;
use dermis_live::device::Address;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;

/// The arguments of `dermis check-device`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Device: tcp:HOST:PORT or serial:PATH[@BAUD].
    #[arg(long, value_name = "DEVICE")]
    source: String,
    /// Frames to read.
    #[arg(long, value_name = "N", default_value_t = 120, value_parser = count(2..=60_000usize))]
    frames: usize,
    /// Frame rate, Hz; by default the device's own.
    #[arg(long, value_name = "HZ", value_parser = number(0.001..=1e6))]
    rate: Option<f64>,
    /// Longest time to wait for an answer, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.5, value_parser = number(0.05..=60.0))]
    patience: f64,
    /// File to write: the device's messages, a line each in hexadecimal, without the fields that are its own (name,
    /// numbers, times, texts). Devices with equal readings have equal files.
    #[arg(long, value_name = "FILE")]
    transcript: Option<PathBuf>,
    /// File to write: the scan table and the readings of the frames, which emulated boards replay.
    #[arg(long, value_name = "FILE")]
    readings: Option<PathBuf>,
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Talks to the device and prints what was wrong.
    pub fn run(self) -> Outcome {
        let design = SkinDesign::load(&self.design)?;
        let address = Address::parse(&self.source)?;
        if !matches!(address, Address::Tcp(_) | Address::Serial { .. }) {
            let fix = "give tcp:HOST:PORT or serial:PATH";
            return Err(Failure::given("rows of values have no wire protocol to check", Some(fix)));
        }
        let patience = Duration::from_secs_f64(self.patience);
        let options = ConformanceOptions { frames: self.frames, rate_hz: self.rate, patience };
        let checked = {
            let _waiting = Progress::waiting("talking to the device");
            check_device(&design, &address, options)?
        };
        if let Some(path) = &self.transcript {
            write_whole(path, |out| out.write_all(checked.transcript.as_bytes()))?;
        }
        if let Some(path) = &self.readings {
            let scan = ScanTable::new(&design.protocol).map_err(dermis_live::LiveError::from)?;
            let bytes = write_readings(scan.slots(), &checked.readings)?;
            write_whole(path, |out| out.write_all(&bytes))?;
        }
        if self.json {
            print_json(&checked)?
        } else {
            print(&self.text(&checked))?
        }
        match checked.findings.first() {
            None => Ok(()),
            Some(Finding { step, evidence, fix, .. }) => {
                let step = step.unwrap_or_default();
                Err(Failure::given(format!("the device does not conform: {step}: {evidence}"), Some(fix)))
            }
        }
    }

    fn text(&self, checked: &Conformance) -> String {
        let mut text = format!("{}\n", checked.device);
        for step in &checked.steps {
            let found = checked.findings.iter().find(|finding| finding.step == Some(step));
            let _ = writeln!(text, "  {step:24} {}", found.map_or("as specified", |finding| &finding.evidence));
        }
        let rate = checked.rate_hz.map_or(String::new(), |rate_hz| format!(", {rate_hz:.3} Hz by its clock"));
        let _ = writeln!(
            text,
            "  {}, {} lost{rate}; transcript {}",
            counted(checked.frames, "frame"),
            checked.lost,
            &checked.transcript_sha256[..16]
        );
        text
    }
}
