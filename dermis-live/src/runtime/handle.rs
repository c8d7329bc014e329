//! The handle of a skin being read: subscriptions, commands and facts.

use crate::LiveError;
use crate::clock;
use crate::device::{DeviceFacts, IncomingFrame};
use crate::recording::Playback;
use crate::runtime::notice_limit::NoticeLimit;
use crate::runtime::{Event, Mailbox, Popped, lock};
use dermis::method::MethodSet;
use dermis::pipeline::{Command, Notice, Pipeline, Settings, Severity, State};
use dermis::skin::Skin;
use dermis::text::counted;
use std::collections::{BTreeMap, VecDeque};
use std::mem::discriminant;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A subscriber receives the notices of this time after the start, even if it subscribes later.
const EARLY: Duration = Duration::from_secs(5);
/// Frames that can wait for the pipeline: half a second at 120 frames per second.
const MAX_WAITING: usize = 64;

/// Notices of the device, and notices altogether, that subscribers receive in a second.
const DEVICE_NOTICES: u32 = 5;
const NOTICES: u32 = 100;
const SECOND: Duration = Duration::from_secs(1);

/// The handle of a skin being read, shared between threads.
pub struct LiveHandle {
    methods: Arc<MethodSet>,
    work: Mailbox<WorkItem>,
    /// Frames that the pipeline has passed over for a newer one.
    late: AtomicU64,
    commands: Mutex<VecDeque<Command>>,
    subscribers: Mutex<Vec<Subscriber>>,
    start: Instant,
    /// Notices of the first seconds, for later subscribers.
    early_notices: Mutex<Vec<Notice>>,
    device_notices: Mutex<NoticeLimit>,
    notices: Mutex<NoticeLimit>,
    /// Events dropped by sinks whose subscription has ended, and those that sinks report themselves.
    dropped: Mutex<BTreeMap<&'static str, u64>>,
    state: Mutex<State>,
    facts: Mutex<Option<Arc<DeviceFacts>>>,
    method: Mutex<String>,
    failure: Mutex<Option<LiveError>>,
    state_requested: AtomicBool,
    /// The place in the recording that is played in place of a device.
    playback: Option<Arc<Playback>>,
    begun: AtomicBool,
    stopped: AtomicBool,
    /// No more events will come.
    ended: AtomicBool,
}

/// A receiver of events.
struct Subscriber {
    /// Its name in the counts of dropped events; a subscriber without a name is not counted.
    sink: Option<&'static str>,
    mailbox: Arc<Mailbox<Event>>,
}

/// An item of work for the pipeline's thread.
pub(crate) enum WorkItem {
    /// A frame.
    Frame(Box<IncomingFrame>),
    /// A command of a recording, between the same frames as in the recording.
    Command(Command),
    /// A recording begins again, with its state.
    Restart(Box<State>),
}

impl LiveHandle {
    pub(super) fn new(pipeline: &Pipeline, playback: Option<Arc<Playback>>) -> Arc<Self> {
        Arc::new(LiveHandle {
            methods: Arc::clone(pipeline.methods()),
            work: Mailbox::new(MAX_WAITING),
            late: AtomicU64::new(0),
            commands: Mutex::default(),
            subscribers: Mutex::default(),
            start: Instant::now(),
            early_notices: Mutex::default(),
            device_notices: Mutex::new(NoticeLimit::new(DEVICE_NOTICES, SECOND)),
            notices: Mutex::new(NoticeLimit::new(NOTICES, SECOND)),
            dropped: Mutex::default(),
            state: Mutex::new(pipeline.state().clone()),
            facts: Mutex::default(),
            method: Mutex::new(pipeline.method().name().into()),
            failure: Mutex::default(),
            state_requested: AtomicBool::new(false),
            playback,
            begun: AtomicBool::new(false),
            stopped: AtomicBool::new(false),
            ended: AtomicBool::new(false),
        })
    }

    /// The place in the recording that is played in place of a device.
    pub(crate) fn playback(&self) -> Option<&Playback> {
        self.playback.as_deref()
    }

