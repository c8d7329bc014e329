//! Pages that send invalid data, and pages that never read: contacts continue, other pages are served, memory stays
//! bounded.

mod page;

use dermis_live::sinks::viewer::{Server, ServerOptions};
use dermis_live::{ClientSession, Event, Live, Popped};
use serde_json::Value;
use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};

type Page = WebSocket<TcpStream>;

fn open(address: SocketAddr) -> Page {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    tungstenite::client(format!("ws://{address}/live"), stream).unwrap().0
}

/// Number of frames that a page receives in a given time.
fn frames_in(page: &mut Page, time: Duration) -> usize {
    let (begun, mut frames) = (Instant::now(), 0);
    while begun.elapsed() < time {
        frames += usize::from(matches!(page.read().unwrap(), Message::Binary(_)));
    }
    frames
}

/// The next message of a given kind.
fn next(page: &mut Page, kind: &str) -> Value {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(5) {
        if let Message::Text(text) = page.read().unwrap() {
            let value: Value = serde_json::from_str(text.as_str()).unwrap();
            if value["type"] == kind {
                return value;
            }
        }
    }
    panic!("no message `{kind}`");
}

/// Resident memory of this process, bytes.
#[cfg(target_os = "linux")]
fn resident_bytes() -> usize {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap();
    text.split_whitespace().nth(1).unwrap().parse::<usize>().unwrap() * 4096
}

/// Asserts that no frame is skipped during a piece of work. A loaded machine may halt once and skip frames for it; work that
/// costs frames does so every time.
fn no_frame_is_skipped(live: &Live, mut work: impl FnMut()) {
    let skipped = |_| {
        let before = live.shared().skipped();
        work();
        live.shared().skipped() - before
    };
    assert!((0..3).map(skipped).any(|frames| frames == 0), "frames are skipped each time");
}

/// Serialises the tests, because memory is measured for the whole process.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

#[test]
fn rubbish_is_refused_in_words_and_disturbs_nobody() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (live, control) = page::live(folder.path());
    let server = Server::start(control, &ServerOptions { address: "127.0.0.1:0".into(), token: None }).unwrap();
    let mut good = open(server.address());

    let deep = "[".repeat(4000);
    let rubbish = [
        "",
        "{",
        "tare",
        deep.as_str(),
        r#"{"do":"explode"}"#,
        r#"{"do":"tare","now":true}"#,
        r#"{"do":"threshold"}"#,
        r#"{"do":"threshold","value":NaN}"#,
        r#"{"do":"threshold","value":1e999}"#,
        r#"{"do":"threshold","value":-1}"#,
        r#"{"do":"method","name":"\u0000"}"#,
        r#"{"do":"press","finger":-1,"position_m":[0,0,0],"force_n":1}"#,
        r#"{"do":"press","finger":1,"position_m":[1e308,1e308,1e308],"force_n":1}"#,
        r#"{"do":"press","finger":1,"position_m":[0,0],"force_n":1}"#,
        r#"{"do":"press","finger":1,"position_m":[0,0,0],"force_n":1e9}"#,
    ];
    no_frame_is_skipped(&live, || {
        let mut bad = open(server.address());
        for text in rubbish {
            bad.send(Message::text(text)).unwrap();
            let why = next(&mut bad, "refused")["why"].as_str().unwrap().to_string();
            assert!(!why.is_empty() && why.len() < 1000, "{text}: {why}");
        }
        // Binary messages are ignored, and the page is still served.
        bad.send(Message::binary(vec![0xFF; 4000])).unwrap();
        assert_eq!(next(&mut bad, "status")["threshold"], 1.0);

        // A message that is too long, or an invalid WebSocket frame, closes the connection of that page.
        bad.send(Message::text("x".repeat(1 << 20))).unwrap_or_default();
        let ended = |page: &mut Page| (0..2000).any(|_| page.read().is_err());
        assert!(ended(&mut bad), "a page that sends a megabyte");
        let mut raw = open(server.address());
        let _ = raw.get_mut().write_all(&[0xFF; 5000]);
        assert!(ended(&mut raw), "a page that sends no messages");

        let frames = frames_in(&mut good, Duration::from_secs(1));
        assert!(frames > 60, "{frames} frames in a second");
    });
    live.stop();
    server.stop();
}

