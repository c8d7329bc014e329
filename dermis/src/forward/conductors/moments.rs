//! Moments of the sheet's potential under floating conductors.

use std::ops::Range;

/// One moment of the sheet's potential under a conductor.
#[derive(Debug, Clone, PartialEq)]
pub struct PotentialMoment {
    /// Index of the conductor.
    pub conductor: usize,
    /// Nodes with their weights: the moment is the weighted sum of their potentials.
    pub nodes: Vec<(usize, f64)>,
}

impl PotentialMoment {
    /// The moment of a potential of 1 V.
    pub(super) fn of_one(&self) -> f64 {
        self.nodes.iter().map(|(_, weight)| weight).sum()
    }
}

/// The moments of all conductors, sorted by conductor.
#[derive(Debug, Clone, PartialEq)]
pub struct PotentialMoments {
    pub(super) all: Vec<PotentialMoment>,
    pub(super) of_conductor: Vec<Range<usize>>,
}

impl PotentialMoments {
    /// Moments in ascending order of their conductors.
    ///
    /// # Panics
    /// If they are in another order.
    pub fn new(all: Vec<PotentialMoment>) -> Self {
        assert!(all.is_sorted_by_key(|moment| moment.conductor), "moments in the order of their conductors");
        let count = all.last().map_or(0, |moment| moment.conductor + 1);
        let mut of_conductor = vec![0..0; count];
        for (index, moment) in all.iter().enumerate() {
            let range: &mut Range<usize> = &mut of_conductor[moment.conductor];
            *range = if range.end == 0 { index..index + 1 } else { range.start..index + 1 };
        }
        PotentialMoments { all, of_conductor }
    }

    /// All moments.
    pub fn all(&self) -> &[PotentialMoment] {
        &self.all
    }

    /// The moments of one conductor; none if the conductor does not exist.
    pub(crate) fn of_conductor(&self, conductor: usize) -> &[PotentialMoment] {
        &self.all[self.range(conductor)]
    }

    pub(super) fn range(&self, conductor: usize) -> Range<usize> {
        self.of_conductor.get(conductor).cloned().unwrap_or(0..0)
    }
}
