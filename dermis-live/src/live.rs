//! The live skin at work: one thread listens to the device, one makes contacts, and whoever subscribes is told.
//!
//! Nobody who is told can delay a contact: each subscriber has a [`Mailbox`] of its own that keeps the newest.

use crate::LiveError;
use crate::clock;
use crate::device::{Address, Device, DeviceFacts, DeviceOptions, Heard, IncomingFrame, Stream};
use crate::mailbox::{Mailbox, Taken};
use crate::replay::Player;
use crate::report::LiveFrame;
use dermis::method::MethodSet;
use dermis::pipeline::{Command, DriftFit, Notice, Pipeline, PipelineError, RebuiltMethod, Settings, Severity, State};
use dermis::skin::Skin;
use std::collections::{BTreeMap, VecDeque};
use std::mem::discriminant;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How a skin is read.
#[derive(Debug, Clone)]
pub struct LiveOptions {
    /// Where the device is.
    pub address: Address,
    /// How it is read.
    pub device: DeviceOptions,
    /// What may be changed while frames come.
    pub settings: Settings,
    /// Where an earlier run was, in place of a tare.
    pub state: Option<State>,
}

/// Who subscribes so long after the start is told what was noticed since.
const EARLY: Duration = Duration::from_secs(5);

/// What subscribers are told.
#[derive(Debug, Clone)]
pub enum Event {
    /// A device was found.
    Connected(Arc<DeviceFacts>),
    /// It was lost; it is looked for again.
    Lost(String),
    /// A frame.
    Frame(Arc<LiveFrame>),
    /// Something that a person should know.
    Notice(Notice),
    /// A command was carried out, before the frames that follow.
    Done(Command),
    /// What the pipeline remembers between the frames before and after, where it was asked for.
    State(Arc<State>),
}

/// A skin that is being read.
pub struct Live {
    shared: Arc<LiveHandle>,
    threads: Vec<JoinHandle<()>>,
}

/// What the threads share.
pub struct LiveHandle {
    methods: Arc<MethodSet>,
    incoming: Mailbox<Fed>,
    commands: Mutex<VecDeque<Command>>,
    subscribers: Mutex<Vec<Subscriber>>,
    begun: Instant,
    /// Notices of the first seconds, for those who subscribe a moment later.
    early: Mutex<Vec<Notice>>,
    /// What sinks left out whose subscription has ended, and what they say themselves.
    left_out: Mutex<BTreeMap<&'static str, u64>>,
    state: Mutex<State>,
    facts: Mutex<Option<Arc<DeviceFacts>>>,
    method: Mutex<String>,
    tells_state: AtomicBool,
    rolling: AtomicBool,
    stopped: AtomicBool,
}

/// Who is told of what happens.
struct Subscriber {
    /// What it is called in counts of what is left out; one without a name counts for itself.
    sink: Option<&'static str>,
    mailbox: Arc<Mailbox<Event>>,
}

/// What the thread that listens hands to the one that makes contacts.
pub(crate) enum Fed {
    /// A frame.
    Frame(Box<IncomingFrame>),
    /// A command of a recording, between the same frames as when it was recorded.
    Command(Command),
}

/// Frames that may wait for the contacts of those before: half a second at 120 frames a second.
const MOST_WAITING: usize = 64;
/// How long a thread sleeps at most before it looks whether it shall stop.
const NAP: Duration = Duration::from_millis(50);
/// How long it waits between two tries to find a device again.
const RETRY: Duration = Duration::from_millis(250);
/// How often it is told, at most, what sinks leave out.
const TELL_LEFT_OUT: Duration = Duration::from_secs(1);
/// How often the state is put by.
const KEEP: Duration = Duration::from_secs(5);

impl std::fmt::Debug for Live {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Live").field("skin", self.shared.skin()).finish_non_exhaustive()
    }
}

