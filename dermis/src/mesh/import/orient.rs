//! Orientation of the triangles of a surface.

use super::cursor::Problem;
use crate::geom::Point3;
use crate::geom::vector::{cross, dot, sub, triangle_area};
use std::collections::HashMap;

/// The triangles at each edge, the edge's lower node first.
type OfEdge = HashMap<[usize; 2], Vec<usize>>;

/// The connected parts of a surface: each triangle, and whether it must be reversed so that all have the same
/// orientation: outwards if the part is closed, towards +z if it is in a plane of constant z, else the present
/// orientation of most of its area.
pub(super) fn parts(nodes: &[Point3], triangles: &[[usize; 3]]) -> Result<Vec<Vec<(usize, bool)>>, Problem> {
    let of_edge = triangles_of_edges(nodes, triangles)?;
    let mut turned: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut parts = Vec::new();
    for start in 0..triangles.len() {
        if turned[start].is_none() {
            let part = flood(start, triangles, &of_edge, &mut turned, nodes)?;
            let flags = part.iter().map(|&triangle| turned[triangle] == Some(true));
            let mut part: Vec<(usize, bool)> = part.iter().copied().zip(flags).collect();
            if faces_wrong(&part, triangles, &of_edge, nodes)? {
                part.iter_mut().for_each(|(_, turn)| *turn = !*turn);
            }
            parts.push(part);
        }
    }
    Ok(parts)
}

fn edges([a, b, c]: [usize; 3]) -> [(usize, usize); 3] {
    [(a, b), (b, c), (c, a)]
}

fn key((from, to): (usize, usize)) -> [usize; 2] {
    [from.min(to), from.max(to)]
}

fn triangles_of_edges(nodes: &[Point3], triangles: &[[usize; 3]]) -> Result<OfEdge, Problem> {
    let mut of_edge = OfEdge::new();
    for (index, triangle) in triangles.iter().enumerate() {
        for edge in edges(*triangle) {
            of_edge.entry(key(edge)).or_default().push(index);
        }
    }
    let crowded = of_edge.iter().filter(|(_, list)| list.len() > 2).min();
    if let Some((edge, list)) = crowded {
        let message = format!(
            "{} triangles meet at the edge from {:?} to {:?} m, but a surface has at most two at an edge: repair it in a \
             mesh editor",
            list.len(),
            nodes[edge[0]],
            nodes[edge[1]]
        );
        return Err(Problem(message));
    }
    Ok(of_edge)
}

/// The triangles connected to `start`; `turned` is set for each that must be reversed to agree with it.
fn flood(
    start: usize,
    triangles: &[[usize; 3]],
    of_edge: &OfEdge,
    turned: &mut [Option<bool>],
    nodes: &[Point3],
) -> Result<Vec<usize>, Problem> {
    turned[start] = Some(false);
    let mut part = vec![start];
    let mut next = 0;
    while let Some(&triangle) = part.get(next) {
        next += 1;
        for edge in edges(triangles[triangle]) {
            for &other in of_edge[&key(edge)].iter().filter(|&&other| other != triangle) {
                // Neighbours with the same orientation traverse their common edge in opposite directions.
                let same_way = edges(triangles[other]).contains(&edge);
                let turn = (turned[triangle] == Some(true)) != same_way;
                match turned[other] {
                    None => {
                        turned[other] = Some(turn);
                        part.push(other);
                    }
                    Some(known) if known != turn => {
                        let message = format!("the surface has one side only: follow it from {:?} m", nodes[edge.0]);
                        return Err(Problem(message));
                    }
                    Some(_) => {}
                }
            }
        }
    }
    Ok(part)
}

/// Whether a part with consistent triangles is oriented inwards, towards -z, or against most of its area.
fn faces_wrong(
    part: &[(usize, bool)],
    triangles: &[[usize; 3]],
    of_edge: &OfEdge,
    nodes: &[Point3],
) -> Result<bool, Problem> {
    let corners = |(triangle, turn): (usize, bool)| {
        let [a, b, c] = triangles[triangle].map(|node| nodes[node]);
        if turn { [a, c, b] } else { [a, b, c] }
    };
    let origin = corners(part[0])[0];
    if part.iter().all(|&(triangle, _)| edges(triangles[triangle]).iter().all(|&edge| of_edge[&key(edge)].len() == 2)) {
        let six_volumes = part.iter().map(|&member| {
            let [a, b, c] = corners(member).map(|point| sub(point, origin));
            dot(a, cross(b, c))
        });
        return Ok(six_volumes.sum::<f64>() < 0.0);
    }
    if part.iter().all(|&member| corners(member).iter().all(|point| point[2] == origin[2])) {
        let up = |&&member: &&(usize, bool)| {
            let [a, b, c] = corners(member);
            cross(sub(b, a), sub(c, a))[2] > 0.0
        };
        let up_count = part.iter().filter(up).count();
        if let Some(folded) = part.iter().find(|member| up(member) == (2 * up_count < part.len())) {
            let message =
                format!("the triangle with the corners {:?} m is folded over its neighbours", corners(*folded));
            return Err(Problem(message));
        }
        return Ok(up_count == 0);
    }
    let area = |&(triangle, turn): &(usize, bool)| {
        let area = triangle_area(triangles[triangle].map(|node| nodes[node]));
        if turn { -area } else { area }
    };
    Ok(part.iter().map(area).sum::<f64>() < 0.0)
}
