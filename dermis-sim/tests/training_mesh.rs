//! Checks that the default mesh is fine enough for training: differences of frames compared with a mesh with edges a
//! quarter as long.
//!
//! `cargo test --release -p dermis-sim --test integration training_mesh:: -- --ignored --nocapture` prints the results.

use dermis::design::{Electrode, SkinDesign};
use dermis::forward::ForwardModel;
use dermis::mesh::Mesh;
use dermis_sim::dataset::{GaussianTouches, Generator, Recipe, Skins, Touch};
use dermis_sim::touch::{GaussianTouch, touched_conductivity};
use rayon::prelude::*;

/// Relative L2 error over the values without a driven electrode.
const MEDIAN_AT_MOST: f64 = 0.015;
const P95_AT_MOST: f64 = 0.04;
const ON_ELECTRODE_AT_MOST: f64 = 0.08;

/// A model and its untouched frame.
struct Side {
    model: ForwardModel,
    rest: Vec<f64>,
}

impl Side {
    fn new(design: &SkinDesign) -> Self {
        let mesh = Mesh::generate(design).expect("a mesh");
        let model = ForwardModel::new(design, &mesh).expect("a model");
        let rest = model.solve(model.rest_conductivity()).expect("an untouched frame").0;
        Side { model, rest }
    }

    /// The change by touches of the values without a driven electrode, ohm.
    fn difference(&self, design: &SkinDesign, touches: &[GaussianTouch]) -> Vec<f64> {
        let (mesh, rest) = (self.model.mesh(), self.model.rest_conductivity());
        let touched = touched_conductivity(mesh, &design.body.surface(), design.sheet.touch, rest, touches);
        let frame = self.model.solve(&touched.expect("touches that leave conductance")).expect("a frame");
        let channels = self.model.protocol().channels().iter();
        let undriven = channels.enumerate().filter(|(_, channel)| !channel.touches_driven());
        undriven.map(|(index, _)| frame[index] - self.rest[index]).collect()
    }
}

fn relative(ours: &[f64], fine: &[f64]) -> f64 {
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|value| value * value).sum::<f64>().sqrt();
    norm(&mut ours.iter().zip(fine).map(|(a, b)| a - b)) / norm(&mut fine.iter().copied())
}

#[test]
#[ignore = "slow: half a minute, a mesh of 79,000 nodes"]
fn differences_on_the_training_mesh_are_those_of_a_mesh_a_quarter_as_coarse() {
    let design = SkinDesign::shipped("cylinder30").expect("a shipped design");
    let coarse = Side::new(&design);
    let fine = Side::new(&SkinDesign { mesh: design.mesh.scaled(0.25), ..design.clone() });
    let gaussian = GaussianTouches::for_effect(design.sheet.touch);
    let [narrow, wide] = gaussian.width_m;
    let [weak, strong] = gaussian.amplitude;
    let recipe = Recipe { seed: 20, samples: 200, touch: Touch::Gaussian(gaussian), skins: Skins::Even };
    let generator = Generator::new(&design, &coarse.model, &recipe).expect("a recipe that can be drawn from");
    let error =
        |touches: &[GaussianTouch]| relative(&coarse.difference(&design, touches), &fine.difference(&design, touches));
    let mut errors: Vec<f64> =
        (0..recipe.samples).into_par_iter().map(|sample| error(&generator.touches(sample))).collect();
    errors.sort_by(f64::total_cmp);
    let (median, p95) = (errors[100], errors[190]);

    let centred = |electrode: &Electrode, width_m: f64| {
        let amplitude = (weak * strong).sqrt();
        error(&[GaussianTouch { centre_m: electrode.centre_m, amplitude, width_m }])
    };
    let on_electrode = |width_m: f64| {
        design.electrodes.par_iter().map(|electrode| centred(electrode, width_m)).reduce(|| 0.0, f64::max)
    };
    let worst = on_electrode(narrow).max(on_electrode(wide));
    println!(
        "{} against {} nodes, 200 samples: median {:.2} %, 95th percentile {:.2} %, most {:.2} %; worst touch centred on \
         an electrode {:.2} %",
        coarse.model.mesh().node_count(),
        fine.model.mesh().node_count(),
        100.0 * median,
        100.0 * p95,
        100.0 * errors[199],
        100.0 * worst
    );
    assert!(median <= MEDIAN_AT_MOST && p95 <= P95_AT_MOST && worst <= ON_ELECTRODE_AT_MOST);
}
