//! Eight matrices of one pattern factored simultaneously, one in each SIMD lane.
//!
//! Each number of the factorisation is a vector of eight numbers here, one per matrix. The arithmetic is that of
//! [`Symbolic::factor`] without gathers, and lanes are independent. Only the Schur complement of the kept unknowns is
//! needed, so the factor itself is not stored, unless derivatives are wanted ([`BatchFactor`]): a front's columns are in
//! a scratch panel, and its update is written to the address where its parent reads it, which is planned beforehand.
//!
//! Panels and updates are stored in tiles of 4 x 4 numbers, so that the product of two rows of tiles reads memory in
//! order with 16 sums in registers. The number of passes depends on the instruction set: one with 512-bit vectors, two
//! with 256-bit vectors, eight without vectors.

mod adjoint;
mod front;
mod network;
mod plan;

pub(crate) use network::pseudo_inverses;
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
    /// Of derivatives; empty until they are asked for.
    scratch: AlignedVec,
    level: SimdLevel,
}

/// The factors of eight matrices, for derivatives.
#[derive(Debug, Clone)]
pub struct BatchFactor {
    /// The panels of all fronts, pass after pass.
    panels: AlignedVec,
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
            scratch: AlignedVec::new(0),
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
        self.run(entries, workspace, None, impedances)
    }

    /// Memory for the factors of [`transfer_impedances_kept`](Self::transfer_impedances_kept) with this workspace.
    pub fn factor(&self, workspace: &BatchWorkspace) -> BatchFactor {
        BatchFactor { panels: AlignedVec::new(self.panels_size * LANES), level: workspace.level }
    }

    /// As [`transfer_impedances`](Self::transfer_impedances), with the same bits, and keeps the factors.
    ///
    /// # Errors
    /// The same.
    ///
    /// # Panics
    /// If the memory is of another plan.
    pub fn transfer_impedances_kept(
        &self,
        entries: &impl Entries,
        workspace: &mut BatchWorkspace,
        factor: &mut BatchFactor,
        impedances: &mut [[f64; LANES]],
    ) -> Result<(), BadLanes> {
        assert_eq!(factor.panels.len, self.panels_size * LANES, "a factor of another plan");
        factor.level = workspace.level;
        self.run(entries, workspace, Some(factor), impedances)
    }

    fn run(
        &self,
        entries: &impl Entries,
        workspace: &mut BatchWorkspace,
        factor: Option<&mut BatchFactor>,
        impedances: &mut [[f64; LANES]],
    ) -> Result<(), BadLanes> {
        assert_eq!(impedances.len(), self.kept_count * self.kept_count, "a value per pair of kept unknowns");
        assert_eq!(workspace.updates.len, self.update_size * LANES, "workspace of another plan");
        let arch = workspace.level.arch();
        let good = arch.dispatch(Run { plan: self, entries, workspace, factor, impedances });
        if good.iter().all(|&good| good) { Ok(()) } else { Err(BadLanes(good.map(|good| !good))) }
    }

    /// The derivatives of a function of the Schur complements with respect to the entries, in the order of
    /// [`entry_order`](Self::entry_order), a lane per matrix.
    ///
    /// `schur` contains the function's derivative with respect to the complement `Y` as a symmetric matrix `G`, so that
    /// it changes by `trace(G dY)`; `kept x kept`. The derivative of an off-diagonal entry is half of that of the value
    /// that the entry stands for, which is in the matrix twice.
    ///
    /// # Panics
    /// If the memory is of another plan.
    pub fn entry_derivatives(
        &self,
        factor: &BatchFactor,
        schur: &[[f64; LANES]],
        workspace: &mut BatchWorkspace,
        derivatives: &mut [[f64; LANES]],
    ) {
        assert_eq!(factor.panels.len, self.panels_size * LANES, "a factor of another plan");
        assert_eq!(schur.len(), self.kept_count * self.kept_count, "a value per pair of kept unknowns");
        assert_eq!(derivatives.len(), self.entry_order().len(), "a value per entry");
        let size = adjoint::Scratch::of(self).size() * LANES;
        if workspace.scratch.len < size {
            workspace.scratch = AlignedVec::new(size);
        }
        let arch = factor.level.arch();
        arch.dispatch(Differentiate { plan: self, factor, schur, workspace, derivatives });
    }
}

struct Run<'a, E> {
    plan: &'a BatchPlan,
    entries: &'a E,
    workspace: &'a mut BatchWorkspace,
    factor: Option<&'a mut BatchFactor>,
    impedances: &'a mut [[f64; LANES]],
}

impl<E: Entries> WithSimd for Run<'_, E> {
    type Output = [bool; LANES];

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> Self::Output {
        let width = S::F64_LANES;
        let mut good = [true; LANES];
        for pass in 0..LANES / width {
            let updates = S::as_mut_simd_f64s(self.workspace.updates.values_mut()).0;
            let network = S::as_mut_simd_f64s(self.workspace.network.values_mut()).0;
            let least = match &mut self.factor {
                None => {
                    let panel = S::as_mut_simd_f64s(self.workspace.panel.values_mut()).0;
                    front::eliminate_all::<S, false>(simd, self.plan, self.entries, pass, panel, updates)
                }
                Some(factor) => {
                    let panels = S::as_mut_simd_f64s(factor.panels.values_mut()).0;
                    let panels = &mut panels[pass * self.plan.panels_size..][..self.plan.panels_size];
                    front::eliminate_all::<S, true>(simd, self.plan, self.entries, pass, panels, updates)
                }
            };
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

struct Differentiate<'a> {
    plan: &'a BatchPlan,
    factor: &'a BatchFactor,
    schur: &'a [[f64; LANES]],
    workspace: &'a mut BatchWorkspace,
    derivatives: &'a mut [[f64; LANES]],
}

impl WithSimd for Differentiate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Differentiate { plan, factor, schur, workspace, derivatives } = self;
        let (width, kept) = (S::F64_LANES, plan.kept_count);
        let panels = S::as_simd_f64s(factor.panels.values()).0;
        for pass in 0..LANES / width {
            let lanes = pass * width..(pass + 1) * width;
            let updates = S::as_mut_simd_f64s(workspace.updates.values_mut()).0;
            let mut place = plan.schur;
            for column in 0..kept {
                for row in column..kept {
                    let values: &mut [f64] = pulp::bytemuck::cast_slice_mut(std::slice::from_mut(&mut updates[place]));
                    values.copy_from_slice(&schur[row * kept + column][lanes.clone()]);
                    place += 1;
                }
            }
            let panels = &panels[pass * plan.panels_size..][..plan.panels_size];
            let scratch = S::as_mut_simd_f64s(workspace.scratch.values_mut()).0;
            adjoint::differentiate_all(simd, plan, panels, updates, scratch, |position, value| {
                let value: &[f64] = pulp::bytemuck::cast_slice(std::slice::from_ref(&value));
                derivatives[position][lanes.clone()].copy_from_slice(value);
            });
        }
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

    /// Another number of numbers, of any value, in the same memory if it is large enough.
    pub(crate) fn resize(&mut self, len: usize) {
        match self.start + len <= self.memory.len() {
            true => self.len = len,
            false => *self = Self::new(len),
        }
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
