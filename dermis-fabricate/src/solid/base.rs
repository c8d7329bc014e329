//! The base of each kind of body. Lengths in mm.

use crate::error::FabricateError;
use crate::model::{Bore, Fabrication};
use crate::solid::cutter::{Frame, circle, cuboid, prism, union};
use crate::solid::{Solid, channel, shell};
use dermis::design::{Body, FabricationOptions};
use dermis::geom::vector::scale;
use manifold_rust::manifold::Manifold;
use manifold_rust::types::Error;

/// Largest distance between a round surface and its facets, mm: a fifth of what a printer resolves.
const CHORD_ERROR_MM: f64 = 0.002;

const UPRIGHT: Frame = Frame { origin: [0.0; 3], u: [1.0, 0.0, 0.0], v: [0.0, 1.0, 0.0] };

pub(crate) fn mm(length_m: f64) -> f64 {
    1e3 * length_m
}

/// Genus of the base as designed: that of the body with its wall, and one for each bore.
///
/// A wall over a surface of genus `g` with `b` edges has the genus `2 g + b - 1`. Each bore adds one; over a closed
/// surface (`b = 0`) the first one joins inside and outside.
pub fn designed_genus(fabrication: &Fabrication) -> i64 {
    let (edges, genus) = match (&fabrication.design.body, &fabrication.body_mesh) {
        (Body::Cylinder { .. }, _) => (2, 0),
        (_, Some(mesh)) => mesh.topology(),
        _ => (1, 0),
    };
    2 * genus + edges as i64 - 1 + fabrication.electrodes.len() as i64
}

/// The base of a skin.
///
/// # Errors
/// A wall that is too thick for the body's curvature; bores or channels that do not leave one part with a hole for each
/// electrode.
pub fn base(fabrication: &Fabrication) -> Result<Solid, FabricateError> {
    let mut cutters: Vec<Manifold> = fabrication.electrodes.iter().map(|one| bore(&one.bore, fabrication)).collect();
    if fabrication.options.channel_depth_m > 0.0 {
        cutters.extend(channel::channels(fabrication)?);
    }
    let body = body(fabrication)?;
    let part = body.difference(&union(cutters));
    if part.status() != Error::NoError {
        return Err(FabricateError::Internal(format!("the base: {:?}", part.status())));
    }
    let parts = part.decompose().len();
    let solid = Solid::of(&part);
    let (genus, designed) = (solid.genus(), designed_genus(fabrication));
    if parts != 1 || genus != designed || !solid.is_closed() {
        let message = format!(
            "the base has {parts} parts and {genus} holes, but one part and {designed} holes are designed: bores or \
             channels break through the wall or meet"
        );
        return Err(FabricateError::part(
            message,
            "make the bores smaller, the channels shallower or the wall thinner",
        ));
    }
    Ok(solid)
}

/// The body with its wall, without holes.
fn body(fabrication: &Fabrication) -> Result<Manifold, FabricateError> {
    let FabricationOptions { wall_m, flange_m, .. } = fabrication.options;
    let (wall, flange) = (mm(wall_m), mm(flange_m));
    match fabrication.design.body {
        Body::Cylinder { length_m, diameter_m } => {
            let (radius, heights) = (0.5 * mm(diameter_m), [-flange, mm(length_m) + flange]);
            let inside = [heights[0] - wall, heights[1] + wall];
            let outer = prism(&circle(radius, CHORD_ERROR_MM), &UPRIGHT, heights);
            Ok(outer.difference(&prism(&circle(radius - wall, CHORD_ERROR_MM), &UPRIGHT, inside)))
        }
        Body::Disk { diameter_m } => {
            Ok(prism(&circle(0.5 * mm(diameter_m) + flange, CHORD_ERROR_MM), &UPRIGHT, [-wall, 0.0]))
        }
        Body::Rectangle { width_m, height_m } => {
            let side = |length_m: f64| [-flange, mm(length_m) + flange];
            Ok(cuboid(&UPRIGHT, side(width_m), side(height_m), [-wall, 0.0]))
        }
        Body::Mesh { .. } => {
            let mesh = fabrication.body_mesh.as_ref().expect("a body from a mesh file has its surface");
            shell::shell(mesh, wall_m)
        }
    }
}

/// A cylinder along the normal, from above the surface to below the wall.
fn bore(bore: &Bore, fabrication: &Fabrication) -> Manifold {
    let frame = Frame::along(scale(bore.centre_m, 1e3), bore.normal);
    let beyond = mm(bore.diameter_m);
    prism(
        &circle(0.5 * mm(bore.diameter_m), CHORD_ERROR_MM),
        &frame,
        [-mm(fabrication.options.wall_m) - beyond, beyond],
    )
}
