//! The part of a sparse Cholesky factorisation that depends only on the pattern.

use super::dissection::nested_dissection;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMat;
use faer::sparse::linalg::amd;

/// No supernode.
pub(super) const NONE: usize = usize::MAX;

/// Supernodes are merged into their parents as long as the fraction of stored zeros stays below a limit that decreases
/// with the width: `(columns up to, fraction)`. Narrow fronts have more overhead per column, so they may store more
/// zeros. Measured on 1,000 to 20,000 nodes; the optimum is flat.
const MERGE: [(usize, f64); 3] = [(4, 0.8), (16, 0.3), (48, 0.1)];
/// The limit for wider supernodes.
const MERGE_WIDE: f64 = 0.05;

/// A sequence of columns of the factor that share one pattern below their diagonal block.
#[derive(Debug, Clone)]
pub(super) struct Supernode {
    /// First column and one past the last, in elimination order.
    pub columns: std::ops::Range<usize>,
    /// The rows below, in elimination order, as a range of [`Symbolic::rows`].
    pub rows: std::ops::Range<usize>,
    /// Where its `height x width` column-major block starts in the factor's values.
    pub start: usize,
    /// The entries of the matrix that belong to its front, as a range of [`Symbolic::entry_plan`].
    pub entries: std::ops::Range<usize>,
    /// Its children, as a range of [`Symbolic::children`]; in the order in which their updates were pushed.
    pub children: std::ops::Range<usize>,
    /// The positions of its rows in its parent's front, as a range of [`Symbolic::row_in_parent`].
    pub row_in_parent: std::ops::Range<usize>,
}

impl Supernode {
    /// Number of columns eliminated here.
    pub(super) fn width(&self) -> usize {
        self.columns.len()
    }

    /// Order of its front.
    pub(super) fn height(&self) -> usize {
        self.columns.len() + self.rows.len()
    }
}

/// Elimination order, supernodes and assembly plan of a symmetric pattern whose last unknowns are kept.
///
/// The first `n - kept` unknowns are eliminated in a fill-reducing order (nested dissection: George, 1973, DOI
/// 10.1137/0710032; or approximate minimum degree, if it is better) by the multifrontal method (Duff and Reid, 1983, DOI
/// 10.1145/356044.356047); for the last `kept` the Schur complement is computed.
#[derive(Debug, Clone)]
pub struct Symbolic {
    pub(super) unknown_count: usize,
    pub(super) kept_count: usize,
    /// `order[k]` is the unknown eliminated k-th; the kept ones stay last and in order.
    pub(super) order: Vec<usize>,
    /// The place of each unknown in `order`.
    pub(super) position: Vec<usize>,
    /// The supernode that eliminates each place of `order`; `NONE` for the kept ones.
    pub(super) supernode_of: Vec<usize>,
    /// The parent of each supernode; `NONE` for a root.
    pub(super) parent_of: Vec<usize>,
    pub(super) supernodes: Vec<Supernode>,
    pub(super) rows: Vec<usize>,
    pub(super) children: Vec<usize>,
    pub(super) row_in_parent: Vec<usize>,
    /// (index of the entry in the caller's list, column and row of the front).
    pub(super) entry_plan: Vec<(usize, [usize; 2])>,
    /// The supernodes without a parent, whose updates go to the kept block; and the block's own entries.
    pub(super) roots: Vec<usize>,
    pub(super) kept_entries: Vec<(usize, usize)>,
    pub(super) value_count: usize,
    pub(super) front_max: usize,
    pub(super) stack_max: usize,
    entry_count: usize,
}

impl Symbolic {
    /// Analyses a pattern given by its entries `[i, j]`: every diagonal one, and each off-diagonal pair once, in
    /// either triangle.
    ///
    /// # Panics
    /// If an index is out of range or `kept_count` exceeds `unknown_count`.
    pub fn new(unknown_count: usize, kept_count: usize, entries: &[[usize; 2]]) -> Self {
        assert!(kept_count <= unknown_count, "more unknowns kept than there are");
        let interior = unknown_count - kept_count;
        Self::in_best_order(unknown_count, kept_count, entries, elimination_orders(interior, unknown_count, entries))
    }

