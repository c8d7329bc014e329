//! Target images of networks: the mean of each pixel's relative change of conductance.

use crate::elementary::{Chart, erf};
use crate::touch::GaussianTouch;
use dermis::design::{ImageLayout, SkinDesign};
use dermis::geom::Shape;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use std::f64::consts::{FRAC_PI_2, PI, SQRT_2};

/// How the image of some touches is made.
#[derive(Debug, Clone)]
pub(super) enum Target {
    /// Pixels that are rectangles in the unrolled surface: the mean of a Gaussian is exactly a product of differences
    /// of the error function.
    Rectangles(Rectangles),
    /// Any other pixels: the mean over the cells that they overlap, each cell weighted by the shared area.
    Cells(Vec<Vec<(usize, f64)>>),
}

/// The unrolled grid of a cylinder or a rectangle.
#[derive(Debug, Clone)]
pub(super) struct Rectangles {
    rows: usize,
    columns: usize,
    chart: Chart,
}

impl Target {
    pub(super) fn new(design: &SkinDesign, mesh: &Mesh, space: &PixelSpace) -> Self {
        match (&design.image, design.body.chart()) {
            (&ImageLayout::Grid { rows, columns }, Some(chart)) if !matches!(chart.shape(), Shape::Disk { .. }) => {
                Target::Rectangles(Rectangles { rows, columns, chart: chart.with_seam(-PI).with_functions() })
            }
            _ => Target::Cells(shares(space, mesh)),
        }
    }

    /// The image of some touches; their relative change of conductance in each cell is also given.
    pub(super) fn image_into(&self, touches: &[GaussianTouch], change: impl Fn(usize) -> f64, image: &mut [f64]) {
        match self {
            Target::Rectangles(grid) => {
                image.fill(0.0);
                touches.iter().for_each(|touch| grid.add(touch, image));
            }
            Target::Cells(pixels) => {
                for (value, cells) in image.iter_mut().zip(pixels) {
                    *value = cells.iter().map(|&(cell, share)| share * change(cell)).sum();
                }
            }
        }
    }
}

/// For each pixel its cells, with weights that sum to one.
fn shares(space: &PixelSpace, mesh: &Mesh) -> Vec<Vec<(usize, f64)>> {
    let weights = |overlaps: &Vec<(usize, f64)>| {
        let parts: Vec<(usize, f64)> =
            overlaps.iter().map(|&(cell, fraction)| (cell, fraction * mesh.cell_measure(cell))).collect();
        let total: f64 = parts.iter().map(|part| part.1).sum();
        parts.into_iter().map(|(cell, part)| (cell, part / total)).collect()
    };
    space.overlaps.iter().map(weights).collect()
}

impl Rectangles {
    /// Adds the pixel means of a touch, row-major.
    fn add(&self, touch: &GaussianTouch, image: &mut [f64]) {
        let ([round_m, along_m], [width_m, height_m]) = (self.chart.unroll(touch.centre_m), self.chart.size_m());
        let rows = means(height_m, self.rows, along_m, touch.width_m, false);
        let columns = means(width_m, self.columns, round_m, touch.width_m, self.chart.period_m().is_some());
        for (line, row) in image.chunks_exact_mut(self.columns).zip(rows) {
            let height = touch.amplitude * row;
            if height != 0.0 {
                line.iter_mut().zip(&columns).for_each(|(value, column)| *value += height * column);
            }
        }
    }
}

