//! `dermis check-frames`: what is wrong with a recording.

use crate::check_page::page;
use crate::console::{Progress, known, print, print_json};
use crate::failure::{Failure, Outcome};
use crate::frames::{FrameArguments, Incomplete, Recorded};
use crate::picture::check_page_ending;
use crate::skin;
use clap::Args;
use dermis::estimate::noise::ChannelNoise;
use dermis::frame::write_frames;
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_calibrate::checks::{Checked, Recording, check_recording, realigned};
use dermis_calibrate::{LabelFrame, Presses};
use dermis_plot::report::findings_text;
use serde_json::json;
use std::fmt::Write;
use std::path::PathBuf;

/// The arguments of `dermis check-frames`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    frames: FrameArguments,
    /// Measured presses, one per frame, as for `dermis calibrate`: checks whether they are shifted against the frames,
    /// and, on the skin, whether their axes are reversed or exchanged.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Page to write: findings and pictures (.html).
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// File to write: the frames with late channels moved to their rows (CSV, NPY or NPZ). Nothing else is changed; with
    /// --currents the values are in ohm.
    #[arg(long, value_name = "FILE")]
    realign: Option<PathBuf>,
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Checks the frames and prints the findings.
    pub fn run(self) -> Outcome {
        if let Some(path) = &self.output {
            check_page_ending(path)?;
        }
        if self.realign.is_some() && self.frames.is_of_model() {
            let fix = "give untouched frames with --baseline, or leave --realign out";
            return Err(Failure::given("--realign does not go with --baseline model", Some(fix)));
        }
        let skin = skin::load(&self.design)?;
        skin::warn_if_ambiguous(&skin)?;
        // What is realigned has a row for each frame.
        let incomplete = if self.realign.is_some() { Incomplete::Refused } else { Incomplete::LeftOut };
        let Recorded { frames, untouched, used, .. } = self.frames.read_recorded(&skin, &[], incomplete)?;
        let presses = self.truth.as_ref().map(|path| Presses::read(path, &skin, used.count)).transpose()?;
        let presses = presses.map(|presses| presses.of_rows(&used.rows));
        let positions_m = presses.as_ref().map(Presses::positions_m);
        let mut checked = {
            let _waiting = Progress::waiting("checking the frames");
            let label_frame = presses.as_ref().map_or(LabelFrame::Skin, Presses::frame);
            check_recording(&skin, &Recording { frames: &frames, untouched: &untouched, positions_m, label_frame })?
        };
        if let Some(unlike) = self.frames.of_model(&skin, &frames)? {
            checked.findings.insert(0, unlike);
        }
        checked.findings.iter_mut().for_each(|found| found.rows = used.rows_of(&found.rows));
        if let Some(path) = &self.realign {
            write_frames(path, &realigned(&frames, &checked.lags)?)?;
        }
        if let Some(path) = &self.output {
            page(&skin, frames.len(), &checked).write(path)?;
        }
        let noise = ChannelNoise::of(&untouched, &skin.design().protocol);
        if self.json {
            self.print_json(&skin, frames.len(), &checked, noise.as_ref())
        } else {
            print(&self.text(&skin, frames.len(), &checked, noise.as_ref()))
        }
    }

    fn print_json(&self, skin: &Skin, frames: usize, checked: &Checked, noise: Option<&ChannelNoise>) -> Outcome {
        print_json(&json!({
            "skin": skin.design().name,
            "frames": frames,
            "channels": skin.design().protocol.channel_count(),
            "noise_ohm": noise.map(|noise| noise.by_group_ohm().map(known)),
            "findings": checked.findings,
            "lags": checked.lags,
            "columns": checked.columns,
            "untouched_cosine": checked.figures.untouched_cosine,
            "correlation_cosine": checked.figures.correlation_cosine,
            "drift": checked.figures.drift,
            "memory": checked.figures.memory,
        }))
    }

    fn text(&self, skin: &Skin, frames: usize, checked: &Checked, noise: Option<&ChannelNoise>) -> String {
        let mut text = format!(
            "{}: {}, {}",
            skin.design().name,
            counted(frames, "frame"),
            findings_text(&checked.findings, "no findings")
        );
        if let Some(noise) = noise {
            let _ = writeln!(text, "{noise}");
        }
        for path in [&self.realign, &self.output].into_iter().flatten() {
            let _ = writeln!(text, "written to {}", path.display());
        }
        text
    }
}
