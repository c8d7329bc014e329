//! Gradients in reverse mode against the Jacobian, and against central differences of the plain solver.

use crate::shapes;
use dermis::design::SkinDesign;
use dermis::forward::{ForwardModel, Gradient};
use dermis::geom::Point3;
use dermis::linalg::{LANES, SimdLevel};
use dermis::mesh::Mesh;
use dermis::protocol::{Channel, Protocol};

/// Models of every kind of electrode and cell: arcs on edges, discs on cells, points, faces of tetrahedra.
fn models() -> Vec<(String, ForwardModel)> {
    let shipped = ["tank16", "skin16", "cylinder30"].map(|name| {
        let mut design = SkinDesign::shipped(name).unwrap();
        design.mesh = design.mesh.scaled(3.0);
        (name.to_string(), design)
    });
    let of_design = |(name, design): (String, SkinDesign)| {
        let mesh = Mesh::generate(&design).unwrap();
        (name, ForwardModel::new(&design, &mesh).unwrap())
    };
    shipped.into_iter().map(of_design).chain([("block".to_string(), block())]).collect()
}

/// Tetrahedra with electrodes on faces, and points.
fn block() -> ForwardModel {
    let mesh = shapes::block([0.3, 0.1, 0.05], [6, 3, 2]);
    let channels = [[0, 1], [2, 3], [0, 2], [1, 3]];
    let channel = |drive| channels.map(|measure| Channel { drive, measure });
    let protocol = Protocol::new(4, channels.into_iter().flat_map(channel).collect()).unwrap();
    ForwardModel::from_parts(&mesh, &[0.01; 4], &protocol, &vec![1.0; mesh.cell_count()]).unwrap()
}

/// A different conductivity in each lane, and a function of the frame: its derivative by channel.
fn problem(model: &ForwardModel) -> (Vec<[f64; LANES]>, Vec<[f64; LANES]>) {
    let factor = |cell: usize, lane: usize| 1.0 + 0.3 * ((cell * 7 + lane * 13) % 11) as f64 / 11.0;
    let rest = model.rest_conductivity().iter().enumerate();
    let conductivity = rest.map(|(cell, s)| std::array::from_fn(|lane| s * factor(cell, lane))).collect();
    let weight = |channel: usize, lane: usize| ((channel * 5 + lane * 3) % 17) as f64 - 8.0;
    let channels = 0..model.protocol().channel_count();
    (conductivity, channels.map(|channel| std::array::from_fn(|lane| weight(channel, lane))).collect())
}

fn lane_of(values: &[[f64; LANES]], lane: usize) -> Vec<f64> {
    values.iter().map(|value| value[lane]).collect()
}

/// The function of a lane: its weights times the frame.
fn function(model: &ForwardModel, conductivity: &[f64], weights: &[f64]) -> f64 {
    model.solve(conductivity).unwrap().iter().zip(weights).map(|(value, weight)| value * weight).sum()
}

fn gradient(model: &ForwardModel, level: SimdLevel) -> Gradient {
    let (conductivity, weights) = problem(model);
    let mut solver = model.batch_solver_at(level);
    let mut kept = solver.kept_solution();
    let (mut frames, mut plain) = (weights.clone(), weights.clone());
    solver.solve_kept_into(&conductivity, &mut frames, &mut kept).unwrap();
    model.batch_solver_at(level).solve_into(&conductivity, &mut plain).unwrap();
    assert_eq!(frames, plain, "keeping the factors changes no bit");
    let gradient = solver.gradient(&kept, &weights);
    assert_eq!(solver.conductivity_gradient(&kept, &weights), gradient.conductivity);
    gradient
}

fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |largest, value| largest.max(value.abs()))
}

#[test]
fn by_conductivity_it_is_the_transposed_jacobian_times_the_derivative() {
    for (name, model) in models() {
        let (conductivity, weights) = problem(&model);
        for level in SimdLevel::available() {
            let gradient = gradient(&model, level);
            for lane in [0, 3, 7] {
                let jacobian = model.jacobian(&lane_of(&conductivity, lane)).unwrap();
                let weights = lane_of(&weights, lane);
                let mut expected = vec![0.0; jacobian.columns];
                for (channel, weight) in weights.iter().enumerate() {
                    expected.iter_mut().zip(jacobian.row(channel)).for_each(|(sum, value)| *sum += weight * value);
                }
                let scale = largest(expected.iter().copied());
                for (cell, expected) in expected.iter().enumerate() {
                    let off = (gradient.conductivity[cell][lane] - expected).abs();
                    assert!(off < 1e-10 * scale, "{name}, {level:?}, lane {lane}, cell {cell}: {off} of {scale}");
                }
            }
        }
    }
}

