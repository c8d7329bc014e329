//! The complete loop: a twin with the wire protocol over TCP, read live.

use dermis::design::SkinDesign;
use dermis::method::MethodSet;
use dermis::pipeline::{ElectrodeState, Settings};
use dermis::skin::Skin;
use dermis_emulate::emulator::{Emulator, EmulatorOptions, Script, TimedFault};
use dermis_live::device::Address;
use dermis_live::{Event, Live, LiveFrame, LiveOptions, Popped, Pressable, sinks};
use dermis_sim::twin::TwinOptions;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::sync::{Arc, OnceLock, PoisonError, RwLock};
use std::time::{Duration, Instant};

/// Held while all cores compute: what needs frames in time waits for it.
static BUSY: RwLock<()> = RwLock::new(());

/// The paper's skin, prepared once for all tests.
fn methods() -> Arc<MethodSet> {
    static METHODS: OnceLock<Arc<MethodSet>> = OnceLock::new();
    let prepare = || MethodSet::new(&dermis_learn::methods(), Skin::load("cylinder30").unwrap(), None).unwrap();
    Arc::clone(METHODS.get_or_init(|| Arc::new(prepare())))
}

struct Running {
    emulator: Arc<Emulator>,
    address: Address,
}

fn emulate(script: &str, faults: &[&str]) -> Running {
    emulate_design(&SkinDesign::shipped("cylinder30").unwrap(), script, faults)
}

fn emulate_design(design: &SkinDesign, script: &str, faults: &[&str]) -> Running {
    let twin = TwinOptions::shipped("lab").unwrap();
    let options = EmulatorOptions {
        script: Script::load(script, design, &twin, 41).unwrap(),
        twin,
        seed: 41,
        faults: faults.iter().map(|fault| fault.parse::<TimedFault>().unwrap()).collect(),
        speed: 1.0,
        prerendered: 0,
        unpaced: false,
    };
    let emulator = Emulator::new(design, options).unwrap();
    let address = emulator.serve_locally().unwrap();
    Running { emulator, address }
}

/// A connection that does not read yet.
fn connect(running: &Running, settings: Settings) -> Live {
    Live::start(methods(), LiveOptions::new(running.address.clone(), settings)).unwrap()
}

fn read(running: &Running, settings: Settings) -> Live {
    let live = connect(running, settings);
    live.begin();
    live
}

#[test]
fn a_subscriber_from_before_the_beginning_receives_the_first_frame() {
    let running = emulate("none", &[]);
    let live = connect(&running, Settings::default());
    std::thread::sleep(Duration::from_millis(300));
    let mailbox = live.shared().subscribe(64);
    live.begin();
    let first = loop {
        if let Popped::Item(Event::Frame(frame)) = mailbox.take(Duration::from_secs(5)) {
            break frame;
        }
    };
    assert_eq!(first.result.health.counts.frames, 1);
    live.stop();
    running.emulator.stop();
}

