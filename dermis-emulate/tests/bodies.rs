//! Every shipped design, pressed by its twin: contacts appear, stay on the body and end.

use dermis::design::SkinDesign;
use dermis::geom::Point3;
use dermis::method::MethodSet;
use dermis::pipeline::{Pipeline, PipelineFrame, Settings, Timestamp};
use dermis::skin::Skin;
use dermis_emulate::emulator::{Emulator, EmulatorOptions, Script};
use dermis_live::device::Stream;
use dermis_sim::twin::TwinOptions;
use dermis_wire::{Decoder, Received, ToHost};
use std::sync::Arc;
use std::time::Instant;

const RATE_HZ: f64 = 120.0;

/// A twin with a touch script, and its pipeline.
struct Pressed {
    skin: Skin,
    emulator: Arc<Emulator>,
    stream: Stream,
    pipeline: Pipeline,
    decoder: Decoder<Vec<u8>>,
    next: u64,
    /// Total time of the twin, s.
    twin_s: f64,
}

impl Pressed {
    fn new(methods: &Arc<MethodSet>, script: &str, method: &str) -> Self {
        let skin = methods.skin();
        let twin = TwinOptions::shipped("lab").unwrap();
        let mut script = Script::load(script, skin.design(), &twin, 1).unwrap();
        script.touches.iter_mut().for_each(|stroke| stroke.force_n = force_n(&skin.design().name));
        let options =
            EmulatorOptions { twin, seed: 1, script, faults: Vec::new(), speed: 1.0, prerendered: 0, unpaced: true };
        let emulator = Emulator::new(skin.design(), options).unwrap();
        let settings = Settings { method: method.into(), ..Settings::default() };
        let pipeline = Pipeline::new(Arc::clone(methods), settings).unwrap();
        let (mut decoder, mut stream) = (Decoder::new(vec![0; 1 << 16]), Stream::new(skin).unwrap());
        decoder.feed(&emulator.hello_packet((1e3 * RATE_HZ) as u32), |received| {
            let Received::Message(message) = received else { panic!("a damaged hello") };
            let Ok(ToHost::Hello(hello)) = ToHost::parse(message) else { panic!("no hello") };
            stream.hello(&hello);
        });
        Pressed { skin: skin.clone(), emulator, stream, pipeline, decoder, next: 0, twin_s: 0.0 }
    }

    fn frame(&mut self) -> PipelineFrame {
        let begun = Instant::now();
        let packet = self.emulator.frame_packet(self.next).unwrap();
        self.twin_s += begun.elapsed().as_secs_f64();
        let at = Timestamp { unix_ns: 1_800_000_000_000_000_000 + (self.time_s() * 1e9) as u64 };
        let mut heard = Vec::new();
        let Pressed { stream, decoder, .. } = self;
        decoder.feed(&packet, |received| {
            let Received::Message(message) = received else { panic!("a damaged packet") };
            let Ok(ToHost::Frame(frame)) = ToHost::parse(message) else { panic!("no frame") };
            heard.extend(stream.frame(&frame, message, at));
        });
        self.next += 1;
        self.pipeline.process(heard.pop().unwrap().input).unwrap()
    }

    fn time_s(&self) -> f64 {
        self.next as f64 / RATE_HZ
    }

    /// Distance of a position from the nearest press, m.
    fn off_m(&self, place: Point3, time_s: f64) -> f64 {
        let surface = &self.skin.pixels().surface;
        let presses = self.emulator.presses(time_s);
        presses.iter().map(|press| surface.distance_m(press.centre_m, place)).fold(f64::INFINITY, f64::min)
    }

    /// Distance of a position from the nearest pixel centre, m.
    fn off_body_m(&self, place: Point3) -> f64 {
        let away = |centre: &Point3| dermis::geom::vector::distance(*centre, place);
        self.skin.pixels().centres_m.iter().map(away).fold(f64::INFINITY, f64::min)
    }
}

/// The force of a press. 2 N are at the limit of what NOSER finds on the tank: of the twins with the seeds 1 to 8 it found
/// three within three frames, one not at all, with the correction at the ends of arcs or without it.
fn force_n(name: &str) -> f64 {
    if name == "tank16" { 5.0 } else { 2.0 }
}

fn methods(name: &str) -> Arc<MethodSet> {
    Arc::new(MethodSet::new(&dermis_learn::methods(), Skin::load(name).unwrap(), None).unwrap())
}