#[test]
fn by_contact_impedance_it_is_the_transposed_jacobian_times_the_derivative() {
    for (name, model) in models() {
        let (conductivity, weights) = problem(&model);
        let gradient = gradient(&model, SimdLevel::best());
        let jacobian = model.contact_jacobian(&lane_of(&conductivity, 2)).unwrap();
        let weights = lane_of(&weights, 2);
        let expected = |electrode: usize| -> f64 {
            weights.iter().enumerate().map(|(channel, weight)| weight * jacobian.at(channel, electrode)).sum()
        };
        let scale = largest((0..jacobian.columns).map(expected));
        for electrode in 0..jacobian.columns {
            let off = (gradient.contact_impedances[electrode][2] - expected(electrode)).abs();
            // Of arcs the drops at the contact are differences of nearly equal potentials.
            assert!(off <= 5e-9 * scale, "{name}, electrode {electrode}: {off} of {scale}");
        }
    }
}

#[test]
fn by_node_it_is_the_central_difference() {
    for (name, model) in models() {
        let (conductivity, weights) = problem(&model);
        let gradient = gradient(&model, SimdLevel::best());
        let (conductivity, weights) = (lane_of(&conductivity, 1), lane_of(&weights, 1));
        let scale = largest(gradient.nodes.iter().flatten().map(|lanes| lanes[1]));
        // Nodes of electrodes (their patches change), and others.
        let of_electrodes =
            (0..model.mesh().electrodes.len()).flat_map(|one| model.mesh().electrode_nodes(one)).step_by(7);
        let others = (0..model.mesh().node_count()).step_by(model.mesh().node_count() / 9);
        for node in of_electrodes.take(9).chain(others) {
            for axis in 0..3 {
                let step = 1e-6;
                let at = |offset: f64| {
                    let mut nodes: Vec<Point3> = model.mesh().nodes.clone();
                    nodes[node][axis] += offset;
                    let rest = model.rest_conductivity();
                    let moved = model.with_parameters(&nodes, model.contact_impedances(), rest).unwrap();
                    function(&moved, &conductivity, &weights)
                };
                let expected = (at(step) - at(-step)) / (2.0 * step);
                let off = (gradient.nodes[node][axis][1] - expected).abs();
                assert!(off < 1e-5 * scale, "{name}, node {node}, axis {axis}: {off} of {scale}");
            }
        }
    }
}

/// A skin moved, turned or scaled as a whole: the gradient has no component along the first two, and frames of a sheet
/// do not change with its scale where contacts are points.
#[test]
fn motions_of_the_whole_skin_change_nothing() {
    for (name, model) in models() {
        let gradient = gradient(&model, SimdLevel::best());
        let scale = gradient.nodes.iter().flatten().map(|lanes| lanes[0].abs()).sum::<f64>();
        for axis in 0..3 {
            let along: f64 = gradient.nodes.iter().map(|node| node[axis][0]).sum();
            assert!(along.abs() < 1e-9 * scale, "{name}, axis {axis}: {along} of {scale}");
        }
        let turned: f64 =
            gradient.nodes.iter().zip(&model.mesh().nodes).map(|(g, x)| x[0] * g[1][0] - x[1] * g[0][0]).sum();
        assert!(turned.abs() < 1e-9 * scale, "{name}: {turned} of {scale}");
    }
}

/// Of many conductivities, also where the instrument loses the signs: against the solver of eight.
#[test]
fn many_solutions_have_the_gradients_of_each() {
    for name in ["tank16", "skin16"] {
        let skin = dermis::skin::Skin::load(name).unwrap();
        let model = skin.forward();
        let (conductivity, weights) = problem(model);
        let maps: Vec<Vec<f64>> = (0..11).map(|map| lane_of(&conductivity, map % LANES)).collect();
        let weights: Vec<Vec<f64>> = (0..11).map(|map| lane_of(&weights, map % LANES)).collect();
        let map = |map: usize| Ok::<_, dermis::forward::ForwardError>(maps[map].as_slice().into());
        let (frames, solutions) = model.solve_many_kept(maps.len(), map, |_| {}).unwrap();
        assert_eq!(frames, model.solve_many(maps.len(), map, |_| {}).unwrap());
        let gradients = solutions.gradients(|map| &weights[map]);
        let alone = solutions.conductivity_gradients(|map| &weights[map]);
        assert_eq!((gradients.len(), alone.len()), (11, 11));
        for map in [0, 7, 8, 10] {
            assert_eq!(gradients[map].conductivity, alone[map]);
            let jacobian = model.jacobian(&maps[map]).unwrap();
            let raw = model.solve(&maps[map]).unwrap();
            let mut expected = vec![0.0; maps[map].len()];
            for (channel, value) in raw.iter().enumerate() {
                let sign = if model.protocol().amplitude_only() { value.signum() } else { 1.0 };
                let weight = sign * weights[map][channel];
                expected.iter_mut().zip(jacobian.row(channel)).for_each(|(sum, value)| *sum += weight * value);
            }
            let scale = largest(expected.iter().copied());
            assert!(expected.iter().zip(&alone[map]).all(|(a, b)| (a - b).abs() < 1e-10 * scale), "{name}, {map}");
        }
    }
}
