//! Eight conductivities solved together give the same results and errors as one by one, at every instruction set.

use dermis::design::SkinDesign;
use dermis::forward::{BatchSolver, ForwardError, ForwardModel};
use dermis::linalg::{BadLanes, BatchPlan, Entries, LANES, SimdLevel, Symbolic};
use dermis::mesh::Mesh;
use dermis_sim::random::{sample_rng, standard_normal};

/// Tolerance: rounding of both methods, amplified by the system's condition number (about 1e5 with contacts of 2e-5 ohm
/// m2), is far below.
const AGREEMENT: f64 = 1e-10;

fn model(name: &str) -> ForwardModel {
    let design = SkinDesign::shipped(name).expect("a shipped design");
    let mesh = Mesh::generate(&design).expect("shipped designs have a mesh");
    ForwardModel::new(&design, &mesh).expect("shipped designs have a model")
}

/// Conductivities that vary between cells and lanes, by at most a factor of e.
fn conductivities(model: &ForwardModel) -> Vec<[f64; LANES]> {
    let mut rng = sample_rng(8, 0);
    let mut factor = || (0.3 * standard_normal(&mut rng)).exp();
    model.rest_conductivity().iter().map(|rest| std::array::from_fn(|_| rest * factor())).collect()
}

fn frames(solver: &mut BatchSolver, conductivity: &[[f64; LANES]]) -> Vec<[f64; LANES]> {
    let mut frames = vec![[0.0; LANES]; solver.model().protocol().channel_count()];
    solver.solve_into(conductivity, &mut frames).expect("positive conductivities");
    frames
}

#[test]
fn every_lane_at_every_level_equals_the_plain_solver() {
    for name in ["cylinder30", "skin16", "tank16"] {
        let model = model(name);
        let conductivity = conductivities(&model);
        let plain: Vec<_> = (0..LANES)
            .map(|lane| {
                let one: Vec<f64> = conductivity.iter().map(|lanes| lanes[lane]).collect();
                model.solve(&one).expect("positive conductivities")
            })
            .collect();
        for level in SimdLevel::available() {
            let batched = frames(&mut model.batch_solver_at(level), &conductivity);
            for (lane, plain) in plain.iter().enumerate() {
                let norm = plain.iter().map(|v| v * v).sum::<f64>().sqrt();
                let distance = plain.iter().zip(&batched).map(|(a, b)| (a - b[lane]).powi(2)).sum::<f64>().sqrt();
                assert!(distance <= AGREEMENT * norm, "{name}, {level:?}, lane {lane}: {:.1e}", distance / norm);
                if lane == 0 {
                    println!("{name}, {level:?}: equal to {:.1e}", distance / norm);
                }
            }
        }
    }
}

#[test]
fn the_bits_of_a_lane_depend_on_nothing_but_its_conductivity() {
    let model = model("cylinder30");
    let conductivity = conductivities(&model);
    for level in SimdLevel::available() {
        let mut solver = model.batch_solver_at(level);
        let first = frames(&mut solver, &conductivity);
        let turned: Vec<[f64; LANES]> =
            conductivity.iter().map(|lanes| std::array::from_fn(|lane| lanes[(lane + 3) % LANES])).collect();
        let others = frames(&mut solver, &turned);
        for (first, other) in first.iter().zip(&others) {
            for lane in 0..LANES {
                assert_eq!(first[(lane + 3) % LANES].to_bits(), other[lane].to_bits(), "{level:?}");
            }
        }
        assert_eq!(frames(&mut model.batch_solver_at(level), &conductivity), first, "{level:?}: another workspace");
    }
}

#[test]
fn impossible_conductivities_are_named() {
    let model = model("tank16");
    let mut solver = model.batch_solver();
    let mut frames = vec![[0.0; LANES]; model.protocol().channel_count()];
    let good = conductivities(&model);
    for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let mut bad = good.clone();
        bad[17][5] = value;
        let error = solver.solve_into(&bad, &mut frames).expect_err("not a conductivity");
        assert!(matches!(error, ForwardError::Conductivity { cell: 17, .. }), "{error}");
    }
    let error = solver.solve_into(&good[1..], &mut frames).expect_err("a cell too few");
    assert!(matches!(error, ForwardError::Count { .. }), "{error}");
}

/// A 9 x 9 grid of resistors between neighbours, its corners kept.
struct Grid {
    entries: Vec<[usize; 2]>,
    /// In the order of the plan, a value per lane.
    values: Vec<[f64; LANES]>,
}

impl Entries for Grid {
    #[inline(always)]
    fn entry<S: pulp::Simd>(&self, _: S, position: usize, pass: usize) -> S::f64s {
        S::as_simd_f64s(&self.values[position]).0[pass]
    }
}

fn grid(turned_lane: Option<usize>) -> (Grid, BatchPlan) {
    let side = 9;
    let count = side * side;
    let corners = [0, side - 1, count - side, count - 1];
    let order: Vec<usize> = (0..count).filter(|node| !corners.contains(node)).chain(corners).collect();
    let place = |node: usize| order.iter().position(|&other| other == node).expect("every node has a place");
    let mut entries: Vec<[usize; 2]> = (0..count).map(|node| [node, node]).collect();
    let mut values = vec![[0.0; LANES]; count];
    for node in 0..count {
        let (right, above) = (node + 1, node + side);
        for other in [(right, right % side != 0), (above, above < count)].into_iter().filter(|pair| pair.1) {
            let (a, b) = (place(node), place(other.0));
            let conductance: [f64; LANES] = std::array::from_fn(|lane| 1.0 + (node * 7 + lane) as f64 % 3.0);
            entries.push([a, b]);
            values.push(conductance.map(|value| -value));
            for lane in 0..LANES {
                values[a][lane] += conductance[lane];
                values[b][lane] += conductance[lane];
            }
        }
    }
    if let Some(lane) = turned_lane {
        values[20][lane] = -5.0;
    }
    let plan = Symbolic::new(count, corners.len(), &entries).batch_plan();
    let values = plan.entry_order().iter().map(|&entry| values[entry]).collect();
    (Grid { entries, values }, plan)
}

#[test]
fn a_matrix_that_is_not_positive_definite_is_named_by_its_lane_alone() {
    for level in SimdLevel::available() {
        let mut impedances = vec![[0.0; LANES]; 16];
        let (good, plan) = grid(None);
        let mut workspace = plan.workspace_at(level);
        plan.transfer_impedances(&good, &mut workspace, &mut impedances).expect("resistors hang together");
        assert_eq!(good.entries.len(), 81 + 2 * 72);
        let expected = impedances.clone();
        let (bad, plan) = grid(Some(2));
        let error = plan.transfer_impedances(&bad, &mut workspace, &mut impedances).expect_err("lane 2 is indefinite");
        assert_eq!(error, BadLanes(std::array::from_fn(|lane| lane == 2)));
        for (impedance, expected) in impedances.iter().zip(&expected) {
            assert_eq!([impedance[1], impedance[3]], [expected[1], expected[3]], "its neighbours do not notice");
        }
    }
}
