//! Electrodes of a design on a surface from a file.

use super::remesh::{self, Curve, MeshEditor, Target};
use super::{Cells, ElectrodePatch, Mesh, MeshError};
use crate::design::{Electrode, ElectrodeShape, MeshOptions};
use crate::geom::vector::{self, Point3, add, distance, normalize, scale, sub};
use crate::geom::{TriangleTree, vector::triangle_area};

/// A centre may be off the surface by this distance, or by its electrode's radius if that is larger: points are often
/// copied by hand, to about a tenth of a millimetre.
const MIN_REACH_M: f64 = 1e-3;

/// Minimum number of edges per radius of an outline; with two, a disc is a dodecagon with 4.5 % less area.
const MIN_EDGES_PER_RADIUS: f64 = 2.0;

/// Maximum number of triangles of a remeshed surface, the same as for the mesh of a design.
const MAX_TRIANGLES: usize = 2_000_000;

/// Iterations of remeshing before the electrodes are cut out, and after. According to Botsch and Kobbelt 5 to 10 are
/// enough.
const ROUNDS: usize = 6;

/// The surface with electrodes, remeshed to the sizes of the design.
///
/// A disc is the intersection of the surface with a ball of its radius around its centre, projected onto the surface:
/// its outline becomes edges. On a sphere this has exactly the area `pi r^2`.
pub(super) fn electrodes(surface: &Mesh, electrodes: &[Electrode], options: MeshOptions) -> Result<Mesh, MeshError> {
    let Cells::Triangles(triangles) = &surface.cells else {
        return Err(MeshError::Generate(
            "the body is a volume: give its electrodes as physical groups `electrode_<n>` of triangles in the mesh file"
                .into(),
        ));
    };
    let tree = TriangleTree::new(triangles.iter().map(|t| t.map(|node| surface.nodes[node])));
    let spots = spots(&tree, electrodes)?;
    let sizes = Sizes::new(surface, &spots, options);
    let size = |point: Point3| sizes.at(point);
    let onto_curve = |point: Point3, curve: Curve| match curve {
        // The midpoint of a straight part of a crease is on it.
        Curve::Crease => point,
        Curve::Outline(electrode) => onto_outline(&tree, &spots[electrode], point),
    };
    let target = Target { surface: &tree, size: &size, onto_curve: &onto_curve, most_triangles: MAX_TRIANGLES };
    sizes.check()?;
    let mut editor = MeshEditor::new(surface.nodes.clone(), triangles.clone());
    remesh::find_creases(&mut editor);
    refine(&mut editor, &target)?;
    for (electrode, spot) in spots.iter().enumerate() {
        match spot.radius_m {
            Some(radius_m) => cut_disc(&mut editor, &tree, electrode, spot, radius_m)?,
            None => put_point(&mut editor, spot, &size),
        }
    }
    refine(&mut editor, &target)?;
    let mut mesh = finished(&editor, &spots)?;
    mesh.regions = regions(surface, &tree, &mesh);
    Ok(mesh)
}

/// The regions of the surface on its new cells: a cell belongs to the region of its centre.
fn regions(surface: &Mesh, tree: &TriangleTree, mesh: &Mesh) -> Vec<(String, Vec<usize>)> {
    if surface.regions.is_empty() {
        return Vec::new();
    }
    let old_cell: Vec<usize> =
        (0..mesh.cell_count()).map(|cell| tree.nearest(mesh.cell_centre(cell)).triangle).collect();
    let on_new_cells = |(name, cells): &(String, Vec<usize>)| {
        let members: std::collections::HashSet<usize> = cells.iter().copied().collect();
        (name.clone(), (0..mesh.cell_count()).filter(|&cell| members.contains(&old_cell[cell])).collect())
    };
    surface.regions.iter().map(on_new_cells).collect()
}

fn refine(editor: &mut MeshEditor, target: &Target<'_>) -> Result<(), MeshError> {
    if remesh::remesh(editor, target, ROUNDS) { Ok(()) } else { Err(too_fine()) }
}

fn too_fine() -> MeshError {
    MeshError::Generate(format!(
        "a mesh this fine would have more than {MAX_TRIANGLES} triangles: make `max_edge_m` and `electrode_edge_m` \
         larger, or check the body's `unit_m`"
    ))
}

/// An electrode's position on the surface.
#[derive(Debug, Clone, Copy)]
struct Spot {
    centre: Point3,
    /// None for a point.
    radius_m: Option<f64>,
}

