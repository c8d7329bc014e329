//! The memory layout of a batched factorisation, computed once for a pattern.

use crate::linalg::Symbolic;

/// Rows and columns of a tile.
pub(super) const TILE: usize = 4;

/// The memory layout of a batched factorisation, in vectors of [`LANES`](super::LANES) numbers.
#[derive(Debug, Clone)]
pub struct BatchPlan {
    /// In the order of elimination; the last one eliminates nothing and collects the kept unknowns.
    pub(super) fronts: Vec<Front>,
    pub(super) children: Vec<Child>,
    /// For each row of each child's update, its part of the addresses in the parent.
    pub(super) rows: Vec<RowAddress>,
    /// The target of each entry, in a panel or (for the kept unknowns) in the last update.
    pub(super) entry_targets: Vec<u32>,
    entry_order: Vec<usize>,
    pub(super) kept_count: usize,
    /// The start of the last front's update, which becomes the Schur complement.
    pub(super) schur: usize,
    /// Of the largest panel.
    pub(super) panel_size: usize,
    /// Of all panels together.
    pub(super) panels_size: usize,
    pub(super) update_size: usize,
}

/// A front: the columns it eliminates, and the update for its parent.
#[derive(Debug, Clone)]
pub(super) struct Front {
    /// Columns eliminated.
    pub width: usize,
    /// Rows of its update.
    pub rows: usize,
    /// Its entries, as a range of [`BatchPlan::entry_targets`].
    pub entries: std::ops::Range<usize>,
    /// Its children, as a range of [`BatchPlan::children`].
    pub children: std::ops::Range<usize>,
    /// Start of its update.
    pub update: usize,
    /// Start of its panel where all panels are kept.
    pub panel: usize,
}

impl Front {
    /// Rows of tiles in its panel.
    #[inline(always)]
    pub(super) fn panel_tiles(&self) -> usize {
        self.width.div_ceil(TILE) + self.rows.div_ceil(TILE)
    }

    #[inline(always)]
    pub(super) fn panel_size(&self) -> usize {
        self.panel_tiles() * TILE * self.width
    }

    #[inline(always)]
    pub(super) fn update_size(&self) -> usize {
        self.rows * (self.rows + 1) / 2
    }
}

/// A front as seen by its parent.
#[derive(Debug, Clone)]
pub(super) struct Child {
    /// Start of its update.
    pub update: usize,
    /// Its update's rows, as a range of [`BatchPlan::rows`].
    pub rows: std::ops::Range<usize>,
    /// The number of its first rows that are columns eliminated by the parent.
    pub eliminated: usize,
}

/// A row of a child's update in its parent: an address is the sum of a part for the row and a part for the column.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RowAddress {
    /// As a row in the parent's panel.
    pub panel: u32,
    /// As a row in the parent's update; unused if the parent eliminates it.
    pub update: u32,
    /// As a column in the parent's panel if the parent eliminates it, else in its update.
    pub column: u32,
}

/// The column's part of an address in an update of `rows` rows, a lower triangle column by column; the row's part is
/// the row index.
#[inline(always)]
pub(super) fn update_column(column: usize, rows: usize) -> usize {
    (column * (2 * rows - column) - column) / 2
}

/// The row's part of an address in a panel of `width` columns; rows below the eliminated ones start a new tile.
fn panel_row(row: usize, width: usize) -> usize {
    let (tile, within) = match row.checked_sub(width) {
        None => (row / TILE, row % TILE),
        Some(below) => (width.div_ceil(TILE) + below / TILE, below % TILE),
    };
    tile * TILE * width + within
}

/// The column's part of an address in a panel.
fn panel_column(column: usize) -> usize {
    column * TILE
}

impl BatchPlan {
    pub(super) fn new(symbolic: &Symbolic) -> Self {
        let mut plan = BatchPlan {
            fronts: Vec::with_capacity(symbolic.supernodes.len() + 1),
            children: Vec::new(),
            rows: Vec::new(),
            entry_targets: Vec::new(),
            entry_order: Vec::new(),
            kept_count: symbolic.kept_count,
            schur: 0,
            panel_size: 0,
            panels_size: 0,
            update_size: 0,
        };
        let mut memory = Memory::default();
        for supernode in &symbolic.supernodes {
            let (width, height) = (supernode.width(), supernode.height());
            let entries = symbolic.entry_plan[supernode.entries.clone()]
                .iter()
                .map(|&(entry, [column, row])| (entry, panel_row(row, width) + panel_column(column)));
            let children = &symbolic.children[supernode.children.clone()];
            plan.push(symbolic, &mut memory, [width, height - width], entries, children);
        }
        let kept = symbolic.kept_count;
        let entries =
            symbolic.kept_entries.iter().map(|&(entry, at)| (entry, at % kept + update_column(at / kept, kept)));
        plan.push(symbolic, &mut memory, [0, kept], entries, &symbolic.roots);
        plan.schur = plan.fronts[plan.fronts.len() - 1].update;
        plan.update_size = memory.size;
        plan
    }

