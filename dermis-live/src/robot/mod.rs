//! The skins of a robot, read at once: one [`Live`] for each, whose faults do not reach the others.
//!
//! ```no_run
//! use dermis::method::Methods;
//! use dermis::pipeline::Settings;
//! use dermis_live::device::Address;
//! use dermis_live::robot::{RobotLive, RobotOptions, RobotOutput};
//! use dermis_live::{LiveError, LiveOptions};
//! use dermis_robot::Robot;
//! use std::path::Path;
//! use std::sync::Arc;
//! use std::time::Duration;
//!
//! # fn example() -> Result<(), Box<dyn std::error::Error>> {
//! let robot = Arc::new(Robot::load(Path::new("ur5.toml"))?);
//! let device = |index: usize| -> Result<LiveOptions, LiveError> {
//!     let address = Address::parse(&robot.skins()[index].source)?;
//!     Ok(LiveOptions { waits: true, ..LiveOptions::new(address, Settings::default()) })
//! };
//! let mut live = RobotLive::start(&robot, &Methods::linear(), &RobotOptions::default(), device)?;
//! while let Some(output) = live.next(Duration::from_secs(1)) {
//!     if let RobotOutput::Event(event) = output {
//!         println!("{}: {:?}", event.rule, event.event); // stop the robot here
//!     }
//! }
//! # Ok(())
//! # }
//! ```

mod check;
mod recording;

pub use check::{Neighbours, RobotReport, SkinReport, check};
pub use recording::RobotReplay;

use crate::clock;
use crate::runtime::{Event, Live, LiveFrame, LiveOptions, Mailbox, Popped};
use crate::{LiveError, runtime};
use dermis::method::{MethodSet, Methods};
use dermis::pipeline::{Command, Notice, Severity, Timestamp};
use dermis::skin::Skin;
use dermis_robot::{JointSource, Robot, RobotState, RuleEvent, Snapshot, UnknownReason, WornSkin};
use recording::{Input, RobotRecording};
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, VecDeque};
use std::net::UdpSocket;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Events of a skin that can wait.
const WAITING: usize = 256;
/// Time until a skin that has failed is read again.
const AGAIN: Duration = Duration::from_secs(1);
/// Shortest time between two notices of joint states.
const JOINT_NOTICE: Duration = Duration::from_secs(2);
/// Joint states are missing after this time.
const JOINTS_MISSING: Duration = Duration::from_secs(1);
/// Joint states in a row that are off the clock by more than `age_s`: fewer are late by chance.
const OFF_CLOCK: u32 = 10;
/// Longest datagram of joint states, bytes: that of UDP.
const DATAGRAM: usize = 1 << 16;

/// How the skins of a robot are read.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotOptions {
    /// Snapshots per second.
    pub rate_hz: f64,
    /// A new folder for a recording.
    pub record: Option<PathBuf>,
    /// Whether frames of skins are outputs.
    pub frames: bool,
}

impl Default for RobotOptions {
    fn default() -> Self {
        RobotOptions { rate_hz: 50.0, record: None, frames: false }
    }
}

/// What a robot says.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(title = "Dermis robot line"))]
#[serde(rename_all = "snake_case")]
pub enum RobotOutput {
    /// A rule begins or ends.
    Event(RuleEvent),
    /// What is known of the robot.
    Snapshot(Box<Snapshot>),
    /// A frame of a skin, by its index; a stale one without contacts.
    #[serde(skip)]
    Frame(usize, Arc<LiveFrame>),
    /// A message for people, of a skin or of the robot itself.
    #[serde(skip)]
    Notice {
        /// The skin.
        skin: Option<String>,
        /// The message.
        notice: Notice,
    },
}

impl RobotOutput {
    /// The JSON schema of a line.
    #[cfg(feature = "schema")]
    pub fn json_schema() -> serde_json::Value {
        schemars::schema_for!(RobotOutput).to_value()
    }
}

/// What comes in.
enum Incoming {
    Skin(usize, Event),
    /// A skin is no longer read.
    Ended(usize),
    Joints {
        at: Timestamp,
        states: JointStates,
        /// Whether the time is that of the message, and not of its arrival.
        is_stamped: bool,
    },
    Wrong(String),
}

/// Joint states as a datagram of JSON, with the names of `sensor_msgs/JointState`.
#[derive(Debug, Deserialize)]
struct JointStates {
    /// When they were measured, seconds since 1970; without it, when they arrived.
    stamp_s: Option<f64>,
    name: Vec<String>,
    position: Vec<f64>,
}

