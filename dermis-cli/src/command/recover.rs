//! `dermis recover`: repair of a truncated recording.

use crate::console::{Progress, print, print_json};
use crate::failure::{Failure, Outcome};
use clap::Args;
use dermis::text::counted;
use dermis_live::recording::{RecoveryReport, recover};
use std::path::{Path, PathBuf};

/// The arguments of `dermis recover`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Truncated or damaged recording; it is not changed.
    recording: PathBuf,
    /// File to write; it must not exist.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Print a summary as JSON.
    #[arg(long)]
    json: bool,
}

/// The error of a recording with damaged parts, which are lost. One that only ends early has none.
pub(super) fn damage(recording: &Path, parts: usize) -> Outcome {
    if parts == 0 {
        return Ok(());
    }
    let message = format!("{}: {} lost, everything else was read", recording.display(), counted(parts, "damaged part"));
    Err(Failure::given(message, Some("look for another copy of the file")))
}

impl Arguments {
    /// Repairs the recording.
    pub fn run(self) -> Outcome {
        let recovered = {
            let _waiting = Progress::waiting("recovering");
            recover(&self.recording, &self.output).map_err(dermis_live::LiveError::from)?
        };
        match self.json {
            true => print_json(&recovered)?,
            false => print(&self.summary(&recovered))?,
        }
        damage(&self.recording, recovered.damaged.len())
    }

    fn summary(&self, recovered: &RecoveryReport) -> String {
        let RecoveryReport { messages, frames, seconds, recordings, was_whole, was_finished, cut_bytes, .. } =
            *recovered;
        let RecoveryReport { ref damaged, without_topic, .. } = *recovered;
        let mut text = format!(
            "{}: {}, {}, {seconds:.1} s\n",
            self.output.display(),
            counted(frames, "frame"),
            counted(messages, "message")
        );
        if recordings > 1 {
            text += &format!("{recordings} recordings were joined; they follow each other in the output\n");
        }
        if was_whole {
            text += "the recording was whole: nothing was left out\n";
        } else if !was_finished && cut_bytes == 0 {
            text += "the recording was not finished: what came in its last moments was not written\n";
        }
        if cut_bytes > 0 {
            text += &format!("left out at the end: {}, no whole record\n", counted(cut_bytes, "byte"));
        }
        for place in damaged {
            text += &format!("left out: {place}\n");
        }
        if without_topic > 0 {
            text += &format!("left out: {} on topics whose names are lost\n", counted(without_topic, "message"));
        }
        text
    }
}
