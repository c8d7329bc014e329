//! The fuzz targets on seeded mutations of valid files: bits flipped, bytes overwritten, numbers made extreme, lines
//! and parts removed, duplicated, moved between files. No reader may panic, hang or allocate memory by a size that a
//! file only states.

#[path = "../../fuzz/src/mutation.rs"]
mod mutation;
#[path = "../../fuzz/src/lib.rs"]
mod targets;

use mutation::mutated;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::path::{Path, PathBuf};

/// Number of mutations of each reader's files. Set `DERMIS_FUZZ_RUNS` for more.
const RUNS: usize = 2_000;

fn runs() -> usize {
    std::env::var("DERMIS_FUZZ_RUNS").ok().and_then(|text| text.parse().ok()).unwrap_or(RUNS)
}

fn data(path: &str) -> Vec<u8> {
    let path: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Runs a target on its valid files, then on mutations of them; sample `i` depends only on the seed and `i`.
fn fuzz(target: fn(&[u8]), seeds: &[Vec<u8>], seed: u64) {
    seeds.iter().for_each(|bytes| target(bytes));
    for run in 0..runs() {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(run as u64);
        let bytes = mutated(seeds, &mut random);
        if let Err(panic) = std::panic::catch_unwind(|| target(&bytes)) {
            let path = std::env::temp_dir().join(format!("dermis-finding-{seed}-{run}"));
            std::fs::write(&path, &bytes).unwrap();
            eprintln!("seed {seed}, run {run}: the input is in {}", path.display());
            std::panic::resume_unwind(panic);
        }
    }
}

#[test]
fn designs() {
    let names = ["cylinder30", "skin16", "tank16", "forearm"];
    fuzz(targets::fuzz_design, &names.map(|name| data(&format!("designs/{name}.toml"))), 1);
}

#[test]
fn gmsh_files() {
    let sheets = ["2.2_ascii", "2.2_binary", "4.1_ascii", "4.1_binary"]
        .map(|end| data(&format!("../data/bodies/sheet_{end}.msh")));
    fuzz(targets::fuzz_msh, &sheets, 2);
    let blocks = ["2.2_ascii", "4.1_binary"].map(|end| data(&format!("../data/bodies/block_{end}.msh")));
    fuzz(targets::fuzz_msh, &blocks, 3);
}

/// A fan of triangles in every surface format.
fn fan() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let rim = (0..12).map(|k| [(0.5 * k as f32).cos(), (0.5 * k as f32).sin(), 0.1 * k as f32]);
    let points = std::iter::once([0.0; 3]).chain(rim).collect();
    (points, (1..12).map(|k| [0, k, k + 1]).collect())
}

#[test]
fn stl_files() {
    let (points, triangles) = fan();
    let mut text = String::from("solid fan\n");
    let mut binary = vec![b' '; 80];
    binary.extend((triangles.len() as u32).to_le_bytes());
    for triangle in &triangles {
        text += "facet normal 0 0 1\nouter loop\n";
        binary.extend([0; 12]);
        for [x, y, z] in triangle.map(|k| points[k as usize]) {
            text += &format!("vertex {x} {y} {z}\n");
            [x, y, z].iter().for_each(|value| binary.extend(value.to_le_bytes()));
        }
        text += "endloop\nendfacet\n";
        binary.extend([0; 2]);
    }
    text += "endsolid fan\n";
    fuzz(targets::fuzz_stl, &[text.into_bytes(), binary], 4);
}

#[test]
fn obj_files() {
    let (points, triangles) = fan();
    let mut text = String::from("# fan\no fan\n");
    points.iter().for_each(|[x, y, z]| text += &format!("v {x} {y} {z}\n"));
    triangles.iter().for_each(|[a, b, c]| text += &format!("f {}/1/1 {} {}//2\n", a + 1, b + 1, c + 1));
    fuzz(targets::fuzz_obj, &[text.into_bytes()], 5);
}

#[test]
fn ply_files() {
    let (points, triangles) = fan();
    let seed = |format: &str| {
        let mut bytes = format!(
            "ply\nformat {format} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty list uchar int vertex_indices\nend_header\n",
            points.len(),
            triangles.len()
        )
        .into_bytes();
        let number = |bits: u32| if format.contains("big") { bits.to_be_bytes() } else { bits.to_le_bytes() };
        for [x, y, z] in &points {
            match format {
                "ascii" => bytes.extend(format!("{x} {y} {z}\n").bytes()),
                _ => [x, y, z].iter().for_each(|value| bytes.extend(number(value.to_bits()))),
            }
        }
        for [a, b, c] in &triangles {
            match format {
                "ascii" => bytes.extend(format!("3 {a} {b} {c}\n").bytes()),
                _ => {
                    bytes.push(3);
                    [a, b, c].iter().for_each(|&&corner| bytes.extend(number(corner)));
                }
            }
        }
        bytes
    };
    fuzz(targets::fuzz_ply, &["ascii", "binary_little_endian", "binary_big_endian"].map(seed), 6);
}

/// Small tables in all formats, as written by the library.
fn tables(extension: &str) -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("frames.{extension}"));
    let values: Vec<f64> = (0..24).map(|k| (k as f64 * 0.7).sin() * 10f64.powi(k % 7 - 3)).collect();
    dermis::frame::write_array(&path, "frames", &[4, 6], &values).unwrap();
    vec![std::fs::read(&path).unwrap()]
}

#[test]
fn tables_of_frames() {
    let mut texts = tables("csv");
    texts.push(b"\xef\xbb\xbfa,b,c\r\n1,2,3\r\n-4.5e-3,5,6\r\n".to_vec());
    fuzz(targets::fuzz_frames_csv, &texts, 7);
    fuzz(targets::fuzz_frames_npy, &tables("npy"), 8);
    fuzz(targets::fuzz_frames_npz, &tables("npz"), 9);
}

#[test]
fn truths() {
    let texts = [
        "frame,z_m,theta_rad,force_n\n0,0.1,1.5,2\n2,0.2,6.1,3\n",
        "frame,x_m,y_m,z_m\n0,0,0,0\n",
        "1,2,3\n4,5,6\n7,8,9\n",
    ];
    fuzz(targets::fuzz_truth, &texts.map(|text| text.as_bytes().to_vec()), 10);
}

#[test]
fn protocol_tables() {
    let table = dermis::protocol::Protocol::opposite(16).unwrap().to_csv();
    fuzz(targets::fuzz_protocol_table, &[table.into_bytes()], 11);
}
