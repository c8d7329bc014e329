//! Isotropic remeshing of a surface to a target edge length (Botsch and Kobbelt, A remeshing approach to
//! multiresolution modeling, 2004, DOI 10.1145/1057432.1057457, section 4): long edges are split, short ones collapsed,
//! edges flipped until the mesh is Delaunay, points moved towards the mean of their neighbours and projected back onto
//! the surface.

mod editor;

pub(crate) use editor::{Curve, MeshEditor};

use editor::angle;

use crate::geom::vector::{add, cross, dot, norm, scale, sub};
use crate::geom::{Point3, TriangleTree};
use std::f64::consts::PI;

/// The target of remeshing.
pub(crate) struct Target<'a> {
    /// The surface on which the points stay.
    pub surface: &'a TriangleTree,
    /// The target edge length at a point, m.
    pub size: &'a dyn Fn(Point3) -> f64,
    /// Projects a point near a curve onto it.
    pub onto_curve: &'a dyn Fn(Point3, Curve) -> Point3,
    /// Maximum number of triangles.
    pub most_triangles: usize,
}

/// An edge longer than this multiple of the target length is split, one shorter than [`SHORT`] collapsed: with these
/// values neither reverses the other (Botsch and Kobbelt, section 4).
const LONG: f64 = 4.0 / 3.0;
const SHORT: f64 = 4.0 / 5.0;

/// Triangles with a larger angle between them (cosine of 40 degrees) form a crease, which remeshing keeps.
const CREASE: f64 = 0.766;

/// A crease that turns by more than this angle at a point (cosine of 40 degrees) has a corner there.
const CORNER: f64 = 0.766;

/// Marks the boundary and the sharp edges as curves, and pins their corners.
pub(crate) fn find_creases(editor: &mut MeshEditor) {
    for [a, b] in editor.edges() {
        let is_crease = match editor.at_edge(a, b)[..] {
            [one, other] => {
                let (one, other) = (editor.area_vector(one), editor.area_vector(other));
                dot(one, other) < CREASE * norm(one) * norm(other)
            }
            _ => true,
        };
        if is_crease {
            editor.set_curve(a, b, Curve::Crease);
        }
    }
    for point in 0..editor.points.len() {
        let is_corner = match *editor.curves_at(point) {
            [] => false,
            [(a, _), (b, _)] => {
                let here = editor.points[point];
                let (u, v) = (sub(here, editor.points[a]), sub(editor.points[b], here));
                dot(u, v) < CORNER * norm(u) * norm(v)
            }
            _ => true,
        };
        if is_corner {
            editor.pin(point);
        }
    }
}

/// Remeshes in some iterations; false if the mesh would have more triangles than allowed.
pub(crate) fn remesh(editor: &mut MeshEditor, target: &Target<'_>, rounds: usize) -> bool {
    for _ in 0..rounds {
        if !split_long(editor, target) {
            return false;
        }
        collapse_short(editor, target);
        flip_to_delaunay(editor);
        relax(editor, target);
        flip_to_delaunay(editor);
    }
    true
}

fn split_long(editor: &mut MeshEditor, target: &Target<'_>) -> bool {
    // Each pass halves the longest edges; 60 are more than enough for any size.
    for _ in 0..60 {
        let mut changed = false;
        for [a, b] in editor.edges() {
            let middle = editor.middle(a, b);
            let is_there = !editor.at_edge_unordered(a, b).is_empty();
            if !is_there || editor.length(a, b) <= LONG * (target.size)(middle) {
                continue;
            }
            let position = match editor.curve(a, b) {
                Some(curve) => (target.onto_curve)(middle, curve),
                None => target.surface.nearest(middle).point,
            };
            editor.split(a, b, position);
            changed = true;
            if editor.triangles.len() > target.most_triangles {
                return false;
            }
        }
        if !changed {
            break;
        }
        flip_to_delaunay(editor);
    }
    true
}

