//! Contacts of frames in a file and of the same frames through the live pipeline: the same rule for noise and
//! thresholds.

use dermis::contact::Contact;
use dermis::frame::{Frame, mean};
use dermis::method::{MethodOptions, MethodSet};
use dermis::pipeline::{FrameInput, Pipeline, Settings, Timestamp, TrackedContact};
use dermis::skin::Skin;
use dermis_sim::twin::{Press, Twin, TwinOptions};
use std::sync::Arc;

/// Untouched frames of the tare, which are also the baseline of the file.
const TARE: u64 = 100;
/// Frames of a press, and untouched ones after it: shorter than the time after which the pipeline's baseline follows.
const HELD: u64 = 40;
const RELEASED: u64 = 30;
/// Number of frames after the start or the end of a press in which the tracker may lag: a contact is confirmed in its
/// second frame, and ends 50 ms after it was last seen.
const LAG: u64 = 8;
/// The tracker averages positions over a few frames; those of single frames have larger noise.
const SCATTER_M: f64 = 2e-3;
const MEAN_M: f64 = 0.5e-3;

/// The presses of the test: one or two at a time, at the rims and across the seam.
fn presses(skin: &Skin) -> Vec<Vec<Press>> {
    let surface = skin.design().body.surface();
    let press = |z_m: f64, theta_rad: f64, force_n: f64| Press {
        centre_m: surface.at(z_m, theta_rad).expect("a place on the cylinder"),
        force_n,
        tip_radius_m: 0.006,
    };
    vec![
        vec![press(0.150, 1.0, 2.0)],
        vec![press(0.010, 3.0, 3.0)],
        vec![press(0.090, 0.05, 4.0)],
        vec![press(0.070, 1.2, 3.0), press(0.220, 4.2, 3.0)],
    ]
}

/// The frames of the tare and of all presses, with the number of touches of each.
fn frames(skin: &Skin) -> Vec<(Frame, usize)> {
    let twin = Twin::new(skin.design(), &TwinOptions::shipped("lab").unwrap(), 2001).unwrap();
    let mut states: Vec<Vec<Press>> = vec![Vec::new(); TARE as usize];
    for press in presses(skin) {
        states.extend(std::iter::repeat_n(press, HELD as usize));
        states.extend(std::iter::repeat_n(Vec::new(), RELEASED as usize));
    }
    let frame = |(index, state): (usize, &Vec<Press>)| (twin.frame(state, index as u64).unwrap(), state.len());
    states.iter().enumerate().map(frame).collect()
}

/// Contacts as `dermis contacts` finds them.
fn from_file(skin: &Skin, name: &str, frames: &[(Frame, usize)]) -> Vec<Vec<Contact>> {
    let untouched: Vec<Frame> = frames[..TARE as usize].iter().map(|(frame, _)| frame.clone()).collect();
    let baseline = mean(&untouched).unwrap();
    let differences: Vec<Frame> = untouched.iter().map(|frame| frame - &baseline).collect();
    let method = dermis_learn::methods().method(skin, name, &MethodOptions::default()).unwrap();
    let detector = method.detector(&differences, &skin.design().protocol).unwrap();
    frames.iter().map(|(frame, _)| method.contacts(&(frame - &baseline), &detector).unwrap()).collect()
}

/// Contacts as the live pipeline finds them.
fn from_pipeline(skin: &Skin, name: &str, frames: &[(Frame, usize)]) -> Vec<Vec<TrackedContact>> {
    let methods = MethodSet::new(&dermis_learn::methods(), skin.clone(), Some(name)).unwrap();
    let settings = Settings { method: name.into(), ..Settings::default() };
    let mut pipeline = Pipeline::new(Arc::new(methods), settings).unwrap();
    let mut contacts = |(index, (frame, _)): (usize, &(Frame, usize))| {
        let measured_at = Timestamp { unix_ns: 1_000_000_000 + index as u64 * 8_333_333 };
        pipeline.process(FrameInput::new(index as u64, measured_at, frame.to_vec())).unwrap().contacts
    };
    frames.iter().enumerate().map(&mut contacts).collect()
}

#[test]
fn frames_of_a_file_and_of_the_pipeline_give_the_same_contacts() {
    let skin = Skin::load("cylinder30").unwrap();
    let surface = skin.design().body.surface();
    let frames = frames(&skin);
    for name in ["noser", "spots"] {
        let (file, live) = (from_file(&skin, name, &frames), from_pipeline(&skin, name, &frames));
        let (mut distances_m, mut compared) = (Vec::new(), 0);
        let (mut single, mut untouched) = (0, 0);
        for (index, ((file, live), (_, touches))) in file.iter().zip(&live).zip(&frames).enumerate() {
            let since = (index as u64).checked_sub(TARE).map(|since| since % (HELD + RELEASED));
            let Some(since) = since.filter(|since| since % HELD >= LAG && (*since < HELD || since - HELD >= LAG))
            else {
                continue;
            };
            let at = format!("{name}, frame {index} ({since} after the press)");
            assert_eq!(live.len(), *touches, "{at}");
            // The frames of a file are evaluated one by one. In the pipeline a contact needs two consecutive frames,
            // both detected as touched by the voltages: it has no false contact here, whatever single frames show.
            if *touches == 0 {
                single += file.len();
                untouched += 1;
                continue;
            }
            assert_eq!(file.len(), *touches, "{at}");
            for TrackedContact { contact, .. } in live {
                let distance_m = |other: &&Contact| surface.distance_m(other.position_m, contact.position_m);
                let nearest = file.iter().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b))).unwrap();
                distances_m.push(distance_m(&nearest));
                assert!(distance_m(&nearest) < SCATTER_M, "{at}: {:.2} mm apart", 1e3 * distance_m(&nearest));
                assert_eq!(contact.force_n.is_finite(), nearest.force_n.is_finite(), "{at}");
            }
            compared += 1;
        }
        let mean_m = dermis::stats::mean(&distances_m);
        println!(
            "{name}: {compared} touched frames, {} contacts, {:.3} mm apart on average; {single} of {untouched} untouched frames \
             of the file with a false contact",
            distances_m.len(),
            1e3 * mean_m
        );
        assert!(compared > 100 && mean_m < MEAN_M, "{name}: {:.3} mm", 1e3 * mean_m);
    }
}
