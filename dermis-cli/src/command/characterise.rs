//! `dermis characterise`: position errors and force per strength of a method, measured on simulated touches.

use crate::console::{Progress, print, print_json};
use crate::failure::Outcome;
use crate::method::MethodArguments;
use crate::range::{count, number, seed};
use crate::skin;
use clap::Args;
use dermis::design::SkinDesign;
use dermis::detect::Forces;
use dermis::frame::{Differences, write_whole};
use dermis::text::counted;
use dermis_plot::report::Table;
use dermis_sim::dataset::{Recipe, SkinSpread, Skins, Touch};
use dermis_sim::evaluate::{Characteristics, characterise};
use serde_json::json;
use std::path::PathBuf;

/// The arguments of `dermis characterise`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    method: MethodArguments,
    /// Recipe of the touches and skins (TOML); may be given more than once. Default: presses on patches (Gaussian touches
    /// on a body from a mesh file), with a careful workshop's tolerances.
    #[arg(long, value_name = "FILE")]
    recipe: Vec<PathBuf>,
    /// Samples of each recipe.
    #[arg(long, value_name = "N", default_value_t = 4000, value_parser = count(1..=1_000_000_000u64))]
    samples: u64,
    /// Seed of the samples; use one that the method was not trained with.
    #[arg(long, value_name = "S", default_value_t = 3001, value_parser = seed)]
    seed: u64,
    /// Smallest peak of a contact as a share of the image's highest peak, instead of the method's own.
    #[arg(long, value_name = "SHARE", value_parser = number(0.0..=0.999))]
    peak_fraction: Option<f64>,
    /// Save the calibration and the peak fraction to the card of the network in the folder of --method.
    #[arg(long)]
    keep: bool,
    /// Write the matched contacts with their errors (CSV).
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print JSON (SI units) instead of a table.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Simulates touches, detects contacts and measures their errors.
    pub fn run(self) -> Outcome {
        if self.keep {
            self.method.check_is_folder("--keep")?;
        }
        let skin = skin::load(&self.design)?;
        let method = self.method.prepare(&skin, &Differences::default())?;
        let mut detection = method.reconstruct().detection();
        if let Some(fraction) = self.peak_fraction {
            detection.peak_fraction = fraction;
        }
        let recipes = self.recipes(skin.design())?;
        let progress = Progress::new("simulating touches", self.samples as usize * recipes.len());
        let found = characterise(&skin, &method, detection, &recipes, || progress.step())?;
        drop(progress);
        if let Some(path) = &self.output {
            write_whole(path, |out| found.write_csv(out))?;
        }
        if self.keep {
            self.method.keep_detection(&skin, found.detection.clone())?;
        }
        if self.json {
            return print_json(&json!(found));
        }
        print(&format!("{}\n\n{}\n", found.method, summary(&found).to_text()))
    }

    fn recipes(&self, design: &SkinDesign) -> Outcome<Vec<Recipe>> {
        if self.recipe.is_empty() {
            let (touch, skins) = (Touch::for_design(design), Skins::Random(SkinSpread::for_design(design)));
            return Ok(vec![Recipe { seed: self.seed, samples: self.samples, touch, skins }]);
        }
        let load = |path: &PathBuf| Ok(Recipe::load(path, self.seed, self.samples)?);
        self.recipe.iter().map(load).collect()
    }
}

fn summary(found: &Characteristics) -> Table {
    let after = |counts| format!("{:.1} %", 100.0 * found.covered(counts));
    let mut table = Table::new(&["figure", "value"]);
    table.pair("touches", found.touches);
    table.pair("detected", format!("{}, and {}", found.found, counted(found.false_positives, "false positive")));
    table.pair("95 % region contains the truth, before calibration", format!("{:.1} %", 100.0 * found.covered_before));
    table.pair("after calibration, one touch in the frame", after(|contact| contact.touches == 1));
    table.pair(
        "after calibration, several touches, all detected",
        after(|contact| contact.touches > 1 && !contact.is_shared),
    );
    table.pair("after calibration, several touches, some missed", after(|contact| contact.is_shared));
    if let Some(spread) = &found.detection.spread {
        table.pair("typical standard deviation", format!("{:.2} mm", 1e3 * spread.typical_m));
    }
    if let Some(Forces { newtons_per_strength, relative_sd, .. }) = found.detection.forces {
        table.pair("force over strength", format!("{newtons_per_strength:.4e} N"));
        table.pair("standard deviation of a force", format!("{:.0} %", 100.0 * relative_sd));
    }
    table.pair("systematic error over contact radius", format!("{:.3}", found.blur_share));
    table.pair("unexplained variance of the images", format!("{:.4}", found.unexplained));
    table.pair("variance of the targets", format!("{:.3e}", found.target_variance));
    table
}
