//! Trained networks in other programs: the ONNX file in ONNX Runtime, the model folder in NumPy and PyTorch.

use crate::workplace::Workplace;
use dermis::frame::write_array;
use std::path::Path;
use std::process::Command;

const FRAMES: usize = 5;

/// Steps of the tests with a network.
trait Exports {
    /// Trains briefly, and writes differences, their images and the ONNX file.
    fn model(&self, design: &str, network: &str, channels: usize);
    /// The output of an example script for files of this folder.
    fn example(&self, python: &str, script: &str, files: &[&str]) -> String;
}

impl Exports for Workplace {
    fn model(&self, design: &str, network: &str, channels: usize) {
        self.good(&format!("simulate {design} --seed 1 --samples 800 -o data"));
        self.good("simulate --finish data");
        self.good(&format!("train {design} --data data --network {network} --epochs 1 -o model"));
        let differences: Vec<f64> = (0..FRAMES * channels).map(|at| 0.5 * (0.7 * at as f64).sin()).collect();
        write_array(&self.path("differences.npy"), "differences", &[FRAMES, channels], &differences).unwrap();
        self.good(&format!(
            "reconstruct {design} --frames differences.npy --difference --method ./model -o images.npy"
        ));
        self.good(&format!("export {design} --method ./model --onnx model.onnx"));
    }

    fn example(&self, python: &str, script: &str, files: &[&str]) -> String {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples").join(script);
        let mut command = Command::new(python);
        let output = command.arg(script).args(files).current_dir(self.folder()).output().unwrap();
        let told = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{told}{}", String::from_utf8_lossy(&output.stderr));
        told.into_owned()
    }
}

/// `DERMIS_PYTHON`, the interpreter of the comparison, or `python3`; `None`, with a message, if it lacks the modules.
fn python(modules: &str) -> Option<String> {
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/../bench/peers/.venv-learn/bin/python");
    let named = std::env::var("DERMIS_PYTHON").ok();
    let python = named.unwrap_or_else(|| if Path::new(own).exists() { own.into() } else { "python3".into() });
    let tried = Command::new(&python).args(["-c", &format!("import {modules}")]).output();
    let has = tried.is_ok_and(|output| output.status.success());
    if !has {
        eprintln!("skipped: {python} has not all of {modules} (DERMIS_PYTHON names another)");
    }
    has.then_some(python)
}

#[test]
fn an_exported_network_is_a_file_that_names_its_ends() {
    let workplace = Workplace::new();
    workplace.model("disk.toml", "paper", 40);
    let file = std::fs::read(workplace.path("model.onnx")).unwrap();
    for name in ["difference_ohm", "image", "Gemm", "dermis model"] {
        assert!(file.windows(name.len()).any(|part| part == name.as_bytes()), "{name}");
    }
    let refused = workplace.run("export cylinder30 --method ./model --onnx other.onnx");
    assert_eq!(refused.status.code(), Some(2));
    assert!(!workplace.path("other.onnx").exists());
}

#[test]
fn other_programs_make_the_same_images_on_a_disk() {
    let Some(python) = python("numpy") else { return };
    let workplace = Workplace::new();
    workplace.model("disk.toml", "paper", 40);
    agree(&workplace, &python);
}

#[test]
#[ignore = "slow: trains the network of spots for the paper's skin; needs python3 (or DERMIS_PYTHON) with NumPy"]
fn other_programs_make_the_same_images_on_a_cylinder() {
    let Some(python) = python("numpy") else { return };
    let workplace = Workplace::new();
    workplace.model("cylinder30", "spots", 870);
    agree(&workplace, &python);
}

fn agree(workplace: &Workplace, has_numpy: &str) {
    let told = workplace.example(has_numpy, "load_model.py", &["model", "differences.npy", "images.npy"]);
    assert!(told.contains(&format!("NumPy and Dermis: {FRAMES} images agree")), "{told}");
    if let Some(python) = python("onnxruntime") {
        let told = workplace.example(&python, "check_onnx.py", &["model.onnx", "differences.npy", "images.npy"]);
        assert!(told.contains(&format!("one by one: {FRAMES} images")), "{told}");
    }
}
