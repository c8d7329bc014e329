//! The data for pages: prepared once for all of them, on a separate thread.

use crate::clock;
use crate::recording::Playback;
use crate::runtime::Control;
use crate::runtime::Event;
use crate::runtime::LiveFrame;
use crate::runtime::Popped;
use crate::sinks::viewer::scene::{flat_m, scene};
use bytes::Bytes;
use dermis::method::Method;
use dermis::pipeline::{Health, Notice, Severity, TrackedContact, Validity};
use dermis::reconstruct::Quantity;
use dermis::stats::nearest_quantiles;
use dermis::text::counted;
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// The latest data for pages.
#[derive(Debug)]
pub(super) struct Board {
    /// The newest frame, and its number among the published ones.
    pub frame: watch::Sender<(u64, Bytes)>,
    /// The message `status`.
    pub status: watch::Sender<Arc<Value>>,
    /// The message `scene`.
    pub scene: watch::Sender<Arc<String>>,
}

/// Interval of the status.
const STATUS: Duration = Duration::from_millis(250);
/// Frames over which latencies are measured.
const LATENCIES: usize = 1000;
/// Notices shown on pages.
const MESSAGES: usize = 8;
/// Frames that can wait to be prepared; pages show the newest of them.
const WAITING: usize = 64;

/// Prepares the data for pages.
pub(super) struct Hub {
    control: Arc<Control>,
    board: Arc<Board>,
    number: u64,
    latencies_ms: VecDeque<f32>,
    messages: VecDeque<Notice>,
    health: Arc<Health>,
    method: String,
}

#[derive(Serialize)]
struct Header<'a> {
    sequence: u64,
    measured_at_s: f64,
    output_at_s: f64,
    validity: ShownValidity,
    touched: Option<bool>,
    contacts: Vec<Shown<'a>>,
}

/// The validity of a frame, in words.
#[derive(Serialize)]
struct ShownValidity {
    state: &'static str,
    text: String,
}

impl ShownValidity {
    fn of(validity: &Validity) -> Self {
        ShownValidity { state: validity.name(), text: validity.to_string() }
    }
}

/// A contact, and its place on the unrolled surface.
#[derive(Serialize)]
struct Shown<'a> {
    #[serde(flatten)]
    contact: &'a TrackedContact,
    flat_m: Option<[f64; 2]>,
}

impl Board {
    /// Without data yet.
    pub(super) fn new() -> Self {
        Board {
            frame: watch::Sender::new((0, Bytes::new())),
            status: watch::Sender::new(Arc::new(Value::Null)),
            scene: watch::Sender::new(Arc::default()),
        }
    }
}

impl Hub {
    /// For the pages of a live skin.
    pub(super) fn new(control: Arc<Control>, board: Arc<Board>) -> Self {
        let mut hub = Hub {
            control,
            board,
            number: 0,
            latencies_ms: VecDeque::new(),
            messages: VecDeque::new(),
            health: Arc::default(),
            method: String::new(),
        };
        hub.show_scene();
        hub.show_status();
        hub
    }

    /// Runs until the live skin is stopped.
    pub(super) fn run(mut self) {
        let shared = Arc::clone(self.control.shared());
        let mailbox = shared.subscribe_as("the page", WAITING);
        let mut status_at = Instant::now();
        loop {
            match mailbox.take(STATUS) {
                Popped::Item(Event::Frame(frame)) => self.take(&frame),
                Popped::Item(Event::Stale(frame)) => self.show(&frame),
                Popped::Item(Event::Notice(notice)) => self.say(notice),
                Popped::Item(Event::Lost(why)) => {
                    self.say(Notice { level: Severity::Error, text: why, at: clock::now() });
                }
                Popped::Item(Event::Done(_) | Event::Connected(_)) => self.show_scene(),
                Popped::Item(Event::State(_)) | Popped::TimedOut => {}
                Popped::Closed => return,
            }
            if status_at.elapsed() >= STATUS {
                status_at = Instant::now();
                self.show_status();
            }
        }
    }

    fn take(&mut self, frame: &LiveFrame) {
        if self.latencies_ms.len() == LATENCIES {
            self.latencies_ms.pop_front();
        }
        self.latencies_ms.push_back(1e3 * frame.output_at.seconds_since(frame.received_at) as f32);
        self.health = Arc::clone(&frame.result.health);
        self.show(frame);
    }

