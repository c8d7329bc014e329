//! A skin being read: a thread for the device, a thread for the pipeline, and subscribers.
//!
//! Each subscriber has a separate [`Mailbox`] that keeps the newest events: a slow subscriber never blocks the
//! pipeline.
//!
//! ```
//! use dermis::method::{MethodSet, Methods};
//! use dermis::pipeline::Settings;
//! use dermis::skin::Skin;
//! use dermis_live::device::Address;
//! use dermis_live::{Live, LiveError, LiveOptions};
//! use std::sync::Arc;
//!
//! let methods = Arc::new(MethodSet::new(&Methods::linear(), Skin::load("skin16")?, None)?);
//! let address = Address::parse("tcp:127.0.0.1:1")?; // no device listens there
//! let options = LiveOptions::new(address, Settings::default());
//! assert!(matches!(Live::start(methods, options), Err(LiveError::Absent { .. })));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod control;
mod device_thread;
mod frame;
mod handle;
mod limit;
mod mailbox;
mod notice_limit;
mod pipeline_thread;
mod statistics;
mod watch;

pub use control::{ClientSession, Control, Pressable, RecordingOptions};
pub use frame::LiveFrame;
pub use handle::LiveHandle;
pub use mailbox::{Mailbox, Popped};
pub use statistics::{Latency, LiveStatistics, LiveSummary};

pub(crate) use handle::WorkItem;
pub(crate) use limit::RateLimit;
pub(crate) use pipeline_thread::process;

use crate::LiveError;
use crate::device::{Address, Connection, DeviceFacts, DeviceOptions};
use crate::recording::Player;
use crate::runtime::device_thread::DeviceThread;
use crate::runtime::pipeline_thread::PipelineThread;
use crate::runtime::watch::Watch;
use dermis::method::MethodSet;
use dermis::pipeline::{Command, Notice, Pipeline, Settings, State};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// How a skin is read.
#[derive(Debug, Clone)]
pub struct LiveOptions {
    /// Address of the device.
    pub address: Address,
    /// Options of the device.
    pub device: DeviceOptions,
    /// Settings of the pipeline.
    pub settings: Settings,
    /// The state of an earlier run, to continue from instead of a tare.
    pub state: Option<State>,
    /// Whether to wait for a device that is not there yet, in place of an error.
    pub waits: bool,
}

impl LiveOptions {
    /// A device with its own frame rate, which must be there, and a tare.
    pub fn new(address: Address, settings: Settings) -> Self {
        LiveOptions { address, device: DeviceOptions::default(), settings, state: None, waits: false }
    }
}

/// What subscribers receive.
#[derive(Debug, Clone)]
pub enum Event {
    /// A device was connected.
    Connected(Arc<DeviceFacts>),
    /// The device was lost; the reason. The connection is tried again.
    Lost(String),
    /// A frame.
    Frame(Arc<LiveFrame>),
    /// No frame has arrived for too long: the last one, stale. Repeated several times a second.
    Stale(Arc<LiveFrame>),
    /// A message for people.
    Notice(Notice),
    /// A command was carried out, before the frames that follow.
    Done(Command),
    /// The state of the pipeline between the frames before and after, where it was requested.
    State(Arc<State>),
}

/// Where frames come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Input {
    /// A device that measures now: a frame that is late is of no use.
    Device,
    /// A stream that waits for the pipeline.
    Stream,
    /// A recording, which contains the changes of the method.
    Recording,
}

/// A skin that is being read.
pub struct Live {
    shared: Arc<LiveHandle>,
    threads: Vec<JoinHandle<()>>,
}

impl std::fmt::Debug for Live {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Live").field("skin", self.shared.skin()).finish_non_exhaustive()
    }
}

impl Live {
    /// Connects to the device; [`begin`](Self::begin) begins to read it. At the end of the input all mailboxes are
    /// closed.
    ///
    /// # Errors
    /// A device that cannot be reached or is refused, but for one that is waited for; settings out of their ranges.
    pub fn start(methods: Arc<MethodSet>, options: LiveOptions) -> Result<Self, LiveError> {
        let pipeline = match options.state {
            Some(state) => Pipeline::resume(Arc::clone(&methods), state)?,
            None => Pipeline::new(Arc::clone(&methods), options.settings.clone())?,
        };
        let connection = match Connection::open(&options.address, methods.skin(), options.device, None) {
            Err(LiveError::Absent { .. }) if options.waits => None,
            opened => Some(opened?),
        };
        let shared = LiveHandle::new(&pipeline, None);
        // Standard input may be a file, whose frames wait for each other.
        let kind = if options.address.is_patient() { Input::Stream } else { Input::Device };
        let thread = DeviceThread::new(Arc::clone(&shared), options.address, options.device);
        Ok(Self::with_threads(shared, pipeline, kind, move || thread.run(connection)))
    }

    /// Prepares to play a recording instead of a device; [`begin`](Self::begin) begins. At its end all mailboxes are
    /// closed.
    ///
    /// # Errors
    /// An unknown method, a state of another skin.
    pub fn play(methods: Arc<MethodSet>, player: Player) -> Result<Self, LiveError> {
        let pipeline = Pipeline::resume(methods, player.state().clone())?;
        let shared = LiveHandle::new(&pipeline, Some(Arc::clone(player.playback())));
        shared.connected(player.facts().clone());
        let handle = Arc::clone(&shared);
        let play = move || {
            handle.await_begin();
            player.play(&handle);
            handle.close_work();
        };
        Ok(Self::with_threads(shared, pipeline, Input::Recording, play))
    }