/// The means of `exp(-d^2 / (2 w^2))` over `count` equal intervals of `0..size`, `d` the distance from a centre:
/// `sqrt(pi / 2) w / h (erf(b / (sqrt 2 w)) - erf(a / (sqrt 2 w)))` over an interval from `a` to `b`, of length `h`.
///
/// If the axis is periodic, `d` is the shorter way around: the Gaussian is truncated half a period away on either side.
fn means(size_m: f64, count: usize, centre_m: f64, width_m: f64, wraps: bool) -> Vec<f64> {
    let step_m = size_m / count as f64;
    let factor = FRAC_PI_2.sqrt() * width_m / step_m;
    let half_m = if wraps { 0.5 * size_m } else { f64::INFINITY };
    let integral = |edge: usize, turn: f64| {
        let off_m = (edge as f64 * step_m - centre_m + turn * size_m).clamp(-half_m, half_m);
        erf(off_m / (SQRT_2 * width_m))
    };
    // A centre is at most half a period before the first edge and at most one after it.
    let turns: &[f64] = if wraps { &[-1.0, 0.0, 1.0] } else { &[0.0] };
    let mut means = vec![0.0; count];
    for &turn in turns {
        let mut before = integral(0, turn);
        for (index, mean) in means.iter_mut().enumerate() {
            let after = integral(index + 1, turn);
            *mean += factor * (after - before);
            before = after;
        }
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elementary::unrolled;
    use dermis::design::Body;
    use dermis::geom::Surface;
    use dermis::mesh::Cells;
    use std::f64::consts::TAU;

    const CYLINDER: Body = Body::Cylinder { length_m: 0.3, diameter_m: 0.1 };

    fn grid() -> Rectangles {
        Rectangles { rows: 30, columns: 30, chart: unrolled(&CYLINDER.surface()) }
    }

    /// The pixel means by the midpoint rule, with distances along the surface.
    fn slow(surface: &Surface, touch: &GaussianTouch) -> Vec<f64> {
        const PARTS: usize = 40;
        let middle = |line: usize, part: usize| line as f64 + (part as f64 + 0.5) / PARTS as f64;
        let mut image = Vec::with_capacity(900);
        for pixel in 0..900 {
            let mut sum = 0.0;
            for part in 0..PARTS * PARTS {
                let z_m = 0.01 * middle(pixel / 30, part / PARTS);
                let theta_rad = TAU / 30.0 * middle(pixel % 30, part % PARTS);
                sum += touch.value(surface, surface.at(z_m, theta_rad).unwrap());
            }
            image.push(sum / (PARTS * PARTS) as f64);
        }
        image
    }

    #[test]
    fn pixel_means_agree_with_a_fine_quadrature_at_seam_rim_and_antipode() {
        let surface = CYLINDER.surface();
        for (z_m, theta_rad, width_m) in
            [(0.15, 2.0, 0.008), (0.15, 0.02, 0.012), (0.3, 3.1, 0.005), (0.0, TAU - 0.01, 0.015), (0.1, 1.0, 0.1)]
        {
            let centre_m = surface.at(z_m, theta_rad).unwrap();
            let touch = GaussianTouch { centre_m, amplitude: 1.3, width_m };
            let mut fast = vec![0.0; 900];
            grid().add(&touch, &mut fast);
            let off = fast.iter().zip(slow(&surface, &touch)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            println!("z {z_m}, theta {theta_rad:.2}, width {width_m}: off by {off:.1e}");
            // The midpoint rule's own error: (h/w)^2 / 24 with h = 0.26 mm.
            assert!(off < 3e-4, "{off}");
        }
    }

    #[test]
    fn an_image_holds_the_whole_touch() {
        let touch = GaussianTouch { centre_m: [0.05, 0.0, 0.15], amplitude: 0.8, width_m: 0.011 };
        let mut image = vec![0.0; 900];
        grid().add(&touch, &mut image);
        let integral: f64 = image.iter().sum::<f64>() * 0.01 * (0.5 * TAU * 0.1 / 30.0);
        assert!((integral / (TAU * 0.8 * 0.011 * 0.011) - 1.0).abs() < 1e-10, "{integral}");
    }

    #[test]
    fn other_pixels_take_the_mean_of_their_cells() {
        let nodes = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let cells = Cells::Triangles(vec![[0, 1, 2], [0, 2, 3]]);
        let mesh = Mesh { nodes, cells, electrodes: vec![], regions: vec![] };
        let space = PixelSpace::cells(&mesh, Surface::Free);
        let target = Target::Cells(shares(&space, &mesh));
        let mut image = [0.0; 2];
        target.image_into(&[], |cell| (10 * cell + 3) as f64, &mut image);
        assert_eq!(image, [3.0, 13.0]);
    }
}
