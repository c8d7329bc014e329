use super::*;
use crate::frame::Frame;
use crate::reconstruct::testing::{normal, small};
use crate::reconstruct::{Linearised, OneStep, Prior, Reconstruct, noise_figure};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

const PRIORS: [Prior; 3] = [Prior::Tikhonov, Prior::Noser { exponent: 0.5 }, Prior::Laplace];

fn options(prior: Prior, alpha: Alpha) -> OneStepOptions {
    OneStepOptions { prior, alpha, ..OneStepOptions::default() }
}

/// Differences of a smooth image with white noise, and that image.
fn examples(model: &Linearised, noise: f64, count: usize) -> (Vec<Frame>, Vec<f64>) {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let pixels = model.pixel_count() as f64;
    let truth: Vec<f64> =
        (0..model.pixel_count()).map(|pixel| (-(12.0 * (pixel as f64 / pixels - 0.4)).powi(2)).exp()).collect();
    let mut clean = vec![0.0; model.channel_count()];
    model.jacobian.product_into(&truth, &mut clean);
    let noisy = |_| Frame(clean.iter().map(|value| value + noise * normal(&mut random)).collect());
    ((0..count).map(noisy).collect(), truth)
}

/// The inputs of the rules, by brute force: `|y - J x|^2`, `x'Rx` and `trace(H)` through the complete matrix.
fn by_matrix(model: &Linearised, prior: Prior, alpha: f64, examples: &[Frame]) -> [f64; 3] {
    let (_, pixels) = small(model.channel_count(), model.pixel_count());
    let one_step = OneStep::from_linearised(model, Arc::clone(&pixels), &options(prior, Alpha::Given(alpha))).unwrap();
    let jacobian =
        faer::MatRef::from_row_major_slice(&model.jacobian.values, model.jacobian.rows, model.jacobian.columns);
    let penalty = prior.matrix(jacobian, &pixels).unwrap();
    let matrix = one_step.matrix().unwrap();
    let inverse = faer::MatRef::from_row_major_slice(&matrix.values, matrix.rows, matrix.columns);
    let hat = jacobian * inverse;
    let trace: f64 = (0..hat.nrows()).map(|channel| hat[(channel, channel)]).sum();
    let (mut misfit, mut roughness) = (0.0, 0.0);
    for example in examples {
        let image = one_step.reconstruct(example).unwrap().values;
        let mut explained = vec![0.0; example.len()];
        model.jacobian.product_into(&image, &mut explained);
        misfit += example.iter().zip(&explained).map(|(y, z)| (y - z).powi(2)).sum::<f64>();
        roughness += penalty.apply(&image).iter().zip(&image).map(|(r, x)| r * x).sum::<f64>();
    }
    [misfit, roughness, trace]
}

fn chosen(model: &Linearised, prior: Prior, alpha: Alpha, examples: &[Frame]) -> f64 {
    let (_, pixels) = small(model.channel_count(), model.pixel_count());
    let options = OneStepOptions { examples: examples.to_vec(), ..options(prior, alpha) };
    OneStep::from_linearised(model, pixels, &options).unwrap().alpha()
}

/// Cross-validation chooses the same alpha as brute force over whole matrices.
#[test]
fn cross_validation_agrees_with_brute_force() {
    for (channels, pixels) in [(25, 40), (40, 25)] {
        let (model, _) = small(channels, pixels);
        let (examples, _) = examples(&model, 0.05, 4);
        for prior in PRIORS {
            let alpha = chosen(&model, prior, Alpha::Gcv, &examples);
            let error = |alpha: f64| {
                let [misfit, _, trace] = by_matrix(&model, prior, alpha, &examples);
                misfit / (channels as f64 - trace).powi(2)
            };
            let factors = (-200..=200).map(|step| 1.02_f64.powi(step));
            let best = factors.map(|f| f * alpha).min_by(|&a, &b| error(a).total_cmp(&error(b))).unwrap();
            println!("{} {channels} x {pixels}: GCV alpha {alpha:.4e}, brute force {best:.4e}", prior.name());
            assert!((alpha / best).ln().abs() < 0.021);
        }
    }
}

/// The corner is at the maximum curvature of the curve through brute-force points, by circles through three neighbours.
#[test]
fn the_corner_agrees_with_brute_force() {
    let (model, _) = small(25, 40);
    let (examples, _) = examples(&model, 0.02, 3);
    for prior in PRIORS {
        let alpha = chosen(&model, prior, Alpha::LCurve, &examples);
        let point = |alpha: f64| {
            let [misfit, roughness, _] = by_matrix(&model, prior, alpha, &examples);
            [0.5 * misfit.ln(), 0.5 * roughness.ln()]
        };
        let bend = |alpha: f64| circle(point(alpha / 1.02), point(alpha), point(alpha * 1.02));
        let factors = (-150..=150).map(|step| 1.03_f64.powi(step));
        let best = factors.map(|f| f * alpha).max_by(|&a, &b| bend(a).total_cmp(&bend(b))).unwrap();
        println!("{}: corner at alpha {alpha:.4e}, brute force {best:.4e}", prior.name());
        assert!((alpha / best).ln().abs() < 0.031);
    }
}