    fn with_threads(
        shared: Arc<LiveHandle>,
        pipeline: Pipeline,
        input: Input,
        source: impl FnOnce() + Send + 'static,
    ) -> Self {
        // A method that fails is reported when it is asked for.
        let methods = Arc::clone(pipeline.methods());
        spawn("dermis-methods", move || drop(methods.prepare()));
        let watch = Arc::new(Watch::new(Arc::clone(&shared), input));
        let worker = PipelineThread::new(Arc::clone(&shared), pipeline, input, Arc::clone(&watch));
        let [of_source, of_worker, of_watch] = [(); 3].map(|()| EndsOnPanic(Arc::clone(&shared)));
        let threads = vec![
            spawn("dermis-listen", move || of_source.run(source)),
            spawn("dermis-contacts", move || of_worker.run(|| worker.run())),
            spawn("dermis-watch", move || of_watch.run(|| watch.run())),
        ];
        Live { shared, threads }
    }

    /// Begins to read the device or to play the recording. Subscribers from before this call receive the first frame.
    pub fn begin(&self) {
        self.shared.begin();
    }

    /// The handle to subscribe with and to send commands with.
    pub fn shared(&self) -> &Arc<LiveHandle> {
        &self.shared
    }

    /// Why the input ended early, if it did.
    pub fn take_failure(&self) -> Option<LiveError> {
        self.shared.take_failure()
    }

    /// Stops reading and returns the state of the pipeline. Mailboxes are closed once they have every event.
    pub fn stop(self) -> State {
        self.shared.stop();
        for thread in self.threads {
            // A thread that panicked has printed its message already.
            let _ = thread.join();
        }
        self.shared.close_mailboxes();
        self.shared.state()
    }
}

/// Ends the skin when its thread panics: subscribers do not wait for frames that never come.
struct EndsOnPanic(Arc<LiveHandle>);

impl EndsOnPanic {
    fn run(self, run: impl FnOnce()) {
        run();
    }
}

impl Drop for EndsOnPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop();
            self.0.close_work();
            self.0.close_mailboxes();
        }
    }
}

pub(crate) fn spawn(name: &str, run: impl FnOnce() + Send + 'static) -> JoinHandle<()> {
    std::thread::Builder::new().name(name.into()).spawn(run).expect("a thread can be started")
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // The data behind these locks is consistent between any two operations.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Longest interval at which threads check whether they must stop.
pub(crate) const POLL: Duration = Duration::from_millis(50);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runtime::watch::STALE;
    use dermis::method::Methods;
    use dermis::pipeline::Severity;
    use dermis::skin::Skin;

    fn pipeline() -> Pipeline {
        let methods = MethodSet::new(&Methods::linear(), Skin::load("skin16").unwrap(), None).unwrap();
        Pipeline::new(Arc::new(methods), Settings::default()).unwrap()
    }

    /// A device that repeats itself thousands of times a second fills neither terminals nor queues.
    #[test]
    fn repeated_messages_of_a_device_are_counted_not_shown() {
        const SENT: u64 = 30_000;
        let shared = LiveHandle::new(&pipeline(), None);
        let mailbox = shared.subscribe(1 << 16);
        let begun = std::time::Instant::now();
        for number in 0..SENT {
            let text = format!("the device says: {number}");
            shared.device_notice(Notice { level: Severity::Error, text, at: crate::clock::now() });
        }
        shared.report_omitted(true);
        let seconds = 1 + begun.elapsed().as_secs();
        let late = shared.subscribe(1 << 16);
        for mailbox in [mailbox, late] {
            let (mut shown, mut omitted) = (0, 0);
            while let Popped::Item(Event::Notice(notice)) = mailbox.take(Duration::ZERO) {
                let counted = notice.text.strip_prefix("and ").and_then(|text| text.split_once(" more messages"));
                match counted {
                    Some((count, _)) => omitted += count.parse::<u64>().unwrap(),
                    None => shown += 1,
                }
            }
            assert!((1..=5 * seconds).contains(&shown), "{shown}");
            assert_eq!(shown + omitted, SENT);
        }
    }

    /// The frame before does not stand while the next one is computed, unless frames wait for each other.
    #[test]
    fn a_frame_that_is_computed_for_long_leaves_the_one_before_stale() {
        for (input, is_stale) in [(Input::Device, true), (Input::Stream, false), (Input::Recording, false)] {
            let shared = LiveHandle::new(&pipeline(), None);
            let mailbox = shared.subscribe(64);
            let watch = Arc::new(Watch::new(Arc::clone(&shared), input));
            let watching = Arc::clone(&watch);
            let thread = spawn("dermis-watch", move || watching.run());
            watch.publish(crate::synthetic::pressed().1);
            watch.set_busy(true);
            std::thread::sleep(STALE + 5 * POLL);
            shared.close_mailboxes();
            thread.join().unwrap();
            let (mut stale, mut told) = (false, false);
            while let Popped::Item(event) = mailbox.take(Duration::ZERO) {
                stale |= matches!(event, Event::Stale(_));
                told |= matches!(event, Event::Notice(notice) if notice.text.starts_with("the computer is too slow"));
            }
            assert_eq!((stale, told), (is_stale, is_stale), "{input:?}");
        }
    }

    #[test]
    fn a_thread_that_panics_ends_the_skin() {
        let pipeline = pipeline();
        let shared = LiveHandle::new(&pipeline, None);
        let handle = Arc::clone(&shared);
        let source = move || {
            handle.await_begin();
            panic!("a test of panics");
        };
        let live = Live::with_threads(shared, pipeline, Input::Device, source);
        let mailbox = live.shared().subscribe(8);
        live.begin();
        assert!(matches!(mailbox.take(Duration::from_secs(20)), Popped::Closed));
        live.stop();
    }
}
