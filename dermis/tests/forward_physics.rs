//! The forward model against exact solutions, conservation laws and its own derivative.

use crate::reference::{Reference, relative_difference};
use crate::shapes::{block, polar, polar_cells, polar_rim, strip};
use dermis::forward::{ElectrodeNetwork, ForwardError, ForwardModel};
use dermis::geom::vector::{cross, dot, norm, scale};
use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use dermis::protocol::{Channel, Protocol};
use std::f64::consts::{PI, TAU};

/// Tolerance for laws that hold in exact arithmetic.
const EXACT: f64 = 1e-10;

/// All pairs of four electrodes against each other: they determine the whole network.
fn four_electrodes() -> Protocol {
    let channels = [[0, 1], [2, 3], [0, 2], [1, 3]];
    Protocol::new(4, channels.iter().flat_map(|&drive| channels.map(|measure| Channel { drive, measure })).collect())
        .unwrap()
}

fn model(mesh: &Mesh, impedances: &[f64], conductivity: f64) -> ForwardModel {
    ForwardModel::from_parts(mesh, impedances, &four_electrodes(), &vec![conductivity; mesh.cell_count()]).unwrap()
}

/// A conductivity that varies from cell to cell within a factor of three, without any symmetry.
fn uneven(cell_count: usize) -> Vec<f64> {
    (0..cell_count).map(|cell| 1.5 + (cell as f64 * 0.7).sin() * 0.5 + (cell as f64 * 0.0137).cos() * 0.4).collect()
}

fn resistance(network: &ElectrodeNetwork, source: usize, sink: usize) -> f64 {
    let s = &network.transfer_impedance;
    s.at(source, source) - 2.0 * s.at(source, sink) + s.at(sink, sink)
}

/// R = l / (s w) + 2 z / w, and a linear field between.
#[test]
fn a_strip_with_a_contact_impedance_at_each_end() {
    let (length, width, conductance, z) = (0.3, 0.1, 1e-3, 0.7);
    let mesh = strip(length, width, 9, 4);
    let model = model(&mesh, &[z; 4], conductance);
    let network = model.network(model.rest_conductivity()).unwrap();
    let exact = length / (conductance * width) + 2.0 * z / width;
    assert!((resistance(&network, 0, 1) / exact - 1.0).abs() < EXACT);
    let between = model.solve(model.rest_conductivity()).unwrap()[1];
    assert!((between / (length / 3.0 / (conductance * width)) - 1.0).abs() < EXACT);
}

/// R = l / (c A) + 2 z / A in a volume.
#[test]
fn a_block_with_a_contact_impedance_at_each_end() {
    let (size, conductivity, z) = ([0.3, 0.1, 0.05], 2.5, 0.013);
    let mesh = block(size, [6, 3, 2]);
    let model = model(&mesh, &[z; 4], conductivity);
    let network = model.network(model.rest_conductivity()).unwrap();
    let area = size[1] * size[2];
    let exact = size[0] / (conductivity * area) + 2.0 * z / area;
    println!("block: {:.2e}", resistance(&network, 0, 1) / exact - 1.0);
    assert!((resistance(&network, 0, 1) / exact - 1.0).abs() < EXACT);
}

#[test]
fn the_network_is_symmetric_of_rank_one_less_and_conserves_current() {
    let disk = Reference::disk16();
    let network = disk.model().network(&uneven(disk.mesh.cell_count())).unwrap();
    let (y, s) = (&network.admittance, &network.transfer_impedance);
    let scale_of = |matrix: &dermis::linalg::Matrix| matrix.values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    for matrix in [y, s] {
        let scale = scale_of(matrix);
        for i in 0..16 {
            let current: f64 = matrix.row(i).iter().sum();
            assert!(current.abs() < EXACT * scale, "row {i} sums to {current:e}");
            for j in 0..16 {
                assert!((matrix.at(i, j) - matrix.at(j, i)).abs() < EXACT * scale);
            }
        }
    }
    // Y S = 1 - P, the projector of rank L - 1.
    for i in 0..16 {
        for j in 0..16 {
            let product: f64 = (0..16).map(|k| y.at(i, k) * s.at(k, j)).sum();
            let expected = f64::from(u8::from(i == j)) - 1.0 / 16.0;
            assert!((product - expected).abs() < EXACT);
        }
    }
}

