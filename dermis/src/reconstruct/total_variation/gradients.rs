//! The gradient of an image in each pixel, and its total variation.

use crate::geom::vector::distance;
use crate::image::PixelSpace;
use crate::reconstruct::ReconstructError;
use crate::reconstruct::prior::Graph;

/// The steps from each pixel to its neighbours, weighted so that their squares sum to `(A_p |grad x|_p)^2`:
///
/// ```text
/// g_pq = sqrt(A_p A_pq / 2) (x_p - x_q) / d_pq
/// ```
///
/// with the areas `A_p` of the pixels, the mean `A_pq` of two and the distance `d_pq` of their centres. On a grid each
/// axis has two neighbours, so the sum over q is the mean of both differences squared.
#[derive(Debug, Clone)]
pub(super) struct Gradients {
    /// For each pixel the position of its first step; then their number.
    first: Vec<usize>,
    other: Vec<usize>,
    weight: Vec<f64>,
}

impl Gradients {
    pub(super) fn new(pixels: &PixelSpace) -> Result<Self, ReconstructError> {
        let mut gradients = Gradients { first: vec![0], other: Vec::new(), weight: Vec::new() };
        for (pixel, neighbours) in pixels.neighbours.iter().enumerate() {
            for &other in neighbours {
                let (own, mean) = (pixels.areas[pixel], 0.5 * (pixels.areas[pixel] + pixels.areas[other]));
                gradients.other.push(other);
                let weight = (0.5 * own * mean).sqrt() / distance(pixels.centres_m[pixel], pixels.centres_m[other]);
                gradients.weight.push(weight);
            }
            gradients.first.push(gradients.other.len());
        }
        if gradients.weight.iter().any(|weight| !weight.is_finite()) {
            return Err(ReconstructError::Parameter("two neighbouring pixels have the same centre".into()));
        }
        Ok(gradients)
    }

    /// Number of steps.
    pub(super) fn len(&self) -> usize {
        self.other.len()
    }

    /// The steps of each pixel, as positions in a field.
    fn pixels(&self) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        self.first.windows(2).map(|pair| pair[0]..pair[1])
    }

    /// `g = D x`.
    pub(super) fn apply_into(&self, image: &[f64], field: &mut [f64]) {
        for (pixel, steps) in self.pixels().enumerate() {
            for step in steps {
                field[step] = self.weight[step] * (image[pixel] - image[self.other[step]]);
            }
        }
    }

    /// `D' g`.
    pub(super) fn transposed_into(&self, field: &[f64], image: &mut [f64]) {
        image.fill(0.0);
        for (pixel, steps) in self.pixels().enumerate() {
            for step in steps {
                let value = self.weight[step] * field[step];
                image[pixel] += value;
                image[self.other[step]] -= value;
            }
        }
    }

    /// `|g|` in each pixel.
    pub(super) fn norms<'a>(&'a self, field: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        self.pixels().map(|steps| norm(&field[steps]))
    }

    /// `g (1 - size / |g|)` in each pixel, zero where `|g|` is smaller than `size`: the proximal operator of `size |g|`.
    pub(super) fn shrink(&self, field: &mut [f64], size: f64) {
        for steps in self.pixels() {
            let length = norm(&field[steps.clone()]);
            let factor = if length > size { 1.0 - size / length } else { 0.0 };
            field[steps].iter_mut().for_each(|value| *value *= factor);
        }
    }

    /// The total variation of an image that is one in a single pixel and zero elsewhere, for each pixel.
    pub(super) fn of_single_pixels(&self) -> Vec<f64> {
        let mut sums: Vec<f64> = self.pixels().map(|steps| norm(&self.weight[steps])).collect();
        for (&other, weight) in self.other.iter().zip(&self.weight) {
            sums[other] += weight;
        }
        sums
    }

    /// `D'D`: a graph's Laplacian.
    pub(super) fn laplacian(&self, neighbours: &[Vec<usize>]) -> Result<Graph, ReconstructError> {
        let square = |from: usize, to: usize| {
            let steps = self.first[from]..self.first[from + 1];
            steps.filter(|&step| self.other[step] == to).map(|step| self.weight[step].powi(2)).sum::<f64>()
        };
        Graph::new(neighbours, |a, b| square(a, b) + square(b, a))
    }
}

/// The Euclidean norm.
pub(super) fn norm(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}
