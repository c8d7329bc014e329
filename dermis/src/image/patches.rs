//! Pixels that are groups of neighbouring cells, on a mesh much finer than an image can be.

use crate::geom::Surface;
use crate::geom::vector::{Point3, add, distance, norm, normalize, scale};
use crate::image::{PixelSpace, cells};
use crate::mesh::{Cells, Mesh};

/// Pixels between neighbouring electrodes: a touch is far wider than a pixel, and the default grid of a cylinder is as fine.
const PIXELS_PER_SPACING: f64 = 6.0;
/// Least distance of two seeds over the side of a pixel. Seeds that are placed one after another, wherever there is room,
/// have on average an area of 1.44 times their least distance squared (Renyi 1958, in two dimensions Palasti 1960).
const SEED_DISTANCE: f64 = 0.83;
/// A mesh with fewer cells in a pixel keeps its cells.
const MIN_CELLS_PER_PIXEL: f64 = 2.0;

/// Pixels of about a sixth of the electrodes' spacing. A cell that is farther than the least distance from all seeds is the
/// next seed; a cell belongs to the nearest seed from which cells within that distance lead to it, so that two sides of a
/// thin body stay apart. Volumes and coarse meshes have a pixel for each cell.
pub(super) fn pixels(mesh: &Mesh, surface: Surface) -> PixelSpace {
    let of_cells = cells::pixels(mesh, surface);
    let area: f64 = of_cells.areas.iter().sum();
    let side_m = (area / mesh.electrodes.len().max(1) as f64).sqrt() / PIXELS_PER_SPACING;
    let is_coarse = side_m * side_m * (of_cells.len() as f64) < MIN_CELLS_PER_PIXEL * area;
    match mesh.cells {
        Cells::Triangles(_) if !is_coarse => grouped(&of_cells, SEED_DISTANCE * side_m),
        _ => of_cells,
    }
}

fn grouped(cells: &PixelSpace, reach_m: f64) -> PixelSpace {
    let owners = owners(cells, reach_m);
    let count = owners.iter().max().map_or(0, |last| last + 1);
    let mut members = vec![Vec::new(); count];
    owners.iter().enumerate().for_each(|(cell, &pixel)| members[pixel].push(cell));
    let centres: Vec<usize> = members.iter().map(|members| centre(cells, members)).collect();
    let normal = |members: &Vec<usize>, centre: usize| {
        let sum = members.iter().fold([0.0; 3], |sum, &cell| add(sum, scale(cells.normals[cell], cells.areas[cell])));
        if norm(sum) > 0.0 { normalize(sum) } else { cells.normals[centre] }
    };
    PixelSpace {
        surface: cells.surface,
        grid: None,
        position_in_grid: (0..count).collect(),
        centres_m: centres.iter().map(|&cell| cells.centres_m[cell]).collect(),
        normals: members.iter().zip(&centres).map(|(members, &centre)| normal(members, centre)).collect(),
        areas: members.iter().map(|members| members.iter().map(|&cell| cells.areas[cell]).sum()).collect(),
        neighbours: (0..count).map(|pixel| neighbours(cells, &owners, &members[pixel], pixel)).collect(),
        edge_m: Vec::new(),
        overlaps: members.into_iter().map(|members| members.into_iter().map(|cell| (cell, 1.0)).collect()).collect(),
    }
}

/// The pixel of each cell.
fn owners(cells: &PixelSpace, reach_m: f64) -> Vec<usize> {
    let mut nearest: Vec<Option<(f64, usize)>> = vec![None; cells.len()];
    // The last seed that has visited each cell.
    let mut visited = vec![usize::MAX; cells.len()];
    let mut count = 0;
    for seed in 0..cells.len() {
        if nearest[seed].is_some() {
            continue;
        }
        let mut waiting = vec![seed];
        visited[seed] = count;
        while let Some(cell) = waiting.pop() {
            let away_m = distance(cells.centres_m[cell], cells.centres_m[seed]);
            if away_m > reach_m {
                continue;
            }
            if nearest[cell].is_none_or(|(least_m, _)| away_m < least_m) {
                nearest[cell] = Some((away_m, count));
            }
            for &next in &cells.neighbours[cell] {
                if visited[next] != count {
                    visited[next] = count;
                    waiting.push(next);
                }
            }
        }
        count += 1;
    }
    nearest.into_iter().map(|nearest| nearest.expect("a cell that no seed reaches is one").1).collect()
}

/// The cell of a group that is nearest to its mean: on the surface, where the mean of a curved group is not.
fn centre(cells: &PixelSpace, members: &[usize]) -> usize {
    let area: f64 = members.iter().map(|&cell| cells.areas[cell]).sum();
    let weighted = |sum: Point3, &cell: &usize| add(sum, scale(cells.centres_m[cell], cells.areas[cell] / area));
    let mean_m = members.iter().fold([0.0; 3], weighted);
    let away_m = |cell: &usize| distance(cells.centres_m[*cell], mean_m);
    let nearest = members.iter().copied().min_by(|a, b| away_m(a).total_cmp(&away_m(b)));
    nearest.expect("a group holds its seed")
}

fn neighbours(cells: &PixelSpace, owners: &[usize], members: &[usize], pixel: usize) -> Vec<usize> {
    let around = members.iter().flat_map(|&cell| &cells.neighbours[cell]).map(|&cell| owners[cell]);
    let mut others: Vec<usize> = around.filter(|&other| other != pixel).collect();
    others.sort_unstable();
    others.dedup();
    others
}
