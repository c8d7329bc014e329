//! Bounds of a skin: how well any method can do, before the skin is built.
//!
//! For a place on the skin: the standard deviation of a press's position that no unbiased method goes below (Cramer and
//! Rao; Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, section 3.8), the smallest force
//! that is found at one false alarm an hour, and the smallest distance at which two presses are told from one. The skin
//! is that of the design: an even coat, electrodes in their places. What is not known is estimated with the position:
//! force, tip radius, the phase of the patches, drift of coat and contacts.
//!
//! ```no_run
//! use dermis::design::SkinDesign;
//! use dermis_sim::bound::{BoundOptions, Bounds};
//! use dermis_sim::twin::TwinOptions;
//!
//! let design = SkinDesign::shipped("cylinder30").unwrap();
//! let bounds = Bounds::new(&design, &TwinOptions::shipped("lab").unwrap(), &BoundOptions::default())?;
//! let place = bounds.position([0.05, 0.0, 0.15], [1.0, 0.0, 0.0])?.expect("current flows there");
//! println!("{:.2} mm, {:.3} N", 1e3 * place.sd_m, place.force_sd_n);
//! # Ok::<(), dermis_sim::Error>(())
//! ```

mod detection;
mod error;
mod map;
mod precision;
mod separation;

pub use error::BoundError;
pub use map::{BoundMap, MapOptions, PlaceBounds, SkinBounds, Spread, map_bounds};

use crate::elementary::{ln, powf};
use crate::noise::Noise;
use crate::twin::{Press, TouchOptions, Twin, TwinError, TwinOptions};
use dermis::design::{SheetKind, SkinDesign};
use dermis::estimate::drift::DriftSpread;
use dermis::estimate::least_squares::Normal;
use dermis::forward::ForwardModel;
use dermis::frame::Frame;
use dermis::geom::vector::{add, bounding_box, cross, distance, normalize, scale};
use dermis::geom::{Point3, Surface};
use precision::{Precision, frame_of};
use std::f64::consts::PI;
use std::sync::Arc;

/// Step of central differences along the skin and of the patches, m.
const STEP_M: f64 = 2e-4;
/// Step of the logarithms of force and tip radius.
const LOG_STEP: f64 = 0.01;
/// Longest edge of the mesh over the radius of the tip, before the twin's own scale. The contact of a tip is smaller than
/// the tip; with edges of 6 mm on `cylinder30` the bounds at single places differ by a factor of up to 2.7 (root mean
/// square 1.25) from those with 3 mm.
const EDGE: f64 = 0.6;
/// Shortest edge over that of the design: 16 times as many cells.
const FINEST: f64 = 0.25;
/// Longest edge over that of the design. A press is integrated over the cells, so that those of a small disk may be twice as
/// long: its bounds stay within 1 %.
const COARSEST: f64 = 2.0;
/// Angles of a mean over directions.
const ANGLES: u32 = 64;
/// Standard deviation of the logarithm of the tip radius of an unknown object: a factor of 1.6.
const LOG_RADIUS_SD: f64 = 0.5;
/// Parameters of a press: two of its position, the logarithms of its force and of its tip radius.
const PARAMETERS: usize = 4;
/// The index of the tip radius.
const LOG_RADIUS: usize = 3;

/// What the bounds are for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundOptions {
    /// Force of a press, N.
    pub force_n: f64,
    /// Radius of the tip, m.
    pub tip_radius_m: f64,
    /// Number of frames whose mean is used.
    pub frames: usize,
    /// Drift since the untouched frame; that of the twin without it.
    pub drift: Option<DriftSpread>,
    /// Whether it is known where the patches lie on the coat.
    pub known_patches: bool,
    /// Whether a touch is known to be a press by a ball. If not, two presses must also be told from one object of any length.
    pub known_form: bool,
}

impl Default for BoundOptions {
    /// A press of 2 N with a tip of 5 mm in one frame.
    fn default() -> Self {
        BoundOptions {
            force_n: 2.0,
            tip_radius_m: 0.005,
            frames: 1,
            drift: None,
            known_patches: false,
            known_form: true,
        }
    }
}

