//! The Schur complement of a factored matrix after additions of low rank.
//!
//! Let `A_ii = L L'` be the eliminated part of the matrix and `U U'` the addition. With `X = L^-1 U_i` and
//! `Q = U_k - A_ki A_ii^-1 U_i` the Schur complement of the kept unknowns increases by `Q (1 + X' X)^-1 Q'` (Woodbury,
//! 1950; Hager, 1989, DOI 10.1137/1031049).

use super::factor::{Factor, NotPositiveDefinite};
use super::matrix::Matrix;
use super::substitution::{Path, SparseColumns, Substituted};
use super::symbolic::Symbolic;
use super::tile::{ROWS, Rows, column_tiles, load, store, subtract_product};
use pulp::{Simd, WithSimd};

impl Factor {
    /// The Schur complement of the kept unknowns after the additions `U U'`: additions at different places apart, so
    /// that each is substituted along its own path up the elimination tree. Columns of `U` that begin in the order of
    /// elimination take less time.
    ///
    /// # Errors
    /// Additions that are not finite.
    pub(crate) fn schur_with(
        &self,
        symbolic: &Symbolic,
        additions: &[SparseColumns],
        memory: &mut UpdateMemory,
    ) -> Result<Matrix, NotPositiveDefinite> {
        let mut schur = self.schur().clone();
        if additions.is_empty() {
            return Ok(schur);
        }
        pulp::Arch::new().dispatch(Update { symbolic, factor: self, additions, memory, schur: &mut schur })?;
        Ok(schur)
    }
}

/// Work memory of [`Factor::schur_with`].
#[derive(Debug, Default)]
pub(crate) struct UpdateMemory {
    row_of_place: Vec<usize>,
    parts: Vec<Substituted>,
    system: Rows,
    rise: Rows,
}

struct Update<'a> {
    symbolic: &'a Symbolic,
    factor: &'a Factor,
    additions: &'a [SparseColumns],
    memory: &'a mut UpdateMemory,
    schur: &'a mut Matrix,
}

impl WithSimd for Update<'_> {
    type Output = Result<(), NotPositiveDefinite>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Update { symbolic, factor, additions, memory, schur } = self;
        let UpdateMemory { row_of_place, parts, system, rise } = memory;
        if parts.len() < additions.len() {
            parts.resize_with(additions.len(), Substituted::default);
        }
        // Not in a closure, which would be compiled without the instruction set.
        for (part, right) in parts.iter_mut().zip(additions) {
            part.compute(simd, symbolic, factor, right, row_of_place);
        }
        let mut system = System::new(simd, &parts[..additions.len()], symbolic.kept_count(), system);
        system.factor(simd)?;
        system.add_rise(simd, rise, schur);
        Ok(())
    }
}

/// `[1 + X' X, Q']`, later `R` with `R' R = 1 + X' X` and `R^-T Q'`; the upper triangle.
struct System<'a> {
    /// Columns of all additions, each filled up to whole vectors.
    order: usize,
    rows: &'a mut Rows,
}

impl<'a> System<'a> {
    #[inline(always)]
    fn new<S: Simd>(simd: S, parts: &[Substituted], kept_count: usize, rows: &'a mut Rows) -> Self {
        let order = parts.iter().map(|part| part.width).sum();
        rows.resize(order, order + kept_count);
        let mut system = System { order, rows };
        let mut column = 0;
        for (index, part) in parts.iter().enumerate() {
            let mut row = 0;
            for other in &parts[..=index] {
                system.add_gram(simd, [other, part], [row, column]);
                row += other.width;
            }
            let width = part.width;
            for (kept, values) in part.kept().chunks_exact(part.solution.stride).enumerate() {
                for (offset, &value) in values[..width].iter().enumerate() {
                    system.rows.row_mut(column + offset)[order + kept] = value;
                }
            }
            (column..column + width).for_each(|k| system.rows.row_mut(k)[k] += 1.0);
            column += width;
        }
        system
    }

