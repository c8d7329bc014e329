//! GREIT: the linear reconstruction fitted to the desired images of a set of small targets (Adler et al. 2009, DOI
//! 10.1088/0967-3334/30/6/S03).

use crate::design::TouchEffect;
use crate::forward::{ForwardModel, Matrix};
use crate::geom::Point3;
use crate::image::PixelSpace;
use crate::mesh::Mesh;
use crate::reconstruct::alpha::{AlphaRule, mu_at_noise_figure, positive};
use crate::reconstruct::channels::{Channels, Difference};
use crate::reconstruct::linearised::Linearised;
use crate::reconstruct::{Reconstruct, ReconstructError, check_lengths, noise_figure};
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use std::sync::Arc;

/// Training options of GREIT.
#[derive(Debug, Clone)]
pub struct GreitOptions {
    /// The noise figure for the training target with the smallest sensitivity; `None` uses the rule of
    /// [`Alpha::Auto`](crate::reconstruct::Alpha::Auto).
    pub noise_figure: Option<f64>,
    /// Radius of the training targets over that of a disk of the body's area.
    pub target_radius: f64,
    /// Radius of the desired image of a target over the mean electrode spacing (the square root of the area per
    /// electrode). Its edge is soft, half of the radius wide.
    pub desired_radius: f64,
    /// Targets with less than this fraction of their desired image on the body are not used for training: their images
    /// would be biased inwards.
    pub smallest_part: f64,
    /// Channels that are excluded.
    pub excluded: Vec<usize>,
    /// The sign of the conductance change under touch: images are positive where touched.
    pub touch: TouchEffect,
}

impl Default for GreitOptions {
    fn default() -> Self {
        GreitOptions {
            noise_figure: None,
            target_radius: 0.05,
            desired_radius: 0.45,
            smallest_part: 0.8,
            excluded: Vec::new(),
            touch: TouchEffect::ConductanceRises,
        }
    }
}

/// GREIT.
///
/// ```text
/// M = D Y' (Y Y' + mu I)^-1
/// ```
///
/// The columns of Y are the differences caused by small targets, one at the centre of each pixel, those of D their
/// desired images: a soft circle around the target with its strength. Distances are along the surface, across the seam
/// of a closed skin. Each target is weighted by the area of its pixel. `mu` is chosen by the noise figure.
#[derive(Debug, Clone)]
pub struct Greit {
    pixels: Arc<PixelSpace>,
    matrix: Matrix,
    rule: AlphaRule,
}

impl Greit {
    /// GREIT for a skin.
    ///
    /// # Errors
    /// Options out of their range, a forward problem that cannot be solved, targets smaller than the mesh can resolve.
    pub fn new(forward: &ForwardModel, pixels: Arc<PixelSpace>, options: &GreitOptions) -> crate::Result<Self> {
        for (what, value) in [
            ("the target radius", options.target_radius),
            ("the desired radius", options.desired_radius),
            ("the smallest part of a target's desired image", options.smallest_part),
        ] {
            positive(what, value)?;
        }
        let mesh = forward.mesh();
        let model = Linearised::new(forward, &PixelSpace::cells(mesh, pixels.surface))?;
        let channels = Channels::new(&model, Difference::Plain, &options.excluded, &[])?;
        let body_area: f64 = pixels.areas.iter().sum();
        let target_radius_m = options.target_radius * (body_area / std::f64::consts::PI).sqrt();
        let targets = Targets::new(mesh, &pixels, target_radius_m)?;
        let differences = channels.jacobian(&model, &channels.scale, false) * &targets.cells;
        let electrode_count = forward.protocol().electrode_count() as f64;
        let desired_radius_m = options.desired_radius * (body_area / electrode_count).sqrt();
        let (desired, weights) = desired_images(&pixels, &targets.strengths, desired_radius_m, options.smallest_part);
        let faint = faintest(&differences, &targets.strengths);
        let (inverse, rule) = train(&differences, &desired, &weights, &pixels.areas, &faint, options.noise_figure)?;
        let matrix = channels.spread(inverse.as_ref(), &model, false, options.touch.sign());
        Ok(Greit { pixels, matrix, rule })
    }
}

impl Greit {
    /// The rule that chose the regularization parameter.
    pub fn alpha_rule(&self) -> AlphaRule {
        self.rule
    }
}

