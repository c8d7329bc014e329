//! The complete electrode model: conductance to voltages, transfer impedance, Jacobian.
//!
//! On the skin `div (s grad u) = 0`, with `s` the sheet conductance (S) or, in a volume, the conductivity (S/m). An
//! electrode at potential `U` covers its patch `E` through a contact impedance `z`: the current density into the skin
//! is `(U - u) / z`, and its integral over `E` is the electrode's current `I` (Cheng, Isaacson, Newell and Gisser,
//! 1989, DOI 10.1109/10.35300; existence and uniqueness: Somersalo, Cheney and Isaacson, 1992, DOI 10.1137/0152060).
//! Linear elements give a symmetric system in the nodes' and the electrodes' potentials. Elimination of the nodes gives
//! the `L x L` admittance of the equivalent resistor network, stored in [`ElectrodeNetwork`].

mod arc_ends;
mod assembly;
mod batch;
mod conductors;
mod contact_jacobian;
mod displacement_jacobian;
mod family;
mod gradient;
mod jacobian;
mod many;
mod model;
mod near_field;
mod network;

pub use crate::linalg::Matrix;
pub use batch::BatchSolver;
pub use conductors::{ConductorContact, ConductorMoments, FloatingConductors, OnceMemory, PotentialMoments};
pub use displacement_jacobian::NodeVelocities;
pub(crate) use family::ModelFamily;
pub use gradient::{Gradient, KeptSolution};
pub use many::{SolutionGradient, Solutions};
pub use model::{ForwardModel, Solver, rest_conductivity};
pub use network::ElectrodeNetwork;

use thiserror::Error;

/// A forward problem without a solution.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ForwardError {
    /// A conductivity that is not positive and finite.
    #[error("the conductivity of cell {cell} is {value}: it must be positive and finite")]
    Conductivity {
        /// Index of the cell.
        cell: usize,
        /// Its value.
        value: f64,
    },
    /// A node whose position is not finite.
    #[error("the position of node {node} is not finite")]
    Node {
        /// Index of the node.
        node: usize,
    },
    /// A cell without an extent.
    #[error("cell {cell} has no extent: two of its nodes coincide, or it is folded")]
    Cell {
        /// Index of the cell.
        cell: usize,
    },
    /// A contact impedance that is not positive and finite.
    #[error("the contact impedance of electrode {electrode} is {value}: it must be positive and finite")]
    ContactImpedance {
        /// Index of the electrode.
        electrode: usize,
        /// Its value.
        value: f64,
    },
    /// A series resistance that is not finite.
    #[error("the series resistance of electrode {electrode} is {value}: it must be finite")]
    SeriesResistance {
        /// Index of the electrode.
        electrode: usize,
        /// Its value.
        value: f64,
    },
    /// A list of the wrong length.
    #[error("{what}: {got} values, but {expected} are needed")]
    Count {
        /// The content of the list.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length needed.
        expected: usize,
    },
    /// A contact with an invalid conductance: not finite, or less than at rest.
    #[error("the contact of conductor {conductor} is {value}: it must be finite and nowhere less than at rest")]
    ConductorContact {
        /// Index of the conductor.
        conductor: usize,
        /// The invalid conductance.
        value: f64,
    },
    /// Two point electrodes on one node.
    #[error("electrodes {first} and {second} are both at node {node}")]
    SharedNode {
        /// The first electrode.
        first: usize,
        /// The second.
        second: usize,
        /// Their node.
        node: usize,
    },
    /// A part of the skin without an electrode, or values of too different magnitude for floating-point arithmetic.
    #[error("the potentials are not determined at {place}: is there a part of the skin that no electrode touches?")]
    Singular {
        /// "node 17" or "electrode 3".
        place: String,
    },
}
