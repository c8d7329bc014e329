//! Fill-reducing order by nested dissection.
//!
//! A small set of vertices that divides the graph of the unknowns into two halves is eliminated last; the halves are
//! divided in the same way (George, 1973, DOI 10.1137/0710032). Small parts are ordered by minimum degree.

mod bisection;
mod graph;
mod minimum_degree;
#[cfg(test)]
mod tests;

use bisection::{bisect, cover};
use graph::{Graph, NONE, index};
use minimum_degree::minimum_degree;

/// Parts of at most so many vertices are ordered by minimum degree.
const SMALL: usize = 150;

/// The first `interior` of `count` vertices in a fill-reducing order; the others are eliminated later. `pairs` are those
/// of adjacent vertices, each once.
///
/// The order depends on the arguments alone.
pub(super) fn nested_dissection(
    interior: usize,
    count: usize,
    pairs: impl Iterator<Item = [usize; 2]> + Clone,
) -> Vec<usize> {
    let graph = Graph::new(count, pairs);
    let mut place = vec![NONE; count];
    let all: Vec<u32> = (0..index(interior)).collect();
    let mut waiting = vec![(graph.part(&all, &mut place), all)];
    // From the last to the first.
    let mut reversed = Vec::with_capacity(interior);
    while let Some((part, vertices)) = waiting.pop() {
        let Some((between, parts)) = divide(&part) else {
            reversed.extend(minimum_degree(&graph, &vertices, &mut place).iter().rev().map(|&vertex| vertex as usize));
            continue;
        };
        reversed.extend(between.iter().map(|&own| vertices[own as usize] as usize));
        for own in parts {
            let smaller = part.part(&own, &mut place[..part.count()]);
            waiting.push((smaller, own.iter().map(|&own| vertices[own as usize]).collect()));
        }
    }
    reversed.reverse();
    reversed
}

/// The vertices between the parts of a graph, and those of each part; `None` if the graph is small.
fn divide(graph: &Graph) -> Option<(Vec<u32>, Vec<Vec<u32>>)> {
    if graph.count() <= SMALL {
        return None;
    }
    let components = graph.components();
    if components.len() > 1 {
        return Some((Vec::new(), components));
    }
    let sides = bisect(graph);
    let is_between = cover(graph, &sides);
    let (between, rest): (Vec<u32>, Vec<u32>) = (0..index(graph.count())).partition(|&v| is_between[v as usize]);
    let (left, right) = rest.into_iter().partition(|&vertex| sides[vertex as usize] == 0);
    Some((between, vec![left, right]))
}