#[test]
fn frames_that_stop_are_stale_in_every_output_within_a_quarter_of_a_second() {
    let _quiet = BUSY.read().unwrap_or_else(PoisonError::into_inner);
    let running = emulate("none", &["silent@3+2"]);
    let live = connect(&running, Settings::default());
    let watchdog = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    watchdog.set_nonblocking(true).unwrap();
    sinks::watchdog::send(live.shared(), &watchdog.local_addr().unwrap().to_string()).unwrap();
    let (address, _) = sinks::jsonl::serve_lines(live.shared(), "127.0.0.1:0").unwrap();
    let lines = BufReader::new(TcpStream::connect(address).unwrap()).lines();
    let states = std::thread::spawn(move || {
        let state = |line: String| serde_json::from_str::<Value>(&line).unwrap()["validity"]["state"].clone();
        let states = lines.map(|line| (Instant::now(), state(line.unwrap())));
        states.take_while(|(_, state)| state != "stale").collect::<Vec<_>>()
    });
    let mailbox = live.shared().subscribe(4096);
    live.begin();
    let (mut last_frame, mut last_heartbeat, mut heartbeats) = (Instant::now(), Instant::now(), 0);
    let begun = Instant::now();
    let stale_after = loop {
        assert!(begun.elapsed() < Duration::from_secs(30), "no frame was stale after 200 frames");
        match mailbox.take(Duration::from_millis(5)) {
            Popped::Item(Event::Frame(_)) => last_frame = Instant::now(),
            Popped::Item(Event::Stale(frame)) if frame.result.health.counts.frames > 200 => {
                break last_frame.elapsed();
            }
            _ => {}
        }
        let mut datagram = [0; 200];
        while let Ok(length) = watchdog.recv(&mut datagram) {
            let heartbeat: Value = serde_json::from_slice(&datagram[..length]).unwrap();
            assert_eq!((&heartbeat["validity"], &heartbeat["touched"]), (&"ok".into(), &false.into()));
            (last_heartbeat, heartbeats) = (Instant::now(), heartbeats + 1);
        }
    };
    let heartbeat_age = last_heartbeat.elapsed();
    let states = states.join().unwrap();
    let in_lines = states.last().unwrap().0;
    println!(
        "stale after {stale_after:?}; last line that is not stale {:?} before, last of {heartbeats} heartbeats {heartbeat_age:?} before",
        in_lines.elapsed()
    );
    assert!(stale_after < Duration::from_millis(250), "{stale_after:?}");
    assert!(states.len() > 200 && in_lines.elapsed() < Duration::from_secs(1));
    assert!(heartbeats > 150 && heartbeat_age >= Duration::from_millis(100), "{heartbeats}, {heartbeat_age:?}");
    live.stop();
    running.emulator.stop();
}

/// A skin whose method needs much longer than the time between two frames: whoever reads it knows no contacts
/// older than 50 ms, and the last usable frame does not stand while the next one is computed.
fn an_overloaded_skin_is_stale(edges: f64, cells: usize, time: Duration) {
    let _busy = BUSY.write().unwrap_or_else(PoisonError::into_inner);
    let mut design = SkinDesign::shipped("cylinder30").unwrap();
    design.mesh = design.mesh.scaled(edges);
    let running = emulate_design(&design, "press", &[]);
    let skin = Skin::new(design).unwrap().with_cells_as_pixels();
    assert!(skin.forward().mesh().cell_count() > cells, "{}", skin.forward().mesh().cell_count());
    let methods = Arc::new(MethodSet::new(&dermis_learn::methods(), skin, Some("tv")).unwrap());
    // What is slow is a frame, not what comes before the first one.
    methods.method("tv").unwrap();
    let settings = Settings { method: "tv".into(), force_tare: true, ..Settings::default() };
    let live = Live::start(methods, LiveOptions::new(running.address.clone(), settings)).unwrap();
    let watchdog = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    watchdog.set_nonblocking(true).unwrap();
    sinks::watchdog::send(live.shared(), &watchdog.local_addr().unwrap().to_string()).unwrap();
    let mailbox = live.shared().subscribe(4096);
    live.begin();
    let mut states = std::collections::BTreeMap::new();
    // When the frame was published whose contacts stand.
    let mut usable = None::<Instant>;
    // The time begins after the tare, whose end takes as long as many frames.
    let mut until = Instant::now() + Duration::from_mins(2);
    while Instant::now() < until {
        if let Popped::Item(Event::Frame(frame) | Event::Stale(frame)) = mailbox.take(Duration::from_millis(5)) {
            let validity = &frame.result.validity;
            let age_s = frame.output_at.seconds_since(frame.received_at);
            assert!(!validity.is_usable() || age_s <= 0.05, "{validity:?} with contacts {age_s} s old");
            usable = validity.is_usable().then(Instant::now);
            if validity.name() != "invalid" && states.keys().all(|state| *state == "invalid") {
                until = Instant::now() + time;
            }
            *states.entry(validity.name()).or_insert(0) += 1;
        }
        assert!(usable.is_none_or(|since| since.elapsed() < Duration::from_millis(600)), "{states:?}");
    }
    println!("{states:?}; {} frames skipped", live.shared().skipped());
    assert!(states.get("stale").is_some_and(|&count| count > time.as_secs()), "{states:?}");
    let mut heartbeats = 0;
    while watchdog.recv(&mut [0; 200]).is_ok() {
        heartbeats += 1;
    }
    assert!(heartbeats <= states.get("ok").copied().unwrap_or(0), "{heartbeats} heartbeats: {states:?}");
    live.stop();
    running.emulator.stop();
}

