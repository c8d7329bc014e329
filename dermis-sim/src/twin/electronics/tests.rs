//! The instrument compared with the exact circuit, the definition of its noise and the law of each part.

use super::settling::{MINUS, PLUS, SOURCE};
use super::*;
use crate::twin::{Twin, TwinError, TwinOptions};
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::linalg::{Cholesky, Matrix};
use dermis::mesh::Mesh;
use std::sync::LazyLock;

/// The paper's skin on its shipped mesh.
static SKIN: LazyLock<(SkinDesign, ForwardModel)> = LazyLock::new(|| {
    let design = SkinDesign::shipped("cylinder30").unwrap();
    let mesh = Mesh::generate(&design).unwrap();
    let forward = ForwardModel::new(&design, &mesh).unwrap();
    (design, forward)
});

/// The network of the paper's skin at a sheet resistance.
fn network(sheet_resistance_ohm: f64) -> ElectrodeNetwork {
    let rest = vec![1.0 / sheet_resistance_ohm; SKIN.1.mesh().cell_count()];
    SKIN.1.network(&rest).unwrap()
}

fn protocol() -> &'static Protocol {
    &SKIN.0.protocol
}

/// The paper's multiplexers and rates, without noise and converter.
fn settling_options() -> ElectronicsOptions {
    ElectronicsOptions {
        on_resistance_ohm: 120.0,
        on_resistance_spread_ohm: 5.0,
        line_capacitance_f: 150e-12,
        ..ElectronicsOptions::ideal()
    }
}

fn instrument(options: &ElectronicsOptions, network: &ElectrodeNetwork) -> Electronics {
    Electronics::new(options, protocol(), network, 3).unwrap()
}

fn undriven(frame: &Frame) -> f64 {
    protocol().undriven_rms(frame)
}

#[test]
fn an_instrument_without_errors_delivers_the_forward_models_frame() {
    let network = network(1e3);
    let switched = ElectronicsOptions { line_capacitance_f: 0.0, ..settling_options() };
    for options in [ElectronicsOptions::ideal(), switched] {
        let frame = instrument(&options, &network).frame(&network, 7);
        let clean = network.frame(protocol());
        let worst = frame.iter().zip(clean.iter()).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
        println!("ideal instrument against the forward model: {worst:.1e}");
        assert!(worst < 1e-12);
    }
}

/// The circuit of the settling model again, node by node: the skin's admittance, a conductance for each closed switch,
/// capacitances on the lines and, if `wire_f` is not zero, on every electrode; integrated by the fourth-order
/// Runge-Kutta method in steps far below its shortest time constant.
struct Nodal<'a> {
    electronics: &'a Electronics,
    network: &'a ElectrodeNetwork,
    wire_f: f64,
}

