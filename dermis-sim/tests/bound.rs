//! Bounds against Monte Carlo: the spread of maximum-likelihood estimates, and the share of presses that are found.

use dermis::design::SkinDesign;
use dermis::estimate::drift::DriftSpread;
use dermis::linalg::{Cholesky, Matrix};
use dermis_sim::bound::{BoundOptions, Bounds};
use dermis_sim::noise::Noise;
use dermis_sim::random::{sample_rng, standard_normal};
use dermis_sim::twin::{Press, TouchOptions, Twin, TwinOptions};
use rayon::prelude::*;

const DISK: &str = r#"
name = "disk"
[body.disk]
diameter_m = 0.1
[sheet]
sheet_resistance_ohm = 1000
touch = "conductance_rises"
[electrodes]
shape.arc.length_m = 0.005
contact_impedance_ohm_m = 0.01
layout.rim.count = 8
[protocol]
pattern = "adjacent"
[image.grid]
rows = 8
columns = 8
[mesh]
max_edge_m = 0.003
electrode_edge_m = 0.0025
"#;
const DRAWS: u64 = 400;
const NORMAL: [f64; 3] = [0.0, 0.0, 1.0];
/// Prior standard deviation of the logarithm of the tip radius, as docs/bounds.md states it.
const LOG_RADIUS_SD: f64 = 0.5;

/// The skin without errors, its noise, and the drift of its coat.
struct Bench {
    design: SkinDesign,
    options: TwinOptions,
    twin: Twin,
    noise: Noise,
    drift: DriftSpread,
    /// The inverse of the covariance of a frame.
    precision: Matrix,
}

impl Bench {
    fn new(twin: &str, snr_db: f64, coat_drift: f64) -> Self {
        let design = SkinDesign::parse(DISK, "disk").unwrap();
        let mut options = TwinOptions::shipped(twin).unwrap();
        options.electronics.snr_db = Some(snr_db);
        if let TouchOptions::Patches(patches) = &mut options.touch {
            (patches.rows, patches.columns) = (10, 10);
        }
        let twin = Twin::new(&design, &options.as_designed(), 0).unwrap();
        let noise = twin.noise().unwrap();
        let drift = DriftSpread { sheet: coat_drift, ..DriftSpread::default() };
        let precision = Cholesky::new(&covariance(&twin, noise, drift)).unwrap().inverse();
        Bench { design, options, twin, noise, drift, precision }
    }

    fn bounds(&self) -> Bounds {
        let options = BoundOptions { drift: Some(self.drift), known_patches: true, ..BoundOptions::default() };
        Bounds::new(&self.design, &self.options, &options).unwrap()
    }

    /// A noisy frame, with drift of the coat.
    fn frame(&self, presses: &[Press], draw: u64) -> Vec<f64> {
        let mut rng = sample_rng(7, draw);
        let (_, drive_of) = self.twin.design().protocol.drives();
        let drift = self.drift.sheet * standard_normal(&mut rng);
        let noisy = self.noise.apply(&self.twin.clean(presses).unwrap(), &drive_of, &mut rng);
        noisy.iter().zip(self.twin.clean(&[]).unwrap().iter()).map(|(value, rest)| value + drift * rest).collect()
    }

    /// `a' R^-1 b`.
    fn inner(&self, a: &[f64], b: &[f64]) -> f64 {
        let mut product = vec![0.0; b.len()];
        self.precision.product_into(b, &mut product);
        a.iter().zip(&product).map(|(a, b)| a * b).sum()
    }

    /// Twice the negative logarithm of the posterior of some parameters.
    fn misfit(&self, frame: &[f64], parameters: &[f64]) -> f64 {
        // The foam does not bear every press.
        let Ok(clean) = self.twin.clean(&presses(parameters)) else { return f64::INFINITY };
        let rest = difference(frame, &clean);
        self.inner(&rest, &rest) + (parameters[0] / LOG_RADIUS_SD).powi(2)
    }

    /// The most probable parameters for a frame, by damped Gauss-Newton steps from a start, and their misfit.
    fn fit(&self, frame: &[f64], start: &[f64]) -> (Vec<f64>, f64) {
        let (mut best, mut damping) = (start.to_vec(), 1e-3);
        let mut misfit = self.misfit(frame, &best);
        for _ in 0..30 {
            // At the limit of what the foam bears there are no derivatives.
            let Ok((information, slope)) = self.normal_equations(frame, &best) else { break };
            let before = misfit;
            while damping < 1e6 {
                let mut damped = information.clone();
                (0..best.len()).for_each(|i| *damped.at_mut(i, i) *= 1.0 + damping);
                let step = Cholesky::new(&damped).unwrap().solve(&slope);
                let tried: Vec<f64> = best.iter().zip(&step).map(|(a, b)| a + b.clamp(-0.5, 0.5)).collect();
                let reached = self.misfit(frame, &tried);
                if reached < misfit {
                    (best, misfit, damping) = (tried, reached, 0.1 * damping);
                    break;
                }
                damping *= 10.0;
            }
            if before - misfit < 1e-3 {
                break;
            }
        }
        (best, misfit)
    }

