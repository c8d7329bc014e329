//! Every kind of network compared with ONNX Runtime, if it is installed.

use super::file;
use crate::inference::Inference;

use crate::input::Input;
use crate::network::{Architecture, Network};
use crate::options::Target;
use dermis::frame::write_array;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::path::Path;
use std::process::Command;

const FRAMES: usize = 4;

/// The Python for the tests: `DERMIS_PYTHON`, or that of the comparison, or `python3`; `None` if it lacks the modules.
fn python(modules: &str) -> Option<String> {
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/../bench/peers/.venv-learn/bin/python");
    let named = std::env::var("DERMIS_PYTHON").ok();
    let python = named.unwrap_or_else(|| if Path::new(own).exists() { own.into() } else { "python3".into() });
    let tried = Command::new(&python).args(["-c", &format!("import {modules}")]).output();
    tried.is_ok_and(|output| output.status.success()).then_some(python)
}

#[test]
fn onnx_runtime_gives_our_images() {
    let Some(python) = python("numpy, onnxruntime") else {
        return eprintln!("skipped: no Python with numpy and onnxruntime (DERMIS_PYTHON names one)");
    };
    let folder = tempfile::tempdir().unwrap();
    let ring = Architecture::refined(20, [5, 6], true, &[4, 16, 16, 1]);
    // More convolutions than columns: the periodic image is repeated more than once.
    let narrow = Architecture::refined(20, [4, 3], true, &[2, 16, 16, 16, 16, 1]);
    let flat = Architecture::refined(20, [5, 6], false, &[3, 16, 1]);
    let architectures = [Architecture::paper(CHANNELS, 30), Architecture::paper_norm_first(20, 30), ring, narrow, flat];
    for (index, architecture) in architectures.iter().enumerate() {
        for target in [Target::Conductance, Target::Touches { width_m: 0.01 }] {
            for scale_free in [false, true] {
                check(&python, folder.path(), architecture, index as u64, target, scale_free);
            }
        }
    }
}

/// A network with random values everywhere, as different from the initial zeros and ones as after training.
fn drawn(architecture: &Architecture, seed: u64) -> Network {
    let mut network = Network::new(architecture, seed);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let names: Vec<String> = network.tensors().into_iter().map(|tensor| tensor.name).collect();
    for (values, name) in network.values_mut().into_iter().zip(names) {
        let range = match name.rsplit('.').next() {
            Some("variance" | "scale") => 0.2..2.0,
            Some("weight") => -0.2..0.2,
            _ => -0.5..0.5,
        };
        values.iter_mut().for_each(|value| *value = rng.random_range(range.clone()));
    }
    network
}

/// Number of channels of the test's frames.
const CHANNELS: usize = 40;

/// As many inputs as channels, or means of one to three channels.
fn drawn_input(inputs: usize) -> Input {
    let group = |at: usize| match inputs == CHANNELS {
        true => vec![at],
        false => (0..1 + at % 3).map(|turn| (5 * at + 7 * turn) % CHANNELS).collect(),
    };
    Input {
        channels: (0..inputs).map(group).collect(),
        mean_ohm: (0..inputs).map(|at| 0.01 * (at as f32).cos()).collect(),
        sd_ohm: (0..inputs).map(|at| 0.02 + 0.01 * (at as f32).sin()).collect(),
        scale_free: false,
    }
}

fn check(python: &str, folder: &Path, architecture: &Architecture, seed: u64, target: Target, scale_free: bool) {
    let network = drawn(architecture, seed);
    let mut input = drawn_input(architecture.inputs());
    if scale_free {
        input.scale_free = true;
        input.channels[1].clear();
    }
    let differences: Vec<f32> = (0..FRAMES * CHANNELS).map(|at| 0.03 * (0.7 * at as f32).sin()).collect();
    let wide = |values: &[f32]| values.iter().map(|&value| f64::from(value)).collect::<Vec<f64>>();
    let differences = wide(&differences);
    let mut images = vec![0.0; FRAMES * architecture.outputs()];
    let inference = Inference::new(&network, &input, target);
    for (difference, image) in differences.chunks_exact(CHANNELS).zip(images.chunks_exact_mut(architecture.outputs())) {
        inference.image_into(difference, image);
    }
    let paths = ["model.onnx", "differences.npy", "images.npy"].map(|name| folder.join(name));
    std::fs::write(&paths[0], file(&input, &network, target, CHANNELS, &[("seed", seed.to_string())])).unwrap();
    write_array(&paths[1], "differences", &[FRAMES, CHANNELS], &differences).unwrap();
    write_array(&paths[2], "images", &[FRAMES, architecture.outputs()], &images).unwrap();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/check_onnx.py");
    let output = Command::new(python).arg(script).args(&paths).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{architecture:?}\n{said}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("one by one: 4 images"), "{said}");
}
