//! Eight matrices of one pattern factored at once, one in each lane of a vector.
//!
//! A number of the factorisation is a vector of eight numbers here, one per matrix: the arithmetic is that of
//! [`Symbolic::factor`] without a gather, and a lane never looks at its neighbours. Only the Schur complement of the kept
//! unknowns is wanted, so the factor itself is not stored: a front's columns live in a scratch panel, and its update is
//! written where its parent will find it, at an address planned beforehand.
//!
//! Panels and updates are stored in tiles of 4 x 4 numbers, so that the product of two rows of tiles runs through memory
//! in order with 16 sums in registers. Matrices go through in as many passes as it takes the instruction set at hand: one
//! with 512-bit vectors, two with 256, eight without.

mod front;
mod network;
mod plan;

pub use plan::BatchPlan;

use super::Symbolic;
use super::simd_level::SimdLevel;
use pulp::{Simd, WithSimd};

/// Matrices factored at once.
pub const LANES: usize = 8;

/// The entries of the matrices, as the factorisation asks for them.
///
/// An implementation marks `entry` as `#[inline(always)]`: it is compiled once per instruction set.
pub trait Entries: Sync {
    /// The entry at a position of [`BatchPlan::entry_order`], of as many matrices as a vector has lanes, in the given
    /// pass.
    fn entry<S: Simd>(&self, simd: S, position: usize, pass: usize) -> S::f64s;
}

/// Memory that factorisations by one plan share.
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
    /// Memory for [`transfer_impedances`](Self::transfer_impedances), with the best instruction set of this machine.
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
    /// Which matrices are not positive definite on the eliminated unknowns, or whose kept ones do not hang together.
    ///
    /// # Panics
    /// Where the memory is another plan's.
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

/// Numbers whose first lies at the start of a cache line: a 64-byte vector that straddles two is read at half the speed.
#[derive(Debug)]
pub struct AlignedVec {
    memory: Vec<f64>,
    start: usize,
    len: usize,
}

const CACHE_LINE_BYTES: usize = 64;

impl AlignedVec {
    /// Zeros.
    pub fn new(len: usize) -> Self {
        let memory = vec![0.0; len + CACHE_LINE_BYTES / size_of::<f64>()];
        let start = memory.as_ptr().align_offset(CACHE_LINE_BYTES).min(CACHE_LINE_BYTES / size_of::<f64>());
        AlignedVec { memory, start, len }
    }

    /// The numbers.
    #[inline(always)]
    pub fn values(&self) -> &[f64] {
        &self.memory[self.start..self.start + self.len]
    }

    /// The numbers, to change.
    #[inline(always)]
    pub fn values_mut(&mut self) -> &mut [f64] {
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
    /// The plan by which eight matrices of this pattern are factored at once.
    pub fn batch_plan(&self) -> BatchPlan {
        BatchPlan::new(self)
    }
}
