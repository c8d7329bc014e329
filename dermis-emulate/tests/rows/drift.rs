//! Drift of all values, under a touch of ten minutes and without one; and what is left of a touch that the model does not know.

use crate::rows::bench::{Bench, TARE, lab, place, stroke};
use dermis::method::{MethodSet, Methods};
use dermis::pipeline::{FrameInput, Pipeline, Settings, Timestamp};
use dermis::skin::Skin;
use dermis_sim::noise::Noise;
use dermis_sim::random::{sample_rng, standard_normal};
use dermis_sim::touch::{GaussianTouch, touched_conductivity};

/// Frames per second: the time matters, not the number of frames.
const RATE_HZ: f64 = 10.0;
/// The touch begins, ends, and is over, s.
const TIMES_S: [f64; 3] = [20.0, 620.0, 625.0];
/// The run ends, s.
const END_S: f64 = 800.0;

/// Frames with contacts more than 5 s after the touch, and all frames with its contact, of how many. All values grow by a part
/// of themselves during the touch and stay so.
fn run(method: &str, part: f64, seed: u64) -> [u32; 3] {
    let mut twin = lab();
    twin.electronics.frame_rate_hz = RATE_HZ;
    let [from_s, to_s, over_s] = TIMES_S;
    let theta_deg = 100.0 + 37.0 * seed as f64;
    let touch = stroke(from_s, to_s - from_s, place(0.13, theta_deg), None, 3.9);
    let settings = Settings { method: method.into(), ..Settings::default() };
    let mut bench = Bench::new(twin, 620 + seed, vec![touch], settings);
    assert_eq!(bench.next, TARE);
    let (mut false_frames, mut held, mut of) = (0, 0, 0);
    while bench.time_s() < END_S {
        let time_s = bench.time_s();
        let grown = 1.0 + part * ((time_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0);
        let frame = bench.changed(|values| values.iter_mut().for_each(|value| *value *= grown));
        bench.rebuild();
        false_frames += u32::from(time_s > over_s && !frame.contacts.is_empty());
        if (from_s + 1.0..to_s).contains(&time_s) {
            of += 1;
            held += u32::from(frame.validity.is_usable() && frame.contacts.len() == 1);
        }
    }
    [false_frames, held, of]
}

fn table(parts: &[f64], methods: &[&str], seeds: u64) {
    for &part in parts {
        for &method in methods {
            let mut all = [0; 3];
            for seed in 0..seeds {
                run(method, part, seed).into_iter().zip(&mut all).for_each(|(count, all)| *all += count);
            }
            let [false_frames, held, of] = all;
            println!(
                "{method}, {:.0} %: {false_frames} frames with contacts later than 5 s after the touch; one contact in {held} \
                 of {of} frames of the touch",
                100.0 * part
            );
            assert_eq!(false_frames, 0, "{method}, {part}");
        }
    }
}

#[test]
fn drift_under_a_touch_leaves_no_contact() {
    table(&[0.1], &["noser"], 1);
}

/// All values grow by 1 % a minute, as the fastest drift above: no frame is touched.
#[test]
fn drift_without_a_touch_is_none() {
    let mut bench = Bench::new(lab(), 641, Vec::new(), Settings::default());
    while bench.time_s() < 30.0 {
        let time_s = bench.time_s();
        let grown = 1.0 + 0.01 / 60.0 * time_s;
        let frame = bench.changed(|values| values.iter_mut().for_each(|value| *value *= grown));
        assert_eq!((frame.touched, frame.contacts.len()), (Some(false), 0), "{time_s:.2} s");
    }
}

/// The channels of a membrane have gains of their own, which its model does not know: what they leave of a press of two seconds is taken
/// for drift of its contacts. After the release nothing is touched.
#[test]
fn a_press_on_an_uncalibrated_skin_leaves_no_touch() {
    let skin = Skin::load("skin16").unwrap();
    let methods = std::sync::Arc::new(MethodSet::new(&Methods::linear(), skin.clone(), None).unwrap());
    let (design, rest) = (skin.design(), skin.forward().rest_conductivity());
    let press = GaussianTouch { centre_m: [0.015, 0.01, 0.0], amplitude: 1.0, width_m: 0.005 };
    let pressed =
        touched_conductivity(skin.mesh(), &design.body.surface(), design.sheet.touch, rest, &[press]).unwrap();
    let frames = [rest, &pressed].map(|conductivity| skin.forward().solve(conductivity).unwrap());
    let noise = Noise::at_snr_db(60.0, &frames[0], &design.protocol, f64::INFINITY).unwrap();
    let (_, drive_of) = design.protocol.drives();
    for seed in 0..4 {
        let mut rng = sample_rng(642, seed);
        let gains: Vec<f64> = frames[0].iter().map(|_| 1.0 + 0.03 * standard_normal(&mut rng)).collect();
        let mut pipeline = Pipeline::new(methods.clone(), Settings::default()).unwrap();
        for index in 0..960u64 {
            let is_pressed = (240..480).contains(&index);
            let frame = noise.apply(&frames[usize::from(is_pressed)], &drive_of, &mut sample_rng(643 + seed, index));
            let values_ohm = frame.iter().zip(&gains).map(|(value, gain)| (value * gain).abs()).collect();
            let measured_at = Timestamp { unix_ns: index * 8_333_333 };
            let read = pipeline.process(FrameInput::new(index, measured_at, values_ohm)).unwrap();
            if (245..480).contains(&index) {
                assert_eq!(read.contacts.len(), 1, "seed {seed}, frame {index}");
            }
            if index >= 500 {
                assert_eq!((read.touched, read.contacts.len()), (Some(false), 0), "seed {seed}, frame {index}");
            }
        }
    }
}

#[test]
#[ignore = "slow: 54 runs of 13 minutes of device time"]
fn drift_of_all_sizes_under_a_touch_leaves_no_contact() {
    table(&[0.0, 0.01, 0.02, 0.03, 0.05, 0.1, -0.03, -0.05, -0.1], &["refined", "spots", "noser"], 2);
}
