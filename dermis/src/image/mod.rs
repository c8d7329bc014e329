//! Pixels on a surface, and images made of them.

mod cells;
mod grid;
mod patches;
#[cfg(test)]
pub(crate) mod tests;

use crate::design::{ImageLayout, SkinDesign};
use crate::geom::vector::{bounding_box, distance, dot, norm, scale, sub};
use crate::geom::{Point3, Surface};
use crate::mesh::{Mesh, MeshError};
use std::sync::Arc;

/// The pixels of a skin's image: their positions, their neighbours, and the fraction of each mesh cell in each pixel.
///
/// Only pixels that overlap the body are stored; `position_in_grid` gives their places in the grid.
#[derive(Debug, Clone)]
pub struct PixelSpace {
    /// The surface of the pixels.
    pub surface: Surface,
    /// Rows and columns of the grid; `None` if pixels are cells or groups of cells.
    pub grid: Option<[usize; 2]>,
    /// Index in the grid, row-major, of each pixel (its own index without a grid).
    pub position_in_grid: Vec<usize>,
    /// Centre of each pixel on the surface, m (of the part inside the body).
    pub centres_m: Vec<Point3>,
    /// Outward unit normals at the centres.
    pub normals: Vec<Point3>,
    /// Area of the part of each pixel inside the body, m2 (volume of a tetrahedron, m3).
    pub areas: Vec<f64>,
    /// Neighbours of each pixel, by index in this list: pixels that share an edge (in a volume a face).
    pub(crate) neighbours: Vec<Vec<usize>>,
    /// The sides of the mesh's edge; none on a closed surface, or where it is not known.
    pub(crate) edge_m: Vec<[Point3; 2]>,
    /// For each pixel the cells that it overlaps, with the fraction of the cell's measure in the pixel. The fractions
    /// of one cell over all pixels sum to one.
    pub overlaps: Vec<Vec<(usize, f64)>>,
}

impl PixelSpace {
    /// The pixels of a design, on its mesh.
    ///
    /// On a cylinder, pixel `(i, j)` of a grid of `rows` x `columns` is the part of the wall with z between `i` and
    /// `i + 1` times `length / rows` and theta between `j` and `j + 1` times `2 pi / columns`; on a flat skin rows run
    /// along y and columns along x over the bounding box of the body. The overlap of a pixel and a triangle is the area
    /// of the clipped triangle, on a cylinder of its unrolled image (with edges straight in z and theta, so that the
    /// unrolled triangles tile the wall).
    ///
    /// # Errors
    /// A grid on a body without rows and columns (a mesh file), or on a volume.
    pub fn for_design(design: &SkinDesign, mesh: &Mesh) -> Result<Self, MeshError> {
        let pixels = match design.image {
            ImageLayout::Cells => cells::pixels(mesh, design.body.surface()),
            ImageLayout::Patches => patches::pixels(mesh, design.body.surface()),
            ImageLayout::Grid { rows, columns } => grid::pixels(&design.body, [rows, columns], mesh)?,
        };
        Ok(pixels.with_edge_of(mesh))
    }

    fn with_edge_of(self, mesh: &Mesh) -> Self {
        let edge_m = mesh.edge_sides().into_iter().map(|side| side.map(|node| mesh.nodes[node])).collect();
        PixelSpace { edge_m, ..self }
    }

    /// The straight-line distance from a point to the edge of the skin, m; `NaN` if it has none.
    pub fn edge_distance_m(&self, point_m: Point3) -> f64 {
        let to_side = |&[a, b]: &[Point3; 2]| {
            let (along, to) = (sub(b, a), sub(point_m, a));
            let part = (dot(to, along) / dot(along, along)).clamp(0.0, 1.0);
            norm(sub(to, scale(along, part)))
        };
        self.edge_m.iter().map(to_side).reduce(f64::min).unwrap_or(f64::NAN)
    }

    /// One pixel per mesh cell; neighbours share an edge (triangles) or a face (tetrahedra).
    ///
    /// The normal of a tetrahedron is that of the nearest part of the body's outer surface, counted in cells.
    pub fn cells(mesh: &Mesh, surface: Surface) -> Self {
        cells::pixels(mesh, surface).with_edge_of(mesh)
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.centres_m.len()
    }