    /// The products of two parts, in their place.
    #[inline(always)]
    fn add_gram<S: Simd>(&mut self, simd: S, [left, right]: [&Substituted; 2], [row, column]: [usize; 2]) {
        let runs = shared(&left.path, &right.path);
        let stride = self.rows.stride / S::F64_LANES;
        let target = S::as_mut_simd_f64s(self.rows.values.values_mut()).0;
        let (a, a_stride) = (left.solution.values.values(), left.solution.stride);
        let b = S::as_simd_f64s(right.solution.values.values()).0;
        let b_stride = right.solution.stride / S::F64_LANES;
        for offset in (0..left.width).step_by(ROWS) {
            // Of a symmetric block the upper triangle.
            let first = if row == column { offset / S::F64_LANES } else { 0 };
            column_tiles!(first, right.width / S::F64_LANES, |at, N| {
                let mut sums = [[simd.splat_f64s(0.0); N]; ROWS];
                let zeros = [left.starts[offset], right.starts[at * S::F64_LANES]];
                for &[a_row, b_row, count] in &runs {
                    let skipped = zeros[0].saturating_sub(a_row).max(zeros[1].saturating_sub(b_row));
                    let Some(count) = count.checked_sub(skipped).filter(|&count| count > 0) else { continue };
                    let a = (&a[(a_row + skipped) * a_stride + offset..], a_stride);
                    let b = (&b[(b_row + skipped) * b_stride + at..], b_stride);
                    sums = subtract_product(simd, sums, a, b, count);
                }
                let sums = sums.map(|sums| sums.map(|sum| simd.neg_f64s(sum)));
                store(&sums, &mut target[(row + offset) * stride + column / S::F64_LANES + at..], stride);
            });
        }
    }

    /// The factor in place, four rows at a time.
    #[inline(always)]
    fn factor<S: Simd>(&mut self, simd: S) -> Result<(), NotPositiveDefinite> {
        let stride = self.rows.stride;
        let vectors = stride / S::F64_LANES;
        for row in (0..self.order).step_by(ROWS) {
            let (done, own) = self.rows.values.values_mut().split_at_mut(row * stride);
            let own = &mut own[..ROWS * stride];
            let first = row / S::F64_LANES;
            if row > 0 {
                let (b, target) = (S::as_simd_f64s(done).0, S::as_mut_simd_f64s(own).0);
                column_tiles!(first, vectors, |at, N| {
                    let sums = load::<S, ROWS, N>(simd, &target[at..], vectors);
                    let sums = subtract_product(simd, sums, (&done[row..], stride), (&b[at..], vectors), row);
                    store(&sums, &mut target[at..], vectors);
                });
            }
            eliminate_rows(own, stride, row)?;
        }
        Ok(())
    }

    /// Adds `Q (1 + X' X)^-1 Q'`.
    #[inline(always)]
    fn add_rise<S: Simd>(&self, simd: S, rise: &mut Rows, schur: &mut Matrix) {
        let (values, stride) = (self.rows.values.values(), self.rows.stride);
        let b = S::as_simd_f64s(values).0;
        let (first, vectors) = (self.order / S::F64_LANES, stride / S::F64_LANES);
        let count = schur.rows;
        rise.resize(count.next_multiple_of(ROWS), stride - self.order);
        let (rise_stride, width) = (rise.stride, rise.stride / S::F64_LANES);
        for row in (0..count).step_by(ROWS) {
            let target = S::as_mut_simd_f64s(rise.values.values_mut()).0;
            column_tiles!(first, vectors, |at, N| {
                let sums = [[simd.splat_f64s(0.0); N]; ROWS];
                let a = (&values[self.order + row..], stride);
                let sums = subtract_product(simd, sums, a, (&b[at..], vectors), self.order);
                store(&sums, &mut target[row * width + at - first..], width);
            });
        }
        for (row, minus) in (0..count).zip(rise.values.values().chunks_exact(rise_stride)) {
            schur.row_mut(row).iter_mut().zip(minus).for_each(|(value, minus)| *value -= minus);
        }
    }
}

/// Eliminates four rows among themselves, from their diagonal on.
#[inline(always)]
fn eliminate_rows(rows: &mut [f64], stride: usize, first: usize) -> Result<(), NotPositiveDefinite> {
    for pivot in 0..ROWS {
        let (head, later) = rows.split_at_mut((pivot + 1) * stride);
        let own = &mut head[pivot * stride + first..];
        let diagonal = own[pivot];
        if diagonal.is_nan() || diagonal <= 0.0 {
            return Err(NotPositiveDefinite { unknown: first + pivot });
        }
        let inverse = 1.0 / diagonal.sqrt();
        own.iter_mut().for_each(|value| *value *= inverse);
        for (offset, row) in later.chunks_exact_mut(stride).enumerate() {
            let factor = own[pivot + 1 + offset];
            row[first..].iter_mut().zip(&*own).for_each(|(value, above)| *value -= factor * above);
        }
    }
    Ok(())
}

