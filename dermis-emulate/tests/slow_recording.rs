//! A recording that takes long to end: in a separate program, because the other tests of pages measure the memory of
//! their process.

use crate::page;
use dermis::pipeline::Command;
use dermis_live::Event;
use dermis_live::sinks::viewer::{Server, ServerOptions};
use std::io::{Read, Seek, SeekFrom};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};

fn open(address: SocketAddr) -> WebSocket<TcpStream> {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    tungstenite::client(format!("ws://{address}/live"), stream).unwrap().0
}

/// Incompressible digits.
fn text(seed: u64) -> String {
    let mut random = 2 * seed + 1;
    let digits = (0..7000).map(|_| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        format!("{random:016x}")
    });
    digits.collect()
}

#[test]
fn a_recording_that_ends_slowly_holds_no_other_page_up() {
    let folder = tempfile::tempdir().unwrap();
    let (live, control) = page::live(folder.path());
    let server = Server::start(control, &ServerOptions { address: "127.0.0.1:0".into(), token: None }).unwrap();
    let (mut one, mut other) = (open(server.address()), open(server.address()));
    one.send(Message::text(r#"{"do":"pause","on":true}"#)).unwrap();
    one.send(Message::text(r#"{"do":"record","on":true}"#)).unwrap();
    let mut frames = 0;
    while frames < 100 {
        frames += usize::from(matches!(other.read().unwrap(), Message::Binary(_)));
    }
    // More data than the recorder can write in one second.
    let texts: Vec<String> = (0..40).map(text).collect();
    for index in 0..3900 {
        let command = Command::Method { name: texts[index % texts.len()].clone() };
        live.shared().publish(&Event::Done(command));
    }
    // Another page ends the recording: commands of the first one wait while it does not read.
    let mut ending = open(server.address());
    ending.send(Message::text(r#"{"do":"record","on":false}"#)).unwrap();
    let path = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
    let begun = Instant::now();
    // A complete file ends with its magic bytes.
    let ended = std::thread::spawn(move || {
        let mut last = [0; 8];
        while &last != b"\x89MCAP0\r\n" {
            std::thread::sleep(Duration::from_millis(5));
            let mut file = std::fs::File::open(&path).unwrap();
            file.seek(SeekFrom::End(-8)).and_then(|_| file.read_exact(&mut last)).unwrap();
        }
        begun.elapsed()
    });
    let (mut last, mut longest) = (Instant::now(), Duration::ZERO);
    while !ended.is_finished() {
        if matches!(other.read().unwrap(), Message::Binary(_)) {
            longest = longest.max(last.elapsed());
            last = Instant::now();
        }
    }
    let took = ended.join().unwrap();
    assert!(took > Duration::from_millis(300) && longest < took / 2, "{longest:?} without a frame of {took:?}");
    live.stop();
    server.stop();
}
