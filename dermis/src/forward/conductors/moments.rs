//! Moments of the sheet's potential under floating conductors.

use crate::linalg::Matrix;
use std::ops::Range;

/// The moments of the sheet's potential under one conductor: weighted sums of the potentials of the same nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct ConductorMoments {
    /// The nodes.
    pub nodes: Vec<usize>,
    /// Their weights, nodes x moments.
    pub weights: Matrix,
}

impl ConductorMoments {
    /// A conductor without a moment, which has no contact.
    pub fn none() -> Self {
        ConductorMoments { nodes: Vec::new(), weights: Matrix::zeros(0, 0) }
    }

    /// The moments of a potential of 1 V.
    pub(super) fn of_one(&self) -> Vec<f64> {
        let mut sums = vec![0.0; self.weights.columns];
        for row in self.weights.values.chunks_exact(self.weights.columns.max(1)) {
            sums.iter_mut().zip(row).for_each(|(sum, weight)| *sum += weight);
        }
        sums
    }
}

/// The moments of all conductors, in the order of their indices.
#[derive(Debug, Clone, PartialEq)]
pub struct PotentialMoments {
    conductors: Vec<ConductorMoments>,
    /// The index of the first moment of each conductor, and the number of all.
    starts: Vec<usize>,
}

impl PotentialMoments {
    /// The moments of each conductor.
    ///
    /// # Panics
    /// If a conductor's weights do not have a row for each of its nodes.
    pub fn new(conductors: Vec<ConductorMoments>) -> Self {
        let mut starts = vec![0];
        for (index, ConductorMoments { nodes, weights }) in conductors.iter().enumerate() {
            assert_eq!(nodes.len(), weights.rows, "a row of weights for each node of conductor {index}");
            starts.push(starts[index] + weights.columns);
        }
        PotentialMoments { conductors, starts }
    }

    /// The moments of each conductor.
    pub fn conductors(&self) -> &[ConductorMoments] {
        &self.conductors
    }

    /// The number of all moments.
    pub(super) fn count(&self) -> usize {
        self.starts[self.conductors.len()]
    }

    /// The indices of a conductor's moments; none if the conductor does not exist.
    pub(super) fn range(&self, conductor: usize) -> Range<usize> {
        match self.conductors.get(conductor) {
            Some(_) => self.starts[conductor]..self.starts[conductor + 1],
            None => 0..0,
        }
    }
}
