//! Virtual experiments: touches on a skin, recorded as noisy frames.

use crate::design::SkinDesign;
use crate::forward::ForwardModel;
use crate::frame::{Frame, mean};
use crate::touch::{GaussianTouch, Noise, sample_rng, touched_conductivity};
use rayon::prelude::*;

/// Random streams from here on belong to untouched frames, those below to the frames of an experiment.
const UNTOUCHED_STREAMS: u64 = 1 << 63;

/// Under which conditions frames are recorded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditions {
    /// Signal-to-noise ratio as [`Noise::at_snr_db`] defines it, dB.
    pub snr_db: f64,
    /// Resistor across which the drive current is read, ohm; see [`Noise::reference_ohm`].
    pub reference_ohm: f64,
    /// Untouched frames before the first touch; the baseline is their mean.
    pub untouched_frames: usize,
    /// Frame `i` depends on the seed and `i` alone.
    pub seed: u64,
}

impl Default for Conditions {
    /// 50 dB, 1 kohm (the sheet resistance of the paper's skin), 100 untouched frames.
    fn default() -> Self {
        Conditions { snr_db: 50.0, reference_ohm: 1e3, untouched_frames: 100, seed: 1 }
    }
}

/// What an experiment recorded.
#[derive(Debug, Clone)]
pub struct Recording {
    /// Mean of the untouched frames, with their noise, ohm.
    pub baseline: Frame,
    /// A frame for each entry of the list of touches, with noise, ohm.
    pub frames: Vec<Frame>,
    /// The noise that they carry.
    pub noise: Noise,
}

