//! One-step images and noise figures compared with an independent program.

use crate::reference::{Reference, relative_difference};
use dermis::geom::Surface;
use dermis::image::PixelSpace;
use dermis::reconstruct::{Alpha, Difference, Linearised, OneStep, OneStepOptions, Prior, Reconstruct, noise_figure};
use std::sync::Arc;

/// Our own Jacobian and the same formula: only rounding errors differ.
const IMAGES: f64 = 1e-8;
/// The noise figure is given to 0.1 %, its inverse to 1 %.
const NOISE_FIGURE: f64 = 1e-3;
const HYPERPARAMETER: f64 = 1e-2;

const PRIORS: [(&str, Prior, f64); 3] = [
    ("noser", Prior::Noser { exponent: 0.5 }, 0.1),
    ("tikhonov", Prior::Tikhonov, 0.01),
    ("laplace", Prior::Laplace, 0.01),
];

struct Disk {
    reference: Reference,
    pixels: Arc<PixelSpace>,
    model: Linearised,
    meta: serde_json::Value,
}

impl Disk {
    fn new() -> Self {
        let reference = Reference::disk16();
        let pixels = Arc::new(PixelSpace::cells(&reference.mesh, Surface::Plane));
        let model = Linearised::new(&reference.model(), &pixels).unwrap();
        let text = std::fs::read_to_string(reference.folder.join("meta.json")).unwrap();
        Disk { pixels, model, meta: serde_json::from_str(&text).unwrap(), reference }
    }

    fn one_step(&self, options: &OneStepOptions) -> OneStep {
        OneStep::from_linearised(&self.model, Arc::clone(&self.pixels), options).unwrap()
    }

    /// The difference of a case from the uniform disk, with the voltages of the reference.
    fn difference(&self, case: &str) -> Vec<f64> {
        let rest = self.reference.column("v_homog.csv");
        self.reference.column(&format!("v_{case}.csv")).iter().zip(&rest).map(|(a, b)| a - b).collect()
    }

    fn assert_image(&self, one_step: &OneStep, case: &str, file: &str) {
        let mut image = vec![0.0; self.pixels.len()];
        one_step.reconstruct_into(&self.difference(case), &mut image).unwrap();
        let difference = relative_difference(&image, &self.reference.column(file));
        println!("disk16 {file}: relative difference {difference:.2e} (at most {IMAGES:.0e})");
        assert!(difference <= IMAGES, "{file}: {difference:.2e}");
    }
}

#[test]
fn images_of_three_priors() {
    let disk = Disk::new();
    for (name, prior, hyperparameter) in PRIORS {
        let alpha = Alpha::Absolute(hyperparameter);
        let one_step = disk.one_step(&OneStepOptions { prior, alpha, ..OneStepOptions::default() });
        for case in ["incl", "two"] {
            disk.assert_image(&one_step, case, &format!("img_{name}_{case}.csv"));
        }
    }
}

#[test]
fn the_image_of_a_normalised_difference() {
    let disk = Disk::new();
    let one_step = disk.one_step(&OneStepOptions {
        alpha: Alpha::Absolute(0.1),
        difference: Difference::Normalised,
        ..OneStepOptions::default()
    });
    disk.assert_image(&one_step, "incl", "img_noser_incl_normalized.csv");
}

/// The target of the reference: an increase of one per cent in the cells in the centre.
#[test]
fn noise_figures() {
    let disk = Disk::new();
    let target: Vec<usize> = disk.reference.column("nf_target_elems.csv").iter().map(|&cell| cell as usize).collect();
    let forward = disk.reference.model();
    let mut conductivity = forward.rest_conductivity().to_vec();
    target.iter().for_each(|&cell| conductivity[cell] *= 1.01);
    let touched = forward.solve(&conductivity).unwrap();
    let difference: Vec<f64> = touched.iter().zip(&disk.model.rest_frame).map(|(a, b)| a - b).collect();
    for (name, prior, hyperparameter) in PRIORS {
        let options = OneStepOptions { prior, target: target.clone(), ..OneStepOptions::default() };
        let one_step = disk.one_step(&OneStepOptions { alpha: Alpha::Absolute(hyperparameter), ..options.clone() });
        let ours = noise_figure(one_step.matrix().unwrap(), &disk.pixels.areas, &difference);
        let theirs = disk.meta["reconstructions"][name]["noise_figure"].as_f64().unwrap();
        println!("disk16 {name}: noise figure {ours:.6}, reference {theirs:.6}: {:+.1e}", ours / theirs - 1.0);
        assert!((ours / theirs - 1.0).abs() <= NOISE_FIGURE);

        // The prior's scale converts our alpha to the reference's hyperparameter.
        let chosen = disk.one_step(&OneStepOptions { alpha: Alpha::NoiseFigure(1.0), ..options });
        let ours = chosen.hyperparameter();
        let theirs = disk.meta["hp_for_noise_figure_1"][name].as_f64().unwrap();
        println!("disk16 {name}: hyperparameter {ours:.6e}, reference {theirs:.6e}: {:+.1e}", ours / theirs - 1.0);
        assert!((ours / theirs - 1.0).abs() <= HYPERPARAMETER);
    }
}
