//! The arithmetic of one front: eight matrices simultaneously, sixteen sums in registers.

use super::Entries;
use super::plan::{BatchPlan, Child, Front, RowAddress, TILE, update_column};
use pulp::Simd;

/// Eliminates all fronts; the Schur complement is the last front's update. Returns the smallest pivot of each matrix;
/// if one is not positive, the other results of its lane are undefined.
///
/// The panels share the memory of the largest one, unless they are kept: `KEEP`.
#[inline(always)]
pub(super) fn eliminate_all<S: Simd, const KEEP: bool>(
    simd: S,
    plan: &BatchPlan,
    entries: &impl Entries,
    pass: usize,
    panels: &mut [S::f64s],
    updates: &mut [S::f64s],
) -> S::f64s {
    let zero = simd.splat_f64s(0.0);
    let mut least = simd.splat_f64s(f64::MAX);
    for front in &plan.fronts {
        let panel = &mut panels[if KEEP { front.panel } else { 0 }..][..front.panel_size()];
        let children = &plan.children[front.children.clone()];
        if front.width > 0 {
            panel.fill(zero);
            add_entries(simd, plan, front, entries, pass, panel);
            for child in children {
                add_to_panel(simd, child, &plan.rows[child.rows.clone()], updates, panel);
            }
            factor_panel(simd, front, panel, &mut least);
            subtract_products(simd, front, panel, &mut updates[front.update..][..front.update_size()]);
        } else {
            let update = &mut updates[front.update..][..front.update_size()];
            update.fill(zero);
            add_entries(simd, plan, front, entries, pass, update);
        }
        for child in children {
            add_to_update(simd, child, &plan.rows[child.rows.clone()], front, updates);
        }
    }
    least
}

#[inline(always)]
fn add_entries<S: Simd>(
    simd: S,
    plan: &BatchPlan,
    front: &Front,
    entries: &impl Entries,
    pass: usize,
    target: &mut [S::f64s],
) {
    for (position, &at) in front.entries.clone().zip(&plan.entry_targets[front.entries.clone()]) {
        let value = &mut target[at as usize];
        *value = simd.add_f64s(*value, entries.entry(simd, position, pass));
    }
}

/// Adds the columns of a child's update that its parent eliminates.
#[inline(always)]
fn add_to_panel<S: Simd>(simd: S, child: &Child, rows: &[RowAddress], updates: &[S::f64s], panel: &mut [S::f64s]) {
    let mut start = child.update;
    for column in 0..child.eliminated {
        let source = &updates[start..start + rows.len() - column];
        let target = &mut panel[rows[column].column as usize..];
        for (address, &value) in rows[column..].iter().zip(source) {
            let target = &mut target[address.panel as usize];
            *target = simd.add_f64s(*target, value);
        }
        start += source.len();
    }
}

/// Adds the other columns of a child's update to its parent's.
#[inline(always)]
fn add_to_update<S: Simd>(simd: S, child: &Child, rows: &[RowAddress], front: &Front, updates: &mut [S::f64s]) {
    let (update, target) = source_and_target(updates, child.update, front.update, front.update_size());
    let mut start = update_column(child.eliminated, rows.len()) + child.eliminated;
    for column in child.eliminated..rows.len() {
        let source = &update[start..start + rows.len() - column];
        let target = &mut target[rows[column].column as usize..];
        for (address, &value) in rows[column..].iter().zip(source) {
            let target = &mut target[address.update as usize];
            *target = simd.add_f64s(*target, value);
        }
        start += source.len();
    }
}

/// Two parts of one memory that do not overlap: one from `source` on, and `length` values from `target` on.
#[inline(always)]
pub(super) fn source_and_target<T>(memory: &mut [T], source: usize, target: usize, length: usize) -> (&[T], &mut [T]) {
    if source < target {
        let (low, high) = memory.split_at_mut(target);
        (&low[source..], &mut high[..length])
    } else {
        let (low, high) = memory.split_at_mut(source);
        (high, &mut low[target..target + length])
    }
}

/// Factors a panel, four columns at a time: each group applies all columns before it in one pass.
#[inline(always)]
fn factor_panel<S: Simd>(simd: S, front: &Front, panel: &mut [S::f64s], least: &mut S::f64s) {
    let stride = TILE * front.width;
    for first in (0..front.width).step_by(TILE) {
        let (head, below) = panel[first * front.width..].split_at_mut(stride);
        match front.width - first {
            1 => factor_columns::<S, 1>(simd, head, below, first, least),
            2 => factor_columns::<S, 2>(simd, head, below, first, least),
            3 => factor_columns::<S, 3>(simd, head, below, first, least),
            _ => factor_columns::<S, TILE>(simd, head, below, first, least),
        }
    }
}