/// The centres of the electrodes, projected onto the surface.
fn spots(tree: &TriangleTree, electrodes: &[Electrode]) -> Result<Vec<Spot>, MeshError> {
    let mut spots = Vec::new();
    for (index, electrode) in electrodes.iter().enumerate() {
        let radius_m = match electrode.shape {
            ElectrodeShape::Disc { radius_m } => Some(radius_m),
            ElectrodeShape::Point => None,
            ElectrodeShape::Arc { .. } | ElectrodeShape::Group => {
                let message =
                    format!("electrode {index}: the mesh file has no electrodes, so it must be a disc or a point");
                return Err(MeshError::Generate(message));
            }
        };
        let nearest = tree.nearest(electrode.centre_m);
        let reach_m = radius_m.unwrap_or(0.0).max(MIN_REACH_M);
        // A centre that is not a number has infinite distance.
        if nearest.distance_m > reach_m {
            let message = format!(
                "electrode {index}: its centre {:?} m lies {:.4} m off the body, more than {reach_m} m; the nearest point \
                 of the body is {:?} m",
                electrode.centre_m, nearest.distance_m, nearest.point
            );
            return Err(MeshError::Generate(message));
        }
        spots.push(Spot { centre: nearest.point, radius_m });
    }
    check_apart(&spots)?;
    Ok(spots)
}

fn check_apart(spots: &[Spot]) -> Result<(), MeshError> {
    for (second, b) in spots.iter().enumerate() {
        for (first, a) in spots[..second].iter().enumerate() {
            let (apart_m, needed_m) =
                (distance(a.centre, b.centre), a.radius_m.unwrap_or(0.0) + b.radius_m.unwrap_or(0.0));
            if apart_m <= needed_m {
                let message = format!(
                    "electrodes {first} and {second} overlap: on the body their centres are {apart_m:.5} m apart, but their \
                     radii sum to {needed_m} m"
                );
                return Err(MeshError::Generate(message));
            }
        }
    }
    Ok(())
}

/// The target edge lengths: that of the nearest outline, growing with the distance from it.
struct Sizes<'a> {
    area_m2: f64,
    spots: &'a [Spot],
    longest_m: f64,
    outline_m: Vec<f64>,
    growth: f64,
}

impl<'a> Sizes<'a> {
    fn new(surface: &Mesh, spots: &'a [Spot], options: MeshOptions) -> Self {
        let area_m2: f64 = (0..surface.cell_count()).map(|cell| surface.cell_measure(cell)).sum();
        // The default is the same as on generated bodies: a fiftieth of the side of a square of the same area.
        let longest_m = if options.max_edge_m.is_finite() { options.max_edge_m } else { area_m2.sqrt() / 50.0 };
        let asked_m = options.electrode_edge_m.min(longest_m);
        let outline_m = spots.iter().map(|spot| match spot.radius_m {
            Some(radius_m) => asked_m.min(radius_m / MIN_EDGES_PER_RADIUS),
            None => asked_m.min(longest_m / 4.0),
        });
        Sizes { area_m2, spots, longest_m, outline_m: outline_m.collect(), growth: options.growth }
    }

    /// Refuses invalid lengths, and also those that would fail only after minutes: equilateral triangles of the longest
    /// edge length would already be too many.
    fn check(&self) -> Result<(), MeshError> {
        let lengths_m = self.outline_m.iter().chain([&self.longest_m]);
        for &length_m in lengths_m {
            if !(length_m.is_finite() && length_m > 0.0) {
                return Err(MeshError::Generate(format!("edges of {length_m} m: their length must be positive")));
            }
        }
        if !(self.growth.is_finite() && self.growth >= 0.0) {
            return Err(MeshError::Generate(format!("growth is {}: it must not be negative", self.growth)));
        }
        let triangle_m2 = 3f64.sqrt() / 4.0 * self.longest_m * self.longest_m;
        if self.area_m2 / triangle_m2 > MAX_TRIANGLES as f64 { Err(too_fine()) } else { Ok(()) }
    }

    fn at(&self, point: Point3) -> f64 {
        let mut size_m = self.longest_m;
        for (spot, outline_m) in self.spots.iter().zip(&self.outline_m) {
            let distance_m = (distance(point, spot.centre) - spot.radius_m.unwrap_or(0.0)).abs();
            size_m = size_m.min(outline_m + self.growth * distance_m);
        }
        size_m
    }
}

