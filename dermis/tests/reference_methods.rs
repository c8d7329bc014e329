//! The methods for comparison - Gauss-Newton, total variation, GREIT - against an independent program's results.

use crate::reference::Reference;
use dermis::design::{Body, ImageLayout, MeshOptions, Sheet, SkinDesign, TouchEffect};
use dermis::frame::Frame;
use dermis::geom::Surface;
use dermis::image::{Image, PixelSpace};
use dermis::reconstruct::{
    Alpha, GaussNewton, GaussNewtonOptions, Greit, GreitOptions, Linearised, OneStepOptions, Prior, Reconstruct,
    TotalVariation, TotalVariationOptions, Unknowns, figures_of_merit,
};
use std::sync::Arc;

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

fn meta(reference: &Reference) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(reference.folder.join("meta.json")).unwrap()).unwrap()
}

/// The absolute image of two inclusions. The reference gives its misfit, but not its image. Converged, the same problem
/// has a 0.1 % larger misfit at the reference's hyperparameter (its iteration continues past a smaller objective, or
/// stops before it). The misfit must therefore agree there, and must be smaller at half of it, which is weak enough for
/// a better fit.
#[test]
fn absolute_gauss_newton_fits_no_worse_than_the_reference() {
    const SAME_PROBLEM: f64 = 2e-3;
    let disk = Reference::disk16();
    let theirs = meta(&disk)["other_solvers"]["GN_abs"]["rel_data_misfit"].as_f64().unwrap();
    let measured = Frame(disk.column("v_two.csv"));
    let truth = disk.column("sigma_two.csv");
    let pixels = Arc::new(PixelSpace::cells(&disk.mesh, Surface::Plane));
    let solve = |hyperparameter: f64| {
        let linear =
            OneStepOptions { prior: Prior::Laplace, alpha: Alpha::Absolute(hyperparameter), ..Default::default() };
        let options = GaussNewtonOptions {
            linear,
            unknowns: Unknowns::Conductance,
            max_iterations: 30,
            tolerance: 1e-6,
            ..Default::default()
        };
        let method = GaussNewton::new(&disk.model(), Arc::clone(&pixels), &options).unwrap();
        let solution = method.absolute(&measured).unwrap();
        let misfit = solution.misfit / norm(&measured);
        let image_error = norm(&minus(&solution.conductivity, &truth)) / norm(&minus(&truth, &vec![1.0; truth.len()]));
        println!(
            "disk16 absolute Gauss-Newton at {hyperparameter}: misfit {misfit:.5e} of the frame (reference {theirs:.5e} \
             at 0.01), image error {image_error:.3}, {} steps",
            solution.objectives.len() - 1
        );
        assert!(solution.objectives.windows(2).all(|pair| pair[1] < pair[0]));
        (method, solution, misfit)
    };
    let (method, solution, misfit) = solve(0.01);
    assert!((misfit / theirs - 1.0).abs() < SAME_PROBLEM);
    // The reference gives only the one-step image for the same prior and hyperparameter.
    let objective = *solution.objectives.last().unwrap();
    let one_step = method.objective(&disk.column("img_laplace_two.csv"), &measured).unwrap();
    println!(
        "disk16 absolute Gauss-Newton: objective {objective:.4e}, at the reference's one-step image {one_step:.4e}"
    );
    assert!(objective <= one_step);
    assert!(solve(0.005).2 <= theirs);
}

/// A difference is explained by the same iteration as the frame, if the untouched skin is that of the model.
#[test]
fn gauss_newton_explains_a_difference() {
    let disk = Reference::disk16();
    let model = disk.model();
    let pixels = Arc::new(PixelSpace::cells(&disk.mesh, Surface::Plane));
    let linear = OneStepOptions { alpha: Alpha::Absolute(0.01), ..Default::default() };
    let method = GaussNewton::new(&model, pixels, &GaussNewtonOptions { linear, ..Default::default() }).unwrap();
    let rest = model.solve(model.rest_conductivity()).unwrap();
    let difference = &Frame(disk.column("v_two.csv")) - &rest;
    let solution = method.difference(&difference).unwrap();
    let left = solution.misfit / norm(&difference);
    println!("disk16 Gauss-Newton of a difference: {left:.2e} of it left unexplained, {:?}", solution.objectives);
    assert!(left < 0.1);
    assert!(solution.objectives.windows(2).all(|pair| pair[1] < pair[0]));
    let logarithms: Vec<f64> = solution.change.iter().map(|change| change.ln_1p()).collect();
    assert_eq!(method.reconstruct(&difference).unwrap().values, logarithms);
    // A skin of twice the resistance, whose untouched frame is given, has the same image.
    let baseline = Some(Frame(rest.iter().map(|value| 2.0 * value).collect()));
    let linear = OneStepOptions { alpha: Alpha::Absolute(0.01), ..Default::default() };
    let scaled = GaussNewton::new(
        &model,
        Arc::clone(method.pixels()),
        &GaussNewtonOptions { linear, baseline, ..Default::default() },
    );
    let doubled: Vec<f64> = difference.iter().map(|value| 2.0 * value).collect();
    let doubled = scaled.unwrap().difference(&doubled).unwrap();
    assert!(norm(&minus(&doubled.change, &solution.change)) < 1e-9 * norm(&solution.change));
}