    /// Whether there are no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The mean of a value per cell over each pixel, weighted by the measure of the overlap.
    ///
    /// # Panics
    /// If the number of values or measures differs from the number of cells.
    pub fn average_cells(&self, mesh: &Mesh, cell_values: &[f64]) -> Vec<f64> {
        assert_eq!(cell_values.len(), mesh.cell_count(), "a value per cell");
        let mean = |overlaps: &Vec<(usize, f64)>| {
            let (mut sum, mut measure) = (0.0, 0.0);
            for &(cell, fraction) in overlaps {
                let part = fraction * mesh.cell_measure(cell);
                sum += part * cell_values[cell];
                measure += part;
            }
            sum / measure
        };
        self.overlaps.iter().map(mean).collect()
    }

    /// Half of the pixel spacing, from the side of a square of mean area (in a volume of a cube): the approximate
    /// rounding error of positions in an image, m.
    pub fn half_pixel_m(&self) -> f64 {
        let mean = self.areas.iter().sum::<f64>() / self.len().max(1) as f64;
        0.5 * mean.sqrt()
    }

    /// The bounding box of the pixels' centres: the minimum and maximum coordinate along x, y and z, m.
    pub fn box_m(&self) -> [[f64; 2]; 3] {
        let [low_m, high_m] = bounding_box(self.centres_m.iter().copied());
        [0, 1, 2].map(|axis| [low_m[axis], high_m[axis]])
    }

    /// The longest side of the bounding box of the pixels' centres, m.
    pub fn extent_m(&self) -> f64 {
        self.box_m().into_iter().map(|[least, most]| most - least).fold(f64::MIN_POSITIVE, f64::max)
    }

    /// The outward unit normal of the body at a place: that of its surface, or of the nearest pixel.
    pub fn normal(&self, place: Point3) -> Point3 {
        self.surface.normal(place).unwrap_or_else(|| {
            let away = |pixel: &usize| distance(self.centres_m[*pixel], place);
            let nearest = (0..self.len()).min_by(|a, b| away(a).total_cmp(&away(b)));
            nearest.map_or([0.0, 0.0, 1.0], |pixel| self.normals[pixel])
        })
    }

    /// Pixels that may be within some distance of a position along the surface: those within the straight-line
    /// distance, which is a lower bound of the distance along the surface and much faster to compute.
    pub fn near(&self, place: Point3, reach_m: f64) -> impl Iterator<Item = usize> {
        let square = reach_m * reach_m;
        let is_near = move |(_, centre): &(usize, &Point3)| {
            let away = sub(**centre, place);
            dot(away, away) <= square
        };
        self.centres_m.iter().enumerate().filter(is_near).map(|(pixel, _)| pixel)
    }
}

/// One image: a value for each pixel. A touch is positive, whether it raises or lowers the conductance; the values are
/// relative changes of conductance.
#[derive(Debug, Clone)]
pub struct Image {
    /// The pixels.
    pub space: Arc<PixelSpace>,
    /// A value for each pixel, in the order of the space.
    pub values: Vec<f64>,
}

impl Image {
    /// An image of zeros.
    pub fn zeros(space: &Arc<PixelSpace>) -> Self {
        Image { space: Arc::clone(space), values: vec![0.0; space.len()] }
    }

    /// The grid of values, row-major with `NaN` outside the body; without a grid the values themselves, one per cell.
    pub fn to_grid(&self) -> Vec<f64> {
        let mut picture = match self.space.grid {
            Some([rows, columns]) => vec![f64::NAN; rows * columns],
            None => vec![f64::NAN; self.values.len()],
        };
        for (&position, &value) in self.space.position_in_grid.iter().zip(&self.values) {
            picture[position] = value;
        }
        picture
    }

    /// The mean of the image over each of the mesh's `cell_count` cells, weighted by the fraction of the cell in each
    /// pixel; `NaN` if a cell is in no pixel.
    ///
    /// # Panics
    /// If a pixel overlaps a cell beyond `cell_count`.
    pub fn to_cells(&self, cell_count: usize) -> Vec<f64> {
        let mut sums = vec![[0.0; 2]; cell_count];
        for (overlaps, value) in self.space.overlaps.iter().zip(&self.values) {
            for &(cell, fraction) in overlaps {
                sums[cell][0] += fraction * value;
                sums[cell][1] += fraction;
            }
        }
        sums.into_iter().map(|[sum, part]| sum / part).collect()
    }

    /// The pixel with the largest value and that value; `None` if no value is a number.
    pub fn peak(&self) -> Option<(usize, f64)> {
        let numbers = self.values.iter().copied().enumerate().filter(|(_, value)| !value.is_nan());
        numbers.reduce(|best, next| if next.1 > best.1 { next } else { best })
    }
}
