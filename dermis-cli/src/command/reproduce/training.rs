//! The networks from nothing: commands of this program, one after the other, each of which goes on where it was.

use crate::failure::{Failure, Outcome};
use dermis::frame::write_whole;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Samples of Gaussian touches that the paper's network trains on and is tested by, as many as the paper's.
const TRAINING_SAMPLES: u64 = 1_100_000;
const TEST_SAMPLES: u64 = 40_000;
/// Their seeds.
const SEEDS: [u64; 2] = [21, 22];
/// Touches as strong and as wide as presses of 0.1 to 5 N are, on skins that all differ.
const GAUSSIAN: [&str; 8] = ["--skins", "random", "--amplitude", "0.04", "0.6", "--width-m", "0.005", "0.012"];

/// Epochs of the paper's network, at most, and of ours.
const PAPER_EPOCHS: u64 = 16;
const BEST_EPOCHS: u64 = 60;
/// Samples of an epoch of ours, drawn from all presses.
const BEST_EPOCH_SAMPLES: u64 = 147_456;

/// Samples a second on two cores: of Gaussian touches on random skins, and that a network trains on.
const GAUSSIAN_RATE: f64 = 2_800.0;
const PAPER_RATE: f64 = 13_000.0;
const BEST_RATE: f64 = 5_000.0;

/// Presses on patches that a dataset is made of.
struct Presses {
    name: &'static str,
    recipe: &'static str,
    samples: u64,
    seed: u64,
    /// Samples a second that are made on two cores.
    rate: f64,
}

macro_rules! presses {
    ($name:literal, $samples:literal, $seed:literal, $rate:literal) => {
        Presses {
            name: $name,
            recipe: include_str!(concat!("../../../../data/recipes/", $name, ".toml")),
            samples: $samples,
            seed: $seed,
            rate: $rate,
        }
    };
}

/// Patches of other pitches, foams and contacts than any twin that is reported has.
const PRESSES: [Presses; 6] = [
    presses!("fine-soft", 24_576, 11, 80.0),
    presses!("fine-firm", 24_576, 12, 160.0),
    presses!("coarse-soft", 24_576, 13, 100.0),
    presses!("coarse-firm", 24_576, 14, 250.0),
    presses!("fine-firm-together", 24_576, 31, 160.0),
    presses!("coarse-firm-together", 24_576, 32, 250.0),
];

/// A command of this program and what it leaves.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Its arguments.
    pub arguments: Vec<String>,
    /// The file that is there when it is done.
    done: PathBuf,
    /// The folder of the network that it trains, where it trains one.
    pub model: Option<PathBuf>,
    /// How long it is expected to take on two cores, s.
    pub estimate_s: f64,
}

impl Step {
    /// The command, for people.
    pub fn told(&self) -> String {
        format!("dermis {}", self.arguments.join(" "))
    }

    /// Carries it out, or does nothing where what it leaves is there.
    pub fn carry_out(&self) -> Outcome {
        if self.done.is_file() {
            return Ok(());
        }
        let program =
            std::env::current_exe().map_err(|error| Failure::Ours(format!("this program is nowhere: {error}")))?;
        // What it tells people stands among the stages; standard output is for the result of all.
        let status = Command::new(program).args(&self.arguments).stdout(Stdio::null()).status();
        let status = status.map_err(|error| Failure::Ours(format!("`{}` cannot be run: {error}", self.told())))?;
        match status.code() {
            Some(0) => Ok(()),
            Some(2) => Err(Failure::given(
                format!("`{}` was refused, for the reason above", self.told()),
                Some("mend that, and run again: what is done is kept"),
            )),
            _ => Err(Failure::Ours(format!("`{}` ended with {status}", self.told()))),
        }
    }
}

