//! Small problems for the tests of this module.

use crate::forward::Matrix;
use crate::geom::Surface;
use crate::image::PixelSpace;
use crate::reconstruct::Linearised;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// Pixels in a row, connected in pieces of the given lengths.
pub(crate) fn rows_of_pixels(pieces: &[usize]) -> PixelSpace {
    let count: usize = pieces.iter().sum();
    let mut neighbours = vec![Vec::new(); count];
    let mut start = 0;
    for &length in pieces {
        for pixel in start + 1..start + length {
            neighbours[pixel].push(pixel - 1);
            neighbours[pixel - 1].push(pixel);
        }
        start += length;
    }
    PixelSpace {
        surface: Surface::Plane,
        grid: None,
        position_in_grid: (0..count).collect(),
        centres_m: (0..count).map(|pixel| [pixel as f64, 0.0, 0.0]).collect(),
        normals: vec![[0.0, 0.0, 1.0]; count],
        areas: (0..count).map(|pixel| 1.0 + 0.1 * (pixel % 3) as f64).collect(),
        neighbours,
        edge_m: Vec::new(),
        overlaps: (0..count).map(|pixel| vec![(pixel, 1.0)]).collect(),
    }
}

/// A grid of square pixels of some size, m, row by row; with `closed` the last column is beside the first.
pub(crate) fn grid_of_pixels([rows, columns]: [usize; 2], size_m: f64, closed: bool) -> PixelSpace {
    let mut space = rows_of_pixels(&[rows * columns]);
    space.areas.fill(size_m * size_m);
    for (pixel, neighbours) in space.neighbours.iter_mut().enumerate() {
        let (row, column) = (pixel / columns, pixel % columns);
        *neighbours = [(row.wrapping_sub(1), column), (row + 1, column)]
            .map(|(r, c)| (r < rows, r, c))
            .to_vec()
            .into_iter()
            .chain([column.wrapping_sub(1), column + 1].map(|c| {
                let inside = if closed { (c.wrapping_add(columns)) % columns } else { c };
                (inside < columns, row, inside)
            }))
            .filter(|&(exists, ..)| exists)
            .map(|(_, r, c)| r * columns + c)
            .collect();
    }
    let angle = std::f64::consts::TAU / columns as f64;
    let radius_m = 0.5 * size_m / (0.5 * angle).sin();
    space.centres_m = (0..rows * columns)
        .map(|pixel| (size_m * (pixel / columns) as f64, (pixel % columns) as f64))
        .map(|(y, column)| {
            let (sin, cos) = (angle * column).sin_cos();
            if closed { [radius_m * cos, radius_m * sin, y] } else { [size_m * column, y, 0.0] }
        })
        .collect();
    space
}

/// A smoothing Jacobian: each channel has a Gaussian sensitivity over pixels, with a small random part from the seed.
pub(crate) fn blurring(channels: usize, pixels: usize, seed: u64) -> Linearised {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut values = Vec::new();
    for channel in 0..channels {
        for pixel in 0..pixels {
            let gap = channel as f64 / channels as f64 - pixel as f64 / pixels as f64;
            values.push((-20.0 * gap * gap).exp() * (1.0 + 0.02 * normal(&mut random)));
        }
    }
    Linearised {
        jacobian: Matrix { rows: channels, columns: pixels, values },
        rest_frame: (0..channels).map(|channel| 1.0 + 0.5 * (channel as f64).sin()).collect(),
        rest_conductivity: vec![1.0; pixels],
    }
}

/// A standard normal number (sum of twelve uniform ones, less six).
pub(crate) fn normal(random: &mut impl Rng) -> f64 {
    (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
}

/// [`blurring`] with its pixels in one row.
pub(crate) fn small(channels: usize, pixels: usize) -> (Linearised, Arc<PixelSpace>) {
    (blurring(channels, pixels, 7), Arc::new(rows_of_pixels(&[pixels])))
}