/// The columns that two paths share, as runs: the first of each in either path, and their number.
fn shared(left: &Path, right: &Path) -> Vec<[usize; 3]> {
    let mut runs: Vec<[usize; 3]> = Vec::new();
    let mut others = right.steps.iter().peekable();
    for step in &left.steps {
        while others.next_if(|other| other.supernode < step.supernode).is_some() {}
        let Some(other) = others.next_if(|other| other.supernode == step.supernode) else { continue };
        let (from, to) = (step.columns.start, other.columns.start);
        match runs.last_mut() {
            Some([a, b, count]) if *a + *count == from && *b + *count == to => *count += step.columns.len(),
            _ => runs.push([from, to, step.columns.len()]),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::Cholesky;

    /// The matrix of a square grid of resistors with grounded nodes, the last unknowns kept.
    fn grid(side: usize) -> (Vec<[usize; 2]>, Vec<f64>) {
        let (mut entries, mut values) = (Vec::new(), Vec::new());
        for node in 0..side * side {
            entries.push([node, node]);
            values.push(4.1 + 0.01 * node as f64);
            let (row, column) = (node / side, node % side);
            if column + 1 < side {
                entries.push([node + 1, node]);
                values.push(-1.0);
            }
            if row + 1 < side {
                entries.push([node + side, node]);
                values.push(-0.9);
            }
        }
        (entries, values)
    }

    /// The Schur complement of the last unknowns of a dense matrix, by its inverse's block.
    fn dense_schur(matrix: &Matrix, kept: usize) -> Matrix {
        let inverse = Cholesky::new(matrix).unwrap().inverse();
        let first = matrix.rows - kept;
        let mut block = Matrix::zeros(kept, kept);
        for (row, column) in (0..kept).flat_map(|row| (0..kept).map(move |column| (row, column))) {
            *block.at_mut(row, column) = inverse.at(first + row, first + column);
        }
        Cholesky::new(&block).unwrap().inverse()
    }

    #[test]
    fn the_schur_complement_with_additions_is_that_of_the_whole_matrix() {
        let (side, kept) = (15, 6);
        let (entries, values) = grid(side);
        let symbolic = Symbolic::new(side * side, kept, &entries);
        let factor = symbolic.factor(&values).unwrap();
        let column = |unknown: usize, k: usize| ((unknown * 7 + k * 13) as f64).sin();
        let addition = |unknowns: Vec<usize>, rank: usize| {
            let mut values = Matrix::zeros(unknowns.len(), rank);
            for (row, &unknown) in unknowns.iter().enumerate() {
                (0..rank).for_each(|k| *values.at_mut(row, k) = column(unknown, k));
            }
            SparseColumns { unknowns, values }
        };
        // Two that share little of the tree, one of them wider than a tile, and one with kept unknowns.
        let additions = [
            addition(vec![40, 17, 16, 32, 31, 33], 3),
            addition((150..185).collect(), 29),
            addition(vec![223, 0, 220, 224], 2),
        ];
        let mut matrix = Matrix::zeros(side * side, side * side);
        for (&[i, j], value) in entries.iter().zip(&values) {
            *matrix.at_mut(i, j) = *value;
            *matrix.at_mut(j, i) = *value;
        }
        for SparseColumns { unknowns, values } in &additions {
            for (a, &i) in unknowns.iter().enumerate() {
                for (b, &j) in unknowns.iter().enumerate() {
                    let products = values.row(a).iter().zip(values.row(b)).map(|(x, y)| x * y);
                    *matrix.at_mut(i, j) += products.sum::<f64>();
                }
            }
        }
        // Memory that was used for something else.
        let mut memory = UpdateMemory::default();
        factor.schur_with(&symbolic, &additions[1..], &mut memory).unwrap();
        let got = factor.schur_with(&symbolic, &additions, &mut memory).unwrap();
        let expected = dense_schur(&matrix, kept);
        let largest = expected.values.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
        let off = got.values.iter().zip(&expected.values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let without = got.values.iter().zip(&factor.schur().values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        println!("off by {:.1e} of {largest}; the additions change it by {without}", off / largest);
        assert!(off < 1e-12 * largest && without > 1e-3 * largest);
        let none = factor.schur_with(&symbolic, &[], &mut memory).unwrap();
        assert_eq!(none, *factor.schur());
        let bad = addition(vec![3], 1);
        let bad = SparseColumns { values: Matrix { values: vec![f64::NAN], ..bad.values }, ..bad };
        assert!(factor.schur_with(&symbolic, &[bad], &mut memory).is_err());
    }
}
