use super::*;
use crate::forward::Matrix;
use crate::reconstruct::testing::{blurring, grid_of_pixels, small};
use gradients::norm;

/// The variation of an image of pixels that are sampled from a function.
fn variation_of(pixels: &PixelSpace, function: impl Fn([f64; 3]) -> f64) -> f64 {
    let image: Vec<f64> = pixels.centres_m.iter().map(|&centre| function(centre)).collect();
    let gradients = Gradients::new(pixels).unwrap();
    let mut field = vec![0.0; gradients.len()];
    gradients.apply_into(&image, &mut field);
    gradients.norms(&field).sum()
}

/// `exp(-r^2 / 2 s^2)` has the variation `2 pi integral r |f'| dr = 2 pi s sqrt(pi / 2)`; differences of second order
/// approach it with the square of the pixel size.
#[test]
fn the_variation_of_a_gaussian_converges_at_second_order() {
    const RATE: f64 = 1.9;
    let exact = std::f64::consts::TAU * 0.1 * (std::f64::consts::PI / 2.0).sqrt();
    let errors = [40, 80, 160].map(|count| {
        let pixels = grid_of_pixels([count, count], 1.0 / (count - 1) as f64, false);
        let of = |[x, y, _]: [f64; 3]| (-((x - 0.5).powi(2) + (y - 0.5).powi(2)) / (2.0 * 0.01)).exp();
        (variation_of(&pixels, of) / exact - 1.0).abs()
    });
    let rates = [(errors[0] / errors[1]).log2(), (errors[1] / errors[2]).log2()];
    println!("relative errors {errors:?}, rates {rates:?}");
    assert!(rates.iter().all(|&rate| rate > RATE), "{errors:?}");
}

/// A straight edge through a grid at any angle has the same variation within 9 %: with a slope of m from 0 to 1, m of
/// the columns have a pixel with two steps on either side and the rest one, `(2 m + sqrt(2) (1 - m)) / sqrt(1 + m^2)`
/// per length, from `sqrt(2)` to 1.53. The sum of the steps along both axes differs by 41 %.
#[test]
fn an_edge_at_any_angle_has_the_same_variation() {
    const SAME: f64 = 0.09;
    let size_m = 1.0 / 200.0;
    let pixels = grid_of_pixels([200, 200], size_m, false);
    // Within a disc, so that every edge has the same length; the rest has no steps.
    let lengths: Vec<f64> = (0..16)
        .map(|step| {
            let (sin, cos) = (0.02 + std::f64::consts::TAU * step as f64 / 16.0).sin_cos();
            let inside = |x: f64, y: f64| x.hypot(y) < 0.45;
            let of = |[x, y, _]: [f64; 3]| {
                let (x, y) = (x - 0.4975, y - 0.4975);
                f64::from(u8::from(inside(x, y) && cos * x + sin * y > 0.0))
            };
            variation_of(&pixels, of)
        })
        .collect();
    let (least, most) = lengths.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), &v| (a.min(v), b.max(v)));
    println!("from {least:.4} to {most:.4}");
    assert!(most / least < 1.0 + SAME);
}

fn identity(count: usize) -> Linearised {
    Linearised {
        jacobian: Matrix {
            rows: count,
            columns: count,
            values: (0..count * count).map(|at| f64::from(u8::from(at % (count + 1) == 0))).collect(),
        },
        rest_frame: vec![1.0; count],
        rest_conductivity: vec![1.0; count],
    }
}

/// With `J = I` and two closed rows of n pixels at 0 and 1, the minimum has, being unique, their symmetry: two constants
/// with a step `t` between them, in the `2 n` gradients `t / sqrt(2)` of which lies the variation. The rows move towards
/// each other by `sqrt(2)` times the weight.
#[test]
fn two_rings_move_by_the_exact_amount() {
    const SHIFT: f64 = 1e-6;
    let pixels = grid_of_pixels([2, 9], 1.0, true);
    let options = TotalVariationOptions { alpha: 0.2, tolerance: 1e-12, max_iterations: 5000, ..Default::default() };
    let method = TotalVariation::from_linearised(&identity(18), Arc::new(pixels), &options).unwrap();
    let rows: Vec<f64> = (0..18).map(|pixel| if pixel < 9 { 0.0 } else { 1.0 }).collect();
    let shift = std::f64::consts::SQRT_2 * method.weight(&rows).unwrap();
    assert!(shift > 0.01);
    let mut image = vec![0.0; 18];
    method.reconstruct_into(&rows, &mut image).unwrap();
    for (value, row) in image.iter().zip(&rows) {
        assert!((value - (row + shift * (1.0 - 2.0 * row))).abs() < SHIFT, "{value}, shift {shift}");
    }
}

fn objective(method: &TotalVariation, image: &[f64], difference: &[f64]) -> f64 {
    let weight = method.weight(difference).unwrap();
    0.5 * method.misfit(image, difference).powi(2) + weight * method.variation(image)
}

/// A block on a grid, seen through a smoothing Jacobian.
fn block_on_a_grid() -> (Linearised, Arc<PixelSpace>, Vec<f64>) {
    let pixels = grid_of_pixels([8, 9], 1.0, false);
    let model = blurring(40, 72, 3);
    let truth: Vec<f64> =
        (0..72).map(|at| f64::from(u8::from((2..5).contains(&(at / 9)) && (3..7).contains(&(at % 9))))).collect();
    let mut difference = vec![0.0; 40];
    model.jacobian.product_into(&truth, &mut difference);
    difference.iter_mut().enumerate().for_each(|(channel, value)| *value += 0.02 * (7.0 * channel as f64).sin());
    (model, Arc::new(pixels), difference)
}

