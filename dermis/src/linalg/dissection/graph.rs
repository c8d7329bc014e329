//! Graphs of unknowns, their parts and coarser versions.

use std::cmp::Reverse;
use std::ops::Range;

/// No vertex.
pub(super) const NONE: u32 = u32::MAX;

/// An undirected graph. A vertex stands for `weights` unknowns, an edge for `edge_weights` entries.
#[derive(Debug, Clone, Default)]
pub(super) struct Graph {
    /// Where the edges of each vertex start, and their end.
    starts: Vec<u32>,
    ends: Vec<u32>,
    edge_weights: Vec<u32>,
    pub weights: Vec<u32>,
}

impl Graph {
    /// From pairs of different vertices, each at most once.
    pub(super) fn new(count: usize, pairs: impl Iterator<Item = [usize; 2]> + Clone) -> Self {
        let mut starts = vec![0; count + 1];
        for vertex in pairs.clone().flatten() {
            starts[vertex + 1] += 1;
        }
        for vertex in 0..count {
            starts[vertex + 1] += starts[vertex];
        }
        let mut next = starts.clone();
        let mut ends = vec![0; starts[count] as usize];
        for [i, j] in pairs {
            for (from, to) in [(i, j), (j, i)] {
                ends[next[from] as usize] = index(to);
                next[from] += 1;
            }
        }
        Graph { starts, edge_weights: vec![1; ends.len()], ends, weights: vec![1; count] }
    }

    /// Number of vertices.
    pub(super) fn count(&self) -> usize {
        self.weights.len()
    }

    fn range(&self, vertex: usize) -> Range<usize> {
        self.starts[vertex] as usize..self.starts[vertex + 1] as usize
    }

    /// The other ends of a vertex's edges.
    pub(super) fn neighbours(&self, vertex: usize) -> impl Iterator<Item = usize> + '_ {
        self.ends[self.range(vertex)].iter().map(|&end| end as usize)
    }

    /// The same with the weights of the edges.
    pub(super) fn edges(&self, vertex: usize) -> impl Iterator<Item = (usize, u32)> + '_ {
        let range = self.range(vertex);
        self.ends[range.clone()].iter().zip(&self.edge_weights[range]).map(|(&end, &weight)| (end as usize, weight))
    }

    /// Some vertices of a graph without weights, and the edges between them. `place` is scratch memory, a number per
    /// vertex, all `NONE`.
    pub(super) fn part(&self, vertices: &[u32], place: &mut [u32]) -> Graph {
        for (new, &old) in (0..).zip(vertices) {
            place[old as usize] = new;
        }
        let mut part = Graph { starts: Vec::with_capacity(vertices.len() + 1), ..Graph::default() };
        part.starts.push(0);
        for &old in vertices {
            part.ends.extend(self.neighbours(old as usize).map(|end| place[end]).filter(|&end| end != NONE));
            part.starts.push(index(part.ends.len()));
        }
        part.edge_weights = vec![1; part.ends.len()];
        part.weights = vec![1; vertices.len()];
        for &old in vertices {
            place[old as usize] = NONE;
        }
        part
    }

    /// The vertices of each connected component.
    pub(super) fn components(&self) -> Vec<Vec<u32>> {
        let mut seen = vec![false; self.count()];
        let mut components = Vec::new();
        for first in 0..self.count() {
            if std::mem::replace(&mut seen[first], true) {
                continue;
            }
            let mut found = vec![index(first)];
            let mut next = 0;
            while let Some(&vertex) = found.get(next) {
                next += 1;
                let ends = self.neighbours(vertex as usize);
                found.extend(ends.filter(|&end| !std::mem::replace(&mut seen[end], true)).map(index));
            }
            components.push(found);
        }
        components
    }

    /// The graph in which pairs of adjacent vertices are joined, and the new vertex of each old one: each vertex with
    /// the free neighbour at its heaviest edge. The joined vertices stand for at most `largest` unknowns.
    pub(super) fn coarser(&self, largest: u32) -> (Graph, Vec<u32>) {
        let mut coarse_of = vec![NONE; self.count()];
        let mut pairs: Vec<[u32; 2]> = Vec::with_capacity(self.count());
        for vertex in scattered(self.count()) {
            if coarse_of[vertex] != NONE {
                continue;
            }
            let room = largest.saturating_sub(self.weights[vertex]);
            let mate = self
                .edges(vertex)
                .filter(|&(end, _)| coarse_of[end] == NONE && self.weights[end] <= room)
                .max_by_key(|&(end, weight)| (weight, Reverse(self.weights[end])))
                .map_or(vertex, |(end, _)| end);
            coarse_of[vertex] = index(pairs.len());
            coarse_of[mate] = index(pairs.len());
            pairs.push([index(vertex), index(mate)]);
        }
        (self.joined(&pairs, &coarse_of), coarse_of)
    }

    /// The graph of pairs; a vertex alone is a pair with itself.
    fn joined(&self, pairs: &[[u32; 2]], coarse_of: &[u32]) -> Graph {
        let mut coarse = Graph { starts: Vec::with_capacity(pairs.len() + 1), ..Graph::default() };
        coarse.starts.push(0);
        let mut place = vec![NONE; pairs.len()];
        for (new, &[first, second]) in (0..).zip(pairs) {
            let members = if first == second { &[first][..] } else { &[first, second] };
            let start = coarse.ends.len();
            for (end, weight) in members.iter().flat_map(|&old| self.edges(old as usize)) {
                let end = coarse_of[end];
                let at = place[end as usize];
                if end == new {
                    continue;
                }
                if at != NONE && at as usize >= start {
                    coarse.edge_weights[at as usize] += weight;
                } else {
                    place[end as usize] = index(coarse.ends.len());
                    coarse.ends.push(end);
                    coarse.edge_weights.push(weight);
                }
            }
            coarse.starts.push(index(coarse.ends.len()));
            coarse.weights.push(members.iter().map(|&old| self.weights[old as usize]).sum());
        }
        coarse
    }
}

/// All numbers below `count` in an order in which neighbours are far apart: pairs that follow the order of the nodes of
/// a mesh would become long and thin.
fn scattered(count: usize) -> impl Iterator<Item = usize> {
    let coprime = |step: &usize| greatest_common_divisor(*step, count) == 1;
    let step = (count * 618 / 1000 + 1..).find(coprime).unwrap_or(1);
    (0..count).map(move |k| k * step % count)
}

fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

pub(super) fn index(value: usize) -> u32 {
    u32::try_from(value).expect("a graph of four thousand million entries fits no memory")
}
