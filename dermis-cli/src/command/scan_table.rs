//! `dermis scan-table`: the scan table of a skin, for firmware.

use crate::console::print;
use crate::failure::Outcome;
use crate::range::number;
use clap::Args;
use dermis::design::SkinDesign;
use dermis::frame::write_whole;
use dermis_emulate::firmware::ReaderPlan;
use dermis_live::ScanTable;
use dermis_sim::twin::TwinOptions;
use dermis_sim::twin::electronics::Switching;
use std::path::PathBuf;

/// The arguments of `dermis scan-table`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Write a C header instead of CSV.
    #[arg(long)]
    header: bool,
    /// Write the table with the settling time of each slot, as a module in Rust for dermis-firmware, instead of CSV.
    #[arg(long, conflicts_with = "header")]
    firmware: bool,
    /// Digital twin with the electronics of the reader, for --firmware: the path of a file, or a shipped name.
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    twin: String,
    /// Charge that a closing switch injects, pC, for --firmware.
    #[arg(long, value_name = "PC", default_value_t = 1.0, value_parser = number(0.0..=1000.0))]
    charge: f64,
    /// File to write instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl Arguments {
    /// Writes the table.
    pub fn run(self) -> Outcome {
        let design = SkinDesign::load(&self.design)?;
        // Refuses what no device can be sent.
        ScanTable::new(&design.protocol).map_err(dermis_live::LiveError::from)?;
        let (protocol, places) = (&design.protocol, design.multiplexer_inputs());
        let text = match (self.firmware, self.header) {
            (true, _) => self.plan(&design)?.to_rust(),
            (_, true) => protocol.scan_c_header(&design.name, design.sha256(), &places),
            _ => protocol.scan_csv(&places),
        };
        match &self.output {
            Some(path) => Ok(write_whole(path, |out| out.write_all(text.as_bytes()))?),
            None => print(&text),
        }
    }

    fn plan(&self, design: &SkinDesign) -> Outcome<ReaderPlan> {
        let switching = Switching { charge_c: self.charge * 1e-12, aperture_s: 0.0 };
        Ok(ReaderPlan::new(design, &TwinOptions::load(&self.twin)?, switching)?)
    }
}