impl Live {
    /// Finds the device and begins to read it.
    ///
    /// # Errors
    /// A device that cannot be reached or is refused; settings out of their ranges.
    pub fn start(methods: Arc<MethodSet>, options: LiveOptions) -> Result<Self, LiveError> {
        let pipeline = match options.state {
            Some(state) => Pipeline::resume(Arc::clone(&methods), state)?,
            None => Pipeline::new(Arc::clone(&methods), options.settings.clone())?,
        };
        let device = Device::connect(&options.address, methods.skin(), options.device, None)?;
        let shared = LiveHandle::new(&pipeline);
        let listener = Listener { shared: Arc::clone(&shared), address: options.address, options: options.device };
        Ok(Self::with(shared, pipeline, true, move || listener.run(device)))
    }

    /// Prepares a recording to be played in the place of a device: [`roll`](Self::roll) begins. At its end all subscribers'
    /// mailboxes are closed.
    ///
    /// # Errors
    /// A method that there is not; a state of another skin.
    pub fn play(methods: Arc<MethodSet>, player: Player) -> Result<Self, LiveError> {
        let pipeline = Pipeline::resume(methods, player.state().clone())?;
        let shared = LiveHandle::new(&pipeline);
        shared.connected(player.facts().clone());
        let fed = Arc::clone(&shared);
        let listen = move || {
            while !fed.rolling.load(Ordering::Relaxed) && !fed.is_stopped() {
                std::thread::sleep(Duration::from_millis(1));
            }
            player.play(&fed);
            fed.incoming.close();
        };
        Ok(Self::with(shared, pipeline, false, listen))
    }

    fn with(
        shared: Arc<LiveHandle>,
        pipeline: Pipeline,
        rebuilds: bool,
        listen: impl FnOnce() + Send + 'static,
    ) -> Self {
        let worker = PipelineThread {
            shared: Arc::clone(&shared),
            pipeline,
            rebuilds,
            rebuilding: None,
            fitting: None,
            tried_without: None,
            kept_at: Instant::now(),
            told_left_out: (BTreeMap::new(), Instant::now()),
        };
        let threads = vec![spawn("dermis-listen", listen), spawn("dermis-contacts", move || worker.run())];
        Live { shared, threads }
    }

    /// Begins to play a recording, when all who want to be told of its first frame have subscribed.
    pub fn roll(&self) {
        self.shared.rolling.store(true, Ordering::Relaxed);
    }

    /// What its threads share: to subscribe to, to command.
    pub fn shared(&self) -> &Arc<LiveHandle> {
        &self.shared
    }

    /// Stops reading and tells what the pipeline remembers. Subscribers' mailboxes are closed when all is told.
    pub fn stop(self) -> State {
        self.shared.stopped.store(true, Ordering::Relaxed);
        for thread in self.threads {
            // A thread that panicked has told so already.
            let _ = thread.join();
        }
        lock(&self.shared.subscribers).iter().for_each(|subscriber| subscriber.mailbox.close());
        lock(&self.shared.state).clone()
    }
}

