//! Invalid mesh files: each is refused with the problem and its place.

use dermis::design::{Body, ElectrodeShape, ImageLayout, SkinDesign};
use dermis::mesh::import::{self, Format};
use dermis::mesh::{Mesh, MeshError, export};
use dermis::protocol::Protocol;
use std::path::Path;

/// A strip 2 x 1 of four triangles: electrodes 0 and 1 on its ends, 2 and 3 the points between.
const STRIP: &str = "$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
5
0 3 \"electrode_2\"
0 4 \"electrode_3\"
1 1 \"electrode_0\"
1 2 \"electrode_1\"
2 5 \"sheet\"
$EndPhysicalNames
$Nodes
6
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
5 2 0 0
6 2 1 0
$EndNodes
$Elements
8
1 15 2 3 1 2
2 15 2 4 2 3
3 1 2 1 3 1 4
4 1 2 2 4 5 6
5 2 2 5 5 1 2 3
6 2 2 5 5 1 3 4
7 2 2 5 5 2 5 6
8 2 2 5 5 2 6 3
$EndElements
";

/// Two tetrahedra; electrodes are a face, a face, a point and a point.
const WEDGE: &str = "$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
4
0 3 \"electrode_2\"
0 4 \"electrode_3\"
2 1 \"electrode_0\"
2 2 \"electrode_1\"
$EndPhysicalNames
$Nodes
5
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
5 1 1 1
$EndNodes
$Elements
6
1 15 2 3 1 2
2 15 2 4 2 3
3 2 2 1 3 1 2 3
4 2 2 2 4 2 3 5
5 4 2 0 5 1 2 3 4
6 4 2 0 5 2 5 3 4
$EndElements
";

fn generated(text: &str) -> Result<Mesh, MeshError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("body.msh");
    std::fs::write(&path, text).unwrap();
    let mut design = SkinDesign::shipped("cylinder30").unwrap();
    design.electrodes.truncate(4);
    design.electrodes.iter_mut().for_each(|electrode| electrode.shape = ElectrodeShape::Group);
    design.protocol = Protocol::adjacent(4).unwrap();
    design.image = ImageLayout::Cells;
    design.body = Body::Mesh { file: path.into(), unit_m: 0.01 };
    Mesh::generate(&design)
}

/// The required text of a message when one part of a valid file is replaced.
fn refused(text: &str, old: &str, new: &str, expected: &[&str]) {
    assert!(text.contains(old), "{old}");
    let error = generated(&text.replacen(old, new, 1)).unwrap_err().to_string();
    for part in expected.iter().chain(&["body.msh"]) {
        assert!(error.contains(part), "`{error}` should contain `{part}`");
    }
}

#[test]
fn the_files_that_are_broken_below_are_good() {
    let strip = generated(STRIP).unwrap();
    assert_eq!((strip.node_count(), strip.cell_count()), (6, 4));
    let wedge = generated(WEDGE).unwrap();
    assert_eq!((wedge.node_count(), wedge.cell_count()), (5, 2));
    assert!((0..2).all(|cell| wedge.cell_measure(cell) > 0.0));
}

#[test]
fn a_mesh_that_is_wholly_turned_is_turned_back() {
    let mut text = STRIP.to_string();
    for (old, new) in [("1 2 3\n", "1 3 2\n"), ("1 3 4\n", "1 4 3\n"), ("2 5 6\n", "2 6 5\n"), ("2 6 3\n", "2 3 6\n")] {
        text = text.replacen(&format!("5 5 {old}"), &format!("5 5 {new}"), 1);
    }
    assert_ne!(text, STRIP);
    assert_eq!(generated(&text).unwrap().cells, generated(STRIP).unwrap().cells);
    let text = WEDGE.replace("1 2 3 4\n", "1 2 4 3\n").replace("2 5 3 4\n", "2 5 4 3\n");
    let wedge = generated(&text).unwrap();
    assert!((0..2).all(|cell| wedge.cell_measure(cell) > 0.0));
}

