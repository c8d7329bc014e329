use super::*;
use crate::forward::Matrix;
use crate::reconstruct::testing::{rows_of_pixels, small};

/// Relative tolerance of a plateau's shift for smoothing and the end of the iteration.
const SHIFT: f64 = 0.01;

/// With `J = I` and a step between two plateaus of `a` and `b` pixels, total variation of weight `l` moves the plateaus
/// towards each other by `l w / a` and `l w / b` (Strong and Chan 2003, DOI 10.1088/0266-5611/19/6/059).
#[test]
fn a_step_shrinks_by_the_exact_amount() {
    let (low, high) = (12, 8);
    let mut pixels = rows_of_pixels(&[low + high]);
    pixels.areas = vec![1.0; low + high];
    let count = low + high;
    let identity = (0..count * count).map(|at| if at % (count + 1) == 0 { 1.0 } else { 0.0 }).collect();
    let model = Linearised {
        jacobian: Matrix { rows: count, columns: count, values: identity },
        rest_frame: vec![1.0; count],
        rest_conductivity: vec![1.0; count],
    };
    let options = TotalVariationOptions { tolerance: 1e-10, max_iterations: 500, ..Default::default() };
    let method = TotalVariation::from_linearised(&model, Arc::new(pixels), &options).unwrap();
    let step: Vec<f64> = (0..count).map(|pixel| if pixel < low { 0.0 } else { 1.0 }).collect();
    let weight = method.weight(&step).unwrap();
    let mut image = vec![0.0; count];
    method.reconstruct_into(&step, &mut image).unwrap();
    for (pixel, value) in image.iter().enumerate() {
        let expected = if pixel < low { weight / low as f64 } else { 1.0 - weight / high as f64 };
        assert!((value - expected).abs() < SHIFT * weight / low as f64, "{value} {expected}");
    }
}

/// No nearby image has a smaller objective: the problem is convex, so the minimum is global.
#[test]
fn no_image_nearby_is_better() {
    let (model, pixels) = small(15, 25);
    let options = TotalVariationOptions { tolerance: 1e-10, max_iterations: 500, ..Default::default() };
    let method = TotalVariation::from_linearised(&model, pixels, &options).unwrap();
    let truth: Vec<f64> = (0..25).map(|pixel| if (8..14).contains(&pixel) { 1.0 } else { 0.0 }).collect();
    let mut difference = vec![0.0; 15];
    model.jacobian.product_into(&truth, &mut difference);
    let weight = method.weight(&difference).unwrap();
    let mut image = vec![0.0; 25];
    method.reconstruct_into(&difference, &mut image).unwrap();
    let objective = |image: &[f64]| 0.5 * method.misfit(image, &difference).powi(2) + weight * method.variation(image);
    let best = objective(&image);
    for size in [1e-1, 1e-2, 1e-3] {
        for (first, last) in (0..25).flat_map(|first| (first + 1..=25).map(move |last| (first, last))) {
            for sign in [-size, size] {
                let mut moved = image.clone();
                moved[first..last].iter_mut().for_each(|value| *value += sign);
                assert!(objective(&moved) > best * (1.0 - 1e-5), "pixels {first} to {last} by {sign}");
            }
        }
    }
}
