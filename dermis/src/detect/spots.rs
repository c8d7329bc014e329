//! Touches in images in which every touch is a spot of the same shape.
//!
//! The square root of such an image is a sum of Gaussians of one known width. The spots are found one after the other
//! at the maximum of the residual, and after each one all are fitted again (orthogonal matching pursuit: Pati,
//! Rezaiifar and Krishnaprasad, 1993, DOI 10.1109/ACSSC.1993.342465). A spot that is clipped by the skin's edge is
//! located as well as a whole one; a centroid would be biased inwards.

use crate::geom::vector::{cross, dot};
use crate::geom::{Point3, Surface};
use crate::image::{Image, PixelSpace};

/// One spot: `height exp(-d^2 / (2 width^2))` in the square root of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spot {
    /// The pixel where it was found.
    pub pixel: usize,
    /// Its position.
    pub centre_m: Point3,
    /// Its height.
    pub height: f64,
}

/// Maximum number of rounds in which all spots are fitted in turn after each new one.
const ROUNDS: usize = 4;
/// The rounds end when no spot changes by more than this fraction of its width and height.
const SETTLED: f64 = 1e-4;
/// A spot is fitted to the pixels within this many widths.
const REACH: f64 = 2.0;
/// At this many widths a spot is less than a millionth of its height.
const FAR: f64 = 5.3;
/// A spot that has moved this many widths from where it was found gets a new set of pixels.
const ASTRAY: f64 = 1.0;
/// Maximum number of touches.
const MAX: usize = 16;

/// The spots of an image, until the maximum of the residual of its square root is at most `least`, a function of the
/// pixel and the height of the first spot.
pub(super) fn spots(image: &Image, width_m: f64, least: impl Fn(usize, f64) -> f64) -> Vec<Spot> {
    let root = |value: &f64| if value.is_finite() { value.signum() * value.abs().sqrt() } else { 0.0 };
    let mut search = Search { image, width_m, left: image.values.iter().map(root).collect(), fits: Vec::new() };
    while search.fits.len() < MAX {
        let pixels = search.left.iter().enumerate();
        let Some((pixel, &height)) = pixels.max_by(|a, b| a.1.total_cmp(b.1)) else { break };
        let first = search.fits.first().map_or(height, |fit| fit.height);
        if height <= least(pixel, first.max(height)) || height <= 0.0 {
            break;
        }
        search.add(pixel, height);
    }
    let mut spots: Vec<Spot> = search.fits.iter().map(|fit| fit.spot(&image.space.surface)).collect();
    // If a spot shrank when its neighbours were fitted, it was not a spot.
    let highest = spots.iter().map(|spot| spot.height).fold(0.0, f64::max);
    spots.retain(|spot| spot.height > least(spot.pixel, highest));
    spots.sort_by(|a, b| b.height.total_cmp(&a.height));
    spots
}

/// The variance per axis of a spot's position due to noise, from the standard deviation `s` of its pixel in untouched
/// images: in the square root of the image it is `sd = (s / sqrt 3)^(1/2)` (the signed square of a normal deviate), and
/// a fitted Gaussian of height h has the variance `sd^2 / sum (h shape u / width^2)^2` (least squares), with the sum as
/// an integral over the plane: `sd^2 2 A / (pi h^2)`, `A` the area of a pixel.
pub(super) fn centre_variance_m2(space: &PixelSpace, spot: &Spot, sd: f64) -> f64 {
    let root_sd = (sd / 3f64.sqrt()).sqrt();
    2.0 * space.areas[spot.pixel] / std::f64::consts::PI * (root_sd / spot.height).powi(2)
}

struct Search<'a> {
    image: &'a Image,
    width_m: f64,
    /// The square root of the image less all spots.
    left: Vec<f64>,
    fits: Vec<Fit>,
}

/// A spot during the fit, in the chart about a point near it.
#[derive(Default)]
struct Fit {
    pixel: usize,
    origin_m: Point3,
    /// Its position in the chart, m.
    at_m: [f64; 2],
    height: f64,
    /// The pixels that it covers, and its value in each.
    patch: Vec<Reached>,
}

/// A pixel that a spot covers.
struct Reached {
    pixel: usize,
    /// Its position in the chart, m.
    at_m: [f64; 2],
    /// The value of the spot there.
    value: f64,
}

impl Fit {
    fn spot(&self, surface: &Surface) -> Spot {
        Spot { pixel: self.pixel, centre_m: surface.walk(self.origin_m, self.at_m), height: self.height }
    }
}

impl Reached {
    fn offset_m(&self, from_m: [f64; 2]) -> [f64; 2] {
        [self.at_m[0] - from_m[0], self.at_m[1] - from_m[1]]
    }
}

fn square([u, v]: [f64; 2]) -> f64 {
    u * u + v * v
}

