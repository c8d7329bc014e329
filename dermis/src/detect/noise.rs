//! The noise of images, from the noise of frames or from images of the untouched skin.

use crate::forward::Matrix;
use crate::geom::vector::{Point3, add, dot, scale};
use crate::image::Image;
use crate::stats::upper_median;
use serde::{Deserialize, Serialize};

/// The highest value of some images of noise counts as this many standard deviations: a contact exceeds it by a quarter, with
/// the detector's usual factor of 5.
const PEAK_SD: f64 = 4.0;

/// The noise of images: the response of the pixels to independent sources of unit variance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImageNoise {
    /// Pixels x sources.
    spread: Matrix,
    /// Standard deviation of each pixel.
    sd: Vec<f64>,
}

impl ImageNoise {
    /// The noise of a linear reconstruction's images, from its matrix (pixels x channels) and the standard deviation of
    /// each channel's noise in a difference: `sd_p^2 = sum_c (B_pc s_c)^2`.
    ///
    /// # Panics
    /// If the number of standard deviations differs from the number of channels.
    pub fn from_matrix(matrix: &Matrix, channel_sd_ohm: &[f64]) -> Self {
        assert_eq!(matrix.columns, channel_sd_ohm.len(), "a standard deviation per channel");
        let mut values = matrix.values.clone();
        for row in values.chunks_exact_mut(matrix.columns) {
            row.iter_mut().zip(channel_sd_ohm).for_each(|(value, sd)| *value *= sd);
        }
        Self::new(Matrix { rows: matrix.rows, columns: matrix.columns, values })
    }

    /// The noise of any reconstruction's images, from images of untouched frames (their true mean is zero); `None`
    /// without an image. Twenty images give each standard deviation to a sixth.
    ///
    /// No pixel's standard deviation is less than the root mean square of all pixels: a network's pixel that is nearly
    /// always zero has rare peaks as high as its neighbours', which its own deviation does not show.
    ///
    /// # Panics
    /// If the images differ in length.
    pub fn from_untouched(images: &[Image]) -> Option<Self> {
        let pixels = images.first()?.values.len();
        let scale = 1.0 / (images.len() as f64).sqrt();
        let mut values = vec![0.0; pixels * images.len()];
        for (source, image) in images.iter().enumerate() {
            assert_eq!(image.values.len(), pixels, "images of one skin");
            for (pixel, value) in image.values.iter().enumerate() {
                values[pixel * images.len() + source] = value * scale;
            }
        }
        let mut noise = Self::new(Matrix { rows: pixels, columns: images.len(), values });
        let least = (noise.sd.iter().map(|sd| sd * sd).sum::<f64>() / pixels.max(1) as f64).sqrt();
        noise.sd.iter_mut().for_each(|sd| *sd = sd.max(least));
        Some(noise)
    }

    /// The same where the highest value of these images is no contact either: a network's rare peaks on noise are not normal.
    #[must_use]
    pub(crate) fn above_peaks(mut self, images: &[Image]) -> Self {
        let highest = images.iter().flat_map(|image| &image.values).copied().fold(0.0, f64::max);
        self.sd.iter_mut().for_each(|sd| *sd = sd.max(highest / PEAK_SD));
        self
    }

    fn new(spread: Matrix) -> Self {
        let norm = |row: &[f64]| row.iter().map(|value| value * value).sum::<f64>().sqrt();
        let sd = spread.values.chunks_exact(spread.columns.max(1)).map(norm).collect();
        ImageNoise { spread, sd }
    }

    /// Standard deviation of each pixel's noise.
    pub fn sd(&self) -> &[f64] {
        &self.sd
    }

    /// Number of pixels.
    pub fn pixel_count(&self) -> usize {
        self.sd.len()
    }

    /// Variance per axis of the centroid `c = sum w_p x_p / W` of some pixels, with the weights
    /// `w_p = a_p (v_p - floor)`, the floor a part f of the peak: by the first derivatives
    /// `dc = sum_p a_p (x_p - c) / W (dv_p - f dv_peak)`.
    pub(super) fn centroid_variance_m2(
        &self,
        image: &Image,
        inside: &[usize],
        peak: usize,
        floor: f64,
        centroid: Point3,
    ) -> f64 {
        let space = &image.space;
        let fraction = floor / image.values[peak];
        let total: f64 = inside.iter().map(|&p| (image.values[p] - floor) * space.areas[p]).sum();
        let mut gradient = vec![[0.0; 3]; self.spread.columns];
        let mut add_row = |pixel: usize, factor: Point3| {
            let row = &self.spread.values[pixel * self.spread.columns..][..self.spread.columns];
            for (sum, value) in gradient.iter_mut().zip(row) {
                *sum = add(*sum, scale(factor, *value));
            }
        };
        let mut together = [0.0; 3];
        for &pixel in inside {
            let factor = scale(space.surface.step(centroid, space.centres_m[pixel]), space.areas[pixel] / total);
            together = add(together, factor);
            add_row(pixel, factor);
        }
        add_row(peak, scale(together, -fraction));
        0.5 * gradient.iter().map(|&g| dot(g, g)).sum::<f64>()
    }
}

/// The standard deviation of white noise of the same roughness as the image: 1.4826 times the median of
/// `|v - mean of its n neighbours| / sqrt(1 + 1/n)`. A contact covers few pixels and hardly changes the median.
pub(super) fn roughness(image: &Image) -> f64 {
    let deviation = |(pixel, around): (usize, &Vec<usize>)| {
        let count = around.len() as f64;
        let mean = around.iter().map(|&other| image.values[other]).sum::<f64>() / count;
        (image.values[pixel] - mean).abs() / (1.0 + 1.0 / count).sqrt()
    };
    let deviations: Vec<f64> = (image.space.neighbours.iter().enumerate())
        .filter(|(_, around)| !around.is_empty())
        .map(deviation)
        .filter(|deviation| deviation.is_finite())
        .collect();
    1.4826 * upper_median(&deviations).unwrap_or(0.0)
}
