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
mod precision;
mod separation;

pub use precision::DriftSpread;

use crate::twin::{Press, TouchOptions, Twin, TwinError, TwinOptions};
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::geom::vector::{add, cross, normalize, scale};
use dermis::geom::{Point3, Surface};
use dermis::linalg::{Matrix, invert_spd};
use precision::{Precision, Whitened, frame_of};

/// Step of central differences along the skin and of the patches, m.
const STEP_M: f64 = 2e-4;
/// Step of the logarithms of force and tip radius.
const LOG_STEP: f64 = 0.01;
/// Standard deviation of the logarithm of the tip radius of an unknown object: a factor of 1.6.
const LOG_RADIUS_SD: f64 = 0.5;

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
}

impl Default for BoundOptions {
    /// A press of 2 N with a tip of 5 mm in one frame.
    fn default() -> Self {
        BoundOptions { force_n: 2.0, tip_radius_m: 0.005, frames: 1, drift: None }
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

/// The bounds of a design under the physics and the noise of a twin.
#[derive(Debug)]
pub struct Bounds {
    options: BoundOptions,
    twin: Twin,
    shifted: Vec<Shift>,
    untouched: Vec<f64>,
    precision: Precision,
    /// Frames an hour.
    frames_per_hour: f64,
}

impl Bounds {
    /// The bounds of a design with the presses, the noise and the drift of a twin, whose manufacturing errors and faults
    /// are left out.
    ///
    /// # Errors
    /// Presses that the twin cannot simulate; a twin without noise; a design without a solution.
    pub fn new(design: &SkinDesign, twin: &TwinOptions, options: &BoundOptions) -> crate::Result<Self> {
        let sound = twin.as_designed();
        let skin = Twin::new(design, &sound, 0)?;
        let noise = skin.noise().ok_or_else(|| TwinError::OutOfRange {
            field: "electronics.snr_db",
            value: f64::INFINITY,
            must: "finite".into(),
            fix: "without noise every bound is zero; give the noise of the instrument".into(),
        })?;
        let model = ForwardModel::new(skin.design(), skin.mesh())?;
        let of_twin =
            skin.options().drift.map(|drift| DriftSpread { coat: drift.conductance_rms, contact: drift.contact_rms });
        let drift = options.drift.or(of_twin).unwrap_or(DriftSpread { coat: 0.0, contact: 0.0 });
        Ok(Bounds {
            options: *options,
            precision: Precision::new(&model, skin.untouched(), noise, drift, options.frames)?,
            shifted: shifted_patches(design, &sound, skin.options())?,
            untouched: frame_of(skin.untouched(), &skin.design().protocol),
            frames_per_hour: 3600.0 * skin.options().electronics.frame_rate_hz / options.frames as f64,
            twin: skin,
        })
    }

    /// Whether the body has a chart, on which distances along the skin are known.
    pub fn has_chart(&self) -> bool {
        self.twin.design().body.surface() != Surface::Free
    }

    /// The bound of the position of a press at a place with an outward normal; `None` if the press changes no reading:
    /// no current flows there.
    ///
    /// # Errors
    /// A press that the twin cannot simulate.
    pub fn position(&self, place_m: Point3, normal: Point3) -> crate::Result<Option<PositionBound>> {
        let press = self.press(place_m);
        let mut columns = self.derivatives(&press, normal)?;
        let mut priors = vec![0.0, 0.0, 0.0, LOG_RADIUS_SD.powi(-2)];
        for shift in &self.shifted {
            let [forward, back] = &shift.twins;
            columns.push(self.precision.whiten(quotient(&forward.clean(&[press])?, &back.clean(&[press])?, STEP_M)));
            priors.push(shift.sd_m.powi(-2));
        }
        let Some(covariance) = self.covariance(&columns, &priors) else { return Ok(None) };
        let at = |i: usize, j: usize| covariance.at(i, j);
        Ok(Some(PositionBound {
            covariance_m2: [[at(0, 0), at(0, 1)], [at(1, 0), at(1, 1)]],
            sd_m: (at(0, 0) + at(1, 1)).sqrt(),
            force_sd_n: self.options.force_n * at(2, 2).sqrt(),
        }))
    }

    /// The inverse of the information about parameters along which a frame changes by `columns`, each with the inverse
    /// variance that is known before; `None` if a parameter changes nothing.
    fn covariance(&self, columns: &[Whitened], priors: &[f64]) -> Option<Matrix> {
        let mut information = Matrix::zeros(columns.len(), columns.len());
        for (i, a) in columns.iter().enumerate() {
            columns.iter().enumerate().for_each(|(j, b)| *information.at_mut(i, j) = self.precision.inner(a, b));
            *information.at_mut(i, i) += priors[i];
        }
        invert_spd(&information).ok()
    }

    /// The change of the frame of a press along two tangents of the skin (per m), and by the logarithms of its force and
    /// of its tip radius.
    fn derivatives(&self, press: &Press, normal: Point3) -> crate::Result<Vec<Whitened>> {
        let moved = |step_m: [f64; 2]| Press { centre_m: self.moved(press.centre_m, normal, step_m), ..*press };
        let grown = |factor: f64| Press { force_n: press.force_n * factor, ..*press };
        let wider = |factor: f64| Press { tip_radius_m: press.tip_radius_m * factor, ..*press };
        let ratio = LOG_STEP.exp();
        let pairs = [
            ([moved([STEP_M, 0.0]), moved([-STEP_M, 0.0])], STEP_M),
            ([moved([0.0, STEP_M]), moved([0.0, -STEP_M])], STEP_M),
            ([grown(ratio), grown(1.0 / ratio)], LOG_STEP),
            ([wider(ratio), wider(1.0 / ratio)], LOG_STEP),
        ];
        let column = |([forward, back], step): ([Press; 2], f64)| {
            let change = quotient(&self.twin.clean(&[forward])?, &self.twin.clean(&[back])?, step);
            Ok(self.precision.whiten(change))
        };
        pairs.into_iter().map(column).collect()
    }

    /// A point moved along the skin: [around, along] on a cylinder, [x, y] on a flat skin, else along two tangents.
    fn moved(&self, place_m: Point3, normal: Point3, step_m: [f64; 2]) -> Point3 {
        match self.twin.design().body.surface() {
            Surface::Free => {
                let [u, v] = tangents(normal);
                add(place_m, add(scale(u, step_m[0]), scale(v, step_m[1])))
            }
            surface => surface.walk(place_m, step_m),
        }
    }

    /// The change of the untouched frame by some presses.
    fn change(&self, presses: &[Press]) -> crate::Result<Whitened> {
        let frame = self.twin.clean(presses)?;
        Ok(self.precision.whiten(frame.iter().zip(&self.untouched).map(|(touched, rest)| touched - rest).collect()))
    }

    fn press(&self, centre_m: Point3) -> Press {
        Press { centre_m, force_n: self.options.force_n, tip_radius_m: self.options.tip_radius_m }
    }
}

/// The skin with its patches shifted by a step forward and back along one direction, and the standard deviation of an
/// unknown phase, m.
#[derive(Debug)]
struct Shift {
    twins: [Twin; 2],
    sd_m: f64,
}

/// The shifts along both directions; none without patches.
fn shifted_patches(design: &SkinDesign, sound: &TwinOptions, of_design: &TwinOptions) -> crate::Result<Vec<Shift>> {
    let TouchOptions::Patches(patches) = &of_design.touch else { return Ok(Vec::new()) };
    let pitch_m = patches.on_body(&design.body)?.pitch_m();
    let shift = |axis: usize| {
        let twin = |step_m: f64| {
            let mut shifted = patches.clone();
            shifted.offset_m[axis] += step_m;
            let mut options = sound.clone();
            options.touch = TouchOptions::Patches(shifted);
            Twin::new(design, &options, 0)
        };
        // Any phase is equally likely: a uniform distribution over the pitch.
        Ok(Shift { twins: [twin(STEP_M)?, twin(-STEP_M)?], sd_m: pitch_m[axis] / 12f64.sqrt() })
    };
    (0..2).map(shift).collect()
}

/// Two unit vectors that are perpendicular to a normal and to each other.
fn tangents(normal: Point3) -> [Point3; 2] {
    let axis = if normal[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let first = normalize(cross(normal, axis));
    [first, cross(normal, first)]
}

/// Central difference quotient.
fn quotient(forward: &[f64], back: &[f64], step: f64) -> Vec<f64> {
    forward.iter().zip(back).map(|(forward, back)| (forward - back) / (2.0 * step)).collect()
}