/// A skin of the robot.
struct Reader {
    options: LiveOptions,
    methods: Arc<MethodSet>,
    live: Option<(Live, JoinHandle<()>)>,
    /// When it is read again.
    again: Option<Instant>,
    /// Why it was not read when it was tried last: said once.
    said: String,
}

/// Skins with their methods: equal ones are prepared once.
struct Prepared<'a> {
    methods: &'a Methods,
    sets: HashMap<(String, Option<String>), Arc<MethodSet>>,
}

impl<'a> Prepared<'a> {
    fn new(methods: &'a Methods) -> Self {
        Prepared { methods, sets: HashMap::new() }
    }

    fn of(&mut self, worn: &WornSkin) -> Result<Arc<MethodSet>, LiveError> {
        let key = (worn.design.clone(), worn.method.clone());
        if let Some(set) = self.sets.get(&key) {
            return Ok(Arc::clone(set));
        }
        let set = MethodSet::new(self.methods, Skin::load(&worn.design)?, worn.method.as_deref());
        let set = Arc::new(set.map_err(|error| LiveError::Given(format!("the skin `{}`: {error}", worn.name)))?);
        self.sets.insert(key, Arc::clone(&set));
        Ok(set)
    }
}

/// A robot whose skins are being read.
pub struct RobotLive {
    state: RobotState,
    readers: Vec<Reader>,
    incoming: Arc<Mailbox<Incoming>>,
    joints: Option<JointThread>,
    joint_notice: Option<Instant>,
    /// When joint states came last, of whatever use, and whether it was said that they do not.
    joints_seen: Arrival,
    are_joints_missing: bool,
    /// Joint states in a row whose times are not those of this clock.
    off_clock: u32,
    recording: Option<RobotRecording>,
    frames: bool,
    waiting: VecDeque<RobotOutput>,
    interval: Duration,
    next_snapshot: Instant,
}

impl std::fmt::Debug for RobotLive {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("RobotLive").field("robot", self.state.robot()).finish_non_exhaustive()
    }
}

impl RobotLive {
    /// Prepares the skins and begins to read them; equal skins are prepared once. `options` are those of each skin, by index:
    /// its address, and its settings, whose method is that of the robot's file.
    ///
    /// # Errors
    /// A method that does not exist or cannot be prepared, a socket of joint states that cannot be opened, a folder of a
    /// recording that exists or cannot be written, those of `options`. A device that is not there or is refused is waited for.
    pub fn start<E: From<LiveError>>(
        robot: &Arc<Robot>,
        methods: &Methods,
        how: &RobotOptions,
        mut options: impl FnMut(usize) -> Result<LiveOptions, E>,
    ) -> Result<Self, E> {
        let incoming = Arc::new(Mailbox::new(WAITING * robot.skins().len()));
        // An address that is in use is known before the skins are prepared.
        let socket = match robot.joint_source() {
            JointSource::Udp(address) => Some(bind(address)?),
            JointSource::None | JointSource::Ros2(_) => None,
        };
        let (mut prepared, mut readers) = (Prepared::new(methods), Vec::new());
        for (index, worn) in robot.skins().iter().enumerate() {
            let methods = prepared.of(worn)?;
            let again = Some(Instant::now());
            readers.push(Reader { options: options(index)?, methods, live: None, again, said: String::new() });
        }
        let recording = how.record.as_ref().map(|folder| RobotRecording::create(robot, folder)).transpose()?;
        let joints_seen = Arc::default();
        let joints = match (socket, robot.joint_source()) {
            (Some(socket), _) => Some(listen(socket, &incoming, &joints_seen)),
            (None, JointSource::Ros2(topic)) => Some(subscribe(topic, &incoming, &joints_seen)?),
            (None, _) => None,
        };
        let mut robot = RobotLive {
            state: RobotState::new(Arc::clone(robot)),
            readers,
            incoming,
            joints,
            joint_notice: None,
            joints_seen,
            are_joints_missing: false,
            off_clock: 0,
            recording,
            frames: how.frames,
            waiting: VecDeque::new(),
            interval: Duration::from_secs_f64(1.0 / how.rate_hz),
            next_snapshot: Instant::now(),
        };
        (0..robot.readers.len()).try_for_each(|skin| robot.read(skin))?;
        Ok(robot)
    }

    /// The state of the robot.
    pub fn state(&self) -> &RobotState {
        &self.state
    }

