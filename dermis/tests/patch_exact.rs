//! A disc-shaped patch in the centre of a disk-shaped skin compared with the exact potential, from no contact to a
//! perfect one.
//!
//! On the unit disk of conductance 1 S a patch of radius `a` has the contact conductance `g` per area. The current
//! `cos(k theta)` through the rim gives the potential `r^k - beta a^(2k) r^-k` outside the patch and `I_k(r sqrt(g))`
//! under it, both times `cos(k theta)`; by symmetry the patch floats at 0. The derivatives are continuous at `a` if
//! `beta = (q - k) / (q + k)`, `q = x I_k'(x) / I_k(x)`, `x = a sqrt(g)`: 0 without contact, 1 for a perfect one. At
//! the rim `u = (1 - beta a^(2k)) / (k (1 + beta a^(2k))) cos(k theta)`.

use dermis::forward::{ConductorContact, ConductorMoments, FloatingConductors, ForwardModel, Matrix, PotentialMoments};
use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use dermis::protocol::{Channel, Protocol};
use std::f64::consts::TAU;
use std::sync::Arc;

const RADIUS: f64 = 0.4;

/// A skin of rings and sectors with a point electrode at every node of its rim, and a moment for each node of the
/// patch; with the areas of the patch that belong to the nodes.
fn disk(refinement: usize) -> (FloatingConductors, Vec<f64>) {
    let (sectors, inner, outer) = (16 * refinement, 4 * refinement, 6 * refinement);
    let radius = |ring: usize| match ring <= inner {
        true => RADIUS * ring as f64 / inner as f64,
        false => RADIUS + (1.0 - RADIUS) * (ring - inner) as f64 / outer as f64,
    };
    let mut nodes = vec![[0.0; 3]];
    for ring in 1..=inner + outer {
        nodes.extend((0..sectors).map(|k| {
            let (sin, cos) = (TAU * k as f64 / sectors as f64).sin_cos();
            [radius(ring) * cos, radius(ring) * sin, 0.0]
        }));
    }
    let node = |ring: usize, k: usize| 1 + (ring - 1) * sectors + k % sectors;
    let mut cells: Vec<[usize; 3]> = (0..sectors).map(|k| [0, node(1, k), node(1, k + 1)]).collect();
    for ring in 2..=inner + outer {
        for k in 0..sectors {
            let (a, b, c, d) = (node(ring - 1, k), node(ring, k), node(ring, k + 1), node(ring - 1, k + 1));
            cells.extend([[a, b, c], [a, c, d]]);
        }
    }
    let patch_cells = sectors + 2 * sectors * (inner - 1);
    let electrodes = (0..sectors).map(|k| ElectrodePatch::Node(node(inner + outer, k))).collect();
    let mesh = Mesh { nodes, cells: Cells::Triangles(cells), electrodes, regions: vec![] };
    let patch_nodes = 1 + inner * sectors;
    let mut areas = vec![0.0; patch_nodes];
    for cell in 0..patch_cells {
        mesh.cells.corners(cell).iter().for_each(|&node| areas[node] += mesh.cell_measure(cell) / 3.0);
    }
    let protocol = Protocol::new(sectors, vec![Channel { drive: [0, 1], measure: [0, 1] }]).unwrap();
    let rest = vec![1.0; mesh.cell_count()];
    let model = ForwardModel::from_parts(&mesh, &vec![1.0; sectors], &protocol, &rest).unwrap();
    let mut weights = Matrix::zeros(patch_nodes, patch_nodes);
    (0..patch_nodes).for_each(|node| *weights.at_mut(node, node) = 1.0);
    let moments = PotentialMoments::new(vec![ConductorMoments { nodes: (0..patch_nodes).collect(), weights }]);
    (FloatingConductors::new(&model, &rest, Arc::new(moments), &[]).unwrap(), areas)
}

fn contact(areas: &[f64], conductance_s_per_m2: f64) -> ConductorContact {
    let mut conductance = Matrix::zeros(areas.len(), areas.len());
    for (node, area) in areas.iter().enumerate() {
        *conductance.at_mut(node, node) = conductance_s_per_m2 * area;
    }
    ConductorContact { conductor: 0, conductance }
}

/// The amplitude of `cos(k theta)` of the potential at the rim under the current density `cos(k theta)`.
fn amplitude(transfer_impedance: &Matrix, k: usize) -> f64 {
    let count = transfer_impedance.rows;
    let wave = |electrode: usize| (k as f64 * TAU * electrode as f64 / count as f64).cos();
    let current: Vec<f64> = (0..count).map(|electrode| wave(electrode) * TAU / count as f64).collect();
    let potential = |row: usize| transfer_impedance.row(row).iter().zip(&current).map(|(s, i)| s * i).sum::<f64>();
    (0..count).map(|row| potential(row) * wave(row)).sum::<f64>() * 2.0 / count as f64
}

