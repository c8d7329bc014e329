//! Playback of a recording in place of its device.

use dermis::method::{MethodSet, Methods};
use dermis::pipeline::{Command, Settings, TrackedContact};
use dermis::skin::Skin;
use dermis_emulate::emulator::{Emulator, EmulatorOptions, Script};
use dermis_live::recording::{Player, Replay, Replayed};
use dermis_live::recording::{RecordingLimits, RecordingSink};
use dermis_live::{ClientSession, Control, Event, Live, LiveOptions, Mailbox, Popped, RecordingOptions};
use dermis_sim::twin::TwinOptions;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Enough for all events of a recording here.
const WAITING: usize = 1 << 14;

/// Of the emulated skin.
const FRAMES_A_SECOND: f64 = 120.0;

fn methods(name: &str) -> Arc<MethodSet> {
    Arc::new(MethodSet::new(&dermis_learn::methods(), Skin::load(name).unwrap(), None).unwrap())
}

/// Records a press, with commands between its frames.
fn record(methods: &Arc<MethodSet>, path: &Path) {
    let options = EmulatorOptions {
        twin: TwinOptions::shipped("lab").unwrap(),
        seed: 5,
        script: Script::load("press", methods.skin().design(), &TwinOptions::shipped("lab").unwrap(), 5).unwrap(),
        faults: vec!["unplug@4.5+0.2".parse().unwrap(), "loose:9:200@6".parse().unwrap()],
        speed: 1.0,
        prerendered: 0,
        unpaced: false,
    };
    let emulator = Emulator::new(methods.skin().design(), options).unwrap();
    let address = emulator.serve_locally().unwrap();
    let settings = Settings { method: Methods::REFINED.into(), ..Settings::default() };
    let live = Live::start(Arc::clone(methods), LiveOptions::new(address, settings)).unwrap();
    let [mailbox, adapted, whole] = [(), (), ()].map(|()| live.shared().subscribe(WAITING));
    live.begin();
    await_frame(&mailbox, 200);
    let taping = RecordingSink::start(live.shared(), path, None, RecordingLimits::default()).unwrap();
    await_frame(&mailbox, 700);
    await_adaptation(&adapted);
    // On a slow machine more frames have come meanwhile.
    let mailbox = live.shared().subscribe(WAITING);
    let here = await_frame(&mailbox, 700);
    live.shared().command(Command::Threshold { value: 0.9 });
    await_frame(&mailbox, here + 100);
    // Two commands between the same two frames.
    live.shared().command(Command::Threshold { value: 0.95 });
    live.shared().command(Command::Zones { zones: Vec::new() });
    live.shared().command(Command::Method { name: "noser".into() });
    await_frame(&mailbox, here + 300);
    assert!(taping.stop().problem.is_none());
    live.stop();
    emulator.stop();
    assert!(frames_during_adaptation(&whole) > 0, "frames do not wait for the method to be adapted");
}

/// Number of frames with contacts between the end of the tare and the first preparation of the method.
fn frames_during_adaptation(mailbox: &Mailbox<Event>) -> usize {
    let mut count = 0;
    while let Popped::Item(event) = mailbox.take(Duration::ZERO) {
        match event {
            Event::Frame(frame) => count += usize::from(frame.result.validity.is_usable()),
            Event::Done(Command::Rebuild) => return count,
            _ => {}
        }
    }
    panic!("the method was not adapted");
}

fn await_adaptation(mailbox: &Mailbox<Event>) {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(60) {
        if let Popped::Item(Event::Done(Command::Rebuild)) = mailbox.take(Duration::from_secs(1)) {
            return;
        }
    }
    panic!("the method was not adapted");
}

/// The number of the first frame from one on.
fn await_frame(mailbox: &Mailbox<Event>, sequence: u64) -> u64 {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(60) {
        if let Popped::Item(Event::Frame(frame)) = mailbox.take(Duration::from_secs(1))
            && frame.result.sequence >= sequence
        {
            return frame.result.sequence;
        }
    }
    panic!("frame {sequence} did not come");
}

/// The output of a live skin during playback: contacts by frame, and commands.
fn played(methods: &Arc<MethodSet>, path: &Path, speed: f64) -> (Vec<(u64, Vec<TrackedContact>)>, Vec<Command>) {
    let live = Live::play(Arc::clone(methods), Player::open(path, methods, speed).unwrap()).unwrap();
    let mailbox = live.shared().subscribe(WAITING);
    live.begin();
    let (mut frames, mut commands, mut connected, mut ended) = (Vec::new(), Vec::new(), 0, false);
    loop {
        match mailbox.take(Duration::from_secs(30)) {
            Popped::Item(Event::Frame(frame)) => {
                assert!(frame.received_at <= frame.output_at, "latencies are those of now");
                frames.push((frame.result.sequence, frame.result.contacts.clone()));
            }
            Popped::Item(Event::Done(command)) => commands.push(command),
            Popped::Item(Event::Connected(_)) => connected += 1,
            Popped::Item(Event::Notice(notice)) => ended |= notice.text.contains("at its end"),
            Popped::Item(_) => {}
            Popped::TimedOut => panic!("a recording that stands still"),
            Popped::Closed => break,
        }
    }
    assert!(ended, "the end is told");
    assert_eq!(connected, 2, "once at the beginning, once when it was found again");
    assert_eq!((live.shared().skipped(), mailbox.dropped()), (0, 0));
    live.stop();
    (frames, commands)
}

