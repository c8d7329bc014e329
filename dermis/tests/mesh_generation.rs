//! Generated meshes: their shape, and the accuracy of a forward model on them.

use dermis::design::{Body, Electrode, ElectrodeShape, MeshOptions, SkinDesign};
use dermis::geom::Point3;
use dermis::mesh::quality::{ElectrodeReport, MeshReport};
use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use dermis::protocol::Protocol;
use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};

fn cylinder30() -> SkinDesign {
    SkinDesign::shipped("cylinder30").unwrap()
}

/// A flat or rolled body with some electrodes; sheet and protocol do not affect the mesh.
fn skin(body: Body, electrodes: &[(Point3, ElectrodeShape)], mesh: MeshOptions) -> SkinDesign {
    let electrodes: Vec<Electrode> =
        electrodes.iter().map(|&(centre_m, shape)| Electrode { centre_m, shape, contact_impedance: 1e-3 }).collect();
    let protocol = Protocol::adjacent(electrodes.len()).unwrap();
    SkinDesign { body, electrodes, protocol, mesh, ..cylinder30() }
}

fn disc(x: f64, y: f64, z: f64, radius_m: f64) -> (Point3, ElectrodeShape) {
    ([x, y, z], ElectrodeShape::Disc { radius_m })
}

/// Generates a mesh, checks the properties of every mesh and prints the report.
fn generated(what: &str, design: &SkinDesign) -> (Mesh, MeshReport) {
    let start = std::time::Instant::now();
    let mesh = Mesh::generate(design).unwrap_or_else(|error| panic!("{what}: {error}"));
    let took = start.elapsed();
    mesh.validate().unwrap();
    let places: BTreeSet<_> = mesh.nodes.iter().map(|node| node.map(|x| (x * 1e9).round() as i64)).collect();
    assert_eq!(places.len(), mesh.node_count(), "{what}: no two nodes at one place");
    let report = MeshReport::new(design, &mesh);
    println!(
        "{what}: {} nodes, {} cells, smallest angle {:.1} degrees, edges {:.3} to {:.3} mm, electrodes {:.4?} of their \
         design, {took:.2?}",
        report.node_count,
        report.cell_count,
        report.smallest_angle_rad.to_degrees(),
        report.shortest_edge_m * 1e3,
        report.longest_edge_m * 1e3,
        electrode_ratios(&report),
    );
    assert!(report.longest_edge_m <= design.mesh.max_edge_m, "{what}: an edge of {} m", report.longest_edge_m);
    (mesh, report)
}

/// Lowest and highest ratio of an electrode's size to its designed one.
fn electrode_ratios(report: &MeshReport) -> Option<[f64; 2]> {
    let ratios: Vec<f64> = report.electrodes.iter().filter_map(ElectrodeReport::ratio).collect();
    let least = ratios.iter().copied().reduce(f64::min)?;
    Some([least, ratios.into_iter().fold(least, f64::max)])
}

fn assert_electrodes(what: &str, report: &MeshReport) {
    let [low, high] = electrode_ratios(report).unwrap();
    assert!(low > 0.99 && high < 1.01, "{what}: electrodes have {low} to {high} of their designed sizes");
}

fn assert_angle(what: &str, report: &MeshReport) {
    let degrees = report.smallest_angle_rad.to_degrees();
    assert!(degrees >= 20.0, "{what}: the smallest angle is {degrees} degrees");
}

#[test]
fn the_papers_cylinder_keeps_its_bounds() {
    let (mesh, report) = generated("cylinder30", &cylinder30());
    assert!((4000..=6000).contains(&report.node_count), "{} nodes", report.node_count);
    assert_angle("cylinder30", &report);
    assert_electrodes("cylinder30", &report);
    for [x, y, z] in mesh.nodes {
        assert!((x.hypot(y) - 0.05).abs() < 1e-15 && (0.0..=0.3).contains(&z));
    }
}

#[test]
fn the_same_design_gives_the_same_mesh_on_any_number_of_threads() {
    let first = Mesh::generate(&cylinder30()).unwrap();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let again = pool.install(|| Mesh::generate(&cylinder30())).unwrap();
        assert_eq!(first, again);
        assert_eq!(first.hash(), again.hash());
    }
}

/// Electrodes may be on the seam, across it, or next to it: the mesh must be closed in all cases.
#[test]
fn the_seam_closes_wherever_the_electrodes_are() {
    for turn in [0.0, 1e-12, 0.003, 0.02, 0.04, 0.079, 0.081, 0.3, -1e-9, TAU - 0.05] {
        let mut design = cylinder30();
        for electrode in &mut design.electrodes {
            let [x, y, z] = electrode.centre_m;
            let (sin, cos) = turn.sin_cos();
            electrode.centre_m = [x * cos - y * sin, x * sin + y * cos, z];
        }
        let what = format!("turned by {turn}");
        let (_, report) = generated(&what, &design);
        assert_electrodes(&what, &report);
        assert_angle(&what, &report);
    }
}

/// Discs of eight corners without a point inside are all ties: their copies must be divided in the same way.
#[test]
fn tiny_discs_on_the_seam_close() {
    let mesh = MeshOptions { max_edge_m: 0.006, electrode_edge_m: 0.002, growth: 0.4, correct_arc_ends: true };
    let body = Body::Cylinder { length_m: 0.06, diameter_m: 0.04 };
    for turn in 0..20 {
        let at = |k: usize| {
            let angle = 0.01 * turn as f64 + k as f64 * TAU / 6.0;
            disc(0.02 * angle.cos(), 0.02 * angle.sin(), 0.01 + 0.008 * k as f64, 0.001)
        };
        let electrodes: Vec<_> = (0..6).map(at).collect();
        let (_, report) = generated("tiny discs", &skin(body.clone(), &electrodes, mesh));
        assert_electrodes("tiny discs", &report);
    }
}

