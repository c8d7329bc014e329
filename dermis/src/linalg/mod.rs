//! Sparse Cholesky, symbolic apart from numeric, and small dense algebra.
