//! `dermis benchmark`: a method on digital twins.

use crate::console::{Progress, print, print_json};
use crate::failure::Outcome;
use crate::method::MethodArguments;
use crate::range::{count, seed};
use crate::skin;
use clap::Args;
use dermis::design::MAX_ELECTRODES;
use dermis::frame::{Differences, write_whole};
use dermis::method::Method;
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_plot::chart::Curves;
use dermis_plot::{Drawing, Key, Picture, Scale, View};
use dermis_sim::evaluate::{Benchmark, BenchmarkBound, BenchmarkOptions, BenchmarkResult, FamiliesResult};
use dermis_sim::experiment::{Family, Sizes};
use dermis_sim::twin::TwinOptions;
use dermis_study::metrics;
use serde::Serialize;
use std::path::PathBuf;

/// The arguments of `dermis benchmark`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Digital twin: the path of a file, or a shipped name (ideal, lab, lab-b, lab-c, harsh).
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    twin: String,
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
    /// Write a map of the smallest detectable force, averaged over the twins (SVG).
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Write the share of resolved pairs of touches against their distance, over all twins, and its bound (SVG).
    #[arg(long, value_name = "FILE")]
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
    #[arg(long, conflicts_with_all = ["map", "curve", "dead"])]
    families: bool,
    /// Print JSON (SI units) instead of a table.
    #[arg(long)]
    json: bool,
}

/// Frames of each family on each skin, and with `--quick`.
const FAMILY_FRAMES: usize = 40;
const QUICK_FRAMES: usize = 10;

/// The results of families as JSON.
#[derive(Serialize)]
struct FamiliesSummary<'a> {
    design: &'a str,
    method: &'a str,
    skins: &'a [FamiliesResult],
}

/// The results as JSON.
#[derive(Serialize)]
struct Summary<'a> {
    design: &'a str,
    twin: &'a str,
    method: &'a str,
    alpha: Option<f64>,
    /// What the skin allows any method; none for twins without noise.
    bound: Option<&'a BenchmarkBound>,
    twins: &'a [BenchmarkResult],
}

impl Arguments {
    /// Runs the benchmark on every twin.
    pub fn run(self) -> Outcome {
        let skin = skin::load(&self.design)?;
        let options = TwinOptions::load(&self.twin)?;
        let pixels = skin.pixels();
        let method = self.method.prepare(&skin, &Differences::default())?;
        let benchmark = Benchmark {
            design: skin.design(),
            mesh: skin.mesh(),
            pixels,
            options: &options,
            method: method.reconstruct().as_ref(),
            alpha: method.alpha(),
        };
        if self.families {
            return self.families(&benchmark, &skin, &method);
        }
        let size = self.size();
        let each = metrics::benchmark_frames(&size, pixels.len());
        let progress = Progress::new("benchmarking", each * self.twins as usize);
        let seeds = self.seed..self.seed + self.twins;
        let twins = seeds.map(|seed| benchmark.run(seed, &size, |done| progress.steps(done as u64)));
        let twins: Vec<BenchmarkResult> = twins.collect::<dermis_sim::Result<_>>()?;
        drop(progress);
        let waiting = Progress::waiting("computing the bounds");
        let bound = benchmark.bound(self.seed..self.seed + self.twins, &size)?;
        drop(waiting);
        if let Some(path) = &self.map {
            let picture = self.map(&skin, pixels, &size, &twins)?;
            write_whole(path, |out| out.write_all(picture.to_svg().as_bytes()))?;
        }
        if let Some(path) = &self.curve {
            let picture = self.curve(method.description(), &twins, bound.as_ref());
            write_whole(path, |out| out.write_all(picture.to_svg().as_bytes()))?;
        }
        if self.json {
            return print_json(&Summary {
                design: &skin.design().name,
                twin: &options.name,
                method: method.label(),
                alpha: method.alpha(),
                bound: bound.as_ref(),
                twins: &twins,
            });
        }
        let advice = twins.iter().find_map(|twin| twin.grid.advice());
        print(&format!(
            "{} `{}` of {} (seeds {} to {}), {}\n\n{}\n{}",
            counted(twins.len(), "twin"),
            options.name,
            skin.design().name,
            self.seed,
            self.seed + self.twins - 1,
            method.description(),
            metrics::table(&twins, bound.as_ref()).to_text(),
            advice.map(|advice| format!("\nnote: {advice}\n")).unwrap_or_default()
        ))
    }

