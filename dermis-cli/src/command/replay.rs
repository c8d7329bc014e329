//! `dermis replay`: the contacts of a recording, recomputed from the messages of the device.

use crate::command::recover::damage;
use crate::console::{Progress, print, print_json, warn};
use crate::failure::Outcome;
use crate::output::{json_line, to_standard_output};
use clap::Args;
use dermis::text::counted;
use dermis_live::LiveError;
use dermis_live::recording::RecordError;
use dermis_live::recording::{Replay, Replayed};
use dermis_live::sinks::jsonl::FrameLine;
use serde::Serialize;
use std::path::PathBuf;

/// The arguments of `dermis replay`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Recording, complete or truncated.
    recording: PathBuf,
    /// Folder of the network that the recording was made with, unless a shipped one.
    #[arg(long, value_name = "FOLDER")]
    method: Option<String>,
    /// Print contacts alone, without times of output: identical for every replay.
    #[arg(long)]
    contacts: bool,
    /// Print a summary instead of a line of JSON per frame.
    #[arg(long, conflicts_with = "contacts")]
    summary: bool,
    /// Print JSON, which the lines of frames always are: the summary too.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Replays at full speed.
    pub fn run(self) -> Outcome {
        let mut replay = Replay::open(&self.recording, &dermis_learn::methods(), self.method.as_deref())?;
        let name = replay.skin().design().name.clone();
        let recorded = replay.session().state["settings"]["method"].as_str().unwrap_or_default();
        if let Some(own) = self.method.as_deref().filter(|_| {
            // What has a card, or was a folder, takes a method of one's own.
            replay.session().model_card_json.is_none() && !dermis::method::is_path(recorded)
        }) {
            warn(&format!("the recording begins with the method `{recorded}`: {own} is not used for it"));
        }
        let waiting = Progress::waiting("replaying");
        let mut counts = ReplayCounts::default();
        // A reader that has enough ends it before.
        let (mut failure, mut is_read) = (Ok(()), false);
        to_standard_output(|out| {
            loop {
                let frame = match replay.step() {
                    Ok(None) => break,
                    Ok(Some(Replayed::Frame(frame))) => frame,
                    Ok(Some(Replayed::Command(_))) => continue,
                    Err(error @ LiveError::Record(RecordError::Damaged { .. })) => {
                        counts.damaged_parts += 1;
                        warn(&error.to_string());
                        continue;
                    }
                    Err(error) => {
                        failure = Err(error);
                        return Ok(());
                    }
                };
                counts.frames += 1;
                counts.touched_frames += u64::from(!frame.result.contacts.is_empty());
                match (self.summary, self.contacts) {
                    (true, _) => {}
                    (_, true) => json_line(out, &frame.result.contacts)?,
                    _ => json_line(out, &FrameLine::new(&frame, &name))?,
                }
            }
            is_read = true;
            Ok(())
        })?;
        drop(waiting);
        failure?;
        if !replay.is_whole() && is_read && counts.damaged_parts == 0 {
            warn(&format!("{} ends early: what came in its last moments is missing", self.recording.display()));
        }
        match (self.summary, self.json) {
            (true, true) => print_json(&counts)?,
            (true, false) => {
                let frames = counted(counts.frames, "frame");
                print(&format!("{frames}, {} of them with contacts\n", counts.touched_frames))?;
            }
            _ => {}
        }
        damage(&self.recording, counts.damaged_parts)
    }
}

/// What a replay counts.
#[derive(Debug, Default, Serialize)]
struct ReplayCounts {
    frames: u64,
    touched_frames: u64,
    damaged_parts: usize,
}