/// `q = x I_k'(x) / I_k(x)` by the power series `I_k(x) = sum of (x/2)^(k + 2m) / (m! (m + k)!)` (DLMF 10.25.2): each
/// term counts `k + 2m` times. Where the series would overflow, the asymptotic value `x`.
fn slope(k: usize, x: f64) -> f64 {
    if x > 300.0 {
        return x;
    }
    let (mut term, mut sum, mut weighted) = (1.0, 0.0, 0.0);
    for m in 0..1000 {
        sum += term;
        weighted += term * (k + 2 * m) as f64;
        term *= 0.25 * x * x / ((m + 1) * (m + 1 + k)) as f64;
    }
    weighted / sum
}

fn exact(k: usize, conductance_s_per_m2: f64) -> f64 {
    let q = slope(k, RADIUS * conductance_s_per_m2.sqrt());
    let order = k as f64;
    let share = (q - order) / (q + order) * RADIUS.powi(2 * k as i32);
    (1.0 - share) / (order * (1.0 + share))
}

#[test]
fn a_round_patch_meets_the_exact_potential_from_no_contact_to_a_perfect_one() {
    let levels = [1, 2, 4].map(disk);
    for (name, conductance) in [("weak", 1.0), ("half", 25.0), ("perfect", 1e9)] {
        for k in [1, 2] {
            let errors = levels.each_ref().map(|(skin, areas)| {
                let rest = amplitude(&skin.resting_network().unwrap().transfer_impedance, k);
                let touched = skin.network(&[contact(areas, conductance)]).unwrap();
                let change = amplitude(&touched.transfer_impedance, k) - rest;
                change / (exact(k, conductance) - exact(k, 0.0)) - 1.0
            });
            let rate = (errors[1] / errors[2]).abs().log2();
            // The error after removal of the second-order term (Richardson extrapolation).
            let left = (4.0 * errors[2] - errors[1]) / 3.0;
            println!("{name} contact, k = {k}: errors {errors:.4?} of the change, rate {rate:.2}, limit {left:.1e}");
            assert!((1.7..2.4).contains(&rate));
            assert!(errors[2].abs() < 0.03 && left.abs() < 0.003);
        }
    }
}

#[test]
fn without_contact_the_frame_is_the_untouched_one() {
    let (skin, areas) = disk(1);
    let model = skin.model();
    let untouched = model.network(model.rest_conductivity()).unwrap();
    for contacts in [vec![], vec![contact(&areas, 0.0)]] {
        let network = skin.network(&contacts).unwrap();
        assert_eq!(network.transfer_impedance, untouched.transfer_impedance, "to the last bit");
    }
}

/// In the perfect limit the patch is one equipotential: its conductance has no effect, and the exact change is the
/// opposite of that of a hole, `beta = 1`.
#[test]
fn the_perfect_limit_is_reached_and_the_direct_solve_agrees() {
    let (skin, areas) = disk(1);
    let model = skin.model();
    let of = |g: f64| skin.network(&[contact(&areas, g)]).unwrap().transfer_impedance;
    let (hard, harder) = (amplitude(&of(1e8), 1), amplitude(&of(1e9), 1));
    println!("ten times a nearly perfect contact changes the potential by {:.1e}", (harder / hard - 1.0).abs());
    assert!((harder / hard - 1.0).abs() < 1e-6);
    for g in [1.0, 1e4] {
        let contacts = [contact(&areas, g)];
        let direct = model.network_with_conductors(model.rest_conductivity(), skin.moments(), &contacts).unwrap();
        let difference = amplitude(&direct.transfer_impedance, 1) / amplitude(&of(g), 1) - 1.0;
        assert!(difference.abs() < 1e-10, "{difference}");
    }
    let perfect = (1.0 - RADIUS * RADIUS) / (1.0 + RADIUS * RADIUS);
    assert!((exact(1, 1e12) / perfect - 1.0).abs() < 1e-5 && (exact(1, 0.0) - 1.0).abs() < 1e-15);
}

#[test]
fn contacts_that_no_conductor_has_are_refused() {
    let (skin, areas) = disk(1);
    for g in [f64::NAN, f64::INFINITY, -1.0] {
        let error = skin.network(&[contact(&areas, g)]).unwrap_err();
        assert!(error.to_string().contains("conductor 0"), "{error}");
    }
}
