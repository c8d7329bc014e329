//! The numeric part of a sparse Cholesky factorisation.

use super::AlignedVec;
use super::dense::eliminate;
use super::matrix::Matrix;
use super::symbolic::{Supernode, Symbolic};
use super::tile::Rows;
use pulp::{Simd, WithSimd};
use thiserror::Error;

/// Right-hand sides are processed in groups of this size, the lanes of the widest vectors: a smaller remainder would be
/// processed one by one.
const LANES: usize = 8;

/// A matrix that is not positive definite.
#[derive(Debug, Error, Clone, Copy, PartialEq, Eq)]
#[error("the matrix is not positive definite: the pivot of unknown {unknown} is not positive")]
pub struct NotPositiveDefinite {
    /// The unknown whose pivot is not positive.
    pub unknown: usize,
}

/// Work memory shared by factorisations of one pattern.
#[derive(Debug, Clone)]
pub(crate) struct Workspace {
    front: AlignedVec,
    stack: Vec<f64>,
}

/// The Cholesky factor `L` of the eliminated unknowns, and the Schur complement of the kept ones.
#[derive(Debug, Clone)]
pub struct Factor {
    values: Vec<f64>,
    /// The Schur complement of the kept unknowns, both triangles.
    schur: Matrix,
}

impl Symbolic {
    /// Work memory for [`factor_into`](Self::factor_into).
    pub(crate) fn workspace(&self) -> Workspace {
        let front = AlignedVec::new(self.front_max * Rows::stride(self.front_max));
        Workspace { front, stack: vec![0.0; self.stack_max] }
    }

    /// A factor to be filled by [`factor_into`](Self::factor_into).
    pub(crate) fn empty_factor(&self) -> Factor {
        Factor { values: vec![0.0; self.value_count], schur: Matrix::zeros(self.kept_count, self.kept_count) }
    }

    /// Factors the matrix with the given entry values, in the order of the pattern's entries.
    ///
    /// # Errors
    /// A matrix that is not positive definite on the eliminated unknowns.
    ///
    /// # Panics
    /// If the number of values differs from the pattern's.
    pub fn factor(&self, values: &[f64]) -> Result<Factor, NotPositiveDefinite> {
        let mut factor = self.empty_factor();
        self.factor_into(values, &mut factor, &mut self.workspace())?;
        Ok(factor)
    }

    /// [`factor`](Self::factor) into the caller's memory.
    ///
    /// # Errors
    /// A matrix that is not positive definite on the eliminated unknowns.
    ///
    /// # Panics
    /// If the number of values differs from the pattern's, or the memory is of another pattern.
    pub(crate) fn factor_into(
        &self,
        values: &[f64],
        factor: &mut Factor,
        workspace: &mut Workspace,
    ) -> Result<(), NotPositiveDefinite> {
        assert_eq!(values.len(), self.entry_count(), "values of another pattern");
        assert_eq!(factor.values.len(), self.value_count, "factor of another pattern");
        assert_eq!(workspace.stack.len(), self.stack_max, "workspace of another pattern");
        pulp::Arch::new().dispatch(Eliminate { symbolic: self, values, factor, workspace })
    }

    #[inline(always)]
    fn eliminate_all<S: Simd>(
        &self,
        simd: S,
        values: &[f64],
        factor: &mut Factor,
        workspace: &mut Workspace,
    ) -> Result<(), NotPositiveDefinite> {
        let Workspace { front, stack } = workspace;
        let mut top = 0;
        for supernode in &self.supernodes {
            let (width, height) = (supernode.width(), supernode.height());
            let stride = Rows::stride(height);
            let front = &mut front.values_mut()[..height * stride];
            front.fill(0.0);
            for &(entry, [column, row]) in &self.entry_plan[supernode.entries.clone()] {
                front[column * stride + row] += values[entry];
            }
            for &child in self.children[supernode.children.clone()].iter().rev() {
                top -= self.extend_add(&self.supernodes[child], &stack[..top], front, stride);
            }
            eliminate(simd, front, height, width)
                .map_err(|pivot| NotPositiveDefinite { unknown: self.order[supernode.columns.start + pivot] })?;
            let block = &mut factor.values[supernode.start..supernode.start + width * height];
            for (target, column) in block.chunks_exact_mut(height).zip(front.chunks_exact(stride)) {
                target.copy_from_slice(&column[..height]);
            }
            let rows = height - width;
            for column in 0..rows {
                let from = (width + column) * stride + width;
                stack[top + column * rows + column..top + (column + 1) * rows]
                    .copy_from_slice(&front[from + column..from + rows]);
            }
            top += rows * rows;
        }
        self.finish_schur(values, &stack[..top], &mut factor.schur);
        Ok(())
    }

    /// Adds the update on top of the stack, which belongs to `child`, to a front whose columns are `stride` apart; returns
    /// its size.
    #[inline(always)]
    fn extend_add(&self, child: &Supernode, stack: &[f64], front: &mut [f64], stride: usize) -> usize {
        let rows = child.rows.len();
        let update = &stack[stack.len() - rows * rows..];
        let place = &self.row_in_parent[child.row_in_parent.clone()];
        for (column, &target_column) in place.iter().enumerate() {
            let target = &mut front[target_column * stride..(target_column + 1) * stride];
            let source = &update[column * rows + column..(column + 1) * rows];
            for (&row, value) in place[column..].iter().zip(source) {
                target[row] += value;
            }
        }
        rows * rows
    }

