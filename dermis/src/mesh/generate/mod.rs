//! Mesh generation for a design: cylinder, disk, rectangle.
//!
//! The body is unrolled. Its edges and the electrodes' outlines are divided into edges of the length given by the
//! [sizing](sizing). Points are inserted between them and relaxed on their Delaunay triangulation. The result is
//! deterministic.

mod fill;
mod layout;
mod outline;
mod sizing;
mod triangulate;

use crate::design::{MeshOptions, SkinDesign};
use crate::geom::{Chart, Point2};
use crate::mesh::{Cells, ElectrodePatch, Mesh, MeshError, import};
use layout::{Layout, Marking};
use outline::Outline;
use sizing::Sizing;
use std::collections::HashMap;

/// Maximum number of nodes: more are a mistake in the options, as no solver of this crate could handle them.
const NODES_AT_MOST: f64 = 2e6;

impl Mesh {
    /// The mesh of a design: a cylinder, disk or rectangle with the design's mesh sizes, or the mesh of its file.
    ///
    /// # Errors
    /// Electrodes or options for which no mesh can be generated; a file without a usable mesh.
    pub fn generate(design: &SkinDesign) -> Result<Self, MeshError> {
        design.check().map_err(|error| MeshError::Generate(error.to_string()))?;
        match design.body.chart() {
            Some(chart) => lay(&chart, design, &design.mesh),
            None => import::from_design(design),
        }
    }
}

/// Cells across the shorter side of a region.
pub(super) const CELLS_ACROSS: f64 = 4.0;

fn lay(chart: &Chart, design: &SkinDesign, options: &MeshOptions) -> Result<Mesh, MeshError> {
    let smallest = chart.area_m2() / (options.max_edge_m * options.max_edge_m);
    if smallest > NODES_AT_MOST {
        return Err(MeshError::Generate(format!(
            "edges of {} m make a mesh of more than {smallest:.0} nodes: make max_edge_m longer",
            options.max_edge_m
        )));
    }
    let outlines = design
        .electrodes
        .iter()
        .enumerate()
        .map(|(index, electrode)| {
            Outline::new(chart, electrode, options.electrode_edge_m).ok_or_else(|| {
                MeshError::Generate(format!("electrode {index} is a group of a mesh file, but the body is not a file"))
            })
        })
        .collect::<Result<Vec<_>, _>>()?;
    let sizing = Sizing::new(chart, &outlines, &design.sheet.regions, options);
    let layout = Layout::new(chart, &outlines, &sizing)?;
    let mut points = layout.points.clone();
    let fixed = points.len();
    fill::fill(chart, &sizing, &mut points);
    let triangles = fill::relax(chart, &sizing, &mut points, fixed, &layout.constraints, options.max_edge_m)?;
    let mesh = assemble(chart, &points, triangles, &layout.electrodes);
    check_whole(chart, &mesh)?;
    Ok(mesh)
}

/// Checks a finished mesh: valid cells, and nodes - edges + cells as of a tube (0) or a disk (1).
fn check_whole(chart: &Chart, mesh: &Mesh) -> Result<(), MeshError> {
    let crowded = |what: String| {
        MeshError::Generate(format!(
            "no mesh fits between the electrodes and edges of the body ({what}): move electrodes apart that nearly touch \
             each other or an edge, or make electrode_edge_m shorter"
        ))
    };
    mesh.validate().map_err(|error| crowded(error.to_string()))?;
    let Cells::Triangles(triangles) = &mesh.cells else { unreachable!("bodies are laid with triangles") };
    let edges = fill::edges(triangles).len() as isize;
    let euler = mesh.node_count() as isize - edges + triangles.len() as isize;
    let expected = isize::from(chart.period_m().is_none());
    if euler == expected { Ok(()) } else { Err(crowded(format!("its Euler characteristic is {euler}"))) }
}

fn assemble(chart: &Chart, points: &[Point2], triangles: Vec<[usize; 3]>, markings: &[Marking]) -> Mesh {
    let neighbours = Neighbours::new(&triangles);
    let electrodes = markings
        .iter()
        .map(|marking| match marking {
            Marking::Inside(outline) => ElectrodePatch::Cells(neighbours.inside(outline)),
            Marking::Along(edges) => ElectrodePatch::Edges(edges.clone()),
            Marking::At(node) => ElectrodePatch::Node(*node),
        })
        .collect();
    Mesh {
        nodes: points.iter().map(|&point| chart.roll(point)).collect(),
        cells: Cells::Triangles(triangles),
        electrodes,
        regions: Vec::new(),
    }
}

/// The triangle on the left of every directed edge.
struct Neighbours<'a> {
    triangles: &'a [[usize; 3]],
    left_of: HashMap<[usize; 2], usize>,
}

impl<'a> Neighbours<'a> {
    fn new(triangles: &'a [[usize; 3]]) -> Self {
        let mut left_of = HashMap::with_capacity(3 * triangles.len());
        for (index, &[a, b, c]) in triangles.iter().enumerate() {
            for edge in [[a, b], [b, c], [c, a]] {
                left_of.insert(edge, index);
            }
        }
        Neighbours { triangles, left_of }
    }

    /// The triangles on the left of an outline, up to it.
    fn inside(&self, outline: &[[usize; 2]]) -> Vec<usize> {
        let walls: std::collections::HashSet<[usize; 2]> =
            outline.iter().flat_map(|&[a, b]| [[a, b], [b, a]]).collect();
        let mut found: Vec<usize> = Vec::new();
        let mut stack: Vec<usize> = outline.iter().filter_map(|edge| self.left_of.get(edge).copied()).collect();
        let mut seen = std::collections::HashSet::new();
        while let Some(triangle) = stack.pop() {
            if !seen.insert(triangle) {
                continue;
            }
            found.push(triangle);
            let [a, b, c] = self.triangles[triangle];
            for [from, to] in [[a, b], [b, c], [c, a]] {
                if !walls.contains(&[from, to]) {
                    stack.extend(self.left_of.get(&[to, from]).copied());
                }
            }
        }
        found.sort_unstable();
        found
    }
}