/// The training targets: discs of relative contrast one, one around the centre of each pixel.
struct Targets {
    /// The fraction of each cell in each target, cells x targets.
    cells: Mat<f64>,
    /// Contrast times area of each, m2.
    strengths: Vec<f64>,
}

impl Targets {
    fn new(mesh: &Mesh, pixels: &PixelSpace, radius_m: f64) -> Result<Self, ReconstructError> {
        let mut cells = Mat::zeros(mesh.cell_count(), pixels.len());
        let mut strengths = vec![0.0; pixels.len()];
        for cell in 0..mesh.cell_count() {
            let samples = samples(mesh, cell);
            let (centre, measure) = (mesh.cell_centre(cell), mesh.cell_measure(cell));
            let reach = samples.iter().map(|&sample| pixels.surface.distance_m(centre, sample)).fold(0.0, f64::max);
            for (target, &position) in pixels.centres_m.iter().enumerate() {
                if pixels.surface.distance_m(centre, position) > radius_m + reach {
                    continue;
                }
                let inside = samples.iter().filter(|&&s| pixels.surface.distance_m(s, position) <= radius_m).count();
                let part = inside as f64 / samples.len() as f64;
                cells[(cell, target)] = part;
                strengths[target] += part * measure;
            }
        }
        match strengths.iter().position(|&strength| strength == 0.0) {
            None => Ok(Targets { cells, strengths }),
            Some(target) => Err(ReconstructError::Parameter(format!(
                "training targets of {:.3} mm are lost between the cells near pixel {target}: take larger ones or a finer mesh",
                1e3 * radius_m
            ))),
        }
    }
}

/// Points distributed uniformly over a cell: a lattice of barycentric coordinates.
fn samples(mesh: &Mesh, cell: usize) -> Vec<Point3> {
    /// Points along an edge, minus one: 15 points in a triangle, 35 in a tetrahedron.
    const ORDER: usize = 4;
    let corners: Vec<Point3> = mesh.cells.corners(cell).iter().map(|&node| mesh.nodes[node]).collect();
    let mut points = Vec::new();
    for i in 0..=ORDER {
        for j in 0..=ORDER - i {
            if corners.len() == 3 {
                points.push([i, j, ORDER - i - j, 0]);
            } else {
                points.extend((0..=ORDER - i - j).map(|k| [i, j, k, ORDER - i - j - k]));
            }
        }
    }
    let share = 1.0 / corners.len() as f64;
    let coordinate = |index: usize| (index as f64 + share) / (ORDER as f64 + 1.0);
    let point = |indices: &[usize; 4]| {
        let mut point = [0.0; 3];
        for (corner, &index) in corners.iter().zip(indices) {
            (0..3).for_each(|axis| point[axis] += coordinate(index) * corner[axis]);
        }
        point
    };
    points.iter().map(point).collect()
}

/// Soft circles around the targets, pixels x targets, each with its target's strength, and the weight of each target:
/// the area of its pixel, or zero if too much of the circle is beyond a rim.
fn desired_images(pixels: &PixelSpace, strengths: &[f64], radius_m: f64, smallest_part: f64) -> (Mat<f64>, Vec<f64>) {
    let softness_m = 0.5 * radius_m;
    let mut desired = Mat::from_fn(pixels.len(), pixels.len(), |pixel, target| {
        let distance = pixels.surface.distance_m(pixels.centres_m[pixel], pixels.centres_m[target]);
        1.0 / (1.0 + ((distance - radius_m) / softness_m).exp())
    });
    let volume = |target: usize| -> f64 {
        desired.col(target).iter().zip(&pixels.areas).map(|(value, area)| value * area).sum()
    };
    let volumes: Vec<f64> = (0..pixels.len()).map(volume).collect();
    let whole = volumes.iter().copied().fold(0.0, f64::max);
    for (target, strength) in strengths.iter().enumerate() {
        desired.col_mut(target).iter_mut().for_each(|value| *value *= strength / volumes[target]);
    }
    let weight = |(volume, &area): (&f64, &f64)| if *volume >= smallest_part * whole { area } else { 0.0 };
    (desired, volumes.iter().zip(&pixels.areas).map(weight).collect())
}

