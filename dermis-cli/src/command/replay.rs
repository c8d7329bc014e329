//! `dermis replay`: the contacts of a recording, recomputed from the messages of the device.

use crate::command::recover::damage;
use crate::console::{Progress, print};
use crate::failure::{Failure, Outcome};
use clap::Args;
use dermis::text::counted;
use dermis_live::LiveError;
use dermis_live::recording::RecordError;
use dermis_live::recording::{Replay, Replayed};
use dermis_live::sinks::jsonl::FrameLine;
use std::io::{BufWriter, Write};
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
}

impl Arguments {
    /// Replays at full speed.
    pub fn run(self) -> Outcome {
        let mut replay = Replay::open(&self.recording, &dermis_learn::methods(), self.method.as_deref())?;
        let name = replay.skin().design().name.clone();
        let waiting = Progress::waiting("replaying");
        let mut out = BufWriter::new(std::io::stdout().lock());
        let (mut frames, mut touched, mut damaged) = (0u64, 0u64, 0);
        loop {
            let frame = match replay.step() {
                Ok(None) => break,
                Ok(Some(Replayed::Frame(frame))) => frame,
                Ok(Some(Replayed::Command(_))) => continue,
                Err(LiveError::Record(RecordError::Damaged { .. })) => {
                    damaged += 1;
                    continue;
                }
                Err(error) => return Err(error.into()),
            };
            frames += 1;
            touched += u64::from(!frame.result.contacts.is_empty());
            let written = match (self.summary, self.contacts) {
                (true, _) => Ok(()),
                (_, true) => serde_json::to_writer(&mut out, &frame.result.contacts).map_err(std::io::Error::from),
                _ => serde_json::to_writer(&mut out, &FrameLine::new(&frame, &name)).map_err(std::io::Error::from),
            };
            let written = if self.summary { written } else { written.and_then(|()| out.write_all(b"\n")) };
            match written {
                Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => return Ok(()),
                written => written.map_err(|error| Failure::given(format!("cannot write: {error}"), None))?,
            }
        }
        let flushed = out.flush();
        drop(out);
        drop(waiting);
        flushed.or_else(|error| match error.kind() {
            std::io::ErrorKind::BrokenPipe => Ok(()),
            _ => Err(Failure::given(format!("cannot write: {error}"), None)),
        })?;
        if self.summary {
            print(&format!("{}, {touched} of them with contacts\n", counted(frames, "frame")))?;
        }
        damage(&self.recording, damaged)
    }
}
