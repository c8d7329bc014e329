//! Whether labels belong to their frames, told from chance.

use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::stats::mean;

/// By how many standard deviations estimated positions are nearer to their own labels than to the same labels in a
/// random order (both in m); 0 where the order makes no difference.
///
/// The sum of the distances of pairs over all orders has the mean and variance of Hoeffding (1951), "A combinatorial
/// central limit theorem", DOI 10.1214/aoms/1177729545.
pub(crate) fn evidence(estimates_m: &[Point3], labels_m: &[Point3]) -> f64 {
    let count = estimates_m.len() as f64;
    let rows: Vec<Vec<f64>> =
        estimates_m.iter().map(|&estimate| labels_m.iter().map(|&label| distance(estimate, label)).collect()).collect();
    let of_rows: Vec<f64> = rows.iter().map(|row| mean(row)).collect();
    let of_columns: Vec<f64> =
        (0..labels_m.len()).map(|column| rows.iter().map(|row| row[column]).sum::<f64>() / count).collect();
    let whole = mean(&of_rows);
    let centred = |row: usize, column: usize| rows[row][column] - of_rows[row] - of_columns[column] + whole;
    let squares: f64 =
        (0..rows.len()).flat_map(|row| (0..rows.len()).map(move |column| centred(row, column).powi(2))).sum();
    let sd = (squares / (count - 1.0)).sqrt();
    let paired: f64 = (0..rows.len()).map(|row| rows[row][row]).sum();
    let rounding = f64::EPSILON * count * whole;
    if sd > rounding { (count * whole - paired) / sd } else { 0.0 }
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
        let values: Vec<f64> = (0..40_000)
            .map(|_| {
                order.shuffle(&mut rng);
                evidence(&estimates, &order)
            })
            .collect();
        let middle = mean(&values);
        let sd = mean(&values.iter().map(|value| (value - middle).powi(2)).collect::<Vec<_>>()).sqrt();
        assert!(middle.abs() < 0.02 && (sd - 1.0).abs() < 0.02, "{middle} {sd}");
        assert!(evidence(&labels, &labels) > 5.0);
        assert_eq!(evidence(&[labels[0]; 12], &labels), 0.0);
    }
}
