//! Training samples per second on `RAYON_NUM_THREADS` threads: of random skins with fabric patches as `dermis simulate
//! --touch patch --skins random` has them, and of each recipe in `data/recipes`; or of the recipes named as arguments.
//! `cargo run --release -p dermis-sim --example sampling_speed [RECIPE.toml ...]`.

use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::mesh::Mesh;
use dermis_sim::dataset::{Generator, PatchTouches, Recipe, SkinSpread, Skins, Touch};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Samples per measurement: 64 skins.
const SAMPLES: u64 = 1024;
/// The best of several measurements: other programs may run too.
const RUNS: u64 = 3;
const SEED: u64 = 1;

fn main() -> Result<(), Box<dyn Error>> {
    let named: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    println!("| recipe | samples per second |\n|---|---|");
    if named.is_empty() {
        let (touch, skins) = (Touch::Patch(PatchTouches::usual()), Skins::Random(SkinSpread::usual()));
        let usual = Recipe { seed: SEED, samples: SAMPLES, touch, skins };
        println!("| `--touch patch --skins random` | {:.0} |", rate(&usual, "cylinder30")?);
    }
    for path in if named.is_empty() { shipped()? } else { named } {
        let name = path.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        // The recipe of membranes is for skins on which a touch lowers the conductance.
        let design = if name == "membrane" { "skin16" } else { "cylinder30" };
        println!("| {name} | {:.0} |", rate(&Recipe::load(&path, SEED, SAMPLES)?, design)?);
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

fn rate(recipe: &Recipe, design: &str) -> Result<f64, Box<dyn Error>> {
    let design = SkinDesign::load(design)?;
    let forward = ForwardModel::new(&design, &Mesh::generate(&design)?)?;
    let generator = Generator::new(&design, &forward, recipe)?;
    let mut best = 0.0f64;
    for run in 0..RUNS {
        let start = Instant::now();
        let made = generator.samples(run * SAMPLES..(run + 1) * SAMPLES)?.len();
        best = best.max(made as f64 / start.elapsed().as_secs_f64());
    }
    Ok(best)
}
