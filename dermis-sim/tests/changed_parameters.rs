//! A forward model with other parameters equals the same skin built from the start.

use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::linalg::LANES;
use dermis::mesh::Mesh;
use dermis_sim::random::{sample_rng, standard_normal};

#[test]
fn a_model_with_other_parameters_equals_one_built_anew() {
    let design = SkinDesign::shipped("cylinder30").expect("a shipped design");
    let mesh = Mesh::generate(&design).expect("a mesh");
    let model = ForwardModel::new(&design, &mesh).expect("a model");
    let mut rng = sample_rng(3, 0);
    let mut normal = || standard_normal(&mut rng);
    let displacements: Vec<[f64; 2]> = (0..30).map(|_| [1e-3 * normal(), 1e-3 * normal()]).collect();
    let impedances: Vec<f64> = model.contact_impedances().iter().map(|z| z * (0.3 * normal()).exp()).collect();
    let coat: Vec<f64> = model.rest_conductivity().iter().map(|s| s * (0.2 * normal()).exp()).collect();
    let nodes = mesh.displaced(&design, &displacements);

    let changed = model.with_parameters(&nodes, &impedances, &coat).expect("a sound skin");
    let moved = Mesh { nodes, ..mesh };
    let built = ForwardModel::from_parts(&moved, &impedances, &design.protocol, &coat)
        .expect("a sound skin")
        .with_series_resistances(changed.series_resistances())
        .expect("finite resistances");
    let (ours, expected) = (changed.solve(&coat).expect("a frame"), built.solve(&coat).expect("a frame"));
    assert_eq!(ours.0, expected.0, "the same arithmetic, bit for bit");
    let before = model.solve(model.rest_conductivity()).expect("a frame");
    let change = |frame: &[f64]| frame.iter().zip(&before.0).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(change(&ours) > 1.0, "the skins differ: {}", change(&ours));

    // Both solvers continue with the new skin.
    let mut plain = model.solver();
    plain.set_model(&changed);
    let mut values = vec![0.0; before.len()];
    plain.solve_into(&coat, &mut values).expect("a frame");
    assert_eq!(values, expected.0);
    let mut batch = model.batch_solver();
    batch.set_model(&changed);
    let lanes: Vec<[f64; LANES]> = coat.iter().map(|&s| [s; LANES]).collect();
    let mut frames = vec![[0.0; LANES]; before.len()];
    batch.solve_into(&lanes, &mut frames).expect("a frame");
    let worst = frames.iter().zip(&expected.0).map(|(a, b)| (a[4] - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-8, "{worst:.1e} ohm");
}

#[test]
fn the_near_field_scales_with_the_resistance_of_the_coating() {
    let design = SkinDesign::shipped("cylinder30").expect("a shipped design");
    let mesh = Mesh::generate(&design).expect("a mesh");
    let model = ForwardModel::new(&design, &mesh).expect("a model");
    let twice: Vec<f64> = model.rest_conductivity().iter().map(|s| 2.0 * s).collect();
    let halved: Vec<f64> = model.contact_impedances().iter().map(|z| 0.5 * z).collect();
    // All resistances of the skin are halved, so every value must be halved too.
    let changed = model.with_parameters(&mesh.nodes, &halved, &twice).expect("a sound skin");
    let (half, whole) = (changed.solve(&twice).expect("a frame"), model.solve(model.rest_conductivity()).expect("one"));
    for (half, whole) in half.iter().zip(whole.iter()) {
        assert!((2.0 * half - whole).abs() <= 1e-9 * whole.abs().max(1.0), "{half} against {whole}");
    }
}
