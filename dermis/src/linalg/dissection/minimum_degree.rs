//! Minimum degree for a few vertices.

use super::graph::{Graph, NONE, index};

/// Some vertices in an order of minimum degree. Their other neighbours, which are eliminated later, count too. `place`
/// is scratch memory, a number per vertex of the graph, all `NONE`.
///
/// The elimination graph is a matrix of bits: for a hundred vertices, a row is a few words.
pub(super) fn minimum_degree(graph: &Graph, vertices: &[u32], place: &mut [u32]) -> Vec<u32> {
    let mut matrix = BitMatrix::new(graph, vertices, place);
    let mut waiting: Vec<(u32, u32)> = (0..).zip(vertices).map(|(row, _)| (matrix.degree(row as usize), row)).collect();
    let mut order = Vec::with_capacity(vertices.len());
    while let Some(next) = (0..waiting.len()).min_by_key(|&at| waiting[at]) {
        let (_, row) = waiting.swap_remove(next);
        order.push(vertices[row as usize]);
        matrix.eliminate(row as usize);
        for (degree, other) in &mut waiting {
            if matrix.pivot_has(*other as usize) {
                *degree = matrix.degree(*other as usize);
            }
        }
    }
    order
}

/// A symmetric matrix of bits.
struct BitMatrix {
    words: usize,
    rows: Vec<u64>,
    /// The row eliminated last.
    pivot: Vec<u64>,
}

impl BitMatrix {
    /// Which of the vertices and their neighbours are adjacent; the vertices first.
    fn new(graph: &Graph, vertices: &[u32], place: &mut [u32]) -> Self {
        let mut all = vertices.to_vec();
        for (row, &vertex) in (0..).zip(vertices) {
            place[vertex as usize] = row;
        }
        for end in vertices.iter().flat_map(|&vertex| graph.neighbours(vertex as usize)) {
            if place[end] == NONE {
                place[end] = index(all.len());
                all.push(index(end));
            }
        }
        let words = all.len().div_ceil(64);
        let mut matrix = BitMatrix { words, rows: vec![0; all.len() * words], pivot: vec![0; words] };
        for (row, &vertex) in vertices.iter().enumerate() {
            for end in graph.neighbours(vertex as usize) {
                matrix.set(row, place[end] as usize);
                matrix.set(place[end] as usize, row);
            }
        }
        for &vertex in &all {
            place[vertex as usize] = NONE;
        }
        matrix
    }

    fn set(&mut self, row: usize, column: usize) {
        self.rows[row * self.words + column / 64] |= 1 << (column % 64);
    }

    fn degree(&self, row: usize) -> u32 {
        self.rows[row * self.words..][..self.words].iter().map(|word| word.count_ones()).sum()
    }

    fn pivot_has(&self, column: usize) -> bool {
        self.pivot[column / 64] >> (column % 64) & 1 == 1
    }

    /// Joins all neighbours of a vertex and removes it.
    fn eliminate(&mut self, row: usize) {
        self.pivot.copy_from_slice(&self.rows[row * self.words..][..self.words]);
        for word in 0..self.words {
            let mut bits = self.pivot[word];
            while bits != 0 {
                let other = word * 64 + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let target = &mut self.rows[other * self.words..][..self.words];
                target.iter_mut().zip(&self.pivot).for_each(|(target, &pivot)| *target |= pivot);
                target[other / 64] &= !(1 << (other % 64));
                target[row / 64] &= !(1 << (row % 64));
            }
        }
    }
}
