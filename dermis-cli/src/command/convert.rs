//! `dermis convert`: conversion of a recording to tables.

use crate::command::recover::damage;
use crate::console::{Progress, print, print_json};
use crate::failure::Outcome;
use clap::Args;
use dermis::text::counted;
use dermis_live::recording::{Converted, convert};
use std::path::PathBuf;

/// The arguments of `dermis convert`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Recording, complete or truncated.
    recording: PathBuf,
    /// Folder to write, which must not exist: frames.csv, times.csv, contacts.csv and recording.npz.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Print a summary as JSON.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Converts the recording.
    pub fn run(self) -> Outcome {
        let converted = {
            let _waiting = Progress::waiting("converting");
            convert(&self.recording, &self.output).map_err(dermis_live::LiveError::from)?
        };
        match self.json {
            true => print_json(&converted)?,
            false => print(&self.summary(&converted))?,
        }
        damage(&self.recording, converted.damaged)
    }

    fn summary(&self, converted: &Converted) -> String {
        let Converted { frames, channels, picture: [rows, columns], contacts, ref left_out, .. } = *converted;
        let folder = self.output.display();
        let mut text = format!(
            "{folder}: {} of {channels} values and {rows} x {columns} pixels, {}\n",
            counted(frames, "frame"),
            counted(contacts, "contact")
        );
        for place in left_out {
            text += &format!("left out: {place}\n");
        }
        text
    }
}
