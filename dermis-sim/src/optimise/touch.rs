//! What a press changes, apart from the electrodes: points of the coat and their weights.

use super::fields::PressPoints;
use super::places::with_points;
use crate::bound::{BoundOptions, tangents};
use crate::elementary::exp;
use crate::twin::{Press, TouchOptions, Twin, TwinOptions};
use dermis::design::SkinDesign;
use dermis::geom::vector::{Point3, distance, dot, normalize, sub};
use dermis::geom::{Point2, Surface};
use dermis::mesh::Mesh;
use std::f64::consts::PI;

/// Parameters of a press: two of its position, the logarithms of its force and of its tip radius, the phase of the patches
/// along both directions.
pub(super) const PARAMETERS: usize = 6;
/// Those about which nothing is known but from the readings, and the tip radius.
pub(super) const UNKNOWNS: usize = 4;
/// Standard deviation of the logarithm of the tip radius, as in [`bound`](crate::bound).
const LOG_RADIUS_SD: f64 = 0.5;
/// Steps of central differences: along the skin, m, and of logarithms.
const STEP_M: f64 = 5e-4;
const LOG_STEP: f64 = 0.02;
/// Standard deviations of a Gaussian press beyond which its change is left out: 4 % of its strength.
const REACH: f64 = 2.5;
/// Edges of the touched mesh over those of the design: strengths hardly depend on it.
const COARSE: f64 = 2.0;

/// A point of the coat, and the derivatives of its relative change of conductance by each parameter, integrated over its
/// area, m2 (per m for lengths), along each pair of tangents (11, 12, 22).
#[derive(Debug, Clone)]
pub(super) struct TouchPoint {
    pub(super) place_m: Point3,
    pub(super) weights: [[f64; 3]; PARAMETERS],
}

/// How a twin's presses change the coat.
#[derive(Debug)]
pub(super) struct Touches {
    press: Press,
    surface: Surface,
    change: Change,
}

#[derive(Debug)]
enum Change {
    /// Contacts of patches; the twins with patches shifted forward and back along two directions, and their pitch.
    Patches { skin: Box<Twin>, shifted: Vec<[Twin; 2]>, pitch_m: [f64; 2] },
    /// A Gaussian of a strength (m2), a width (m), and the derivative of the logarithm of the width by that of the tip's
    /// radius.
    Gaussian { strength_m2: f64, width_m: f64, growth: f64, points: Vec<(Point3, f64)> },
}

impl Touches {
    /// The presses of a twin on a design; `edge_m` is the edge of the cells of smooth presses.
    pub(super) fn new(
        design: &SkinDesign,
        twin: &TwinOptions,
        bound: &BoundOptions,
        edge_m: f64,
        at_m: Point3,
    ) -> crate::Result<Self> {
        let skin = coarse_skin(design, twin)?;
        let press = Press { centre_m: at_m, force_n: bound.force_n, tip_radius_m: bound.tip_radius_m };
        let change = match skin.options().touch.clone() {
            TouchOptions::Patches(patches) => {
                let shifted = |axis: usize, step_m: f64| {
                    let mut shifted = patches.clone();
                    shifted.offset_m[axis] += step_m;
                    let mut options = twin.clone();
                    options.touch = TouchOptions::Patches(shifted);
                    coarse_skin(design, &options)
                };
                let both = |axis: usize| Ok::<_, crate::Error>([shifted(axis, STEP_M)?, shifted(axis, -STEP_M)?]);
                let shifted = if bound.known_patches { Vec::new() } else { vec![both(0)?, both(1)?] };
                Change::Patches { shifted, pitch_m: patches.on_body(&design.body)?.pitch_m(), skin: Box::new(skin) }
            }
            smooth => {
                let (width_m, growth) = match smooth {
                    TouchOptions::Gaussian(gaussian) => (gaussian.width_m, 0.0),
                    _ => (press.tip_radius_m, 1.0),
                };
                let centres: Vec<Point3> = design.electrodes.iter().map(|electrode| electrode.centre_m).collect();
                let mesh = Mesh::generate(&with_points(design, &centres, edge_m)?)?;
                let points = (0..mesh.cell_count()).map(|cell| (mesh.cell_centre(cell), mesh.cell_measure(cell)));
                let strength_m2 = skin.strength_m2(&[press])?;
                Change::Gaussian { strength_m2, width_m: width_m.max(edge_m), growth, points: points.collect() }
            }
        };
        Ok(Touches { press, surface: design.body.surface(), change })
    }

