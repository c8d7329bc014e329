//! `dermis scan-table`: the scan table of a skin, for firmware.

use crate::console::print;
use crate::failure::Outcome;
use clap::Args;
use dermis::design::SkinDesign;
use dermis::frame::write_whole;
use dermis_live::ScanTable;
use std::path::PathBuf;

/// The arguments of `dermis scan-table`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Write a C header instead of CSV.
    #[arg(long)]
    header: bool,
    /// File to write instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl Arguments {
    /// Writes the table.
    pub fn run(self) -> Outcome {
        let design = SkinDesign::load(&self.design)?;
        let table = ScanTable::new(&design.protocol).map_err(dermis_live::LiveError::from)?;
        let text = if self.header { table.to_c_header(&design.name, design.sha256()) } else { table.to_csv() };
        match &self.output {
            Some(path) => Ok(write_whole(path, |out| out.write_all(text.as_bytes()))?),
            None => print(&text),
        }
    }
}
