//! The accuracy with which a single frame determines the position of a touch: the Cramér-Rao bound of a touch's
//! position on `cylinder30`, with the noise of the twin `lab` and everything else known except the touch's position,
//! width and strength (Kay, 1993, "Fundamentals of Statistical Signal Processing: Estimation Theory", Eq. 3.31: the
//! covariance is at least the inverse of `F = sum_channels g g' / sd^2`, `g` the frame's derivatives).
//!
//! Expected: tenths of a millimetre in the middle, where patches and not noise limit every method, and several times as
//! much along the axis at a rim: no current crosses an edge, so that near it a frame hardly depends on the distance of
//! the touch from it. Both are asserted.

use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::frame::{Frame, mean};
use dermis::mesh::Mesh;
use dermis::stats::upper_median;
use dermis_sim::touch::{GaussianTouch, touched_conductivity};
use dermis_sim::twin::{Twin, TwinOptions};

/// Amplitude with the same change of the frame as a press of 2 N on the patches of `lab`.
const WIDTH_M: f64 = 0.008;
const AMPLITUDE: f64 = 0.7;
/// Number of untouched frames for the noise, and the seed of their twin.
const UNTOUCHED: u64 = 200;
const SEED: u64 = 3000;
/// Steps of the derivatives: of positions (m), and of the logarithms of amplitude and width.
const PLACE_STEP_M: f64 = 2e-4;
const LOG_STEP: f64 = 0.01;

struct Skin {
    design: SkinDesign,
    forward: ForwardModel,
    noise_ohm: Vec<f64>,
}

impl Skin {
    fn new() -> dermis_sim::Result<Self> {
        let design = SkinDesign::load("cylinder30")?;
        let forward = ForwardModel::new(&design, &Mesh::generate(&design)?)?;
        let twin = Twin::new(&design, &TwinOptions::load("lab")?, SEED)?;
        let frames = (0..UNTOUCHED).map(|index| twin.frame(&[], index)).collect::<dermis_sim::Result<Vec<Frame>>>()?;
        let middle = mean(&frames).expect("there are frames");
        let square =
            |channel: usize| frames.iter().map(|frame| (frame[channel] - middle[channel]).powi(2)).sum::<f64>();
        let noise_ohm = (0..middle.len()).map(|channel| (square(channel) / (UNTOUCHED - 1) as f64).sqrt()).collect();
        Ok(Skin { design, forward, noise_ohm })
    }

    /// The frame of a touch at a z and an angle, with its amplitude and width multiplied by the exponentials of two
    /// numbers.
    fn frame(&self, [z_m, theta_rad, log_amplitude, log_width]: [f64; 4]) -> dermis_sim::Result<Frame> {
        let surface = self.design.body.surface();
        let touch = GaussianTouch {
            centre_m: surface.at(z_m, theta_rad).expect("a cylinder"),
            amplitude: AMPLITUDE * log_amplitude.exp(),
            width_m: WIDTH_M * log_width.exp(),
        };
        let rest = self.forward.rest_conductivity();
        let touched = touched_conductivity(self.forward.mesh(), &surface, self.design.sheet.touch, rest, &[touch])?;
        Ok(self.forward.solve(&touched)?)
    }

    /// The smallest possible standard deviations along the axis and around it, m.
    fn bound_m(&self, z_m: f64, theta_rad: f64, radius_m: f64) -> dermis_sim::Result<[f64; 2]> {
        let steps = [PLACE_STEP_M, PLACE_STEP_M / radius_m, LOG_STEP, LOG_STEP];
        let mut derivatives = Vec::new();
        for (which, step) in steps.into_iter().enumerate() {
            let moved = |sign: f64| {
                let mut place = [z_m, theta_rad, 0.0, 0.0];
                place[which] += sign * step;
                self.frame(place)
            };
            let change = &moved(1.0)? - &moved(-1.0)?;
            derivatives.push(
                change.iter().zip(&self.noise_ohm).map(|(one, sd)| one / (2.0 * step * sd)).collect::<Vec<f64>>(),
            );
        }
        let information = |i: usize, j: usize| derivatives[i].iter().zip(&derivatives[j]).map(|(a, b)| a * b).sum();
        let covariance = inverse(std::array::from_fn(|i| std::array::from_fn(|j| information(i, j))));
        Ok([covariance[0][0].sqrt(), radius_m * covariance[1][1].sqrt()])
    }
}

/// The inverse of a positive definite matrix (Gauss-Jordan).
fn inverse(mut matrix: [[f64; 4]; 4]) -> [[f64; 4]; 4] {
    let mut inverse: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    for pivot in 0..4 {
        let factor = matrix[pivot][pivot].recip();
        matrix[pivot].iter_mut().chain(&mut inverse[pivot]).for_each(|value| *value *= factor);
        for row in (0..4).filter(|row| *row != pivot) {
            let factor = matrix[row][pivot];
            for column in 0..4 {
                matrix[row][column] -= factor * matrix[pivot][column];
                inverse[row][column] -= factor * inverse[pivot][column];
            }
        }
    }
    inverse
}

fn main() -> dermis_sim::Result<()> {
    let skin = Skin::new()?;
    let rest = skin.forward.solve(skin.forward.rest_conductivity())?;
    let norm = |frame: &Frame| frame.iter().map(|value| value * value).sum::<f64>().sqrt();
    let change = |&(z_m, theta_rad): &(f64, f64)| -> dermis_sim::Result<f64> {
        Ok(norm(&(&skin.frame([z_m, theta_rad, 0.0, 0.0])? - &rest)) / norm(&rest))
    };
    // Positions that cover the skin uniformly (Roberts, 2018, "The unreasonable effectiveness of quasirandom
    // sequences").
    let even = |k: i32| {
        (0.3 * (f64::from(k) * 0.754_877_67).fract(), std::f64::consts::TAU * (f64::from(k) * 0.569_840_29).fract())
    };
    let changes = (0..60).map(even).map(|place| change(&place)).collect::<dermis_sim::Result<Vec<f64>>>()?;
    let change = upper_median(&changes).unwrap_or(f64::NAN);
    println!("the touch changes the frame by {:.2} % in the median", 100.0 * change);
    println!("{:>14} {:>16} {:>16}", "from rim (mm)", "along axis (mm)", "round it (mm)");
    let mut along_m = Vec::new();
    for from_rim_m in [0.001, 0.002, 0.005, 0.010, 0.015, 0.020, 0.030, 0.050, 0.150] {
        // The mean over positions around the skin, between electrodes and on them.
        let places = 12;
        let mut sum = [0.0; 2];
        for place in 0..places {
            let bound =
                skin.bound_m(from_rim_m, 0.05 + std::f64::consts::TAU * f64::from(place) / f64::from(places), 0.05)?;
            (0..2).for_each(|axis| sum[axis] += bound[axis] / f64::from(places));
        }
        println!("{:14.0} {:16.3} {:16.3}", 1e3 * from_rim_m, 1e3 * sum[0], 1e3 * sum[1]);
        along_m.push(sum[0]);
    }
    let middle_m = along_m.last().copied().expect("places");
    assert!((0.003..0.02).contains(&change), "a touch like a press: {change}");
    assert!(middle_m < 1e-3, "{middle_m}");
    assert!(along_m[0] > 3.0 * middle_m, "{along_m:?}");
    Ok(())
}
