//! The derivative of a function of the Schur complements with respect to all entries, in reverse order of elimination.
//!
//! A front with the blocks `A` (eliminated columns), `B` (rows below) and `C` has the update `U = C - B A^-1 B'`. With
//! `W = B A^-1` its differential is `dU = dC - dB W' - W dB' + W dA W'`. A function whose derivative with respect to `U`
//! is the symmetric matrix `G`, so that it changes by `trace(G dU)`, thus has the derivatives `G`, `-G W` and `W' G W`
//! with respect to `C`, `B` and `A`: of the fronts, the entries and the updates of the children are parts.
//!
//! Derivatives have the addresses of the values that they belong to. Off-diagonal values stand for two entries of a
//! symmetric matrix: their derivatives are stored once and doubled at the end.

use super::front::{source_and_target, subtract_product};
use super::plan::{BatchPlan, Child, Front, RowAddress, TILE, update_column};
use pulp::Simd;

/// Scratch memory of the reverse pass, in vectors of numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scratch {
    /// Derivatives of a panel.
    pub panel: usize,
    /// The derivative of an update, all rows and columns.
    pub square: usize,
    /// `W`, or `-G W`, transposed.
    pub across: usize,
}

impl Scratch {
    pub(super) fn of(plan: &BatchPlan) -> Self {
        let most = |size: &dyn Fn(&Front) -> usize| plan.fronts.iter().map(size).max().unwrap_or(0);
        Scratch {
            panel: plan.panel_size,
            square: most(&|front| front.rows.next_multiple_of(TILE) * front.rows),
            across: most(&|front| front.width.next_multiple_of(TILE) * front.rows),
        }
    }

    pub(super) fn size(self) -> usize {
        self.panel + self.square + 2 * self.across
    }
}

/// The derivatives with respect to the entries, from the kept panels and the derivative of the Schur complement, which
/// is in its place in `updates`. They are handed to `found` with their position.
#[inline(always)]
pub(super) fn differentiate_all<S: Simd>(
    simd: S,
    plan: &BatchPlan,
    panels: &[S::f64s],
    updates: &mut [S::f64s],
    scratch: &mut [S::f64s],
    mut found: impl FnMut(usize, S::f64s),
) {
    let sizes = Scratch::of(plan);
    let (derivative, rest) = scratch.split_at_mut(sizes.panel);
    let (square, rest) = rest.split_at_mut(sizes.square);
    let (across, derivative_across) = rest.split_at_mut(sizes.across);
    for front in plan.fronts.iter().rev() {
        let derivative = &mut derivative[..front.panel_size()];
        if front.width > 0 {
            let panel = &panels[front.panel..][..front.panel_size()];
            let size = front.width.next_multiple_of(TILE) * front.rows;
            let across = &mut across[..size];
            divide(simd, front, panel, derivative, across);
            unpack(simd, front, &updates[front.update..][..front.update_size()], square);
            differentiate(simd, front, square, across, &mut derivative_across[..size], derivative);
        }
        let values = if front.width > 0 { &*derivative } else { &updates[front.update..][..front.update_size()] };
        for (position, &at) in front.entries.clone().zip(&plan.entry_targets[front.entries.clone()]) {
            found(position, values[at as usize]);
        }
        for child in &plan.children[front.children.clone()] {
            take(child, &plan.rows[child.rows.clone()], front, derivative, updates);
        }
    }
}

/// `W = B A^-1` from the factored panel (`A = L L'`, `B L^-T` below it): `W L = B L^-T`, solved from the last column.
/// `across` is `W` transposed: for every four columns, their values row by row. `quotient` is scratch memory of a panel.
#[inline(always)]
fn divide<S: Simd>(simd: S, front: &Front, panel: &[S::f64s], quotient: &mut [S::f64s], across: &mut [S::f64s]) {
    let (width, rows, stride) = (front.width, front.rows, TILE * front.width);
    let start = width.div_ceil(TILE) * stride;
    let (head, below) = panel.split_at(start);
    let factor = |row: usize, column: usize| head[row / TILE * stride + column * TILE + row % TILE];
    let last = width / TILE * rows * TILE;
    across[last..].fill(simd.splat_f64s(0.0));
    let (inverses, quotient) = quotient.split_at_mut(start);
    for (column, inverse) in inverses[..width].iter_mut().enumerate() {
        *inverse = simd.div_f64s(simd.splat_f64s(1.0), factor(column, column));
    }
    for (tile, (row, quotient)) in below.chunks_exact(stride).zip(quotient.chunks_exact_mut(stride)).enumerate() {
        let quotient = quotient.as_chunks_mut::<TILE>().0;
        let row = row.as_chunks::<TILE>().0;
        let count = TILE.min(rows - tile * TILE);
        for column in (0..width).rev() {
            let (own, later) = quotient.split_at_mut(column + 1);
            let mut sums = row[column];
            for (values, later) in later.iter().zip(column + 1..) {
                let factor = factor(later, column);
                for (sum, &value) in sums.iter_mut().zip(values) {
                    *sum = simd.negate_mul_add_e_f64s(value, factor, *sum);
                }
            }
            own[column] = sums.map(|sum| simd.mul_f64s(sum, inverses[column]));
            let place = (column / TILE * rows + tile * TILE) * TILE + column % TILE;
            for (offset, &value) in own[column][..count].iter().enumerate() {
                across[place + offset * TILE] = value;
            }
        }
    }
}

