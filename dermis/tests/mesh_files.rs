//! Mesh files: Gmsh's own examples, round trips, and invalid files.

use crate::shapes;
use dermis::design::SkinDesign;
use dermis::image::{Image, PixelSpace};
use dermis::mesh::export::CellField;
use dermis::mesh::{Cells, ElectrodePatch, Mesh, export, import};
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/bodies").join(name)
}

fn all_codings(stem: &str) -> Vec<Mesh> {
    let endings = ["2.2_ascii", "2.2_binary", "4.1_ascii", "4.1_binary"];
    endings.iter().map(|ending| import::load(&sample(&format!("{stem}_{ending}.msh")), 1e-3).unwrap()).collect()
}

fn total_measure(mesh: &Mesh) -> f64 {
    (0..mesh.cell_count()).map(|cell| mesh.cell_measure(cell)).sum()
}

fn area(mesh: &Mesh, faces: &[[usize; 3]]) -> f64 {
    faces.iter().map(|face| dermis::geom::vector::triangle_area(face.map(|node| mesh.nodes[node]))).sum()
}

#[test]
fn gmsh_volumes_of_both_versions_and_codings_are_one_mesh() {
    let meshes = all_codings("block");
    let mesh = &meshes[3];
    assert!(matches!(mesh.cells, Cells::Tetrahedra(_)));
    assert!((total_measure(mesh) - 8e-6).abs() < 1e-18, "the block holds 40 x 20 x 10 mm");
    assert_eq!(mesh.electrodes.len(), 4);
    for electrode in &mesh.electrodes[..2] {
        let ElectrodePatch::Faces(faces) = electrode else { panic!("{electrode:?}") };
        assert!((area(mesh, faces) - 2e-4).abs() < 1e-16, "an end is 20 x 10 mm");
    }
    let ElectrodePatch::Node(node) = mesh.electrodes[2] else { panic!() };
    assert_eq!(mesh.nodes[node], [0.0; 3]);
    assert_eq!(mesh.regions, [("gel".to_string(), (0..mesh.cell_count()).collect::<Vec<_>>())]);
    same(&meshes);
}

#[test]
fn gmsh_surfaces_of_both_versions_and_codings_are_one_mesh() {
    let meshes = all_codings("sheet");
    let mesh = &meshes[3];
    assert!((total_measure(mesh) - 8e-4).abs() < 1e-16);
    let area_of = |cells: &[usize]| cells.iter().map(|&cell| mesh.cell_measure(cell)).sum::<f64>();
    let ElectrodePatch::Edges(edges) = &mesh.electrodes[0] else { panic!() };
    assert!(edges.iter().flatten().all(|&node| mesh.nodes[node][0] == 0.0));
    let ElectrodePatch::Cells(disc) = &mesh.electrodes[2] else { panic!() };
    // A polygon inscribed in a circle: a little less than pi r2.
    let ratio = area_of(disc) / (std::f64::consts::PI * 9e-6);
    assert!(ratio > 0.7 && ratio < 1.0, "{ratio}");
    let names: Vec<&str> = mesh.regions.iter().map(|region| region.0.as_str()).collect();
    assert_eq!(names, ["sheet", "core", "left"]);
    assert_eq!(mesh.regions[0].1.len(), mesh.cell_count());
    assert_eq!(&mesh.regions[1].1, disc);
    assert!((area_of(&mesh.regions[2].1) - 2e-4).abs() < 1e-16);
    same(&meshes);
}

/// Version 2.2 writes text with 16 digits, so positions agree to rounding only.
fn same(meshes: &[Mesh]) {
    for mesh in &meshes[1..] {
        assert_eq!(mesh.cells, meshes[0].cells);
        assert_eq!(mesh.electrodes, meshes[0].electrodes);
        assert_eq!(mesh.regions, meshes[0].regions);
        let pairs = mesh.nodes.iter().flatten().zip(meshes[0].nodes.iter().flatten());
        assert!(
            pairs.clone().all(|(a, b)| (a - b).abs() < 1e-16),
            "{:?}",
            pairs.max_by(|a, b| (a.0 - a.1).abs().total_cmp(&(b.0 - b.1).abs()))
        );
    }
}

#[test]
fn what_is_written_as_msh_is_read_back_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.msh");
    let mut strip = shapes::strip(0.3, 0.1, 6, 3);
    strip.electrodes.push(ElectrodePatch::Cells(vec![3, 4, 9]));
    strip.regions = vec![("left half".into(), vec![0, 1, 4, 5]), ("empty".into(), vec![])];
    let block = shapes::block([0.3, 0.1, 0.1], [6, 2, 3]);
    let mut meshes = all_codings("sheet");
    meshes.extend(all_codings("block"));
    meshes.extend([strip, block]);
    for mesh in meshes {
        let conductivity = vec![0.25; mesh.cell_count()];
        export::save(&mesh, &path, Some(&conductivity)).unwrap();
        assert_eq!(import::load(&path, 1.0).unwrap(), mesh);
        if let Ok(folder) = std::env::var("DERMIS_KEEP_MESHES") {
            // Written for inspection with other programs.
            let name = format!("{}_{}.msh", mesh.node_count(), mesh.cell_count());
            std::fs::copy(&path, Path::new(&folder).join(name)).unwrap();
        }
    }
}

