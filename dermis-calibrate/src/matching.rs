//! Whether labels belong to their frames, told from chance.

use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::stats::mean;
use faer::Mat;
use std::ops::Range;

/// Labels with less [evidence] than this do not belong to their frames. The evidence of useless labels
/// has a standard deviation of 1.56 (34 sets, `--test integration useless_labels::`), not 1, since the maps of the folds share labels
/// (Bengio and Grandvalet, 2004, JMLR 5, 1089); three of these are needed.
pub(crate) const MIN_EVIDENCE: f64 = 3.0 * 1.56;

/// By how many standard deviations estimated positions are nearer to their own labels than to the same labels in a
/// random order (both in m); 0 where the order makes no difference, `None` for too few labels.
///
/// Labels change places within each fold of cross-validation only: a map of the others finds an unlike frame in the gaps
/// between their labels, and the labels of the fold lie there, right or wrong. The sum of the distances of pairs over
/// all orders has the mean and variance of Hoeffding (1951), "A combinatorial central limit theorem", DOI
/// 10.1214/aoms/1177729545.
pub(crate) fn evidence(estimates_m: &[Point3], labels_m: &[Point3], folds: &[Range<usize>]) -> Option<f64> {
    // Of few labels even the right places tell nothing from chance.
    let evidence = |places_m| of_places(places_m, labels_m, folds);
    (evidence(labels_m) >= MIN_EVIDENCE).then(|| evidence(estimates_m))
}

/// By how many standard deviations rows differ less from their own columns than from those in a random order.
pub(crate) fn evidence_of(apart: &Mat<f64>) -> f64 {
    let (gain, variance) = gain_of(apart);
    if variance > 0.0 { gain / variance.sqrt() } else { 0.0 }
}

fn of_places(estimates_m: &[Point3], labels_m: &[Point3], folds: &[Range<usize>]) -> f64 {
    let of_fold = |fold: &Range<usize>| gain(&estimates_m[fold.clone()], &labels_m[fold.clone()]);
    let (gain, variance) = folds.iter().map(of_fold).fold((0.0, 0.0), |sum, fold| (sum.0 + fold.0, sum.1 + fold.1));
    if variance > 0.0 { gain / variance.sqrt() } else { 0.0 }
}

/// The sum of distances of a mean order less that of the given one, and the variance of the sum over all orders.
fn gain(estimates_m: &[Point3], labels_m: &[Point3]) -> (f64, f64) {
    let count = labels_m.len();
    gain_of(&Mat::from_fn(count, count, |row, column| distance(estimates_m[row], labels_m[column])))
}

/// The same of the differences of all rows from all columns.
fn gain_of(apart: &Mat<f64>) -> (f64, f64) {
    let count = apart.nrows();
    if count < 2 {
        return (0.0, 0.0);
    }
    let of_rows: Vec<f64> = apart.row_iter().map(|row| row.sum() / count as f64).collect();
    let of_columns: Vec<f64> = apart.col_iter().map(|column| column.sum() / count as f64).collect();
    let whole = mean(&of_rows);
    let centred = Mat::from_fn(count, count, |i, j| apart[(i, j)] - of_rows[i] - of_columns[j] + whole);
    let paired: f64 = (0..count).map(|index| apart[(index, index)]).sum();
    // Rounding alone is no variance.
    let sd = centred.norm_l2() / ((count - 1) as f64).sqrt();
    let variance = if sd > f64::EPSILON * count as f64 * whole.abs() { sd * sd } else { 0.0 };
    (count as f64 * whole - paired, variance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand::SeedableRng;
    use rand::seq::SliceRandom;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn moments_are_those_of_random_orders() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let place = |rng: &mut ChaCha8Rng| [rng.random_range(0.0..0.3), rng.random_range(0.0..0.1), 0.0];
        let labels: Vec<Point3> = (0..12).map(|_| place(&mut rng)).collect();
        let estimates: Vec<Point3> = (0..12).map(|_| place(&mut rng)).collect();
        let mut order = labels.clone();
        let whole = std::slice::from_ref(&(0..12));
        let values: Vec<f64> = (0..40_000)
            .map(|_| {
                order.shuffle(&mut rng);
                of_places(&estimates, &order, whole)
            })
            .collect();
        let middle = mean(&values);
        let sd = mean(&values.iter().map(|value| (value - middle).powi(2)).collect::<Vec<_>>()).sqrt();
        assert!(middle.abs() < 0.02 && (sd - 1.0).abs() < 0.02, "{middle} {sd}");
        assert!(of_places(&labels, &labels, &[0..6, 6..12]) > 3.0);
        assert_eq!(evidence(&labels[..4], &labels[..4], std::slice::from_ref(&(0..4))), None);
        assert_eq!(of_places(&[labels[0]; 12], &labels, whole), 0.0);
    }
}
