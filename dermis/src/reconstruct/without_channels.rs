//! A method that is not told of channels that are broken.

use crate::detect::DetectOptions;
use crate::forward::Matrix;
use crate::image::PixelSpace;
use crate::reconstruct::{Quantity, Reconstruct, ReconstructError};
use std::sync::Arc;

/// A method for a skin of which some channels are broken: it is told of no change in them. A method that is made anew
/// without them does better where that is possible, but a network cannot be.
pub struct WithoutChannels<'a> {
    method: &'a dyn Reconstruct,
    silent: Vec<usize>,
    matrix: Option<Matrix>,
}

impl<'a> WithoutChannels<'a> {
    /// The method without some channels.
    ///
    /// # Panics
    /// Where a linear method has no such channel.
    pub fn new(method: &'a dyn Reconstruct, silent: Vec<usize>) -> Self {
        let mut matrix = method.matrix().cloned();
        if let Some(matrix) = &mut matrix {
            let columns = matrix.columns;
            for row in matrix.values.chunks_exact_mut(columns) {
                silent.iter().for_each(|&channel| row[channel] = 0.0);
            }
        }
        WithoutChannels { method, silent, matrix }
    }
}

impl Reconstruct for WithoutChannels<'_> {
    fn name(&self) -> String {
        self.method.name()
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        self.method.pixels()
    }

    /// As the method does; a copy of the difference is made where channels are broken.
    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        if self.silent.is_empty() {
            return self.method.reconstruct_into(difference, values);
        }
        let mut heard = difference.to_vec();
        for &channel in &self.silent {
            // A difference of another length is the method's to refuse.
            heard.iter_mut().skip(channel).take(1).for_each(|value| *value = 0.0);
        }
        self.method.reconstruct_into(&heard, values)
    }

    fn matrix(&self) -> Option<&Matrix> {
        self.matrix.as_ref()
    }

    fn quantity(&self) -> Quantity {
        self.method.quantity()
    }

    fn detection(&self) -> DetectOptions {
        self.method.detection()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::SkinDesign;
    use crate::forward::ForwardModel;
    use crate::mesh::Mesh;
    use crate::reconstruct::{OneStep, OneStepOptions};

    #[test]
    fn what_a_broken_channel_says_makes_no_difference() {
        let mut design = SkinDesign::shipped("cylinder30").unwrap();
        design.mesh = design.mesh.scaled(2.0);
        let forward = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
        let pixels = Arc::new(PixelSpace::for_design(&design, forward.mesh()).unwrap());
        let method = OneStep::new(&forward, pixels, &OneStepOptions::default()).unwrap();
        let deaf = WithoutChannels::new(&method, vec![3, 500]);
        let difference = |broken: f64| -> Vec<f64> {
            (0..870).map(|channel| if [3, 500].contains(&channel) { broken } else { f64::from(channel % 7) }).collect()
        };
        let image = |method: &dyn Reconstruct, broken: f64| {
            let mut values = vec![0.0; 900];
            method.reconstruct_into(&difference(broken), &mut values).unwrap();
            values
        };
        assert_eq!(image(&deaf, 1e6), image(&method, 0.0));
        assert_ne!(image(&method, 1.0), image(&method, 0.0));
        // The matrix is that of what it does.
        let matrix = deaf.matrix().unwrap();
        let product: f64 = matrix.values[..870].iter().zip(difference(1e6)).map(|(a, b)| a * b).sum();
        assert!((product - image(&deaf, 1e6)[0]).abs() < 1e-9 * product.abs());
        assert!(deaf.reconstruct_into(&[0.0], &mut [0.0]).is_err());
    }
}
