//! Orders compared with approximate minimum degree (`faer`), and with the known growth of fill on grids.

use super::graph::Graph;
use super::nested_dissection;
use crate::linalg::Symbolic;
use crate::linalg::symbolic::minimum_degree;

/// Vertices and pairs of adjacent ones.
#[derive(Clone)]
struct Pattern {
    count: usize,
    pairs: Vec<[usize; 2]>,
}

impl Pattern {
    /// A grid; neighbours differ by one of the steps.
    fn grid(size: [usize; 3], steps: &[[usize; 3]]) -> Self {
        let place = |[x, y, z]: [usize; 3]| (z * size[1] + y) * size[0] + x;
        let (mut pairs, count) = (Vec::new(), size.iter().product());
        for vertex in 0..count {
            let at = [vertex % size[0], vertex / size[0] % size[1], vertex / size[0] / size[1]];
            for step in steps {
                let to: [usize; 3] = std::array::from_fn(|axis| at[axis] + step[axis]);
                if (0..3).all(|axis| to[axis] < size[axis]) {
                    pairs.push([vertex, place(to)]);
                }
            }
        }
        Pattern { count, pairs }
    }

    /// A square with two triangles per cell.
    fn triangles(side: usize) -> Self {
        Self::grid([side, side, 1], &[[1, 0, 0], [0, 1, 0], [1, 1, 0]])
    }

    /// A cube with six tetrahedra per cell.
    fn tetrahedra(side: usize) -> Self {
        let steps = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]];
        Self::grid([side; 3], &steps)
    }

    fn order(&self, interior: usize) -> Vec<usize> {
        nested_dissection(interior, self.count, self.pairs.iter().copied())
    }

    fn analysed(&self, order: Vec<usize>) -> Symbolic {
        let diagonal = (0..self.count).map(|vertex| [vertex, vertex]);
        let entries: Vec<[usize; 2]> = diagonal.chain(self.pairs.iter().copied()).collect();
        Symbolic::in_best_order(self.count, 0, &entries, vec![order])
    }

    /// Multiply-adds with nested dissection over those with minimum degree.
    fn ratio(&self) -> f64 {
        let count = |order| self.analysed(order).multiply_add_count() as f64;
        count(self.order(self.count)) / count(minimum_degree(self.count, &self.pairs))
    }
}

fn assert_is_permutation(order: &[usize], count: usize) {
    let mut sorted = order.to_vec();
    sorted.sort_unstable();
    assert_eq!(sorted, (0..count).collect::<Vec<_>>());
}

/// George (1973): `31 n log2(n) / 4` entries and `829 n^1.5 / 84` multiply-adds for squares of `n` nodes by dissection
/// with crosses. A square four times as large needs 8 times the multiply-adds, and 4 (1 + 2 / log2(n)) times the entries.
#[test]
fn fill_on_a_square_grows_as_george_derived() {
    let of = |side: usize| {
        let pattern = Pattern::triangles(side);
        pattern.analysed(pattern.order(pattern.count))
    };
    let [small, large] = [64, 128].map(of);
    let growth = large.multiply_add_count() as f64 / small.multiply_add_count() as f64;
    // The lower terms of n^1.5 still matter at this size: they let the cost grow more slowly, or by a few percent faster.
    assert!((6.5..8.8).contains(&growth), "multiply-adds grow by {growth}");
    let entries = large.value_count() as f64 / small.value_count() as f64;
    assert!(entries < 4.0 * (1.0 + 2.0 / 12.0) * 1.05, "entries grow by {entries}");
    let nodes = f64::from(128 * 128);
    let bound = 829.0 / 84.0 * nodes.powf(1.5);
    assert!((large.multiply_add_count() as f64) < bound, "{} of {bound}", large.multiply_add_count());
    assert!((large.value_count() as f64) < 31.0 / 4.0 * nodes * nodes.log2());
}

#[test]
fn meshes_need_fewer_multiply_adds_than_with_minimum_degree() {
    for (name, pattern, most) in [
        ("100 x 100 triangles", Pattern::triangles(100), 1.0),
        ("12^3 tetrahedra", Pattern::tetrahedra(12), 0.95),
        ("18^3 tetrahedra", Pattern::tetrahedra(18), 0.65),
    ] {
        let ratio = pattern.ratio();
        assert!(ratio < most, "{name}: {ratio}");
    }
}

