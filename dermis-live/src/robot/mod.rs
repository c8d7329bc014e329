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
//! let device = |index: usize| -> Result<Option<LiveOptions>, LiveError> {
//!     let address = Address::parse(&robot.skins()[index].source)?;
//!     Ok(Some(LiveOptions { waits: true, ..LiveOptions::new(address, Settings::default()) }))
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
mod joints;
mod part;
mod recording;

pub use check::{Neighbours, RobotReport, SkinReport, check};
pub use recording::RobotReplay;

use self::joints::{Arrival, JointStates, bind, listen, lock_arrival, subscribe};
use self::part::{Follower, Greeting, StoppedThread, Wanted};
use crate::clock;
use crate::runtime::{Event, Live, LiveFrame, LiveOptions, Mailbox, Popped};
use crate::sinks::jsonl::{self, LineServer};
use crate::{LiveError, runtime};
use dermis::method::{MethodSet, Methods};
use dermis::pipeline::{Command, Notice, Severity, Timestamp, Validity};
use dermis::skin::Skin;
use dermis_robot::{JointSource, Robot, RobotState, RuleEvent, SkinFrame, Snapshot, UnknownReason, WornSkin};
use recording::{Input, RobotRecording};
use serde::Serialize;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Events of a skin that can wait.
const WAITING: usize = 256;
/// Time until a skin that has failed is read again.
const AGAIN: Duration = Duration::from_secs(1);
/// Shortest time between two notices of joint states or clocks.
const JOINT_NOTICE: Duration = Duration::from_secs(2);
/// Joint states are missing after this time.
const JOINTS_MISSING: Duration = Duration::from_secs(1);
/// Joint states, or frames of a part, in a row that are off the clock by more than `age_s`: fewer are late by chance.
const OFF_CLOCK: u32 = 10;

/// How the skins of a robot are read.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotOptions {
    /// Snapshots per second.
    pub rate_hz: f64,
    /// A new folder for a recording.
    pub record: Option<PathBuf>,
    /// Whether frames of skins are outputs.
    pub frames: bool,
    /// The address, `HOST:PORT` of this machine, at which the skins are shared with the program of the whole robot, whose file
    /// names it as their source.
    pub share: Option<String>,
}