/// The numbers of a VTU file's array.
fn vtu_array(text: &str, name: &str) -> Vec<f64> {
    let start = text.find(&format!("Name=\"{name}\"")).unwrap_or_else(|| panic!("no array {name}"));
    let body = &text[start..];
    let body = &body[body.find('>').unwrap() + 1..body.find("</DataArray>").unwrap()];
    body.split_whitespace().map(|word| word.parse().unwrap()).collect()
}

/// Images of a grid and of cells, as separate arrays: a constant image stays constant, and the sum over cells equals
/// the integral over the pixels.
#[test]
fn a_vtu_file_holds_images_per_cell() {
    let mut design = SkinDesign::shipped("cylinder30").unwrap();
    design.mesh = design.mesh.scaled(2.0);
    let mesh = Mesh::generate(&design).unwrap();
    let space = Arc::new(PixelSpace::for_design(&design, &mesh).unwrap());
    let along_z = space.centres_m.iter().map(|centre| centre[2]).collect();
    let images = [vec![0.25; space.len()], along_z].map(|values| Image { space: Arc::clone(&space), values });
    let names = ["constant", "height < \"z\""];
    let fields: Vec<CellField> = images
        .iter()
        .zip(names)
        .map(|(image, name)| CellField { name: name.into(), values: image.to_cells(mesh.cell_count()) })
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("images.vtu");
    export::save_cell_fields(&mesh, &path, &fields).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let constant = vtu_array(&text, "constant");
    assert!(constant[..mesh.cell_count()].iter().all(|value| (value - 0.25).abs() < 1e-12));
    let height = vtu_array(&text, "height &lt; &quot;z&quot;");
    // A pixel is 10 mm high: the mean over a cell is the height of its centre to half a pixel and half a cell (12 mm).
    for (cell, value) in height[..mesh.cell_count()].iter().enumerate() {
        assert!((value - mesh.cell_centre(cell)[2]).abs() < 0.005 + 0.006, "cell {cell}");
    }
}

#[test]
fn a_vtu_file_holds_the_mesh_its_electrodes_and_its_conductivity() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.vtu");
    for mesh in [all_codings("block").remove(0), all_codings("sheet").remove(0)] {
        let conductivity: Vec<f64> = (0..mesh.cell_count()).map(|cell| 1.0 / (cell + 3) as f64).collect();
        export::save(&mesh, &path, Some(&conductivity)).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(vtu_array(&text, "Points"), mesh.nodes.as_flattened());
        let ends: Vec<usize> = vtu_array(&text, "offsets").iter().map(|&end| end as usize).collect();
        let corners: Vec<usize> = vtu_array(&text, "connectivity").iter().map(|&node| node as usize).collect();
        let electrode = vtu_array(&text, "electrode");
        let cells: Vec<&[usize]> =
            (0..ends.len()).map(|k| &corners[if k == 0 { 0 } else { ends[k - 1] }..ends[k]]).collect();
        for (cell, corners) in cells.iter().take(mesh.cell_count()).enumerate() {
            assert_eq!(*corners, mesh.cells.corners(cell));
        }
        for (number, patch) in mesh.electrodes.iter().enumerate() {
            let shown: Vec<usize> = (0..cells.len()).filter(|&k| electrode[k] == number as f64).collect();
            let nodes: Vec<Vec<usize>> = shown.iter().map(|&k| cells[k].to_vec()).collect();
            match patch {
                ElectrodePatch::Cells(list) => assert_eq!(&shown, list),
                ElectrodePatch::Edges(list) => assert_eq!(nodes, list.iter().map(|e| e.to_vec()).collect::<Vec<_>>()),
                ElectrodePatch::Faces(list) => assert_eq!(nodes, list.iter().map(|f| f.to_vec()).collect::<Vec<_>>()),
                ElectrodePatch::Node(node) => assert_eq!(nodes, [[*node]]),
            }
        }
        assert_eq!(vtu_array(&text, "conductivity")[..mesh.cell_count()], conductivity);
    }
}

#[test]
fn the_outside_of_a_volume_is_written_as_stl() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.stl");
    export::save(&shapes::block([0.5, 0.25, 0.125], [4, 2, 1]), &path, None).unwrap();
    let mesh = import::load(&path, 1.0).unwrap();
    assert_eq!(mesh.cell_count(), 2 * 2 * (8 + 4 + 2));
    assert_eq!(total_measure(&mesh), 2.0 * (0.5 * 0.25 + 0.5 * 0.125 + 0.25 * 0.125));
    // Written with outward orientation, so that reading reverses no triangle.
    let bytes = std::fs::read(&path).unwrap();
    let number = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let first = [0, 1, 2].map(|k| number(84 + 4 * k));
    let corner = [0, 1, 2].map(|k| number(96 + 4 * k));
    let centre = [0.25, 0.125, 0.0625];
    assert!((0..3).map(|k| first[k] * (corner[k] - centre[k])).sum::<f32>() > 0.0);
}
