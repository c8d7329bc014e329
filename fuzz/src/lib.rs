//! The functions of the fuzz targets: each reader on arbitrary bytes. They return an error or a value for any file
//! content; a panic is a finding, and so is an inconsistent value.
//!
//! `cargo +nightly fuzz run msh` from this folder's parent; `dermis/tests/fuzz_readers.rs` runs the same functions on
//! seeded mutations of valid files in the ordinary tests.

use dermis::design::SkinDesign;
use dermis::frame;
use dermis::geom::{PlaceLimits, Surface};
use dermis::mesh::Cells;
use dermis::mesh::import::{self, Format};
use dermis::protocol::Protocol;
use std::path::Path;

/// The reader of designs.
pub fn fuzz_design(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match SkinDesign::parse(text, "fuzz.toml") {
        Ok(design) => assert!(design.electrodes.len() >= 4 && design.protocol.channel_count() > 0),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// The reader of channel tables.
pub fn fuzz_protocol_table(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(protocol) = Protocol::parse_csv(text, "fuzz.csv", 16) {
        assert!(protocol.channels().iter().all(|channel| channel.drive.iter().all(|&electrode| electrode < 16)));
    }
}

/// The reader of Gmsh files.
pub fn fuzz_msh(data: &[u8]) {
    mesh(data, Format::Msh);
}

/// The reader of STL files.
pub fn fuzz_stl(data: &[u8]) {
    mesh(data, Format::Stl);
}

/// The reader of OBJ files.
pub fn fuzz_obj(data: &[u8]) {
    mesh(data, Format::Obj);
}

/// The reader of PLY files.
pub fn fuzz_ply(data: &[u8]) {
    mesh(data, Format::Ply);
}

fn mesh(data: &[u8], format: Format) {
    let Ok(mesh) = import::parse(data, format, 1e-3) else { return };
    assert!(mesh.cell_count() > 0 && mesh.nodes.iter().flatten().all(|x| x.is_finite()));
    let in_range = |cell: usize| mesh.cells.corners(cell).iter().all(|&node| node < mesh.node_count());
    assert!((0..mesh.cell_count()).all(in_range));
    if let Cells::Tetrahedra(_) = mesh.cells {
        assert!((0..mesh.cell_count()).all(|cell| mesh.cell_measure(cell) > 0.0));
    }
    let _ = mesh.validate();
}

/// The reader of frames in CSV files.
pub fn fuzz_frames_csv(data: &[u8]) {
    table(data, "csv");
}

/// The reader of frames in NPY files.
pub fn fuzz_frames_npy(data: &[u8]) {
    table(data, "npy");
}

/// The reader of frames in NPZ files.
pub fn fuzz_frames_npz(data: &[u8]) {
    table(data, "npz");
}

/// The reader of truths.
pub fn fuzz_truth(data: &[u8]) {
    in_file(data, "csv", |path| {
        let surfaces = [Surface::Cylinder { radius_m: 0.05, length_m: 0.3 }, Surface::Plane, Surface::Free];
        for surface in surfaces {
            let limits = PlaceLimits::of_box(surface, [[-1.0; 3], [1.0; 3]], 0.1);
            let _ = frame::read_truth(path, &limits, 3);
        }
    });
}

fn table(data: &[u8], extension: &str) {
    in_file(data, extension, |path| {
        if let Ok(table) = frame::read_table(path, "frames") {
            assert!(!table.rows.is_empty() && table.rows.iter().all(|row| row.len() == table.rows[0].len()));
        }
    });
}

/// These readers take a path: a temporary file is used.
fn in_file(data: &[u8], extension: &str, read: impl Fn(&Path)) {
    let file = tempfile::Builder::new().suffix(&format!(".{extension}")).tempfile().expect("a temporary file");
    std::fs::write(file.path(), data).expect("a temporary file can be written");
    read(file.path());
}