/// An independent method for the same problem: the primal-dual algorithm of Chambolle and Pock 2011
/// (DOI 10.1007/s10851-010-0251-1, algorithm 1), with both terms in the dual.
fn primal_dual(method: &TotalVariation, difference: &[f64], iterations: usize) -> Vec<f64> {
    let (jacobian, gradients) = (&method.jacobian, &method.gradients);
    let weight = method.weight(difference).unwrap();
    let count = jacobian.ncols();
    // |J|^2 + |D|^2 by the Frobenius norm and the largest sum of a row of D'D, twice its diagonal.
    let steepest = gradients.of_single_pixels().iter().fold(0.0, |a: f64, &b| a.max(b));
    let bound = (jacobian.squared_norm_l2() + 2.0 * steepest * steepest).sqrt();
    let size = 0.99 / bound;
    let (mut image, mut ahead) = (vec![0.0; count], vec![0.0; count]);
    let (mut residual, mut flux) = (vec![0.0; difference.len()], vec![0.0; gradients.len()]);
    let (mut field, mut spread) = (flux.clone(), image.clone());
    for _ in 0..iterations {
        let explained = jacobian * faer::ColRef::from_slice(&ahead);
        for (value, (explained, data)) in residual.iter_mut().zip(explained.iter().zip(difference)) {
            *value = (*value + size * (explained - data)) / (1.0 + size);
        }
        gradients.apply_into(&ahead, &mut field);
        flux.iter_mut().zip(&field).for_each(|(flux, value)| *flux += size * value);
        let mut beyond = flux.clone();
        gradients.shrink(&mut beyond, weight);
        flux.iter_mut().zip(&beyond).for_each(|(flux, beyond)| *flux -= beyond);
        gradients.transposed_into(&flux, &mut spread);
        let pull = jacobian.transpose() * faer::ColRef::from_slice(&residual);
        for ((value, ahead), (pull, spread)) in image.iter_mut().zip(&mut ahead).zip(pull.iter().zip(&spread)) {
            let next = *value - size * (pull + spread);
            (*ahead, *value) = (2.0 * next - *value, next);
        }
    }
    image
}

#[test]
fn an_independent_method_finds_no_smaller_objective() {
    const TOLERANCE: f64 = 1e-6;
    let (model, pixels, difference) = block_on_a_grid();
    for alpha in [0.1, 0.01] {
        let options =
            TotalVariationOptions { alpha, tolerance: TOLERANCE, max_iterations: 20_000, ..Default::default() };
        let method = TotalVariation::from_linearised(&model, Arc::clone(&pixels), &options).unwrap();
        let minimum = method.minimise(&difference);
        let ours = objective(&method, &minimum.image, &difference);
        let theirs = objective(&method, &primal_dual(&method, &difference, 100_000), &difference);
        println!("alpha {alpha}: objective {ours:.9e}, gap {:.1e}; primal-dual {theirs:.9e}", minimum.gap);
        assert!(minimum.gap <= TOLERANCE);
        assert!(ours <= theirs * (1.0 + TOLERANCE), "{ours} {theirs}");
        // The bound is one: the other method does not fall below it.
        assert!(theirs >= ours * (1.0 - minimum.gap) - TOLERANCE * ours);
    }
}

/// No nearby image has a smaller objective: the problem is convex, so the minimum is global.
#[test]
fn no_image_nearby_is_better() {
    let (model, pixels) = small(15, 25);
    let options = TotalVariationOptions { alpha: 0.03, tolerance: 1e-8, max_iterations: 50_000, ..Default::default() };
    let method = TotalVariation::from_linearised(&model, pixels, &options).unwrap();
    let truth: Vec<f64> = (0..25).map(|pixel| if (8..14).contains(&pixel) { 1.0 } else { 0.0 }).collect();
    let mut difference = vec![0.0; 15];
    model.jacobian.product_into(&truth, &mut difference);
    let mut image = vec![0.0; 25];
    method.reconstruct_into(&difference, &mut image).unwrap();
    let best = objective(&method, &image, &difference);
    for size in [1e-1, 1e-2, 1e-3] {
        for (first, last) in (0..25).flat_map(|first| (first + 1..=25).map(move |last| (first, last))) {
            for sign in [-size, size] {
                let mut moved = image.clone();
                moved[first..last].iter_mut().for_each(|value| *value += sign);
                assert!(
                    objective(&method, &moved, &difference) > best * (1.0 - 1e-5),
                    "pixels {first} to {last} by {sign}"
                );
            }
        }
    }
}

/// Differences that no image explains, and none at all, give an image without variation.
#[test]
fn nothing_to_see_is_a_uniform_image() {
    let (model, pixels, _) = block_on_a_grid();
    let method = TotalVariation::from_linearised(&model, pixels, &Default::default()).unwrap();
    let mut image = vec![1.0; 72];
    method.reconstruct_into(&[0.0; 40], &mut image).unwrap();
    assert!(norm(&image) < 1e-12);
}

#[test]
fn a_part_that_no_channel_sees_is_an_error() {
    let mut pixels = grid_of_pixels([1, 12], 1.0, false);
    pixels.neighbours[5].retain(|&other| other != 6);
    pixels.neighbours[6].retain(|&other| other != 5);
    let mut model = blurring(8, 12, 1);
    (0..8).for_each(|channel| (6..12).for_each(|pixel| *model.jacobian.at_mut(channel, pixel) = 0.0));
    let error = TotalVariation::from_linearised(&model, Arc::new(pixels), &Default::default()).unwrap_err();
    assert!(error.to_string().contains("seen by no channel"), "{error}");
}