#[test]
fn outlines_are_clipped_at_edges_and_corners() {
    let mesh = MeshOptions { max_edge_m: 0.006, electrode_edge_m: 0.0008, growth: 0.3, correct_arc_ends: true };
    let sheet = Body::Rectangle { width_m: 0.1, height_m: 0.06 };
    let electrodes = [
        disc(0.0, 0.0, 0.0, 0.005),
        disc(0.1, 0.03, 0.0, 0.004),
        disc(0.05, 0.002, 0.0, 0.004),
        disc(0.05, 0.03, 0.0, 0.006),
        ([0.1, 0.06, 0.0], ElectrodeShape::Arc { length_m: 0.01 }),
        ([0.0, 0.03, 0.0], ElectrodeShape::Arc { length_m: 0.004 }),
        ([0.02, 0.02, 0.0], ElectrodeShape::Point),
        ([0.03, 0.06, 0.0], ElectrodeShape::Point),
    ];
    let (laid, report) = generated("rectangle", &skin(sheet, &electrodes, mesh));
    assert_electrodes("rectangle", &report);
    assert_angle("rectangle", &report);
    for electrode in [6, 7] {
        let ElectrodePatch::Node(node) = laid.electrodes[electrode] else { panic!("a point is a node") };
        assert_eq!(laid.nodes[node], electrodes[electrode].0);
    }
    let corner = &laid.electrodes[4];
    assert!(
        matches!(corner, ElectrodePatch::Edges(edges) if edges.iter().flatten().any(|&node| laid.nodes[node] == [0.1, 0.06, 0.0]))
    );

    let disk = Body::Disk { diameter_m: 0.1 };
    let round = |angle: f64, radius: f64| [0.05 * angle.cos(), 0.05 * angle.sin(), radius];
    let rim: Vec<_> = (0..8)
        .map(|k| {
            let [x, y, _] = round(0.3 + k as f64 * TAU / 8.0, 0.0);
            disc(x, y, 0.0, 0.004)
        })
        .chain([disc(0.0, 0.0, 0.0, 0.003), disc(0.02, 0.02, 0.0, 0.004)])
        .collect();
    let (_, report) = generated("disk with discs", &skin(disk, &rim, mesh));
    assert_electrodes("disk with discs", &report);
    assert_angle("disk with discs", &report);
}

#[test]
fn shipped_disks_keep_their_bounds() {
    for name in ["skin16", "tank16"] {
        let (_, report) = generated(name, &SkinDesign::shipped(name).unwrap());
        assert_angle(name, &report);
        assert_electrodes(name, &report);
    }
}

#[test]
fn what_cannot_be_meshed_is_named() {
    let complaint = |change: &dyn Fn(&mut SkinDesign)| {
        let mut design = cylinder30();
        change(&mut design);
        Mesh::generate(&design).unwrap_err().to_string()
    };
    let overlap = complaint(&|design| design.electrodes[7].centre_m = design.electrodes[8].centre_m);
    assert!(overlap.contains("electrodes 7 and 8 overlap"), "{overlap}");
    let huge = complaint(&|design| design.electrodes[3].shape = ElectrodeShape::Disc { radius_m: 0.2 });
    assert!(huge.contains("electrode 3") && huge.contains("larger"), "{huge}");
    let fine = complaint(&|design| design.mesh = design.mesh.scaled(1e-3));
    assert!(fine.contains("cells") || fine.contains("nodes"), "{fine}");
    let group = complaint(&|design| design.electrodes[2].shape = ElectrodeShape::Group);
    assert!(group.contains("electrode 2"), "{group}");
}

/// Scaling the options scales every edge: four times finer gives sixteen times the cells.
#[test]
fn a_quarter_of_the_size_has_sixteen_times_the_cells() {
    let coarse = cylinder30();
    let fine = SkinDesign { mesh: coarse.mesh.scaled(0.25), ..coarse.clone() };
    let (_, coarse) = generated("cylinder30", &coarse);
    let (_, fine) = generated("a quarter of the size", &fine);
    let ratio = fine.cell_count as f64 / coarse.cell_count as f64;
    assert!((14.0..18.0).contains(&ratio), "{ratio}");
    assert_angle("a quarter of the size", &fine);
    assert_electrodes("a quarter of the size", &fine);
}

#[test]
fn triangles_face_outwards() {
    let mesh = Mesh::generate(&cylinder30()).unwrap();
    let Cells::Triangles(cells) = &mesh.cells else { panic!("a cylinder has triangles") };
    let area: f64 = (0..cells.len()).map(|cell| mesh.cell_measure(cell)).sum();
    assert!((area / (PI * 0.1 * 0.3) - 1.0).abs() < 1e-3);
    for &cell in cells {
        let [a, b, c] = cell.map(|node| mesh.nodes[node]);
        let (u, v) = (dermis::geom::vector::sub(b, a), dermis::geom::vector::sub(c, a));
        let normal = dermis::geom::vector::cross(u, v);
        assert!(normal[0] * a[0] + normal[1] * a[1] > 0.0);
    }
}
