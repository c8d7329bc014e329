//! Bounds against Monte Carlo: the spread of maximum-likelihood estimates, and the share of presses that are found.

use dermis::design::SkinDesign;
use dermis::linalg::{Matrix, invert_spd};
use dermis_sim::bound::{BoundOptions, Bounds, DriftSpread};
use dermis_sim::noise::Noise;
use dermis_sim::random::{sample_rng, standard_normal};
use dermis_sim::twin::{Press, Twin, TwinOptions};

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
max_edge_m = 0.006
electrode_edge_m = 0.0025
"#;
const DRAWS: usize = 1000;

/// The skin without errors, its noise, and its channels.
struct Bench {
    design: SkinDesign,
    options: TwinOptions,
    twin: Twin,
    noise: Noise,
}

impl Bench {
    fn new() -> Self {
        let design = SkinDesign::parse(DISK, "disk").unwrap();
        let mut options = TwinOptions::shipped("ideal").unwrap();
        options.electronics.snr_db = Some(70.0);
        let twin = Twin::new(&design, &options.as_designed(), 0).unwrap();
        let noise = twin.noise().unwrap();
        Bench { design, options, twin, noise }
    }

    /// A noisy frame, with drift of the coat and of each contact.
    fn frame(&self, press: &[Press], drift: DriftSpread, draw: u64) -> Vec<f64> {
        let mut rng = sample_rng(7, draw);
        let (_, drive_of) = self.twin.design().protocol.drives();
        let coat = 1.0 + drift.coat * standard_normal(&mut rng);
        let clean = self.twin.clean(press).unwrap();
        let noisy = self.noise.apply(&clean, &drive_of, &mut rng);
        let rest = self.twin.clean(&[]).unwrap();
        noisy.iter().zip(rest.iter()).map(|(value, rest)| value + (coat - 1.0) * rest).collect()
    }

    /// The covariance of a frame, written down entry by entry.
    fn covariance(&self, drift: DriftSpread) -> Matrix {
        let rest = self.twin.clean(&[]).unwrap();
        let (_, drive_of) = self.twin.design().protocol.drives();
        let variance = self.noise.sd_ohm.powi(2);
        let mut covariance = Matrix::zeros(rest.len(), rest.len());
        for i in 0..rest.len() {
            for j in 0..rest.len() {
                let product = rest[i] * rest[j];
                let drive = if drive_of[i] == drive_of[j] { variance / self.noise.reference_ohm.powi(2) } else { 0.0 };
                let white = if i == j { variance } else { 0.0 };
                *covariance.at_mut(i, j) = white + product * (drive + drift.coat.powi(2));
            }
        }
        covariance
    }
}

/// The position of the best press for a frame, by Newton's method on the likelihood from the true press.
fn estimate(bench: &Bench, precision: &Matrix, frame: &[f64], start: Press) -> [f64; 2] {
    let mut press = start;
    for _ in 0..6 {
        let at = |dx: f64, dy: f64, growth: f64| {
            let [x, y, z] = press.centre_m;
            let moved = Press { centre_m: [x + dx, y + dy, z], force_n: press.force_n * growth, ..press };
            bench.twin.clean(&[moved]).unwrap()
        };
        let (step, growth) = (1e-4, 1.01);
        let pairs = [
            (at(step, 0.0, 1.0), at(-step, 0.0, 1.0), step),
            (at(0.0, step, 1.0), at(0.0, -step, 1.0), step),
            (at(0.0, 0.0, growth), at(0.0, 0.0, 1.0 / growth), growth.ln()),
        ];
        let columns: Vec<Vec<f64>> = (pairs.iter())
            .map(|(forward, back, step)| forward.iter().zip(back.iter()).map(|(f, b)| (f - b) / (2.0 * step)).collect())
            .collect();
        let now = at(0.0, 0.0, 1.0);
        let rest: Vec<f64> = frame.iter().zip(now.iter()).map(|(a, b)| a - b).collect();
        let inner = |a: &[f64], b: &[f64]| -> f64 {
            let mut product = vec![0.0; b.len()];
            precision.product_into(b, &mut product);
            a.iter().zip(&product).map(|(a, b)| a * b).sum()
        };
        let mut information = Matrix::zeros(3, 3);
        for i in 0..3 {
            for j in 0..3 {
                *information.at_mut(i, j) = inner(&columns[i], &columns[j]);
            }
        }
        let slope: Vec<f64> = columns.iter().map(|column| inner(column, &rest)).collect();
        let mut change = vec![0.0; 3];
        invert_spd(&information).unwrap().product_into(&slope, &mut change);
        press.centre_m[0] += change[0].clamp(-2e-3, 2e-3);
        press.centre_m[1] += change[1].clamp(-2e-3, 2e-3);
        press.force_n *= change[2].clamp(-0.5, 0.5).exp();
    }
    [press.centre_m[0], press.centre_m[1]]
}