    /// Queues an item for the pipeline's thread.
    pub(crate) fn queue(&self, item: WorkItem) {
        self.work.put(item);
    }

    /// Waits for room in the queue, so that one more item drops no older one.
    pub(crate) fn await_room(&self) {
        while self.work.len() + 1 >= MAX_WAITING && !self.is_stopped() {
            std::thread::sleep(Duration::from_micros(100));
        }
    }

    /// Announces a device.
    pub(crate) fn connected(&self, facts: DeviceFacts) {
        let facts = Arc::new(facts);
        *lock(&self.facts) = Some(Arc::clone(&facts));
        self.publish(&Event::Connected(facts));
    }

    /// The skin.
    pub fn skin(&self) -> &Skin {
        self.methods.skin()
    }

    /// The methods that the pipeline can change between.
    pub fn methods(&self) -> &Arc<MethodSet> {
        &self.methods
    }

    /// Subscribes to the events from now on. If they are not taken fast enough, the oldest are dropped.
    pub fn subscribe(&self, capacity: usize) -> Arc<Mailbox<Event>> {
        self.add_subscriber(None, capacity)
    }

    /// The same for a sink: its dropped events are counted by its name ([`dropped`](Self::dropped)) and reported.
    pub fn subscribe_as(&self, sink: &'static str, capacity: usize) -> Arc<Mailbox<Event>> {
        self.add_subscriber(Some(sink), capacity)
    }

    fn add_subscriber(&self, sink: Option<&'static str>, capacity: usize) -> Arc<Mailbox<Event>> {
        let mailbox = Arc::new(Mailbox::new(capacity));
        if let Some(facts) = lock(&self.facts).clone() {
            mailbox.put(Event::Connected(facts));
        }
        if self.start.elapsed() < EARLY {
            lock(&self.early_notices).iter().for_each(|notice| mailbox.put(Event::Notice(notice.clone())));
        }
        let mut subscribers = lock(&self.subscribers);
        if self.is_ended() {
            mailbox.close();
        }
        subscribers.push(Subscriber { sink, mailbox: Arc::clone(&mailbox) });
        mailbox
    }

    /// Ends a subscription.
    pub fn unsubscribe(&self, mailbox: &Arc<Mailbox<Event>>) {
        let mut subscribers = lock(&self.subscribers);
        let ended = subscribers.extract_if(.., |other| Arc::ptr_eq(&other.mailbox, mailbox));
        ended.filter_map(|ended| ended.sink).for_each(|sink| self.add_dropped(sink, mailbox.dropped()));
        mailbox.close();
    }

    /// Counts events that a sink dropped by itself.
    pub(crate) fn add_dropped(&self, sink: &'static str, count: u64) {
        *lock(&self.dropped).entry(sink).or_default() += count;
    }