impl Search<'_> {
    fn add(&mut self, pixel: usize, height: f64) {
        let mut fit = self.fit_about(pixel, self.image.space.centres_m[pixel], height);
        self.take_off(&mut fit);
        self.fits.push(fit);
        for _ in 0..ROUNDS {
            let mut most: f64 = 0.0;
            for index in 0..self.fits.len() {
                most = most.max(self.refit(index));
            }
            if most <= SETTLED {
                break;
            }
        }
    }

    /// A spot with the pixels that it covers, including a margin for small moves.
    fn fit_about(&self, pixel: usize, origin_m: Point3, height: f64) -> Fit {
        let Search { image: Image { space, .. }, width_m, .. } = self;
        let patch = (space.near(origin_m, (FAR + ASTRAY) * width_m))
            .map(|pixel| Reached { pixel, at_m: space.surface.chart(origin_m, space.centres_m[pixel]), value: 0.0 })
            .collect();
        Fit { pixel, origin_m, at_m: [0.0; 2], height, patch }
    }

    /// Subtracts a spot from the residual.
    fn take_off(&mut self, fit: &mut Fit) {
        let factor = -0.5 / (self.width_m * self.width_m);
        for reached in &mut fit.patch {
            reached.value = fit.height * (factor * square(reached.offset_m(fit.at_m))).exp();
            self.left[reached.pixel] -= reached.value;
        }
    }

    /// Fits a spot again together with all others; returns the relative change of its width or height.
    fn refit(&mut self, index: usize) -> f64 {
        let Some([up, du, dv]) = self.step(&self.fits[index]) else { return 0.0 };
        let mut fit = std::mem::take(&mut self.fits[index]);
        for reached in &fit.patch {
            self.left[reached.pixel] += reached.value;
        }
        fit.at_m = self.inside(&fit, [fit.at_m[0] + du, fit.at_m[1] + dv]);
        let change = du.hypot(dv) / self.width_m + (up / fit.height).abs();
        fit.height = (fit.height + up).max(0.0);
        if square(fit.at_m) > (ASTRAY * self.width_m).powi(2) {
            let spot = fit.spot(&self.image.space.surface);
            fit = self.fit_about(spot.pixel, spot.centre_m, spot.height);
        }
        self.take_off(&mut fit);
        self.fits[index] = fit;
        change
    }

    /// One Gauss-Newton step for height and position, against the residual with this spot added back.
    fn step(&self, fit: &Fit) -> Option<[f64; 3]> {
        let (mut matrix, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
        let per_width = 1.0 / (self.width_m * self.width_m);
        let reach = (REACH * self.width_m).powi(2);
        for reached in &fit.patch {
            let offset @ [u, v] = reached.offset_m(fit.at_m);
            if square(offset) > reach {
                continue;
            }
            let row = [reached.value / fit.height, reached.value * per_width * u, reached.value * per_width * v];
            for i in 0..3 {
                right[i] += row[i] * self.left[reached.pixel];
                (0..3).for_each(|j| matrix[i][j] += row[i] * row[j]);
            }
        }
        let [up, du, dv] = solved(matrix, right)?;
        // At most half a width per step: beyond, the linearisation is not valid.
        let short = (0.5 * self.width_m / du.hypot(dv)).min(1.0);
        Some([up, short * du, short * dv])
    }

    /// The point on the skin nearest to one that may be outside its edge.
    fn inside(&self, fit: &Fit, [u, v]: [f64; 2]) -> [f64; 2] {
        match self.image.space.surface {
            Surface::Cylinder { length_m, .. } => [u, v.clamp(-fit.origin_m[2], length_m - fit.origin_m[2])],
            Surface::Plane | Surface::Free => [u, v],
        }
    }
}

/// Solves three equations by Cramer's rule (the matrix is symmetric); `None` if they are singular.
fn solved([a, b, c]: [[f64; 3]; 3], right: [f64; 3]) -> Option<[f64; 3]> {
    let determinant = dot(a, cross(b, c));
    let solution = [cross(b, c), cross(c, a), cross(a, b)].map(|minor| dot(right, minor) / determinant);
    solution.iter().all(|value| value.is_finite()).then_some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::SkinDesign;
    use crate::image::PixelSpace;
    use crate::mesh::Mesh;
    use std::sync::Arc;

    const WIDTH_M: f64 = 0.01;

    fn image(touches: &[(Point3, f64)]) -> Image {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let space = Arc::new(PixelSpace::for_design(&design, &Mesh::generate(&design).unwrap()).unwrap());
        let value = |&centre: &Point3| {
            let root: f64 = (touches.iter())
                .map(|&(place, size)| {
                    size.sqrt() * (-0.5 * (space.surface.distance_m(place, centre) / WIDTH_M).powi(2)).exp()
                })
                .sum();
            root * root
        };
        let values = space.centres_m.iter().map(value).collect();
        Image { space, values }
    }

    #[test]
    fn spots_are_found_where_they_are_even_side_by_side_and_at_the_edge() {
        let surface = SkinDesign::shipped("cylinder30").unwrap().body.surface();
        let at = |z: f64, theta: f64| surface.at(z, theta).unwrap();
        // At the rim, across the seam, and two spots 25 mm apart, one of them a fifth of the other.
        let touches = [(at(0.001, 1.0), 2.0), (at(0.1, 0.03), 1.0), (at(0.2, 3.0), 5.0), (at(0.2, 3.5), 1.0)];
        let found = spots(&image(&touches), WIDTH_M, |_, first| 0.2 * first);
        assert_eq!(found.len(), 4, "{found:?}");
        for (place, size) in touches {
            let near = found.iter().find(|spot| surface.distance_m(spot.centre_m, place) < 2e-4).unwrap();
            assert!((near.height.powi(2) / size - 1.0).abs() < 0.02, "{near:?} of {size}");
        }
        assert!(spots(&image(&[]), WIDTH_M, |_, _| 0.0).is_empty());
    }
}