#[test]
fn cells_whose_nodes_are_in_another_order_are_reordered() {
    let count = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("body.msh");
        std::fs::write(&path, text).unwrap();
        import::reordered_cells(&path.into(), 1.0).unwrap()
    };
    for (good, from, to) in [(STRIP, "5 5 1 3 4", "5 5 1 4 3"), (WEDGE, "2 5 3 4\n", "5 2 3 4\n")] {
        let text = good.replacen(from, to, 1);
        let (mesh, unmixed) = (generated(&text).unwrap(), generated(good).unwrap());
        assert!(
            (0..mesh.cell_count()).all(|cell| (mesh.cell_measure(cell) - unmixed.cell_measure(cell)).abs() < 1e-18)
        );
        assert_eq!((count(&text), count(good)), (1, 0));
    }
}

#[test]
fn overlapping_cells_and_cells_without_extent() {
    // Node 5 on the same side of the face of nodes 2, 3 and 4 as node 1.
    refused(WEDGE, "5 1 1 1\n", "5 -1 -1 -1\n", &["elements 5 and 6 overlap"]);
    // Node 6 moved across the edge from 2 to 5: its triangles fold.
    refused(STRIP, "6 2 1 0", "6 2 -1 0", &["folded"]);
    refused(STRIP, "6 2 1 0", "6 3 0 0", &["element 7", "no area"]);
    refused(WEDGE, "4 0 0 1", "4 1 1 0", &["element 5", "no volume"]);
    refused(STRIP, "5 5 1 3 4", "5 5 1 3 3", &["element 6", "no area"]);
}

#[test]
fn torn_and_lonely_parts() {
    // The right half has its own nodes where it should share 2 and 3.
    let torn = STRIP.replacen("$Nodes\n6\n", "$Nodes\n8\n7 1 0 0\n8 1 1 0\n", 1);
    refused(&torn, "2 5 6\n8 2 2 5 5 2 6 3", "7 5 6\n8 2 2 5 5 7 6 8", &["torn"]);
    // A distant triangle without an electrode.
    let lonely = STRIP.replacen("$Nodes\n6\n", "$Nodes\n9\n7 9 9 0\n8 10 9 0\n9 9 10 0\n", 1);
    refused(&lonely, "$Elements\n8\n", "$Elements\n9\n9 2 2 5 5 7 8 9\n", &["has no electrode"]);
    // Three triangles at the edge from 2 to 3.
    refused(STRIP, "$Elements\n8\n", "$Elements\n9\n9 2 2 5 5 2 3 5\n", &["3 triangles meet"]);
}

#[test]
fn electrodes_that_are_missing_or_misplaced() {
    refused(STRIP, "electrode_1", "electrode_4", &["electrode_2", "none named electrode_1", "without a gap"]);
    refused(STRIP, "electrode_1", "electrode_0", &["two physical groups named electrode_0"]);
    refused(STRIP, "electrode_1", "electrode_left", &["electrode_left", "number"]);
    refused(STRIP, "electrode_3", "mark", &["3 physical groups", "4 electrodes"]);
    refused(STRIP, "1 2 2 4 5 6", "1 2 9 4 5 6", &["electrode_1 holds no elements"]);
    refused(STRIP, "1 2 1 3 1 4", "1 2 1 3 2 4", &["electrode_0", "does not belong"]);
    refused(STRIP, "15 2 4 2 3", "15 2 3 2 3", &["electrode_2 holds 2 points"]);
    let lost = STRIP.replacen("$Nodes\n6\n", "$Nodes\n7\n7 5 5 0\n", 1);
    refused(&lost, "15 2 4 2 3", "15 2 4 2 7", &["electrode_3", "touches no triangles"]);
    // A face between two tetrahedra is not on the outside.
    refused(WEDGE, "2 2 1 3 1 2 3", "2 2 1 3 2 3 4", &["electrode_0", "does not belong"]);
    // Lines on a volume.
    let lines = WEDGE.replacen("2 1 \"electrode_0\"", "1 1 \"electrode_0\"", 1);
    refused(&lines, "3 2 2 1 3 1 2 3", "3 1 2 1 3 1 2", &["electrode_0 is a group of lines in a mesh of tetrahedra"]);
}