    /// Events that each sink has dropped since the start.
    pub fn dropped(&self) -> BTreeMap<&'static str, u64> {
        let subscribers = lock(&self.subscribers);
        let mut counts = lock(&self.dropped).clone();
        for Subscriber { sink, mailbox } in subscribers.iter() {
            if let (Some(sink), dropped @ 1..) = (sink, mailbox.dropped()) {
                *counts.entry(sink).or_default() += dropped;
            }
        }
        counts.retain(|_, count| *count > 0);
        counts
    }

    /// Queues a command, to be carried out before the next frame; [`Event::Done`] or a notice reports it. It replaces a
    /// waiting command of its kind, so that a frame waits for at most one command of each kind.
    pub fn command(&self, command: Command) {
        let mut commands = lock(&self.commands);
        commands.retain(|other| discriminant(other) != discriminant(&command));
        commands.push_back(command);
    }

    /// Requests [`Event::State`] before the next frame.
    pub fn request_state(&self) {
        self.state_requested.store(true, Ordering::Relaxed);
    }

    /// The state of the pipeline, at most a few seconds old.
    pub fn state(&self) -> State {
        lock(&self.state).clone()
    }

    /// The settings in use.
    pub fn settings(&self) -> Settings {
        lock(&self.state).settings.clone()
    }

    /// The name of the method in use.
    pub fn method(&self) -> String {
        lock(&self.method).clone()
    }

    /// The facts of the device, while one is connected.
    pub fn facts(&self) -> Option<Arc<DeviceFacts>> {
        lock(&self.facts).clone()
    }

    /// Frames that were dropped before the pipeline, because they arrived faster than it works.
    pub fn skipped(&self) -> u64 {
        self.work.dropped() + self.late.load(Ordering::Relaxed)
    }

    /// Counts frames that were late.
    pub(super) fn add_late(&self, frames: u64) {
        self.late.fetch_add(frames, Ordering::Relaxed);
    }

    /// Whether it is being stopped.
    pub(crate) fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    /// Whether no more events will come.
    pub(super) fn is_ended(&self) -> bool {
        self.ended.load(Ordering::Relaxed)
    }

    /// Sends an event to every subscriber; of too many notices in a second only their number.
    pub fn publish(&self, event: &Event) {
        if !matches!(event, Event::Notice(_)) || lock(&self.notices).passes(Instant::now()) {
            self.deliver(event);
        }
    }

    /// Publishes a notice of the device; a device can repeat itself thousands of times a second.
    pub(super) fn device_notice(&self, notice: Notice) {
        if lock(&self.device_notices).passes(Instant::now()) {
            self.publish(&Event::Notice(notice));
        }
    }

    /// Reports the number of notices that were left out since the last report, once a second or at the end.
    pub(super) fn report_omitted(&self, is_end: bool) {
        for (limit, whose) in [(&self.device_notices, " of the device"), (&self.notices, "")] {
            let omitted = lock(limit).take_omitted(Instant::now(), is_end);
            if let Some(count) = omitted {
                let text = format!("and {}{whose}", counted(count, "more message"));
                self.deliver(&Event::Notice(Notice { level: Severity::Warning, text, at: clock::now() }));
            }
        }
    }

    fn deliver(&self, event: &Event) {
        if let (Event::Notice(notice), true) = (event, self.start.elapsed() < EARLY) {
            lock(&self.early_notices).push(notice.clone());
        }
        lock(&self.subscribers).iter().for_each(|subscriber| subscriber.mailbox.put(event.clone()));
    }

    /// Publishes a notice of now.
    pub fn notice(&self, level: Severity, text: String) {
        self.publish(&Event::Notice(Notice { level, text, at: clock::now() }));
    }

    /// Ends the input early.
    pub(super) fn fail(&self, error: LiveError) {
        *lock(&self.failure) = Some(error);
    }

    pub(super) fn take_failure(&self) -> Option<LiveError> {
        lock(&self.failure).take()
    }

    pub(super) fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    pub(super) fn begin(&self) {
        self.begun.store(true, Ordering::Relaxed);
    }

    /// Waits until the input may begin.
    pub(super) fn await_begin(&self) {
        while !self.begun.load(Ordering::Relaxed) && !self.is_stopped() {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// No more items will be queued.
    pub(super) fn close_work(&self) {
        self.work.close();
    }

    pub(super) fn take_work(&self, timeout: Duration) -> Popped<WorkItem> {
        self.work.take(timeout)
    }

    pub(super) fn close_mailboxes(&self) {
        let subscribers = lock(&self.subscribers);
        self.ended.store(true, Ordering::Relaxed);
        subscribers.iter().for_each(|subscriber| subscriber.mailbox.close());
    }

    pub(super) fn take_command(&self) -> Option<Command> {
        lock(&self.commands).pop_front()
    }

    /// Whether the state was requested since the last call.
    pub(super) fn take_state_request(&self) -> bool {
        self.state_requested.swap(false, Ordering::Relaxed)
    }

    /// Publishes state and method.
    pub(super) fn set_state(&self, pipeline: &Pipeline) {
        *lock(&self.state) = pipeline.state().clone();
        *lock(&self.method) = pipeline.method().name().into();
    }

    pub(super) fn disconnected(&self) {
        *lock(&self.facts) = None;
    }
}
