//! The sparse factorisation compared with dense algebra, on random patterns.

use dermis::linalg::{Cholesky, Matrix, Symbolic};
use proptest::prelude::*;

/// A random symmetric, diagonally dominant matrix: as pattern entries, and dense.
#[derive(Debug, Clone)]
struct Sample {
    count: usize,
    kept: usize,
    entries: Vec<[usize; 2]>,
    values: Vec<f64>,
}

fn sample() -> impl Strategy<Value = Sample> {
    (2usize..40).prop_flat_map(|count| {
        let pair = (0..count, 0..count, -1.0f64..1.0);
        (Just(count), 0..=count.min(6), prop::collection::vec(pair, 0..4 * count)).prop_map(|(count, kept, pairs)| {
            let mut entries: Vec<[usize; 2]> = (0..count).map(|i| [i, i]).collect();
            let mut values = vec![0.5; count];
            for (i, j, value) in pairs {
                if i != j && !entries.contains(&[i, j]) && !entries.contains(&[j, i]) {
                    entries.push([i, j]);
                    values.push(value);
                    values[i] += value.abs();
                    values[j] += value.abs();
                }
            }
            Sample { count, kept, entries, values }
        })
    })
}

impl Sample {
    fn dense(&self) -> Matrix {
        let mut dense = Matrix::zeros(self.count, self.count);
        for (&[i, j], &value) in self.entries.iter().zip(&self.values) {
            *dense.at_mut(i, j) = value;
            *dense.at_mut(j, i) = value;
        }
        dense
    }
}

/// Diagonal dominance bounds the condition number; 40 unknowns lose few digits.
const TOLERANCE: f64 = 1e-11;

proptest! {
    #[test]
    fn the_schur_complement_is_the_inverse_of_a_block_of_the_inverse(sample in sample()) {
        let factor = Symbolic::new(sample.count, sample.kept, &sample.entries).factor(&sample.values).unwrap();
        let inverse = Cholesky::new(&sample.dense()).unwrap().inverse();
        let interior = sample.count - sample.kept;
        for i in 0..sample.kept {
            for j in 0..sample.kept {
                let product: f64 =
                    (0..sample.kept).map(|k| factor.schur().at(i, k) * inverse.at(interior + k, interior + j)).sum();
                prop_assert!((product - f64::from(u8::from(i == j))).abs() < TOLERANCE);
            }
        }
    }

    #[test]
    fn a_solution_satisfies_its_equations(sample in sample(), seed in 0usize..1000) {
        let symbolic = Symbolic::new(sample.count, 0, &sample.entries);
        let factor = symbolic.factor(&sample.values).unwrap();
        let mut right = Matrix::zeros(sample.count, 3);
        for (k, value) in right.values.iter_mut().enumerate() {
            *value = ((k * 31 + seed) as f64).sin();
        }
        let mut solution = right.clone();
        factor.solve_in_place(&symbolic, &mut solution);
        let dense = sample.dense();
        for i in 0..sample.count {
            for problem in 0..3 {
                let left: f64 = (0..sample.count).map(|k| dense.at(i, k) * solution.at(k, problem)).sum();
                prop_assert!((left - right.at(i, problem)).abs() < TOLERANCE);
            }
        }
    }

    #[test]
    fn kept_unknowns_extend_so_that_the_rest_is_in_equilibrium(sample in sample()) {
        let symbolic = Symbolic::new(sample.count, sample.kept, &sample.entries);
        let factor = symbolic.factor(&sample.values).unwrap();
        let interior = sample.count - sample.kept;
        let mut x = Matrix::zeros(sample.count, 2);
        for (k, value) in x.values[interior * 2..].iter_mut().enumerate() {
            *value = (k as f64 + 1.0).cos();
        }
        factor.extend_homogeneous(&symbolic, &mut x);
        let dense = sample.dense();
        for i in 0..interior {
            for problem in 0..2 {
                let left: f64 = (0..sample.count).map(|k| dense.at(i, k) * x.at(k, problem)).sum();
                prop_assert!(left.abs() < TOLERANCE);
            }
        }
    }
}

#[test]
fn a_pivot_that_is_not_positive_is_named() {
    let entries = [[0, 0], [1, 1], [2, 2], [1, 0]];
    let error = Symbolic::new(3, 0, &entries).factor(&[1.0, 1.0, -1.0, 0.5]).unwrap_err();
    assert_eq!(error.unknown, 2);
    let indefinite = Matrix { rows: 2, columns: 2, values: vec![1.0, 2.0, 2.0, 1.0] };
    assert_eq!(Cholesky::new(&indefinite).unwrap_err().unknown, 1);
}