    /// The same by the order of elimination that needs the fewest multiply-adds, the kept unknowns last and in order.
    pub(super) fn in_best_order(
        unknown_count: usize,
        kept_count: usize,
        entries: &[[usize; 2]],
        orders: Vec<Vec<usize>>,
    ) -> Self {
        let interior = unknown_count - kept_count;
        let columns = |order: &Vec<usize>| Columns::new(unknown_count, interior, order, entries);
        let (columns, order) = orders
            .into_iter()
            .map(|order| (columns(&order), order))
            .min_by_key(|(columns, _)| columns.multiply_add_count())
            .expect("there is an order");
        let sequence = postorder(&columns);
        let columns = columns.renumbered(&sequence);
        let order = sequence.iter().map(|&place| order[place]).chain(order[interior..].iter().copied()).collect();
        Self::from_columns(unknown_count, kept_count, order, &columns, entries)
    }

    /// Number of unknowns.
    pub(crate) fn unknown_count(&self) -> usize {
        self.unknown_count
    }

    /// Number of kept unknowns, for which the Schur complement is computed.
    pub(crate) fn kept_count(&self) -> usize {
        self.kept_count
    }

    /// Number of entries of the caller's pattern.
    pub(crate) fn entry_count(&self) -> usize {
        self.entry_count
    }

    /// Number of values in the factor, including the zeros stored because of merging.
    pub fn value_count(&self) -> usize {
        self.value_count
    }

    /// Multiply-adds of one factorisation.
    pub fn multiply_add_count(&self) -> usize {
        let column = |height: usize| height * (height + 1) / 2;
        self.supernodes.iter().map(|s| (s.height() - s.width()..s.height()).map(column).sum::<usize>()).sum()
    }

    fn from_columns(
        unknown_count: usize,
        kept_count: usize,
        order: Vec<usize>,
        columns: &Columns,
        entries: &[[usize; 2]],
    ) -> Self {
        let interior = unknown_count - kept_count;
        let groups = merge(fundamental(columns), columns);
        let mut group_of = vec![NONE; unknown_count];
        for (index, group) in groups.iter().enumerate() {
            group_of[group.clone()].fill(index);
        }
        let parent_of = |group: &std::ops::Range<usize>| match columns.parent[group.end - 1] {
            row if row < interior => group_of[row],
            _ => NONE,
        };
        let mut symbolic = Symbolic {
            unknown_count,
            kept_count,
            position: inverse(&order),
            order,
            supernode_of: Vec::new(),
            parent_of: groups.iter().map(parent_of).collect(),
            supernodes: Vec::with_capacity(groups.len()),
            rows: Vec::new(),
            children: Vec::new(),
            row_in_parent: Vec::new(),
            entry_plan: Vec::new(),
            roots: Vec::new(),
            kept_entries: Vec::new(),
            value_count: 0,
            front_max: 0,
            stack_max: 0,
            entry_count: entries.len(),
        };
        let mut children_of = vec![Vec::new(); groups.len()];
        for (index, group) in groups.iter().enumerate() {
            match parent_of(group) {
                NONE => symbolic.roots.push(index),
                parent => children_of[parent].push(index),
            }
            symbolic.push_supernode(group.clone(), &columns.below[group.end - 1], &children_of[index]);
        }
        symbolic.place_rows_in_parents(&groups, parent_of);
        symbolic.plan_entries(&group_of, entries);
        symbolic.supernode_of = group_of;
        symbolic.measure_stack();
        symbolic
    }

    fn push_supernode(&mut self, columns: std::ops::Range<usize>, rows: &[usize], children: &[usize]) {
        let rows_start = self.rows.len();
        self.rows.extend_from_slice(rows);
        let children_start = self.children.len();
        self.children.extend_from_slice(children);
        let supernode = Supernode {
            columns,
            rows: rows_start..self.rows.len(),
            start: self.value_count,
            entries: 0..0,
            children: children_start..self.children.len(),
            row_in_parent: 0..0,
        };
        self.value_count += supernode.height() * supernode.width();
        self.front_max = self.front_max.max(supernode.height());
        self.supernodes.push(supernode);
    }

    /// For each supernode, the positions of its rows in its parent's front (in the kept block for a root).
    fn place_rows_in_parents(
        &mut self,
        groups: &[std::ops::Range<usize>],
        parent_of: impl Fn(&std::ops::Range<usize>) -> usize,
    ) {
        let interior = self.unknown_count - self.kept_count;
        let mut place = vec![0; self.unknown_count];
        for (index, group) in groups.iter().enumerate() {
            let start = self.row_in_parent.len();
            match parent_of(group) {
                NONE => {
                    let rows = &self.rows[self.supernodes[index].rows.clone()];
                    self.row_in_parent.extend(rows.iter().map(|row| row - interior));
                }
                parent => {
                    for (local, row) in self.front_rows(parent).enumerate() {
                        place[row] = local;
                    }
                    let rows = &self.rows[self.supernodes[index].rows.clone()];
                    self.row_in_parent.extend(rows.iter().map(|&row| place[row]));
                }
            }
            self.supernodes[index].row_in_parent = start..self.row_in_parent.len();
        }
    }

