//! The table of Green's functions: a column is computed when it is first needed; beyond a limit of memory the oldest
//! ones are dropped.

use crate::linalg::Matrix;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError, RwLock};

/// The columns that are stored, per conductor. Can be shared between threads by reference.
#[derive(Debug)]
pub(super) struct Table {
    columns: Vec<RwLock<Option<Arc<Matrix>>>>,
    kept: Mutex<Kept>,
    most_bytes: usize,
}

/// The stored columns, oldest first.
#[derive(Debug, Default)]
struct Kept {
    conductors: VecDeque<usize>,
    bytes: usize,
}

impl Table {
    /// For a number of conductors, without a limit.
    pub(super) fn new(conductor_count: usize) -> Self {
        let columns = (0..conductor_count).map(|_| RwLock::default()).collect();
        Table { columns, kept: Mutex::default(), most_bytes: usize::MAX }
    }

    /// Keeps at most this many bytes from now on, but at least one column.
    pub(super) fn limit(&mut self, most_bytes: usize) {
        self.most_bytes = most_bytes;
        self.drop_oldest();
    }

    /// The number of columns.
    pub(super) fn len(&self) -> usize {
        self.columns.len()
    }

    /// Memory of the stored columns.
    pub(super) fn bytes(&self) -> usize {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).bytes
    }

    /// The column of a conductor, stored or computed now; other threads that need it meanwhile wait for it.
    pub(super) fn column(&self, conductor: usize, compute: impl FnOnce() -> Matrix) -> Arc<Matrix> {
        // A panic while a column is computed leaves none.
        let slot = &self.columns[conductor];
        if let Some(column) = &*slot.read().unwrap_or_else(PoisonError::into_inner) {
            return Arc::clone(column);
        }
        let mut held = slot.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(column) = &*held {
            return Arc::clone(column);
        }
        let column = Arc::new(compute());
        *held = Some(Arc::clone(&column));
        // No thread waits for a column while it holds the list of columns, and the reverse.
        drop(held);
        self.keep(conductor, &column);
        column
    }

    fn keep(&self, conductor: usize, column: &Matrix) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.conductors.push_back(conductor);
        kept.bytes += bytes_of(column);
        drop(kept);
        self.drop_oldest();
    }

    fn drop_oldest(&self) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        while kept.bytes > self.most_bytes && kept.conductors.len() > 1 {
            let Some(oldest) = kept.conductors.pop_front() else { return };
            let dropped = self.columns[oldest].write().unwrap_or_else(PoisonError::into_inner).take();
            kept.bytes -= dropped.map_or(0, |column| bytes_of(&column));
        }
    }
}

fn bytes_of(column: &Matrix) -> usize {
    size_of_val(&column.values[..])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// A column of 100 values, 800 bytes.
    fn column(value: usize) -> Matrix {
        Matrix { rows: 100, columns: 1, values: vec![value as f64; 100] }
    }

    #[test]
    fn the_oldest_columns_are_dropped_and_computed_again() {
        let mut table = Table::new(10);
        let computed = AtomicUsize::new(0);
        let get = |table: &Table, conductor: usize| {
            let compute = || {
                computed.fetch_add(1, Ordering::Relaxed);
                column(conductor)
            };
            assert_eq!(table.column(conductor, compute).values[0], conductor as f64);
        };
        (0..10).chain(0..10).for_each(|conductor| get(&table, conductor));
        assert_eq!((table.bytes(), computed.load(Ordering::Relaxed)), (8000, 10));
        table.limit(2500);
        assert_eq!(table.bytes(), 2400);
        get(&table, 9);
        assert_eq!(computed.load(Ordering::Relaxed), 10, "the newest three are kept");
        get(&table, 0);
        assert_eq!((table.bytes(), computed.load(Ordering::Relaxed)), (2400, 11));
        table.limit(0);
        assert_eq!(table.bytes(), 800, "one column is needed");
    }

    #[test]
    fn threads_share_a_small_table() {
        let mut table = Table::new(8);
        table.limit(1600);
        std::thread::scope(|scope| {
            for first in 0..4 {
                let table = &table;
                scope.spawn(move || {
                    for step in 0..5000 {
                        let conductor = (first * 3 + step * 5) % 8;
                        assert_eq!(table.column(conductor, || column(conductor)).values[99], conductor as f64);
                    }
                });
            }
        });
        assert!(table.bytes() <= 1600, "{}", table.bytes());
    }
}
