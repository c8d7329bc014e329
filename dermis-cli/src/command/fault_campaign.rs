//! `dermis fault-campaign`: random faults of an emulated device.

use crate::console::{Progress, print, print_json};
use crate::failure::Outcome;
use crate::method::METHOD_HELP;
use crate::range::{count, seed};
use crate::twin::TwinArguments;
use clap::Args;
use dermis::frame::write_whole;
use dermis::method::MethodSet;
use dermis::skin::Skin;
use dermis_emulate::campaign::{CampaignOptions, FaultKind, Score, run, scores};
use dermis_plot::report::Table;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The arguments of `dermis fault-campaign`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[arg(long, value_name = "NAME|FOLDER", help = METHOD_HELP)]
    method: Option<String>,
    #[command(flatten)]
    twin: TwinArguments,
    /// Number of faults.
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = count(1..=1_000_000u64))]
    faults: u64,
    /// Seed of the faults, presses and twins.
    #[arg(long, value_name = "S", default_value_t = 1, value_parser = seed)]
    seed: u64,
    /// Write every fault, and the presses without faults of every device, with the times of the false contacts, as a JSON
    /// line to this file.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Runs the campaign.
    pub fn run(self) -> Outcome {
        let skin = Skin::load(&self.design)?;
        let methods = Arc::new(MethodSet::new(&dermis_learn::methods(), skin, self.method.as_deref())?);
        let options = CampaignOptions {
            twin: self.twin.load()?,
            method: self.method.clone().unwrap_or_default(),
            faults: self.faults as usize,
            seed: self.seed,
        };
        let runs = {
            let (bar, shown) = (Progress::new("faults", options.faults), AtomicUsize::new(0));
            run(&methods, &options, |done| {
                bar.steps(done.saturating_sub(shown.fetch_max(done, Ordering::Relaxed)) as u64);
            })?
        };
        if let Some(output) = &self.output {
            write_whole(output, |file| runs.iter().try_for_each(|run| writeln!(file, "{}", serde_json::json!(run))))?;
        }
        let scores = scores(&runs);
        if self.json {
            return print_json(&serde_json::json!(scores));
        }
        print(&table(&scores).to_text())
    }
}

/// A row for each kind of fault, one for all faults, and one for the presses without faults.
fn table(scores: &[Score]) -> Table {
    let mut table = Table::new(&[
        "fault",
        "count",
        "frames during",
        "with false contacts",
        "touch wrong",
        "frames after",
        "with false contacts",
        "touch wrong",
        "noticed in 0.1 s",
        "named",
        "presses found later",
        "longest until ok, s",
    ]);
    let (faults, control): (Vec<&Score>, Vec<&Score>) =
        scores.iter().partition(|score| score.kind != FaultKind::Control);
    let total = faults.iter().copied().cloned().reduce(|mut total, score| {
        total += &score;
        total
    });
    faults.iter().for_each(|score| table.row(row(score.kind.name(), score)));
    total.iter().for_each(|total| table.row(row("all", total)));
    control.iter().for_each(|score| table.row(row(score.kind.name(), score)));
    table
}

fn row(name: &str, score: &Score) -> [String; 12] {
    let Score { during, after, .. } = score;
    [
        name.to_string(),
        score.faults.to_string(),
        during.frames.to_string(),
        during.false_contacts.to_string(),
        during.wrong_touch.to_string(),
        after.frames.to_string(),
        after.false_contacts.to_string(),
        after.wrong_touch.to_string(),
        format!("{} of {}", score.noticed, score.to_notice),
        format!("{} of {}", score.named, score.to_notice),
        format!("{} of {}", score.found, score.presses),
        format!("{:.2}", score.slowest_s),
    ]
}