    /// The rows of a front in order: its columns, then the rows below.
    fn front_rows(&self, supernode: usize) -> impl Iterator<Item = usize> + '_ {
        let supernode = &self.supernodes[supernode];
        supernode.columns.clone().chain(self.rows[supernode.rows.clone()].iter().copied())
    }

    fn plan_entries(&mut self, group_of: &[usize], entries: &[[usize; 2]]) {
        let interior = self.unknown_count - self.kept_count;
        let position = &self.position;
        let mut entries_of = vec![Vec::new(); self.supernodes.len()];
        for (index, &[i, j]) in entries.iter().enumerate() {
            let (i, j) = (position[i], position[j]);
            let (low, high) = (i.min(j), i.max(j));
            if low < interior {
                entries_of[group_of[low]].push((index, low, high));
            } else {
                let (column, row) = (low - interior, high - interior);
                self.kept_entries.push((index, column * self.kept_count + row));
            }
        }
        let mut place = vec![0; self.unknown_count];
        for (index, list) in entries_of.iter().enumerate() {
            for (local, row) in self.front_rows(index).enumerate().collect::<Vec<_>>() {
                place[row] = local;
            }
            let start = self.entry_plan.len();
            self.entry_plan.extend(list.iter().map(|&(entry, low, high)| (entry, [place[low], place[high]])));
            self.supernodes[index].entries = start..self.entry_plan.len();
        }
    }

    /// The maximum number of values of updates that wait for their parents.
    fn measure_stack(&mut self) {
        let size = |s: &Supernode| s.rows.len() * s.rows.len();
        let mut held = 0;
        for supernode in &self.supernodes {
            held -= self.children[supernode.children.clone()]
                .iter()
                .map(|&child| size(&self.supernodes[child]))
                .sum::<usize>();
            held += size(supernode);
            self.stack_max = self.stack_max.max(held);
        }
    }
}

/// Up to so many unknowns, minimum degree is about as good as dissection and is found faster.
const SMALL: usize = 1000;

/// Fill-reducing orders of the interior unknowns, each followed by the kept ones. Dissection is better on most large
/// meshes, minimum degree on long strips.
fn elimination_orders(interior: usize, unknown_count: usize, entries: &[[usize; 2]]) -> Vec<Vec<usize>> {
    let mut orders = vec![minimum_degree(interior, entries)];
    if interior > SMALL {
        let pairs = entries.iter().copied().filter(|[i, j]| i != j);
        orders.push(nested_dissection(interior, unknown_count, pairs));
    }
    orders.iter_mut().for_each(|order| order.extend(interior..unknown_count));
    orders
}

/// The first `interior` unknowns by approximate minimum degree (Amestoy, Davis and Duff, 1996, DOI
/// 10.1137/S0895479894278952).
pub(super) fn minimum_degree(interior: usize, entries: &[[usize; 2]]) -> Vec<usize> {
    let mut columns = vec![Vec::new(); interior];
    for &[i, j] in entries.iter().filter(|[i, j]| i != j && *i < interior && *j < interior) {
        columns[i.max(j)].push(i.min(j));
    }
    let mut column_start = vec![0];
    let mut row_indices = Vec::new();
    for column in &mut columns {
        column.sort_unstable();
        row_indices.append(column);
        column_start.push(row_indices.len());
    }
    let nonzero_count = row_indices.len();
    let pattern = SymbolicSparseColMat::new_checked(interior, interior, column_start, None, row_indices);
    let (mut order, mut position) = (vec![0usize; interior], vec![0usize; interior]);
    let mut memory = MemBuffer::new(amd::order_scratch::<usize>(interior, nonzero_count));
    amd::order(&mut order, &mut position, pattern.as_ref(), amd::Control::default(), MemStack::new(&mut memory))
        .expect("indices of a mesh fit a usize");
    order
}

fn inverse(order: &[usize]) -> Vec<usize> {
    let mut position = vec![0; order.len()];
    for (k, &unknown) in order.iter().enumerate() {
        position[unknown] = k;
    }
    position
}

/// The columns of the factor: the rows below each diagonal, and the elimination tree.
struct Columns {
    below: Vec<Vec<usize>>,
    /// First row below the diagonal; `NONE` for a column without one.
    parent: Vec<usize>,
}