/// The bound of the position at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionBound {
    /// Covariance along [around, along] on a cylinder, [x, y] on a flat skin, else along two tangents, m2.
    pub covariance_m2: [[f64; 2]; 2],
    /// Standard deviation: root of the sum of the variances along both, m.
    pub sd_m: f64,
    /// Standard deviation of the force, N.
    pub force_sd_n: f64,
}

impl PositionBound {
    /// The mean distance of a normal estimate with this covariance from the press, m: by Jensen's inequality at most
    /// `sd_m`, at least `sqrt(2 / pi)` of it.
    pub(crate) fn mean_error_m(&self) -> f64 {
        let [[xx, xy], [_, yy]] = self.covariance_m2;
        // In polar coordinates the radius of the standard normal distribution has the mean sqrt(pi / 2); the mean over the
        // angle converges faster than any power of the number of points.
        let turned = |step: u32| {
            let (sin, cos) = (f64::from(step) * PI / f64::from(ANGLES)).sin_cos();
            // `|L (cos, sin)|` with the factor `L` of the covariance.
            let l = xx.sqrt();
            let (m, n) = (xy / l, (yy - xy * xy / xx).max(0.0).sqrt());
            (l * cos).hypot(m * cos + n * sin)
        };
        (PI / 2.0).sqrt() * (0..ANGLES).map(turned).sum::<f64>() / f64::from(ANGLES)
    }
}

/// The bounds of a design under the physics and the noise of a twin.
#[derive(Debug)]
pub struct Bounds {
    options: BoundOptions,
    physics: Arc<Physics>,
    precision: Precision,
}

/// What does not depend on the number of frames.
#[derive(Debug)]
struct Physics {
    twin: Twin,
    shifted: Vec<Shift>,
    untouched: Vec<f64>,
    /// Greatest distance of two points of the mesh's bounding box, m.
    size_m: f64,
    model: ForwardModel,
    noise: Noise,
    drift: DriftSpread,
}

impl Bounds {
    /// The bounds of a design with the presses, the noise and the drift of a twin, whose manufacturing errors and faults
    /// are left out. The mesh has cells that suit the tip ([`refined`]).
    ///
    /// # Errors
    /// Presses that the twin cannot simulate; a twin without noise; a design without a solution.
    pub fn new(design: &SkinDesign, twin: &TwinOptions, options: &BoundOptions) -> crate::Result<Self> {
        let design = &refined(design, options);
        let sound = twin.as_designed();
        let skin = Twin::new(design, &sound, 0)?;
        let noise = skin.noise().ok_or_else(|| TwinError::OutOfRange {
            field: "electronics.snr_db",
            value: f64::INFINITY,
            must: "finite".into(),
            fix: "without noise every bound is zero; give the noise of the instrument".into(),
        })?;
        let of_twin = skin.options().drift.map(|drift| DriftSpread {
            sheet: drift.conductance_rms,
            contact: drift.contact_rms,
            ..DriftSpread::default()
        });
        let physics = Physics {
            shifted: if options.known_patches { Vec::new() } else { shifted_patches(design, &sound, skin.options())? },
            untouched: frame_of(skin.untouched(), &skin.design().protocol),
            size_m: size_m(&skin.mesh().nodes),
            model: ForwardModel::new(skin.design(), skin.mesh())?,
            noise,
            drift: options.drift.or(of_twin).unwrap_or_default(),
            twin: skin,
        };
        Bounds::of(Arc::new(physics), options)
    }

    fn of(physics: Arc<Physics>, options: &BoundOptions) -> crate::Result<Self> {
        let Physics { model, twin, noise, drift, .. } = &*physics;
        let precision = Precision::new(model, twin.untouched(), *noise, *drift, options.frames)?;
        Ok(Bounds { options: *options, precision, physics })
    }

    /// The bounds of the same skin for the mean of another number of frames; they share all computed currents.
    ///
    /// # Errors
    /// None for a skin that has bounds.
    pub fn averaged(&self, frames: usize) -> crate::Result<Self> {
        Bounds::of(self.physics.clone(), &BoundOptions { frames, ..self.options })
    }

