//! Two halves of a graph with few edges between them, and the fewest vertices that meet these edges.

use super::graph::{Graph, NONE, index};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Graphs with so few vertices are not made coarser.
const COARSEST: usize = 20;
/// Halves are grown from so many vertices of the coarsest graph; the best is taken.
const STARTS: usize = 4;
/// The largest share of a half.
const LARGEST: f64 = 0.7;
/// A pass ends after so many moves without a better result.
const PATIENCE: usize = 50;
const PASSES: usize = 8;

/// Every vertex on side 0 or on side 1.
struct Bisection<'a> {
    graph: &'a Graph,
    sides: Vec<u8>,
    /// The weights of the sides.
    weights: [u32; 2],
    /// The weights of each vertex's edges to the two sides.
    around: Vec<[u32; 2]>,
    /// The weight of the edges between the sides.
    cut: i64,
    /// The largest weight of a side.
    largest: u32,
}

/// The side of each vertex of a connected graph.
///
/// The graph is made coarser step by step; the halves of the coarsest are refined on each finer one (Hendrickson and
/// Leland, 1995, DOI 10.1145/224170.224228; Karypis and Kumar, 1998, DOI 10.1137/S1064827595287997).
pub(super) fn bisect(graph: &Graph) -> Vec<u8> {
    let total: u32 = graph.weights.iter().sum();
    if graph.count() > COARSEST {
        let (coarse, coarse_of) = graph.coarser(total / COARSEST as u32 * 2 + 1);
        if coarse.count() < graph.count() * 9 / 10 {
            let sides = bisect(&coarse);
            let mut finer = Bisection::new(graph, coarse_of.iter().map(|&vertex| sides[vertex as usize]).collect());
            finer.refine();
            return finer.sides;
        }
    }
    let starts = STARTS.min(graph.count());
    let grown = (0..starts).map(|start| Bisection::grown(graph, start * graph.count() / starts));
    grown.min_by_key(Bisection::cost).map_or_else(Vec::new, |best| best.sides)
}

impl<'a> Bisection<'a> {
    fn new(graph: &'a Graph, sides: Vec<u8>) -> Self {
        let mut weights = [0; 2];
        let mut around = vec![[0; 2]; graph.count()];
        let mut cut = 0;
        for (vertex, &side) in sides.iter().enumerate() {
            weights[usize::from(side)] += graph.weights[vertex];
            for (end, weight) in graph.edges(vertex) {
                around[vertex][usize::from(sides[end])] += weight;
            }
            cut += i64::from(around[vertex][usize::from(1 - side)]);
        }
        let largest = (LARGEST * f64::from(weights[0] + weights[1])) as u32;
        Bisection { graph, sides, weights, around, cut: cut / 2, largest }
    }

    /// Side 0 grows from a vertex until it has half of the weight.
    fn grown(graph: &'a Graph, first: usize) -> Self {
        let mut grown = Self::new(graph, vec![1; graph.count()]);
        let mut next = BinaryHeap::from([(0, Reverse(index(first)))]);
        while grown.weights[0] < grown.weights[1] {
            let Some((gain, Reverse(vertex))) = next.pop() else { break };
            let vertex = vertex as usize;
            if grown.sides[vertex] == 1 && (grown.gain(vertex) == gain || vertex == first) {
                grown.flip(vertex);
                let free = graph.neighbours(vertex).filter(|&end| grown.sides[end] == 1);
                next.extend(free.map(|end| (grown.gain(end), Reverse(index(end)))));
            }
        }
        grown.refine();
        grown
    }

    /// Less is better: excess of a half, then cut, then balance.
    fn cost(&self) -> (u32, i64, u32) {
        let most = self.weights[0].max(self.weights[1]);
        (most.saturating_sub(self.largest), self.cut, most)
    }

    /// How much lighter the cut becomes if a vertex changes sides.
    fn gain(&self, vertex: usize) -> i64 {
        let side = usize::from(self.sides[vertex]);
        i64::from(self.around[vertex][1 - side]) - i64::from(self.around[vertex][side])
    }

    fn is_at_border(&self, vertex: usize) -> bool {
        self.around[vertex][usize::from(1 - self.sides[vertex])] > 0
    }

    /// Moves a vertex to the other side.
    fn flip(&mut self, vertex: usize) {
        self.cut -= self.gain(vertex);
        let former = usize::from(self.sides[vertex]);
        self.sides[vertex] = 1 - self.sides[vertex];
        self.weights[former] -= self.graph.weights[vertex];
        self.weights[1 - former] += self.graph.weights[vertex];
        for (end, weight) in self.graph.edges(vertex) {
            self.around[end][former] -= weight;
            self.around[end][1 - former] += weight;
        }
    }