/// A symmetric matrix from its lower triangle: for every four rows, their values column by column.
#[inline(always)]
fn unpack<S: Simd>(simd: S, front: &Front, lower: &[S::f64s], square: &mut [S::f64s]) {
    let rows = front.rows;
    if !rows.is_multiple_of(TILE) {
        let last = rows / TILE * rows * TILE;
        square[last..last + rows * TILE].fill(simd.splat_f64s(0.0));
    }
    for column in 0..rows {
        let source = &lower[update_column(column, rows) + column..][..rows - column];
        for (&value, row) in source.iter().zip(column..) {
            square[(row / TILE * rows + column) * TILE + row % TILE] = value;
            square[(column / TILE * rows + row) * TILE + column % TILE] = value;
        }
    }
}

/// The derivatives of a front's panel: `-G W` below, `W' G W` above.
#[inline(always)]
fn differentiate<S: Simd>(
    simd: S,
    front: &Front,
    square: &[S::f64s],
    across: &[S::f64s],
    derivative_across: &mut [S::f64s],
    derivative: &mut [S::f64s],
) {
    let (rows, stride, tile_size) = (front.rows, TILE * front.width, TILE * front.rows);
    let (head, below) = derivative.split_at_mut(front.width.div_ceil(TILE) * stride);
    let zero = [[simd.splat_f64s(0.0); TILE]; TILE];
    for (tile, target) in below.chunks_exact_mut(stride).enumerate() {
        let a = square[tile * tile_size..][..tile_size].as_chunks::<TILE>().0;
        for (group, target) in target.chunks_mut(TILE * TILE).enumerate() {
            let mut sums = zero;
            subtract_product(simd, &mut sums, a, across[group * tile_size..][..tile_size].as_chunks::<TILE>().0);
            for (values, target) in sums.iter().zip(target.chunks_exact_mut(TILE)) {
                target.copy_from_slice(values);
            }
            for offset in 0..TILE.min(rows - tile * TILE) {
                let at = group * tile_size + (tile * TILE + offset) * TILE;
                for (column, values) in sums.iter().enumerate() {
                    derivative_across[at + column] = values[offset];
                }
            }
        }
    }
    for (tile, target) in head.chunks_exact_mut(stride).enumerate() {
        let a = across[tile * tile_size..][..tile_size].as_chunks::<TILE>().0;
        for (group, target) in target.chunks_mut(TILE * TILE).take(tile + 1).enumerate() {
            let mut sums = zero;
            let b = derivative_across[group * tile_size..][..tile_size].as_chunks::<TILE>().0;
            subtract_product(simd, &mut sums, a, b);
            for (values, target) in sums.iter().zip(target.chunks_exact_mut(TILE)) {
                target.copy_from_slice(values);
            }
        }
    }
}

/// Copies the derivative of a child's update from its parent's.
#[inline(always)]
fn take<T: Copy>(child: &Child, rows: &[RowAddress], front: &Front, panel: &[T], updates: &mut [T]) {
    let size = rows.len() * (rows.len() + 1) / 2;
    let (own, target) = source_and_target(updates, front.update, child.update, size);
    let mut target = target.iter_mut();
    for (column, address) in rows.iter().enumerate() {
        let is_eliminated = column < child.eliminated;
        let source = if is_eliminated { panel } else { own };
        for row in &rows[column..] {
            let at = address.column + if is_eliminated { row.panel } else { row.update };
            if let Some(target) = target.next() {
                *target = source[at as usize];
            }
        }
    }
}