impl Nodal<'_> {
    /// Conductances between all nodes (electrodes, then lines) in a slot, and the currents fed in.
    fn circuit(&self, pair: Pair, measure: Option<Pair>) -> (Matrix, Vec<f64>) {
        let (options, on_ohm) = (&self.electronics.options, &self.electronics.on_ohm);
        let count = protocol().electrode_count();
        let mut g = Matrix::zeros(count + 3, count + 3);
        for i in 0..count {
            for j in 0..count {
                *g.at_mut(i, j) = self.network.admittance.at(i, j);
            }
        }
        let mut fed = vec![0.0; count + 3];
        let mut join = |i: usize, j: Option<usize>, ohm: f64| {
            *g.at_mut(i, i) += 1.0 / ohm;
            if let Some(j) = j {
                *g.at_mut(j, j) += 1.0 / ohm;
                *g.at_mut(i, j) -= 1.0 / ohm;
                *g.at_mut(j, i) -= 1.0 / ohm;
            }
        };
        join(pair[0], Some(count + SOURCE), on_ohm[SOURCE][pair[0]]);
        join(pair[1], None, on_ohm[GROUND][pair[1]]);
        join(count + SOURCE, None, options.reference_ohm);
        fed[count + SOURCE] += options.source_v / options.reference_ohm;
        match measure {
            Some([plus, minus]) => {
                join(plus, Some(count + PLUS), on_ohm[PLUS][plus]);
                join(minus, Some(count + MINUS), on_ohm[MINUS][minus]);
            }
            None => {
                join(count + PLUS, None, on_ohm[PLUS][count]);
                fed[count + PLUS] += options.source_v / on_ohm[PLUS][count];
                join(count + SOURCE, Some(count + MINUS), on_ohm[MINUS][count]);
            }
        }
        (g, fed)
    }

    /// The nodes that store charge, and the circuit with all others eliminated.
    fn states(&self, pair: Pair, measure: Option<Pair>) -> (Matrix, Vec<f64>) {
        let (g, fed) = self.circuit(pair, measure);
        let count = protocol().electrode_count();
        if self.wire_f > 0.0 {
            return (g, fed);
        }
        let mut inner = Matrix::zeros(count, count);
        (0..count).for_each(|i| inner.row_mut(i).copy_from_slice(&g.row(i)[..count]));
        let inverse = Cholesky::new(&inner).unwrap().inverse();
        let mut reduced = Matrix::zeros(3, 3);
        for a in 0..3 {
            for b in 0..3 {
                let mut through = 0.0;
                for i in 0..count {
                    for j in 0..count {
                        through += g.at(count + a, i) * inverse.at(i, j) * g.at(j, count + b);
                    }
                }
                *reduced.at_mut(a, b) = g.at(count + a, count + b) - through;
            }
        }
        (reduced, fed[count..].to_vec())
    }

    fn frame(&self, drive_count: usize) -> Frame {
        let options = &self.electronics.options;
        let line_f = options.line_capacitance_f;
        let count = protocol().electrode_count();
        let capacitance: Vec<f64> = match self.wire_f > 0.0 {
            true => [vec![self.wire_f; count], vec![line_f; 3]].concat(),
            false => vec![line_f; 3],
        };
        let least_f = capacitance.iter().fold(f64::INFINITY, |a, &b| a.min(b));
        let slot_s = 1.0 / options.slot_rate_hz;
        let steps = (slot_s / (0.3 * 115.0 * least_f)).ceil() as usize;
        let lines = capacitance.len() - 3;
        let mut values = vec![f64::NAN; protocol().channel_count()];
        let mut state: Option<Vec<f64>> = None;
        for drive in &self.electronics.drives[..drive_count] {
            let mut reference_v = f64::NAN;
            let slots = std::iter::once(None).chain(drive.channels.iter().map(|&channel| Some(channel)));
            for slot in slots {
                let measure = slot.map(|channel| protocol().channels()[channel].measure);
                let (g, fed) = self.states(drive.pair, measure);
                let mut v = state.take().unwrap_or_else(|| Cholesky::new(&g).unwrap().solve(&fed));
                integrate(&g, &fed, &capacitance, slot_s, steps, &mut v);
                let read_v = v[lines + PLUS] - v[lines + MINUS];
                match slot {
                    None => reference_v = read_v,
                    Some(channel) => values[channel] = read_v / reference_v * options.reference_ohm,
                }
                state = Some(v);
            }
        }
        Frame(values)
    }
}

trait MultiplyVector {
    fn multiply_vector(&self, x: &[f64]) -> Vec<f64>;
}

impl MultiplyVector for Matrix {
    fn multiply_vector(&self, x: &[f64]) -> Vec<f64> {
        (0..self.rows).map(|i| self.row(i).iter().zip(x).map(|(a, b)| a * b).sum()).collect()
    }
}

