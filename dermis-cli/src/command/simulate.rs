//! `dermis simulate`: training datasets.

use crate::console::{Progress, print, print_json};
use crate::failure::{Failure, Outcome};
use crate::range::{count, number, seed};
use clap::{Args, ValueEnum};
use dermis::design::SkinDesign;
use dermis::text::counted;
use dermis_sim::dataset::{
    self, GaussianTouches, MAX_TOUCHES, Manifest, PatchTouches, Recipe, Record, Shard, SkinSpread, Skins, Touch,
};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::OnceLock;

/// More samples would not fit on any disk.
const MAX_SAMPLES: u64 = 1_000_000_000_000_000;

/// The arguments of `dermis simulate`.
#[derive(Debug, Args)]
#[command(
    after_help = "An interrupted run continues when it is started again with the same arguments. Several processes may \
    share a folder, each with its own --shard; then `dermis simulate --finish DIR` checks the files and writes the manifest."
)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name. With --finish or --verify: check that the dataset was made
    /// from this design.
    #[arg(required_unless_present_any = ["finish", "verify"])]
    design: Option<String>,
    /// Number of samples.
    #[arg(long, value_name = "N", required_unless_present_any = ["finish", "verify"], value_parser = count(1..=MAX_SAMPLES))]
    samples: Option<u64>,
    /// Seed; sample i depends on the seed and on i alone.
    #[arg(long, value_name = "S", required_unless_present_any = ["finish", "verify"], value_parser = seed)]
    seed: Option<u64>,
    /// Folder for the files.
    #[arg(short, long, value_name = "FOLDER", required_unless_present_any = ["finish", "verify"])]
    output: Option<PathBuf>,
    /// Recipe of the touches and skins (TOML), instead of the options below.
    #[arg(long, value_name = "FILE", conflicts_with_all = RECIPE)]
    recipe: Option<PathBuf>,
    /// Touch model.
    #[arg(long, value_enum, default_value_t = TouchName::Gaussian)]
    touch: TouchName,
    /// Largest number of touches of a sample.
    #[arg(long, value_name = "K", value_parser = count(1..=MAX_TOUCHES))]
    most_touches: Option<usize>,
    /// Smallest and largest width of a touch (standard deviation), m.
    #[arg(long, value_names = ["FROM", "TO"], num_args = 2, value_parser = number(1e-4..=100.0))]
    width_m: Option<Vec<f64>>,
    /// Smallest and largest amplitude of a touch: relative change of conductance at its centre.
    #[arg(long, value_names = ["FROM", "TO"], num_args = 2, value_parser = number(1e-9..=1e6))]
    amplitude: Option<Vec<f64>>,
    /// Smallest and largest force of a press on patches, N.
    #[arg(long, value_names = ["FROM", "TO"], num_args = 2, value_parser = number(1e-6..=1e4))]
    force_n: Option<Vec<f64>>,
    /// Smallest and largest radius of the pressing tip, m.
    #[arg(long, value_names = ["FROM", "TO"], num_args = 2, value_parser = number(1e-5..=1.0))]
    tip_radius_m: Option<Vec<f64>>,
    /// Skins of the samples.
    #[arg(long, value_enum, default_value_t = SkinsName::Uniform)]
    skins: SkinsName,
    /// Relative standard deviation of the coat's conductance, for random skins.
    #[arg(long, value_name = "SHARE", value_parser = number(0.0..=1.0))]
    coat_rms: Option<f64>,
    /// RMS displacement of the electrodes, for random skins, m.
    #[arg(long, value_name = "M", value_parser = number(0.0..=0.1))]
    electrode_displacement_m: Option<f64>,
    /// Relative standard deviation of the contact impedance, for random skins.
    #[arg(long, value_name = "SHARE", value_parser = number(0.0..=1.0))]
    contact_impedance_rms: Option<f64>,
    /// Generate only the files k with k mod N = I.
    #[arg(long, value_name = "I/N")]
    shard: Option<ShardChoice>,
    /// Number of threads [default: all of the machine]
    #[arg(long, value_name = "N", value_parser = count(1..=1024usize))]
    threads: Option<usize>,
    /// Check that all files of a folder are complete and write its manifest.
    #[arg(long, value_name = "FOLDER", conflicts_with_all = MAKING)]
    finish: Option<PathBuf>,
    /// Verify the checksums of a folder's files.
    #[arg(long, value_name = "FOLDER", conflicts_with_all = MAKING, conflicts_with = "finish")]
    verify: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Options of generating samples.