fn spawn(name: &str, run: impl FnOnce() + Send + 'static) -> JoinHandle<()> {
    std::thread::Builder::new().name(name.into()).spawn(run).expect("a thread can be started")
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What these locks guard is whole between any two operations.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl LiveHandle {
    fn new(pipeline: &Pipeline) -> Arc<Self> {
        Arc::new(LiveHandle {
            methods: Arc::clone(pipeline.methods()),
            incoming: Mailbox::new(MOST_WAITING),
            commands: Mutex::default(),
            subscribers: Mutex::default(),
            begun: Instant::now(),
            early: Mutex::default(),
            left_out: Mutex::default(),
            state: Mutex::new(pipeline.state().clone()),
            facts: Mutex::default(),
            method: Mutex::new(pipeline.method().name().into()),
            tells_state: AtomicBool::new(false),
            rolling: AtomicBool::new(false),
            stopped: AtomicBool::new(false),
        })
    }

    /// Hands something to the thread that makes contacts.
    pub(crate) fn feed(&self, fed: Fed) {
        self.incoming.put(fed);
    }

    /// Whether one more frame might push an older one out.
    pub(crate) fn is_full(&self) -> bool {
        self.incoming.len() + 1 >= MOST_WAITING
    }

    /// A device was found.
    pub(crate) fn connected(&self, facts: DeviceFacts) {
        let facts = Arc::new(facts);
        *lock(&self.facts) = Some(Arc::clone(&facts));
        self.tell(&Event::Connected(facts));
    }

    /// The skin.
    pub fn skin(&self) -> &Skin {
        self.methods.skin()
    }

    /// The methods that the pipeline can change between.
    pub fn methods(&self) -> &Arc<MethodSet> {
        &self.methods
    }

    /// From now on, what happens; the newest of it, where it is not taken fast enough.
    pub fn subscribe(&self, capacity: usize) -> Arc<Mailbox<Event>> {
        self.enrol(None, capacity)
    }

    /// The same for a sink: what it does not take in time is counted by its name ([`left_out`](Self::left_out)) and told.
    pub fn subscribe_as(&self, sink: &'static str, capacity: usize) -> Arc<Mailbox<Event>> {
        self.enrol(Some(sink), capacity)
    }

    fn enrol(&self, sink: Option<&'static str>, capacity: usize) -> Arc<Mailbox<Event>> {
        let mailbox = Arc::new(Mailbox::new(capacity));
        if let Some(facts) = lock(&self.facts).clone() {
            mailbox.put(Event::Connected(facts));
        }
        if self.begun.elapsed() < EARLY {
            lock(&self.early).iter().for_each(|notice| mailbox.put(Event::Notice(notice.clone())));
        }
        lock(&self.subscribers).push(Subscriber { sink, mailbox: Arc::clone(&mailbox) });
        mailbox
    }

    /// Ends a subscription.
    pub fn unsubscribe(&self, mailbox: &Arc<Mailbox<Event>>) {
        let mut subscribers = lock(&self.subscribers);
        let ended = subscribers.extract_if(.., |other| Arc::ptr_eq(&other.mailbox, mailbox));
        ended.filter_map(|ended| ended.sink).for_each(|sink| self.leave_out(sink, mailbox.dropped()));
        mailbox.close();
    }

    /// A sink has left something out by itself.
    pub fn leave_out(&self, sink: &'static str, count: u64) {
        *lock(&self.left_out).entry(sink).or_default() += count;
    }

    /// Frames and messages that each sink has left out since the start, as it did not keep up.
    pub fn left_out(&self) -> BTreeMap<&'static str, u64> {
        let subscribers = lock(&self.subscribers);
        let mut left_out = lock(&self.left_out).clone();
        for Subscriber { sink, mailbox } in subscribers.iter() {
            if let (Some(sink), dropped @ 1..) = (sink, mailbox.dropped()) {
                *left_out.entry(sink).or_default() += dropped;
            }
        }
        left_out.retain(|_, count| *count > 0);
        left_out
    }

    /// Has a command carried out before the next frame; [`Event::Done`] or a notice tells of it. One of the same kind that still
    /// waits is forgotten: whoever asks however often, no frame waits for more than one of each kind.
    pub fn command(&self, command: Command) {
        let mut commands = lock(&self.commands);
        commands.retain(|other| discriminant(other) != discriminant(&command));
        commands.push_back(command);
    }

    /// Has [`Event::State`] told before the next frame.
    pub fn tell_state(&self) {
        self.tells_state.store(true, Ordering::Relaxed);
    }

    /// What the pipeline remembered a few seconds ago at most.
    pub fn state(&self) -> State {
        lock(&self.state).clone()
    }

    /// What may be changed, as it is.
    pub fn settings(&self) -> Settings {
        lock(&self.state).settings.clone()
    }

    /// The name of the method in use.
    pub fn method(&self) -> String {
        lock(&self.method).clone()
    }

    /// What the device is known by, while there is one.
    pub fn facts(&self) -> Option<Arc<DeviceFacts>> {
        lock(&self.facts).clone()
    }

    /// Frames that came faster than contacts could be made of them, and were left out.
    pub fn skipped(&self) -> u64 {
        self.incoming.dropped()
    }

    /// Whether all is to end.
    pub fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    /// Tells every subscriber.
    pub fn tell(&self, event: &Event) {
        if let (Event::Notice(notice), true) = (event, self.begun.elapsed() < EARLY) {
            lock(&self.early).push(notice.clone());
        }
        lock(&self.subscribers).iter().for_each(|subscriber| subscriber.mailbox.put(event.clone()));
    }

    fn notice(&self, level: Severity, text: String) {
        self.tell(&Event::Notice(Notice { level, text, at: clock::now() }));
    }
}

