//! Skins on free bodies: electrodes placed on surfaces from files.

#[path = "../examples/forearm.rs"]
#[allow(dead_code, reason = "its main is for running it")]
mod forearm;

use dermis::design::{Body, Electrode, ElectrodeShape, MeshOptions, SkinDesign};
use dermis::forward::ForwardModel;
use dermis::geom::Point3;
use dermis::geom::vector::{distance, triangle_area};
use dermis::mesh::{Cells, ElectrodePatch, Mesh, MeshError, export, import};
use dermis::protocol::{Channel, Protocol};
use std::f64::consts::PI;
use std::path::Path;

fn smallest_angle_deg(mesh: &Mesh) -> f64 {
    let Cells::Triangles(cells) = &mesh.cells else { panic!() };
    let mut smallest = f64::INFINITY;
    for &cell in cells {
        let [a, b, c] = cell.map(|node| mesh.nodes[node]);
        for [p, q, r] in [[a, b, c], [b, c, a], [c, a, b]] {
            let (u, v) = (distance(q, p), distance(r, p));
            let sine = 2.0 * triangle_area([p, q, r]) / (u * v);
            let cosine = (u * u + v * v - distance(q, r).powi(2)) / (2.0 * u * v);
            smallest = sine.atan2(cosine).to_degrees().min(smallest);
        }
    }
    smallest
}

fn area(mesh: &Mesh, patch: &ElectrodePatch) -> f64 {
    let ElectrodePatch::Cells(cells) = patch else { panic!("{patch:?}") };
    cells.iter().map(|&cell| mesh.cell_measure(cell)).sum()
}

/// A design like the shipped forearm's, on another body.
fn design(path: &Path, electrodes: &[(Point3, ElectrodeShape)], max_edge_m: f64) -> SkinDesign {
    let mut design = forearm_design();
    design.body = Body::Mesh { file: path.into(), unit_m: 1.0 };
    let electrode =
        |&(centre_m, shape): &(Point3, ElectrodeShape)| Electrode { centre_m, shape, contact_impedance: 2e-5 };
    design.electrodes = electrodes.iter().map(electrode).collect();
    let radius_m = |electrode: &Electrode| match electrode.shape {
        ElectrodeShape::Disc { radius_m } => radius_m,
        _ => f64::INFINITY,
    };
    let smallest_m = design.electrodes.iter().map(radius_m).fold(f64::INFINITY, f64::min);
    design.mesh = MeshOptions { max_edge_m, electrode_edge_m: smallest_m / 5.0, growth: 0.3, correct_arc_ends: true };
    design
}

fn forearm_design() -> SkinDesign {
    SkinDesign::load(concat!(env!("CARGO_MANIFEST_DIR"), "/designs/forearm.toml")).unwrap()
}

/// Saves a surface and places electrodes on it.
fn placed(surface: &Mesh, electrodes: &[(Point3, ElectrodeShape)], max_edge_m: f64) -> Result<Mesh, MeshError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("body.stl");
    export::save(surface, &path, None).unwrap();
    import::from_design(&design(&path, electrodes, max_edge_m))
}

fn disc(radius_m: f64) -> ElectrodeShape {
    ElectrodeShape::Disc { radius_m }
}

/// Twelve triangles: the corners of a box, side lengths in m.
fn cube(side_m: f64) -> Mesh {
    let nodes = (0..8).map(|k| [k & 1, k >> 1 & 1, k >> 2 & 1].map(|bit| side_m * bit as f64)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh { nodes, cells: Cells::Triangles(triangles), electrodes: vec![], regions: vec![] }
}

/// Two triangles: a square in the plane z = 0.
fn square(side_m: f64) -> Mesh {
    let nodes = vec![[0.0; 3], [side_m, 0.0, 0.0], [side_m, side_m, 0.0], [0.0, side_m, 0.0]];
    Mesh { nodes, cells: Cells::Triangles(vec![[0, 1, 2], [0, 2, 3]]), electrodes: vec![], regions: vec![] }
}

fn total_area(mesh: &Mesh) -> f64 {
    (0..mesh.cell_count()).map(|cell| mesh.cell_measure(cell)).sum()
}

fn longest_edge(mesh: &Mesh) -> f64 {
    let Cells::Triangles(cells) = &mesh.cells else { panic!() };
    let edges = cells.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    edges.map(|[a, b]| distance(mesh.nodes[a], mesh.nodes[b])).fold(0.0, f64::max)
}

#[test]
fn the_shipped_forearm_is_what_its_example_makes() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("designs/forearm.stl");
    let shipped = import::load(&path, 1.0).unwrap();
    let made = forearm::sleeve();
    assert_eq!(shipped.node_count(), made.node_count(), "doubled vertices are welded");
    assert_eq!(shipped.cell_count(), made.cell_count());
    // Single precision.
    assert!((total_area(&shipped) / total_area(&made) - 1.0).abs() < 1e-6);
}

