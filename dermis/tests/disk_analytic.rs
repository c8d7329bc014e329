//! Generated meshes of the unit disk against the exact disk: 30 arcs that cover half of its rim.

use crate::reference::{path, relative_difference, table};
use dermis::design::{Body, Electrode, ElectrodeShape, ImageLayout, MeshOptions, SkinDesign};
use dermis::forward::ForwardModel;
use dermis::mesh::Mesh;
use dermis::protocol::{Channel, Protocol};
use std::f64::consts::{PI, TAU};

/// The disk of `data/reference/disk30_5k`: contact impedance 0.01 ohm m, sheet conductance 1 S.
fn unit_disk(mesh: MeshOptions) -> SkinDesign {
    let arc = |k: usize| {
        let (sin, cos) = (k as f64 * TAU / 30.0).sin_cos();
        let shape = ElectrodeShape::Arc { length_m: PI / 30.0 };
        Electrode { centre_m: [cos, sin, 0.0], shape, contact_impedance: 0.01 }
    };
    let pairs = |name: &str| -> Vec<[usize; 2]> {
        table(&path("disk30_5k").join(name)).iter().map(|row| [row[0] as usize, row[1] as usize]).collect()
    };
    let measures = pairs("meas.csv");
    let channels = pairs("inj.csv")
        .into_iter()
        .flat_map(|drive| measures.iter().map(move |&measure| Channel { drive, measure }))
        .collect();
    let mut design = SkinDesign::load("cylinder30").unwrap();
    design.body = Body::Disk { diameter_m: 2.0 };
    design.sheet.conductance = 1.0;
    design.electrodes = (0..30).map(arc).collect();
    design.protocol = Protocol::new(30, channels).unwrap();
    design.image = ImageLayout::Grid { rows: 30, columns: 30 };
    design.mesh = mesh;
    design
}

/// Nodes, and relative L2 errors of self pairs, of values that touch a driven electrode, and of the rest.
fn errors(mesh: MeshOptions) -> (usize, [f64; 3]) {
    let design = unit_disk(mesh);
    let mesh = Mesh::generate(&design).unwrap();
    let model = ForwardModel::new(&design, &mesh).unwrap();
    let ours = model.solve(model.rest_conductivity()).unwrap();
    let exact: Vec<f64> = table(&path("disk30_5k").join("analytic_V.csv")).into_iter().flatten().collect();
    let shared = |channel: &Channel| channel.measure.iter().filter(|one| channel.drive.contains(one)).count();
    let error = |count: usize| {
        let of = |values: &[f64]| -> Vec<f64> {
            let channels = design.protocol.channels().iter().zip(values);
            channels.filter(|(channel, _)| shared(channel) == count).map(|(_, value)| *value).collect()
        };
        relative_difference(&of(&ours), &of(&exact))
    };
    (mesh.node_count(), [error(2), error(1), error(0)])
}

/// The corrected accuracy of linear elements with 5,000 nodes. Finer meshes should converge with at least second order.
#[test]
fn errors_on_the_exact_disk_fall_with_second_order() {
    let options = MeshOptions { max_edge_m: 0.15, electrode_edge_m: 0.006, growth: 0.17, correct_arc_ends: true };
    let levels = [2.0, 1.0, 0.5].map(|factor| errors(options.scaled(factor)));
    for (nodes, [own, driven, rest]) in levels {
        let percent = [own, driven, rest].map(|error| error * 100.0);
        println!(
            "unit disk, {nodes} nodes: self {:.2} %, driven {:.2} %, rest {:.2} %",
            percent[0], percent[1], percent[2]
        );
    }
    assert!(levels[1].0 <= 5_000, "{} nodes", levels[1].0);
    for kind in 0..3 {
        let rate = (levels[1].1[kind] / levels[2].1[kind]).log2();
        println!("  rate {rate:.2}");
        assert!(rate > 1.6);
    }
    let [own, driven, rest] = levels[1].1;
    assert!(own < 0.005 && driven < 0.005 && rest < 0.001);
}
