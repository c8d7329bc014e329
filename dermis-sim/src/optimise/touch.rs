//! What a press answers to a field, whatever the electrodes.

use super::local::{COMPONENTS, Neighbourhood};
use super::places::with_points;
use crate::bound::{BoundOptions, refined, tangents};
use crate::elementary::exp;
use crate::twin::{Press, TouchOptions, Twin, TwinOptions};
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::geom::vector::{Point3, add, distance, scale};
use dermis::geom::{Point2, Surface};
use dermis::linalg::{Cholesky, Matrix};

/// Parameters of a press: two of its position, the logarithms of its force and of its tip radius, the phase of the patches
/// along both directions.
pub(super) const PARAMETERS: usize = 6;
/// Those about which nothing is known but from the readings, and the tip radius.
pub(super) const UNKNOWNS: usize = 4;
/// Standard deviation of the logarithm of the tip radius, as in [`bound`](crate::bound).
const LOG_RADIUS_SD: f64 = 0.5;
/// Steps of central differences: along the skin, m, and of logarithms.
const STEP_M: f64 = 2e-4;
const LOG_STEP: f64 = 0.01;
/// Diagonal of the normal equations of a response over their mean: the square of the error of the fields of a mesh.
const RIDGE: f64 = 1e-6;
/// Least distance of a probe from a press, in radii of its neighbourhood: nearer fields are no polynomials there.
const AWAY: f64 = 3.0;

/// The answers of a press to fields: for each parameter the symmetric matrix `M` by which the transfer impedance of two
/// electrodes changes, `f' M g` with the coefficients `f` and `g` of their fields.
#[derive(Debug, Clone)]
pub(super) struct Response {
    pub(super) around: Neighbourhood,
    /// By row and column of the coefficients, then by parameter, S (per m for lengths).
    pub(super) matrix: [[[f64; PARAMETERS]; COMPONENTS]; COMPONENTS],
}

/// The presses of a twin, with the fields of some point electrodes as probes.
#[derive(Debug)]
pub(super) struct Touches {
    skin: Twin,
    /// With the patches shifted forward and back along two directions.
    shifted: Vec<[Twin; 2]>,
    pitch_m: [f64; 2],
    potentials: Matrix,
    press: Press,
    radius_m: f64,
}

impl Touches {
    /// The presses of a twin on the body and the coat of a design, with probes at some places; fields are described
    /// within about `radius_m`.
    pub(super) fn new(
        design: &SkinDesign,
        probes_m: &[Point3],
        twin: &TwinOptions,
        bound: &BoundOptions,
        radius_m: f64,
    ) -> crate::Result<Self> {
        let mut sound = twin.as_designed();
        // Every pair of probes can be read in this time.
        sound.electronics.frame_rate_hz = sound.electronics.slot_rate_hz / (probes_m.len() * probes_m.len()) as f64;
        let design = &with_points(design, probes_m, refined(design, bound).mesh.max_edge_m)?;
        let skin = Twin::new(design, &sound, 0)?;
        let (mut shifted, mut pitch_m) = (Vec::new(), [1.0; 2]);
        if let (TouchOptions::Patches(patches), false) = (&skin.options().touch, bound.known_patches) {
            pitch_m = patches.on_body(&design.body)?.pitch_m();
            let with = |axis: usize, step_m: f64| {
                let mut moved = patches.clone();
                moved.offset_m[axis] += step_m;
                let mut options = sound.clone();
                options.touch = TouchOptions::Patches(moved);
                Twin::new(design, &options, 0)
            };
            shifted = vec![[with(0, STEP_M)?, with(0, -STEP_M)?], [with(1, STEP_M)?, with(1, -STEP_M)?]];
        }
        let model = ForwardModel::new(skin.design(), skin.mesh())?;
        let potentials = model.potentials(model.rest_conductivity())?;
        let press = Press { centre_m: [0.0; 3], force_n: bound.force_n, tip_radius_m: bound.tip_radius_m };
        Ok(Touches { skin, shifted, pitch_m, potentials, press, radius_m })
    }

    /// What is known of each parameter before: the inverse of its variance. Any phase of the patches is equally likely; a
    /// phase that does not exist has no effect, and any value serves.
    pub(super) fn known(&self) -> [f64; PARAMETERS] {
        let [first, second] = self.pitch_m.map(|pitch_m| 12.0 / (pitch_m * pitch_m));
        [0.0, 0.0, 0.0, LOG_RADIUS_SD.powi(-2), first, second]
    }