/// Exchanging drive and measure reads the same value.
#[test]
fn reciprocity() {
    let disk = Reference::disk30();
    let protocol = Protocol::adjacent(30).unwrap();
    let model = ForwardModel::from_parts(&disk.mesh, &disk.contact_impedances, &protocol, &uneven(9600)).unwrap();
    let frame = model.solve(model.rest_conductivity()).unwrap();
    let mut pairs = 0;
    for (index, channel) in protocol.channels().iter().enumerate() {
        let twin = protocol.channels().iter().position(|other| *other == channel.reciprocal()).unwrap();
        assert!((frame[index] - frame[twin]).abs() < EXACT * frame[index].abs().max(1e-3));
        pairs += usize::from(twin > index);
    }
    assert_eq!(pairs, 435);
}

/// c times the conductivity and 1/c of the contact impedance give 1/c of the voltages.
#[test]
fn scaling() {
    let disk = Reference::disk16();
    let conductivity = uneven(disk.mesh.cell_count());
    let plain = disk.model().solve(&conductivity).unwrap();
    let factor = 37.0;
    let more: Vec<f64> = conductivity.iter().map(|value| value * factor).collect();
    let scaled = disk.model_with(&[0.01 / factor; 16]).solve(&more).unwrap();
    let back: Vec<f64> = scaled.iter().map(|value| value * factor).collect();
    assert!(relative_difference(&back, &plain) < EXACT);
}

fn turned(mesh: &Mesh) -> Mesh {
    let axis = scale([1.0, -2.0, 0.7], 1.0 / norm([1.0, -2.0, 0.7]));
    let (sin, cos) = 0.83f64.sin_cos();
    let mut turned = mesh.clone();
    for node in &mut turned.nodes {
        let (along, across) = (dot(axis, *node), cross(axis, *node));
        for k in 0..3 {
            node[k] = node[k] * cos + across[k] * sin + axis[k] * along * (1.0 - cos) + 0.3;
        }
    }
    turned
}

#[test]
fn turning_the_coordinates_changes_nothing() {
    let disk = Reference::disk16();
    let conductivity = uneven(disk.mesh.cell_count());
    let plain = disk.model().solve(&conductivity).unwrap();
    let moved = Reference { mesh: turned(&disk.mesh), ..Reference::disk16() };
    assert!(relative_difference(&moved.model().solve(&conductivity).unwrap(), &plain) < EXACT);

    let block = block([0.3, 0.1, 0.05], [3, 2, 2]);
    let conductivity = uneven(block.cell_count());
    let plain = model(&block, &[0.01; 4], 1.0).solve(&conductivity).unwrap();
    let moved = model(&turned(&block), &[0.01; 4], 1.0).solve(&conductivity).unwrap();
    assert!(relative_difference(&moved, &plain) < EXACT);
}

/// The paper's Eq. 6-7: with the drives' columns in P and the measures' in M, `vec(M' dS P) = (P' kron M') vec(dS)`.
#[test]
fn the_papers_kronecker_form_is_the_frame_difference() {
    let disk = Reference::disk30();
    let protocol = Protocol::adjacent(30).unwrap();
    let model = ForwardModel::from_parts(&disk.mesh, &disk.contact_impedances, &protocol, &vec![1.0; 9600]).unwrap();
    let rest = model.network(model.rest_conductivity()).unwrap();
    let touched = model.network(&disk.column("sigma_inh.csv")).unwrap();
    let difference = &touched.frame(&protocol) - &rest.frame(&protocol);

    let pattern = |electrode: usize, pair: usize| match electrode {
        e if e == pair => 1.0,
        e if e == (pair + 1) % 30 => -1.0,
        _ => 0.0,
    };
    let mut kronecker = Vec::new();
    for drive in 0..30 {
        for measure in (0..30).filter(|&measure| measure != drive) {
            let mut value = 0.0;
            for column in 0..30 {
                for row in 0..30 {
                    let change = touched.transfer_impedance.at(row, column) - rest.transfer_impedance.at(row, column);
                    value += pattern(column, drive) * pattern(row, measure) * change;
                }
            }
            kronecker.push(value);
        }
    }
    let error = relative_difference(&kronecker, &difference);
    println!("Kronecker form against frames: {error:.2e}");
    assert!(error < 1e-12);
}

