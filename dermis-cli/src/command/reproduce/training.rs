//! The networks from nothing: commands of this program, one after the other, each of which goes on where it was.

use crate::failure::{Failure, Outcome};
use dermis::frame::write_whole;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Samples of Gaussian touches that the networks train on and are tested by: the paper's.
const TRAINING_SAMPLES: u64 = 1_100_000;
const TEST_SAMPLES: u64 = 40_000;
/// Samples of presses on patches, of each recipe.
const PRESSED_SAMPLES: u64 = 100_000;
/// Most epochs of a network.
const EPOCHS: u64 = 40;
/// Seeds of the datasets: of training, of test, and of the presses from the last on.
const SEEDS: [u64; 3] = [1, 2, 3];

/// Samples a second on two cores (`docs/datasets.md`): Gaussian touches on random skins, presses on random skins, and
/// those that a network trains on.
const GAUSSIAN_RATE: f64 = 2_800.0;
const PRESSED_RATE: f64 = 280.0;
const TRAINING_RATE: f64 = 13_000.0;

/// Patches of other pitches, foams and contacts than any twin that is reported has.
const RECIPES: [(&str, &str); 4] = [
    ("fine-soft", include_str!("../../../../data/recipes/fine-soft.toml")),
    ("fine-firm", include_str!("../../../../data/recipes/fine-firm.toml")),
    ("coarse-soft", include_str!("../../../../data/recipes/coarse-soft.toml")),
    ("coarse-firm", include_str!("../../../../data/recipes/coarse-firm.toml")),
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
    let random = ["--skins", "random"];
    let mut all = vec![
        simulate("training", TRAINING_SAMPLES, SEEDS[0], &random, GAUSSIAN_RATE),
        finish("training"),
        simulate("test", TEST_SAMPLES, SEEDS[1], &random, GAUSSIAN_RATE),
        finish("test"),
    ];
    for ((name, text), seed) in RECIPES.into_iter().zip(SEEDS[2]..) {
        let recipe = work.join(format!("{name}.toml"));
        write_whole(&recipe, |out| out.write_all(text.as_bytes()))?;
        let recipe = recipe.display().to_string();
        all.push(simulate(name, PRESSED_SAMPLES, seed, &["--recipe", &recipe], PRESSED_RATE));
        all.push(finish(name));
    }
    let train = |network: &str, data: &[&str], samples: u64| {
        let folder = |name: &str| work.join(name).display().to_string();
        let model = work.join(format!("network-{network}"));
        let mut arguments: Vec<String> =
            ["train", design, "--network", network, "--noise", twin].map(String::from).to_vec();
        arguments.extend(data.iter().flat_map(|name| ["--data".to_string(), folder(name)]));
        arguments.extend(["--test".to_string(), folder("test")]);
        arguments.extend(["--epochs".to_string(), EPOCHS.to_string(), "-o".to_string(), model.display().to_string()]);
        let estimate_s = (EPOCHS * samples) as f64 / TRAINING_RATE;
        Step { arguments, done: model.join("card.json"), model: Some(model), estimate_s }
    };
    all.push(train("paper", &["training"], TRAINING_SAMPLES));
    let pressed: Vec<&str> = RECIPES.iter().map(|recipe| recipe.0).collect();
    let data: Vec<&str> = ["training"].into_iter().chain(pressed).collect();
    all.push(train("best", &data, TRAINING_SAMPLES + RECIPES.len() as u64 * PRESSED_SAMPLES));
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