    /// The answers of a press at a place with a normal, from those of the probes `D = F' M F`: `M` by least squares.
    ///
    /// # Errors
    /// A press that the twin cannot simulate.
    pub(super) fn response(&self, place_m: Point3, normal: Point3) -> crate::Result<Response> {
        let surface = self.skin.design().body.surface();
        let around = Neighbourhood { surface, place_m, tangents: tangents(normal), radius_m: self.radius_m };
        let electrodes = &self.skin.design().electrodes;
        let is_far = |probe: &usize| distance(electrodes[*probe].centre_m, place_m) > AWAY * self.radius_m;
        let probes: Vec<usize> = (0..electrodes.len()).filter(is_far).collect();
        let all = around.coefficients(&self.skin.mesh().nodes, &self.potentials);
        let mut fields = Matrix::zeros(COMPONENTS, probes.len());
        for component in 0..COMPONENTS {
            let mean = probes.iter().map(|&probe| all.at(component, probe)).sum::<f64>() / probes.len() as f64;
            let row = fields.row_mut(component);
            row.iter_mut().zip(&probes).for_each(|(value, &probe)| *value = all.at(component, probe) - mean);
        }
        // All probes count alike, near and far.
        let weight = |probe: usize| 1.0 / (0..COMPONENTS).map(|i| fields.at(i, probe).powi(2)).sum::<f64>().sqrt();
        let weights: Vec<f64> = (0..probes.len()).map(weight).collect();
        (0..COMPONENTS)
            .for_each(|i| fields.row_mut(i).iter_mut().zip(&weights).for_each(|(value, weight)| *value *= weight));
        let transposed = fields.transposed();
        let mut normal_matrix = fields.times(&transposed);
        let trace: f64 = (0..COMPONENTS).map(|i| normal_matrix.at(i, i)).sum();
        (0..COMPONENTS).for_each(|i| *normal_matrix.at_mut(i, i) += RIDGE * trace / COMPONENTS as f64);
        let mut matrix = [[[0.0; PARAMETERS]; COMPONENTS]; COMPONENTS];
        let Ok(factor) = Cholesky::new(&normal_matrix) else { return Ok(Response { around, matrix }) };
        // Rows of the transposed matrix are the columns of the fields.
        let columns: Vec<Vec<f64>> = (0..transposed.rows).map(|row| factor.solve(transposed.row(row))).collect();
        let solve = Matrix { rows: transposed.rows, columns: COMPONENTS, values: columns.concat() }.transposed();
        for (parameter, change) in self.changes(&around)?.iter().enumerate() {
            let own = weighted_differences(change, &probes, &weights);
            let found = solve.times(&own).times(&solve.transposed());
            for (i, row) in matrix.iter_mut().enumerate() {
                for (j, values) in row.iter_mut().enumerate() {
                    values[parameter] = 0.5 * (found.at(i, j) + found.at(j, i));
                }
            }
        }
        Ok(Response { around, matrix })
    }

    /// The derivatives of the transfer impedance of the probes by each parameter that there is.
    fn changes(&self, around: &Neighbourhood) -> crate::Result<Vec<Matrix>> {
        let here = Press { centre_m: around.place_m, ..self.press };
        let moved = |step_m: Point2| Press { centre_m: walk(around, step_m), ..here };
        let stronger = |sign: f64| Press { force_n: here.force_n * exp(sign * LOG_STEP), ..here };
        let wider = |sign: f64| Press { tip_radius_m: here.tip_radius_m * exp(sign * LOG_STEP), ..here };
        let of = |twins: [&Twin; 2], presses: [Press; 2], step: f64| -> crate::Result<Matrix> {
            let mut change = twins[0].network(&[presses[0]])?.transfer_impedance;
            let back = twins[1].network(&[presses[1]])?.transfer_impedance;
            change.values.iter_mut().zip(&back.values).for_each(|(a, b)| *a = (*a - b) / (2.0 * step));
            Ok(change)
        };
        let own = [&self.skin; 2];
        let mut changes = vec![
            of(own, [moved([STEP_M, 0.0]), moved([-STEP_M, 0.0])], STEP_M)?,
            of(own, [moved([0.0, STEP_M]), moved([0.0, -STEP_M])], STEP_M)?,
            of(own, [stronger(1.0), stronger(-1.0)], LOG_STEP)?,
            of(own, [wider(1.0), wider(-1.0)], LOG_STEP)?,
        ];
        for [forward, back] in &self.shifted {
            changes.push(of([forward, back], [here, here], STEP_M)?);
        }
        Ok(changes)
    }
}

/// The changes of some probes against their mean, each times the weights of both.
fn weighted_differences(change: &Matrix, probes: &[usize], weights: &[f64]) -> Matrix {
    let count = probes.len();
    let means: Vec<f64> =
        probes.iter().map(|&a| probes.iter().map(|&b| change.at(a, b)).sum::<f64>() / count as f64).collect();
    let mean = means.iter().sum::<f64>() / count as f64;
    let mut differences = Matrix::zeros(count, count);
    for (i, &a) in probes.iter().enumerate() {
        for (j, &b) in probes.iter().enumerate() {
            *differences.at_mut(i, j) = weights[i] * weights[j] * (change.at(a, b) - means[i] - means[j] + mean);
        }
    }
    differences
}

/// A point moved along the skin, as in [`bound`](crate::bound).
fn walk(around: &Neighbourhood, step_m: Point2) -> Point3 {
    let [u, v] = around.tangents;
    match around.surface {
        Surface::Free => add(around.place_m, add(scale(u, step_m[0]), scale(v, step_m[1]))),
        surface => surface.walk(around.place_m, step_m),
    }
}