    /// Whether the body has a chart, on which distances along the skin are known.
    pub fn has_chart(&self) -> bool {
        self.surface() != Surface::Free
    }

    /// The bound of the position of a press with the force and the tip of the options, at a place with an outward normal;
    /// `None` if the readings do not tell the place: no current flows there, or they are fewer than the unknowns.
    ///
    /// # Errors
    /// A press that the twin cannot simulate.
    pub fn position(&self, place_m: Point3, normal: Point3) -> crate::Result<Option<PositionBound>> {
        self.position_of(&self.press(place_m), normal)
    }

    /// The bound of the position of a press, at a place with an outward normal; `None` as for [`position`](Self::position).
    ///
    /// # Errors
    /// A press that the twin cannot simulate.
    pub(crate) fn position_of(&self, press: &Press, normal: Point3) -> crate::Result<Option<PositionBound>> {
        Ok(self.position_from(press, &self.response(press, normal)?))
    }

    /// The changes of the frame around a press; they do not depend on the number of frames.
    fn response(&self, press: &Press, normal: Point3) -> crate::Result<Response> {
        let phases = self.phase_changes(&[*press], &self.clean(&[*press])?)?;
        Ok(Response { phases, columns: self.derivatives(press, normal)? })
    }

    /// The bound of the position of a press from the changes of the frame around it.
    fn position_from(&self, press: &Press, response: &Response) -> Option<PositionBound> {
        let precision = self.precision.clone().with_disturbances(response.phases.clone());
        let columns = response.columns.clone().map(|column| precision.whiten(column));
        let information = equations(&columns, &vec![0.0; columns[0].len()], 0.0);
        let covariance = information.factor().ok()?.inverse();
        let at = |i: usize, j: usize| covariance.at(i, j);
        let sd_m = (at(0, 0) + at(1, 1)).sqrt();
        // Rounding may hide that the information is singular.
        (sd_m < self.physics.size_m).then(|| PositionBound {
            covariance_m2: [[at(0, 0), at(0, 1)], [at(1, 0), at(1, 1)]],
            sd_m,
            force_sd_n: press.force_n * at(2, 2).sqrt(),
        })
    }

    /// The precision of the frame of some presses, if the phase of the patches is unknown: the frame's change by one
    /// standard deviation of the phase is one more disturbance.
    fn with_unknown_phase(&self, presses: &[Press], frame: &Frame) -> crate::Result<Precision> {
        Ok(self.precision.clone().with_disturbances(self.phase_changes(presses, frame)?))
    }

    /// The change of the frame of some presses by one standard deviation of each phase of the patches that is unknown.
    fn phase_changes(&self, presses: &[Press], frame: &Frame) -> crate::Result<Vec<Vec<f64>>> {
        let of_shift = |shift: &Shift| -> crate::Result<Vec<f64>> {
            let change = difference(&shift.twin.clean(presses)?, frame);
            Ok(change.into_iter().map(|value| shift.sd_m / STEP_M * value).collect())
        };
        self.physics.shifted.iter().map(of_shift).collect()
    }

    /// The change of the frame of a press along two tangents of the skin (per m), and by the logarithms of its force and
    /// of its tip radius.
    fn derivatives(&self, press: &Press, normal: Point3) -> crate::Result<[Vec<f64>; PARAMETERS]> {
        let column = |[forward, back]: [Press; 2], step: f64| -> crate::Result<Vec<f64>> {
            Ok(quotient(&self.clean(&[forward])?, &self.clean(&[back])?, step))
        };
        let [around, along, force, radius] = self.steps(press, normal);
        Ok([column(around, STEP_M)?, column(along, STEP_M)?, column(force, LOG_STEP)?, column(radius, LOG_STEP)?])
    }

    /// A press moved forward and back by a step of each parameter.
    fn steps(&self, press: &Press, normal: Point3) -> [[Press; 2]; PARAMETERS] {
        let moved = |step_m: [f64; 2]| Press { centre_m: self.moved(press.centre_m, normal, step_m), ..*press };
        let grown = |factor: f64| Press { force_n: press.force_n * factor, ..*press };
        let wider = |factor: f64| Press { tip_radius_m: press.tip_radius_m * factor, ..*press };
        let ratio = LOG_STEP.exp();
        [
            [moved([STEP_M, 0.0]), moved([-STEP_M, 0.0])],
            [moved([0.0, STEP_M]), moved([0.0, -STEP_M])],
            [grown(ratio), grown(1.0 / ratio)],
            [wider(ratio), wider(1.0 / ratio)],
        ]
    }

