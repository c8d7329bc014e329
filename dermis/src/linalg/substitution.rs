//! Forward substitution of right-hand sides with few entries.
//!
//! `L^-1 b` is nonzero only on the way from the entries of `b` up to the root of the elimination tree (Gilbert and
//! Peierls, 1988, DOI 10.1137/0909058). Columns whose first entries come in the order of elimination are zero in the steps
//! before their own first entry.

use super::batch::LANES;
use super::factor::Factor;
use super::matrix::Matrix;
use super::symbolic::{NONE, Symbolic};
use super::tile::{ROWS, Rows, column_tiles, load, store, subtract_product};
use pulp::Simd;
use std::ops::Range;

impl Symbolic {
    /// The place of an unknown in the order of elimination.
    pub(crate) fn place(&self, unknown: usize) -> usize {
        self.position[unknown]
    }
}

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
    pub steps: Vec<Step>,
    /// Columns eliminated by all steps together.
    pub height: usize,
}

/// One supernode of a path.
#[derive(Debug)]
pub(super) struct Step {
    pub supernode: usize,
    /// Its columns among those of all steps.
    pub columns: Range<usize>,
    /// The first so many right-hand sides may be nonzero here, the others are zero.
    active: usize,
}

impl Path {
    fn new(symbolic: &Symbolic, right: &SparseColumns) -> Self {
        let interior = symbolic.unknown_count() - symbolic.kept_count();
        let mut rows: Vec<(usize, usize)> = (right.unknowns.iter().enumerate())
            .map(|(row, &unknown)| (symbolic.position[unknown], row))
            .filter(|&(place, _)| place < interior)
            .collect();
        rows.sort_unstable();
        let mut supernodes: Vec<usize> = Vec::new();
        let mut reached = vec![false; symbolic.supernodes.len()];
        for &(place, _) in &rows {
            let mut at = symbolic.supernode_of[place];
            while at != NONE && !std::mem::replace(&mut reached[at], true) {
                supernodes.push(at);
                at = symbolic.parent_of[at];
            }
        }
        supernodes.sort_unstable();
        let mut path = Path { steps: Vec::with_capacity(supernodes.len()), height: 0 };
        let (mut rows, mut active) = (rows.into_iter().peekable(), 0);
        for &supernode in &supernodes {
            let columns = symbolic.supernodes[supernode].columns.clone();
            while let Some((_, row)) = rows.next_if(|(place, _)| *place < columns.end) {
                let last = right.values.row(row).iter().rposition(|value| *value != 0.0);
                active = active.max(last.map_or(0, |last| last + 1));
            }
            let height = path.height + columns.len();
            path.steps.push(Step { supernode, columns: path.height..height, active });
            path.height = height;
        }
        path
    }

    /// For each of `count` right-hand sides the first column of the path at which it may be nonzero.
    fn starts(&self, count: usize) -> Vec<usize> {
        let mut starts = Vec::with_capacity(count);
        for step in &self.steps {
            starts.resize(step.active.max(starts.len()), step.columns.start);
        }
        starts.resize(count, self.height);
        starts
    }
}

/// `X = L^-1 b` on the eliminated unknowns, and the contribution to the kept ones.
#[derive(Debug, Default)]
pub(super) struct Substituted {
    pub path: Path,
    /// `X`, the columns of the path x right-hand sides; below it `b_k - A_ki A_ii^-1 b_i`, kept unknowns x right-hand
    /// sides.
    pub solution: Rows,
    /// Right-hand sides, filled up to whole vectors of any instruction set.
    pub width: usize,
    /// The first row of `X` that is not zero, for each right-hand side.
    pub starts: Vec<usize>,
}

impl Substituted {
    /// The rows of the kept unknowns.
    #[inline(always)]
    pub(super) fn kept(&self) -> &[f64] {
        &self.solution.values.values()[self.path.height * self.solution.stride..]
    }

