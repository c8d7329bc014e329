//! Training samples per second of each recipe in `data/recipes`, or of those named as arguments, on all threads of
//! `RAYON_NUM_THREADS`: `cargo run --release -p dermis-sim --example sampling_speed [RECIPE.toml ...]`.

use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::mesh::Mesh;
use dermis_sim::dataset::{Generator, Recipe};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Samples per measurement: 64 skins.
const SAMPLES: u64 = 1024;
/// The best of several measurements: other programs may run too.
const RUNS: u64 = 3;

fn main() -> Result<(), Box<dyn Error>> {
    let named: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let recipes = if named.is_empty() { shipped()? } else { named };
    println!("| recipe | samples per second |\n|---|---|");
    for path in recipes {
        let name = path.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        println!("| {name} | {:.0} |", rate(&path, &name)?);
    }
    Ok(())
}

fn shipped() -> std::io::Result<Vec<PathBuf>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/recipes");
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
    paths.sort();
    Ok(paths)
}

fn rate(path: &Path, name: &str) -> Result<f64, Box<dyn Error>> {
    // The recipe of membranes is for the skins on which a touch lowers the conductance.
    let design = SkinDesign::load(if name == "membrane" { "skin16" } else { "cylinder30" })?;
    let forward = ForwardModel::new(&design, &Mesh::generate(&design)?)?;
    let generator = Generator::new(&design, &forward, &Recipe::load(path, 1, SAMPLES)?)?;
    let mut best = 0.0f64;
    for run in 0..RUNS {
        let start = Instant::now();
        let made = generator.samples(run * SAMPLES..(run + 1) * SAMPLES)?.len();
        best = best.max(made as f64 / start.elapsed().as_secs_f64());
    }
    Ok(best)
}
