//! Products of row-major matrices.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use pulp::{Simd, WithSimd};

/// Threads for a product: those of the caller's thread pool, where networks are trained.
fn threads() -> Par {
    #[cfg(feature = "train")]
    if rayon::current_num_threads() > 1 {
        return Par::rayon(rayon::current_num_threads());
    }
    Par::Seq
}

/// `out += left right`, with `left` rows x inner, `right` inner x columns.
pub(crate) fn add_product(out: &mut [f32], left: &[f32], right: &[f32], [rows, inner, columns]: [usize; 3]) {
    let left = MatRef::from_row_major_slice(left, rows, inner);
    let right = MatRef::from_row_major_slice(right, inner, columns);
    matmul(MatMut::from_row_major_slice_mut(out, rows, columns), Accum::Add, left, right, 1.0, threads());
}

/// `out = left^T right`, with `left` inner x rows, `right` inner x columns.
pub(crate) fn product_of_transpose(out: &mut [f32], left: &[f32], right: &[f32], [rows, inner, columns]: [usize; 3]) {
    let left = MatRef::from_row_major_slice(left, inner, rows).transpose();
    let right = MatRef::from_row_major_slice(right, inner, columns);
    matmul(MatMut::from_row_major_slice_mut(out, rows, columns), Accum::Replace, left, right, 1.0, threads());
}

/// `out = left right^T`, with `left` rows x inner, `right` columns x inner.
pub(crate) fn product_with_transpose(out: &mut [f32], left: &[f32], right: &[f32], [rows, inner, columns]: [usize; 3]) {
    let left = MatRef::from_row_major_slice(left, rows, inner);
    let right = MatRef::from_row_major_slice(right, columns, inner).transpose();
    matmul(MatMut::from_row_major_slice_mut(out, rows, columns), Accum::Replace, left, right, 1.0, threads());
}

/// One row times a matrix, `out = bias + input weight`, optionally with a rectifier. Rows of the weight whose input is
/// zero are not read: after a rectifier these are about half of them, and the speed of a single product is limited by
/// memory.
#[derive(Debug)]
pub(crate) struct RowProduct<'a> {
    /// One value per row of the weight.
    pub input: &'a [f32],
    /// Row-major, inputs x outputs.
    pub weight: &'a [f32],
    /// One value per output.
    pub bias: &'a [f32],
    /// Whether a rectifier follows.
    pub relu: bool,
    /// One value per output.
    pub output: &'a mut [f32],
}

impl WithSimd for RowProduct<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        /// Rows that are added in one pass over the outputs.
        const ROWS: usize = 8;
        let columns = self.output.len();
        self.output.copy_from_slice(self.bias);
        let mut rows: [(&[f32], f32); ROWS] = [(&[], 0.0); ROWS];
        let mut waiting = 0;
        let inputs = self.input.iter().zip(self.weight.chunks_exact(columns)).filter(|(value, _)| **value != 0.0);
        for (&value, row) in inputs {
            rows[waiting] = (row, value);
            waiting += 1;
            if waiting == ROWS {
                add_rows(simd, self.output, &rows);
                waiting = 0;
            }
        }
        for row in &rows[..waiting] {
            add_rows(simd, self.output, std::array::from_ref(row));
        }
        if self.relu {
            self.output.iter_mut().for_each(|value| *value = value.max(0.0));
        }
    }
}

#[inline(always)]
fn add_rows<S: Simd, const N: usize>(simd: S, output: &mut [f32], rows: &[(&[f32], f32); N]) {
    let columns = output.len();
    let (out, out_tail) = S::as_mut_simd_f32s(output);
    let vectors: [&[S::f32s]; N] = std::array::from_fn(|n| &S::as_simd_f32s(&rows[n].0[..columns]).0[..out.len()]);
    let factors: [S::f32s; N] = std::array::from_fn(|n| simd.splat_f32s(rows[n].1));
    for (at, place) in out.iter_mut().enumerate() {
        let mut sum = *place;
        for n in 0..N {
            sum = simd.mul_add_e_f32s(vectors[n][at], factors[n], sum);
        }
        *place = sum;
    }
    let done = columns - out_tail.len();
    for (row, factor) in rows {
        out_tail.iter_mut().zip(&row[done..]).for_each(|(place, value)| *place += factor * value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(count: usize, step: f32) -> Vec<f32> {
        (0..count).map(|at| (at as f32 * step).sin()).collect()
    }

    fn plain(left: &[f32], right: &[f32], [rows, inner, columns]: [usize; 3]) -> Vec<f32> {
        let entry = |row: usize, column: usize| {
            (0..inner).map(|k| f64::from(left[row * inner + k]) * f64::from(right[k * columns + column])).sum::<f64>()
        };
        (0..rows * columns).map(|at| entry(at / columns, at % columns) as f32).collect()
    }

    fn transposed(matrix: &[f32], rows: usize, columns: usize) -> Vec<f32> {
        (0..rows * columns).map(|at| matrix[at % rows * columns + at / rows]).collect()
    }

    fn farthest(a: &[f32], b: &[f32]) -> f32 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn products_are_those_of_plain_sums() {
        let shape @ [rows, inner, columns] = [7, 33, 19];
        let (left, right) = (filled(rows * inner, 0.7), filled(inner * columns, 1.3));
        let expected = plain(&left, &right, shape);
        let mut out = vec![0.0; rows * columns];
        add_product(&mut out, &left, &right, shape);
        assert!(farthest(&out, &expected) < 1e-5);
        product_of_transpose(&mut out, &transposed(&left, rows, inner), &right, shape);
        assert!(farthest(&out, &expected) < 1e-5);
        product_with_transpose(&mut out, &left, &transposed(&right, inner, columns), shape);
        assert!(farthest(&out, &expected) < 1e-5);
    }

    #[test]
    fn a_row_product_skips_nothing_but_zeros() {
        for (inner, columns) in [(33, 19), (64, 64), (870, 901)] {
            let mut input = filled(inner, 0.9);
            input.iter_mut().for_each(|value| *value = value.max(0.0));
            let (weight, bias) = (filled(inner * columns, 1.1), filled(columns, 0.3));
            let sums = plain(&input, &weight, [1, inner, columns]);
            let expected: Vec<f32> = sums.iter().zip(&bias).map(|(sum, bias)| (sum + bias).max(0.0)).collect();
            let mut output = vec![f32::NAN; columns];
            let output_of = &mut output;
            crate::kernel::run(RowProduct {
                input: &input,
                weight: &weight,
                bias: &bias,
                relu: true,
                output: output_of,
            });
            assert!(farthest(&output, &expected) < 1e-4, "{}", farthest(&output, &expected));
        }
    }
}