    /// The kept block: its own entries and the roots' updates.
    #[inline(always)]
    fn finish_schur(&self, values: &[f64], stack: &[f64], schur: &mut Matrix) {
        schur.values.fill(0.0);
        for &(entry, target) in &self.kept_entries {
            schur.values[target] += values[entry];
        }
        let mut top = stack.len();
        for &root in self.roots.iter().rev() {
            top -= self.extend_add(&self.supernodes[root], &stack[..top], &mut schur.values, self.kept_count);
        }
        for column in 0..self.kept_count {
            for row in column + 1..self.kept_count {
                schur.values[row * self.kept_count + column] = schur.values[column * self.kept_count + row];
            }
        }
    }
}

impl Factor {
    /// The Schur complement of the kept unknowns.
    pub fn schur(&self) -> &Matrix {
        &self.schur
    }

    /// Given the values of the kept unknowns, computes the eliminated ones that make their equations homogeneous:
    /// `A_ii x_i + A_ik x_k = 0`.
    ///
    /// `x` has a row per unknown, in the caller's order, and a column per problem; the last rows are given, the others
    /// are computed.
    ///
    /// # Panics
    /// If `x` has the wrong number of rows.
    pub fn extend_homogeneous(&self, symbolic: &Symbolic, x: &mut Matrix) {
        assert_eq!(x.rows, symbolic.unknown_count, "a row per unknown");
        let interior = symbolic.unknown_count - symbolic.kept_count;
        x.values[..interior * x.columns].fill(0.0);
        self.back_substitute(symbolic, x);
    }

    /// Solves `A x = b` in place for a matrix without kept unknowns; a row per unknown, a column per problem.
    ///
    /// # Panics
    /// If there are kept unknowns or `x` has the wrong number of rows.
    pub fn solve_in_place(&self, symbolic: &Symbolic, x: &mut Matrix) {
        assert_eq!(symbolic.kept_count, 0, "no unknown kept");
        assert_eq!(x.rows, symbolic.unknown_count, "a row per unknown");
        self.forward_substitute(symbolic, x);
        self.back_substitute(symbolic, x);
    }

    /// Solves `A_ii x_i = b_i` in place on the eliminated unknowns, with the kept ones fixed at zero; a row per
    /// unknown, a column per problem.
    ///
    /// # Panics
    /// If `x` has the wrong number of rows.
    pub(crate) fn solve_grounded(&self, symbolic: &Symbolic, x: &mut Matrix) {
        assert_eq!(x.rows, symbolic.unknown_count, "a row per unknown");
        self.forward_substitute(symbolic, x);
        let interior = symbolic.unknown_count - symbolic.kept_count;
        x.values[interior * x.columns..].fill(0.0);
        self.back_substitute(symbolic, x);
    }

    /// `x <- L^-1 x` on the eliminated unknowns; their contribution is subtracted from the kept ones.
    fn forward_substitute(&self, symbolic: &Symbolic, x: &mut Matrix) {
        let stride = x.columns.next_multiple_of(LANES);
        let mut buffer = vec![0.0; symbolic.front_max * stride];
        pulp::Arch::new().dispatch(ForwardSubstitute { symbolic, factor: self, x, buffer: &mut buffer, stride });
    }

    /// `x <- L^-T x` on the eliminated unknowns, given the kept ones.
    fn back_substitute(&self, symbolic: &Symbolic, x: &mut Matrix) {
        let stride = x.columns.next_multiple_of(LANES);
        let mut buffer = vec![0.0; symbolic.front_max * stride];
        pulp::Arch::new().dispatch(BackSubstitute { symbolic, factor: self, x, buffer: &mut buffer, stride });
    }

    /// The column-major block of a supernode.
    #[inline(always)]
    pub(super) fn block(&self, supernode: &Supernode) -> &[f64] {
        &self.values[supernode.start..supernode.start + supernode.width() * supernode.height()]
    }
}

// The loops below are compiled once per instruction set (`pulp` calls them inside a function with the features
// enabled); a closure would be compiled without the features.

struct Eliminate<'a> {
    symbolic: &'a Symbolic,
    values: &'a [f64],
    factor: &'a mut Factor,
    workspace: &'a mut Workspace,
}

impl WithSimd for Eliminate<'_> {
    type Output = Result<(), NotPositiveDefinite>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        self.symbolic.eliminate_all(simd, self.values, self.factor, self.workspace)
    }
}

struct ForwardSubstitute<'a> {
    symbolic: &'a Symbolic,
    factor: &'a Factor,
    x: &'a mut Matrix,
    buffer: &'a mut [f64],
    stride: usize,
}