const MAKING: [&str; 13] = [
    "recipe",
    "samples",
    "seed",
    "output",
    "most_touches",
    "width_m",
    "amplitude",
    "force_n",
    "tip_radius_m",
    "coat_rms",
    "electrode_displacement_m",
    "contact_impedance_rms",
    "shard",
];

/// Options that a recipe replaces.
const RECIPE: [&str; 10] = [
    "touch",
    "most_touches",
    "width_m",
    "amplitude",
    "force_n",
    "tip_radius_m",
    "skins",
    "coat_rms",
    "electrode_displacement_m",
    "contact_impedance_rms",
];

/// The touch model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum TouchName {
    /// Gaussian changes of conductance.
    Gaussian,
    /// Presses of a tip on fabric patches under foam.
    Patch,
}

/// The skins of the samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SkinsName {
    /// The design itself.
    Uniform,
    /// A new random coat, contact impedances, electrode displacements and patches for every 16 samples.
    Random,
}

/// `I/N`.
#[derive(Debug, Clone, Copy)]
struct ShardChoice(Shard);

impl FromStr for ShardChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
        let (index, count) =
            numbers.ok_or_else(|| format!("`{text}` is not a shard: write 0/4 for the first of four"))?;
        Shard::new(index, count).map(ShardChoice).map_err(|error| error.to_string())
    }
}

impl Arguments {
    /// Generates samples, or finishes or verifies a dataset.
    pub fn run(self) -> Outcome {
        let mut builder = rayon::ThreadPoolBuilder::new();
        if let Some(threads) = self.threads {
            builder = builder.num_threads(threads);
        }
        let pool = builder.build().map_err(|error| Failure::given(format!("cannot start threads: {error}"), None))?;
        match (&self.finish, &self.verify) {
            (Some(folder), _) => pool.install(|| self.finish(folder)),
            (_, Some(folder)) => pool.install(|| self.verify(folder)),
            _ => pool.install(|| self.make()),
        }
    }

    fn make(&self) -> Outcome {
        // Clap requires these.
        let (Some(name), Some(samples), Some(seed), Some(folder)) =
            (&self.design, self.samples, self.seed, &self.output)
        else {
            return Err(Failure::Ours("an argument is missing".into()));
        };
        let design = SkinDesign::load(name)?;
        let recipe = match &self.recipe {
            Some(path) => Recipe::load(path, seed, samples)?,
            None => Recipe { seed, samples, touch: self.touch(&design)?, skins: self.skins(&design)? },
        };
        let shard = self.shard.map_or(Shard::WHOLE, |choice| choice.0);
        let progress = OnceLock::new();
        let made = dataset::simulate(name, &recipe, folder, shard, |count, missing| {
            progress.get_or_init(|| Progress::with_rate("samples", missing)).steps(count);
        })?;
        drop(progress);
        if self.json {
            return print_json(&json!(made));
        }
        print(&format!(
            "{0}: {1} samples in {2}, {3:.0} samples/s; {4} existed already\n\
             when all files are there: dermis simulate --finish {0}\n",
            folder.display(),
            made.report.made_samples,
            counted(made.report.made_files, "file"),
            made.samples_per_second,
            counted(made.report.found_files, "file"),
        ))
    }