    fn normal_equations(&self, frame: &[f64], at: &[f64]) -> dermis_sim::Result<(Matrix, Vec<f64>)> {
        let clean = self.twin.clean(&presses(at))?;
        let rest = difference(frame, &clean);
        // Differences to one side are exact enough for a direction.
        let column = |index: usize| -> dermis_sim::Result<Vec<f64>> {
            let step = if index.is_multiple_of(3) { 0.01 } else { 1e-4 };
            let mut moved = at.to_vec();
            moved[index] += step;
            Ok(difference(&self.twin.clean(&presses(&moved))?, &clean)
                .into_iter()
                .map(|change| change / step)
                .collect())
        };
        let columns = (0..at.len()).map(column).collect::<dermis_sim::Result<Vec<Vec<f64>>>>()?;
        let mut information = Matrix::zeros(at.len(), at.len());
        for (i, a) in columns.iter().enumerate() {
            columns.iter().enumerate().for_each(|(j, b)| *information.at_mut(i, j) = self.inner(a, b));
        }
        *information.at_mut(0, 0) += LOG_RADIUS_SD.powi(-2);
        let mut slope: Vec<f64> = columns.iter().map(|column| self.inner(column, &rest)).collect();
        slope[0] -= at[0] / LOG_RADIUS_SD.powi(2);
        Ok((information, slope))
    }
}

/// The parameters of presses with one tip: the logarithm of its radius over that of the options; for each press x, y and
/// the logarithm of its force.
fn parameters(presses: &[Press]) -> Vec<f64> {
    let each = presses.iter().flat_map(|press| [press.centre_m[0], press.centre_m[1], press.force_n.ln()]);
    std::iter::once((presses[0].tip_radius_m / BoundOptions::default().tip_radius_m).ln()).chain(each).collect()
}

fn presses(parameters: &[f64]) -> Vec<Press> {
    let tip_radius_m = BoundOptions::default().tip_radius_m * parameters[0].exp();
    let press = |each: &[f64]| Press { centre_m: [each[0], each[1], 0.0], force_n: each[2].exp(), tip_radius_m };
    parameters[1..].chunks(3).map(press).collect()
}

