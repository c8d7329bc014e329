//! `dermis check-build`: whether a skin was built as designed.

use crate::build_page::page;
use crate::build_watch::FRAMES;
use crate::console::{Progress, known, notice_line, print, print_json, say, warn};
use crate::failure::{Failure, Outcome};
use crate::format::FormatArguments;
use crate::frames::{CURRENTS_HELP, warn_if_unlike};
use crate::picture::check_page_ending;
use crate::range::count;
use crate::skin;
use crate::source::SourceArguments;
use clap::Args;
use dermis::finding::{Severity, is_sound};
use dermis::frame::{Frame, ReadOptions};
use dermis::plausibility::Plausibility;
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_calibrate::build::{BuildCheck, BuildChecker};
use dermis_live::{Event, Live};
use dermis_plot::report::findings_text;
use serde_json::json;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;

/// Events that can wait.
const WAITING: usize = 1 << 10;
/// A source that sends no frame for this time is given up.
const PATIENCE: Duration = Duration::from_secs(10);

/// The arguments of `dermis check-build`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Frames of the untouched skin, one per row (CSV, NPY or NPZ; ohm, or see --unit), in place of a --source.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["source", "rate", "EmulatorArguments", "take"])]
    frames: Option<PathBuf>,
    #[arg(long, value_name = "FILE", requires = "frames", help = CURRENTS_HELP)]
    currents: Option<PathBuf>,
    #[command(flatten)]
    format: FormatArguments,
    /// Frames to take from the source.
    #[arg(long, value_name = "N", default_value_t = FRAMES, value_parser = count(1..=100_000usize))]
    take: usize,
    /// Report to write: findings, map of the coat, contacts (.html).
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print JSON (SI units) instead of a table.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    source: SourceArguments,
}

impl Arguments {
    /// Checks the skin and prints the findings.
    pub fn run(self) -> Outcome {
        if let Some(path) = &self.output {
            check_page_ending(path)?;
        }
        let skin = skin::load(&self.design)?;
        let (frames, source) = match &self.frames {
            Some(path) => {
                let (protocol, currents) = (&skin.design().protocol, self.currents.as_deref());
                (
                    self.format.read_divided(
                        path,
                        protocol,
                        &ReadOptions { untouched: true, ..ReadOptions::default() },
                        currents,
                    )?,
                    path.display().to_string(),
                )
            }
            None => self.read_source(&skin)?,
        };
        warn_if_unlike(&Plausibility::new(&skin.design().protocol, skin.untouched()?, &[]), &frames);
        let check = {
            let _waiting = Progress::waiting("checking the skin");
            BuildChecker::new(&skin)?.check(&frames)?
        };
        if let Some(path) = &self.output {
            page(&skin, &check, &source)?.write(path)?;
        }
        if self.json { print_json(&as_json(&skin, &check, &source)) } else { print(&self.text(&skin, &check)) }
    }

    /// Frames of the source, and its description.
    fn read_source(&self, skin: &Skin) -> Outcome<(Vec<Frame>, String)> {
        if self.source.recording().is_some() {
            let fix = "convert it with dermis convert, and give its untouched frames with --frames";
            return Err(Failure::given("a recording is no device", Some(fix)));
        }
        let (live, emulator) = self.source.start(skin, false)?;
        let read = self.read_frames(&live);
        let name = live.shared().facts().map(|facts| format!("{}, serial number {}", facts.name, facts.serial));
        let failure = live.take_failure();
        live.stop();
        emulator.into_iter().for_each(|emulator| emulator.stop());
        if let Some(failure) = failure {
            return Err(failure.into());
        }
        Ok((read?, name.unwrap_or_else(|| "rows of values".into())))
    }

    fn read_frames(&self, live: &Live) -> Outcome<Vec<Frame>> {
        let mailbox = live.shared().subscribe(WAITING);
        let progress = Progress::new("reading frames", self.take);
        live.begin();
        let frames = mailbox.frames(self.take, PATIENCE, |event| match event {
            Event::Frame(_) => progress.step(),
            Event::Notice(notice) if notice.level == Severity::Error => {
                say(notice_line(notice.level, &notice.text));
            }
            _ => {}
        });
        match frames.len() {
            0 => Err(Failure::given("the source sends no frame", Some("check its connection, or try dermis live"))),
            count => {
                if count < self.take {
                    warn(&format!("the source has sent {} and stopped", counted(count, "frame")));
                }
                Ok(frames)
            }
        }
    }

    fn text(&self, skin: &Skin, check: &BuildCheck) -> String {
        let mut text = format!(
            "{}: {}, {}",
            skin.design().name,
            counted(check.frames, "untouched frame"),
            findings_text(&check.findings, "sound, no findings")
        );
        text.push('\n');
        // Frames that no resistances explain tell none.
        if check.misfit.is_finite() && check.resistance_factor.is_finite() {
            let _ = writeln!(
                text,
                "resistances over the design's: {:.3}; unevenness of the coat: {:.1} %; misfit: {:.2}",
                check.resistance_factor,
                100.0 * check.unevenness,
                check.misfit
            );
        }
        if let Some(path) = &self.output {
            let _ = writeln!(text, "written to {}", path.display());
        }
        text
    }
}

fn as_json(skin: &Skin, check: &BuildCheck, source: &str) -> serde_json::Value {
    json!({
        "skin": skin.design().name,
        "protocol_sha256": skin.design().protocol.sha256(),
        "source": source,
        "frames": check.frames,
        "sound": is_sound(&check.findings),
        "findings": check.findings,
        "faults": check.faults,
        "resistance_factor": known(check.resistance_factor),
        "unevenness": known(check.unevenness),
        "misfit": known(check.misfit),
        "sound_misfit": known(check.sound_misfit),
        "noise_ohm": check.noise_ohm.map(known),
        "contacts": check.contacts,
        "conductance": check.conductance,
    })
}