    /// The skins, in the order of the robot.
    pub fn skins(&self) -> Vec<Skin> {
        self.readers.iter().map(|reader| reader.methods.skin().clone()).collect()
    }

    /// Takes joint states from the program, as [`RobotState::joints`].
    ///
    /// # Errors
    /// As there.
    pub fn joints(&mut self, at: Timestamp, positions: &[(&str, f64)]) -> Result<(), String> {
        self.record(clock::now(), || Input::Joints {
            measured_at: at,
            positions: positions.iter().map(|&(name, position)| (name.into(), position)).collect(),
        });
        self.state.joints(at, positions)
    }

    /// Records what the state is told.
    fn record(&self, at: Timestamp, input: impl FnOnce() -> Input) {
        if let Some(recording) = &self.recording {
            recording.take(at, input());
        }
    }

    fn name(&self, skin: usize) -> String {
        self.state.robot().skins()[skin].name.clone()
    }

    /// Begins a new tare of a skin, or of all that are read.
    pub fn tare(&self, skin: Option<&str>) {
        for (reader, worn) in self.readers.iter().zip(self.state.robot().skins()) {
            if let Some((live, _)) = reader.live.as_ref().filter(|_| skin.is_none_or(|skin| skin == worn.name)) {
                live.shared().command(Command::Tare);
            }
        }
    }

    /// The handle of a skin, for commands as a tare; `None` while it is not read.
    pub fn skin(&self, skin: usize) -> Option<&Arc<runtime::LiveHandle>> {
        self.readers[skin].live.as_ref().map(|(live, _)| live.shared())
    }

    /// The next output; `None` if there is none for the time `patience`.
    pub fn next(&mut self, patience: Duration) -> Option<RobotOutput> {
        let until = Instant::now() + patience;
        loop {
            if let Some(output) = self.waiting.pop_front() {
                return Some(output);
            }
            self.read_again();
            let now = Instant::now();
            if now >= self.next_snapshot {
                // A late snapshot is not made up for.
                self.next_snapshot = (self.next_snapshot + self.interval).max(now);
                self.check_joints();
                let at = clock::now();
                self.record(at, || Input::Snapshot);
                let events = self.state.tick(at);
                self.queue(events);
                self.waiting.push_back(RobotOutput::Snapshot(Box::new(self.state.snapshot(at))));
                continue;
            }
            if now >= until {
                return None;
            }
            match self.incoming.take(self.next_snapshot.min(until).saturating_duration_since(now)) {
                Popped::Item(incoming) => self.take(incoming),
                Popped::TimedOut | Popped::Closed => {}
            }
        }
    }

    /// Stops reading. Returns why the recording, if there is one, is not complete.
    pub fn stop(self) -> Option<String> {
        for (live, forward) in self.readers.into_iter().filter_map(|reader| reader.live) {
            live.stop();
            // A thread that panicked has printed its message already.
            let _ = forward.join();
        }
        drop(self.joints);
        self.recording.and_then(RobotRecording::stop)
    }

    fn show(&mut self, skin: usize, frame: Arc<LiveFrame>) {
        if self.frames {
            self.waiting.push_back(RobotOutput::Frame(skin, frame));
        }
    }

    fn queue(&mut self, events: Vec<RuleEvent>) {
        self.waiting.extend(events.into_iter().map(RobotOutput::Event));
    }

    fn error(&mut self, skin: Option<usize>, text: String) {
        self.notice(skin, Notice { level: Severity::Error, text, at: clock::now() });
    }

    fn notice(&mut self, skin: Option<usize>, notice: Notice) {
        let skin = skin.map(|skin| self.state.robot().skins()[skin].name.clone());
        self.waiting.push_back(RobotOutput::Notice { skin, notice });
    }