/// Curvature of the circle through three points, positive for a left turn.
fn circle(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    let side = |p: [f64; 2], q: [f64; 2]| [q[0] - p[0], q[1] - p[1]];
    let (ab, bc, ac) = (side(a, b), side(b, c), side(a, c));
    2.0 * (ab[0] * bc[1] - ab[1] * bc[0]) / (ab[0].hypot(ab[1]) * bc[0].hypot(bc[1]) * ac[0].hypot(ac[1]))
}

/// With data from the model, the image of cross-validation is nearly as good as that of the best alpha.
#[test]
fn cross_validation_comes_near_the_best_image() {
    let (model, pixels) = small(60, 40);
    let (examples, truth) = examples(&model, 0.05, 8);
    let error = |alpha: Alpha| {
        let options = OneStepOptions { examples: examples.clone(), ..options(Prior::Laplace, alpha) };
        let one_step = OneStep::from_linearised(&model, Arc::clone(&pixels), &options).unwrap();
        let of = |example| one_step.reconstruct(example).unwrap().values;
        let squares = |example| of(example).iter().zip(&truth).map(|(x, t)| (x - t).powi(2)).sum::<f64>();
        examples.iter().map(squares).sum::<f64>().sqrt()
    };
    let best = (-60..40).map(|step| error(Alpha::Given(1.2_f64.powi(step)))).fold(f64::INFINITY, f64::min);
    let ours = error(Alpha::Gcv);
    println!("image error {ours:.4} with cross-validation, {best:.4} with the best alpha");
    assert!(ours < 1.3 * best);
}

/// The alpha found has the requested noise figure.
#[test]
fn the_noise_figure_asked_for_is_met() {
    let (model, pixels) = small(25, 40);
    for prior in PRIORS {
        for wanted in [0.3, 0.5, 1.0] {
            let options = OneStepOptions { target: vec![20, 21], ..options(prior, Alpha::NoiseFigure(wanted)) };
            let one_step = OneStep::from_linearised(&model, Arc::clone(&pixels), &options).unwrap();
            let difference: Vec<f64> =
                (0..25).map(|channel| model.jacobian.at(channel, 20) + model.jacobian.at(channel, 21)).collect();
            let figure = noise_figure(one_step.matrix().unwrap(), &pixels.areas, &difference);
            println!("{} noise figure {wanted}: {figure:.9} at alpha {:.3e}", prior.name(), one_step.alpha());
            assert!((figure / wanted - 1.0).abs() < 2e-6);
        }
    }
}

#[test]
fn rules_that_cannot_choose_say_so() {
    let (model, pixels) = small(10, 15);
    let fails = |options: OneStepOptions| OneStep::from_linearised(&model, Arc::clone(&pixels), &options).unwrap_err();
    let message = |alpha| fails(options(Prior::Tikhonov, alpha)).to_string();
    assert!(message(Alpha::Gcv).contains("give some as examples"));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(message(Alpha::Given(bad)).starts_with("alpha is"), "{bad}");
        assert!(message(Alpha::Absolute(bad)).starts_with("alpha is"), "{bad}");
        assert!(message(Alpha::NoiseFigure(bad)).starts_with("the noise figure is"), "{bad}");
    }
    assert!(message(Alpha::NoiseFigure(1e9)).starts_with("no alpha gives the noise figure"));
    let with = |examples| OneStepOptions { examples, ..options(Prior::Tikhonov, Alpha::Gcv) };
    assert!(matches!(fails(with(vec![Frame(vec![0.0; 3])])), ReconstructError::FrameLength { got: 3, .. }));
    let mut broken = vec![0.0; 10];
    broken[4] = f64::NAN;
    assert!(matches!(fails(with(vec![Frame(broken)])), ReconstructError::NotFinite { channel: 4, .. }));
    let beyond = OneStepOptions { target: vec![15], ..options(Prior::Tikhonov, Alpha::Auto) };
    assert!(fails(beyond).to_string().contains("pixel 15"));
}

/// Disks with few electrodes have an automatic alpha, and the rule contains its noise figure.
#[test]
fn skins_of_few_electrodes_have_an_automatic_alpha() {
    for electrodes in [6, 8, 10] {
        let text = format!(
            "[body.disk]\ndiameter_m = 0.08\n[sheet]\nsheet_resistance_ohm = 1000.0\ntouch = \"conductance_falls\"\n\
             [electrodes]\nshape.arc.length_m = 0.004\ncontact_impedance_ohm_m = 0.01\n[electrodes.layout.rim]\n\
             count = {electrodes}\n[protocol]\npattern = \"adjacent_undriven\"\n[image.grid]\nrows = 12\ncolumns = 12\n"
        );
        let design = crate::design::SkinDesign::parse(&text, "disk.toml").unwrap();
        let mesh = crate::mesh::Mesh::generate(&design).unwrap();
        let forward = crate::forward::ForwardModel::new(&design, &mesh).unwrap();
        let pixels = Arc::new(crate::image::PixelSpace::for_design(&design, &mesh).unwrap());
        let one_step = OneStep::new(&forward, pixels, &OneStepOptions::default()).unwrap();
        println!("{electrodes} electrodes: alpha {:.3e}, {}", one_step.alpha(), one_step.alpha_rule());
        assert!(one_step.alpha().is_finite() && one_step.alpha() > 0.0);
        assert!(one_step.alpha_rule().to_string().starts_with("noise figure "));
    }
}