    /// A point moved along the skin: [around, along] on a cylinder, [x, y] on a flat skin, else along two tangents.
    fn moved(&self, place_m: Point3, normal: Point3, step_m: [f64; 2]) -> Point3 {
        match self.surface() {
            Surface::Free => {
                let [u, v] = tangents(normal);
                add(place_m, add(scale(u, step_m[0]), scale(v, step_m[1])))
            }
            surface => surface.walk(place_m, step_m),
        }
    }

    fn surface(&self) -> Surface {
        self.physics.twin.design().body.surface()
    }

    /// The frame of some presses without noise.
    fn clean(&self, presses: &[Press]) -> crate::Result<Frame> {
        self.physics.twin.clean(presses)
    }

    fn press(&self, centre_m: Point3) -> Press {
        Press { centre_m, force_n: self.options.force_n, tip_radius_m: self.options.tip_radius_m }
    }
}

/// The changes of a frame around a press.
struct Response {
    /// By one standard deviation of each unknown phase of the patches.
    phases: Vec<Vec<f64>>,
    /// By each parameter.
    columns: [Vec<f64>; PARAMETERS],
}

/// The equations of the parameters of a press from the whitened changes of a frame by each, what is left of the frame
/// (zeros, for the information alone), and the distance of the logarithm of the tip radius from the usual one.
fn equations(columns: &[Vec<f64>], residuals: &[f64], log_radius: f64) -> Normal {
    let mut normal = Normal::new(&columns.iter().map(Vec::as_slice).collect::<Vec<_>>(), residuals);
    normal.add_prior(LOG_RADIUS, LOG_RADIUS_SD.powi(-2), log_radius);
    normal
}

/// Steps of [`smallest`] before it halves the bracket at least every second time.
const FREE_STEPS: usize = 5;

/// The smallest value in a range at which a growing function reaches a level, to a relative accuracy; `None` if the largest is
/// not enough. From the smallest value that is enough the next is guessed by a power law, whose first exponent is given;
/// where that leads out of the bracket, and in every second step after the first ones, the bracket is halved.
fn smallest(
    [mut low, mut high]: [f64; 2],
    level: f64,
    mut power: f64,
    accuracy: f64,
    function: impl Fn(f64) -> crate::Result<f64>,
) -> crate::Result<Option<f64>> {
    let mut of_high = function(high)?;
    if of_high < level {
        return Ok(None);
    }
    for step in 0usize.. {
        if high <= (1.0 + accuracy) * low {
            break;
        }
        let guess = high * powf(level / of_high, 1.0 / power) * (1.0 + 0.5 * accuracy);
        let is_inside = guess > low && (step < FREE_STEPS || step.is_multiple_of(2));
        let next = if is_inside { guess.min(high / (1.0 + accuracy)) } else { (low * high).sqrt() };
        let found = function(next)?;
        if found < level {
            low = next;
            continue;
        }
        power = (ln(of_high / found) / ln(high / next)).clamp(0.5 * power, 2.0 * power);
        (high, of_high) = (next, found);
    }
    Ok(Some(high))
}

/// A design with a mesh that is as fine as the contact of a tip on its coating needs: edges of 0.6 of its radius, but no shorter
/// than a quarter and no longer than twice those of the design. The mesh of a volume is kept.
pub fn refined(design: &SkinDesign, options: &BoundOptions) -> SkinDesign {
    let mut refined = design.clone();
    if design.sheet.kind == SheetKind::Surface {
        let given_m = design.mesh.max_edge_m;
        refined.mesh.max_edge_m = (EDGE * options.tip_radius_m).clamp(FINEST * given_m, COARSEST * given_m);
    }
    refined
}

