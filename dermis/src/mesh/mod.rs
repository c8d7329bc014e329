//! Surface triangles in space or tetrahedra, with electrode patches.

mod displace;
pub mod export;
mod faces;
mod fit;
mod generate;
mod hash;
pub mod import;
mod limits;
mod place;
pub mod quality;
mod refine;
mod remesh;
mod validate;

pub(crate) use refine::Refined;

use crate::geom::vector::{self, Point3};
use std::path::PathBuf;
use thiserror::Error;

/// A mesh that cannot be generated, read, written or used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A file that cannot be opened, read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// A file that is not of the format of its name.
    #[error("{}: {message}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The problem, its place, and the fix.
        message: String,
    },
    /// A mesh on which no forward problem can be solved.
    #[error("{0}")]
    Invalid(String),
    /// A design for which no mesh can be generated.
    #[error("{0}")]
    Generate(String),
}

/// The cells of a mesh, as indices of nodes.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// A surface: triangles, counter-clockwise as seen from outside.
    Triangles(Vec<[usize; 3]>),
    /// A volume: tetrahedra of positive volume.
    Tetrahedra(Vec<[usize; 4]>),
}

impl Cells {
    /// Number of cells.
    pub fn len(&self) -> usize {
        match self {
            Cells::Triangles(cells) => cells.len(),
            Cells::Tetrahedra(cells) => cells.len(),
        }
    }

    /// Whether there are no cells.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The nodes of a cell.
    pub fn corners(&self, cell: usize) -> &[usize] {
        match self {
            Cells::Triangles(cells) => &cells[cell],
            Cells::Tetrahedra(cells) => &cells[cell],
        }
    }
}

/// The part of a mesh covered by an electrode.
#[derive(Debug, Clone, PartialEq)]
pub enum ElectrodePatch {
    /// Whole triangles of a surface mesh, by cell index.
    Cells(Vec<usize>),
    /// Edges of a surface mesh.
    Edges(Vec<[usize; 2]>),
    /// Faces of a volume mesh.
    Faces(Vec<[usize; 3]>),
    /// One node.
    Node(usize),
}

/// A mesh of a skin.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// Positions of the nodes, m.
    pub nodes: Vec<Point3>,
    /// The cells.
    pub cells: Cells,
    /// The patch of each electrode, in the order of the electrodes.
    pub electrodes: Vec<ElectrodePatch>,
    /// Named groups of cells, by cell index (from a file's physical groups; empty on generated meshes).
    pub regions: Vec<(String, Vec<usize>)>,
}

impl Mesh {
    /// Number of nodes.
    pub fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// Number of cells.
    pub fn cell_count(&self) -> usize {
        self.cells.len()
    }

    /// The nodes of an electrode, in order.
    ///
    /// # Panics
    /// If the electrode does not exist.
    pub fn electrode_nodes(&self, electrode: usize) -> Vec<usize> {
        let mut nodes: Vec<usize> = match &self.electrodes[electrode] {
            ElectrodePatch::Cells(cells) => cells.iter().flat_map(|&cell| self.cells.corners(cell)).copied().collect(),
            ElectrodePatch::Edges(edges) => edges.as_flattened().to_vec(),
            ElectrodePatch::Faces(faces) => faces.as_flattened().to_vec(),
            ElectrodePatch::Node(node) => vec![*node],
        };
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Area (m2) of a triangle or volume (m3) of a tetrahedron.
    pub fn cell_measure(&self, cell: usize) -> f64 {
        match &self.cells {
            Cells::Triangles(cells) => vector::triangle_area(cells[cell].map(|node| self.nodes[node])),
            Cells::Tetrahedra(cells) => vector::tetrahedron_volume(cells[cell].map(|node| self.nodes[node])),
        }
    }

    /// The centre of a cell, m.
    pub fn cell_centre(&self, cell: usize) -> Point3 {
        let corners = self.cells.corners(cell);
        let sum = corners.iter().fold([0.0; 3], |sum, &node| vector::add(sum, self.nodes[node]));
        vector::scale(sum, 1.0 / corners.len() as f64)
    }
}
