//! Electrodes moved on a mesh that keeps its topology.

use crate::design::{Body, ElectrodeShape, SkinDesign};
use crate::geom::Point3;
use crate::mesh::{ElectrodePatch, Mesh};

/// Within this many radii of its centre, all nodes move with a disc electrode.
const RIGID_RADII: f64 = 1.5;
/// From this fraction of the distance to the nearest electrode on, no node moves.
const REACH_SHARE: f64 = 0.5;
/// A disc within this many radii of an edge of the body moves along the edge only.
const EDGE_RADII: f64 = 1.0;
/// Maximum slope of a displacement, which limits the shear of cells.
const STEEPEST: f64 = 0.5;

impl Mesh {
    /// The nodes of a design's mesh with displaced disc electrodes: electrode `k` is displaced by `displacements_m[k]`,
    /// in the coordinates of [`chart`](crate::geom::Surface::chart) (around and along a cylinder, x and y on a flat
    /// skin).
    ///
    /// The nodes near a disc move with it; farther out the displacement decreases smoothly to zero halfway to the next
    /// electrode. Discs on the rim of a cylinder move along it; other shapes, discs at the edge of a flat skin and
    /// those of a body known only by its mesh do not move. A displacement too large for the available space is limited
    /// so that no cell is sheared by more than one half.
    ///
    /// # Panics
    /// If the number of displacements differs from the number of electrodes.
    pub fn displaced(&self, design: &SkinDesign, displacements_m: &[[f64; 2]]) -> Vec<Point3> {
        assert_eq!(displacements_m.len(), design.electrodes.len(), "a displacement per electrode");
        let surface = design.body.surface();
        let mut nodes = self.nodes.clone();
        for (index, electrode) in design.electrodes.iter().enumerate() {
            let ElectrodeShape::Disc { radius_m } = electrode.shape else { continue };
            let ElectrodePatch::Cells(_) = self.electrodes[index] else { continue };
            let Some(freedom) = freedom(design, electrode.centre_m, radius_m) else { continue };
            let others = design.electrodes.iter().enumerate().filter(|(other, _)| *other != index);
            let nearest = others
                .map(|(_, other)| surface.distance_m(electrode.centre_m, other.centre_m))
                .fold(f64::INFINITY, f64::min);
            let (inner, outer) = (RIGID_RADII * radius_m, reach(design, electrode.centre_m, nearest, freedom));
            if outer <= inner {
                continue;
            }
            let step = [0, 1].map(|axis| displacements_m[index][axis] * freedom[axis]);
            // The smooth step falls by at most 3/2 of its mean slope.
            let most = STEEPEST * (outer - inner) / 1.5;
            let cut = (most / step[0].hypot(step[1])).min(1.0);
            for (node, rest) in nodes.iter_mut().zip(&self.nodes) {
                let share = fade((surface.distance_m(electrode.centre_m, *rest) - inner) / (outer - inner));
                if share > 0.0 {
                    *node = surface.walk(*node, step.map(|component| component * share * cut));
                }
            }
        }
        nodes
    }
}

/// 1 before 0, 0 after 1, smooth between.
fn fade(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    1.0 - x * x * (3.0 - 2.0 * x)
}

/// The axes of the chart along which an electrode can move; `None` if it cannot move.
fn freedom(design: &SkinDesign, centre_m: Point3, radius_m: f64) -> Option<[f64; 2]> {
    let depth_m = design.body.edge_distance_m(centre_m)?;
    let at_edge = depth_m < EDGE_RADII * radius_m;
    match design.body {
        Body::Cylinder { .. } if at_edge => Some([1.0, 0.0]),
        _ if at_edge => None,
        _ => Some([1.0, 1.0]),
    }
}

/// The radius around an electrode within which nodes move: halfway to the next one, and not beyond the edge if it moves
/// across it.
fn reach(design: &SkinDesign, centre_m: Point3, nearest_m: f64, freedom: [f64; 2]) -> f64 {
    let half = REACH_SHARE * nearest_m;
    match design.body.edge_distance_m(centre_m) {
        Some(depth_m) if freedom[1] > 0.0 => half.min(depth_m),
        _ => half,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Surface;
    use crate::mesh::quality::MeshReport;

    #[test]
    fn electrodes_move_as_one_piece_and_the_mesh_stays_sound() {
        let design = SkinDesign::shipped("cylinder30").expect("a shipped design");
        let mesh = Mesh::generate(&design).expect("a mesh");
        let displacements: Vec<[f64; 2]> =
            (0..30).map(|k| [1e-3 * (k as f64).sin() * 2.0, 1e-3 * (1.7 * k as f64).cos() * 2.0]).collect();
        let moved = Mesh { nodes: mesh.displaced(&design, &displacements), ..mesh.clone() };
        let surface = design.body.surface();
        let Surface::Cylinder { radius_m, length_m } = surface else { unreachable!("a cylinder") };
        for (before, after) in mesh.nodes.iter().zip(&moved.nodes) {
            assert!((after[0].hypot(after[1]) - radius_m).abs() < 1e-12, "nodes stay on the wall");
            assert_eq!(before[2] == 0.0, after[2] == 0.0, "rims stay rims");
            assert_eq!(before[2] == length_m, after[2] == length_m);
        }
        for (index, patch) in mesh.electrodes.iter().enumerate() {
            let ElectrodePatch::Cells(cells) = patch else { unreachable!("discs") };
            let on_rim = [0.0, length_m].contains(&design.electrodes[index].centre_m[2]);
            let expected = [displacements[index][0], if on_rim { 0.0 } else { displacements[index][1] }];
            for &node in cells.iter().flat_map(|&cell| mesh.cells.corners(cell)) {
                let step = surface.chart(mesh.nodes[node], moved.nodes[node]);
                assert!((step[0] - expected[0]).abs() < 1e-12 && (step[1] - expected[1]).abs() < 1e-12, "{step:?}");
            }
        }
        let smallest = |mesh: &Mesh| MeshReport::new(&design, mesh).smallest_angle_rad.to_degrees();
        let (before, after) = (smallest(&mesh), smallest(&moved));
        println!("smallest angle {before:.1} degrees before, {after:.1} after 2 mm");
        assert!(after > 10.0);
    }
}