    /// `rows` is memory for the row of each unknown.
    #[inline(always)]
    pub(super) fn compute<S: Simd>(
        &mut self,
        simd: S,
        symbolic: &Symbolic,
        factor: &Factor,
        right: &SparseColumns,
        rows: &mut Vec<usize>,
    ) {
        self.path = Path::new(symbolic, right);
        self.width = right.values.columns.next_multiple_of(LANES);
        let Substituted { path, solution, starts, width } = self;
        solution.resize(path.height + symbolic.kept_count(), right.values.columns);
        solution.values.values_mut().fill(0.0);
        *starts = path.starts(*width);
        // The rows of the path and of the kept unknowns, by their places in the order of elimination.
        let interior = symbolic.unknown_count() - symbolic.kept_count();
        rows.resize(symbolic.unknown_count(), 0);
        for step in &path.steps {
            let columns = symbolic.supernodes[step.supernode].columns.clone();
            columns.zip(step.columns.clone()).for_each(|(place, row)| rows[place] = row);
        }
        (interior..symbolic.unknown_count()).zip(path.height..).for_each(|(place, row)| rows[place] = row);
        for (index, &unknown) in right.unknowns.iter().enumerate() {
            add(solution.row_mut(rows[symbolic.position[unknown]]), right.values.row(index));
        }
        let stride = solution.stride / S::F64_LANES;
        let values = S::as_mut_simd_f64s(solution.values.values_mut()).0;
        for step in &path.steps {
            let supernode = &symbolic.supernodes[step.supernode];
            let front = Front {
                block: factor.block(supernode),
                width: supernode.width(),
                height: supernode.height(),
                below: &symbolic.rows[supernode.rows.clone()],
                rows,
            };
            let (above, later) = values.split_at_mut(step.columns.end * stride);
            let own = &mut above[step.columns.start * stride..];
            column_tiles!(0, step.active.div_ceil(S::F64_LANES), |at, N| {
                front.solve_own::<S, N>(simd, own, stride, at);
                front.subtract_below::<S, N>(simd, own, later, [stride, at], step.columns.end);
            });
        }
    }
}

#[inline(always)]
fn add(target: &mut [f64], source: &[f64]) {
    target.iter_mut().zip(source).for_each(|(target, value)| *target += value);
}

/// A supernode with the places of its rows below, and the row of each place in the solution.
struct Front<'a> {
    block: &'a [f64],
    width: usize,
    height: usize,
    below: &'a [usize],
    rows: &'a [usize],
}

impl Front<'_> {
    /// Solves the rows that the supernode eliminates.
    #[inline(always)]
    fn solve_own<S: Simd, const N: usize>(&self, simd: S, own: &mut [S::f64s], stride: usize, at: usize) {
        let mut row = 0;
        while row + ROWS <= self.width {
            self.solve_rows::<S, ROWS, N>(simd, own, [stride, at], row);
            row += ROWS;
        }
        match self.width - row {
            3 => self.solve_rows::<S, 3, N>(simd, own, [stride, at], row),
            2 => self.solve_rows::<S, 2, N>(simd, own, [stride, at], row),
            1 => self.solve_rows::<S, 1, N>(simd, own, [stride, at], row),
            _ => {}
        }
    }

    /// Some of them, after those before.
    #[inline(always)]
    fn solve_rows<S: Simd, const R: usize, const N: usize>(
        &self,
        simd: S,
        own: &mut [S::f64s],
        [stride, at]: [usize; 2],
        row: usize,
    ) {
        let (before, rows) = own.split_at_mut(row * stride);
        let rows = &mut rows[at..];
        let sums = load::<S, R, N>(simd, rows, stride);
        let before = if row > 0 { &before[at..] } else { &[] };
        let mut sums = subtract_product(simd, sums, (&self.block[row..], self.height), (before, stride), row);
        for pivot in 0..R {
            let column = &self.block[(row + pivot) * self.height + row..][..R];
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
        store(&sums, rows, stride);
    }

    /// Subtracts their contribution from the rows below, where these are: `later` begins with the row `first`.
    #[inline(always)]
    fn subtract_below<S: Simd, const N: usize>(
        &self,
        simd: S,
        own: &[S::f64s],
        later: &mut [S::f64s],
        [stride, at]: [usize; 2],
        first: usize,
    ) {
        let starts = |place: &usize| (self.rows[*place] - first) * stride + at;
        let (fours, rest) = self.below.as_chunks::<ROWS>();
        let mut row = self.width;
        for four in fours {
            self.subtract_rows::<S, ROWS, N>(simd, &own[at..], later, stride, (row, four.each_ref().map(starts)));
            row += ROWS;
        }
        match *rest {
            [a, b, c] => {
                self.subtract_rows::<S, 3, N>(simd, &own[at..], later, stride, (row, [a, b, c].each_ref().map(starts)));
            }
            [a, b] => {
                self.subtract_rows::<S, 2, N>(simd, &own[at..], later, stride, (row, [a, b].each_ref().map(starts)));
            }
            [a] => self.subtract_rows::<S, 1, N>(simd, &own[at..], later, stride, (row, [starts(&a)])),
            _ => {}
        }
    }

    /// Some of them, from a row of the front on, which start at these places of `later`.
    #[inline(always)]
    fn subtract_rows<S: Simd, const R: usize, const N: usize>(
        &self,
        simd: S,
        own: &[S::f64s],
        later: &mut [S::f64s],
        stride: usize,
        (row, starts): (usize, [usize; R]),
    ) {
        let mut sums = [[simd.splat_f64s(0.0); N]; R];
        for (sums, &start) in sums.iter_mut().zip(&starts) {
            sums.copy_from_slice(&later[start..start + N]);
        }
        let sums = subtract_product(simd, sums, (&self.block[row..], self.height), (own, stride), self.width);
        for (sums, &start) in sums.iter().zip(&starts) {
            later[start..start + N].copy_from_slice(sums);
        }
    }
}
