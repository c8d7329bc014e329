//! The default mesh of the paper's skin: its size and shape, and its voltages compared with a finer mesh (edges a
//! quarter as long).

use crate::reference::relative_difference;
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::frame::Frame;
use dermis::geom::vector::{dot, norm, sub};
use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use std::f64::consts::PI;

fn triangles(mesh: &Mesh) -> &[[usize; 3]] {
    match &mesh.cells {
        Cells::Triangles(triangles) => triangles,
        Cells::Tetrahedra(_) => panic!("a skin is a surface"),
    }
}

/// Smallest angle, degrees, and longest edge, m.
fn shape(mesh: &Mesh) -> (f64, f64) {
    let (mut smallest, mut longest) = (f64::INFINITY, 0.0f64);
    for corners in triangles(mesh) {
        let at = corners.map(|node| mesh.nodes[node]);
        for k in 0..3 {
            let (u, v) = (sub(at[(k + 1) % 3], at[k]), sub(at[(k + 2) % 3], at[k]));
            smallest = smallest.min((dot(u, v) / (norm(u) * norm(v))).acos().to_degrees());
            longest = longest.max(norm(u));
        }
    }
    (smallest, longest)
}

#[test]
fn the_default_mesh_is_small_graded_and_well_shaped() {
    let design = SkinDesign::load("cylinder30").unwrap();
    let mesh = Mesh::generate(&design).unwrap();
    let (angle, edge) = shape(&mesh);
    println!(
        "cylinder30: {} nodes, smallest angle {angle:.1} degrees, longest edge {:.2} mm",
        mesh.node_count(),
        edge * 1e3
    );
    assert!((4_500..=6_000).contains(&mesh.node_count()));
    assert!(angle >= 20.0 && edge <= 0.006);
    for (index, patch) in mesh.electrodes.iter().enumerate() {
        let ElectrodePatch::Cells(cells) = patch else { panic!("electrode {index} is a disc") };
        let area: f64 = cells.iter().map(|&cell| mesh.cell_measure(cell)).sum();
        // The outer rings are on the rims: half discs.
        let design_area = PI * 0.004 * 0.004 * if !(5..25).contains(&index) { 0.5 } else { 1.0 };
        assert!((area / design_area - 1.0).abs() < 0.01, "electrode {index}: {}", area / design_area);
    }
    // A tube closed around the axis: V - E + F = 0, every edge in two triangles except those of the two rims.
    let mut edges = std::collections::BTreeMap::new();
    for &[a, b, c] in triangles(&mesh) {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry((from.min(to), from.max(to))).or_insert(0) += 1;
        }
    }
    assert_eq!(mesh.node_count() + mesh.cell_count(), edges.len());
    assert!(edges.values().all(|&count| count == 1 || count == 2));
    let on_rim = |node: usize| mesh.nodes[node][2] == 0.0 || mesh.nodes[node][2] == 0.3;
    assert!(edges.iter().all(|(&(a, b), &count)| count == 2 || (on_rim(a) && on_rim(b))));
    assert!(mesh.nodes.iter().all(|node| (node[0].hypot(node[1]) - 0.05).abs() < 1e-12));
    assert_eq!(mesh, Mesh::generate(&design).unwrap(), "the same design gives the same mesh");
}

/// The values of a frame that share an electrode with their drive, and the others.
fn split(design: &SkinDesign, frame: &Frame) -> [Vec<f64>; 2] {
    let pick = |driven: bool| {
        let channels = design.protocol.channels().iter().zip(frame.iter());
        channels.filter(|(channel, _)| channel.touches_driven() == driven).map(|(_, value)| *value).collect()
    };
    [pick(true), pick(false)]
}

#[test]
fn the_default_mesh_gives_the_voltages_of_a_mesh_a_quarter_as_coarse() {
    let coarse = SkinDesign::load("cylinder30").unwrap();
    let mut fine = coarse.clone();
    fine.mesh = coarse.mesh.scaled(0.25);
    let meshes = [&coarse, &fine].map(|design| Mesh::generate(design).unwrap());
    println!("cylinder30: {} nodes against {}", meshes[0].node_count(), meshes[1].node_count());
    for impedance in [1e-7, 2e-5, 1e-3] {
        let frames = [&coarse, &fine].map(|design| {
            let mut design = design.clone();
            design.electrodes.iter_mut().for_each(|electrode| electrode.contact_impedance = impedance);
            let mesh = &meshes[usize::from(design.mesh == fine.mesh)];
            let model = ForwardModel::new(&design, mesh).unwrap();
            split(&design, &model.solve(model.rest_conductivity()).unwrap())
        });
        let driven = relative_difference(&frames[0][0], &frames[1][0]);
        let rest = relative_difference(&frames[0][1], &frames[1][1]);
        println!(
            "  {impedance:e} ohm m2: {:.2} % on driven, {:.2} % on the rest (at most 0.5)",
            driven * 1e2,
            rest * 1e2
        );
        assert!(driven <= 0.005 && rest <= 0.005);
    }
}