/// The adjoint derivative against central differences, `(v(s + h) - v(s - h)) / 2h`, error O(h^2) + rounding.
fn assert_derivative(model: &ForwardModel, what: &str) {
    let conductivity = uneven(model.mesh().cell_count());
    let jacobian = model.jacobian(&conductivity).unwrap();
    let (mut error, mut size) = (0.0, 0.0);
    for cell in (0..model.mesh().cell_count()).step_by(7) {
        let step = 1e-4 * conductivity[cell];
        let at = |change: f64| {
            let mut changed = conductivity.clone();
            changed[cell] += change;
            model.solve(&changed).unwrap()
        };
        let (above, below) = (at(step), at(-step));
        for channel in 0..jacobian.rows {
            let difference = (above[channel] - below[channel]) / (2.0 * step);
            error += (jacobian.at(channel, cell) - difference).powi(2);
            size += difference.powi(2);
        }
    }
    let relative = (error / size).sqrt();
    println!("Jacobian of {what} against central differences: {relative:.2e} (at most 1e-6)");
    assert!(relative <= 1e-6, "{relative:e}");
}

#[test]
fn the_jacobian_is_the_derivative_on_triangles_in_space() {
    // A tube: the strip rolled up by three quarters of a turn, so that no coordinate direction is special.
    let mut mesh = strip(0.3, 0.1, 9, 5);
    for node in &mut mesh.nodes {
        let angle = node[0] / 0.3 * 1.5 * PI;
        *node = [0.06 * angle.cos(), 0.06 * angle.sin(), node[1]];
    }
    assert_derivative(&model(&turned(&mesh), &[0.1; 4], 1.0), "triangles in space");
}

#[test]
fn the_jacobian_is_the_derivative_on_tetrahedra() {
    assert_derivative(&model(&block([0.3, 0.1, 0.05], [3, 3, 2]), &[0.01; 4], 1.0), "tetrahedra");
}

/// Modified Bessel functions by their power series, which converges for every argument.
fn bessel_ratio_i0_i1(x: f64) -> f64 {
    let (mut term, mut i0, mut i1) = (1.0, 0.0, 0.0);
    for k in 0..400 {
        i0 += term;
        i1 += term * x / 2.0 / (k + 1) as f64;
        term *= (x / 2.0).powi(2) / ((k + 1) as f64).powi(2);
    }
    i0 / i1
}

/// Radii that resolve the layer of width `l` inside the rim of the electrode and the logarithm outside.
fn graded_radii(a: f64, outer: f64, l: f64, refine: usize) -> (Vec<f64>, usize) {
    let layer = l.min(a / 2.0);
    let mut inside = Vec::new();
    let mut depth = 0.0;
    let mut step = layer / (2 * refine) as f64;
    while depth + step < a * 0.999 {
        inside.push(a - depth);
        depth += step;
        step = (step * (1.0 + 0.5 / refine as f64)).min(a / (4 * refine) as f64);
    }
    inside.reverse();
    let electrode_rings = inside.len();
    let growth = 1.0 + 0.25 / refine as f64;
    let count = ((outer / a).ln() / growth.ln()).ceil() as usize;
    inside.extend((1..=count).map(|k| a * (outer / a).powf(k as f64 / count as f64)));
    (inside, electrode_rings)
}

/// A disc electrode in the centre of a disk whose rim is one electrode: radially symmetric, hence exact: R = l I0(a/l)
/// / (2 pi a s I1(a/l)) + ln(R/a) / (2 pi s) + z_rim / (2 pi R), l = sqrt(s z).
#[test]
fn a_round_area_electrode_in_a_grounded_disk() {
    let (a, outer, s, rim) = (0.004, 0.05, 1e-3, 1e-3);
    for ratio in [0.5, 5.0, 50.0] {
        let l = a / ratio;
        let z = l * l / s;
        let exact = l * bessel_ratio_i0_i1(ratio) / (TAU * a * s) + (outer / a).ln() / (TAU * s) + rim / (TAU * outer);
        let errors: Vec<f64> = [1, 2, 4]
            .iter()
            .map(|&refine| {
                let (radii, rings) = graded_radii(a, outer, l, refine);
                let sectors = 32 * refine;
                let mut mesh = polar(&radii, sectors, TAU);
                let start = 1 + rings * sectors;
                mesh.electrodes = vec![
                    ElectrodePatch::Cells((0..polar_cells(rings, sectors)).collect()),
                    ElectrodePatch::Edges(polar_rim(&radii, sectors)),
                    ElectrodePatch::Node(start),
                    ElectrodePatch::Node(start + sectors / 2),
                ];
                let model = model(&mesh, &[z, rim, 1.0, 1.0], s);
                let network = model.network(model.rest_conductivity()).unwrap();
                resistance(&network, 0, 1) / exact - 1.0
            })
            .collect();
        let rate = (errors[0] / errors[2]).abs().log2() / 2.0;
        println!("round electrode, a/l = {ratio}: errors {errors:.5?} (at most 5e-3), rate {rate:.2}");
        assert!(errors[1].abs() <= 5e-3);
        assert!((1.7..2.4).contains(&rate), "second order is expected, not {rate:.2}");
    }
}