fn collapse_short(editor: &mut MeshEditor, target: &Target<'_>) {
    let longest = |middle: Point3| LONG * (target.size)(middle);
    for [a, b] in editor.edges() {
        let is_there = !editor.at_edge_unordered(a, b).is_empty();
        if is_there && editor.length(a, b) < SHORT * (target.size)(editor.middle(a, b)) {
            let _ = editor.collapse(b, a, longest) || editor.collapse(a, b, longest);
        }
    }
}

/// Flips edges whose opposite angles sum to more than half a turn.
fn flip_to_delaunay(editor: &mut MeshEditor) {
    // A plane needs few passes; on curved surfaces flips may repeat in a cycle, and some edges then stay unchanged.
    for _ in 0..20 {
        let mut changed = false;
        for [a, b] in editor.edges() {
            if opposite_angles(editor, a, b).is_some_and(|sum| sum > PI + 1e-9) {
                changed |= editor.flip(a, b);
            }
        }
        if !changed {
            break;
        }
    }
}

fn opposite_angles(editor: &MeshEditor, a: usize, b: usize) -> Option<f64> {
    let [first, second] = editor.at_edge_unordered(a, b)[..] else { return None };
    let at = |triangle: usize| {
        let corner = editor.opposite(triangle, a, b)?;
        Some(angle([corner, a, b].map(|point| editor.points[point])))
    };
    Some(at(first)? + at(second)?)
}

/// Moves free points towards the mean of the triangles around them, along the surface, and points of outlines towards
/// the mean of their neighbours on the outline.
fn relax(editor: &mut MeshEditor, target: &Target<'_>) {
    for point in 0..editor.points.len() {
        if editor.around(point).is_empty() || editor.is_pinned(point) {
            continue;
        }
        match *editor.curves_at(point) {
            [] => {
                let aim = target.surface.nearest(relaxed(editor, target, point)).point;
                editor.shift(point, aim);
            }
            [(a, Curve::Outline(one)), (b, Curve::Outline(other))] if one == other => {
                let aim = (target.onto_curve)(editor.middle(a, b), Curve::Outline(one));
                editor.shift(point, aim);
            }
            [(a, Curve::Crease), (b, Curve::Crease)] if is_straight(editor, a, point, b) => {
                let aim = editor.middle(a, b);
                editor.shift(point, aim);
            }
            _ => {}
        }
    }
}

/// Whether a point is on the line between two others, within a body's accuracy: moving it there changes the line by
/// less than a thousandth of its length.
fn is_straight(editor: &MeshEditor, a: usize, point: usize, b: usize) -> bool {
    let [a, point, b] = [a, point, b].map(|point| editor.points[point]);
    let (u, v) = (sub(point, a), sub(b, point));
    norm(cross(u, v)) < 1e-3 * norm(u) * norm(v)
}

/// The weighted mean of the triangles around a point, with larger weights for triangles larger than the target size, in
/// the point's tangent plane.
fn relaxed(editor: &MeshEditor, target: &Target<'_>, point: usize) -> Point3 {
    let here = editor.points[point];
    let mut normal = [0.0; 3];
    let mut mean = [0.0; 3];
    let mut weight_sum = 0.0;
    for &triangle in editor.around(point) {
        let [a, b, c] = editor.corners(triangle);
        let centre = scale(add(add(a, b), c), 1.0 / 3.0);
        let area_vector = cross(sub(b, a), sub(c, a));
        let size = (target.size)(centre);
        let weight = norm(area_vector) / (size * size);
        normal = add(normal, area_vector);
        mean = add(mean, scale(sub(centre, here), weight));
        weight_sum += weight;
    }
    let length = norm(normal);
    if !(weight_sum > 0.0 && length > 0.0) {
        return here;
    }
    let step = scale(mean, 1.0 / weight_sum);
    let normal = scale(normal, 1.0 / length);
    add(here, sub(step, scale(normal, dot(step, normal))))
}
