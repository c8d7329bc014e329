//! The fabric patches.

use crate::body::BodyMesh;
use crate::error::FabricateError;
use crate::outline::Outline;
use dermis::design::FabricationOptions;
use dermis::geom::{Chart, Point3, Surface};

/// A piece of conductive fabric.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    /// Its label: `R0C0` in row 0 and column 0, `P0` on a body from a mesh file.
    pub(crate) label: String,
    /// Its outline: on the unrolled coat, or round the origin on a body from a mesh file, where each is laid on by itself.
    pub(crate) outline: Outline,
    /// The point of the surface below its middle, m.
    pub(crate) centre_m: Point3,
    /// The outward unit normal there.
    pub(crate) normal: Point3,
    /// Relative change of length round its edge when it is laid on the body: 0 where the body unrolls, otherwise that of
    /// a disc by the curvature below it.
    pub(crate) strain: f64,
}

/// The patches of a skin.
pub(crate) fn of(
    surface: &Surface,
    chart: Option<&Chart>,
    mesh: Option<&BodyMesh>,
    options: &FabricationOptions,
) -> Result<Vec<Patch>, FabricateError> {
    let patches = match (chart, mesh) {
        (Some(chart), _) => in_rows(surface, chart, options),
        (None, Some(mesh)) => round_ones(mesh, options),
        (None, None) => Vec::new(),
    };
    if patches.is_empty() {
        return Err(FabricateError::part("no patch fits on the body", "make `patch_pitch_m` smaller"));
    }
    Ok(patches)
}

/// Rows and columns over the unrolled coat, cut at its edge.
fn in_rows(surface: &Surface, chart: &Chart, options: &FabricationOptions) -> Vec<Patch> {
    let [low, _] = chart.bounds_m();
    let [(columns, column_m), (rows, row_m)] = chart.size_m().map(|length_m| options.patches_along(length_m));
    let (coat, half_gap_m) = (Outline::of_chart(chart), 0.5 * options.patch_gap_m);
    let patch = |(row, column): (usize, usize)| {
        let at = |column: usize, row: usize| [low[0] + column as f64 * column_m, low[1] + row as f64 * row_m];
        let ([x0, y0], [x1, y1]) = (at(column, row), at(column + 1, row + 1));
        let whole = Outline::rectangle([x0 + half_gap_m, y0 + half_gap_m], [x1 - half_gap_m, y1 - half_gap_m]);
        let outline = if inside(&whole, &coat) { whole } else { whole.clipped(&coat)? };
        let centre_m = chart.roll([0.5 * (x0 + x1), 0.5 * (y0 + y1)]);
        Some(Patch {
            label: format!("R{row}C{column}"),
            outline,
            centre_m,
            normal: surface.normal(centre_m).expect("a body with a chart has a known surface"),
            strain: 0.0,
        })
    };
    (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))).filter_map(patch).collect()
}

/// Whether all corners of a rectangle are on the coat.
fn inside(whole: &Outline, coat: &Outline) -> bool {
    match coat {
        Outline::Circle { centre_m: [x, y], radius_m } => {
            whole.corners().iter().all(|corner| (corner[0] - x).hypot(corner[1] - y) <= *radius_m)
        }
        Outline::Polygon(_) => true,
    }
}

/// Equal round patches at places at least a pitch apart: the distance along the surface is never less than that through
/// space, so that they leave the gap between them.
fn round_ones(mesh: &BodyMesh, options: &FabricationOptions) -> Vec<Patch> {
    let radius_m = 0.5 * (options.patch_pitch_m - options.patch_gap_m);
    let places = mesh.spread_m(options.patch_pitch_m, radius_m);
    let patch = |(number, (centre_m, normal)): (usize, (Point3, Point3))| Patch {
        label: format!("P{number}"),
        outline: Outline::Circle { centre_m: [0.0; 2], radius_m },
        centre_m,
        normal,
        strain: mesh.disc_strain(centre_m, radius_m),
    };
    places.into_iter().enumerate().map(patch).collect()
}