/// Thousands of commands a second: most are refused, and no frame is lost for them.
#[test]
fn commands_that_come_too_fast_are_refused() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (live, control) = page::live(folder.path());
    let mut session = ClientSession::new(Arc::clone(&control));
    let (begun, mut done) = (Instant::now(), 0);
    let reader = live.shared().subscribe(4096);
    no_frame_is_skipped(&live, || {
        for index in 0..10_000 {
            let name = ["noser", "laplace"][index % 2];
            match session.ask(&format!(r#"{{"do":"method","name":"{name}"}}"#)) {
                Ok(()) => done += 1,
                Err(why) => assert!(why.contains("too many commands"), "{why}"),
            }
        }
        assert!((1..=6 + 2 * begun.elapsed().as_secs()).contains(&done), "{done}");
        std::thread::sleep(Duration::from_secs(1));
        let mut frames = 0;
        while let Popped::Item(event) = reader.take(Duration::ZERO) {
            frames += usize::from(matches!(event, Event::Frame(_)));
        }
        assert!(frames > 60, "{frames} frames in a second");
    });
    live.stop();
}

#[test]
fn events_dropped_by_a_sink_are_reported_and_counted() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (live, control) = page::live(folder.path());
    let server = Server::start(control, &ServerOptions { address: "127.0.0.1:0".into(), token: None }).unwrap();
    let shared = Arc::clone(live.shared());
    let reader = shared.subscribe(4096);
    let stalled = shared.subscribe_as("a stalled sink", 8);
    let begun = Instant::now();
    let mut told = Vec::new();
    while begun.elapsed() < Duration::from_millis(3500) {
        if let Popped::Item(Event::Notice(notice)) = reader.take(Duration::from_millis(100)) {
            told.extend(notice.text.contains("a stalled sink: too slow").then_some(notice));
        }
    }
    assert!((2..=4).contains(&told.len()), "{told:?}");
    let left_out = shared.dropped()["a stalled sink"];
    assert!(left_out > 200, "{left_out}");
    shared.unsubscribe(&stalled);
    assert!(shared.dropped()["a stalled sink"] >= left_out, "when it has gone too");
    let before = shared.skipped();
    let late = next(&mut open(server.address()), "status")["counts"]["late"].as_u64().unwrap();
    assert!((before..=shared.skipped()).contains(&late), "{late} late frames: not those of a sink");
    live.stop();
    server.stop();
}

#[test]
fn fingers_of_pages_are_their_own() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (live, control, emulator) = page::live_with(folder.path(), Vec::new());
    let pressing = || emulator.presses(0.0).len();
    let press = |x_m: f64| format!(r#"{{"do":"press","finger":0,"position_m":[{x_m},0.0,0.0],"force_n":1.0}}"#);
    let mut one = ClientSession::new(Arc::clone(&control));
    let mut other = ClientSession::new(Arc::clone(&control));
    one.ask(&press(0.01)).unwrap();
    other.ask(&press(-0.01)).unwrap();
    assert_eq!(pressing(), 2, "the first finger of each");
    one.ask(&press(0.02)).unwrap();
    assert_eq!(pressing(), 2, "it has moved");
    drop(one);
    assert_eq!(emulator.presses(0.0).iter().map(|press| press.centre_m[0]).collect::<Vec<f64>>(), [-0.01]);
    other.ask(r#"{"do":"release","finger":0}"#).unwrap();
    other.ask(r#"{"do":"release","finger":7}"#).unwrap();
    assert_eq!(pressing(), 0);
    live.stop();
    emulator.stop();
}

#[test]
fn pages_that_never_read_cost_the_others_nothing() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (live, control) = page::live(folder.path());
    let server = Server::start(control, &ServerOptions { address: "127.0.0.1:0".into(), token: None }).unwrap();
    let mut good = open(server.address());
    frames_in(&mut good, Duration::from_millis(500));
    let idle: Vec<Page> = (0..20).map(|_| open(server.address())).collect();
    #[cfg(target_os = "linux")]
    let before = resident_bytes();
    no_frame_is_skipped(&live, || {
        let frames = frames_in(&mut good, Duration::from_secs(4));
        assert!(frames > 300, "{frames} frames in four seconds");
    });
    #[cfg(target_os = "linux")]
    {
        let grown = resident_bytes().saturating_sub(before);
        assert!(grown < 32 << 20, "{grown} bytes more for 20 pages that never read");
    }
    drop(idle);
    live.stop();
    server.stop();
}
