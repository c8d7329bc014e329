//! Forward substitution of right-hand sides with few entries.
//!
//! `L^-1 b` is nonzero only on the way from the entries of `b` up to the root of the elimination tree (Gilbert and
//! Peierls, 1988, DOI 10.1137/0909058).

use super::factor::Factor;
use super::matrix::Matrix;
use super::symbolic::{NONE, Symbolic};
use super::tile::{ROWS, Rows, column_tiles, load, store, subtract_product};
use pulp::Simd;
use std::ops::Range;

/// Right-hand sides that are zero except in some rows.
#[derive(Debug, Clone)]
pub(crate) struct SparseColumns {
    /// The unknowns of the rows, each once.
    pub unknowns: Vec<usize>,
    /// Their values, unknowns x columns.
    pub values: Matrix,
}

/// The supernodes that right-hand sides reach, in the order of elimination.
#[derive(Debug, Default)]
pub(super) struct Path {
    /// Rows of the right-hand sides in the order of elimination.
    order: Vec<usize>,
    pub steps: Vec<Step>,
    /// Columns eliminated by all steps together.
    height: usize,
    /// The largest number of rows below that wait for their parents.
    waiting_max: usize,
}

/// One supernode of a path.
#[derive(Debug)]
pub(super) struct Step {
    pub supernode: usize,
    /// Index of the parent's step; `NONE` at a root.
    parent: usize,
    /// Its columns among those of all steps.
    pub columns: Range<usize>,
    /// Its rows of the right-hand sides, as a range of [`Path::order`].
    own: Range<usize>,
}

impl Path {
    fn new(symbolic: &Symbolic, unknowns: &[usize]) -> Self {
        let interior = symbolic.unknown_count() - symbolic.kept_count();
        let position = |row: usize| symbolic.position[unknowns[row]];
        let mut order: Vec<usize> = (0..unknowns.len()).collect();
        order.sort_unstable_by_key(|&row| position(row));
        let mut supernodes: Vec<usize> = Vec::new();
        for place in order.iter().map(|&row| position(row)).filter(|&place| place < interior) {
            let mut at = symbolic.supernode_of[place];
            while at != NONE && !supernodes.contains(&at) {
                supernodes.push(at);
                at = symbolic.parent_of[at];
            }
        }
        supernodes.sort_unstable();
        let mut path = Path { order, steps: Vec::with_capacity(supernodes.len()), height: 0, waiting_max: 0 };
        let (mut next, mut waiting) = (0, 0);
        for &supernode in &supernodes {
            let columns = symbolic.supernodes[supernode].columns.clone();
            let end = next + path.order[next..].iter().take_while(|&&row| position(row) < columns.end).count();
            let parent = supernodes.binary_search(&symbolic.parent_of[supernode]).unwrap_or(NONE);
            let height = path.height + columns.len();
            path.steps.push(Step { supernode, parent, columns: path.height..height, own: next..end });
            (path.height, next) = (height, end);
            let below = |child: &usize| symbolic.supernodes[*child].rows.len();
            let reached = |child: &&usize| supernodes.binary_search(child).is_ok();
            let children = &symbolic.children[symbolic.supernodes[supernode].children.clone()];
            waiting += below(&supernode);
            path.waiting_max = path.waiting_max.max(waiting);
            waiting -= children.iter().filter(reached).map(below).sum::<usize>();
        }
        path
    }
}

/// `X = L^-1 b` on the eliminated unknowns, and the contribution to the kept ones.
#[derive(Debug, Default)]
pub(super) struct Substituted {
    pub path: Path,
    /// `X`, the columns of the path x right-hand sides.
    pub eliminated: Rows,
    /// `b_k - A_ki A_ii^-1 b_i`, kept unknowns x right-hand sides.
    pub kept: Rows,
}

