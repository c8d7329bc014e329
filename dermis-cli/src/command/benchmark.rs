//! `dermis benchmark`: a method on digital twins.

use crate::console::{Progress, print, print_json};
use crate::failure::Outcome;
use crate::method::MethodArguments;
use crate::picture::{picture, save};
use crate::range::{count, seed};
use crate::skin;
use crate::twin::TwinArguments;
use clap::Args;
use dermis::design::MAX_ELECTRODES;
use dermis::frame::Differences;
use dermis::method::Method;
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_plot::chart::Curves;
use dermis_plot::{Key, Picture, Scale, skin_map};
use dermis_sim::evaluate::{BenchmarkOptions, BenchmarkSummary, benchmark, benchmark_families};
use dermis_sim::experiment::Family;
use dermis_sim::twin::TwinOptions;
use dermis_study::metrics;
use std::ops::Range;
use std::path::PathBuf;

/// The arguments of `dermis benchmark`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    twin: TwinArguments,
    /// Number of twins.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = count(1..=100_000u64))]
    twins: u64,
    /// Seed of the first twin; the following twins use the following seeds.
    #[arg(long, value_name = "S", default_value_t = 1001, value_parser = seed)]
    seed: u64,
    #[command(flatten)]
    method: MethodArguments,
    /// Use a tenth of the frames.
    #[arg(long)]
    quick: bool,
    /// Write a map of the smallest detectable force, averaged over the twins (SVG, PNG).
    #[arg(long, value_name = "FILE", value_parser = picture())]
    map: Option<PathBuf>,
    /// Write the share of resolved pairs of touches against their distance, over all twins, and its bound (SVG, PNG).
    #[arg(long, value_name = "FILE", value_parser = picture())]
    curve: Option<PathBuf>,
    /// Number of disconnected electrodes of each twin, drawn from its seed.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        hide_default_value = true,
        value_parser = count(0..=MAX_ELECTRODES)
    )]
    dead: usize,
    /// Score pins, balls, palms, edges and two fingers on skins with patches of 4 to 20 mm or none, foam of 1.5 to 4 mm, coats of
    /// 0 to 30 %, electrodes off by 0 to 1.5 mm (rms) and 40 to 90 dB, drawn from the seeds; the twin gives the rest.
    #[arg(long, conflicts_with_all = ["map", "curve", "dead", "noise"])]
    families: bool,
    /// Print JSON (SI units) instead of a table.
    #[arg(long)]
    json: bool,
}

/// Frames of each family on each skin, and with `--quick`.
const FAMILY_FRAMES: usize = 40;
const QUICK_FRAMES: usize = 10;

impl Arguments {
    /// Runs the benchmark on every twin.
    pub fn run(self) -> Outcome {
        let skin = skin::load(&self.design)?;
        let twin = self.twin.load()?;
        let method = self.method.prepare(&skin, &Differences::default())?;
        let seeds = self.seed..self.seed + self.twins;
        if self.families {
            return self.families(&skin, &method, &twin, seeds);
        }
        let size = BenchmarkOptions {
            dead_electrodes: self.dead,
            ..if self.quick { BenchmarkOptions::quick() } else { BenchmarkOptions::default() }
        };
        let each = metrics::benchmark_frames(&size, skin.pixels().len());
        let progress = Progress::new("benchmarking", each * self.twins as usize);
        let found = benchmark(&skin, &method, &twin, seeds, &size, |done| progress.steps(done as u64))?;
        drop(progress);
        if self.json {
            print_json(&found)?;
        } else {
            print(&self.text(&method, &found))?;
        }
        if let Some(path) = &self.map {
            save(&self.map(&skin, found.least_forces_n(skin.pixels().len(), &size))?, path)?;
        }
        match &self.curve {
            Some(path) => save(&self.curve(method.description(), &found), path),
            None => Ok(()),
        }
    }

    fn text(&self, method: &Method, found: &BenchmarkSummary) -> String {
        let advice = found.twins.iter().find_map(|twin| twin.grid.advice());
        format!(
            "{} `{}` of {} (seeds {} to {}), {}\n\n{}\n{}",
            counted(found.twins.len(), "twin"),
            found.twin,
            found.design,
            self.seed,
            self.seed + self.twins - 1,
            method.description(),
            metrics::table(&found.twins, found.bound.as_ref()).to_text(),
            advice.map(|advice| format!("\nnote: {advice}\n")).unwrap_or_default()
        )
    }

    /// Runs the benchmark of families on every skin.
    fn families(&self, skin: &Skin, method: &Method, twin: &TwinOptions, seeds: Range<u64>) -> Outcome {
        let count = if self.quick { QUICK_FRAMES } else { FAMILY_FRAMES };
        let progress = Progress::new("benchmarking", self.twins as usize * count * Family::ALL.len());
        let found = benchmark_families(skin, method, twin, seeds, count, |done| progress.steps(done as u64))?;
        drop(progress);
        if self.json {
            return print_json(&found);
        }
        let [families, each] = metrics::families_tables(&found.skins);
        print(&format!(
            "{} drawn for {} (seeds {} to {}), {} of each family on each skin, {}\n\n{}\n{}",
            counted(found.skins.len(), "skin"),
            found.design,
            self.seed,
            self.seed + self.twins - 1,
            counted(count, "frame"),
            method.description(),
            families.to_text(),
            each.to_text(),
        ))
    }

    /// The twins of the results.
    fn twins(&self) -> String {
        format!("{} `{}`", counted(self.twins as usize, "twin"), self.twin.name)
    }

    /// The fraction of resolved pairs of touches against their distance and that which the skin allows, with a line at
    /// 90 %.
    fn curve(&self, method: String, found: &BenchmarkSummary) -> Picture {
        let places = found.two_resolved();
        let bar = places.iter().map(|[distance_m, _]| [1e3 * distance_m, 90.0]).collect();
        let in_percent = |[distance_m, part]: [f64; 2]| [1e3 * distance_m, 100.0 * part];
        let mut curves = vec![(method, places.iter().copied().map(in_percent).collect()), ("90 %".into(), bar)];
        if let Some(bound) = &found.bound {
            let steps = bound.two_resolved.iter().map(|&(distance_m, part)| in_percent([distance_m, part]));
            curves.push(("bound".into(), steps.collect()));
        }
        Curves {
            title: "Two-point resolution",
            subtitle: &self.twins(),
            below: "distance (mm)",
            left: "resolved pairs (%)",
            logarithmic: false,
            shown: vec![0.0, 100.0],
            curves,
        }
        .draw()
    }

    /// The mean over the twins of the smallest detectable force at each pixel.
    fn map(&self, skin: &Skin, forces_n: Vec<f64>) -> Outcome<Picture> {
        let scale = Scale::sequential(forces_n.iter().copied());
        let key = Key { scale, label: "smallest force detected with probability 0.9 (N)".into() };
        let subtitle = format!("{}, one false contact an hour at 120 frames a second", self.twins());
        Ok(skin_map(skin, &forces_n, key, "Smallest detectable force", subtitle)?)
    }
}
