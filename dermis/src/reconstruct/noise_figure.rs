//! The noise figure: the ratio of the signal-to-noise ratios of frame and image.

use crate::forward::Matrix;
use crate::image::PixelSpace;
use faer::MatRef;

/// The noise figure of a linear reconstruction for a small target (Graham and Adler 2006,
/// DOI 10.1088/0967-3334/27/5/S06; Adler and Guardo 1996), as EIDORS computes it.
///
/// ```text
/// NF = SNR_frame / SNR_image
/// SNR_frame = mean |y|     / mean_k std(e_k)
/// SNR_image = mean |A M y| / mean_k std(A M e_k)
/// ```
///
/// `y` is the difference caused by the target, `e_k` a unit of noise in channel `k` only, `M` the matrix, `A` the areas
/// of the pixels; means and standard deviations (with n - 1) are over the values of a frame or the pixels of an image.
///
/// # Panics
/// If the sizes of the matrix, the areas and the difference do not match.
pub fn noise_figure(matrix: &Matrix, areas: &[f64], difference: &[f64]) -> f64 {
    let Matrix { rows, columns, ref values } = *matrix;
    assert_eq!((rows, columns), (areas.len(), difference.len()), "pixels and channels of the matrix");
    of_matrix(MatRef::from_row_major_slice(values, rows, columns), areas, difference)
}

/// [`noise_figure`] of any matrix.
pub(crate) fn of_matrix(matrix: MatRef<'_, f64>, areas: &[f64], difference: &[f64]) -> f64 {
    let (pixels, channels) = (matrix.nrows() as f64, matrix.ncols() as f64);
    let mut image = vec![0.0; areas.len()];
    let mut image_noise = 0.0;
    for (channel, &value) in difference.iter().enumerate() {
        let (mut sum, mut square_sum) = (0.0, 0.0);
        for (pixel, &area) in areas.iter().enumerate() {
            let response = area * matrix[(pixel, channel)];
            sum += response;
            square_sum += response * response;
            image[pixel] += response * value;
        }
        image_noise += (((square_sum - sum * sum / pixels) / (pixels - 1.0)).max(0.0)).sqrt() / channels;
    }
    // A unit vector of n values has the mean 1/n and the sum of squares 1: its standard deviation is sqrt(1/n).
    let frame_noise = (1.0 / channels).sqrt();
    let frame_signal = difference.iter().map(|value| value.abs()).sum::<f64>() / channels;
    let image_signal = image.iter().map(|value| value.abs()).sum::<f64>() / pixels;
    (frame_signal / frame_noise) / (image_signal / image_noise)
}

/// The default target: the pixel with the smallest sensitivity per area, with its neighbours.
pub(crate) fn least_seen(jacobian: MatRef<'_, f64>, pixels: &PixelSpace) -> Vec<usize> {
    let density = |pixel: usize| jacobian.col(pixel).norm_l2() / pixels.areas[pixel];
    let least = (0..pixels.len()).min_by(|&a, &b| density(a).total_cmp(&density(b)));
    let mut target: Vec<usize> = least.into_iter().collect();
    target.extend(least.iter().flat_map(|&pixel| &pixels.neighbours[pixel]));
    target
}
