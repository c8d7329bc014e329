//! Correction of the discretisation error of linear elements near a small electrode, as a resistance in series with it.
//!
//! Around a disc electrode of radius `a` the potential decreases like `ln r`, and inside its rim the current leaves the
//! electrode within `l = sqrt(s z)`. To resolve both, a few hundred elements per electrode are needed; with coarser
//! elements the resistance is too low, by an amount that depends only on the mesh near the electrode. So, as in
//! reservoir simulators at wells (Peaceman, 1978, DOI 10.2118/6893-PA), the near field is solved once on the given mesh
//! and once exactly,
//!
//! `U = l I0(a/l) / (2 pi f a s I1(a/l))` at the electrode and `u(r) = -ln(r/a) / (2 pi f s)` outside, for 1 A,
//!
//! and the difference is added in series with the electrode. `f` is 1 in the interior and 1/2 on a straight edge.

use super::ForwardError;
use super::assembly::Assembly;
use crate::design::{Body, ElectrodeShape, SkinDesign};
use crate::geom::Surface;
use crate::geom::vector::Point3;
use crate::linalg::{Matrix, Symbolic};
use crate::mesh::{Cells, ElectrodePatch, Mesh};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

/// Radius of the near field in electrode radii; beyond three, the error of elements that grow with the distance is
/// small.
const REACH_RADII: f64 = 4.0;
/// Its limit as a fraction of the distance to the next electrode, which the exact solution does not include.
const REACH_SHARE: f64 = 0.45;
/// Below this many radii the near field is too small, and no correction is made.
const MIN_RADII: f64 = 1.5;
/// Relative tolerance of the patch area for a whole or half disc.
const AREA_TOLERANCE: f64 = 0.03;

/// The surroundings of an electrode count as uniform, with their mean conductance, up to this relative deviation: the
/// series resistance is a few per cent of the near field's, and the error of the mean a fraction of that. Region
/// boundaries deviate more.
const UNEVENNESS: f64 = 0.5;

/// One electrode and its surroundings.
struct NearField<'a> {
    mesh: &'a Mesh,
    surface: Surface,
    patch: &'a [usize],
    centre_m: Point3,
    radius_m: f64,
    contact_impedance: f64,
    reach_m: f64,
}

/// The series resistance of every electrode of a design, ohm. It is zero if there is no exact near field: an electrode
/// that is not a disc, that is clipped other than in half on a straight edge, whose surroundings are not uniform or
/// that is too close to another.
pub(super) fn series_resistances(
    design: &SkinDesign,
    mesh: &Mesh,
    rest_conductivity: &[f64],
) -> Result<Vec<f64>, ForwardError> {
    let surface = design.body.surface();
    let mut resistances = vec![0.0; design.electrodes.len()];
    for (index, electrode) in design.electrodes.iter().enumerate() {
        let (ElectrodeShape::Disc { radius_m }, ElectrodePatch::Cells(patch)) =
            (electrode.shape, &mesh.electrodes[index])
        else {
            continue;
        };
        let others = design.electrodes.iter().enumerate().filter(|(other, _)| *other != index);
        let nearest = others
            .map(|(_, other)| surface.distance_m(electrode.centre_m, other.centre_m))
            .fold(f64::INFINITY, f64::min);
        let field = NearField {
            mesh,
            surface,
            patch,
            centre_m: electrode.centre_m,
            radius_m,
            contact_impedance: electrode.contact_impedance,
            reach_m: (REACH_RADII * radius_m).min(REACH_SHARE * nearest),
        };
        if let Some((conductance, fraction)) = field.is_known(&design.body, rest_conductivity) {
            resistances[index] = field.exact(conductance, fraction) - field.discrete(conductance, fraction)?;
        }
    }
    Ok(resistances)
}