impl Columns {
    fn new(unknown_count: usize, interior: usize, order: &[usize], entries: &[[usize; 2]]) -> Self {
        let position = inverse(order);
        let mut below = vec![Vec::new(); interior];
        for &[i, j] in entries {
            let (i, j) = (position[i], position[j]);
            if i != j && i.min(j) < interior {
                below[i.min(j)].push(i.max(j));
            }
        }
        let mut parent = vec![NONE; interior];
        let mut children = vec![Vec::new(); unknown_count];
        let mut mark = vec![NONE; unknown_count];
        for j in 0..interior {
            mark[j] = j;
            let mut rows = Vec::new();
            let own = std::mem::take(&mut below[j]);
            let inherited = children[j].iter().flat_map(|&child: &usize| below[child].iter().copied());
            for row in own.into_iter().chain(inherited) {
                if mark[row] != j {
                    mark[row] = j;
                    rows.push(row);
                }
            }
            rows.sort_unstable();
            if let Some(&first) = rows.first() {
                parent[j] = first;
                children[first].push(j);
            }
            below[j] = rows;
        }
        Columns { below, parent }
    }

    /// Multiply-adds of one factorisation without stored zeros.
    fn multiply_add_count(&self) -> usize {
        self.below.iter().map(|rows| rows.len() * (rows.len() + 1) / 2).sum()
    }

    /// The columns in another sequence of elimination, with descendants before their ancestors as before.
    fn renumbered(mut self, sequence: &[usize]) -> Self {
        let place = inverse(sequence);
        let renumber = |row: usize| place.get(row).copied().unwrap_or(row);
        // The rows below a diagonal are ancestors of the column: they stay sorted.
        self.below.iter_mut().flatten().for_each(|row| *row = renumber(*row));
        let below: Vec<Vec<usize>> = sequence.iter().map(|&old| std::mem::take(&mut self.below[old])).collect();
        let parent = below.iter().map(|rows| rows.first().copied().unwrap_or(NONE)).collect();
        Columns { below, parent }
    }
}

/// The columns in a sequence with every subtree contiguous and the child with the largest update last, so that it can be
/// merged into its parent.
fn postorder(columns: &Columns) -> Vec<usize> {
    let interior = columns.parent.len();
    let mut children = vec![Vec::new(); interior];
    let mut stack = Vec::new();
    for j in (0..interior).rev() {
        match columns.parent[j] {
            parent if parent < interior => children[parent].push(j),
            _ => stack.push(j),
        }
    }
    for list in &mut children {
        list.sort_by_key(|&child| (columns.below[child].len(), child));
    }
    // Visiting parents before children, last child first, gives the reverse of the order wanted.
    let mut reversed = Vec::with_capacity(interior);
    while let Some(j) = stack.pop() {
        reversed.push(j);
        stack.extend(children[j].iter().copied());
    }
    reversed.reverse();
    reversed
}

/// Sequences of columns in which each column has the pattern of the one before without its first entry.
fn fundamental(columns: &Columns) -> Vec<std::ops::Range<usize>> {
    let mut groups: Vec<std::ops::Range<usize>> = Vec::new();
    for j in 0..columns.parent.len() {
        match groups.last_mut() {
            Some(group)
                if columns.parent[group.end - 1] == j
                    && columns.below[group.end - 1].len() == columns.below[j].len() + 1 =>
            {
                group.end = j + 1;
            }
            _ => groups.push(j..j + 1),
        }
    }
    groups
}

/// Merges groups into the parents that follow them if few zeros are stored for it.
fn merge(groups: Vec<std::ops::Range<usize>>, columns: &Columns) -> Vec<std::ops::Range<usize>> {
    let nonzeros = |group: &std::ops::Range<usize>| group.clone().map(|j| columns.below[j].len() + 1).sum::<usize>();
    let stored = |group: &std::ops::Range<usize>| {
        let (width, rows) = (group.len(), columns.below[group.end - 1].len());
        width * (width + 1) / 2 + width * rows
    };
    let mut merged: Vec<std::ops::Range<usize>> = Vec::with_capacity(groups.len());
    for group in groups {
        let mut joined = group;
        while let Some(previous) = merged.last() {
            let follows = columns.parent[previous.end - 1];
            if !joined.contains(&follows) {
                break;
            }
            let candidate = previous.start..joined.end;
            let zeros = 1.0 - nonzeros(&candidate) as f64 / stored(&candidate) as f64;
            let allowed =
                MERGE.iter().find(|(width, _)| candidate.len() <= *width).map_or(MERGE_WIDE, |&(_, share)| share);
            if zeros > allowed {
                break;
            }
            joined = candidate;
            merged.pop();
        }
        merged.push(joined);
    }
    merged
}
