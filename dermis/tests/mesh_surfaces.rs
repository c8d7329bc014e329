//! Surfaces from STL, OBJ and PLY files, valid and invalid.

use dermis::mesh::import::{Format, parse};
use dermis::mesh::{Cells, Mesh};
use std::fmt::Write;

/// The corners of a box 40 x 20 x 10 and its twelve triangles, seen from outside; every other one is oriented inwards,
/// as in some real files.
fn corners() -> Vec<[f32; 3]> {
    (0..8).map(|k| [40.0 * (k & 1) as f32, 20.0 * (k >> 1 & 1) as f32, 10.0 * (k >> 2) as f32]).collect()
}

fn triangles() -> Vec<[usize; 3]> {
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    quads.iter().flat_map(|&[a, b, c, d]| [[a, c, b], [a, c, d]]).collect()
}

fn stl_ascii() -> Vec<u8> {
    let mut text = String::from("solid a box\n");
    for triangle in triangles() {
        text.push_str(" facet normal 0 0 0\n  outer loop\n");
        for [x, y, z] in triangle.map(|k| corners()[k]) {
            writeln!(text, "   vertex {x:e} {y:e} {z:e}").unwrap();
        }
        text.push_str("  endloop\n endfacet\n");
    }
    text.push_str("endsolid a box\n");
    text.into_bytes()
}