    fn take(&mut self, incoming: Incoming) {
        let now = clock::now();
        let events = match incoming {
            Incoming::Skin(skin, Event::Frame(frame)) => {
                let (measured_at, rate_hz) = (frame.result.measured_at, frame.result.health.rate_hz);
                self.record(now, || Input::Frame { skin: self.name(skin), measured_at, rate_hz });
                let events = self.state.frame(skin, &frame.result, now);
                self.readers[skin].said.clear();
                self.show(skin, frame);
                events
            }
            Incoming::Skin(skin, Event::Stale(frame)) => {
                self.record(now, || Input::Stale { skin: self.name(skin) });
                self.show(skin, frame);
                self.state.stale(skin, now)
            }
            Incoming::Skin(skin, Event::Connected(facts)) => {
                self.report_swap(skin, facts.serial);
                self.record(now, || Input::Connected { skin: self.name(skin), serial: facts.serial });
                self.state.connected(skin, facts.serial, now)
            }
            Incoming::Skin(skin, Event::Lost(why)) => {
                self.error(Some(skin), why);
                self.fault(skin, UnknownReason::Lost, now)
            }
            Incoming::Skin(skin, Event::Notice(notice)) => {
                self.notice(Some(skin), notice);
                Vec::new()
            }
            Incoming::Skin(_, Event::Done(_) | Event::State(_)) => Vec::new(),
            Incoming::Ended(skin) => self.ended(skin, now),
            Incoming::Joints { at, states, is_stamped } => {
                let given: Vec<(&str, f64)> =
                    states.name.iter().map(String::as_str).zip(states.position.iter().copied()).collect();
                match self.joints(at, &given) {
                    Ok(()) => self.have_joints(at, now, is_stamped),
                    Err(error) => self.joint_notice(error),
                }
                Vec::new()
            }
            Incoming::Wrong(error) => {
                self.joint_notice(error);
                Vec::new()
            }
        };
        self.queue(events);
    }

    /// Joint states have come. Those of another time are of no frame: several in a row are of another clock.
    fn have_joints(&mut self, at: Timestamp, now: Timestamp, is_stamped: bool) {
        let age_s = now.seconds_since(at);
        let is_off = is_stamped && age_s.abs() > self.state.robot().age_s();
        self.off_clock = if is_off { self.off_clock + 1 } else { 0 };
        if self.off_clock >= OFF_CLOCK {
            let relation = if age_s > 0.0 { "old" } else { "ahead of this clock" };
            let text = format!(
                "the joint states are {:.2} s {relation}: positions in the frame of the base are unknown; set both clocks alike",
                age_s.abs()
            );
            self.joint_notice(text);
        }
    }

    /// Says once that joint states do not come.
    fn check_joints(&mut self) {
        let robot = self.state.robot();
        if robot.needed_joints().is_empty() || *robot.joint_source() == JointSource::None {
            return;
        }
        // The time begins with the first snapshot.
        let silent = lock_arrival(&self.joints_seen).get_or_insert_with(Instant::now).elapsed();
        let were_missing = std::mem::replace(&mut self.are_joints_missing, silent > JOINTS_MISSING);
        if were_missing && !self.are_joints_missing {
            let text = "joint states arrive again".into();
            self.notice(None, Notice { level: Severity::Info, text, at: clock::now() });
        }
        if self.are_joints_missing && !were_missing {
            let source = match self.state.robot().joint_source() {
                JointSource::None => return,
                JointSource::Udp(address) => format!("udp:{address}"),
                JointSource::Ros2(topic) => format!("the topic {topic}"),
            };
            let text = format!(
                "no joint states from {source} for {:.0} s: positions in the frame of the base are unknown",
                silent.as_secs_f64()
            );
            self.error(None, text);
        }
    }

    fn joint_notice(&mut self, text: String) {
        if self.joint_notice.is_none_or(|last| last.elapsed() > JOINT_NOTICE) {
            self.joint_notice = Some(Instant::now());
            self.error(None, text);
        }
    }

    /// Names the skin to which a device belongs that is on another one's cable.
    fn report_swap(&mut self, skin: usize, serial: u32) {
        let skins = self.state.robot().skins();
        let Some(expected) = skins[skin].serial.filter(|expected| *expected != serial) else { return };
        let owner = skins.iter().find(|other| other.serial == Some(serial));
        let whose =
            owner.map_or_else(|| "of no skin of this robot".into(), |owner| format!("that of `{}`", owner.name));
        let text =
            format!("the device has the serial number {serial}, {whose}, in place of {expected}: swap the cables");
        self.error(Some(skin), text);
    }

    fn ended(&mut self, skin: usize, now: Timestamp) -> Vec<RuleEvent> {
        let reader = &mut self.readers[skin];
        reader.again = Some(Instant::now() + AGAIN);
        let mut reason = UnknownReason::Unserved;
        if let Some((live, forward)) = reader.live.take() {
            let failure = live.take_failure();
            // It continues with its baseline.
            reader.options.state = Some(live.stop());
            let _ = forward.join();
            reason = self.say_failure(skin, failure.as_ref());
        }
        if let Some(recording) = &mut self.recording {
            recording.end(skin);
        }
        self.fault(skin, reason, now)
    }