fn press(centre_m: [f64; 3], force_n: f64) -> Press {
    Press { centre_m, force_n, tip_radius_m: BoundOptions::default().tip_radius_m }
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// The covariance of a frame, entry by entry.
fn covariance(twin: &Twin, noise: Noise, drift: DriftSpread) -> Matrix {
    let rest = twin.clean(&[]).unwrap();
    let (_, drive_of) = twin.design().protocol.drives();
    let variance = noise.sd_ohm.powi(2);
    let mut covariance = Matrix::zeros(rest.len(), rest.len());
    for i in 0..rest.len() {
        for j in 0..rest.len() {
            let drive = if drive_of[i] == drive_of[j] { variance / noise.reference_ohm.powi(2) } else { 0.0 };
            let white = if i == j { variance } else { 0.0 };
            *covariance.at_mut(i, j) = white + rest[i] * rest[j] * (drive + drift.sheet.powi(2));
        }
    }
    covariance
}

fn share(draws: u64, of: impl Fn(u64) -> bool + Sync) -> f64 {
    (0..draws).into_par_iter().filter(|&draw| of(draw)).count() as f64 / draws as f64
}

/// Over places, and for an even and a drifting coat.
fn the_spread_of_estimates_is_the_bound(bench: &Bench) {
    let bounds = bench.bounds();
    for centre_m in [[0.0, 0.0, 0.0], [0.02, 0.01, 0.0], [-0.01, 0.035, 0.0]] {
        let bound = bounds.position(centre_m, NORMAL).unwrap().unwrap();
        let truth = press(centre_m, BoundOptions::default().force_n);
        let squared_errors = |draw: u64| {
            let log_radius = LOG_RADIUS_SD * standard_normal(&mut sample_rng(8, draw));
            let tip_radius_m = truth.tip_radius_m * log_radius.clamp(-1.0, 1.0).exp();
            let truth = Press { tip_radius_m, ..truth };
            let (best, _) = bench.fit(&bench.frame(&[truth], draw), &parameters(&[truth]));
            [0, 1].map(|axis| (best[1 + axis] - centre_m[axis]).powi(2) / DRAWS as f64)
        };
        let squares =
            (0..DRAWS).into_par_iter().map(squared_errors).reduce(|| [0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        for (axis, square) in squares.iter().enumerate() {
            let ratio = (square / bound.covariance_m2[axis][axis]).sqrt();
            println!("{} {centre_m:?}: bound {:.3} mm, ratio {ratio:.3}", bench.options.name, 1e3 * bound.sd_m);
            assert!((0.9..1.1).contains(&ratio), "{ratio} at {centre_m:?}");
        }
    }
}

#[test]
fn the_spread_of_estimates_is_the_bound_for_gaussian_touches() {
    the_spread_of_estimates_is_the_bound(&Bench::new("ideal", 70.0, 0.0));
    the_spread_of_estimates_is_the_bound(&Bench::new("ideal", 70.0, 0.003));
}

#[test]
fn the_spread_of_estimates_is_the_bound_for_presses_on_patches() {
    the_spread_of_estimates_is_the_bound(&Bench::new("lab", 50.0, 0.003));
}

#[test]
fn the_smallest_force_is_found_in_nine_of_ten_frames() {
    let bench = Bench::new("ideal", 70.0, 0.003);
    let (centre_m, places) = ([0.02, 0.01, 0.0], 52);
    let force_n = bench.bounds().smallest_force_n(centre_m, places).unwrap().unwrap();
    let rest = bench.twin.clean(&[]).unwrap();
    let change = difference(&bench.twin.clean(&[press(centre_m, force_n)]).unwrap(), &rest);
    let sd = bench.inner(&change, &change).sqrt();
    // One false alarm an hour, over all frames and places; the force is at most 0.1 % above the smallest.
    let frames_an_hour = 3600.0 * bench.options.electronics.frame_rate_hz;
    let threshold = sd - 1.281_551_565_544_6;
    let alarms = 0.5 * dermis_sim::elementary::erfc(threshold / std::f64::consts::SQRT_2);
    assert!((alarms * frames_an_hour * places as f64 - 1.0).abs() < 0.1, "{alarms}");
    // At the smallest force and below it.
    for (part, range) in [(1.0, 0.87..0.93), (0.8, 0.2..0.6)] {
        let press = press(centre_m, part * force_n);
        let change = difference(&bench.twin.clean(&[press]).unwrap(), &rest);
        let sd = bench.inner(&change, &change).sqrt();
        let found = share(DRAWS, |draw| {
            bench.inner(&change, &difference(&bench.frame(&[press], draw), &rest)) / sd > threshold
        });
        let stated = bench.bounds().probability_found(&press, places).unwrap();
        println!("{part}: found {found:.3}, stated {stated:.3}");
        assert!(range.contains(&found) && (found - stated).abs() < 0.03, "{found} {stated}");
    }
}

#[test]
fn two_presses_are_told_from_one_in_nine_of_ten_frames() {
    let bench = Bench::new("ideal", 50.0, 0.003);
    let (x, y, force_n) = (0.02, 0.01, BoundOptions::default().force_n);
    let bounds = bench.bounds();
    let distance_m = bounds.separation_m([x, y, 0.0], 0.0).unwrap().unwrap();
    let pair = [-0.5, 0.5].map(|side| press([x + side * distance_m, y, 0.0], force_n));
    let single = press([x, y, 0.0], 2.0 * force_n);
    // No single press fits as well, wherever its fit starts: by the 99th percentile of the chi-square distribution with three
    // degrees of freedom.
    let is_pair = |frame: &[f64]| {
        let misfit = |start: &[Press]| bench.fit(frame, &parameters(start)).1;
        let of_pair = misfit(&pair);
        [&[single][..], &pair[..1], &pair[1..]].into_iter().all(|start| misfit(start) - of_pair > 11.344_866_730)
    };
    // A fit takes long: half the draws, whose share has a standard error of 2 %.
    let told = |presses: &[Press]| share(DRAWS / 2, |draw| is_pair(&bench.frame(presses, draw)));
    let (two, one) = (told(&pair), told(&[single]));
    let predicted = bounds.told_apart(&pair).unwrap();
    println!("{:.1} mm: told from one {two}, predicted {predicted}; one taken for two {one}", 1e3 * distance_m);
    assert!((0.9..0.93).contains(&predicted), "{predicted}");
    // Near one press the place of the second hardly changes the frame at first order, so the ratio has fewer than the
    // three degrees of freedom of the prediction: with one, 79 % would be told from one.
    assert!((0.79..predicted + 0.03).contains(&two), "{two}, {predicted}");
    assert!(one < 0.02, "{one}");
}

/// Told also from one object of any length, two presses must be farther apart: a row of presses may be a single one.
#[test]
fn two_presses_are_farther_apart_where_the_form_is_unknown() {
    let bench = Bench::new("ideal", 50.0, 0.0);
    let options = BoundOptions { drift: Some(bench.drift), known_patches: true, ..BoundOptions::default() };
    let apart_m = [true, false].map(|known_form| {
        let options = BoundOptions { known_form, ..options };
        let bounds = Bounds::new(&bench.design, &bench.options, &options).unwrap();
        let distance_m = bounds.separation_m([0.02, 0.01, 0.0], 0.0).unwrap().unwrap();
        let pair = [-0.5, 0.5].map(|side| press([0.02 + side * distance_m, 0.01, 0.0], options.force_n));
        let predicted = bounds.told_apart(&pair).unwrap();
        assert!((0.9..0.93).contains(&predicted), "{known_form}: {predicted}");
        distance_m
    });
    println!("{apart_m:?}");
    assert!(apart_m[1] > 1.2 * apart_m[0], "{apart_m:?}");
}