/// The skin with its patches shifted by a step along one direction, and the standard deviation of an unknown phase, m.
/// Forward differences: a second skin, shifted back, would cost as much again.
#[derive(Debug)]
struct Shift {
    twin: Twin,
    sd_m: f64,
}

/// The shifts along both directions; none without patches.
fn shifted_patches(design: &SkinDesign, sound: &TwinOptions, of_design: &TwinOptions) -> crate::Result<Vec<Shift>> {
    let TouchOptions::Patches(patches) = &of_design.touch else { return Ok(Vec::new()) };
    let pitch_m = patches.on_body(&design.body)?.pitch_m();
    let shift = |axis: usize| {
        let mut shifted = patches.clone();
        shifted.offset_m[axis] += STEP_M;
        let mut options = sound.clone();
        options.touch = TouchOptions::Patches(shifted);
        // Any phase is equally likely: a uniform distribution over the pitch.
        Ok(Shift { twin: Twin::new(design, &options, 0)?, sd_m: pitch_m[axis] / 12f64.sqrt() })
    };
    (0..2).map(shift).collect()
}

/// The diagonal of the box around some points, m.
fn size_m(points: &[Point3]) -> f64 {
    let [low_m, high_m] = bounding_box(points.iter().copied());
    distance(low_m, high_m)
}

/// Two unit vectors that are perpendicular to a normal and to each other.
pub(crate) fn tangents(normal: Point3) -> [Point3; 2] {
    let axis = if normal[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let first = normalize(cross(normal, axis));
    [first, cross(normal, first)]
}

/// One frame minus another.
fn difference(minuend: &[f64], subtrahend: &[f64]) -> Vec<f64> {
    minuend.iter().zip(subtrahend).map(|(a, b)| a - b).collect()
}

/// Central difference quotient.
fn quotient(forward: &[f64], back: &[f64], step: f64) -> Vec<f64> {
    forward.iter().zip(back).map(|(forward, back)| (forward - back) / (2.0 * step)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_value_that_is_enough() {
        let calls = std::cell::Cell::new(0);
        let counted = |function: fn(f64) -> f64| {
            let calls = &calls;
            move |at: f64| -> crate::Result<f64> {
                calls.set(calls.get() + 1);
                Ok(function(at))
            }
        };
        // A power law, one with another exponent than the first guess, one that saturates, a step.
        type Function = fn(f64) -> f64;
        let functions: [(Function, f64); 4] = [
            (|at| at.powi(4), 1.0),
            (|at| at, 1.0),
            (|at| 2.0 * at / (1.0 + at), 1.0),
            (|at| 1e9 * f64::from(at > 3.0), 3.0),
        ];
        for (function, exact) in functions {
            calls.set(0);
            let found = smallest([1e-4, 20.0], 1.0, 4.0, 1e-3, counted(function)).unwrap().unwrap();
            assert!(found >= exact && found <= 1.001 * exact * (1.0 + 1e-12), "{found} for {exact}");
            println!("{} calls", calls.get());
            assert!(calls.get() <= 30, "{}", calls.get());
        }
        assert_eq!(smallest([1e-4, 20.0], 1.0, 1.0, 1e-3, |_| Ok(0.5)).unwrap(), None);
    }

    #[test]
    fn the_mean_error_of_a_normal_estimate() {
        let bound = |[a, b, c]: [f64; 3]| {
            let sd_m = (a + c).sqrt();
            PositionBound { covariance_m2: [[a, b], [b, c]], sd_m, force_sd_n: 0.0 }.mean_error_m()
        };
        // Round: Rayleigh's distribution; almost along a line: half of a normal one.
        assert!((bound([4.0, 0.0, 4.0]) - 2.0 * (PI / 2.0).sqrt()).abs() < 1e-12);
        assert!((bound([1.0, 1.0, 1.0]) - 2f64.sqrt() * (2.0 / PI).sqrt()).abs() < 1e-3);
        // sqrt(2 / pi) 2 E(3 / 4), with the complete elliptic integral of the second kind: scipy.special.ellipe(0.75).
        assert!((bound([1.0, 0.0, 4.0]) - (2.0 / PI).sqrt() * 2.0 * 1.211_056_027_568_459_5).abs() < 1e-9);
    }
}
