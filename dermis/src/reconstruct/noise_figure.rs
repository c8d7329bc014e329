//! The noise figure: the ratio of the signal-to-noise ratios of frame and image.

use crate::forward::Matrix;
use crate::image::PixelSpace;
use crate::reconstruct::system::Modes;
use faer::{ColRef, Mat, MatRef};

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

/// [`of_matrix`] of a one-step matrix for any `mu`, without the matrix.
///
/// The matrix is `P diag(g) C'` with the [`Modes`], so the sum over the pixels of its column `k`, times the areas, is
/// `s'c` and the sum of squares `c'G c`, with `c = diag(g) C'e_k`, `s = P'a` and `G = P' diag(a)^2 P`.
pub(crate) struct ByModes<'a> {
    modes: Modes,
    areas: &'a [f64],
    /// `s`.
    sums: Vec<f64>,
    /// `G`.
    squares: Mat<f64>,
    difference: &'a [f64],
}

impl<'a> ByModes<'a> {
    pub(crate) fn new(modes: Modes, areas: &'a [f64], difference: &'a [f64]) -> Self {
        let pixels = &modes.pixels;
        let weighted = Mat::from_fn(pixels.nrows(), pixels.ncols(), |pixel, mode| areas[pixel] * pixels[(pixel, mode)]);
        let sums = (0..weighted.ncols()).map(|mode| weighted.col(mode).iter().sum()).collect();
        ByModes { squares: weighted.transpose() * &weighted, sums, modes, areas, difference }
    }

    pub(crate) fn at(&self, mu: f64) -> f64 {
        let gains: Vec<f64> = self.modes.gains(mu).collect();
        let channels = &self.modes.channels;
        let columns =
            Mat::from_fn(gains.len(), channels.nrows(), |mode, channel| gains[mode] * channels[(channel, mode)]);
        let spread = &self.squares * &columns;
        let (pixel_count, channel_count) = (self.areas.len() as f64, channels.nrows() as f64);
        let variance = |channel: usize| {
            let column = columns.col(channel);
            let sum: f64 = column.iter().zip(&self.sums).map(|(c, s)| c * s).sum();
            let square: f64 = column.iter().zip(spread.col(channel).iter()).map(|(c, g)| c * g).sum();
            ((square - sum * sum / pixel_count) / (pixel_count - 1.0)).max(0.0)
        };
        let image_noise = (0..channels.nrows()).map(|channel| variance(channel).sqrt()).sum::<f64>() / channel_count;
        let image = &self.modes.pixels * (&columns * ColRef::from_slice(self.difference));
        let amplitude =
            image.iter().zip(self.areas).map(|(value, area)| (value * area).abs()).sum::<f64>() / pixel_count;
        let frame = self.difference.iter().map(|value| value.abs()).sum::<f64>() / channel_count.sqrt();
        frame / (amplitude / image_noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::Prior;
    use crate::reconstruct::system::System;
    use crate::reconstruct::testing::{blurring, rows_of_pixels};

    /// Over the range of `mu` of a search; a pair of equal channels gives an eigenvalue of zero.
    #[test]
    fn by_modes_it_equals_that_of_the_matrix() {
        const SAME: f64 = 1e-8;
        for pieces in [vec![30], vec![9, 21]] {
            let pixels = rows_of_pixels(&pieces);
            let mut model = blurring(12, 30, 3).jacobian;
            (0..30).for_each(|pixel| *model.at_mut(7, pixel) = model.at(2, pixel));
            let jacobian = MatRef::from_row_major_slice(&model.values, 12, 30).to_owned();
            let difference: Vec<f64> = (0..12).map(|channel| jacobian[(channel, 4)] + jacobian[(channel, 5)]).collect();
            for prior in [Prior::Tikhonov, Prior::default(), Prior::Laplace] {
                let penalty = prior.matrix(jacobian.as_ref(), &pixels).unwrap();
                let system = System::new(jacobian.clone(), penalty).unwrap();
                let modes = Modes::new(&system.data_form().unwrap()).unwrap();
                let figure = ByModes::new(modes, &pixels.areas, &difference);
                for power in -4..=2 {
                    let mu = 10.0_f64.powi(power) * system.scale().unwrap();
                    let expected = of_matrix(system.inverse(mu).unwrap().as_ref(), &pixels.areas, &difference);
                    assert!(
                        (figure.at(mu) / expected - 1.0).abs() < SAME,
                        "{prior:?} {mu:e}: {}, {expected}",
                        figure.at(mu)
                    );
                }
            }
        }
    }
}