    /// Says why a skin is not read, once for each reason; a device of another skin of the robot is named.
    fn say_failure(&mut self, skin: usize, failure: Option<&LiveError>) -> UnknownReason {
        let identity = match failure {
            Some(LiveError::Refused { identity, .. }) => *identity,
            _ => None,
        };
        let owner = identity.and_then(|identity| {
            let skins = self.state.robot().skins().iter().zip(&self.readers).enumerate();
            let is_its = |worn: &WornSkin, reader: &Reader| {
                reader.methods.skin().design().sha256() == identity.design_sha256
                    && worn.serial.is_none_or(|serial| serial == identity.serial)
            };
            let owners = skins.filter(|(other, (worn, reader))| *other != skin && is_its(worn, reader));
            let names: Vec<String> = owners.map(|(_, (worn, _))| format!("`{}`", worn.name)).collect();
            (!names.is_empty()).then(|| (names.join(" or "), identity.serial))
        });
        let (text, reason) = match (&owner, failure) {
            (Some((owner, serial)), _) => {
                let text = format!(
                    "the device has the serial number {serial} and is that of {owner}: swap the cables, or the `source`s of both"
                );
                (text, UnknownReason::OtherDevice)
            }
            (None, Some(error)) => (format!("{error}; it is tried again"), UnknownReason::Unserved),
            (None, None) => ("it is no longer read; it is tried again".into(), UnknownReason::Unserved),
        };
        if self.readers[skin].said != text {
            self.readers[skin].said.clone_from(&text);
            self.error(Some(skin), text);
        }
        reason
    }

    fn fault(&mut self, skin: usize, reason: UnknownReason, now: Timestamp) -> Vec<RuleEvent> {
        self.record(now, || Input::Fault { skin: self.name(skin), reason });
        self.state.fault(skin, reason, now)
    }

    fn read_again(&mut self) {
        for skin in 0..self.readers.len() {
            if self.readers[skin].again.is_some_and(|again| Instant::now() >= again)
                && let Err(error) = self.read(skin)
            {
                self.error(Some(skin), error.to_string());
            }
        }
    }

    /// Begins to read a skin.
    fn read(&mut self, skin: usize) -> Result<(), LiveError> {
        let reader = &mut self.readers[skin];
        reader.again = None;
        let live = match Live::start(Arc::clone(&reader.methods), reader.options.clone()) {
            Ok(live) => live,
            Err(
                error @ (LiveError::Refused { .. }
                | LiveError::Unreachable { .. }
                | LiveError::Absent { .. }
                | LiveError::Lost { .. }
                | LiveError::Ended { .. }),
            ) => {
                reader.again = Some(Instant::now() + AGAIN);
                let reason = self.say_failure(skin, Some(&error));
                let events = self.fault(skin, reason, clock::now());
                self.queue(events);
                return Ok(());
            }
            Err(error) => return Err(error),
        };
        if let Some(recording) = &mut self.recording {
            recording.read(skin, &self.state.robot().skins()[skin].name, clock::now(), live.shared())?;
        }
        let (mailbox, incoming) = (live.shared().subscribe_as("the robot", WAITING), Arc::clone(&self.incoming));
        let forward = move || {
            loop {
                match mailbox.take(AGAIN) {
                    Popped::Item(event) => incoming.put(Incoming::Skin(skin, event)),
                    Popped::TimedOut => {}
                    Popped::Closed => break incoming.put(Incoming::Ended(skin)),
                }
            }
        };
        let forward = runtime::spawn("dermis-skin", forward);
        live.begin();
        self.readers[skin].live = Some((live, forward));
        Ok(())
    }
}

/// A socket for joint states.
fn bind(address: &str) -> Result<UdpSocket, LiveError> {
    let failed = |error: std::io::Error| {
        let fix = "write joints = \"udp:HOST:PORT\" with an address of this machine and a free port";
        LiveError::Given(format!("cannot receive joint states at {address}: {error}; {fix}"))
    };
    let socket = UdpSocket::bind(address).map_err(failed)?;
    socket.set_read_timeout(Some(runtime::POLL)).map_err(failed)?;
    Ok(socket)
}

/// When something came last.
type Arrival = Arc<Mutex<Option<Instant>>>;

fn lock_arrival(arrival: &Arrival) -> MutexGuard<'_, Option<Instant>> {
    arrival.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A thread that receives joint states; it ends with it.
struct JointThread {
    thread: Option<JoinHandle<()>>,
    is_stopped: Arc<AtomicBool>,
}

