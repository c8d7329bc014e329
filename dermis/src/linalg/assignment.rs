//! Assignment of rows to columns at the smallest total cost.

/// The assignment of rows to columns (as many as the smaller count) with the smallest total cost: the Hungarian method
/// by shortest augmenting paths (Jonker and Volgenant 1987, DOI 10.1007/BF02278710).
pub fn smallest_total(rows: usize, columns: usize, cost: &dyn Fn(usize, usize) -> f64) -> Vec<(usize, usize)> {
    if rows > columns {
        let turned = smallest_total(columns, rows, &|row, column| cost(column, row));
        return turned.into_iter().map(|(row, column)| (column, row)).collect();
    }
    let mut row_price = vec![0.0; rows];
    let mut column_price = vec![0.0; columns];
    let mut row_of: Vec<Option<usize>> = vec![None; columns];
    for start in 0..rows {
        let mut least = vec![f64::INFINITY; columns];
        let mut before: Vec<Option<usize>> = vec![None; columns];
        let mut done = vec![false; columns];
        let (mut row, mut last) = (start, None);
        // Grow the tree of alternating paths from the row until a free column is reached.
        let end = loop {
            let mut best: Option<usize> = None;
            for column in (0..columns).filter(|&column| !done[column]) {
                let reduced = cost(row, column) - row_price[row] - column_price[column];
                if reduced < least[column] {
                    least[column] = reduced;
                    before[column] = last;
                }
                if best.is_none_or(|best| least[column] < least[best]) {
                    best = Some(column);
                }
            }
            let column = best.expect("there are no fewer columns than rows");
            let step = least[column];
            row_price[start] += step;
            for other in 0..columns {
                match row_of[other] {
                    Some(owner) if done[other] => {
                        row_price[owner] += step;
                        column_price[other] -= step;
                    }
                    _ => least[other] -= step,
                }
            }
            done[column] = true;
            match row_of[column] {
                Some(owner) => (row, last) = (owner, Some(column)),
                None => break column,
            }
        };
        let mut column = end;
        while let Some(previous) = before[column] {
            row_of[column] = row_of[previous];
            column = previous;
        }
        row_of[column] = Some(start);
    }
    row_of.into_iter().enumerate().filter_map(|(column, row)| row.map(|row| (row, column))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The smallest total over all assignments of rows to columns, by brute force.
    fn by_trying(rows: usize, columns: usize, cost: &dyn Fn(usize, usize) -> f64) -> f64 {
        fn best(row: usize, rows: usize, used: &mut [bool], cost: &dyn Fn(usize, usize) -> f64) -> f64 {
            if row == rows {
                return 0.0;
            }
            let mut least = f64::INFINITY;
            for column in 0..used.len() {
                if !used[column] {
                    used[column] = true;
                    least = least.min(cost(row, column) + best(row + 1, rows, used, cost));
                    used[column] = false;
                }
            }
            least
        }
        best(0, rows, &mut vec![false; columns], cost)
    }

    proptest! {
        #[test]
        fn no_assignment_is_cheaper(rows in 0usize..6, columns in 0usize..6, seed in proptest::collection::vec(0.0..1.0, 36)) {
            let cost = |row: usize, column: usize| seed[row * 6 + column];
            let pairs = smallest_total(rows, columns, &cost);
            prop_assert_eq!(pairs.len(), rows.min(columns));
            let total: f64 = pairs.iter().map(|&(row, column)| cost(row, column)).sum();
            let least = if rows <= columns {
                by_trying(rows, columns, &cost)
            } else {
                by_trying(columns, rows, &|row, column| cost(column, row))
            };
            prop_assert!((total - least).abs() < 1e-12, "{} but {} is possible", total, least);
        }
    }
}