/// The difference of the target with the smallest sensitivity per strength.
fn faintest(differences: &Mat<f64>, strengths: &[f64]) -> Vec<f64> {
    let visible = |target: usize| differences.col(target).norm_l2() / strengths[target];
    let least = (0..strengths.len()).min_by(|&a, &b| visible(a).total_cmp(&visible(b)));
    least.into_iter().flat_map(|target| differences.col(target).iter().copied()).collect()
}

/// The matrix that fits the desired images best, at a noise figure for a weak target.
fn train(
    differences: &Mat<f64>,
    desired: &Mat<f64>,
    weights: &[f64],
    areas: &[f64],
    faint: &[f64],
    wanted: Option<f64>,
) -> Result<(Mat<f64>, AlphaRule), ReconstructError> {
    let weighted = Mat::from_fn(differences.nrows(), weights.len(), |channel, target| {
        weights[target] * differences[(channel, target)]
    });
    let response = desired * weighted.transpose();
    let spread = differences * weighted.transpose();
    let at = |mu: f64| {
        let mut system = spread.clone();
        (0..system.nrows()).for_each(|channel| system[(channel, channel)] += mu);
        let factor = system
            .llt(Side::Lower)
            .map_err(|_| ReconstructError::Singular(format!("Y Y' + mu I is not positive definite at mu = {mu:e}")))?;
        Ok::<_, ReconstructError>(factor.solve(response.transpose()).transpose().to_owned())
    };
    let figure = |mu: f64| Ok(noise_figure::of_matrix(at(mu)?.as_ref(), areas, faint));
    let mean = (0..spread.nrows()).map(|channel| spread[(channel, channel)]).sum::<f64>() / spread.nrows() as f64;
    // The initial noise is a tenth of the training signal's amplitude.
    let (mu, rule) = mu_at_noise_figure(&figure, wanted, 0.01 * mean)?;
    Ok((at(mu)?, rule))
}

impl Reconstruct for Greit {
    fn name(&self) -> String {
        "GREIT".into()
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        &self.pixels
    }

    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        check_lengths(difference, self.matrix.columns, values, self.matrix.rows)?;
        self.matrix.product_into(difference, values);
        Ok(())
    }

    fn matrix(&self) -> Option<&Matrix> {
        Some(&self.matrix)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Surface;

    /// Rotation by one column rotates the desired image by one column, also across the seam; targets near a rim have
    /// weight zero, those near the seam the same weight as all others.
    #[test]
    fn wanted_images_wrap_round_the_seam() {
        const ROWS: usize = 9;
        const COLUMNS: usize = 12;
        let surface = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
        let turn = std::f64::consts::TAU / COLUMNS as f64;
        let centre = |at: usize| {
            let (row, column) = ((at / COLUMNS) as f64 + 0.5, (at % COLUMNS) as f64 + 0.5);
            surface.at(0.3 * row / ROWS as f64, turn * column).unwrap()
        };
        let count = ROWS * COLUMNS;
        let pixels = PixelSpace {
            surface,
            grid: Some([ROWS, COLUMNS]),
            position_in_grid: (0..count).collect(),
            centres_m: (0..count).map(centre).collect(),
            normals: vec![[0.0; 3]; count],
            areas: vec![1e-3; count],
            neighbours: vec![Vec::new(); count],
            edge_m: Vec::new(),
            overlaps: vec![Vec::new(); count],
        };
        let (desired, weights) = desired_images(&pixels, &vec![1e-4; count], 0.04, 0.8);
        let turned = |at: usize| at / COLUMNS * COLUMNS + (at % COLUMNS + 1) % COLUMNS;
        for target in 0..count {
            for pixel in 0..count {
                let (here, there) = (desired[(pixel, target)], desired[(turned(pixel), turned(target))]);
                assert!((here - there).abs() < 1e-12 * here.max(1e-3), "pixel {pixel}, target {target}");
            }
            let volume: f64 = desired.col(target).iter().map(|value| value * 1e-3).sum();
            assert!((volume / 1e-4 - 1.0).abs() < 1e-12);
            assert_eq!(weights[target], weights[turned(target)]);
        }
        assert_eq!((weights[0], weights[count / 2]), (0.0, 1e-3));
    }
}