impl Substituted {
    #[inline(always)]
    pub(super) fn compute<S: Simd>(
        &mut self,
        simd: S,
        symbolic: &Symbolic,
        factor: &Factor,
        right: &SparseColumns,
        [front, stack]: &mut [Rows; 2],
    ) {
        self.path = Path::new(symbolic, &right.unknowns);
        let Substituted { path, eliminated, kept } = self;
        let columns = right.values.columns;
        eliminated.resize(path.height, columns);
        kept.resize(symbolic.kept_count(), columns);
        kept.values.values_mut().fill(0.0);
        front.resize(symbolic.front_max, columns);
        stack.resize(path.waiting_max, columns);
        let stride = kept.stride;
        let (mut top, mut waiting) = (0, Vec::new());
        for (index, step) in path.steps.iter().enumerate() {
            let supernode = &symbolic.supernodes[step.supernode];
            let (count, height) = (supernode.width(), supernode.height());
            let front = &mut front.values.values_mut()[..height * stride];
            front.fill(0.0);
            for &row in &path.order[step.own.clone()] {
                let local = symbolic.position[right.unknowns[row]] - supernode.columns.start;
                add(&mut front[local * stride..], right.values.row(row));
            }
            while let Some(child) = waiting.pop_if(|&mut child: &mut usize| path.steps[child].parent == index) {
                top -= add_below(symbolic, &path.steps[child], &stack.values.values()[..top], front, stride);
            }
            solve_front(simd, factor.block(supernode), [count, height], front, stride);
            let (solved, below) = front.split_at(count * stride);
            eliminated.values.values_mut()[step.columns.start * stride..][..solved.len()].copy_from_slice(solved);
            stack.values.values_mut()[top..top + below.len()].copy_from_slice(below);
            top += below.len();
            waiting.push(index);
        }
        while let Some(root) = waiting.pop() {
            top -=
                add_below(symbolic, &path.steps[root], &stack.values.values()[..top], kept.values.values_mut(), stride);
        }
        let interior = symbolic.unknown_count() - symbolic.kept_count();
        for &row in path.order.iter().rev() {
            let Some(local) = symbolic.position[right.unknowns[row]].checked_sub(interior) else { break };
            add(kept.row_mut(local), right.values.row(row));
        }
    }
}

#[inline(always)]
fn add(target: &mut [f64], source: &[f64]) {
    target.iter_mut().zip(source).for_each(|(target, value)| *target += value);
}

/// Adds the rows on top of the stack, those below a child, to its parent's front; returns their size.
#[inline(always)]
fn add_below(symbolic: &Symbolic, child: &Step, stack: &[f64], front: &mut [f64], stride: usize) -> usize {
    let places = &symbolic.row_in_parent[symbolic.supernodes[child.supernode].row_in_parent.clone()];
    let size = places.len() * stride;
    for (&place, source) in places.iter().zip(stack[stack.len() - size..].chunks_exact(stride)) {
        add(&mut front[place * stride..], source);
    }
    size
}

/// Solves the rows of a front that its supernode eliminates, and subtracts their contribution from those below.
#[inline(always)]
fn solve_front<S: Simd>(simd: S, block: &[f64], [count, height]: [usize; 2], front: &mut [f64], stride: usize) {
    let (front, stride) = (S::as_mut_simd_f64s(front).0, stride / S::F64_LANES);
    column_tiles!(0, stride, |at, N| {
        let mut row = 0;
        while row + ROWS <= height {
            solve_rows::<S, ROWS, N>(simd, block, [count, height], front, [stride, at], row);
            row += ROWS;
        }
        while row < height {
            solve_rows::<S, 1, N>(simd, block, [count, height], front, [stride, at], row);
            row += 1;
        }
    });
}

/// Some rows of a front, after those before.
#[inline(always)]
fn solve_rows<S: Simd, const R: usize, const N: usize>(
    simd: S,
    block: &[f64],
    [count, height]: [usize; 2],
    front: &mut [S::f64s],
    [stride, at]: [usize; 2],
    row: usize,
) {
    let (above, own) = front.split_at_mut(row * stride);
    let own = &mut own[at..];
    let sums = load::<S, R, N>(simd, own, stride);
    let before = if row > 0 { &above[at..] } else { &[] };
    let mut sums = subtract_product(simd, sums, (&block[row..], height), (before, stride), row.min(count));
    for pivot in 0..R {
        if row + pivot >= count {
            break;
        }
        let column = &block[(row + pivot) * height + row..][..R];
        let inverse = simd.splat_f64s(1.0 / column[pivot]);
        for value in &mut sums[pivot] {
            *value = simd.mul_f64s(*value, inverse);
        }
        let solved = sums[pivot];
        for later in pivot + 1..R {
            let factor = simd.splat_f64s(column[later]);
            for (target, &value) in sums[later].iter_mut().zip(&solved) {
                *target = simd.negate_mul_add_e_f64s(factor, value, *target);
            }
        }
    }
    store(&sums, own, stride);
}