/// Results of a touch.
#[derive(Default)]
struct Told {
    /// Frames with a press, and those of them with the correct number of contacts.
    pressed: usize,
    right: usize,
    /// Frames without a press that have contacts, and the time of the last contact, s.
    false_positives: usize,
    last_s: f64,
    most_contacts: usize,
    ids: u64,
    /// Distances of contacts from the presses, sorted, and the largest distance from a pixel centre, m.
    off_m: Vec<f64>,
    off_body_m: f64,
    twin_ms: f64,
}

impl Told {
    fn of(methods: &Arc<MethodSet>, script: &str, method: &str) -> Self {
        let (mut pressed, mut told) = (Pressed::new(methods, script, method), Told::default());
        while pressed.time_s() < 3.7 {
            let time_s = pressed.time_s();
            let fingers = pressed.emulator.presses(time_s).len();
            let contacts = pressed.frame().contacts;
            told.pressed += usize::from(fingers > 0);
            told.right += usize::from(fingers > 0 && contacts.len() == fingers);
            told.false_positives += usize::from(fingers == 0 && !contacts.is_empty());
            told.most_contacts = told.most_contacts.max(contacts.len());
            for contact in &contacts {
                (told.ids, told.last_s) = (told.ids.max(contact.contact.id), time_s);
                told.off_body_m = told.off_body_m.max(pressed.off_body_m(contact.contact.position_m));
                if fingers > 0 {
                    told.off_m.push(pressed.off_m(contact.contact.position_m, time_s));
                }
            }
        }
        told.off_m.sort_by(f64::total_cmp);
        told.twin_ms = 1e3 * pressed.twin_s / pressed.next as f64;
        println!(
            "{}, {script}, {}: {} of {} frames with as many contacts as fingers, {} mm off (95 % within {} mm), {} ids, last \
             told at {:.2} s; the twin took {:.2} ms a frame",
            pressed.skin.design().name,
            pressed.pipeline.method().name(),
            told.right,
            told.pressed,
            mm(told.part(0.5)),
            mm(told.part(0.95)),
            told.ids,
            told.last_s,
            told.twin_ms,
        );
        told
    }

    /// A quantile of the distances, m.
    fn part(&self, part: f64) -> f64 {
        let last = self.off_m.len().saturating_sub(1);
        self.off_m.get((part * last as f64) as usize).copied().unwrap_or(f64::NAN)
    }
}

fn mm(metres: f64) -> String {
    format!("{:.1}", 1e3 * metres)
}

/// A press from 1 to 3 s: one contact from its third frame on, within this distance, that ends within 0.3 s of
/// the lift.
fn pressed_and_lifted(methods: &Arc<MethodSet>, method: &str, within_m: f64) {
    let told = Told::of(methods, "press", method);
    assert_eq!((told.most_contacts, told.ids), (1, 1), "one contact with one id");
    assert!(told.right + 9 >= told.pressed, "{} of {} frames", told.right, told.pressed);
    assert!(told.part(0.95) < within_m, "{} mm", mm(told.part(0.95)));
    assert!(told.last_s < 3.3, "it is told until {} s", told.last_s);
    assert!(told.off_body_m < 2.0 * methods.skin().pixels().half_pixel_m(), "{} mm off the body", mm(told.off_body_m));
}

#[test]
fn a_press_is_one_contact_on_every_shipped_skin_and_ends() {
    for (name, within_m) in [("cylinder30", 0.004), ("skin16", 0.006), ("tank16", 0.020)] {
        assert!(SkinDesign::SHIPPED.contains(&name) && SkinDesign::SHIPPED.len() == 3, "a skin more: press it here");
        let methods = methods(name);
        let default = methods.method("").unwrap().name();
        let names = if default == "noser" { vec!["noser"] } else { vec![default, "noser"] };
        for method in names {
            pressed_and_lifted(&methods, method, within_m);
            let told = Told::of(&methods, "four", method);
            assert!(told.right > 0 || !told.off_m.is_empty(), "four fingers are felt at least as one");
            assert!(
                told.off_body_m < 2.0 * methods.skin().pixels().half_pixel_m(),
                "{} mm off the body",
                mm(told.off_body_m)
            );
        }
    }
}

#[test]
#[ignore = "the images of 14,806 cells take half a minute to prepare"]
fn a_press_is_one_contact_on_a_sleeve_from_an_stl_file() {
    pressed_and_lifted(&methods("../dermis/designs/forearm.toml"), "", 0.003);
}