#[test]
fn an_overloaded_skin_is_stale_and_never_usable_with_old_contacts() {
    an_overloaded_skin_is_stale(1.6, 2_500, Duration::from_secs(5));
}

#[test]
#[ignore = "slow: ten minutes"]
fn a_skin_overloaded_for_ten_minutes_is_stale_and_never_usable_with_old_contacts() {
    an_overloaded_skin_is_stale(0.7, 20_000, Duration::from_mins(10));
}

/// Reads frames until `done` returns true; fails after a minute.
fn frames_until(live: &Live, mut done: impl FnMut(&LiveFrame) -> bool) {
    let mailbox = live.shared().subscribe(4096);
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(60) {
        if let Popped::Item(Event::Frame(frame)) = mailbox.take(Duration::from_secs(5))
            && done(&frame)
        {
            live.shared().unsubscribe(&mailbox);
            return;
        }
    }
    panic!("it did not come to that within a minute");
}

#[test]
fn a_press_by_hand_is_found_where_it_is_and_ends() {
    let running = emulate("none", &[]);
    let live = read(&running, Settings::default());
    let surface = methods().skin().design().body.surface();
    let place = surface.at(0.13, 1.0).unwrap();
    frames_until(&live, |frame| !frame.result.health.electrodes.is_empty());
    running.emulator.press(0, place, 2.0).unwrap();
    let mut id = None;
    frames_until(&live, |frame| {
        let Some(contact) = frame.result.contacts.first() else { return false };
        let off_m = surface.distance_m(contact.contact.position_m, place);
        assert!(off_m < 0.006, "{off_m} m off");
        assert_eq!(frame.result.touched, Some(true));
        id = Some(contact.contact.id);
        true
    });
    running.emulator.release(0);
    frames_until(&live, |frame| frame.result.contacts.is_empty() && frame.result.touched == Some(false));
    assert_eq!(id, Some(1));
    live.stop();
    running.emulator.stop();
}

#[test]
fn an_electrode_that_comes_loose_is_named_and_contacts_go_on() {
    let running = emulate("press", &["loose:7:100@4"]);
    let live = read(&running, Settings::default());
    let loose = |frame: &LiveFrame| {
        let named: Vec<usize> = (0..frame.result.health.electrodes.len())
            .filter(|&e| frame.result.health.electrodes[e].state != ElectrodeState::Sound)
            .collect();
        assert!(named.is_empty() || named == [7], "{named:?} at frame {}", frame.result.sequence);
        named == [7]
    };
    let mut named_at = 0;
    frames_until(&live, |frame| {
        named_at = frame.result.sequence;
        loose(frame)
    });
    // The fault begins at frame 480.
    assert!((480..=492).contains(&named_at), "named at frame {named_at}");
    let place = methods().skin().design().body.surface().at(0.15, std::f64::consts::FRAC_PI_2).unwrap();
    frames_until(&live, |frame| {
        let near = |contact: &dermis::pipeline::TrackedContact| {
            methods().skin().design().body.surface().distance_m(contact.contact.position_m, place) < 0.01
        };
        frame.result.sequence > 500 && frame.result.contacts.iter().any(near)
    });
    live.stop();
    running.emulator.stop();
}

#[test]
fn a_device_that_is_unplugged_is_found_again() {
    let running = emulate("none", &["unplug@2+1"]);
    let live = read(&running, Settings::default());
    let mailbox = live.shared().subscribe(4096);
    let (mut lost, mut found) = (false, false);
    let begun = Instant::now();
    while !found && begun.elapsed() < Duration::from_secs(30) {
        match mailbox.take(Duration::from_secs(5)) {
            Popped::Item(Event::Lost(_)) => lost = true,
            Popped::Item(Event::Frame(frame)) if lost => {
                // There is no touch, and the baseline is the old one.
                assert!(frame.result.contacts.is_empty());
                // The emulator's clock loses a third of the time while it is unplugged.
                let late_s = frame.received_at.seconds_since(frame.result.measured_at);
                assert!(late_s < 0.25, "{late_s} s between measuring and receiving");
                found = frame.result.sequence > 400;
                // Health is evaluated every twelve frames.
                assert!(!found || frame.result.health.counts.reconnected == 1);
            }
            _ => {}
        }
    }
    assert!(lost && found);
    live.stop();
    running.emulator.stop();
}