/// On a long strip minimum degree is better: the analysis takes it.
#[test]
fn the_better_order_is_taken() {
    for pattern in [Pattern::grid([300, 30, 1], &[[1, 0, 0], [0, 1, 0], [1, 1, 0]]), Pattern::triangles(100)] {
        let diagonal = (0..pattern.count).map(|vertex| [vertex, vertex]);
        let entries: Vec<[usize; 2]> = diagonal.chain(pattern.pairs.iter().copied()).collect();
        let chosen = Symbolic::new(pattern.count, 0, &entries).multiply_add_count();
        let orders = [pattern.order(pattern.count), minimum_degree(pattern.count, &pattern.pairs)];
        // Stored zeros are added after the choice: a few percent.
        let least = orders.map(|order| pattern.analysed(order).multiply_add_count()).into_iter().min().unwrap();
        assert!(chosen as f64 <= 1.05 * least as f64, "{chosen}, {least}");
    }
}

#[test]
fn every_vertex_is_ordered_once_and_always_in_the_same_place() {
    let mut two_squares = Pattern::triangles(20);
    let shifted: Vec<[usize; 2]> = two_squares.pairs.iter().map(|pair| pair.map(|vertex| vertex + 400)).collect();
    two_squares.pairs.extend(shifted);
    two_squares.count = 1000; // The last 200 are alone.
    let star = Pattern { count: 3000, pairs: (1..3000).map(|leaf| [0, leaf]).collect() };
    let path = Pattern::grid([5000, 1, 1], &[[1, 0, 0]]);
    let clique = Pattern { count: 400, pairs: (0..400).flat_map(|j| (0..j).map(move |i| [i, j])).collect() };
    let patterns = [two_squares, star, path, clique, Pattern::tetrahedra(9), Pattern::triangles(50)];
    let tiny = (0..5).map(|count| Pattern { count, pairs: (1..count).map(|vertex| [vertex - 1, vertex]).collect() });
    for pattern in patterns.into_iter().chain(tiny) {
        for interior in [pattern.count, pattern.count - pattern.count / 10] {
            let order = pattern.order(interior);
            assert_is_permutation(&order, interior);
            assert_eq!(order, pattern.order(interior));
        }
    }
}

#[test]
fn trees_have_little_fill() {
    let star = Pattern { count: 3000, pairs: (1..3000).map(|leaf| [0, leaf]).collect() };
    assert_eq!(star.order(3000).last(), Some(&0), "the centre is last");
    // Without fill a column of a path has one entry below its diagonal; between two separators it has two, which are
    // three multiply-adds instead of one.
    let path = Pattern::grid([5000, 1, 1], &[[1, 0, 0]]);
    assert!(path.ratio() < 3.0, "{}", path.ratio());
}

/// Vertices that are eliminated later count as neighbours: here they make the middle of a path the better start.
#[test]
fn later_neighbours_count_in_small_parts() {
    // The path 0 - 1 - 2, whose ends have two later neighbours each.
    let pairs = [[0, 1], [1, 2], [0, 3], [0, 4], [2, 5], [2, 6]];
    assert_eq!(nested_dissection(3, 7, pairs.into_iter())[0], 1);
}

/// König: the fewest vertices that meet all edges of a bipartite graph are as many as the edges of a largest matching.
#[test]
fn separators_meet_all_edges_between_the_halves_and_are_smallest() {
    for pattern in [Pattern::triangles(30), Pattern::tetrahedra(8)] {
        let graph = Graph::new(pattern.count, pattern.pairs.iter().copied());
        let sides = super::bisect(&graph);
        let is_between = super::cover(&graph, &sides);
        let crossing = pattern.pairs.iter().filter(|[i, j]| sides[*i] != sides[*j]);
        let mut across = vec![Vec::new(); pattern.count];
        for &[i, j] in crossing {
            assert!(is_between[i] || is_between[j]);
            let [left, right] = if sides[i] == 0 { [i, j] } else { [j, i] };
            across[left].push(right);
        }
        let mut mates = vec![None; pattern.count];
        let matched = (0..pattern.count).filter(|&left| finds_mate(left, &across, &mut mates, &mut Vec::new())).count();
        assert_eq!(is_between.iter().filter(|&&is| is).count(), matched);
    }
}

/// Extends a matching by an augmenting path from a vertex.
fn finds_mate(left: usize, across: &[Vec<usize>], mates: &mut [Option<usize>], seen: &mut Vec<usize>) -> bool {
    for &right in &across[left] {
        if seen.contains(&right) {
            continue;
        }
        seen.push(right);
        if mates[right].is_none_or(|other| finds_mate(other, across, mates, seen)) {
            mates[right] = Some(left);
            return true;
        }
    }
    false
}
