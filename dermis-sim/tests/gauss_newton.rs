//! Gauss-Newton on a skin whose instrument reports amplitudes.

use dermis::detect::Detector;
use dermis::frame::Frame;
use dermis::method::{MethodOptions, Methods};
use dermis::skin::Skin;
use dermis_sim::evaluate::score;
use dermis_sim::experiment::{Presses, record, truth};
use dermis_sim::twin::{GaussianOptions, TouchOptions, Twin, TwinOptions};

/// Presses on a twin of `skin16`, whose frames have no signs, are found where one step finds them. With the signs of the
/// model's fields none of them was.
#[test]
fn presses_are_found_without_signs() {
    const PRESSES: usize = 6;
    let skin = Skin::load("skin16").expect("a shipped design");
    let mut options = TwinOptions::shipped("ideal").expect("a shipped twin");
    options.touch = TouchOptions::Gaussian(GaussianOptions { amplitude_per_n: 0.45, width_m: 0.008 });
    options.electronics.snr_db = Some(50.0);
    (options.press.least_force_n, options.press.greatest_force_n) = (0.5, 2.0);
    let twin = Twin::new(skin.design(), &options, 1).expect("a twin");
    let presses = Presses::new(skin.design(), skin.mesh(), skin.pixels(), options.press, 3).at_random(PRESSES).presses;
    let recording = record(&twin, &presses, 0, || ()).expect("a recording");
    let surface = skin.design().body.surface();
    let truths: Vec<_> = presses.iter().map(|presses| truth(&surface, presses)).collect();
    let differences: Vec<Frame> = recording.frames.iter().map(|frame| frame - &recording.baseline).collect();
    let scored = |name: &str| {
        let options = MethodOptions { baseline: Some(recording.baseline.clone()), ..MethodOptions::default() };
        let method = Methods::linear().method(&skin, name, &options).expect("a method");
        let images: Vec<_> = differences.iter().map(|difference| method.image(difference).expect("an image")).collect();
        let detector = Detector::new(method.reconstruct().detection());
        let score = score(&images, &truths, &detector, name, method.alpha()).expect("a score");
        let mean_mm = 1e3 * score.localisation_m.mean;
        println!("| {name} | {} of {PRESSES} | {} | {mean_mm:.2} |", PRESSES - score.misses, score.false_positives);
        (score.misses, score.false_positives, mean_mm)
    };
    let one_step = scored("noser");
    for name in ["gauss-newton", "tv"] {
        let (misses, false_positives, mean_mm) = scored(name);
        assert_eq!((misses, false_positives), (0, 0), "{name}");
        assert!(mean_mm <= one_step.2, "{name}: {mean_mm} mm, one step {} mm", one_step.2);
    }
}
