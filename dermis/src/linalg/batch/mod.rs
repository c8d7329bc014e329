//! Eight matrices of one pattern factored simultaneously, one in each SIMD lane.
//!
//! Each number of the factorisation is a vector of eight numbers here, one per matrix. The arithmetic is that of
//! [`Symbolic::factor`] without gathers, and lanes are independent. Only the Schur complement of the kept unknowns is
//! needed, so the factor itself is not stored: a front's columns are in a scratch panel, and its update is written to
//! the address where its parent reads it, which is planned beforehand.
//!
//! Panels and updates are stored in tiles of 4 x 4 numbers, so that the product of two rows of tiles reads memory in
//! order with 16 sums in registers. The number of passes depends on the instruction set: one with 512-bit vectors, two
//! with 256-bit vectors, eight without vectors.

mod front;
mod network;
mod plan;

pub use plan::BatchPlan;

use super::Symbolic;
use super::simd_level::SimdLevel;
use pulp::{Simd, WithSimd};

/// Number of matrices factored simultaneously.
pub const LANES: usize = 8;

/// The entries of the matrices, as requested by the factorisation.
///
/// An implementation marks `entry` as `#[inline(always)]`: it is compiled once per instruction set.
pub trait Entries: Sync {
    /// The entry at a position of [`BatchPlan::entry_order`], of as many matrices as a vector has lanes, in the given
    /// pass.
    fn entry<S: Simd>(&self, simd: S, position: usize, pass: usize) -> S::f64s;
}

/// Work memory shared by factorisations of one plan.
#[derive(Debug, Clone)]
pub struct BatchWorkspace {
    panel: AlignedVec,
    updates: AlignedVec,
    network: AlignedVec,
    level: SimdLevel,
}

/// Matrices whose pivots are not all positive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BadLanes(
    /// Whether each lane failed.
    pub [bool; LANES],
);

impl BatchPlan {
    /// Work memory for [`transfer_impedances`](Self::transfer_impedances), with the best instruction set of this
    /// machine.
    pub fn workspace(&self) -> BatchWorkspace {
        self.workspace_at(SimdLevel::best())
    }

    /// The same with a chosen instruction set.
    pub fn workspace_at(&self, level: SimdLevel) -> BatchWorkspace {
        BatchWorkspace {
            panel: AlignedVec::new(self.panel_size * LANES),
            updates: AlignedVec::new(self.update_size * LANES),
            network: AlignedVec::new(2 * self.kept_count * self.kept_count * LANES),
            level,
        }
    }

    /// The pseudo-inverses of the kept unknowns' Schur complements, `kept x kept` row-major with a lane per matrix.
    ///
    /// The complements must have the constant as their null vector; as in [`crate::forward::ElectrodeNetwork`].
    ///
    /// # Errors
    /// The matrices that are not positive definite on the eliminated unknowns, or whose kept unknowns are not
    /// connected.
    ///
    /// # Panics
    /// If the memory is of another plan.
    pub fn transfer_impedances(
        &self,
        entries: &impl Entries,
        workspace: &mut BatchWorkspace,
        impedances: &mut [[f64; LANES]],
    ) -> Result<(), BadLanes> {
        assert_eq!(impedances.len(), self.kept_count * self.kept_count, "a value per pair of kept unknowns");
        assert_eq!(workspace.updates.len, self.update_size * LANES, "workspace of another plan");
        let arch = workspace.level.arch();
        let good = arch.dispatch(Run { plan: self, entries, workspace, impedances });
        if good.iter().all(|&good| good) { Ok(()) } else { Err(BadLanes(good.map(|good| !good))) }
    }
}

struct Run<'a, E> {
    plan: &'a BatchPlan,
    entries: &'a E,
    workspace: &'a mut BatchWorkspace,
    impedances: &'a mut [[f64; LANES]],
}

impl<E: Entries> WithSimd for Run<'_, E> {
    type Output = [bool; LANES];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let width = S::F64_LANES;
        let mut good = [true; LANES];
        for pass in 0..LANES / width {
            let panel = S::as_mut_simd_f64s(self.workspace.panel.values_mut()).0;
            let updates = S::as_mut_simd_f64s(self.workspace.updates.values_mut()).0;
            let network = S::as_mut_simd_f64s(self.workspace.network.values_mut()).0;
            let least = front::eliminate_all(simd, self.plan, self.entries, pass, panel, updates);
            let schur = &updates[self.plan.schur..];
            let least_kept = network::pseudo_inverse(simd, schur, self.plan.kept_count, network);
            let lanes = pass * width..(pass + 1) * width;
            for pivots in [least, least_kept] {
                let pivots = pulp::bytemuck::bytes_of(&pivots);
                let pivots: &[f64] = pulp::bytemuck::cast_slice(pivots);
                for (good, pivot) in good[lanes.clone()].iter_mut().zip(pivots) {
                    *good &= *pivot > 0.0;
                }
            }
            for (target, value) in self.impedances.iter_mut().zip(&*network) {
                let value: &[f64] = pulp::bytemuck::cast_slice(std::slice::from_ref(value));
                target[lanes.clone()].copy_from_slice(value);
            }
        }
        good
    }
}

/// Numbers aligned to a cache line: a 64-byte vector that crosses two lines is read at half the speed.
#[derive(Debug)]
pub(crate) struct AlignedVec {
    memory: Vec<f64>,
    start: usize,
    len: usize,
}

const CACHE_LINE_BYTES: usize = 64;

impl AlignedVec {
    /// Zeros.
    pub(crate) fn new(len: usize) -> Self {
        let memory = vec![0.0; len + CACHE_LINE_BYTES / size_of::<f64>()];
        let start = memory.as_ptr().align_offset(CACHE_LINE_BYTES).min(CACHE_LINE_BYTES / size_of::<f64>());
        AlignedVec { memory, start, len }
    }

    /// The numbers.
    #[inline(always)]
    pub(crate) fn values(&self) -> &[f64] {
        &self.memory[self.start..self.start + self.len]
    }

    /// The numbers, mutable.
    #[inline(always)]
    pub(crate) fn values_mut(&mut self) -> &mut [f64] {
        &mut self.memory[self.start..self.start + self.len]
    }
}

impl Clone for AlignedVec {
    fn clone(&self) -> Self {
        let mut copy = Self::new(self.len);
        copy.values_mut().copy_from_slice(self.values());
        copy
    }
}

impl Symbolic {
    /// The plan for factoring eight matrices of this pattern simultaneously.
    pub fn batch_plan(&self) -> BatchPlan {
        BatchPlan::new(self)
    }
}
