//! Many connections to the page that send nothing, or slowly: they are closed, and everything else continues.

use crate::page;
use dermis_emulate::emulator::{Fault, TimedFault};
use dermis_live::sinks::jsonl::serve_lines;
use dermis_live::sinks::viewer::{Server, ServerOptions};
use dermis_live::{Event, Popped};
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};
use tungstenite::Message;

const TOKEN: &str = "0123456789abcdef";
/// Sockets at once: both ends are in this process, which may have as few as 1024 descriptors.
const SOCKETS: usize = 700;
/// Connections without a page that the server keeps.
const MAX_KEPT: usize = 64;

fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_nonblocking(true).unwrap();
    stream
}

fn is_open(stream: &mut TcpStream) -> bool {
    matches!(stream.read(&mut [0; 4096]), Err(error) if error.kind() == ErrorKind::WouldBlock)
}

fn open_count(streams: &mut [TcpStream]) -> usize {
    streams.iter_mut().filter_map(|stream| is_open(stream).then_some(())).count()
}

#[test]
fn idle_and_slow_sockets_are_closed_and_disturb_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let (live, control) = page::live(folder.path());
    let options = ServerOptions { address: "127.0.0.1:0".into(), token: Some(TOKEN.into()) };
    let server = Server::start(control, &options).unwrap();
    let address = server.address();
    let open_page = || {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        tungstenite::client(format!("ws://{address}/live?token={TOKEN}"), stream).unwrap().0
    };
    let mut first = open_page();
    let (lines_at, _) = serve_lines(live.shared(), "127.0.0.1:0").unwrap();
    let mut lines = BufReader::new(TcpStream::connect(lines_at).unwrap());
    let notices = live.shared().subscribe(1 << 14);
    // Frames skipped before each part of the test. A busy machine halts now and then; sockets that cost frames do so every time.
    let mut skipped = vec![live.shared().skipped()];

    // Three times as many idle sockets as there may be descriptors.
    for round in 0..4 {
        let mut idle: Vec<TcpStream> = (0..SOCKETS).map(|_| connect(address)).collect();
        std::thread::sleep(Duration::from_millis(300));
        let open = open_count(&mut idle);
        assert!(open <= MAX_KEPT, "{open} of {SOCKETS} idle sockets are open in round {round}");
        // A page that comes meanwhile is served.
        let mut page = open_page();
        assert!((0..400).any(|_| matches!(page.read().unwrap(), Message::Binary(_))));
        skipped.push(live.shared().skipped());
    }

    // Those that are within the number are closed after a few seconds, also if they send a byte now and then.
    let mut slow: Vec<TcpStream> = (0..MAX_KEPT / 2).map(|_| connect(address)).collect();
    let begun = Instant::now();
    for byte in b"GET / HTTP/1.1\r\nHost: a.very.long.name".iter().cycle() {
        slow.iter_mut().for_each(|stream| drop(stream.write(&[*byte])));
        std::thread::sleep(Duration::from_millis(200));
        if open_count(&mut slow) == 0 || begun.elapsed() > Duration::from_secs(15) {
            break;
        }
    }
    let seconds = begun.elapsed().as_secs_f64();
    assert_eq!(open_count(&mut slow), 0);
    assert!((4.0..9.0).contains(&seconds), "closed after {seconds} s");
    skipped.push(live.shared().skipped());

    // The first page, the lines of JSON and the device have continued.
    assert!((0..400).any(|_| matches!(first.read().unwrap(), Message::Binary(_))));
    let mut line = String::new();
    lines.read_line(&mut line).unwrap();
    assert!(line.starts_with('{'), "{line}");
    let (mut frames, mut told) = (0, Vec::new());
    while let Popped::Item(event) = notices.take(Duration::from_millis(100)) {
        match event {
            Event::Frame(_) => frames += 1,
            Event::Notice(notice) => told.push(notice.text),
            Event::Lost(why) => panic!("{why}"),
            _ => {}
        }
        if frames > 500 && told.iter().any(|text| text.contains("connections to the page closed")) {
            break;
        }
    }
    assert!(frames > 500, "{frames} frames");
    assert!(told.iter().any(|text| text.contains("connections to the page closed")), "{told:?}");
    live.stop();
    server.stop();
    assert!(skipped.windows(2).any(|pair| pair[0] == pair[1]), "frames are skipped each time: {skipped:?}");
}

#[test]
fn a_device_is_found_again_among_idle_sockets() {
    let folder = tempfile::tempdir().unwrap();
    let unplugged = TimedFault { at_s: 2.0, fault: Fault::Unplug { for_s: 1.0 } };
    let (live, control, _) = page::live_with(folder.path(), vec![unplugged]);
    let options = ServerOptions { address: "127.0.0.1:0".into(), token: Some(TOKEN.into()) };
    let server = Server::start(control, &options).unwrap();
    let events = live.shared().subscribe(1 << 14);
    let (mut sockets, mut lost, mut found, mut frames_after) = (Vec::new(), 0, 0, 0);
    let begun = Instant::now();
    while frames_after < 50 && begun.elapsed() < Duration::from_secs(20) {
        // So many that both ends of all of them exceed the descriptors of this process.
        if sockets.len() < SOCKETS {
            sockets.extend((0..SOCKETS / 20).map(|_| connect(server.address())));
        }
        match events.take(Duration::from_millis(50)) {
            Popped::Item(Event::Lost(_)) => lost += 1,
            Popped::Item(Event::Connected(_)) => found += usize::from(lost > 0),
            Popped::Item(Event::Frame(_)) if found > 0 => frames_after += 1,
            _ => {}
        }
    }
    assert_eq!([lost, found], [1, 1]);
    assert!(frames_after >= 50, "{frames_after} frames after the device came back");
    live.stop();
    server.stop();
}