impl NearField<'_> {
    /// The conductance around the electrode and its fraction of a full circle, if the exact solution applies.
    fn is_known(&self, body: &Body, rest_conductivity: &[f64]) -> Option<(f64, f64)> {
        if self.reach_m < MIN_RADII * self.radius_m || matches!(self.surface, Surface::Free) {
            return None;
        }
        let cells = self.cells();
        let (mut sum, mut whole) = (0.0, 0.0);
        for &cell in &cells {
            let area = self.mesh.cell_measure(cell);
            sum += area * rest_conductivity[cell];
            whole += area;
        }
        let conductance = sum / whole;
        if cells.is_empty()
            || cells.iter().any(|&cell| (rest_conductivity[cell] / conductance - 1.0).abs() > UNEVENNESS)
        {
            return None;
        }
        let area: f64 = self.patch.iter().map(|&cell| self.mesh.cell_measure(cell)).sum();
        let share = area / (TAU / 2.0 * self.radius_m * self.radius_m);
        let depth = body.edge_distance_m(self.centre_m)?;
        if (share - 1.0).abs() < AREA_TOLERANCE && depth > self.reach_m {
            Some((conductance, 1.0))
        } else if (share - 0.5).abs() < AREA_TOLERANCE && depth < 1e-9 * self.radius_m && straight_for(body, self) {
            Some((conductance, 0.5))
        } else {
            None
        }
    }

    fn distance(&self, node: usize) -> f64 {
        self.surface.distance_m(self.centre_m, self.mesh.nodes[node])
    }

    /// The cells with all corners within the radius of the near field.
    fn cells(&self) -> Vec<usize> {
        let within =
            |cell: &usize| self.mesh.cells.corners(*cell).iter().all(|&node| self.distance(node) < self.reach_m);
        (0..self.mesh.cell_count()).filter(within).collect()
    }

    /// The electrode's potential for 1 A, where `u = 0` at the disc's radius.
    fn exact(&self, conductance: f64, fraction: f64) -> f64 {
        let layer = (conductance * self.contact_impedance).sqrt();
        layer * bessel_i0_over_i1(self.radius_m / layer) / (TAU * fraction * self.radius_m * conductance)
    }

    /// The same on the mesh, with the exact potential at the outermost nodes.
    fn discrete(&self, conductance: f64, fraction: f64) -> Result<f64, ForwardError> {
        let cells = self.cells();
        let (mesh, nodes, outer) = self.part(&cells);
        let assembly = Assembly::new(&mesh, &[self.contact_impedance])?;
        let mut values = vec![0.0; assembly.pattern.entries.len()];
        assembly.values_into(&vec![conductance; mesh.cell_count()], &mut values);

        let given: BTreeMap<usize, f64> = outer
            .iter()
            .map(|&node| {
                let ratio = self.distance(nodes[node]) / self.radius_m;
                (assembly.pattern.unknown_of_node[node], -ratio.ln() / (TAU * fraction * conductance))
            })
            .collect();
        let free: Vec<usize> =
            (0..assembly.pattern.unknown_count).filter(|unknown| !given.contains_key(unknown)).collect();
        let place: BTreeMap<usize, usize> = free.iter().copied().zip(0..).collect();
        let mut right = Matrix::zeros(free.len(), 1);
        // The electrode is the last unknown and supplies 1 A.
        right.values[free.len() - 1] = 1.0;
        let (mut pattern, mut kept) = (Vec::new(), Vec::new());
        for (&[i, j], &value) in assembly.pattern.entries.iter().zip(&values) {
            match (place.get(&i), place.get(&j)) {
                (Some(&i), Some(&j)) => {
                    pattern.push([i, j]);
                    kept.push(value);
                }
                (Some(&i), None) => right.values[i] -= value * given[&j],
                (None, Some(&j)) => right.values[j] -= value * given[&i],
                (None, None) => {}
            }
        }
        let symbolic = Symbolic::new(free.len(), 0, &pattern);
        let factor = symbolic
            .factor(&kept)
            .map_err(|_| ForwardError::Singular { place: "the surroundings of an electrode".into() })?;
        factor.solve_in_place(&symbolic, &mut right);
        Ok(right.values[free.len() - 1])
    }

    /// The cells as a separate mesh, its nodes in this one, and those nodes that are shared with other cells.
    fn part(&self, cells: &[usize]) -> (Mesh, Vec<usize>, Vec<usize>) {
        let inside: BTreeSet<usize> = cells.iter().copied().collect();
        let nodes: BTreeSet<usize> = cells.iter().flat_map(|&cell| self.mesh.cells.corners(cell)).copied().collect();
        let place: BTreeMap<usize, usize> = nodes.iter().copied().zip(0..).collect();
        let outside = (0..self.mesh.cell_count()).filter(|cell| !inside.contains(cell));
        let outer: BTreeSet<usize> = outside
            .flat_map(|cell| self.mesh.cells.corners(cell))
            .filter_map(|node| place.get(node).copied())
            .collect();
        let corners = |&cell: &usize| {
            let corners = self.mesh.cells.corners(cell);
            [place[&corners[0]], place[&corners[1]], place[&corners[2]]]
        };
        let patch: BTreeSet<usize> = self.patch.iter().copied().collect();
        let mesh = Mesh {
            nodes: nodes.iter().map(|&node| self.mesh.nodes[node]).collect(),
            cells: Cells::Triangles(cells.iter().map(corners).collect()),
            electrodes: vec![ElectrodePatch::Cells(
                (0..cells.len()).filter(|&cell| patch.contains(&cells[cell])).collect(),
            )],
            regions: Vec::new(),
        };
        (mesh, nodes.into_iter().collect(), outer.into_iter().collect())
    }
}

/// Whether the edge near an electrode is straight within the near field.
fn straight_for(body: &Body, field: &NearField<'_>) -> bool {
    match *body {
        Body::Cylinder { length_m, .. } => length_m > 2.0 * field.reach_m,
        Body::Rectangle { width_m, height_m } => {
            let ([x, y, _], reach) = (field.centre_m, field.reach_m);
            let off_corner = |p: f64, size: f64| p > reach && p < size - reach;
            off_corner(x, width_m) || off_corner(y, height_m)
        }
        Body::Disk { .. } | Body::Mesh { .. } => false,
    }
}

