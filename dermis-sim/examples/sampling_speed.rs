//! Training samples per second on `RAYON_NUM_THREADS` threads, and the time of one core per sample: of random skins with
//! fabric patches as `dermis simulate --touch patch --skins random` has them, and of each recipe in `dermis-study/recipes`; or of
//! the recipes named as arguments.
//! `cargo run --release -p dermis-sim --example sampling_speed [RECIPE.toml ...]`.

use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::mesh::Mesh;
use dermis_sim::dataset::{Generator, PatchTouches, Recipe, SkinSpread, Skins, Touch};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Samples per measurement: 128 skins, so that a thread without work at the end hardly counts.
const SAMPLES: u64 = 2048;
/// The best of several measurements: other programs may run too.
const RUNS: u64 = 3;
const SEED: u64 = 1;

fn main() -> Result<(), Box<dyn Error>> {
    let named: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    println!("| recipe | samples per second | ms of a core per sample |\n|---|---|---|");
    if named.is_empty() {
        let (touch, skins) = (Touch::Patch(PatchTouches::usual()), Skins::Random(SkinSpread::usual()));
        let usual = Recipe { seed: SEED, samples: SAMPLES, touch, skins };
        println!("| `--touch patch --skins random` | {} |", rate(&usual, "cylinder30")?);
    }
    for path in if named.is_empty() { shipped()? } else { named } {
        let name = path.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        // The recipe of membranes is for skins on which a touch lowers the conductance.
        let design = if name == "membrane" { "skin16" } else { "cylinder30" };
        println!("| {name} | {} |", rate(&Recipe::load(&path, SEED, SAMPLES)?, design)?);
    }
    Ok(())
}

fn shipped() -> std::io::Result<Vec<PathBuf>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../dermis-study/recipes");
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
    paths.sort();
    Ok(paths)
}

/// The largest rate of the runs and the least time of a core, as cells of the table.
fn rate(recipe: &Recipe, design: &str) -> Result<String, Box<dyn Error>> {
    let design = SkinDesign::load(design)?;
    let forward = ForwardModel::new(&design, &Mesh::generate(&design)?)?;
    let generator = Generator::new(&design, &forward, recipe)?;
    let (mut best, mut least_ms) = (0.0f64, f64::INFINITY);
    for run in 0..RUNS {
        let (start, start_s) = (Instant::now(), core_time_s());
        let made = generator.samples(run * SAMPLES..(run + 1) * SAMPLES)?.len() as f64;
        best = best.max(made / start.elapsed().as_secs_f64());
        if let (Some(start_s), Some(end_s)) = (start_s, core_time_s()) {
            least_ms = least_ms.min(1e3 * (end_s - start_s) / made);
        }
    }
    let of_core = if least_ms.is_finite() { format!("{least_ms:.2}") } else { "not known here".into() };
    Ok(format!("{best:.0} | {of_core}"))
}

/// Time that the threads of this process have spent on cores so far, s; other programs on the machine change it less than
/// the time on the clock. Linux counts it in hundredths of a second (`proc_pid_stat(5)`).
fn core_time_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // After the program's name, which is in brackets: `utime` and `stime` are the 12th and 13th field.
    let ticks = stat.rsplit_once(')')?.1.split_whitespace().skip(11).take(2).map(str::parse::<f64>);
    Some(ticks.collect::<Result<Vec<f64>, _>>().ok()?.iter().sum::<f64>() / 100.0)
}