/// A playback that is paused, moved forwards and then back to its start: the frames from there on.
fn sought(methods: &Arc<MethodSet>, path: &Path) -> Vec<(u64, Vec<TrackedContact>)> {
    let live = Live::play(Arc::clone(methods), Player::open(path, methods, 1.0).unwrap()).unwrap();
    let options = RecordingOptions::default();
    let control = Arc::new(Control::new(Arc::clone(live.shared()), None, "a recording".into(), options));
    let mut page = ClientSession::new(control);
    let mailbox = live.shared().subscribe(WAITING);
    live.begin();
    let first = await_frame(&mailbox, 0);
    page.ask(r#"{"do":"pause","on":true}"#).unwrap();
    let frames = |time: Duration| {
        let (begun, mut numbers) = (Instant::now(), Vec::new());
        while begun.elapsed() < time {
            match mailbox.take(Duration::from_millis(10)) {
                Popped::Item(Event::Frame(frame)) => numbers.push(frame.result.sequence),
                Popped::Item(Event::Stale(_)) => panic!("a pause is no fault"),
                _ => {}
            }
        }
        numbers
    };
    frames(Duration::from_millis(300));
    assert!(frames(Duration::from_millis(500)).is_empty(), "it stands still");
    // While it is paused, the frames up to the place are played.
    page.ask(r#"{"do":"seek","part":0.6}"#).unwrap();
    await_frame(&mailbox, first + 300);
    frames(Duration::from_secs(2));
    assert!(frames(Duration::from_millis(500)).is_empty(), "it stands still there");
    assert!(page.ask(r#"{"do":"seek","part":1.5}"#).unwrap_err().contains("from 0"));
    page.ask(r#"{"do":"seek","part":0}"#).unwrap();
    page.ask(r#"{"do":"pause","on":false}"#).unwrap();
    let mut from_start = Vec::new();
    loop {
        match mailbox.take(Duration::from_secs(30)) {
            Popped::Item(Event::Frame(frame)) => {
                from_start.push((frame.result.sequence, frame.result.contacts.clone()));
                if from_start.len() == 60 {
                    page.ask(r#"{"do":"seek","part":1}"#).unwrap();
                }
            }
            Popped::Item(_) => {}
            Popped::TimedOut => panic!("a recording that stands still"),
            Popped::Closed => break,
        }
    }
    live.stop();
    from_start
}

#[test]
fn a_recording_in_the_place_of_its_device_gives_the_contacts_of_its_replay() {
    let methods = methods("cylinder30");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("press.mcap");
    record(&methods, &path);

    let begun = Instant::now();
    let mut replay = Replay::open(&path, &dermis_learn::methods(), None).unwrap();
    let (mut frames, mut commands) = (Vec::new(), Vec::new());
    while let Some(replayed) = replay.step().unwrap() {
        match replayed {
            Replayed::Frame(frame) => frames.push((frame.result.sequence, frame.result.contacts)),
            Replayed::Command(command) => commands.push(command),
        }
    }
    let computed_s = begun.elapsed().as_secs_f64();
    assert!(frames.iter().filter(|(_, contacts)| !contacts.is_empty()).count() > 200, "it was pressed");
    assert!(commands.contains(&Command::Threshold { value: 0.9 }), "{commands:?}");

    let (first, last) = (frames.first().expect("frames").0, frames.last().expect("frames").0);
    let recorded_s = (last - first) as f64 / FRAMES_A_SECOND;

    let begun = Instant::now();
    let at_four_times = played(&methods, &path, 4.0);
    let seconds = begun.elapsed().as_secs_f64();
    // On a slow machine the pipeline takes longer than the frames.
    let longest = (0.6 * recorded_s).max(0.25 * recorded_s + computed_s);
    let is_paced = (0.225 * recorded_s..longest).contains(&seconds);
    assert!(is_paced, "{recorded_s} s, computed in {computed_s} s, took {seconds} s at four times their pace");
    println!("{recorded_s:.2} s, computed in {computed_s:.2} s, took {seconds:.2} s");
    assert_eq!(at_four_times.1, commands);
    // As texts: a force that is not known is not equal to itself.
    let text = |frames: &[(u64, Vec<TrackedContact>)]| format!("{frames:?}");
    assert!(text(&at_four_times.0) == text(&frames), "the same contacts in every frame");
    // Faster than the pipeline: no frame is dropped either.
    assert!(text(&played(&methods, &path, 1e6).0) == text(&frames));
    assert!(text(&sought(&methods, &path)) == text(&frames), "from the start again");

    let other = self::methods("skin16");
    let error = Player::open(&path, &other, 1.0).expect_err("another skin").to_string();
    assert!(
        error.contains("press.mcap") && error.contains("(30 electrodes, 870 channels) than `skin16` (16"),
        "{error}"
    );
    assert!(Player::open(&path, &methods, f64::NAN).is_err());
}