/// Listens to the device.
struct Listener {
    shared: Arc<LiveHandle>,
    address: Address,
    options: DeviceOptions,
}

impl Listener {
    fn run(self, device: Device) {
        let mut next = Some(device);
        while let Some(device) = next {
            self.shared.connected(device.facts().clone());
            let stream = self.listen(device);
            *lock(&self.shared.facts) = None;
            next = self.find_again(stream);
        }
        self.shared.incoming.close();
    }

    /// Listens until the device is lost, or all is to stop.
    fn listen(&self, mut device: Device) -> Stream {
        while !self.shared.is_stopped() {
            let heard = device.listen(|heard| match heard {
                Heard::Frame(incoming) => self.shared.feed(Fed::Frame(incoming)),
                Heard::Notice(notice) => self.shared.tell(&Event::Notice(notice)),
                Heard::Status(_) => {}
            });
            if let Err(error) = heard {
                self.shared.tell(&Event::Lost(error.to_string()));
                return device.into_stream();
            }
        }
        // Who is gone needs no stop.
        let _ = device.send(&dermis_wire::ToDevice::Stop);
        device.into_stream()
    }

    fn find_again(&self, stream: Stream) -> Option<Device> {
        let mut told = String::new();
        while !self.shared.is_stopped() {
            match Device::connect(&self.address, self.shared.skin(), self.options, Some(stream.clone())) {
                Ok(device) => {
                    self.shared.notice(Severity::Info, "the device was found again".into());
                    return Some(device);
                }
                Err(error) => {
                    let why = error.to_string();
                    if why != told {
                        self.shared.notice(Severity::Error, why.clone());
                        told = why;
                    }
                    std::thread::sleep(RETRY);
                }
            }
        }
        None
    }
}

/// Makes contacts of frames.
struct PipelineThread {
    shared: Arc<LiveHandle>,
    pipeline: Pipeline,
    /// Whether the method is made anew when that is better; a recording tells by itself when it was.
    rebuilds: bool,
    rebuilding: Option<JoinHandle<Result<RebuiltMethod, PipelineError>>>,
    fitting: Option<JoinHandle<Result<DriftFit, PipelineError>>>,
    /// Channels without which the method was last made anew, or could not be: that is not tried twice.
    tried_without: Option<Vec<usize>>,
    kept_at: Instant,
    /// What was told of that sinks had left out, and when.
    told_left_out: (BTreeMap<&'static str, u64>, Instant),
}

impl PipelineThread {
    fn run(mut self) {
        loop {
            self.obey();
            self.tell_left_out();
            match self.shared.incoming.take(NAP) {
                Taken::Item(Fed::Frame(incoming)) => self.make(*incoming),
                Taken::Item(Fed::Command(command)) => self.carry_out(command),
                Taken::TimedOut => {}
                Taken::Closed => break,
            }
        }
        *lock(&self.shared.state) = self.pipeline.state().clone();
        lock(&self.shared.subscribers).iter().for_each(|subscriber| subscriber.mailbox.close());
    }

    fn make(&mut self, incoming: IncomingFrame) {
        self.install_drift_fit();
        match process(&mut self.pipeline, incoming) {
            Ok(frame) => self.shared.tell(&Event::Frame(Arc::new(frame))),
            Err(error) => self.shared.notice(Severity::Error, error.to_string()),
        }
        for notice in self.pipeline.take_notices() {
            self.shared.tell(&Event::Notice(notice));
        }
        self.start_drift_fit();
        self.rebuild();
        if self.kept_at.elapsed() > KEEP {
            self.kept_at = Instant::now();
            *lock(&self.shared.state) = self.pipeline.state().clone();
        }
    }