impl Default for RobotOptions {
    fn default() -> Self {
        RobotOptions { rate_hz: 50.0, record: None, frames: false, share: None }
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
    /// What another program says of a skin that it reads.
    Part(usize, Input),
    /// A message of the robot itself.
    Notice(Notice),
    /// A skin is no longer read.
    Ended(usize),
    Joints {
        arrived: Timestamp,
        at: Timestamp,
        states: JointStates,
        /// Whether the time is that of the message, and not of its arrival.
        is_stamped: bool,
    },
    Wrong(String),
}

/// A skin of the robot.
struct Reader {
    /// `None` if another program reads it.
    options: Option<LiveOptions>,
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
    joints: Option<StoppedThread>,
    /// Threads that follow the other programs that read skins.
    parts: Vec<StoppedThread>,
    share: Option<LineServer>,
    joint_notice: Option<Instant>,
    /// When joint states came last, of whatever use, and whether it was said that they do not.
    joints_seen: Arrival,
    are_joints_missing: bool,
    /// Joint states in a row, and then frames of each skin, whose times are not those of this clock.
    off_clock: Vec<u32>,
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
    /// its address, and its settings, whose method is that of the robot's file; `None` for a skin that [another
    /// program](WornSkin::part) reads.
    ///
    /// # Errors
    /// A method that does not exist or cannot be prepared, a socket of joint states that cannot be opened, an address at which the
    /// skins cannot be shared, a folder of a recording that exists or cannot be written, those of `options`. A device that is not
    /// there or is refused is waited for.
    pub fn start<E: From<LiveError>>(
        robot: &Arc<Robot>,
        methods: &Methods,
        how: &RobotOptions,
        mut options: impl FnMut(usize) -> Result<Option<LiveOptions>, E>,
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
            readers.push(Reader { options: options(index)?, methods, live: None, again: None, said: String::new() });
        }
        let share = how.share.as_ref().map(|address| share(address, robot, &readers)).transpose()?;
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
            parts: Vec::new(),
            share,
            joint_notice: None,
            joints_seen,
            are_joints_missing: false,
            off_clock: vec![0; 1 + robot.skins().len()],
            recording,
            frames: how.frames,
            waiting: VecDeque::new(),
            interval: Duration::from_secs_f64(1.0 / how.rate_hz),
            next_snapshot: Instant::now(),
        };
        robot.follow();
        (0..robot.readers.len()).try_for_each(|skin| robot.read(skin))?;
        Ok(robot)
    }

    /// Follows the other programs that read skins.
    fn follow(&mut self) {
        let mut parts: BTreeMap<String, Vec<Wanted>> = BTreeMap::new();
        let skins = self.state.robot().skins().iter().zip(&self.readers).enumerate();
        for (index, (worn, _)) in skins.filter(|(_, (_, reader))| reader.options.is_none()) {
            let wanted =
                Wanted { index, name: worn.name.clone(), design: dermis::text::hexadecimal(&worn.design_sha256) };
            parts.entry(worn.part().unwrap_or_default().into()).or_default().push(wanted);
        }
        for (address, skins) in parts {
            let incoming = Arc::clone(&self.incoming);
            let follower = Follower { address, skins, take: move |said| incoming.put(said) };
            self.parts.push(StoppedThread::spawn("dermis-part", move |stopped| follower.run(stopped)));
        }
    }

    /// Where the skins are shared.
    pub fn share_address(&self) -> Option<SocketAddr> {
        self.share.as_ref().map(LineServer::address)
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

    /// Tells whoever joins this part of a robot.
    fn tell(&self, at: Timestamp, input: impl FnOnce() -> Input) {
        if let Some(server) = self.share.as_ref().filter(|server| server.readers() > 0)
            && let Ok(line) = jsonl::line(&recording::Line { at, input: input() })
        {
            server.send(&line);
        }
    }

    /// Tells the state what is known of a skin without its frame, and records it.
    fn take_input(&mut self, skin: usize, input: Input, now: Timestamp) -> Vec<RuleEvent> {
        let events = input.apply(&mut self.state, skin, now);
        // What another program has told is told by that one.
        if self.readers[skin].options.is_some() {
            self.tell(now, || input.clone());
        }
        self.record(now, || input);
        events
    }

    fn name(&self, skin: usize) -> String {
        self.state.robot().skins()[skin].name.clone()
    }

    /// Begins a new tare of a skin, or of all that are read. One that another program reads is tared there, which is said.
    pub fn tare(&mut self, skin: Option<&str>) {
        let robot = Arc::clone(self.state.robot());
        for (index, worn) in
            robot.skins().iter().enumerate().filter(|(_, worn)| skin.is_none_or(|skin| skin == worn.name))
        {
            match &self.readers[index] {
                Reader { live: Some((live, _)), .. } => live.shared().command(Command::Tare),
                Reader { options: None, .. } => {
                    self.error(Some(index), format!("no tare: take it at {}, which reads this skin", worn.source));
                }
                Reader { .. } => {}
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
                // A sign of life.
                self.tell(at, || Input::Snapshot);
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
        drop((self.joints, self.parts, self.share));
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
            // Nothing but its time tells a frame that was computed too late from another one: a replay has to be told.
            Incoming::Skin(skin, Event::Frame(frame)) if matches!(frame.result.validity, Validity::Stale { .. }) => {
                self.show(skin, frame);
                self.take_input(skin, Input::Stale { skin: self.name(skin) }, now)
            }
            Incoming::Skin(skin, Event::Frame(frame)) => {
                let (measured_at, rate_hz) = (frame.result.measured_at, frame.result.health.rate_hz);
                self.record(now, || Input::Frame { skin: self.name(skin), measured_at, rate_hz });
                let events = self.state.frame(skin, &frame.result, now);
                self.tell(now, || match self.state.is_other_device(skin) {
                    true => Input::Fault { skin: self.name(skin), reason: UnknownReason::OtherDevice },
                    false => Input::Known { skin: self.name(skin), frame: SkinFrame::from(&frame.result) },
                });
                self.readers[skin].said.clear();
                self.show(skin, frame);
                events
            }
            Incoming::Skin(skin, Event::Stale(frame)) => {
                self.show(skin, frame);
                self.take_input(skin, Input::Stale { skin: self.name(skin) }, now)
            }
            Incoming::Skin(skin, Event::Connected(facts)) => {
                self.report_swap(skin, facts.serial);
                self.take_input(skin, Input::Connected { skin: self.name(skin), serial: facts.serial }, now)
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
            Incoming::Part(skin, input) => {
                match &input {
                    Input::Connected { serial, .. } => self.report_swap(skin, *serial),
                    Input::Known { frame, .. } => {
                        let what = format!("the frames of `{}`", self.name(skin));
                        self.check_clock(1 + skin, &what, "the skin is unknown", frame.measured_at, now);
                    }
                    _ => {}
                }
                self.take_input(skin, input, now)
            }
            Incoming::Notice(notice) => {
                self.notice(None, notice);
                Vec::new()
            }
            Incoming::Ended(skin) => self.ended(skin, now),
            Incoming::Joints { arrived, at, states, is_stamped } => {
                let given: Vec<(&str, f64)> =
                    states.name.iter().map(String::as_str).zip(states.position.iter().copied()).collect();
                if is_stamped {
                    let effect = "positions in the frame of the base are unknown";
                    self.check_clock(0, "the joint states", effect, at, arrived);
                }
                // States cannot be measured after they have come: a clock that is a little ahead gives way to this one.
                let is_far_ahead = at.seconds_since(arrived) > self.state.robot().age_s();
                let taken = if is_far_ahead { Ok(()) } else { self.joints(at.min(arrived), &given) };
                taken.unwrap_or_else(|error| self.joint_notice(error));
                Vec::new()
            }
            Incoming::Wrong(error) => {
                self.joint_notice(error);
                Vec::new()
            }
        };
        self.queue(events);
    }

    /// What comes with the time of another computer is of use only at that time: several in a row that are old are of another clock.
    fn check_clock(&mut self, which: usize, what: &str, effect: &str, at: Timestamp, now: Timestamp) {
        let age_s = now.seconds_since(at);
        let is_off = age_s.abs() > self.state.robot().age_s();
        self.off_clock[which] = if is_off { self.off_clock[which] + 1 } else { 0 };
        if self.off_clock[which] >= OFF_CLOCK {
            let relation = if age_s > 0.0 { "old" } else { "ahead of this clock" };
            self.joint_notice(format!("{what} are {:.2} s {relation}: {effect}; set both clocks alike", age_s.abs()));
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
            let state = live.stop();
            reader.options.iter_mut().for_each(|options| options.state = Some(state.clone()));
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
        self.take_input(skin, Input::Fault { skin: self.name(skin), reason }, now)
    }

    fn read_again(&mut self) {
        for skin in 0..self.readers.len() {
            if self.readers[skin].again.is_some_and(|again| Instant::now() >= again)
                && let Err(error) = self.read(skin)
            {
                self.readers[skin].again = Some(Instant::now() + AGAIN);
                self.say_failure(skin, Some(&error));
            }
        }
    }

    /// Begins to read a skin.
    fn read(&mut self, skin: usize) -> Result<(), LiveError> {
        let reader = &mut self.readers[skin];
        reader.again = None;
        let Some(options) = &reader.options else { return Ok(()) };
        let live = match Live::start(Arc::clone(&reader.methods), options.clone()) {
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

/// Shares the skins that this program reads with that of the whole robot.
fn share(address: &str, robot: &Robot, readers: &[Reader]) -> Result<LineServer, LiveError> {
    // Contacts are in the frame of the design.
    let of = |(worn, _): (&WornSkin, _)| (worn.name.clone(), dermis::text::hexadecimal(&worn.design_sha256));
    let read_here = robot.skins().iter().zip(readers).filter(|(_, reader)| reader.options.is_some());
    let greeting = Greeting { robot: robot.name().into(), skins: read_here.map(of).collect() };
    let line = jsonl::line(&greeting).map_err(|error| LiveError::Given(error.to_string()))?;
    LineServer::with_greeting("--share ", address, line)
}