    /// The order in which the factorisation requests entries, as indices in the pattern's list.
    pub fn entry_order(&self) -> &[usize] {
        &self.entry_order
    }

    /// Number of kept unknowns.
    pub(crate) fn kept_count(&self) -> usize {
        self.kept_count
    }

    fn push(
        &mut self,
        symbolic: &Symbolic,
        memory: &mut Memory,
        [width, rows]: [usize; 2],
        entries: impl Iterator<Item = (usize, usize)>,
        children: &[usize],
    ) {
        let (first_entry, first_child) = (self.entry_targets.len(), self.children.len());
        for (entry, target) in entries {
            self.entry_order.push(entry);
            self.entry_targets.push(address(target));
        }
        for &child in children {
            let places = &symbolic.row_in_parent[symbolic.supernodes[child].row_in_parent.clone()];
            let first_row = self.rows.len();
            self.rows.extend(places.iter().map(|&place| RowAddress::new(place, width, rows)));
            self.children.push(Child {
                update: self.fronts[child].update,
                rows: first_row..self.rows.len(),
                eliminated: places.partition_point(|&place| place < width),
            });
        }
        let mut front = Front {
            width,
            rows,
            entries: first_entry..self.entry_targets.len(),
            children: first_child..self.children.len(),
            update: 0,
            panel: self.panels_size,
        };
        // The parent's update is written while its children's are still read.
        front.update = memory.take(front.update_size());
        for &child in children {
            memory.give_back(self.fronts[child].update, self.fronts[child].update_size());
        }
        self.panel_size = self.panel_size.max(front.panel_size());
        self.panels_size += front.panel_size();
        self.fronts.push(front);
    }
}

impl RowAddress {
    /// The address of a row of a front of the given width and number of rows below.
    fn new(place: usize, width: usize, rows: usize) -> Self {
        let below = place.checked_sub(width);
        RowAddress {
            panel: address(panel_row(place, width)),
            update: address(below.unwrap_or(0)),
            column: address(below.map_or(panel_column(place), |below| update_column(below, rows))),
        }
    }
}

fn address(value: usize) -> u32 {
    u32::try_from(value).expect("a front of four thousand million numbers fits no memory")
}

/// First-fit allocation of the updates; their lifetimes are known in advance.
#[derive(Default)]
struct Memory {
    /// Free blocks (start, length), by start.
    free: Vec<(usize, usize)>,
    size: usize,
}

impl Memory {
    fn take(&mut self, length: usize) -> usize {
        if let Some(piece) = self.free.iter().position(|&(_, free)| free >= length) {
            let (start, free) = self.free[piece];
            if free == length {
                self.free.remove(piece);
            } else {
                self.free[piece] = (start + length, free - length);
            }
            return start;
        }
        // No block is large enough: the last block grows if it ends at the end of the memory.
        let start = match self.free.last() {
            Some(&(start, free)) if start + free == self.size => {
                self.free.pop();
                start
            }
            _ => self.size,
        };
        self.size = start + length;
        start
    }

    fn give_back(&mut self, start: usize, length: usize) {
        if length == 0 {
            return;
        }
        let next = self.free.partition_point(|&(other, _)| other < start);
        self.free.insert(next, (start, length));
        if next + 1 < self.free.len() && start + length == self.free[next + 1].0 {
            self.free[next].1 += self.free[next + 1].1;
            self.free.remove(next + 1);
        }
        if next > 0 && self.free[next - 1].0 + self.free[next - 1].1 == start {
            self.free[next - 1].1 += self.free[next].1;
            self.free.remove(next);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_of_memory_never_overlap_and_are_used_again() {
        let mut memory = Memory::default();
        let a = memory.take(10);
        let b = memory.take(20);
        let c = memory.take(5);
        assert_eq!((a, b, c), (0, 10, 30));
        memory.give_back(b, 20);
        assert_eq!(memory.take(8), 10);
        memory.give_back(a, 10);
        assert_eq!(memory.take(10), 0);
        memory.give_back(c, 5);
        // 18..35 is one block again and grows.
        assert_eq!(memory.take(30), 18);
        assert_eq!(memory.size, 48);
        assert_eq!(memory.free, []);
    }

    #[test]
    fn addresses_of_an_update_fill_its_triangle_in_order() {
        let rows = 11;
        let addresses: Vec<usize> =
            (0..rows).flat_map(|j| (j..rows).map(move |i| i + update_column(j, rows))).collect();
        assert_eq!(addresses, (0..rows * (rows + 1) / 2).collect::<Vec<_>>());
    }
}