/// `C dv/dt = f - G v` over a slot.
fn integrate(g: &Matrix, fed: &[f64], capacitance: &[f64], slot_s: f64, steps: usize, v: &mut [f64]) {
    let dt = slot_s / steps as f64;
    let slope = |v: &[f64]| -> Vec<f64> {
        let drawn = g.multiply_vector(v);
        (0..v.len()).map(|i| (fed[i] - drawn[i]) / capacitance[i]).collect()
    };
    let ahead = |v: &[f64], k: &[f64], h: f64| -> Vec<f64> { v.iter().zip(k).map(|(v, k)| v + h * k).collect() };
    for _ in 0..steps {
        let k1 = slope(v);
        let k2 = slope(&ahead(v, &k1, 0.5 * dt));
        let k3 = slope(&ahead(v, &k2, 0.5 * dt));
        let k4 = slope(&ahead(v, &k3, dt));
        for i in 0..v.len() {
            v[i] += dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
    }
}

#[test]
fn settling_is_that_of_the_exact_circuit() {
    let network = network(20e3);
    let electronics = instrument(&settling_options(), &network);
    let (model, clean) = (electronics.frame(&network, 0), network.frame(protocol()));
    let exact = Nodal { electronics: &electronics, network: &network, wire_f: 0.0 }.frame(30);
    let error = undriven(&(&model - &clean)) / undriven(&clean);
    let apart = undriven(&(&model - &exact)) / undriven(&clean);
    println!("20 kohm per square: settling error {error:.2e} of r, model and exact circuit {apart:.1e} apart");
    assert!(error > 1e-4, "there must be an error to compare: {error:e}");
    assert!(apart < 1e-3 * error);
    let worst = model.iter().zip(exact.iter()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-3 * error * undriven(&clean), "a value is {worst:e} ohm off");
}

#[test]
fn settling_at_four_sheet_resistances() {
    let mut errors = Vec::new();
    for sheet_resistance_ohm in [200.0, 1e3, 5e3, 20e3] {
        let network = network(sheet_resistance_ohm);
        let report = instrument(&settling_options(), &network).report(&network, 0..1);
        println!(
            "{:5.1} kohm per square: r {:8.3} ohm, settling error {:.2e} ohm, {:.2e} of r",
            sheet_resistance_ohm / 1e3,
            report.signal_ohm,
            report.settling.rms_ohm,
            report.settling.relative
        );
        assert_eq!(report.total, report.settling);
        errors.push(report.settling.relative);
    }
    assert!(errors[0] < 1e-12 && errors[1] < 1e-3, "{errors:?}");
    assert!(errors[3] > 1e-3, "at 20 kohm per square the lines must lag: {errors:?}");
}

#[test]
fn what_the_wires_own_capacitance_would_add() {
    for (sheet_resistance_ohm, most) in [(1e3, 1e-6), (20e3, 0.03)] {
        let network = network(sheet_resistance_ohm);
        let electronics = instrument(&settling_options(), &network);
        let (model, clean) = (electronics.frame(&network, 0), network.frame(protocol()));
        let wired = Nodal { electronics: &electronics, network: &network, wire_f: 10e-12 }.frame(2);
        let (mut model_sum, mut apart_sum) = (0.0, 0.0);
        for &channel in electronics.drives[..2].iter().flat_map(|drive| &drive.channels) {
            if !protocol().channels()[channel].touches_driven() {
                model_sum += (model[channel] - clean[channel]).powi(2);
                apart_sum += (model[channel] - wired[channel]).powi(2);
            }
        }
        let scale = undriven(&clean) * 54f64.sqrt();
        let (error, apart) = (model_sum.sqrt() / scale, apart_sum.sqrt() / scale);
        println!(
            "{:5.1} kohm per square: settling error {error:.2e} of r, {apart:.2e} more with 10 pF on each wire",
            sheet_resistance_ohm / 1e3
        );
        assert!(apart < most, "the wires' own capacitance matters: {apart:e}");
    }
}

#[test]
fn fifty_decibels_are_measured_on_the_frames() {
    let network = network(1e3);
    let options = ElectronicsOptions { snr_db: Some(50.0), ..settling_options() };
    let options = ElectronicsOptions { line_capacitance_f: 0.0, ..options };
    let electronics = instrument(&options, &network);
    let clean = network.frame(protocol());
    let frames = 200;
    let sum: f64 = (0..frames).map(|i| undriven(&(&electronics.frame(&network, i) - &clean)).powi(2)).sum();
    let measured_db = 20.0 * (undriven(&clean) / (sum / frames as f64).sqrt()).log10();
    println!("noise of the untouched skin: {measured_db:.3} dB");
    // The relative standard error of a standard deviation over 162,000 readings is 0.18 %, 0.015 dB; the reference's
    // contribution is below that.
    assert!((measured_db - 50.0).abs() < 0.06);
    // The values of every drive have the same noise, for any current.
    let sd = electronics.noise().unwrap().sd_ohm;
    for drive in &electronics.drives {
        let quiet = |channel: &&usize| !protocol().channels()[**channel].touches_driven();
        let sum: f64 = (0..frames)
            .map(|i| electronics.frame(&network, i))
            .map(|frame| drive.channels.iter().filter(quiet).map(|&c| (frame[c] - clean[c]).powi(2)).sum::<f64>())
            .sum();
        let own = (sum / (27 * frames) as f64).sqrt();
        assert!((own / sd - 1.0).abs() < 0.06, "drive {:?}: {own} for {sd}", drive.pair);
    }
}

#[test]
fn frames_depend_on_seed_and_number_alone() {
    let network = network(1e3);
    let options = ElectronicsOptions { snr_db: Some(50.0), ..settling_options() };
    let electronics = instrument(&options, &network);
    assert_eq!(electronics.frame(&network, 4), instrument(&options, &network).frame(&network, 4));
    assert_ne!(electronics.frame(&network, 4), electronics.frame(&network, 5));
    let other = Electronics::new(&options, protocol(), &network, 4).unwrap();
    assert_ne!(electronics.frame(&network, 4), other.frame(&network, 4));
}

#[test]
fn a_report_splits_the_error_into_its_parts() {
    let network = network(1e3);
    let hum = HumOptions { amplitude_v: 1e-4, frequency_hz: 50.0 };
    let adc = AdcOptions { bits: 14, range_v: 1.0, gain: 2.0, gain_driven: 1.0, gain_reference: 1.0 };
    let options = ElectronicsOptions {
        snr_db: Some(60.0),
        hum: Some(hum),
        gain_error: 2e-3,
        adc: Some(adc),
        ..settling_options()
    };
    let electronics = instrument(&options, &network);
    let report = electronics.report(&network, 0..40);
    println!("{}", serde_json::to_string_pretty(&report).unwrap());
    assert!((report.gain.relative / 2e-3 - 1.0).abs() < 0.05);
    assert!((report.noise.relative / 1e-3 - 1.0).abs() < 0.05);
    // A sine of amplitude a has the root mean square a / sqrt 2; in ohm it is divided by each drive's current.
    let of_drives =
        |power: fn(f64) -> f64| electronics.drives.iter().map(|drive| power(drive.calibration_a)).sum::<f64>() / 30.0;
    let per_a = of_drives(|a| a.powi(-2)).sqrt();
    assert!((report.hum.rms_ohm / (per_a * 1e-4 / 2f64.sqrt()) - 1.0).abs() < 0.05, "hum {:?}", report.hum);
    // The quantisation error for steps of q is q / sqrt 12 (Bennett, 1948, DOI 10.1002/j.1538-7305.1948.tb01340.x).
    let step_v = 1.0 / 2.0 / 8192.0;
    assert!((report.quantisation.rms_ohm / (per_a * step_v / 12f64.sqrt()) - 1.0).abs() < 0.1);
    assert!(report.settling.relative < 1e-6, "the lines settle at 1 kohm per square");
    let parts = [report.settling, report.hum, report.gain, report.noise, report.quantisation];
    let together = parts.iter().map(|part| part.rms_ohm * part.rms_ohm).sum::<f64>().sqrt();
    assert!((report.total.rms_ohm / together - 1.0).abs() < 0.2, "the parts are nearly independent");
    assert_eq!(report.saturated_readings, 0);
}

#[test]
fn readings_out_of_range_are_counted_and_held() {
    let network = network(1e3);
    let adc = AdcOptions { bits: 12, range_v: 1.0, gain: 1.0, gain_driven: 1e3, gain_reference: 1.0 };
    let options = ElectronicsOptions { adc: Some(adc), ..ElectronicsOptions::ideal() };
    let electronics = instrument(&options, &network);
    // The two values of each drive with a driven electrode.
    assert_eq!(electronics.report(&network, 0..2).saturated_readings, 2 * 60);
    let frame = electronics.frame(&network, 0);
    assert!(frame.iter().all(|value| value.is_finite()));
}

#[test]
fn hum_is_a_sine_of_the_mains_frequency_at_the_readings_time() {
    let network = network(1e3);
    let hum = HumOptions { amplitude_v: 0.02, frequency_hz: 60.0 };
    let electronics = instrument(&ElectronicsOptions { hum: Some(hum), ..ElectronicsOptions::ideal() }, &network);
    let clean = network.frame(protocol());
    // 60 Hz at 120 frames per second: every second frame is equal, the one between has the opposite sign.
    let off = |index| &electronics.frame(&network, index) - &clean;
    let (first, second, third) = (off(0), off(1), off(2));
    for channel in 0..first.len() {
        assert!((first[channel] + second[channel]).abs() < 1e-9 && (first[channel] - third[channel]).abs() < 1e-9);
    }
    assert!(undriven(&first) > 1.0);
}

#[test]
fn impossible_instruments_are_refused_by_field() {
    let refused = |change: fn(&mut ElectronicsOptions)| {
        let mut options = settling_options();
        change(&mut options);
        let error = options.check(protocol()).unwrap_err();
        assert!(matches!(&error, TwinError::OutOfRange { fix, .. } if !fix.is_empty()), "{error}");
        error.field().unwrap()
    };
    assert_eq!(refused(|o| o.source_v = -1.0), "electronics.source_v");
    assert_eq!(refused(|o| o.reference_ohm = f64::NAN), "electronics.reference_ohm");
    assert_eq!(refused(|o| o.line_capacitance_f = 150.0), "electronics.line_capacitance_f");
    assert_eq!(refused(|o| o.on_resistance_spread_ohm = 60.0), "electronics.on_resistance_spread_ohm");
    assert_eq!(refused(|o| o.frame_rate_hz = 140.0), "electronics.frame_rate_hz");
    assert_eq!(refused(|o| o.snr_db = Some(f64::INFINITY)), "electronics.snr_db");
    let adc = AdcOptions { bits: 12, range_v: 1.0, gain: 1.0, gain_driven: 1.0, gain_reference: 1.0 };
    assert!(
        ElectronicsOptions { adc: Some(AdcOptions { bits: 1, ..adc }), ..settling_options() }.check_ranges().is_err()
    );
    assert!(
        ElectronicsOptions { adc: Some(AdcOptions { gain: 0.0, ..adc }), ..settling_options() }.check_ranges().is_err()
    );
}

/// The shipped instruments on their skins, ten of each.
#[test]
fn the_shipped_instruments_stay_in_range() {
    for name in ["lab", "harsh"] {
        let mut options = TwinOptions::shipped(name).unwrap();
        options.touch = TwinOptions::shipped("ideal").unwrap().touch;
        options.mesh_scale = 1.6;
        let reports: Vec<ElectronicsReport> =
            (1..=10).map(|seed| Twin::new(&SKIN.0, &options, seed).unwrap().report(0..5).unwrap()).collect();
        let range = |part: fn(&ElectronicsReport) -> f64| {
            let values: Vec<f64> = reports.iter().map(part).collect();
            let ends = |pick: fn(f64, f64) -> f64| values.iter().copied().reduce(pick).unwrap();
            format!("{:.1e} to {:.1e}", ends(f64::min), ends(f64::max))
        };
        println!(
            "{name}, in parts of r: settling {}, hum {}, gain {}, noise {}, quantisation {}, total {}",
            range(|r| r.settling.relative),
            range(|r| r.hum.relative),
            range(|r| r.gain.relative),
            range(|r| r.noise.relative),
            range(|r| r.quantisation.relative),
            range(|r| r.total.relative)
        );
        for report in &reports {
            assert_eq!(report.saturated_readings, 0);
            assert!(report.quantisation.rms_ohm < 0.6 * report.noise.rms_ohm, "noise must hide the steps");
            assert!(report.settling.relative < 1e-5);
        }
    }
}

#[test]
fn an_instrument_reads_a_frame_in_less_than_a_millisecond() {
    let skin = network(1e3);
    let electronics = instrument(&TwinOptions::shipped("harsh").unwrap().electronics, &skin);
    let mut times: Vec<f64> = (0..101)
        .map(|index| {
            let begun = std::time::Instant::now();
            std::hint::black_box(electronics.frame(&skin, index));
            begun.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("a frame of 870 values through the instrument: {:.3} ms (median of 101)", 1e3 * times[50]);
    assert!(times[50] < 1e-3);
}