    /// Runs the benchmark of families on every skin.
    fn families(&self, benchmark: &Benchmark<'_>, skin: &Skin, method: &Method) -> Outcome {
        let count = if self.quick { QUICK_FRAMES } else { FAMILY_FRAMES };
        let seeds = self.seed..self.seed + self.twins;
        let progress = Progress::new("benchmarking", self.twins as usize * count * Family::ALL.len());
        let skins = seeds.map(|seed| benchmark.families(seed, count, |done| progress.steps(done as u64)));
        let skins: Vec<FamiliesResult> = skins.collect::<dermis_sim::Result<_>>()?;
        drop(progress);
        if self.json {
            return print_json(&FamiliesSummary { design: &skin.design().name, method: method.label(), skins: &skins });
        }
        let [families, each] = metrics::families_tables(&skins);
        print(&format!(
            "{} drawn for {} (seeds {} to {}), {} of each family on each skin, {}\n\n{}\n{}",
            counted(skins.len(), "skin"),
            skin.design().name,
            self.seed,
            self.seed + self.twins - 1,
            counted(count, "frame"),
            method.description(),
            families.to_text(),
            each.to_text(),
        ))
    }

    fn size(&self) -> BenchmarkOptions {
        let dead_electrodes = self.dead;
        match self.quick {
            false => BenchmarkOptions { dead_electrodes, ..BenchmarkOptions::default() },
            true => {
                let whole = Sizes::default();
                // 7 has no common divisor with the image sizes of the shipped skins, so that all columns are used.
                let sizes = Sizes { grid_step: 7, random: 90, pairs: 20, fours: 50, ..whole };
                BenchmarkOptions { sizes, untouched: 2000, force_step: 7, places: 10, dead_electrodes }
            }
        }
    }

    /// The fraction of resolved pairs of touches against their distance and that which the skin allows, with a line at
    /// 90 %.
    fn curve(&self, method: String, twins: &[BenchmarkResult], bound: Option<&BenchmarkBound>) -> Picture {
        let places = resolved(twins);
        let bar = places.iter().map(|[distance_m, _]| [1e3 * distance_m, 90.0]).collect();
        let in_percent = |[distance_m, part]: [f64; 2]| [1e3 * distance_m, 100.0 * part];
        let mut curves = vec![(method, places.iter().copied().map(in_percent).collect()), ("90 %".into(), bar)];
        if let Some(bound) = bound {
            let steps = bound.two_resolved.iter().map(|&(distance_m, part)| in_percent([distance_m, part]));
            curves.push(("bound".into(), steps.collect()));
        }
        Curves {
            title: "Two-point resolution",
            subtitle: &format!("{} `{}`", counted(twins.len(), "twin"), self.twin),
            below: "distance (mm)",
            left: "resolved pairs (%)",
            logarithmic: false,
            shown: vec![0.0, 100.0],
            curves,
        }
        .draw()
    }

    /// The mean over the twins of the smallest detectable force at each pixel.
    fn map(
        &self,
        skin: &Skin,
        pixels: &dermis::image::PixelSpace,
        size: &BenchmarkOptions,
        twins: &[BenchmarkResult],
    ) -> Outcome<Picture> {
        let mut forces = vec![f64::NAN; pixels.len()];
        for (place, pixel) in (0..pixels.len()).step_by(size.force_step).enumerate() {
            let sum: f64 = twins.iter().map(|twin| twin.least_forces_n[place]).sum();
            forces[pixel] = sum / twins.len() as f64;
        }
        let drawing = Drawing::new(skin.design(), skin.mesh());
        let scale = Scale::sequential(forces.iter().copied());
        let mut scene = drawing.field(
            pixels,
            &forces,
            Key { scale, label: "smallest force detected with probability 0.9 (N)".into() },
        );
        scene.title = "Smallest detectable force".into();
        scene.subtitle = format!(
            "{} `{}`, one false contact an hour at 120 frames a second",
            counted(twins.len(), "twin"),
            self.twin
        );
        View::Unrolled.draw(&scene, skin.design()).map_err(|error| crate::failure::Failure::Ours(error.to_string()))
    }
}

/// The share of resolved pairs over all twins for each distance (m).
fn resolved(twins: &[BenchmarkResult]) -> Vec<[f64; 2]> {
    let steps = twins.first().map_or(&[][..], |twin| &twin.two_resolved);
    let part = |step: usize| twins.iter().map(|twin| twin.two_resolved[step].1).sum::<f64>() / twins.len() as f64;
    steps.iter().enumerate().map(|(step, (separation_m, _))| [*separation_m, part(step)]).collect()
}
