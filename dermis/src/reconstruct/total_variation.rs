//! Total variation: piecewise constant images with sharp edges.

use crate::design::TouchEffect;
use crate::geom::vector::distance;
use crate::image::PixelSpace;
use crate::reconstruct::channels::{Channels, Difference};
use crate::reconstruct::linearised::Linearised;
use crate::reconstruct::prior::{Graph, Penalty};
use crate::reconstruct::system::System;
use crate::reconstruct::{Reconstruct, ReconstructError, alpha, check_lengths};
use std::sync::Arc;

/// Options of a total-variation image.
#[derive(Debug, Clone)]
pub struct TotalVariationOptions {
    /// The weight of the variation, as a fraction of the weight above which no single pixel differs from a uniform
    /// image.
    pub alpha: f64,
    /// Channels that are excluded.
    pub excluded: Vec<usize>,
    /// The sign of the conductance change under touch: images are positive where touched.
    pub touch: TouchEffect,
    /// Maximum number of steps at each smoothing.
    pub max_iterations: usize,
    /// A smoothing ends when a step lowers its objective by less than this fraction of it.
    pub tolerance: f64,
}

impl Default for TotalVariationOptions {
    fn default() -> Self {
        TotalVariationOptions {
            alpha: 0.03,
            excluded: Vec::new(),
            touch: TouchEffect::ConductanceRises,
            max_iterations: 40,
            tolerance: 1e-6,
        }
    }
}

/// The total-variation image of the linear model.
///
/// ```text
/// x = argmin 1/2 |J x - d|^2 + lambda TV(x),    TV(x) = sum over edges w_ij |x_i - x_j|
/// ```
///
/// `w_ij` is the length of the edge between two pixels, computed as their mean area over the distance of their centres,
/// which is exact on a grid. Lagged diffusivity (Vogel and Oman 1996, DOI 10.1137/0917016): `|t|` is smoothed to
/// `sqrt(t^2 + b^2)`, and each step minimises a quadratic upper bound of it; no step raises the objective, and `b`
/// decreases towards zero.
#[derive(Debug, Clone)]
pub struct TotalVariation {
    pixels: Arc<PixelSpace>,
    channels: Channels,
    channel_count: usize,
    /// The smooth problem for the first image; its penalty is the graph with the weights `w`.
    system: System,
    edges: Vec<Vec<(usize, f64)>>,
    options: TotalVariationOptions,
}

impl TotalVariation {
    /// The reconstruction from a linear model.
    ///
    /// # Errors
    /// Options out of their range, lists that do not match, pixels that share only a single point.
    pub fn from_linearised(
        model: &Linearised,
        pixels: Arc<PixelSpace>,
        options: &TotalVariationOptions,
    ) -> Result<Self, ReconstructError> {
        model.validate(&pixels)?;
        alpha::positive("alpha", options.alpha)?;
        alpha::positive("the tolerance", options.tolerance)?;
        let channels = Channels::new(model, Difference::Plain, &options.excluded, &[])?;
        let graph = Graph::new(&pixels.neighbours, |a, b| {
            0.5 * (pixels.areas[a] + pixels.areas[b]) / distance(pixels.centres_m[a], pixels.centres_m[b])
        })?;
        let edges = graph.edges().to_vec();
        if edges.iter().flatten().any(|edge| !edge.1.is_finite()) {
            return Err(ReconstructError::Parameter("two neighbouring pixels have the same centre".into()));
        }
        let system = System::new(channels.jacobian(model, &channels.scale, false), Penalty::Graph(graph))?;
        let (options, channel_count) = (options.clone(), model.channel_count());
        Ok(TotalVariation { pixels, channels, channel_count, system, edges, options })
    }

    /// `TV(x)`.
    pub fn variation(&self, image: &[f64]) -> f64 {
        self.sum_over_edges(image, f64::abs)
    }

    /// `|J x - d|`, ohm.
    pub fn misfit(&self, image: &[f64], difference: &[f64]) -> f64 {
        self.misfit_of(image, &self.channels.gather(difference))
    }

    /// `lambda` for a difference: alpha times the weight above which no single pixel differs from a uniform image.
    ///
    /// # Errors
    /// A difference of the wrong length or with a value that is not finite; a Jacobian without sensitivity.
    pub fn weight(&self, difference: &[f64]) -> Result<f64, ReconstructError> {
        check_lengths(difference, self.channel_count, &[], 0)?;
        self.weight_of(&self.channels.gather(difference))
    }

