//! Removal of edges that are shorter than anybody can make.

use dermis::geom::Point3;
use dermis::geom::vector::{cross, distance, dot, norm, sub};
use std::collections::BTreeSet;

/// Collapses edges shorter than a length to one of their ends, the shortest first. The surface stays closed and keeps its
/// genus; an edge at which a triangle of some height would turn over is left.
pub(super) fn without_short_edges(corners: &[Point3], triangles: &mut Vec<[u32; 3]>, shortest: f64) {
    let mut left_alone = BTreeSet::new();
    loop {
        let short = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).filter(|[a, b]| a < b);
        let length = |edge: &[u32; 2]| distance(corners[edge[0] as usize], corners[edge[1] as usize]);
        let short = short.filter(|edge| length(edge) < shortest && !left_alone.contains(edge));
        let Some(edge) = short.min_by(|a, b| length(a).total_cmp(&length(b))) else { return };
        let ways = [edge, [edge[1], edge[0]]];
        match ways.into_iter().find(|&[kept, gone]| may_collapse(corners, triangles, kept, gone, shortest)) {
            Some([kept, gone]) => collapse(triangles, kept, gone),
            None => _ = left_alone.insert(edge),
        }
    }
}

/// Whether the ends have two neighbours in common, as on a surface that stays one, and no triangle turns over.
fn may_collapse(corners: &[Point3], triangles: &[[u32; 3]], kept: u32, gone: u32, shortest: f64) -> bool {
    let neighbours = |corner: u32| -> BTreeSet<u32> {
        let own = triangles.iter().filter(|triangle| triangle.contains(&corner));
        own.flatten().copied().filter(|&other| other != corner).collect()
    };
    if neighbours(kept).intersection(&neighbours(gone)).count() != 2 {
        return false;
    }
    let at = |corner: u32| corners[corner as usize];
    let doubled = |[a, b, c]: [u32; 3]| cross(sub(at(b), at(a)), sub(at(c), at(a)));
    let moved = triangles.iter().filter(|triangle| triangle.contains(&gone) && !triangle.contains(&kept));
    let mut turns = moved.map(|&triangle| {
        let before = doubled(triangle);
        let after = doubled(triangle.map(|corner| if corner == gone { kept } else { corner }));
        let longest = (0..3).map(|k| distance(at(triangle[k]), at(triangle[(k + 1) % 3]))).fold(0.0, f64::max);
        norm(before) > shortest * longest && dot(before, after) <= 0.0
    });
    !turns.any(|turns| turns)
}

fn collapse(triangles: &mut Vec<[u32; 3]>, kept: u32, gone: u32) {
    triangles.retain(|triangle| !(triangle.contains(&kept) && triangle.contains(&gone)));
    triangles.iter_mut().flatten().filter(|corner| **corner == gone).for_each(|corner| *corner = kept);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An octahedron with one corner split into two, a micrometre apart.
    #[test]
    fn a_split_corner_becomes_one_and_the_surface_stays_closed() {
        let (x, e) = (1.0, 1e-6);
        let corners =
            [[x, 0.0, 0.0], [0.0, x, 0.0], [-x, 0.0, 0.0], [0.0, -x, 0.0], [0.0, 0.0, x], [0.0, 0.0, -x], [0.0, e, x]];
        let mut triangles = vec![
            [0, 1, 6],
            [1, 2, 6],
            [2, 3, 4],
            [3, 0, 4],
            [0, 6, 4],
            [6, 2, 4],
            [1, 0, 5],
            [2, 1, 5],
            [3, 2, 5],
            [0, 3, 5],
        ];
        without_short_edges(&corners, &mut triangles, 1e-3);
        assert_eq!(triangles.len(), 8);
        let edges: BTreeSet<[u32; 2]> = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        assert_eq!(edges.len(), 24);
        assert!(edges.iter().all(|&[a, b]| edges.contains(&[b, a])));
    }
}