    fn refine(&mut self) {
        let mut moved = vec![false; self.graph.count()];
        for _ in 0..PASSES {
            if !self.pass(&mut moved) {
                break;
            }
        }
    }

    /// Moves vertices at the border, each at most once and the best first even if the cut becomes heavier, and returns
    /// to the best halves seen (Fiduccia and Mattheyses, 1982, DOI 10.1109/DAC.1982.1585498). Returns whether they are
    /// better than before. `moved` is scratch memory, all `false`.
    fn pass(&mut self, moved: &mut [bool]) -> bool {
        let mut queue = Queue::default();
        (0..self.graph.count()).filter(|&vertex| self.is_at_border(vertex)).for_each(|vertex| queue.push(self, vertex));
        let (first, mut best) = (self.cost(), self.cost());
        let (mut changes, mut kept) = (Vec::new(), 0);
        while changes.len() < kept + PATIENCE {
            let Some(vertex) = queue.pop(self, moved) else { break };
            self.flip(vertex);
            moved[vertex] = true;
            changes.push(vertex);
            if self.cost() < best {
                (best, kept) = (self.cost(), changes.len());
            }
            for end in self.graph.neighbours(vertex) {
                if !moved[end] && self.is_at_border(end) {
                    queue.push(self, end);
                }
            }
        }
        changes[kept..].iter().rev().for_each(|&vertex| self.flip(vertex));
        changes.iter().for_each(|&vertex| moved[vertex] = false);
        best < first
    }
}

/// The vertices that may move from each side, by gain. Entries with a former gain stay until they are found.
#[derive(Default)]
struct Queue([BinaryHeap<(i64, Reverse<u32>)>; 2]);

impl Queue {
    fn push(&mut self, bisection: &Bisection<'_>, vertex: usize) {
        let side = usize::from(bisection.sides[vertex]);
        self.0[side].push((bisection.gain(vertex), Reverse(index(vertex))));
    }

    /// The vertex with the largest gain whose move leaves the halves balanced, or makes them more so.
    fn pop(&mut self, bisection: &Bisection<'_>, moved: &[bool]) -> Option<usize> {
        let mut best = None;
        for side in 0..2 {
            let heap = &mut self.0[side];
            while let Some(&(gain, Reverse(vertex))) = heap.peek() {
                let vertex = vertex as usize;
                let target = bisection.weights[1 - side] + bisection.graph.weights[vertex];
                let is_current = !moved[vertex] && gain == bisection.gain(vertex);
                if is_current && (target <= bisection.largest || target <= bisection.weights[side]) {
                    best = best.max(Some((gain, bisection.weights[side], side)));
                    break;
                }
                heap.pop();
            }
        }
        let (_, _, side) = best?;
        self.0[side].pop().map(|(_, Reverse(vertex))| vertex as usize)
    }
}

/// The fewest vertices that meet all edges between the halves: as many as edges of a maximum matching (König).
pub(super) fn cover(graph: &Graph, sides: &[u8]) -> Vec<bool> {
    let mut mate = vec![NONE; graph.count()];
    // Of a vertex of side 1, the vertex of side 0 that it was reached from, in a search without an augmenting path.
    let mut reached_from = vec![NONE; graph.count()];
    let mut is_in_cover = vec![false; graph.count()];
    let across = |vertex: usize| graph.neighbours(vertex).filter(move |&end| sides[end] != sides[vertex]);
    let border: Vec<usize> = (0..graph.count()).filter(|&v| sides[v] == 0 && across(v).next().is_some()).collect();
    for &start in &border {
        is_in_cover[start] = true;
        let mut queue = vec![start];
        let mut reached = Vec::new();
        let mut next = 0;
        let mut free = None;
        'search: while let Some(&vertex) = queue.get(next) {
            next += 1;
            for end in across(vertex) {
                if reached_from[end] != NONE {
                    continue;
                }
                reached_from[end] = index(vertex);
                reached.push(end);
                if mate[end] == NONE {
                    free = Some(end);
                    break 'search;
                }
                queue.push(mate[end] as usize);
            }
        }
        let Some(free) = free else {
            // No later path enters these trees: their vertices of side 1 meet all of their edges.
            queue.iter().for_each(|&vertex| is_in_cover[vertex] = false);
            reached.iter().for_each(|&end| is_in_cover[end] = true);
            continue;
        };
        augment(&mut mate, &reached_from, free);
        reached.iter().for_each(|&end| reached_from[end] = NONE);
    }
    is_in_cover
}

/// Exchanges the edges of a path, from a vertex of side 1 back to the start of the search.
fn augment(mate: &mut [u32], reached_from: &[u32], mut end: usize) {
    loop {
        let vertex = reached_from[end] as usize;
        let former = std::mem::replace(&mut mate[vertex], index(end));
        mate[end] = index(vertex);
        if former == NONE {
            return;
        }
        end = former as usize;
    }
}