/// Our objective, `1/2 |J x - d|^2 + lambda TV(x)`, is at most as large for our image as for the reference's, for any
/// weight; with the default weight the same holds for the misfit.
#[test]
fn total_variation_is_no_worse_than_the_reference() {
    let disk = Reference::disk16();
    let pixels = Arc::new(PixelSpace::cells(&disk.mesh, Surface::Plane));
    let model = Linearised::new(&disk.model(), &pixels).unwrap();
    let difference = minus(&disk.column("v_two.csv"), &disk.column("v_homog.csv"));
    let theirs = disk.column("img_TVpdipm_two.csv");
    let default = TotalVariationOptions::default();
    for factor in [1.0, 10.0] {
        let options = TotalVariationOptions { alpha: factor * default.alpha, ..default.clone() };
        let method = TotalVariation::from_linearised(&model, Arc::clone(&pixels), &options).unwrap();
        let weight = method.weight(&difference).unwrap();
        let mut ours = vec![0.0; pixels.len()];
        method.reconstruct_into(&difference, &mut ours).unwrap();
        let of = |image: &[f64]| {
            let (misfit, variation) = (method.misfit(image, &difference), method.variation(image));
            (misfit / norm(&difference), variation, 0.5 * misfit * misfit + weight * variation)
        };
        let (ours, theirs) = (of(&ours), of(&theirs));
        println!("disk16 TV, alpha {}: misfit, TV, objective {ours:?}; reference {theirs:?}", options.alpha);
        assert!(ours.2 <= theirs.2);
        if factor == 1.0 {
            assert!(ours.0 <= theirs.0);
        }
    }
}

/// Frames of small targets, by the full forward model: at noise figure 0.5 and within 0.7 of the radius the amplitude
/// response is uniform within 10 %, and the position is correct within 3 % of the radius.
#[test]
fn greit_is_even_and_right() {
    const EVEN: f64 = 0.1;
    const POSITION: f64 = 0.03;
    const RADIUS: f64 = 0.05;
    const CONTRAST: f64 = 0.1;
    let disk = Reference::disk16();
    let forward = disk.model();
    let design = SkinDesign {
        name: "disk16".into(),
        body: Body::Disk { diameter_m: 2.0 },
        sheet: Sheet {
            kind: dermis::design::SheetKind::Surface,
            conductance: 1.0,
            regions: Vec::new(),
            touch: TouchEffect::ConductanceRises,
        },
        electrodes: Vec::new(),
        protocol: disk.protocol.clone(),
        image: ImageLayout::Grid { rows: 32, columns: 32 },
        mesh: MeshOptions { max_edge_m: 0.1, electrode_edge_m: 0.1, growth: 0.0, correct_arc_ends: false },
        fabrication: None,
    };
    let pixels = Arc::new(PixelSpace::for_design(&design, &disk.mesh).unwrap());
    let greit = Greit::new(&forward, Arc::clone(&pixels), &GreitOptions::default()).unwrap();
    let rest = forward.solve(forward.rest_conductivity()).unwrap();
    let mut figures = Vec::new();
    for (ring, angle) in (0..=7).flat_map(|ring| (0..8).map(move |step| (ring, 0.1 + step as f64 * 0.785))) {
        let distance = 0.1 * ring as f64;
        let target = [distance * f64::cos(angle), distance * f64::sin(angle), 0.0];
        let parts = parts_inside(&disk, target, RADIUS);
        let conductivity: Vec<f64> = parts.iter().map(|part| 1.0 + CONTRAST * part).collect();
        let difference = &forward.solve(&conductivity).unwrap() - &rest;
        let image: Image = greit.reconstruct(&difference).unwrap();
        let strength: f64 =
            parts.iter().enumerate().map(|(cell, part)| CONTRAST * part * disk.mesh.cell_measure(cell)).sum();
        figures.push((distance, figures_of_merit(&image, target, strength).unwrap()));
    }
    let mean = figures.iter().map(|f| f.1.amplitude_response).sum::<f64>() / figures.len() as f64;
    for ring in figures.chunks(8) {
        let worst = |of: &dyn Fn(&dermis::reconstruct::FiguresOfMerit) -> f64| {
            ring.iter().map(|f| of(&f.1)).fold(f64::NEG_INFINITY, f64::max)
        };
        println!(
            "disk16 GREIT at {:.1}: amplitude {:+.1} % of the mean {mean:.3}; at most position error {:.1} %, resolution \
             {:.3}, shape deformation {:.3}, ringing {:.3}",
            ring[0].0,
            100.0 * (worst(&|f| (f.amplitude_response / mean - 1.0).abs())),
            100.0 * worst(&|f| f.position_error_m),
            worst(&|f| f.resolution),
            worst(&|f| f.shape_deformation),
            worst(&|f| f.ringing)
        );
    }
    assert!(figures.iter().all(|f| (f.1.amplitude_response / mean - 1.0).abs() <= EVEN));
    assert!(figures.iter().all(|f| f.1.position_error_m <= POSITION));
}

/// The fraction of each cell within a disc, by 256 points per cell.
fn parts_inside(disk: &Reference, centre: [f64; 3], radius: f64) -> Vec<f64> {
    let part = |cell: usize| {
        let corners: Vec<[f64; 3]> = disk.mesh.cells.corners(cell).iter().map(|&node| disk.mesh.nodes[node]).collect();
        let mut inside = 0;
        for (i, j) in (0..16).flat_map(|i| (0..16).map(move |j| ((i as f64 + 0.5) / 16.0, (j as f64 + 0.5) / 16.0))) {
            // The square folded onto the triangle.
            let (a, b) = if i + j > 1.0 { (1.0 - i, 1.0 - j) } else { (i, j) };
            let at = |axis: usize| a * corners[0][axis] + b * corners[1][axis] + (1.0 - a - b) * corners[2][axis];
            inside += usize::from((at(0) - centre[0]).hypot(at(1) - centre[1]) <= radius);
        }
        inside as f64 / 256.0
    };
    (0..disk.mesh.cell_count()).map(part).collect()
}
