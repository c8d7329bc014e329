//! The complete electrode model: conductance to voltages, transfer impedance, Jacobian.

use crate::design::SkinDesign;
use crate::frame::Frame;
use crate::image::PixelSpace;
use crate::mesh::Mesh;
use crate::protocol::Protocol;
use thiserror::Error;

/// A forward problem without a solution.
#[derive(Debug, Error)]
pub enum ForwardError {
    /// A conductivity that no matter has.
    #[error("conductivity of cell {cell} is {value}: it must be positive and finite")]
    Conductivity {
        /// Index of the cell.
        cell: usize,
        /// Its value.
        value: f64,
    },
    /// A list of another length than what it describes.
    #[error("{what}: {got} values, but {expected} are needed")]
    Count {
        /// What the list holds.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length needed.
        expected: usize,
    },
    /// A problem that has no unique solution.
    #[error("{0}")]
    Singular(String),
}

/// The forward model of one skin on one mesh: everything that does not depend on the conductivity, computed once.
#[derive(Debug, Clone)]
pub struct ForwardModel {}

/// A matrix in row-major order.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrix {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Row-major values.
    pub values: Vec<f64>,
}

impl ForwardModel {
    /// The model of a design on its mesh.
    ///
    /// # Errors
    /// A mesh that does not fit the design.
    pub fn new(design: &SkinDesign, mesh: &Mesh) -> crate::Result<Self> {
        let _ = (design, mesh);
        unimplemented!()
    }

    /// The model of a mesh without a design. `contact_impedances` has one value per electrode (ohm m2 on cells and
    /// faces, ohm m on edges, unused on nodes), `rest_conductivity` one per cell (S on surfaces, S/m in volumes).
    ///
    /// # Errors
    /// Lists of the wrong length, values that are not positive, a mesh with a part that no electrode reaches.
    pub fn from_parts(
        mesh: &Mesh,
        contact_impedances: &[f64],
        protocol: &Protocol,
        rest_conductivity: &[f64],
    ) -> crate::Result<Self> {
        let _ = (mesh, contact_impedances, protocol, rest_conductivity);
        unimplemented!()
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        unimplemented!()
    }

    /// The order of a frame's values.
    pub fn protocol(&self) -> &Protocol {
        unimplemented!()
    }

    /// Conductivity of the untouched skin, a value per cell.
    pub fn rest_conductivity(&self) -> &[f64] {
        unimplemented!()
    }

    /// The frame of a skin with the given conductivity per cell, ohm.
    ///
    /// # Errors
    /// A conductivity of the wrong length, or one that is not positive and finite.
    pub fn solve(&self, conductivity: &[f64]) -> Result<Frame, ForwardError> {
        let _ = conductivity;
        unimplemented!()
    }

    /// The derivative of the frame by the conductivity of each cell, channels x cells, ohm per S.
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    pub fn jacobian(&self, conductivity: &[f64]) -> Result<Matrix, ForwardError> {
        let _ = conductivity;
        unimplemented!()
    }

    /// The derivative of the frame by the conductivity of each pixel, channels x pixels: the cells' derivatives
    /// summed with the fraction of each that lies in the pixel; ohm per S.
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    pub fn pixel_jacobian(&self, conductivity: &[f64], pixels: &PixelSpace) -> Result<Matrix, ForwardError> {
        let _ = (conductivity, pixels);
        unimplemented!()
    }
}
