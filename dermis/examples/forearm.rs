//! Writes `dermis/designs/forearm.stl`, the sample of a free body: a sleeve around a forearm, 240 mm long.
//!
//! Its sections are ellipses that narrow from the elbow (92 x 80 mm) to the wrist (60 x 44 mm), and its axis is
//! slightly bent, so that no part of it is a cylinder. `cargo run --release --example forearm`

use dermis::mesh::{Cells, Mesh, export};
use std::f64::consts::TAU;
use std::path::Path;

/// Points around a section, and sections along the arm.
const ROUND: usize = 36;
const ALONG: usize = 24;

/// The point of the sleeve at a fraction of its length (0 at the elbow) and an angle, mm.
pub fn point_mm(along: f64, angle_rad: f64) -> [f64; 3] {
    // The muscle is thickest at a quarter of the length.
    let belly = 4.0 * (-(along - 0.25).powi(2) / 0.03).exp();
    let (wide, thick) = (46.0 - 16.0 * along + belly, 40.0 - 18.0 * along + belly);
    let bend = 12.0 * along * along;
    [wide * angle_rad.cos(), bend + thick * angle_rad.sin(), 240.0 * along]
}

/// The sleeve, mm.
pub fn sleeve() -> Mesh {
    let mut nodes = Vec::new();
    let mut triangles = Vec::new();
    for row in 0..=ALONG {
        for k in 0..ROUND {
            // Every other row is turned by half a step, which makes the triangles nearly equilateral.
            let angle_rad = TAU * (k as f64 + 0.5 * (row % 2) as f64) / ROUND as f64;
            nodes.push(point_mm(row as f64 / ALONG as f64, angle_rad));
        }
    }
    for row in 0..ALONG {
        for k in 0..ROUND {
            let at = |row: usize, k: usize| row * ROUND + k % ROUND;
            let (a, b, c, d) = (at(row, k), at(row, k + 1), at(row + 1, k), at(row + 1, k + 1));
            triangles.extend(if row % 2 == 0 { [[a, b, c], [b, d, c]] } else { [[a, d, c], [a, b, d]] });
        }
    }
    Mesh { nodes, cells: Cells::Triangles(triangles), electrodes: Vec::new(), regions: Vec::new() }
}

fn main() -> dermis::Result<()> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("designs/forearm.stl");
    export::save(&sleeve(), &path, None)?;
    println!("{}: {} triangles", path.display(), sleeve().cell_count());
    Ok(())
}