fn stl_binary() -> Vec<u8> {
    // Some programs start binary files with the word that marks text files.
    let mut bytes = b"solid, but binary".to_vec();
    bytes.resize(80, 0);
    bytes.extend((triangles().len() as u32).to_le_bytes());
    for triangle in triangles() {
        bytes.extend([0; 12]);
        for corner in triangle.map(|k| corners()[k]).into_iter().flatten() {
            bytes.extend(corner.to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn obj() -> Vec<u8> {
    let mut text = String::from("# a box\r\nmtllib box.mtl\r\no box\r\n");
    for [x, y, z] in corners() {
        writeln!(text, "v {x} {y} {z} 1.0\r\nvn 0 0 1\r").unwrap();
    }
    // A polygon, corners with texture and normal, corners numbered relative to the last.
    text.push_str("f 1 3 4 2\r\nf 5/1/1 6/1/1 8/1/1 7/1/1\r\nf -8 -7 -3 -4\r\n");
    for [a, b, c] in &triangles()[6..] {
        writeln!(text, "f {}//1 {}//1 {}//1\r", a + 1, b + 1, c + 1).unwrap();
    }
    text.into_bytes()
}

fn ply_header(format: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment a box\nelement vertex 8\nproperty float x\nproperty float y\n\
         property uchar red\nproperty float z\nelement face 12\nproperty uchar material\n\
         property list uchar int vertex_indices\nelement edge 0\nproperty int vertex1\nend_header\n"
    )
}

fn ply_ascii() -> Vec<u8> {
    let mut text = ply_header("ascii");
    for [x, y, z] in corners() {
        writeln!(text, "{x} {y} 255 {z}").unwrap();
    }
    for [a, b, c] in triangles() {
        writeln!(text, "0 3 {a} {b} {c}").unwrap();
    }
    text.into_bytes()
}

fn ply_binary(big: bool) -> Vec<u8> {
    let mut bytes = ply_header(if big { "binary_big_endian" } else { "binary_little_endian" }).into_bytes();
    let four = |bits: u32| if big { bits.to_be_bytes() } else { bits.to_le_bytes() };
    for [x, y, z] in corners() {
        bytes.extend(four(x.to_bits()));
        bytes.extend(four(y.to_bits()));
        bytes.push(255);
        bytes.extend(four(z.to_bits()));
    }
    for triangle in triangles() {
        bytes.extend([0, 3]);
        triangle.iter().for_each(|&corner| bytes.extend(four(corner as u32)));
    }
    bytes
}

fn all() -> Vec<(&'static str, Format, Vec<u8>)> {
    vec![
        ("ASCII STL", Format::Stl, stl_ascii()),
        ("binary STL", Format::Stl, stl_binary()),
        ("OBJ", Format::Obj, obj()),
        ("ASCII PLY", Format::Ply, ply_ascii()),
        ("little-endian PLY", Format::Ply, ply_binary(false)),
        ("big-endian PLY", Format::Ply, ply_binary(true)),
    ]
}

/// Six times the enclosed volume of a closed surface, positive if it is oriented outwards.
fn volume(mesh: &Mesh) -> f64 {
    let Cells::Triangles(cells) = &mesh.cells else { panic!() };
    let of = |cell: &[usize; 3]| {
        let [a, b, c] = cell.map(|node| mesh.nodes[node]);
        dermis::geom::vector::dot(a, dermis::geom::vector::cross(b, c)) / 6.0
    };
    cells.iter().map(of).sum()
}

#[test]
fn a_box_is_the_same_in_every_format() {
    for (name, format, bytes) in all() {
        let mesh = parse(&bytes, format, 1e-3).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((mesh.node_count(), mesh.cell_count()), (8, 12), "{name}: doubled vertices are welded");
        assert!((volume(&mesh) - 8e-6).abs() < 1e-18, "{name}: turned outwards, 40 x 20 x 10 mm");
    }
}

#[test]
fn a_truncated_file_is_an_error_at_every_length() {
    for (name, format, bytes) in all() {
        for length in 0..bytes.len() {
            let part = &bytes[..length];
            match parse(part, format, 1.0) {
                Err(error) => assert!(!error.to_string().is_empty()),
                // Text may end between two faces or within its last number, and still be valid; OBJ has no end mark.
                Ok(mesh) => {
                    assert!(bytes.len() - length < 8 || name == "OBJ", "{name}: {length} of {} bytes", bytes.len());
                    assert!(mesh.cell_count() <= 12);
                }
            }
        }
    }
}

/// The required text of a message for an invalid file.
fn refused(format: Format, bytes: impl AsRef<[u8]>, expected: &[&str]) {
    let error = parse(bytes.as_ref(), format, 1.0).unwrap_err().to_string();
    for part in expected {
        assert!(error.contains(part), "`{error}` should contain `{part}`");
    }
}

#[test]
fn wrong_surfaces_are_named_with_their_place() {
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let stl = text(stl_ascii());
    refused(Format::Stl, stl.replacen("4e1", "nan", 1), &["line 5", "coordinate", "NaN"]);
    refused(Format::Stl, stl.replacen("4e1", "4O.0", 1), &["line 5", "4O.0"]);
    refused(Format::Stl, stl.replacen("   vertex 0e0 0e0 0e0\n", "", 1), &["line 6", "2 corners"]);
    refused(Format::Stl, "solid nothing\nendsolid\n", &["no triangles"]);
    refused(Format::Stl, b"\x89PNG\r\n\x1a\n".repeat(40), &["not an STL file"]);
    let mut nan = stl_binary();
    nan[96..100].copy_from_slice(&f32::NAN.to_le_bytes());
    refused(Format::Stl, nan, &["vertex 1", "NaN"]);

    let obj = text(obj());
    refused(Format::Obj, obj.replacen("-8 -7", "-9 -7", 1), &["line 22", "-9"]);
    refused(Format::Obj, obj.replacen("f 1 3", "f 0 3", 1), &["line 20", "numbered from 1"]);
    refused(Format::Obj, obj.replacen("f 1 3", "f 99 3", 1), &["triangle 1", "99", "8 vertices"]);
    refused(Format::Obj, obj.replacen("f 1 3 4 2", "f 1 3", 1), &["line 20", "2 corners"]);
    refused(Format::Obj, obj.replacen("v 40 0", "v inf 0", 1), &["line 6", "inf"]);
    refused(Format::Obj, "curv 1 2 3", &["line 1", "curv"]);

    let ply = text(ply_ascii());
    refused(Format::Ply, ply.replacen("element vertex 8", "element vertex 18446744073709551615", 1), &["ends where"]);
    refused(Format::Ply, ply.replacen("0 3 0 3 2", "0 3 0 3 8", 1), &["triangle", "8 vertices"]);
    refused(Format::Ply, ply.replacen("0 3 0 3 2", "0 2 0 3", 1), &["2 corners"]);
    refused(Format::Ply, ply.replacen("0 3 0 3 2", "0 3 0 3 -2", 1), &["-2"]);
    refused(Format::Ply, ply.replacen("property float z", "property float w", 1), &["x, y and z"]);
    refused(Format::Ply, ply.replacen("format ascii", "format utf8", 1), &["utf8"]);
    refused(
        Format::Ply,
        "ply\nformat ascii 1.0\nelement false_positive 18446744073709551615\nend_header\n",
        &["no triangles"],
    );
}

#[test]
fn surfaces_that_no_sheet_can_have_are_refused() {
    // Three triangles at one edge.
    let book = "v 0 0 0\nv 0 0 1\nv 1 0 0\nv 0 1 0\nv -1 -1 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n";
    refused(Format::Obj, book, &["3 triangles meet at the edge"]);
    // A Moebius band of five triangles.
    let band = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nv 0 0 1\nf 1 2 3\nf 2 3 4\nf 3 4 5\nf 4 5 1\nf 5 1 2\n";
    refused(Format::Obj, band, &["one side only"]);
    refused(Format::Obj, "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", &["no area"]);
    refused(Format::Obj, "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", &["no extent"]);
    refused(Format::Obj, "v -1e308 0 0\nv 1e308 1e308 0\nv 0 1 0\nf 1 2 3\n", &["overflows"]);
}