    /// What is known of each parameter before: the inverse of its variance. A phase that does not exist, or is known, has
    /// no effect, and any value serves.
    pub(super) fn known(&self) -> [f64; PARAMETERS] {
        let of_phase = |axis: usize| match &self.change {
            // Any phase is equally likely.
            Change::Patches { pitch_m, .. } => 12.0 / (pitch_m[axis] * pitch_m[axis]),
            Change::Gaussian { .. } => 1.0,
        };
        [0.0, 0.0, 0.0, LOG_RADIUS_SD.powi(-2), of_phase(0), of_phase(1)]
    }

    /// The points of a press at a place with a normal.
    pub(super) fn points(&self, place_m: Point3, normal: Point3) -> crate::Result<PressPoints> {
        let points = match &self.change {
            Change::Patches { skin, shifted, .. } => self.contacts(skin, shifted, place_m)?,
            Change::Gaussian { strength_m2, width_m, growth, points } => {
                let near = points.iter().filter(|(point, _)| distance(*point, place_m) < REACH * width_m);
                let point = |&(point, area_m2): &(Point3, f64)| {
                    let [x, y] = self.chart(place_m, normal, point).map(|along| along / width_m);
                    let square = x * x + y * y;
                    let rise = area_m2 * strength_m2 / (2.0 * PI * width_m * width_m) * exp(-0.5 * square);
                    let changes = [x / width_m, y / width_m, 1.0, growth * (square - 2.0), 0.0, 0.0];
                    TouchPoint { place_m: point, weights: changes.map(|change| [rise * change, 0.0, rise * change]) }
                };
                near.map(point).collect()
            }
        };
        Ok(PressPoints { place_m, axes: self.axes(place_m, normal), points })
    }

    /// The contacts of the patches under a press that is displaced, stronger, wider, under shifted patches: a point for
    /// each, with the weight of its step in the difference quotient.
    fn contacts(&self, skin: &Twin, shifted: &[[Twin; 2]], place_m: Point3) -> crate::Result<Vec<TouchPoint>> {
        let here = Press { centre_m: place_m, ..self.press };
        let moved = |step_m: Point2| Press { centre_m: self.surface.walk(place_m, step_m), ..here };
        let stronger = |sign: f64| Press { force_n: here.force_n * exp(sign * LOG_STEP), ..here };
        let wider = |sign: f64| Press { tip_radius_m: here.tip_radius_m * exp(sign * LOG_STEP), ..here };
        let mut points = Vec::new();
        for sign in [1.0, -1.0] {
            let along = sign / (2.0 * STEP_M);
            let cases = [
                (skin, moved([sign * STEP_M, 0.0]), along),
                (skin, moved([0.0, sign * STEP_M]), along),
                (skin, stronger(sign), sign / (2.0 * LOG_STEP)),
                (skin, wider(sign), sign / (2.0 * LOG_STEP)),
            ];
            let side = usize::from(sign < 0.0);
            let phases = shifted.iter().map(|both| (&both[side], here, along));
            for (parameter, (twin, press, quotient)) in cases.into_iter().chain(phases).enumerate() {
                for dipole in twin.dipoles(&[press])?.unwrap_or_default() {
                    let mut weights = [[0.0; 3]; PARAMETERS];
                    weights[parameter] = dipole.shape.map(|part| quotient * dipole.strength_m2 * part);
                    let step = self.surface.chart(place_m, self.at(dipole.centre_m));
                    points.push(TouchPoint { place_m: self.surface.walk(place_m, step), weights });
                }
            }
        }
        Ok(points)
    }

    /// The point of the surface at a place of the chart (around, along), or (x, y).
    fn at(&self, [round_m, along_m]: Point2) -> Point3 {
        match self.surface {
            Surface::Cylinder { radius_m, .. } => {
                self.surface.at(along_m, round_m / radius_m).expect("a cylinder has angles")
            }
            Surface::Plane | Surface::Free => [round_m, along_m, 0.0],
        }
    }

    /// The directions of the chart at a place; two tangents on a body without one.
    fn axes(&self, place_m: Point3, normal: Point3) -> [Point3; 2] {
        match self.surface {
            Surface::Free => tangents(normal),
            surface => [[STEP_M, 0.0], [0.0, STEP_M]].map(|step| normalize(sub(surface.walk(place_m, step), place_m))),
        }
    }

    fn chart(&self, place_m: Point3, normal: Point3, point: Point3) -> Point2 {
        match self.surface {
            Surface::Free => tangents(normal).map(|tangent| dot(tangent, sub(point, place_m))),
            surface => surface.chart(place_m, point),
        }
    }
}

/// The design as a twin without manufacturing errors, on a coarse mesh.
pub(super) fn coarse_skin(design: &SkinDesign, twin: &TwinOptions) -> crate::Result<Twin> {
    let mut options = twin.as_designed();
    options.mesh_scale = COARSE;
    Twin::new(design, &options, 0)
}
