//! `dermis characterise`: position errors and force per strength of a method, measured on simulated touches.

use crate::console::{Progress, print, print_json};
use crate::failure::{Failure, Outcome};
use crate::method::MethodArguments;
use crate::range::{count, number, seed};
use crate::skin;
use clap::Args;
use dermis::contact::REGION_95_SD;
use dermis::detect::{DetectOptions, Forces, Misplacement, PositionSpread, blur_share};
use dermis::frame::{Differences, write_whole};
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_plot::report::Table;
use dermis_sim::dataset::{Generator, PatchTouches, Recipe, SkinSpread, Skins, Touch};
use dermis_sim::evaluate::CalibrationRun;
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;

/// The arguments of `dermis characterise`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    method: MethodArguments,
    /// Recipe of the touches and skins (TOML); may be given more than once. Default: presses on patches, with a careful
    /// workshop's tolerances.
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
        let run = self.calibration_run(&skin, method.reconstruct().as_ref(), &detection)?;
        let few = || {
            let message = format!(
                "only {} matched with a touch: too few for a calibration",
                counted(run.misplacements.len(), "contact")
            );
            Failure::given(message, Some("ask for more --samples"))
        };
        let blur = blur_share(&run.misplacements).ok_or_else(few)?;
        let before = covered(&run.misplacements, |contact| contact.stated_m);
        detection.spread = Some(PositionSpread::fit(&run.misplacements).ok_or_else(few)?);
        // A method that is calibrated on touches without a force keeps its force calibration.
        let single = run.misplacements.iter().filter(|contact| !contact.is_shared);
        let presses = single.map(|contact| (contact.force_n, contact.newtons_per_strength));
        detection.forces = Forces::fit(presses).or(detection.forces);
        if let Some(path) = &self.output {
            write_whole(path, |out| write(out, &run.misplacements))?;
        }
        if self.keep {
            self.method.keep_detection(&skin, detection.clone())?;
        }
        if self.json {
            return print_json(&json!({
                "method": method.description(),
                "alpha": method.alpha(),
                "touches": run.touches,
                "found": run.misplacements.len(),
                "false_positives": run.false_positives,
                "unexplained": run.images.unexplained(),
                "gain": run.images.gain(),
                "target_variance": run.images.target_variance(),
                "covered_before": before,
                "blur_share": blur,
                "detection": detection,
            }));
        }
        print(&format!("{}\n\n{}\n", method.description(), summary(&run, &detection, before, blur).to_text()))
    }

    fn calibration_run(
        &self,
        skin: &Skin,
        method: &dyn dermis::reconstruct::Reconstruct,
        detection: &DetectOptions,
    ) -> Outcome<CalibrationRun> {
        let recipes = self.recipes()?;
        let progress = Progress::new("simulating touches", self.samples as usize * recipes.len());
        let one = |recipe: &Recipe| {
            let generator = Generator::new(skin.design(), skin.forward(), recipe)?;
            Ok(CalibrationRun::of(method, detection, &generator, 0..self.samples, || progress.step())?)
        };
        recipes
            .iter()
            .map(one)
            .try_fold(CalibrationRun::default(), |sum, run: Outcome<CalibrationRun>| Ok(sum.with(run?)))
    }

    fn recipes(&self) -> Outcome<Vec<Recipe>> {
        if self.recipe.is_empty() {
            let (touch, skins) = (Touch::Patch(PatchTouches::usual()), Skins::Random(SkinSpread::usual()));
            return Ok(vec![Recipe { seed: self.seed, samples: self.samples, touch, skins }]);
        }
        let load = |path: &PathBuf| Ok(Recipe::load(path, self.seed, self.samples)?);
        self.recipe.iter().map(load).collect()
    }
}

/// The share of true positions inside the 95 % regions of given standard deviations.
fn covered(contacts: &[Misplacement], sd_m: impl Fn(&Misplacement) -> f64) -> f64 {
    let inside = contacts.iter().filter(|contact| contact.error_m <= REGION_95_SD * sd_m(contact)).count();
    inside as f64 / contacts.len() as f64
}

fn summary(run: &CalibrationRun, detection: &DetectOptions, before: f64, blur: f64) -> Table {
    let found = run.misplacements.len();
    let spread = detection.spread.as_ref().expect("it was measured");
    let after = |counts: fn(&Misplacement) -> bool| {
        let part: Vec<Misplacement> = run.misplacements.iter().copied().filter(counts).collect();
        format!("{:.1} %", 100.0 * covered(&part, |contact| spread.sd_m(&contact.circumstances)))
    };
    let mut table = Table::new(&["figure", "value"]);
    table.pair("touches", run.touches);
    table.pair("detected", format!("{found}, and {}", counted(run.false_positives, "false positive")));
    table.pair("95 % region contains the truth, before calibration", format!("{:.1} %", 100.0 * before));
    table.pair("after calibration, one touch in the frame", after(|contact| contact.touches == 1));
    table.pair(
        "after calibration, several touches, all detected",
        after(|contact| contact.touches > 1 && !contact.is_shared),
    );
    table.pair("after calibration, several touches, some missed", after(|contact| contact.is_shared));
    table.pair("typical standard deviation", format!("{:.2} mm", 1e3 * spread.typical_m));
    if let Some(Forces { newtons_per_strength, relative_sd, .. }) = detection.forces {
        table.pair("force over strength", format!("{newtons_per_strength:.4e} N"));
        table.pair("standard deviation of a force", format!("{:.0} %", 100.0 * relative_sd));
    }
    table.pair("systematic error over contact radius", format!("{blur:.3}"));
    table.pair("unexplained variance of the images", format!("{:.4}", run.images.unexplained()));
    table.pair("variance of the targets", format!("{:.3e}", run.images.target_variance()));
    table
}

fn write(out: &mut dyn Write, contacts: &[Misplacement]) -> std::io::Result<()> {
    writeln!(out, "touches,is_shared,signal,noise_m,radius_m,next_m,stated_m,error_m,newtons_per_strength")?;
    for Misplacement { circumstances: c, touches, is_shared, stated_m, error_m, newtons_per_strength, .. } in contacts {
        let next = if c.next_m.is_finite() { format!("{:?}", c.next_m) } else { String::new() };
        write!(out, "{touches},{},{:?},{:?},{:?},", u8::from(*is_shared), c.signal, c.noise_m, c.radius_m)?;
        writeln!(out, "{next},{stated_m:?},{error_m:?},{newtons_per_strength:?}")?;
    }
    Ok(())
}