    fn show(&mut self, frame: &LiveFrame) {
        self.number += 1;
        // Nothing is prepared without a page.
        if self.board.frame.receiver_count() > 0 {
            self.board.frame.send_replace((self.number, self.message(frame)));
        }
    }

    /// The binary message of a frame.
    fn message(&self, frame: &LiveFrame) -> Bytes {
        let surface = &self.control.shared().skin().pixels().surface;
        let flat_m = |contact: &TrackedContact| flat_m(surface, contact.contact.position_m);
        let contacts = frame.result.contacts.iter().map(|contact| Shown { contact, flat_m: flat_m(contact) });
        let header = Header {
            sequence: frame.result.sequence,
            measured_at_s: frame.result.measured_at.seconds(),
            output_at_s: frame.output_at.seconds(),
            validity: ShownValidity::of(&frame.result.validity),
            touched: frame.result.touched,
            contacts: contacts.collect(),
        };
        let mut bytes = vec![0; 4];
        serde_json::to_writer(&mut bytes, &header).expect("a header is JSON");
        bytes.resize(bytes.len().next_multiple_of(4), b' ');
        let length = (bytes.len() - 4) as u32;
        bytes[..4].copy_from_slice(&length.to_le_bytes());
        bytes.extend(frame.result.image.iter().flat_map(|value| value.to_le_bytes()));
        bytes.into()
    }

    fn say(&mut self, notice: Notice) {
        if self.messages.len() == MESSAGES {
            self.messages.pop_front();
        }
        self.messages.push_back(notice);
    }

    fn show_scene(&mut self) {
        let shared = self.control.shared();
        let method = shared.method();
        if method == self.method {
            return;
        }
        let methods = shared.methods();
        let quantity = methods.method(&method).map_or(Quantity::Change, |method| method.reconstruct().quantity());
        let names: Vec<String> = methods.names().map(str::to_string).collect();
        let text = scene(shared.skin(), quantity, &names, self.control.is_pressable()).to_string();
        self.method = method;
        self.board.scene.send_replace(Arc::new(text));
    }

    fn show_status(&mut self) {
        let shared = self.control.shared();
        let state = shared.settings();
        let method = shared.method();
        let Health { electrodes, noise, rate_hz, counts, masked_channels, .. } = &*self.health;
        let connected = shared.facts().is_some();
        let messages = self
            .messages
            .iter()
            .map(|notice| json!({ "level": notice.level, "text": notice.text, "at_s": notice.at.seconds() }));
        let status = json!({
            "type": "status",
            "connected": connected,
            "source": self.control.source(),
            "method": method,
            "method_note": method_note(*masked_channels, shared.methods().method(&method).ok()),
            "paused": shared.playback().is_some_and(Playback::is_paused),
            "playback": shared.playback().map(Playback::status),
            "recording": self.control.recording(),
            "guide": self.control.guide().map(|guide| guide.status()),
            "threshold": state.threshold,
            "rate_hz": if connected { *rate_hz } else { 0.0 },
            "latency_ms": latency(&self.latencies_ms),
            "noise": noise,
            "counts": {
                "frames": counts.frames,
                "lost": counts.lost,
                "repeated": counts.repeated,
                "reordered": counts.reordered,
                "damaged": counts.damaged,
                "late": shared.skipped(),
                "skipped": 0,
            },
            "electrodes": electrodes,
            "messages": messages.collect::<Vec<_>>(),
        });
        self.board.status.send_replace(Arc::new(status));
    }
}

/// A note on images where channels are masked.
fn method_note(masked_channels: usize, method: Option<&Method>) -> Option<String> {
    if masked_channels == 0 {
        return None;
    }
    let channels = counted(masked_channels, "channel");
    // All methods but one-step methods predict the values of masked channels from the others.
    let is_predicted = !method?.is_one_step();
    Some(if is_predicted {
        format!("{channels} filled in from the others")
    } else {
        format!("made without {channels}")
    })
}

fn latency(latencies_ms: &VecDeque<f32>) -> Value {
    if latencies_ms.is_empty() {
        return Value::Null;
    }
    let [median, p99] = nearest_quantiles(&latencies_ms.iter().copied().collect::<Vec<f32>>(), [0.5, 0.99]);
    json!({ "median": median, "p99": p99 })
}