impl JointThread {
    fn spawn(run: impl FnOnce(&AtomicBool) + Send + 'static) -> Self {
        let is_stopped = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&is_stopped);
        JointThread { thread: Some(runtime::spawn("dermis-joints", move || run(&stopped))), is_stopped }
    }
}

impl Drop for JointThread {
    fn drop(&mut self) {
        self.is_stopped.store(true, Ordering::Relaxed);
        // A thread that panicked has printed its message already.
        self.thread.take().map(JoinHandle::join);
    }
}

/// Receives joint states, without those that came before.
fn listen(socket: UdpSocket, incoming: &Arc<Mailbox<Incoming>>, arrival: &Arrival) -> JointThread {
    let (incoming, arrival) = (Arc::clone(incoming), Arc::clone(arrival));
    let run = move |stopped: &AtomicBool| {
        let mut datagram = vec![0; DATAGRAM];
        if socket.set_nonblocking(true).is_ok() {
            while socket.recv(&mut datagram).is_ok() {}
        }
        // A socket that does not block would be asked without end.
        if socket.set_nonblocking(false).is_err() {
            return;
        }
        while !stopped.load(Ordering::Relaxed) {
            if let Ok(length) = socket.recv(&mut datagram) {
                *lock_arrival(&arrival) = Some(Instant::now());
                incoming.put(joint_states(&datagram[..length], clock::now()));
            }
        }
    };
    JointThread::spawn(run)
}

/// Subscribes to joint states of ROS 2.
#[cfg(feature = "ros2")]
fn subscribe(topic: &str, incoming: &Arc<Mailbox<Incoming>>, arrival: &Arrival) -> Result<JointThread, LiveError> {
    /// Interval of looks: the messages have their times.
    const LOOK: Duration = Duration::from_millis(2);
    let states = crate::sinks::ros2::robot::JointStates::subscribe(topic)
        .map_err(|error| LiveError::Given(format!("cannot receive joint states: {error}")))?;
    let (incoming, arrival) = (Arc::clone(incoming), Arc::clone(arrival));
    let run = move |stopped: &AtomicBool| {
        while !stopped.load(Ordering::Relaxed) {
            match states.take() {
                Ok(Some((stamp, state))) => {
                    *lock_arrival(&arrival) = Some(Instant::now());
                    let states = JointStates { stamp_s: None, name: state.name, position: state.position };
                    incoming.put(states.taken(stamp, clock::now()));
                }
                Ok(None) => std::thread::sleep(LOOK),
                Err(error) => {
                    incoming.put(Incoming::Wrong(format!("joint states that cannot be read: {error}")));
                    std::thread::sleep(LOOK);
                }
            }
        }
    };
    Ok(JointThread::spawn(run))
}

#[cfg(not(feature = "ros2"))]
fn subscribe(topic: &str, _: &Arc<Mailbox<Incoming>>, _: &Arrival) -> Result<JointThread, LiveError> {
    let fix = "build it with ROS 2 (`--features ros2`), or take joints = \"udp:HOST:PORT\"";
    Err(LiveError::Given(format!("joint states of {topic}: this program was built without ROS 2; {fix}")))
}

impl JointStates {
    /// As they come in.
    fn taken(self, stamp: Option<Timestamp>, arrived: Timestamp) -> Incoming {
        if self.name.len() == self.position.len() {
            return Incoming::Joints { at: stamp.unwrap_or(arrived), states: self, is_stamped: stamp.is_some() };
        }
        let (names, positions) = (self.name.len(), self.position.len());
        Incoming::Wrong(format!("joint states with {names} names and {positions} positions: give one for each"))
    }
}

/// Joint states in a datagram that arrived at a time.
fn joint_states(datagram: &[u8], arrived: Timestamp) -> Incoming {
    const SHAPE: &str = r#"send {"stamp_s": 1764200000.5, "name": ["elbow"], "position": [0.1]}"#;
    let states: JointStates = match serde_json::from_slice(datagram) {
        Ok(states) => states,
        Err(error) => return Incoming::Wrong(format!("joint states that cannot be read: {error}; {SHAPE}")),
    };
    let stamp = match states.stamp_s {
        None => None,
        Some(seconds) if (0.0..1e10).contains(&seconds) => Some(Timestamp { unix_ns: (seconds * 1e9).round() as u64 }),
        Some(seconds) => {
            let text = format!("joint states of the time {seconds}: `stamp_s` is in seconds since 1970");
            return Incoming::Wrong(text);
        }
    };
    states.taken(stamp, arrived)
}