impl WithSimd for ForwardSubstitute<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        // For right-hand sides with few entries, most of the tree stays zero.
        let mut reached = vec![false; self.symbolic.supernodes.len()];
        for (index, supernode) in self.symbolic.supernodes.iter().enumerate() {
            let children = &self.symbolic.children[supernode.children.clone()];
            let own = &self.symbolic.order[supernode.columns.clone()];
            reached[index] = children.iter().any(|&child| reached[child])
                || own.iter().any(|&unknown| self.x.row(unknown).iter().any(|value| *value != 0.0));
            if !reached[index] {
                continue;
            }
            gather(self.symbolic, supernode, self.x, self.buffer, self.stride);
            forward_block(self.factor.block(supernode), supernode, self.buffer, self.stride);
            scatter(self.symbolic, supernode, supernode.height(), self.x, self.buffer, self.stride);
        }
    }
}

struct BackSubstitute<'a> {
    symbolic: &'a Symbolic,
    factor: &'a Factor,
    x: &'a mut Matrix,
    buffer: &'a mut [f64],
    stride: usize,
}

impl WithSimd for BackSubstitute<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for supernode in self.symbolic.supernodes.iter().rev() {
            gather(self.symbolic, supernode, self.x, self.buffer, self.stride);
            backward_block(self.factor.block(supernode), supernode, self.buffer, self.stride);
            scatter(self.symbolic, supernode, supernode.width(), self.x, self.buffer, self.stride);
        }
    }
}

/// Solves a supernode's rows and subtracts their contribution from the rows below.
#[inline(always)]
fn forward_block(block: &[f64], supernode: &Supernode, buffer: &mut [f64], stride: usize) {
    let height = supernode.height();
    for pivot in 0..supernode.width() {
        let column = &block[pivot * height..(pivot + 1) * height];
        let (head, tail) = buffer.split_at_mut((pivot + 1) * stride);
        let solved = &mut head[pivot * stride..];
        scale_row(solved, 1.0 / column[pivot]);
        for (&factor, target) in column[pivot + 1..].iter().zip(tail.chunks_exact_mut(stride)) {
            subtract_row(target, factor, solved);
        }
    }
}

/// Subtracts the contribution of the rows below from a supernode's rows, and solves them.
#[inline(always)]
fn backward_block(block: &[f64], supernode: &Supernode, buffer: &mut [f64], stride: usize) {
    let height = supernode.height();
    for pivot in (0..supernode.width()).rev() {
        let column = &block[pivot * height..(pivot + 1) * height];
        let (head, tail) = buffer.split_at_mut((pivot + 1) * stride);
        let solved = &mut head[pivot * stride..];
        let wide = stride - stride % (4 * LANES);
        for first in (0..wide).step_by(4 * LANES) {
            subtract_rows::<{ 4 * LANES }>(solved, &column[pivot + 1..], tail, first, stride);
        }
        for first in (wide..stride).step_by(LANES) {
            subtract_rows::<LANES>(solved, &column[pivot + 1..], tail, first, stride);
        }
        scale_row(solved, 1.0 / column[pivot]);
    }
}

/// Subtracts multiples of many rows from `COUNT` columns of one row, which stay in registers meanwhile.
#[inline(always)]
fn subtract_rows<const COUNT: usize>(solved: &mut [f64], factors: &[f64], rows: &[f64], first: usize, stride: usize) {
    let Some(target) = solved[first..].first_chunk_mut::<COUNT>() else { return };
    let mut sum = *target;
    for (&factor, row) in factors.iter().zip(rows.chunks_exact(stride)) {
        let Some(known) = row[first..].first_chunk::<COUNT>() else { return };
        for lane in 0..COUNT {
            sum[lane] -= factor * known[lane];
        }
    }
    *target = sum;
}

/// Copies a front's rows of `x` into `buffer`, whose rows are `stride` apart.
#[inline(always)]
fn gather(symbolic: &Symbolic, supernode: &Supernode, x: &Matrix, buffer: &mut [f64], stride: usize) {
    let rows = supernode.columns.clone().chain(symbolic.rows[supernode.rows.clone()].iter().copied());
    for (target, row) in buffer.chunks_exact_mut(stride).zip(rows) {
        target[..x.columns].copy_from_slice(x.row(symbolic.order[row]));
    }
}

/// Copies the first `count` rows of a front back into `x`.
#[inline(always)]
fn scatter(symbolic: &Symbolic, supernode: &Supernode, count: usize, x: &mut Matrix, buffer: &[f64], stride: usize) {
    let rows = supernode.columns.clone().chain(symbolic.rows[supernode.rows.clone()].iter().copied());
    for (source, row) in buffer.chunks_exact(stride).zip(rows).take(count) {
        let columns = x.columns;
        x.row_mut(symbolic.order[row]).copy_from_slice(&source[..columns]);
    }
}

#[inline(always)]
fn subtract_row(target: &mut [f64], factor: f64, source: &[f64]) {
    for (target, source) in target.as_chunks_mut::<LANES>().0.iter_mut().zip(source.as_chunks::<LANES>().0) {
        for lane in 0..LANES {
            target[lane] -= factor * source[lane];
        }
    }
}

#[inline(always)]
fn scale_row(row: &mut [f64], factor: f64) {
    for value in row {
        *value *= factor;
    }
}
