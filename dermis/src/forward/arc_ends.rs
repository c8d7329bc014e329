//! Correction of the discretisation error of linear elements at the ends of arc electrodes, as a factor of the stiffness
//! of the cells around them.
//!
//! At the end of an electrode on an edge the potential behaves like `r^(1/2)` down to the length `l = s z`. Linear
//! elements of size `h` store there more energy than the exact field, by an amount proportional to `h` and to the square
//! of the field's amplitude; with all other lengths much larger than `h` it depends on the mesh around the end alone. A
//! factor below 1 of the stiffness of the cells that touch the end removes it: it is proportional to the same square,
//! whatever current flows elsewhere. The factors are those with which the transfer impedances of the untouched skin are
//! those of a mesh that is refined towards the ends and around them, in the sense of least squares.

use super::{ForwardError, ForwardModel};
use crate::fem::Gradients;
use crate::geom::vector::{add, distance, scale};
use crate::linalg::{Matrix, invert_spd};
use crate::mesh::{Cells, ElectrodePatch, Mesh};
use std::collections::BTreeMap;

/// Halvings of the cells at an end: the rest of the error is a thousandth.
const HALVINGS: usize = 10;
/// Iterations of Gauss-Newton; each reduces the misfit tenfold.
const ITERATIONS: usize = 4;
/// Least factor: cells must conduct.
const LEAST: f64 = 0.05;

/// The factor of the stiffness of each cell; `None` without arcs.
pub(super) fn stiffness_factors(model: &ForwardModel) -> Result<Option<Vec<f64>>, ForwardError> {
    let mesh = model.mesh();
    let ends = Ends::new(mesh);
    if ends.nodes.is_empty() {
        return Ok(None);
    }
    let target = refined_impedances(model, &ends)?;
    let mut of_end = vec![1.0; ends.nodes.len()];
    let mut current = model.clone();
    for _ in 0..ITERATIONS {
        let rest = current.rest_conductivity();
        let mut solver = current.solver();
        let impedances = solver.network(rest)?.transfer_impedance;
        let potentials = solver.potentials(rest)?;
        let misfit: Vec<f64> = target.values.iter().zip(&impedances.values).map(|(a, b)| a - b).collect();
        if std::env::var("DBG").is_ok() {
            println!("misfit {:e} of {:e}", misfit.iter().map(|x| x * x).sum::<f64>().sqrt(), target.values.iter().map(|x| x * x).sum::<f64>().sqrt());
        }
        let slopes: Vec<Vec<f64>> = ends.cells.iter().map(|cells| slope(model, cells, &potentials)).collect();
        let step = least_squares(&slopes, &misfit)?;
        of_end.iter_mut().zip(step).for_each(|(factor, step)| *factor = (*factor + step).clamp(LEAST, 2.0));
        current = model.with_stiffness_factors(ends.factors(&of_end, mesh.cell_count()));
    }
    if std::env::var("DBG").is_ok() {
        println!("{of_end:.3?}");
    }
    Ok(Some(ends.factors(&of_end, mesh.cell_count())))
}

/// The ends of all arcs: nodes with one edge of an electrode, and the cells around them.
struct Ends {
    nodes: Vec<usize>,
    reach_m: Vec<f64>,
    cells: Vec<Vec<usize>>,
}

impl Ends {
    fn new(mesh: &Mesh) -> Self {
        let mut reach_of: BTreeMap<usize, f64> = BTreeMap::new();
        if let Cells::Triangles(_) = mesh.cells {
            for (electrode, patch) in mesh.electrodes.iter().enumerate() {
                let ElectrodePatch::Edges(edges) = patch else { continue };
                let mut degree: BTreeMap<usize, usize> = BTreeMap::new();
                edges.as_flattened().iter().for_each(|&node| *degree.entry(node).or_default() += 1);
                let ends = degree.into_iter().filter(|&(_, count)| count == 1);
                reach_of.extend(ends.map(|(node, _)| (node, mesh.electrode_size(electrode))));
            }
        }
        let (nodes, reach_m): (Vec<usize>, Vec<f64>) = reach_of.into_iter().unzip();
        let mut cells = vec![Vec::new(); nodes.len()];
        for cell in 0..mesh.cell_count() {
            for node in mesh.cells.corners(cell) {
                if let Ok(end) = nodes.binary_search(node) {
                    cells[end].push(cell);
                }
            }
        }
        Ends { nodes, reach_m, cells }
    }