#[test]
fn numbers_that_are_none_or_point_nowhere() {
    refused(STRIP, "2 1 0 0", "2 nan 0 0", &["line 15", "NaN"]);
    refused(STRIP, "2 1 0 0", "2 1e999 0 0", &["line 15", "inf"]);
    refused(STRIP, "2 1 0 0", "2 1e308 0 0", &["body.msh"]);
    refused(STRIP, "2 1 0 0", "1 1 0 0", &["line 15", "node 1", "twice"]);
    refused(STRIP, "5 5 1 3 4", "5 5 1 3 40", &["element 6", "node 40"]);
    refused(STRIP, "5 5 1 3 4", "5 5 1 3 -4", &["line 28", "-4"]);
    refused(STRIP, "5 5 1 3 4", "5 5 1 3 four", &["line 28", "four"]);
    refused(STRIP, "6 2 2 5 5 1 3 4", "6 3 2 5 5 1 3 4 2", &["line 28", "quadrangles"]);
    refused(STRIP, "6 2 2 5 5 1 3 4", "6 9 2 5 5 1 3 4", &["line 28", "higher order"]);
    refused(STRIP, "$Elements\n8\n", "$Elements\n7\n", &["does the count fit"]);
    refused(STRIP, "$Elements\n8\n", "$Elements\n18446744073709551615\n", &["line 31"]);
    refused(STRIP, "$Nodes\n6\n", "$Nodes\n-6\n", &["line 13", "-6"]);
    refused(STRIP, "2.2 0 8", "4.0 0 8", &["4.0", "save the mesh as version 4.1 or 2.2"]);
    refused(STRIP, "2.2 0 8", "2.2 1 8", &["byte order"]);
    refused(STRIP, "$MeshFormat", "$MeshFromat", &["$MeshFormat"]);
    refused(STRIP, STRIP, "", &["empty"]);
    refused(STRIP, STRIP, "\u{7f}ELF\u{2}\u{1}\u{1}\0\0\0", &["$MeshFormat"]);
}

#[test]
fn a_truncated_file_is_an_error_at_every_length() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/bodies");
    for name in ["sheet_2.2_ascii.msh", "sheet_2.2_binary.msh", "sheet_4.1_ascii.msh", "sheet_4.1_binary.msh"] {
        let bytes = std::fs::read(Path::new(folder).join(name)).unwrap();
        import::parse(&bytes, Format::Msh, 1.0).unwrap();
        for length in 0..bytes.trim_ascii_end().len() {
            assert!(import::parse(&bytes[..length], Format::Msh, 1.0).is_err(), "{name}: {length} bytes");
        }
    }
}

#[test]
fn files_that_cannot_be_read_or_written() {
    let missing = import::load(Path::new("/nowhere/body.msh"), 1.0).unwrap_err();
    assert!(matches!(missing, MeshError::Io { .. }) && missing.to_string().contains("/nowhere/body.msh"));
    let unknown = import::load(Path::new("body.step"), 1.0).unwrap_err().to_string();
    assert!(unknown.contains(".msh, .stl, .obj or .ply"), "{unknown}");
    assert!(import::load(Path::new("body.msh"), -1.0).unwrap_err().to_string().contains("-1 m"));

    let mesh = generated(STRIP).unwrap();
    assert!(matches!(export::save(&mesh, Path::new("/nowhere/mesh.vtu"), None), Err(MeshError::Io { .. })));
    let error = export::save(&mesh, Path::new("mesh.obj"), None).unwrap_err().to_string();
    assert!(error.contains(".vtu, .msh or .stl, not as `.obj`"), "{error}");
    let error = export::save(&mesh, Path::new("mesh.vtu"), Some(&[1.0])).unwrap_err().to_string();
    assert!(error.contains("1 values of `conductivity`") && error.contains("4 cells"), "{error}");
    let field = export::CellField { name: "image".into(), values: vec![0.0; 4] };
    let fields = [field.clone(), field];
    let error = export::save_cell_fields(&mesh, Path::new("mesh.vtk"), &fields[..1]).unwrap_err().to_string();
    assert!(error.contains("mesh.vtk: values of cells are written as .vtu, not as `.vtk`"), "{error}");
    let error = export::save_cell_fields(&mesh, Path::new("mesh.vtu"), &fields).unwrap_err().to_string();
    assert!(error.contains("two fields have the name `image`"), "{error}");
}

/// A device that is always full represents a full disk; it takes no extension, hence the link.
#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_an_error_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.vtu");
    std::os::unix::fs::symlink("/dev/full", &path).unwrap();
    let error = export::save(&generated(STRIP).unwrap(), &path, None).unwrap_err();
    assert!(matches!(&error, MeshError::Io { source, .. } if source.raw_os_error() == Some(28)), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}
