//! `dermis assess`: a method on twins that it has never seen.

use crate::console::{Progress, print, print_json};
use crate::failure::Outcome;
use crate::frames::Differences;
use crate::method::MethodArguments;
use crate::picture::colour::Scale;
use crate::picture::{Drawing, Key, Picture, View};
use crate::report::Table;
use crate::skin::{Per, Skin};
use clap::Args;
use dermis::evaluate::{AssessOptions, Assessment, Assessor, Summary};
use dermis::experiment::Sizes;
use dermis::frame::write_whole;
use dermis::twin::TwinOptions;
use serde::Serialize;
use std::path::PathBuf;

/// The arguments of `dermis assess`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The design: a path, or a shipped name.
    design: String,
    /// The twin: the path of its file, or a shipped name (ideal, lab, harsh).
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    twin: String,
    /// How many twins are drawn and assessed.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..))]
    twins: u64,
    /// Seed of the first twin; the others have those that follow.
    #[arg(long, value_name = "S", default_value_t = 1001)]
    seed: u64,
    #[command(flatten)]
    method: MethodArguments,
    /// A tenth of the frames, for a first look.
    #[arg(long)]
    quick: bool,
    /// Write a map of the smallest force found, on the mean of the twins, as SVG.
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Print JSON (SI units) in place of a table.
    #[arg(long)]
    json: bool,
}

/// What machines get.
#[derive(Serialize)]
struct Told<'a> {
    design: &'a str,
    twin: &'a str,
    method: String,
    alpha: Option<f64>,
    twins: &'a [Assessment],
}

impl Arguments {
    /// Assesses the method on every twin.
    pub fn run(self) -> Outcome {
        let skin = Skin::load(&self.design)?;
        let options = TwinOptions::load(&self.twin)?;
        let pixels = skin.pixels(Per::Pixel)?;
        let method = self.method.prepare(&skin, Per::Pixel, &Differences::default())?;
        let assessor = Assessor {
            design: &skin.design,
            mesh: skin.forward.mesh(),
            pixels: &pixels,
            options: &options,
            method: method.reconstruct.as_ref(),
            alpha: method.alpha,
        };
        let size = self.size();
        let each = steps(&size, pixels.len());
        let progress = Progress::new("pressing twins", each * self.twins as usize);
        let seeds = self.seed..self.seed + self.twins;
        let twins = seeds.map(|seed| assessor.assess(seed, &size, |done| progress.steps(done as u64)));
        let twins: Vec<Assessment> = twins.collect::<dermis::Result<_>>()?;
        drop(progress);
        if let Some(path) = &self.map {
            let picture = self.map(&skin, &pixels, &size, &twins)?;
            write_whole(path, |out| out.write_all(picture.to_svg().as_bytes()))?;
        }
        let name = method.reconstruct.name();
        if self.json {
            let alpha = method.alpha;
            return print_json(&Told {
                design: &skin.design.name,
                twin: &options.name,
                method: name,
                alpha,
                twins: &twins,
            });
        }
        let alpha = method.alpha.map(|alpha| format!(", alpha {alpha:.4}")).unwrap_or_default();
        print(&format!(
            "{} `{}` of {} (seeds {} to {}), {name}{alpha}\n\n{}\n",
            counted(twins.len()),
            options.name,
            skin.design.name,
            self.seed,
            self.seed + self.twins - 1,
            table(&twins).to_text()
        ))
    }

    fn size(&self) -> AssessOptions {
        match self.quick {
            false => AssessOptions::default(),
            true => {
                let whole = Sizes::default();
                // Seven has no divisor in common with the pictures of shipped skins, so that all columns have their turn.
                let sizes = Sizes { grid_step: 7, random: 90, pairs: 20, fours: 50, ..whole };
                AssessOptions { sizes, untouched: 2000, force_step: 7 }
            }
        }
    }

    /// Where the smallest force is sought at every pixel, its mean over the twins.
    fn map(
        &self,
        skin: &Skin,
        pixels: &dermis::image::PixelSpace,
        size: &AssessOptions,
        twins: &[Assessment],
    ) -> Outcome<Picture> {
        let mut forces = vec![f64::NAN; pixels.len()];
        for (place, pixel) in (0..pixels.len()).step_by(size.force_step).enumerate() {
            let sum: f64 = twins.iter().map(|twin| twin.least_forces_n[place]).sum();
            forces[pixel] = sum / twins.len() as f64;
        }
        let drawing = Drawing::new(&skin.design, skin.forward.mesh());
        let scale = Scale::sequential(forces.iter().copied());
        let mut scene =
            drawing.field(pixels, &forces, Key { scale, label: "smallest force found 90 % of the time, N".into() });
        scene.title = "Smallest force".into();
        scene.subtitle =
            format!("{} `{}`, one false contact an hour at 120 frames a second", counted(twins.len()), self.twin);
        View::Unrolled.draw(&scene, &skin.design).map_err(|error| crate::failure::Failure::Ours(error.to_string()))
    }
}