#[test]
fn the_forearm_gets_round_electrodes_and_well_shaped_triangles() {
    let design = forearm_design();
    let mesh = import::from_design(&design).unwrap();
    let angle_deg = smallest_angle_deg(&mesh);
    println!("{} nodes, {} triangles, smallest angle {angle_deg:.1} degrees", mesh.node_count(), mesh.cell_count());
    assert!(angle_deg > 20.0, "{angle_deg}");
    for (electrode, patch) in design.electrodes.iter().zip(&mesh.electrodes) {
        let ElectrodeShape::Disc { radius_m } = electrode.shape else { panic!() };
        let ratio = area(&mesh, patch) / (PI * radius_m * radius_m);
        println!("area of the electrode over pi r2: {ratio:.4}");
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    }
    // Nodes are on the facets of the file; chords across its shallow edges reduce the area slightly.
    let sleeve = total_area(&forearm::sleeve()) * 1e-6;
    assert!((total_area(&mesh) / sleeve - 1.0).abs() < 2e-3, "{}", total_area(&mesh) / sleeve);
    assert_eq!(import::from_design(&design).unwrap(), mesh, "the same design gives the same mesh");
}

#[test]
fn a_design_carries_the_files_that_it_names() {
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("arm.toml").to_string_lossy().into_owned();
    let text = SkinDesign::text_of(concat!(env!("CARGO_MANIFEST_DIR"), "/designs/forearm.toml")).unwrap();
    std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/designs/forearm.stl"), folder.path().join("forearm.stl"))
        .unwrap();
    let design = SkinDesign::parse(&text, &name).unwrap();
    let table = text.replace(r#"pattern = "adjacent""#, r#"pattern = { table = "pairs.csv" }"#);
    assert_ne!(table, text);
    std::fs::write(folder.path().join("pairs.csv"), design.protocol.to_csv()).unwrap();
    let carried = SkinDesign::with_files(&table, &name).unwrap();
    drop(folder);
    let alone = SkinDesign::parse(&carried, "elsewhere.toml").unwrap();
    assert_eq!((alone.sha256(), &alone.protocol), (design.sha256(), &design.protocol));
    assert_eq!(import::from_design(&alone).unwrap(), import::from_design(&forearm_design()).unwrap());
    // What carries its files needs no others, and the values of a fit are written before them.
    assert_eq!(SkinDesign::with_files(&carried, "elsewhere.toml").unwrap(), carried);
    assert_eq!(alone.rewrite(&carried, "elsewhere.toml").unwrap(), carried);
    let missing = SkinDesign::with_files(&table, "nowhere/arm.toml").unwrap_err().to_string();
    assert!(missing.contains("nowhere/"), "{missing}");
}

#[test]
fn a_coarse_cube_is_refined_and_keeps_its_edges() {
    // A side that is exact in single precision.
    let (side, half) = (0.125, 0.0625);
    let centres = [[half, half, 0.0], [half, half, side], [0.0, half, half], [side, half, half]];
    let mesh = placed(&cube(side), &centres.map(|centre| (centre, disc(0.01))), 0.008).unwrap();
    println!("{} nodes, smallest angle {:.1}", mesh.node_count(), smallest_angle_deg(&mesh));
    assert!(
        (total_area(&mesh) / (6.0 * side * side) - 1.0).abs() < 1e-12,
        "nothing was cut off: {}",
        total_area(&mesh)
    );
    assert!(longest_edge(&mesh) < 0.008 * 4.0 / 3.0 + 1e-12);
    assert!(smallest_angle_deg(&mesh) > 20.0, "{}", smallest_angle_deg(&mesh));
    for patch in &mesh.electrodes {
        let ratio = area(&mesh, patch) / (PI * 1e-4);
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    }
}

#[test]
fn a_disc_across_an_edge_of_the_body_is_clipped() {
    let side = 0.1;
    let centres = [[0.05, 0.0, 0.0], [0.0, 0.0, 0.0], [0.1, 0.05, 0.0], [0.05, 0.1, 0.0]];
    let mesh = placed(&square(side), &centres.map(|centre| (centre, disc(0.01))), 0.008).unwrap();
    assert!((total_area(&mesh) / (side * side) - 1.0).abs() < 1e-7, "{}", total_area(&mesh));
    println!("{} nodes, smallest angle {:.1}", mesh.node_count(), smallest_angle_deg(&mesh));
    for (patch, part) in mesh.electrodes.iter().zip([0.5, 0.25, 0.5, 0.5]) {
        let ratio = area(&mesh, patch) / (part * PI * 1e-4);
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    }
    assert!(smallest_angle_deg(&mesh) > 20.0, "{}", smallest_angle_deg(&mesh));
}

#[test]
fn a_disc_on_one_side_of_a_thin_body_leaves_the_other_side_alone() {
    // A plate 2 mm thick: the ball of a disc of 10 mm extends through it.
    let mut plate = cube(0.1);
    plate.nodes.iter_mut().for_each(|node| node[2] *= 0.02);
    let centres = [[0.03, 0.05, 0.002], [0.07, 0.05, 0.002], [0.05, 0.02, 0.002], [0.05, 0.08, 0.002]];
    let mesh = placed(&plate, &centres.map(|centre| (centre, disc(0.01))), 0.008).unwrap();
    for patch in &mesh.electrodes {
        let ElectrodePatch::Cells(cells) = patch else { panic!() };
        assert!(cells.iter().all(|&cell| mesh.cell_centre(cell)[2] > 0.0015));
        assert!((area(&mesh, patch) / (PI * 1e-4) - 1.0).abs() < 0.01);
    }
}

#[test]
fn point_electrodes_sit_on_nodes_where_the_design_puts_them() {
    let centres = [[0.0312, 0.0477, 0.0], [0.05, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0777, 0.1, 0.0]];
    let mesh = placed(&square(0.1), &centres.map(|centre| (centre, ElectrodeShape::Point)), 0.008).unwrap();
    for (patch, centre) in mesh.electrodes.iter().zip(centres) {
        let ElectrodePatch::Node(node) = *patch else { panic!() };
        assert!(distance(mesh.nodes[node], centre) < 1e-8, "rounded to single precision in the file");
    }
    println!("{} nodes, smallest angle {:.1}", mesh.node_count(), smallest_angle_deg(&mesh));
    assert!(smallest_angle_deg(&mesh) > 20.0);
}

#[test]
fn electrodes_off_the_body_or_on_top_of_one_another_are_errors() {
    let good = [[0.02, 0.02, 0.0], [0.08, 0.02, 0.0], [0.08, 0.08, 0.0], [0.02, 0.08, 0.0]];
    let mut off = good;
    off[2][2] = 0.0101;
    let error = placed(&square(0.1), &off.map(|centre| (centre, disc(0.01))), 0.01).unwrap_err().to_string();
    assert!(error.contains("electrode 2") && error.contains("off the body"), "{error}");
    off[2][2] = 0.0099;
    let mesh = placed(&square(0.1), &off.map(|centre| (centre, disc(0.01))), 0.01).unwrap();
    assert!((area(&mesh, &mesh.electrodes[2]) / (PI * 1e-4) - 1.0).abs() < 0.01, "brought onto the body");
    let mut near = good;
    near[1] = [0.0399, 0.02, 0.0];
    let error = placed(&square(0.1), &near.map(|centre| (centre, disc(0.01))), 0.01).unwrap_err().to_string();
    assert!(error.contains("electrodes 0 and 1 overlap"), "{error}");
    let error = placed(&square(0.1), &good.map(|centre| (centre, disc(0.01))), 1e-5).unwrap_err().to_string();
    assert!(error.contains("max_edge_m"), "{error}");
}

/// Tolerance for laws that hold in exact arithmetic.
const EXACT: f64 = 1e-10;

#[test]
fn the_forearm_obeys_reciprocity_and_scaling() {
    let design = forearm_design();
    let mesh = Mesh::generate(&design).unwrap();
    let model = ForwardModel::new(&design, &mesh).unwrap();
    let uneven: Vec<f64> = (0..mesh.cell_count()).map(|cell| 1e-3 * (1.5 + (cell as f64 * 0.7).sin())).collect();
    let frame = model.solve(&uneven).unwrap();
    assert_eq!(frame.len(), 20 * 19);
    let channels = design.protocol.channels();
    for (index, channel) in channels.iter().enumerate() {
        let twin = channels.iter().position(|other| *other == channel.reciprocal()).unwrap();
        assert!((frame[index] - frame[twin]).abs() < EXACT * frame[0].abs(), "{channel:?}");
    }
    let factor = 37.0;
    let more: Vec<f64> = uneven.iter().map(|value| value * factor).collect();
    let better = vec![2e-5 / factor; 20];
    let scaled = ForwardModel::from_parts(&mesh, &better, &design.protocol, &more).unwrap().solve(&more).unwrap();
    for (value, scaled) in frame.iter().zip(scaled.iter()) {
        assert!((value - scaled * factor).abs() < EXACT * frame[0].abs());
    }
}

/// A potential that is linear along the block is exact on any mesh of it: `R = l / (sigma A) + 2 z / A`, and without
/// the contacts `l / (sigma A)` between points on the two ends.
#[test]
fn a_block_from_a_file_has_its_exact_resistance() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/bodies/block_4.1_binary.msh");
    let mesh = import::load(&path, 1e-3).unwrap();
    let (conductivity, z) = (0.7, 0.013);
    let (length, area) = (0.04, 2e-4);
    let channels = [[0, 1], [2, 3]].map(|measure| Channel { drive: [0, 1], measure });
    let protocol = Protocol::new(4, channels.to_vec()).unwrap();
    let model = ForwardModel::from_parts(&mesh, &[z; 4], &protocol, &vec![conductivity; mesh.cell_count()]).unwrap();
    let frame = model.solve(model.rest_conductivity()).unwrap();
    let inner = length / (conductivity * area);
    let exact = [inner + 2.0 * z / area, inner];
    for (value, exact) in frame.iter().zip(exact) {
        println!("block from a file: {:.1e} from the exact {exact:.1} ohm", value / exact - 1.0);
        assert!((value / exact - 1.0).abs() < EXACT, "{value} ohm, exact {exact} ohm");
    }
}