    fn weight_of(&self, data: &[f64]) -> Result<f64, ReconstructError> {
        let flat = self.flat(data)?;
        let explained = self.system.jacobian() * faer::ColRef::from_slice(&flat);
        let rest: Vec<f64> = data.iter().zip(explained.iter()).map(|(d, e)| d - e).collect();
        let pull = self.system.jacobian().transpose() * faer::ColRef::from_slice(&rest);
        let around = |edges: &Vec<(usize, f64)>| edges.iter().map(|edge| edge.1).sum::<f64>();
        let steepest = pull.iter().zip(&self.edges).map(|(pull, edges)| pull.abs() / around(edges));
        let steepest = steepest.filter(|value| value.is_finite()).fold(0.0, f64::max);
        Ok(self.options.alpha * steepest)
    }

    /// The best uniform image: the limit of an infinite weight.
    fn flat(&self, data: &[f64]) -> Result<Vec<f64>, ReconstructError> {
        self.system.solve(data, 1e6 * self.system.scale()?)
    }

    fn sum_over_edges(&self, image: &[f64], of_step: impl Fn(f64) -> f64) -> f64 {
        let lists = self.edges.iter().enumerate();
        // Each edge is in the lists of both its pixels.
        lists
            .flat_map(|(a, edges)| edges.iter().map(move |&(b, w)| (a, b, w)))
            .filter(|&(a, b, _)| a < b)
            .fold(0.0, |sum, (a, b, weight)| sum + weight * of_step(image[a] - image[b]))
    }

    fn misfit_of(&self, image: &[f64], data: &[f64]) -> f64 {
        let explained = self.system.jacobian() * faer::ColRef::from_slice(image);
        data.iter().zip(explained.iter()).map(|(d, e)| (d - e).powi(2)).sum::<f64>().sqrt()
    }

    /// Lagged diffusivity; the smoothing decreases by factors of ten from the largest step of a first image.
    fn minimise(&self, data: &[f64]) -> Result<Vec<f64>, ReconstructError> {
        /// Smoothings below a millionth of the image's steps have no relevant effect.
        const SMOOTHINGS: i32 = 6;
        let weight = self.weight_of(data)?;
        let Penalty::Graph(mut graph) = self.system.penalty().clone() else { unreachable!("made from a graph") };
        let mut image = self.flat(data)?;
        if weight == 0.0 {
            return Ok(image);
        }
        let mut system = self.system.clone();
        let start = system.solve(data, 1e-3 * system.scale()?)?;
        let largest = self.edges.iter().enumerate().flat_map(|(a, edges)| edges.iter().map(move |edge| (a, edge.0)));
        let largest = largest.map(|(a, b)| (start[a] - start[b]).abs()).fold(0.0, f64::max);
        for decade in 0..=SMOOTHINGS {
            let smoothing = largest * 10.0_f64.powi(-decade);
            let mut previous = f64::INFINITY;
            for _ in 0..self.options.max_iterations {
                let edge_weight = self.edge_weights(&image, weight, smoothing);
                graph.reweigh(edge_weight);
                system.set_penalty(Penalty::Graph(graph.clone()))?;
                image = system.solve(data, 1.0)?;
                let variation = self.sum_over_edges(&image, |step| step.hypot(smoothing));
                let objective = 0.5 * self.misfit_of(&image, data).powi(2) + weight * variation;
                if previous - objective <= self.options.tolerance * objective {
                    break;
                }
                previous = objective;
            }
        }
        Ok(image)
    }

    /// The weight of each edge in the quadratic upper bound of the smoothed variation that touches it at an image.
    fn edge_weights<'a>(&'a self, image: &'a [f64], weight: f64, smoothing: f64) -> impl Fn(usize, usize) -> f64 + 'a {
        move |a, b| {
            let length = self.edges[a].iter().find(|edge| edge.0 == b).map_or(0.0, |edge| edge.1);
            weight * length / (image[a] - image[b]).hypot(smoothing)
        }
    }
}

impl Reconstruct for TotalVariation {
    fn name(&self) -> String {
        "total variation".into()
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        &self.pixels
    }

    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        check_lengths(difference, self.channel_count, values, self.pixels.len())?;
        let image = self.minimise(&self.channels.gather(difference))?;
        let sign = self.options.touch.sign();
        values.iter_mut().zip(&image).for_each(|(value, x)| *value = sign * x);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