fn counted(twins: usize) -> String {
    if twins == 1 { "1 twin".into() } else { format!("{twins} twins") }
}

/// Frames of one assessment.
fn steps(size: &AssessOptions, pixels: usize) -> usize {
    let Sizes { grid_step, random, separations_m, pairs, fours } = &size.sizes;
    pixels.div_ceil(*grid_step)
        + random
        + separations_m.len() * pairs
        + fours
        + size.untouched
        + dermis::experiment::UNTOUCHED_FRAMES as usize
        + pixels.div_ceil(size.force_step)
}

/// A figure of each twin: a row with its mean and its worst.
struct Figure<'a> {
    name: &'a str,
    of: &'a dyn Fn(&Assessment) -> f64,
    /// Whether a larger value is worse.
    large_is_worse: bool,
    factor: f64,
    decimals: usize,
}

/// Mean over the twins and the worst of them.
fn table(twins: &[Assessment]) -> Table {
    let mut table = Table::new(&["figure", "mean of twins", "worst twin"]);
    let mut row = |figure: Figure<'_>| {
        let values: Vec<f64> = twins.iter().map(|twin| figure.factor * (figure.of)(twin)).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let start = if figure.large_is_worse { f64::NEG_INFINITY } else { f64::INFINITY };
        let worst = values.iter().copied().fold(start, |worst, value| match figure.large_is_worse {
            _ if value.is_nan() || worst.is_nan() => f64::NAN,
            true => worst.max(value),
            false => worst.min(value),
        });
        let show = |value: f64| if value.is_nan() { "none".into() } else { format!("{value:.*}", figure.decimals) };
        table.row([figure.name.to_string(), show(mean), show(worst)]);
    };
    let mut more = |name: &str, factor: f64, decimals: usize, of: &dyn Fn(&Assessment) -> f64| {
        row(Figure { name, of, large_is_worse: true, factor, decimals });
    };
    for (set, score) in
        [("grid", (|twin| &twin.grid) as fn(&Assessment) -> &dermis::evaluate::Score), ("random", |twin| &twin.random)]
    {
        for (what, part) in parts() {
            more(&format!("{set}: localisation, {what}, mm"), 1e3, 2, &|twin| part(&score(twin).localisation_m));
        }
        more(&format!("{set}: whole image (Eq. 11), mean, mm"), 1e3, 1, &|twin| score(twin).eq11_m.mean);
        more(&format!("{set}: misses"), 1.0, 1, &|twin| score(twin).misses as f64);
        more(&format!("{set}: ghosts"), 1.0, 1, &|twin| score(twin).ghosts as f64);
        more(&format!("{set}: sensitivity spread"), 1.0, 2, &|twin| score(twin).sensitivity_spread);
    }
    more("rim and seam: localisation, mean, mm", 1e3, 2, &|twin| twin.rim_and_seam_m.mean);
    more("two touches: 90 % resolved from, mm", 1e3, 0, &|twin| twin.resolved_from_m());
    for separation_mm in [20, 40, 60, 80] {
        let resolved = |twin: &Assessment| 100.0 * twin.resolved_at(f64::from(separation_mm) * 1e-3);
        row(Figure {
            name: &format!("two touches: resolved at {separation_mm} mm, %"),
            of: &resolved,
            large_is_worse: false,
            factor: 1.0,
            decimals: 1,
        });
    }
    let mut more = |name: &str, factor: f64, decimals: usize, of: &dyn Fn(&Assessment) -> f64| {
        row(Figure { name, of, large_is_worse: true, factor, decimals });
    };
    more("four touches: localisation, mean, mm", 1e3, 2, &|twin| twin.four.localisation_m.mean);
    more("four touches: misses, % of touches", 100.0, 1, &|twin| {
        twin.four.misses as f64 / (4 * twin.four.frames) as f64
    });
    more("four touches: ghosts, % of touches", 100.0, 1, &|twin| {
        twin.four.ghosts as f64 / (4 * twin.four.frames) as f64
    });
    more("threshold, sd of noise", 1.0, 2, &|twin| twin.noise_factor);
    more("smallest force found, median, N", 1.0, 3, &|twin| twin.least_force_n()[0]);
    more("smallest force found, 95th percentile, N", 1.0, 3, &|twin| twin.least_force_n()[1]);
    row(Figure {
        name: "four touches: all found, nothing else, %",
        of: &|twin| twin.four.all_found,
        large_is_worse: false,
        factor: 100.0,
        decimals: 1,
    });
    table
}

type Part = fn(&Summary) -> f64;

fn parts() -> [(&'static str, Part); 4] {
    [("mean", |all| all.mean), ("sd", |all| all.sd), ("median", |all| all.median), ("95th percentile", |all| all.p95)]
}