/// All steps from nothing to both networks, in a folder for what they leave.
pub fn steps(design: &str, twin: &str, work: &Path) -> Outcome<Vec<Step>> {
    let simulate = |name: &str, samples: u64, seed: u64, more: &[&str], rate: f64| {
        let folder = work.join(name);
        let (samples, seed) = (samples.to_string(), seed.to_string());
        let folder_text = folder.display().to_string();
        let line = ["simulate", design, "--samples", &samples, "--seed", &seed, "-o", &folder_text];
        Step {
            arguments: line.iter().chain(more).map(|word| word.to_string()).collect(),
            done: folder.join("manifest.json"),
            model: None,
            estimate_s: samples.parse::<f64>().unwrap_or(0.0) / rate,
        }
    };
    let finish = |name: &str| {
        let folder = work.join(name);
        let line = ["simulate", "--finish", &folder.display().to_string()];
        Step {
            arguments: line.map(String::from).to_vec(),
            done: folder.join("manifest.json"),
            model: None,
            estimate_s: 2.0,
        }
    };
    let mut all = vec![
        simulate("training", TRAINING_SAMPLES, SEEDS[0], &GAUSSIAN, GAUSSIAN_RATE),
        finish("training"),
        simulate("test", TEST_SAMPLES, SEEDS[1], &GAUSSIAN, GAUSSIAN_RATE),
        finish("test"),
    ];
    for presses in &PRESSES {
        let recipe = work.join(format!("{}.toml", presses.name));
        write_whole(&recipe, |out| out.write_all(presses.recipe.as_bytes()))?;
        let recipe = recipe.display().to_string();
        all.push(simulate(presses.name, presses.samples, presses.seed, &["--recipe", &recipe], presses.rate));
        all.push(finish(presses.name));
    }
    let train = |network: &str, more: &[&str], data: &[&str], samples: u64, rate: f64| {
        let model = work.join(format!("network-{network}"));
        let line = ["train", design, "--network", network, "--noise", twin, "-o", &model.display().to_string()];
        let mut arguments: Vec<String> = line.iter().chain(more).map(|word| word.to_string()).collect();
        let folder = |name: &str| work.join(name).display().to_string();
        arguments.extend(data.iter().flat_map(|name| ["--data".to_string(), folder(name)]));
        Step { arguments, done: model.join("card.json"), model: Some(model), estimate_s: samples as f64 / rate }
    };
    let test = work.join("test").display().to_string();
    let epochs = PAPER_EPOCHS.to_string();
    let more = ["--half", "--epochs", &epochs, "--test", &test];
    all.push(train("paper", &more, &["training"], PAPER_EPOCHS * TRAINING_SAMPLES, PAPER_RATE));
    let (epochs, samples) = (BEST_EPOCHS.to_string(), BEST_EPOCH_SAMPLES.to_string());
    let more = ["--half", "--epochs", &epochs, "--epoch-samples", &samples];
    let data = PRESSES.map(|presses| presses.name);
    all.push(train("best", &more, &data, BEST_EPOCHS * BEST_EPOCH_SAMPLES, BEST_RATE));
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_is_a_command_that_this_program_takes() {
        let work = tempfile::tempdir().unwrap();
        let steps = steps("cylinder30", "lab", work.path()).unwrap();
        assert_eq!(steps.iter().filter(|step| step.model.is_some()).count(), 2);
        for step in &steps {
            let line = ["dermis".to_string()].into_iter().chain(step.arguments.iter().cloned());
            let parsed = <crate::Arguments as clap::Parser>::try_parse_from(line);
            assert!(parsed.is_ok(), "{}: {}", step.told(), parsed.unwrap_err());
        }
        // The bar of the whole: four hours.
        let whole: f64 = steps.iter().map(|step| step.estimate_s).sum();
        assert!(whole < 4.0 * 3600.0, "{whole} s");
    }

    #[test]
    fn a_step_whose_result_is_there_is_not_carried_out() {
        let work = tempfile::tempdir().unwrap();
        let done = work.path().join("manifest.json");
        let step = |done: &Path| Step {
            arguments: vec!["no-such-command".into()],
            done: done.to_path_buf(),
            model: None,
            estimate_s: 0.0,
        };
        std::fs::write(&done, "{}").unwrap();
        assert!(step(&done).carry_out().is_ok());
    }
}