/// The point of an electrode's outline near `point`: on the surface, and at the radius from the centre.
fn onto_outline(tree: &TriangleTree, spot: &Spot, point: Point3) -> Point3 {
    let Some(radius_m) = spot.radius_m else { return spot.centre };
    let mut at = point;
    // Alternating projections onto ball and surface; where they intersect steeply each iteration adds digits, and the
    // distance after the last one is within the chord's own error.
    for _ in 0..30 {
        let on_ball = add(spot.centre, scale(normalize(sub(at, spot.centre)), radius_m));
        at = tree.nearest(on_ball).point;
        if (distance(at, spot.centre) - radius_m).abs() < 1e-9 * radius_m {
            break;
        }
    }
    at
}

/// Cuts a disc's outline into the mesh and marks the triangles inside.
fn cut_disc(
    editor: &mut MeshEditor,
    tree: &TriangleTree,
    electrode: usize,
    spot: &Spot,
    radius_m: f64,
) -> Result<(), MeshError> {
    let height = |editor: &MeshEditor, point: usize| distance(editor.points[point], spot.centre) - radius_m;
    // Tolerance of the distance from the ball: far below any edge length, far above rounding.
    let on_outline_m = 1e-6 * radius_m;
    snap_to_outline(editor, tree, spot, on_outline_m);
    for [a, b] in editor.edges() {
        let (from, to) = (height(editor, a), height(editor, b));
        let crosses = from.min(to) < -on_outline_m && from.max(to) > on_outline_m;
        if !crosses || editor.at_edge(a, b).is_empty() {
            continue;
        }
        let crossing = crossing(editor.points[a], editor.points[b], spot.centre, radius_m);
        // A point on a crease stays on it.
        let position = match editor.curve(a, b) {
            Some(_) => crossing,
            None => onto_outline(tree, spot, crossing),
        };
        let middle = editor.split(a, b, position);
        if editor.curve(a, middle).is_some() {
            editor.pin(middle);
        }
    }
    let is_inside = |editor: &MeshEditor, triangle: usize| {
        let corners = editor.triangles[triangle];
        let lowest = corners.iter().map(|&point| height(editor, point)).fold(f64::INFINITY, f64::min);
        let centre = vector::centroid(&editor.corners(triangle));
        if lowest < -on_outline_m { true } else { distance(centre, spot.centre) < radius_m && lowest <= on_outline_m }
    };
    let disc = connected_disc(editor, spot, is_inside);
    if disc.is_empty() {
        return Err(MeshError::Generate(format!(
            "electrode {electrode}: no triangle lies within its radius {radius_m} m"
        )));
    }
    for &triangle in &disc {
        if let Some(other) = editor.covered_by[triangle].replace(electrode) {
            return Err(MeshError::Generate(format!("electrodes {other} and {electrode} overlap on the body")));
        }
    }
    mark_outline(editor, electrode, &disc);
    Ok(())
}

/// Moves points close to the outline onto it, so that cutting leaves no slivers.
fn snap_to_outline(editor: &mut MeshEditor, tree: &TriangleTree, spot: &Spot, on_outline_m: f64) {
    let radius_m = spot.radius_m.unwrap_or(0.0);
    // A third of the distance to the next point on the other side.
    const NEAR: f64 = 1.0 / 3.0;
    for point in 0..editor.points.len() {
        if !editor.is_free(point) || editor.around(point).is_empty() {
            continue;
        }
        let height = |point: usize| distance(editor.points[point], spot.centre) - radius_m;
        let own = height(point);
        if own.abs() <= on_outline_m || own.abs() > radius_m {
            continue;
        }
        let near_share = |&other: &usize| {
            let theirs = height(other);
            own * theirs < 0.0 && own.abs() < NEAR * (own.abs() + theirs.abs())
        };
        if editor.neighbours(point).iter().any(near_share) {
            let position = onto_outline(tree, spot, editor.points[point]);
            editor.shift(point, position);
        }
    }
}