    fn touch(&self, design: &SkinDesign) -> Outcome<Touch> {
        let pair = |given: &Option<Vec<f64>>, usual: [f64; 2]| given.as_ref().map_or(usual, |pair| [pair[0], pair[1]]);
        let of_others = |given: bool, options: &str, kind: &str| match given {
            true => Err(Failure::given(format!("{options} belong to --touch {kind}"), Some("leave them out"))),
            false => Ok(()),
        };
        match self.touch {
            TouchName::Gaussian => {
                let given = self.force_n.is_some() || self.tip_radius_m.is_some();
                of_others(given, "--force-n and --tip-radius-m", "patch")?;
                let usual = GaussianTouches::for_effect(design.sheet.touch);
                Ok(Touch::Gaussian(GaussianTouches {
                    most: self.most_touches.unwrap_or(usual.most),
                    width_m: pair(&self.width_m, usual.width_m),
                    amplitude: pair(&self.amplitude, usual.amplitude),
                }))
            }
            TouchName::Patch => {
                of_others(self.width_m.is_some() || self.amplitude.is_some(), "--width-m and --amplitude", "gaussian")?;
                let usual = PatchTouches::usual();
                Ok(Touch::Patch(PatchTouches {
                    most: self.most_touches.unwrap_or(usual.most),
                    force_n: pair(&self.force_n, usual.force_n),
                    tip_radius_m: pair(&self.tip_radius_m, usual.tip_radius_m),
                    patches: usual.patches,
                    together: None,
                }))
            }
        }
    }

    fn skins(&self, design: &SkinDesign) -> Outcome<Skins> {
        let given = [self.coat_rms, self.electrode_displacement_m, self.contact_impedance_rms];
        match self.skins {
            SkinsName::Uniform if given.iter().any(Option::is_some) => {
                let message = "options of random skins are given, but the skins are uniform";
                Err(Failure::given(message, Some("write --skins random")))
            }
            SkinsName::Uniform => Ok(Skins::Even),
            SkinsName::Random => {
                let mut spread = SkinSpread::for_design(design);
                let [coat, displacement, contact] = given;
                spread.coat.rms = coat.unwrap_or(spread.coat.rms);
                let electrodes = &mut spread.electrodes;
                electrodes.displacement_rms_m = displacement.unwrap_or(electrodes.displacement_rms_m);
                electrodes.contact_impedance_rms = contact.unwrap_or(electrodes.contact_impedance_rms);
                Ok(Skins::Random(spread))
            }
        }
    }

    fn finish(&self, folder: &Path) -> Outcome {
        self.check_design(folder)?;
        let progress = Progress::with_rate("files", Record::read(folder)?.file_count());
        let manifest = dataset::finish(folder, || progress.step())?;
        drop(progress);
        if self.json { print_json(&finished(folder, &manifest)) } else { print(&summary(folder, &manifest)) }
    }

    fn verify(&self, folder: &Path) -> Outcome {
        self.check_design(folder)?;
        let progress = Progress::with_rate("files", Record::read(folder)?.file_count());
        let checked = dataset::verify(folder, || progress.step())?;
        drop(progress);
        if !checked.problems.is_empty() {
            return Err(Failure::given(checked.problems.join("\n"), None));
        }
        if self.json {
            return print_json(&json!({
                "folder": folder,
                "good_files": checked.good_files,
                "file_count": checked.file_count,
                "finished": checked.finished,
            }));
        }
        let state = if checked.finished { "finished" } else { "without a manifest yet" };
        print(&format!(
            "{}: {} of {}, all intact; {state}\n",
            folder.display(),
            checked.good_files,
            counted(checked.file_count, "file")
        ))
    }

    /// Rejects a design that differs from that of the dataset.
    fn check_design(&self, folder: &Path) -> Outcome {
        match &self.design {
            Some(name) => {
                let text = SkinDesign::with_files(&SkinDesign::text_of(name)?, name)?;
                Ok(Record::read(folder)?.check_design(folder, &text)?)
            }
            None => Ok(()),
        }
    }
}

fn finished(folder: &Path, manifest: &Manifest) -> serde_json::Value {
    json!({
        "folder": folder,
        "samples": manifest.statistics.samples,
        "files": manifest.files.len(),
        "identity": manifest.identity,
        "image_mean": manifest.statistics.image_mean,
        "image_sd": manifest.statistics.image_sd,
    })
}

fn summary(folder: &Path, manifest: &Manifest) -> String {
    format!(
        "{}: {} samples in {}, all intact; images {:.4} +- {:.4}; wrote manifest.json\n",
        folder.display(),
        manifest.statistics.samples,
        counted(manifest.files.len(), "file"),
        manifest.statistics.image_mean,
        manifest.statistics.image_sd,
    )
}