#[test]
fn the_spread_of_the_best_estimates_is_the_bound() {
    let bench = Bench::new();
    for drift in [DriftSpread { coat: 0.0, contact: 0.0 }, DriftSpread { coat: 0.003, contact: 0.0 }] {
        let options = BoundOptions { drift: Some(drift), ..BoundOptions::default() };
        let bounds = Bounds::new(&bench.design, &bench.options, &options).unwrap();
        let precision = invert_spd(&bench.covariance(drift)).unwrap();
        for centre_m in [[0.0, 0.0, 0.0], [0.02, 0.01, 0.0], [-0.01, 0.035, 0.0]] {
            let bound = bounds.position(centre_m, [0.0, 0.0, 1.0]).unwrap().unwrap();
            let press = Press { centre_m, force_n: options.force_n, tip_radius_m: options.tip_radius_m };
            let mut squares = [0.0; 2];
            for draw in 0..DRAWS {
                let place = estimate(&bench, &precision, &bench.frame(&[press], drift, draw as u64), press);
                (0..2).for_each(|axis| squares[axis] += (place[axis] - centre_m[axis]).powi(2) / DRAWS as f64);
            }
            for axis in 0..2 {
                let ratio = (squares[axis] / bound.covariance_m2[axis][axis]).sqrt();
                println!("{centre_m:?}, {drift:?}: bound {:.3} mm, ratio {ratio:.3}", 1e3 * bound.sd_m);
                assert!((0.9..1.1).contains(&ratio), "{ratio} at {centre_m:?}");
            }
        }
    }
}

#[test]
fn the_smallest_force_is_found_in_nine_of_ten_frames() {
    let bench = Bench::new();
    let drift = DriftSpread { coat: 0.003, contact: 0.0 };
    let options = BoundOptions { drift: Some(drift), ..BoundOptions::default() };
    let bounds = Bounds::new(&bench.design, &bench.options, &options).unwrap();
    let precision = invert_spd(&bench.covariance(drift)).unwrap();
    let (centre_m, places) = ([0.02, 0.01, 0.0], 52);
    let force_n = bounds.smallest_force_n(centre_m, places).unwrap().unwrap();
    let press = Press { centre_m, force_n, tip_radius_m: options.tip_radius_m };
    let rest = bench.twin.clean(&[]).unwrap();
    let change: Vec<f64> = bench.twin.clean(&[press]).unwrap().iter().zip(rest.iter()).map(|(a, b)| a - b).collect();
    let mut filter = vec![0.0; change.len()];
    precision.product_into(&change, &mut filter);
    let sum = |values: &[f64]| -> f64 { filter.iter().zip(values).map(|(a, b)| a * b).sum() };
    let sd = sum(&change).sqrt();
    // One false alarm an hour at 120 frames a second and 52 places: a normal variable exceeds 5.31 with 5.6e-8... / 52.
    let frames_an_hour = 3600.0 * bench.options.electronics.frame_rate_hz;
    let threshold = sd - 1.281_551_565_544_6;
    let alarms = 0.5 * dermis_sim::elementary::erfc(threshold / std::f64::consts::SQRT_2);
    assert!((alarms * frames_an_hour * f64::from(places) - 1.0).abs() < 0.1, "{alarms}");
    let found = (0..DRAWS as u64).filter(|&draw| {
        let frame = bench.frame(&[press], drift, draw);
        let difference: Vec<f64> = frame.iter().zip(rest.iter()).map(|(a, b)| a - b).collect();
        sum(&difference) / sd > threshold
    });
    let share = found.count() as f64 / DRAWS as f64;
    assert!((0.87..0.93).contains(&share), "{share}");
}