    /// The factor of each cell; a cell between two ends has the reductions of both.
    fn factors(&self, of_end: &[f64], cell_count: usize) -> Vec<f64> {
        let mut factors = vec![1.0; cell_count];
        for (cells, factor) in self.cells.iter().zip(of_end) {
            cells.iter().for_each(|&cell| factors[cell] = f64::max(LEAST, factors[cell] + factor - 1.0));
        }
        factors
    }
}

/// The transfer impedances on a mesh refined at the ends, extrapolated to no error around them.
///
/// The cells at the ends are halved, then all cells around them once. The error of the first mesh is that of smooth
/// fields, and the second quarters it.
fn refined_impedances(model: &ForwardModel, ends: &Ends) -> Result<Matrix, ForwardError> {
    let c: f64 = std::env::var("REACH").map_or(1.0, |x| x.parse().unwrap());
    let (mut mesh, mut rest) = (model.mesh().clone(), model.rest_conductivity().to_vec());
    let mut refine = |mesh: &mut Mesh, divides: &dyn Fn(&Mesh, [usize; 2]) -> bool| {
        let refined = mesh.refined(|edge| divides(mesh, edge)).expect("arcs are on triangles");
        rest = refined.parents.iter().map(|&parent| rest[parent]).collect();
        *mesh = refined.mesh;
        let fine = ForwardModel::from_parts(mesh, model.contact_impedances(), model.protocol(), &rest);
        fine.map(|fine| fine)
    };
    let mut first = None;
    for _ in 0..HALVINGS {
        first = Some(refine(&mut mesh, &|_, edge| edge.iter().any(|node| ends.nodes.binary_search(node).is_ok())));
    }
    let second = refine(&mut mesh, &|mesh, [a, b]| {
        let middle = scale(add(mesh.nodes[a], mesh.nodes[b]), 0.5);
        ends.nodes.iter().zip(&ends.reach_m).any(|(&node, reach_m)| distance(mesh.nodes[node], middle) < c * reach_m)
    });
    let impedances = |fine: ForwardModel| Ok(fine.network(fine.rest_conductivity())?.transfer_impedance);
    let first: Matrix = impedances(first.expect("some halvings").unwrap())?;
    let second = impedances(second.unwrap())?;
    let values = first.values.iter().zip(&second.values).map(|(a, b)| b + (b - a) / 3.0).collect();
    Ok(Matrix { values, ..second })
}

/// The derivative of the transfer impedances by the factor of some cells: minus the integral of the products of the
/// fields.
fn slope(model: &ForwardModel, cells: &[usize], potentials: &Matrix) -> Vec<f64> {
    let count = potentials.columns;
    let mut slope = vec![0.0; count * count];
    for &cell in cells {
        let gradients = Gradients::new(model.mesh(), cell);
        let corners = model.mesh().cells.corners(cell);
        for (a, &one) in corners.iter().enumerate() {
            for (b, &other) in corners.iter().enumerate() {
                let weight = model.rest_conductivity()[cell] * gradients.stiffness(a, b);
                let (one, other) = (potentials.row(one), potentials.row(other));
                for (row, u) in slope.chunks_exact_mut(count).zip(one) {
                    row.iter_mut().zip(other).for_each(|(value, v)| *value -= weight * u * v);
                }
            }
        }
    }
    slope
}

/// The coefficients of the sum of columns that is nearest to the right side.
fn least_squares(columns: &[Vec<f64>], right: &[f64]) -> Result<Vec<f64>, ForwardError> {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let count = columns.len();
    let mut normal = Matrix::zeros(count, count);
    for i in 0..count {
        for j in 0..=i {
            let value = product(&columns[i], &columns[j]);
            (*normal.at_mut(i, j), *normal.at_mut(j, i)) = (value, value);
        }
        *normal.at_mut(i, i) *= 1.0 + 1e-9;
    }
    let inverse = invert_spd(&normal).map_err(|_| ForwardError::Singular { place: "the ends of the arcs".into() })?;
    let right: Vec<f64> = columns.iter().map(|column| product(column, right)).collect();
    Ok((0..count).map(|i| product(inverse.row(i), &right)).collect())
}