    /// Tells what sinks have left out since it was last told.
    fn tell_left_out(&mut self) {
        let (told, told_at) = &mut self.told_left_out;
        if told_at.elapsed() < TELL_LEFT_OUT {
            return;
        }
        for (sink, count) in self.shared.left_out() {
            let more = count.saturating_sub(told.get(sink).copied().unwrap_or(0));
            if more > 0 {
                let text = format!("{sink} did not keep up: {more} frames or messages were left out of it");
                self.shared.notice(Severity::Warning, text);
            }
        }
        // What there was no room for of these notices is no news.
        (*told, *told_at) = (self.shared.left_out(), Instant::now());
    }

    fn obey(&mut self) {
        if self.shared.tells_state.swap(false, Ordering::Relaxed) {
            self.shared.tell(&Event::State(Arc::new(self.pipeline.state().clone())));
        }
        loop {
            let Some(command) = lock(&self.shared.commands).pop_front() else { return };
            // From here on a recording is no longer played as it was.
            self.rebuilds = true;
            self.carry_out(command);
        }
    }

    fn carry_out(&mut self, command: Command) {
        match self.pipeline.command(&command) {
            Ok(()) => {
                // Another method may be made without the channels that this one could not.
                self.tried_without = None;
                *lock(&self.shared.state) = self.pipeline.state().clone();
                *lock(&self.shared.method) = self.pipeline.method().name().into();
                self.shared.tell(&Event::Done(command));
            }
            Err(error) => self.shared.notice(Severity::Error, error.to_string()),
        }
    }

    /// Has the method made anew on a thread of its own where that is wanted, and uses what was made.
    fn rebuild(&mut self) {
        if let Some(thread) = self.rebuilding.take_if(|thread| thread.is_finished()) {
            // A thread that panicked has told so already.
            match thread.join().map(|made| made.map(|rebuilt| self.pipeline.install_method(rebuilt))) {
                Ok(Ok(true)) => self.shared.tell(&Event::Done(Command::Rebuild)),
                Ok(Ok(false)) | Err(_) => {}
                Ok(Err(error)) => self.shared.notice(Severity::Error, error.to_string()),
            }
        }
        if self.rebuilding.is_some() || !self.rebuilds || !self.pipeline.wants_rebuild() {
            return;
        }
        let broken = self.pipeline.masked_channels();
        if self.tried_without.as_ref() == Some(&broken) {
            return;
        }
        self.tried_without = Some(broken);
        let rebuilding = self.pipeline.rebuild_job();
        let thread = std::thread::Builder::new().name("dermis-rebuild".into());
        self.rebuilding = thread.spawn(move || rebuilding.run()).ok();
    }

    /// Has a drift fit computed on a thread of its own, where the pipeline offers one.
    fn start_drift_fit(&mut self) {
        if let Some(job) = self.pipeline.drift_fit_job() {
            let thread = std::thread::Builder::new().name("dermis-drift".into());
            // Without a thread the pipeline computes it when it is needed.
            self.fitting = thread.spawn(move || job.run()).ok();
        }
    }

    fn install_drift_fit(&mut self) {
        if let Some(Ok(Ok(fit))) = self.fitting.take_if(|thread| thread.is_finished()).map(JoinHandle::join) {
            self.pipeline.install_drift_fit(fit);
        }
    }
}

/// Processes a frame as it was received.
pub(crate) fn process(pipeline: &mut Pipeline, incoming: IncomingFrame) -> Result<LiveFrame, PipelineError> {
    let IncomingFrame { input, received_at, message } = incoming;
    let result = pipeline.process(input)?;
    Ok(LiveFrame { result, received_at, output_at: clock::now(), message })
}