/// A half disc on an edge is a whole disc of the mirrored body at twice the current.
#[test]
fn a_half_disc_on_an_edge_is_a_mirrored_disc_at_twice_the_current() {
    let (radii, rings) = graded_radii(0.004, 0.05, 1e-3, 1);
    let sectors = 16;
    let mut half = polar(&radii, sectors, PI);
    let cells = match &half.cells {
        Cells::Triangles(cells) => cells.clone(),
        Cells::Tetrahedra(_) => unreachable!("polar makes triangles"),
    };
    // Mirrored copies of all nodes off the edge y = 0; the two ends of each ring are on it.
    let mut whole = half.clone();
    let mut twin: Vec<usize> = (0..half.node_count()).collect();
    for (node, twin) in twin.iter_mut().enumerate() {
        let [x, y, _] = half.nodes[node];
        if y.abs() > 1e-12 {
            *twin = whole.nodes.len();
            whole.nodes.push([x, -y, 0.0]);
        }
    }
    let mirrored = cells.iter().map(|&[i, j, k]| [twin[i], twin[k], twin[j]]);
    whole.cells = Cells::Triangles(cells.iter().copied().chain(mirrored).collect());

    let disc = polar_cells(rings, sectors);
    let last = 1 + (radii.len() - 1) * (sectors + 1);
    let rim: Vec<[usize; 2]> = (0..sectors).map(|k| [last + k, last + k + 1]).collect();
    // Both ends of the rim's arc are on the mirror line, so that the mirrored points are the same nodes.
    half.electrodes = vec![
        ElectrodePatch::Cells((0..disc).collect()),
        ElectrodePatch::Edges(rim.clone()),
        ElectrodePatch::Node(last - (sectors + 1)),
        ElectrodePatch::Node(last - 1),
    ];
    whole.electrodes = vec![
        ElectrodePatch::Cells((0..disc).chain(cells.len()..cells.len() + disc).collect()),
        ElectrodePatch::Edges(rim.iter().copied().chain(rim.iter().map(|edge| edge.map(|node| twin[node]))).collect()),
        half.electrodes[2].clone(),
        half.electrodes[3].clone(),
    ];
    let one = uneven(half.cell_count());
    let both: Vec<f64> = one.iter().chain(&one).copied().collect();
    let impedances = [2e-5, 1e-3, 1.0, 1.0];
    let half_frame = model(&half, &impedances, 1e-3).solve(&one).unwrap();
    let whole_frame = model(&whole, &impedances, 1e-3).solve(&both).unwrap();
    let doubled: Vec<f64> = whole_frame.iter().map(|value| 2.0 * value).collect();
    let error = relative_difference(&half_frame, &doubled);
    println!("half disc against mirrored disc: {error:.2e}");
    assert!(error < EXACT);
}

#[test]
fn bad_conductivities_and_impedances_are_named() {
    let disk = Reference::disk16();
    let model = disk.model();
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let mut conductivity = vec![1.0; disk.mesh.cell_count()];
        conductivity[17] = bad;
        let error = model.solve(&conductivity).unwrap_err();
        assert!(matches!(error, ForwardError::Conductivity { cell: 17, .. }), "{error}");
        let mut impedances = [0.01; 16];
        impedances[5] = bad;
        let rest = vec![1.0; disk.mesh.cell_count()];
        let error = ForwardModel::from_parts(&disk.mesh, &impedances, &disk.protocol, &rest).unwrap_err();
        assert!(error.to_string().contains("electrode 5"), "{error}");
    }
    assert!(matches!(model.solve(&[1.0]).unwrap_err(), ForwardError::Count { .. }));
}