/// Records one frame for each entry of `touches`, which holds all touches of that frame. `forward` should have a finer
/// mesh than the model that will reconstruct, or the images look better than any real skin's. `on_frame` is called
/// after every frame, from several threads.
///
/// # Errors
/// A touch or noise out of its range, no untouched frame, a forward problem without a solution.
pub fn record(
    design: &SkinDesign,
    forward: &ForwardModel,
    touches: &[Vec<GaussianTouch>],
    conditions: &Conditions,
    on_frame: impl Fn() + Sync,
) -> crate::Result<Recording> {
    let rest = forward.rest_conductivity();
    let untouched = forward.solve(rest)?;
    let noise = Noise::at_snr_db(conditions.snr_db, &untouched, forward.protocol(), conditions.reference_ohm)?;
    let (_, drive_of) = forward.protocol().drives();
    let noisy = |clean: &Frame, stream| noise.apply(clean, &drive_of, &mut sample_rng(conditions.seed, stream));
    let count = conditions.untouched_frames as u64;
    let untouched: Vec<Frame> = (0..count).map(|index| noisy(&untouched, UNTOUCHED_STREAMS + index)).collect();
    let baseline = mean(&untouched)
        .ok_or(crate::touch::TouchError::NotPositive { what: "the number of untouched frames", value: 0.0 })?;
    let surface = design.body.surface();
    let frame = |solver: &mut crate::forward::Solver, (index, touches): (usize, &Vec<GaussianTouch>)| {
        let conductivity = touched_conductivity(forward.mesh(), &surface, design.sheet.touch, rest, touches)?;
        let mut clean = Frame(vec![0.0; forward.protocol().channel_count()]);
        solver.solve_into(&conductivity, &mut clean)?;
        on_frame();
        Ok(noisy(&clean, index as u64))
    };
    let frames: crate::Result<Vec<Frame>> =
        touches.par_iter().enumerate().map_init(|| forward.solver(), frame).collect();
    Ok(Recording { baseline, frames: frames?, noise })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::TouchEffect;
    use crate::mesh::{Cells, ElectrodePatch, Mesh};
    use crate::touch::TouchError;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// A square of 0.1 m with 16 points on its rim as electrodes, in the place of the tank's mesh.
    fn square() -> (SkinDesign, ForwardModel) {
        let design = SkinDesign::shipped("tank16").expect("a shipped design");
        let n = 16;
        let nodes =
            (0..=n).flat_map(|j| (0..=n).map(move |i| [0.1 * i as f64 / 16.0, 0.1 * j as f64 / 16.0, 0.0])).collect();
        let node = |i: usize, j: usize| j * (n + 1) + i;
        let mut cells = Vec::new();
        for j in 0..n {
            for i in 0..n {
                cells.push([node(i, j), node(i + 1, j), node(i + 1, j + 1)]);
                cells.push([node(i, j), node(i + 1, j + 1), node(i, j + 1)]);
            }
        }
        let side = |k: usize| 4 * k;
        let mut electrodes = Vec::new();
        for k in 0..4 {
            electrodes.push(node(side(k), 0));
        }
        for k in 0..4 {
            electrodes.push(node(n, side(k)));
        }
        for k in 0..4 {
            electrodes.push(node(n - side(k), n));
        }
        for k in 0..4 {
            electrodes.push(node(0, n - side(k)));
        }
        let electrodes = electrodes.into_iter().map(ElectrodePatch::Node).collect();
        let mesh = Mesh { nodes, cells: Cells::Triangles(cells), electrodes, regions: vec![] };
        let rest = vec![1e-3; mesh.cell_count()];
        let forward = ForwardModel::from_parts(&mesh, &[1.0; 16], &design.protocol, &rest).expect("a valid model");
        (design, forward)
    }

    fn touch(x: f64, y: f64) -> GaussianTouch {
        GaussianTouch { centre_m: [x, y, 0.0], amplitude: 0.5, width_m: 0.008 }
    }

    #[test]
    fn frames_come_in_order_and_do_not_depend_on_their_neighbours() {
        let (design, forward) = square();
        let touches: Vec<Vec<_>> = (0..12).map(|k| vec![touch(0.02 + 0.005 * k as f64, 0.05)]).collect();
        let calls = AtomicUsize::new(0);
        let count = || {
            calls.fetch_add(1, Ordering::Relaxed);
        };
        let all = record(&design, &forward, &touches, &Conditions::default(), count).unwrap();
        assert_eq!(calls.load(Ordering::Relaxed), 12);
        let few = record(&design, &forward, &touches[..5], &Conditions::default(), || ()).unwrap();
        assert_eq!(all.frames[..5], few.frames[..]);
        assert_eq!(all.baseline, few.baseline);
        let other = Conditions { seed: 2, ..Conditions::default() };
        assert_ne!(record(&design, &forward, &touches[..1], &other, || ()).unwrap().frames[0], all.frames[0]);
    }

    #[test]
    fn the_baseline_is_ten_times_quieter_than_a_frame_and_a_touch_is_seen() {
        let (design, forward) = square();
        let clean = forward.solve(forward.rest_conductivity()).unwrap();
        let recording =
            record(&design, &forward, &[vec![], vec![touch(0.05, 0.05)]], &Conditions::default(), || ()).unwrap();
        let rms = |frame: &Frame| {
            let difference = frame - &clean;
            (difference.iter().map(|v| v * v).sum::<f64>() / frame.len() as f64).sqrt()
        };
        let (sd, noise) = (recording.noise.sd_ohm, rms(&recording.frames[0]));
        println!("noise {sd:.3e} ohm, a frame's {noise:.3e}, the baseline's {:.3e}", rms(&recording.baseline));
        assert!((noise / sd - 1.0).abs() < 0.2);
        assert!((10.0 * rms(&recording.baseline) / sd - 1.0).abs() < 0.2);
        assert!(rms(&recording.frames[1]) > 3.0 * sd, "the touch must stand above the noise");
    }

    #[test]
    fn what_cannot_be_recorded_is_refused() {
        let (mut design, forward) = square();
        let none = Conditions { untouched_frames: 0, ..Conditions::default() };
        assert!(record(&design, &forward, &[], &none, || ()).is_err());
        design.sheet.touch = TouchEffect::ConductanceFalls;
        let strong = GaussianTouch { amplitude: 3.0, ..touch(0.05, 0.05) };
        let error = record(&design, &forward, &[vec![strong]], &Conditions::default(), || ()).unwrap_err();
        assert!(matches!(error, crate::Error::Touch(TouchError::TooStrong { .. })), "{error}");
    }
}
