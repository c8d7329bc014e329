//! Training of the networks: commands of this program in sequence, each of which can resume.

use crate::{Error, Result};
use dermis::frame::write_whole;
use dermis_sim::dataset::Recipe;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Epochs of the paper's network and of the best network.
const PAPER_EPOCHS: u64 = 28;
const BEST_EPOCHS: u64 = 40;
/// Samples per epoch of the best network, drawn from all presses.
const BEST_EPOCH_SAMPLES: u64 = 147_456;

/// A dataset for training or testing.
struct Data {
    name: &'static str,
    recipe: &'static str,
    recipe_text: &'static str,
    samples: u64,
    seed: u64,
}

macro_rules! data {
    ($name:literal, $samples:literal x $recipe:literal, seed $seed:literal) => {
        Data {
            name: $name,
            recipe: $recipe,
            recipe_text: include_str!(concat!("../../recipes/", $recipe, ".toml")),
            samples: $samples,
            seed: $seed,
        }
    };
}

/// Datasets for training and testing the paper's network: as many samples of Gaussian touches as in the paper.
const GAUSSIANS: [Data; 2] =
    [data!("training", 1_100_000 x "gaussian", seed 21), data!("test", 40_000 x "gaussian", seed 22)];

/// The distribution of Gaussian touches for training the paper's network.
pub(super) fn gaussian_recipe(seed: u64, samples: u64) -> Result<Recipe> {
    let text = GAUSSIANS[0].recipe_text;
    Ok(Recipe::parse(text, Path::new("gaussian.toml"), seed, samples)?)
}

/// Datasets for training the best network: presses on patches with other pitches, foams and contacts than those of any
/// reported twin.
const PRESSES: [Data; 6] = [
    data!("fine-soft", 24_576 x "fine-soft", seed 11),
    data!("fine-firm", 24_576 x "fine-firm", seed 12),
    data!("coarse-soft", 24_576 x "coarse-soft", seed 13),
    data!("coarse-firm", 24_576 x "coarse-firm", seed 14),
    data!("fine-firm-together", 24_576 x "fine-firm-together", seed 31),
    data!("coarse-firm-together", 24_576 x "coarse-firm-together", seed 32),
];

/// A command of this program and its output.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Its arguments.
    pub arguments: Vec<String>,
    /// The file that exists when it is done.
    done: PathBuf,
    /// The folder of the network that it trains, if any.
    pub model: Option<PathBuf>,
}

impl Step {
    /// The command line.
    pub fn summary(&self) -> String {
        format!("dermis {}", self.arguments.join(" "))
    }

    /// Runs it, unless its output exists already.
    pub(crate) fn carry_out(&self, program: &Path) -> Result<()> {
        if self.done.is_file() {
            return Ok(());
        }
        // Its messages appear between the stages; standard output is reserved for the final result.
        let status = Command::new(program).args(&self.arguments).stdout(Stdio::null()).status();
        let status = status.map_err(|error| Error::Internal(format!("`{}` cannot be run: {error}", self.summary())))?;
        match status.code() {
            Some(0) => Ok(()),
            Some(2) => Err(Error::CommandRefused(self.summary())),
            _ => Err(Error::Internal(format!("`{}` ended with {status}", self.summary()))),
        }
    }
}

/// All steps to train both networks from scratch, with a folder for their output.
pub(super) fn steps(design: &str, twin: &str, work: &Path) -> Result<Vec<Step>> {
    let mut all = Vec::new();
    for data in GAUSSIANS.iter().chain(&PRESSES) {
        all.extend(dataset(data, design, work)?);
    }
    let train = |network: &str, more: &[&str], data: &[&str]| {
        let model = work.join(format!("network-{network}"));
        let line = ["train", design, "--network", network, "--noise", twin, "-o", &model.display().to_string()];
        let mut arguments: Vec<String> = line.iter().chain(more).map(|word| word.to_string()).collect();
        let folder = |name: &str| work.join(name).display().to_string();
        arguments.extend(data.iter().flat_map(|name| ["--data".to_string(), folder(name)]));
        Step { arguments, done: model.join("card.json"), model: Some(model) }
    };
    let test = work.join("test").display().to_string();
    let epochs = PAPER_EPOCHS.to_string();
    let more = ["--half", "--epochs", &epochs, "--test", &test];
    all.push(train("paper", &more, &["training"]));
    let (epochs, samples) = (BEST_EPOCHS.to_string(), BEST_EPOCH_SAMPLES.to_string());
    let more = ["--half", "--epochs", &epochs, "--epoch-samples", &samples];
    let data = PRESSES.map(|data| data.name);
    all.push(train("spots", &more, &data));
    Ok(all)
}

/// The steps that generate and finish a dataset; its recipe is written to the same folder.
fn dataset(data: &Data, design: &str, work: &Path) -> Result<[Step; 2]> {
    let recipe = work.join(format!("{}.toml", data.recipe));
    write_whole(&recipe, |out| out.write_all(data.recipe_text.as_bytes()))?;
    let folder = work.join(data.name);
    let done = folder.join("manifest.json");
    let [recipe, folder] = [&recipe, &folder].map(|path| path.display().to_string());
    let (samples, seed) = (data.samples.to_string(), data.seed.to_string());
    let make = ["simulate", design, "--recipe", &recipe, "--samples", &samples, "--seed", &seed, "-o", &folder];
    let finish = ["simulate", "--finish", &folder];
    let step = |line: &[&str]| Step {
        arguments: line.iter().map(|word| word.to_string()).collect(),
        done: done.clone(),
        model: None,
    };
    Ok([step(&make), step(&finish)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_whose_result_is_there_is_not_carried_out() {
        let work = tempfile::tempdir().unwrap();
        let done = work.path().join("manifest.json");
        let step =
            |done: &Path| Step { arguments: vec!["no-such-command".into()], done: done.to_path_buf(), model: None };
        std::fs::write(&done, "{}").unwrap();
        assert!(step(&done).carry_out(Path::new("dermis")).is_ok());
    }
}