/// The intersection of a straight edge with the ball: the root of `|a + t (b - a) - c| = r` between its ends.
fn crossing(a: Point3, b: Point3, centre: Point3, radius_m: f64) -> Point3 {
    let (mut inside, mut outside) = if distance(a, centre) < radius_m { (a, b) } else { (b, a) };
    for _ in 0..60 {
        let middle = scale(add(inside, outside), 0.5);
        if distance(middle, centre) < radius_m {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    outside
}

/// The triangles inside the outline that are connected with the one at the centre: a ball can also contain a part of
/// the far side of a thin body.
fn connected_disc(editor: &MeshEditor, spot: &Spot, is_inside: impl Fn(&MeshEditor, usize) -> bool) -> Vec<usize> {
    let offset = |triangle: usize| {
        let nearest = crate::geom::surface::nearest_on_triangle(spot.centre, editor.corners(triangle));
        distance(nearest, spot.centre)
    };
    let inside = editor.alive().filter(|&triangle| is_inside(editor, triangle));
    let Some(start) = inside.min_by(|&a, &b| offset(a).total_cmp(&offset(b))) else { return Vec::new() };
    let mut disc = vec![start];
    let mut seen = std::collections::BTreeSet::from([start]);
    let mut next = 0;
    while next < disc.len() {
        let [a, b, c] = editor.triangles[disc[next]];
        next += 1;
        for (from, to) in [(a, b), (b, c), (c, a)] {
            for other in editor.at_edge(from, to) {
                if is_inside(editor, other) && seen.insert(other) {
                    disc.push(other);
                }
            }
        }
    }
    disc
}

/// Marks the edges between a disc and the rest as curves, and pins the points where they intersect a crease.
fn mark_outline(editor: &mut MeshEditor, electrode: usize, disc: &[usize]) {
    for &triangle in disc {
        let [a, b, c] = editor.triangles[triangle];
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let is_rim = editor.at_edge(from, to).iter().any(|&t| editor.covered_by[t] != Some(electrode));
            if is_rim && editor.curve(from, to).is_none() {
                editor.set_curve(from, to, Curve::Outline(electrode));
            }
        }
    }
    for &triangle in disc {
        for point in editor.triangles[triangle] {
            let ends = editor.curves_at(point);
            let is_mixed = ends.iter().any(|(_, curve)| *curve != ends[0].1);
            if ends.len() > 2 || is_mixed {
                editor.pin(point);
            }
        }
    }
}

/// Creates a point electrode's node at its position: the nearest point of the mesh is moved there, or a new one is
/// inserted.
fn put_point(editor: &mut MeshEditor, spot: &Spot, size: &dyn Fn(Point3) -> f64) {
    let offset = |&point: &usize| distance(editor.points[point], spot.centre);
    let near = (0..editor.points.len()).filter(|&point| !editor.around(point).is_empty());
    let nearest = near.min_by(|a, b| offset(a).total_cmp(&offset(b)));
    // Closer than this, a new point would make too short an edge.
    if let Some(point) = nearest.filter(|point| offset(point) < 0.4 * size(spot.centre))
        && (editor.points[point] == spot.centre || (editor.is_free(point) && editor.shift(point, spot.centre)))
    {
        editor.pin(point);
        return;
    }
    let off = |triangle: usize| {
        let nearest = crate::geom::surface::nearest_on_triangle(spot.centre, editor.corners(triangle));
        distance(nearest, spot.centre)
    };
    let home = editor.alive().min_by(|&a, &b| off(a).total_cmp(&off(b)));
    if let Some(triangle) = home {
        let point = match nearest_edge(editor, triangle, spot.centre) {
            Some([a, b]) => editor.split(a, b, spot.centre),
            None => editor.split_triangle(triangle, spot.centre),
        };
        editor.pin(point);
    }
}

/// The edge of a triangle on which a point is located, within a tolerance.
fn nearest_edge(editor: &MeshEditor, triangle: usize, point: Point3) -> Option<[usize; 2]> {
    let [a, b, c] = editor.triangles[triangle];
    let whole = triangle_area(editor.corners(triangle));
    [[a, b], [b, c], [c, a]].into_iter().find(|&[from, to]| {
        // A hundredth of the height: with a smaller distance an own triangle would be a sliver.
        triangle_area([editor.points[from], editor.points[to], point]) < 0.01 * whole
    })
}

/// The mesh with its electrodes.
fn finished(editor: &MeshEditor, spots: &[Spot]) -> Result<Mesh, MeshError> {
    let (nodes, triangles, covered_by) = editor.compact();
    let mut electrodes = Vec::new();
    for (index, spot) in spots.iter().enumerate() {
        let patch = match spot.radius_m {
            Some(_) => {
                let cells = (0..triangles.len()).filter(|&triangle| covered_by[triangle] == Some(index)).collect();
                ElectrodePatch::Cells(cells)
            }
            None => {
                let node = nodes.iter().position(|&node| node == spot.centre);
                ElectrodePatch::Node(node.ok_or_else(|| {
                    MeshError::Generate(format!("electrode {index}: no node could be put at {:?} m", spot.centre))
                })?)
            }
        };
        electrodes.push(patch);
    }
    Ok(Mesh { nodes, cells: Cells::Triangles(triangles), electrodes, regions: Vec::new() })
}