/// `I0(x) / I1(x)` for positive `x`, by the continued fraction `I1/I0 = 1 / (2/x + 1 / (4/x + 1 / (6/x + ...)))` (DLMF
/// 10.33.1), or for large `x`, where this is slow, by its asymptotic series (DLMF 10.40.1); both are correct to 1e-12.
fn bessel_i0_over_i1(x: f64) -> f64 {
    if x > 1e4 {
        return 1.0 + 1.0 / (2.0 * x) + 3.0 / (8.0 * x * x);
    }
    let terms = 60 + (3.0 * x) as usize;
    let tail = (2..=terms).rev().fold(0.0, |tail, k| 1.0 / (2.0 * k as f64 / x + tail));
    2.0 / x + tail
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::forward::ForwardModel;
    use crate::protocol::{Channel, Protocol};

    #[test]
    fn the_ratio_of_bessel_functions_is_right() {
        // Abramowitz and Stegun, tables 9.8 and 9.9: I0(1) = 1.2660658778, I1(1) = 0.5651591040.
        assert!((bessel_i0_over_i1(1.0) - 1.266_065_877_8 / 0.565_159_104_0).abs() < 1e-9);
        let (below, above) = (bessel_i0_over_i1(1e4), bessel_i0_over_i1(1e4 * (1.0 + 1e-12)));
        assert!((below - above).abs() < 1e-12);
    }

    /// A coarse disk grounded at its rim, with a disc electrode in its centre: with the series resistance the result is
    /// exact; without it the error is several per cent.
    #[test]
    fn a_coarse_mesh_and_its_series_resistance_give_the_exact_resistance() {
        let (radius_m, outer_m, conductance) = (0.004, 0.05, 1e-3);
        let radii = [0.002, 0.004, 0.006, 0.009, 0.0135, 0.02, 0.025, 0.03, 0.034, 0.038, 0.042, 0.046, outer_m];
        let sectors = 16;
        let mut nodes = vec![[0.0; 3]];
        for radius in radii {
            nodes.extend((0..sectors).map(|k| {
                let (sin, cos) = (TAU * k as f64 / sectors as f64).sin_cos();
                [radius * cos, radius * sin, 0.0]
            }));
        }
        let node = |ring: usize, k: usize| 1 + ring * sectors + k % sectors;
        let mut cells: Vec<[usize; 3]> = (0..sectors).map(|k| [0, node(0, k), node(0, k + 1)]).collect();
        for ring in 1..radii.len() {
            for k in 0..sectors {
                let (a, b, c, d) = (node(ring - 1, k), node(ring, k), node(ring, k + 1), node(ring - 1, k + 1));
                cells.extend([[a, b, c], [a, c, d]]);
            }
        }
        let rim = radii.len() - 1;
        let mesh = Mesh {
            nodes,
            cells: Cells::Triangles(cells),
            electrodes: vec![
                ElectrodePatch::Cells((0..3 * sectors).collect()),
                ElectrodePatch::Edges((0..sectors).map(|k| [node(rim, k), node(rim, k + 1)]).collect()),
                ElectrodePatch::Node(node(6, 0)),
                ElectrodePatch::Node(node(6, 8)),
            ],
            regions: Vec::new(),
        };
        for contact_impedance in [1e-7, 2e-5, 1e-3] {
            let ElectrodePatch::Cells(patch) = &mesh.electrodes[0] else { unreachable!("just made") };
            let field = NearField {
                mesh: &mesh,
                surface: Surface::Plane,
                patch,
                centre_m: [0.0; 3],
                radius_m,
                contact_impedance,
                reach_m: 0.0461,
            };
            let series = field.exact(conductance, 1.0) - field.discrete(conductance, 1.0).unwrap();
            let channel = Channel { drive: [0, 1], measure: [0, 1] };
            let protocol = Protocol::new(4, vec![channel]).unwrap();
            let rest = vec![conductance; mesh.cell_count()];
            let rim_impedance = 1e-3;
            let model =
                ForwardModel::from_parts(&mesh, &[contact_impedance, rim_impedance, 1.0, 1.0], &protocol, &rest)
                    .unwrap();
            let coarse = model.solve(&rest).unwrap()[0];
            let exact = field.exact(conductance, 1.0)
                + (outer_m / radius_m).ln() / (TAU * conductance)
                + rim_impedance / (TAU * outer_m);
            let (without, with) = (coarse / exact - 1.0, (coarse + series) / exact - 1.0);
            println!("z = {contact_impedance:e}: {without:.4} without, {with:.4} with the series resistance");
            assert!(without < -0.015, "the mesh is meant to be coarse: {without}");
            assert!(with.abs() < 0.1 * without.abs(), "{with} against {without}");
        }
    }
}
