//! Real presses on real skins. The recordings have no licence, so they are searched for next to the project or in
//! `DERMIS_DATA`; without them the tests print that they were skipped.

use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::frame::{Frame, Truth, read_frames, read_truth};
use dermis::geom::Point3;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis_sim::evaluate::{AlignOptions, Aligned, PressEstimates};
use std::path::PathBuf;
use std::sync::Arc;

fn skins() -> Option<PathBuf> {
    let data = std::env::var_os("DERMIS_DATA")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")), PathBuf::from);
    let skins = data.join("skins_real");
    if skins.is_dir() {
        return Some(skins);
    }
    println!("skipped: no recordings of real skins at {}", skins.display());
    None
}

fn presses(name: &str) -> Option<(PressEstimates, Vec<Point3>)> {
    let folder = skins()?;
    let design = SkinDesign::shipped("skin16").expect("a shipped design");
    let mesh = Mesh::generate(&design).expect("a mesh");
    let forward = ForwardModel::new(&design, &mesh).expect("a model");
    let pixels = Arc::new(PixelSpace::for_design(&design, &mesh).expect("pixels"));
    let frames: Vec<Frame> = read_frames(&folder.join(format!("inp_{name}.csv")), &design.protocol).expect("frames");
    let truth = read_truth(&folder.join(format!("out_{name}.csv")), &mesh.place_limits(pixels.surface), frames.len())
        .expect("a truth");
    let Truth::Elsewhere { positions_m: truth, .. } = truth else { panic!("the presses have no header") };
    let options = AlignOptions::new(design.sheet.touch);
    Some((PressEstimates::new(&forward, &pixels, &frames, &options).expect("estimates"), truth))
}

fn print(name: &str, aligned: &Aligned) {
    let score = &aligned.score;
    println!(
        "{name}: aligned by {}, {} scored: mean {:.2} mm, median {:.2} mm, 95 % {:.2} mm; Eq. 11 {:.2} mm; {} misses, {} \
         false_positives; {} alpha {:.2} cut at {} sd; {:?}; left out {:?}",
        aligned.aligned_by,
        score.presses,
        1e3 * score.localisation_m.mean,
        1e3 * score.localisation_m.median,
        1e3 * score.localisation_m.p95,
        1e3 * score.eq11_m.mean,
        score.misses,
        score.false_positives,
        score.method,
        score.alpha.unwrap_or(f64::NAN),
        aligned.limit_sd,
        aligned.alignment,
        aligned.left_out,
    );
}

/// Mean error over the last 500 presses after alignment by the first 2,000, and the median over 200 random draws of 20
/// presses for alignment of the mean error over all others; m.
fn figures(name: &str) -> Option<(f64, f64)> {
    let (estimates, truth) = presses(name)?;
    let many: Vec<usize> = (0..2000).collect();
    let aligned = estimates.align(&truth, &many).expect("a score");
    print(name, &aligned);
    let means = estimates.align_by_few(&truth, 20, 200).expect("scores");
    let median = 0.5 * (means[99] + means[100]);
    println!(
        "{name}: 200 draws of 20 presses to align by: median {:.2} mm, 90 % {:.2} mm",
        1e3 * median,
        1e3 * means[180]
    );
    Some((aligned.score.localisation_m.mean, median))
}

#[test]
fn the_even_skin_is_localised() {
    let Some((many, few)) = figures("noPattern") else { return };
    assert!(many <= 6.2e-3, "{:.2} mm", 1e3 * many);
    assert!(few <= 7.0e-3, "{:.2} mm", 1e3 * few);
}

#[test]
fn the_striped_skin_is_localised_better_than_by_guessing_its_centre() {
    let Some((many, few)) = figures("parallel") else { return };
    // Estimating the centre for every press gives an error of 26 mm.
    assert!(many <= 20e-3 && few <= 22e-3, "{:.2} mm, {:.2} mm", 1e3 * many, 1e3 * few);
}