/// Factors `COUNT` columns, from `first` on: `head` is the row of tiles with their pivots, `below` the rows of tiles
/// under it.
#[inline(always)]
fn factor_columns<S: Simd, const COUNT: usize>(
    simd: S,
    head: &mut [S::f64s],
    below: &mut [S::f64s],
    first: usize,
    least: &mut S::f64s,
) {
    let stride = head.len();
    let (done, own) = head.split_at_mut(first * TILE);
    let done = done.as_chunks::<TILE>().0;
    let Some(own) = own.as_chunks_mut::<TILE>().0.first_chunk_mut::<COUNT>() else { return };
    subtract_product(simd, own, done, done);
    let mut inverses = [simd.splat_f64s(0.0); COUNT];
    for column in 0..COUNT {
        let pivot = own[column][column];
        // A pivot that is no number stays: of two numbers the second is taken if one is none.
        *least = simd.min_f64s(*least, pivot);
        let root = simd.sqrt_f64s(pivot);
        inverses[column] = simd.div_f64s(simd.splat_f64s(1.0), root);
        own[column][column] = root;
        for value in &mut own[column][column + 1..] {
            *value = simd.mul_f64s(*value, inverses[column]);
        }
        for later in column + 1..COUNT {
            for row in later..TILE {
                own[later][row] = simd.negate_mul_add_e_f64s(own[column][row], own[column][later], own[later][row]);
            }
        }
    }
    for row in below.chunks_exact_mut(stride) {
        let (row_done, row_own) = row.split_at_mut(first * TILE);
        let Some(target) = row_own.as_chunks_mut::<TILE>().0.first_chunk_mut::<COUNT>() else { return };
        subtract_product(simd, target, row_done.as_chunks::<TILE>().0, done);
        for column in 0..COUNT {
            let (before, rest) = target.split_at_mut(column);
            for (before, own) in before.iter().zip(&*own) {
                for (value, before) in rest[0].iter_mut().zip(before) {
                    *value = simd.negate_mul_add_e_f64s(*before, own[column], *value);
                }
            }
            for value in &mut rest[0] {
                *value = simd.mul_f64s(*value, inverses[column]);
            }
        }
    }
}

/// `target[c][r] -= sum over k of a[k][r] b[k][c]`
#[inline(always)]
pub(super) fn subtract_product<S: Simd, const COUNT: usize>(
    simd: S,
    target: &mut [[S::f64s; TILE]; COUNT],
    a: &[[S::f64s; TILE]],
    b: &[[S::f64s; TILE]],
) {
    // Sixteen sums, four factors and one more value need 21 registers; on machines with fewer vector registers, half
    // the columns at a time avoid spills. Scalar code is vectorised by the compiler.
    let is_narrow = S::F64_LANES > 1 && S::REGISTER_COUNT < TILE * TILE + TILE + 1;
    match target.as_chunks_mut::<2>() {
        ([left, right], []) if is_narrow => {
            subtract_columns(simd, left, 0, a, b);
            subtract_columns(simd, right, 2, a, b);
        }
        _ => subtract_columns(simd, target, 0, a, b),
    }
}

/// The columns of a tile from `first` on.
#[inline(always)]
fn subtract_columns<S: Simd, const COUNT: usize>(
    simd: S,
    target: &mut [[S::f64s; TILE]; COUNT],
    first: usize,
    a: &[[S::f64s; TILE]],
    b: &[[S::f64s; TILE]],
) {
    let mut sums = *target;
    for (a, b) in a.iter().zip(b) {
        for column in 0..COUNT {
            for row in 0..TILE {
                sums[column][row] = simd.negate_mul_add_e_f64s(a[row], b[first + column], sums[column][row]);
            }
        }
    }
    *target = sums;
}

/// The update of a front: minus the products of its panel's lower rows.
#[inline(always)]
fn subtract_products<S: Simd>(simd: S, front: &Front, panel: &[S::f64s], update: &mut [S::f64s]) {
    let stride = TILE * front.width;
    let below = &panel[front.width.div_ceil(TILE) * stride..];
    for (tile, row) in below.chunks_exact(stride).enumerate() {
        let a = row.as_chunks::<TILE>().0;
        for (other, column) in below.chunks_exact(stride).take(tile + 1).enumerate() {
            let mut sums = [[simd.splat_f64s(0.0); TILE]; TILE];
            subtract_product(simd, &mut sums, a, column.as_chunks::<TILE>().0);
            store::<S>(&sums, [tile * TILE, other * TILE], front.rows, update);
        }
    }
}

/// Writes the part of a tile in the lower triangle of an update.
#[inline(always)]
fn store<S: Simd>(tile: &[[S::f64s; TILE]; TILE], [row, column]: [usize; 2], rows: usize, update: &mut [S::f64s]) {
    let whole = row + TILE <= rows && row > column;
    for (offset, values) in tile.iter().enumerate() {
        let column = column + offset;
        if whole {
            let start = update_column(column, rows) + row;
            update[start..start + TILE].copy_from_slice(values);
        } else if column < rows {
            let (from, to) = (row.max(column), (row + TILE).min(rows));
            let start = update_column(column, rows);
            update[start + from..start + to].copy_from_slice(&values[from - row..to - row]);
        }
    }
}
