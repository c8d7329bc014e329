//! Work without the interpreter's lock, on threads of its own, that Ctrl-C interrupts.

use crate::failure::{Failure, Outcome};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Thread;
use std::time::{Duration, Instant};

/// Interval between two looks at signals.
const LOOK: Duration = Duration::from_millis(50);
/// Progress is shown for work that lasts longer.
const QUIET: Duration = Duration::from_secs(2);

/// The threads of this process. A forked child has none of its parent's threads: it makes its own.
fn pool() -> Outcome<Arc<ThreadPool>> {
    static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    match pool.take() {
        Some((owner, threads)) if owner == process => {
            *pool = Some((owner, Arc::clone(&threads)));
            Ok(threads)
        }
        parents => {
            // The threads do not exist here: they cannot be ended.
            std::mem::forget(parents);
            let threads = ThreadPoolBuilder::new().build().map_err(Failure::given)?;
            let threads = Arc::new(threads);
            *pool = Some((process, Arc::clone(&threads)));
            Ok(threads)
        }
    }
}

/// What the caller and the work tell each other.
#[derive(Debug, Default)]
pub struct Watch {
    done: AtomicUsize,
    is_cancelled: AtomicBool,
}

impl Watch {
    /// Counts finished steps.
    pub fn steps(&self, count: usize) {
        self.done.fetch_add(count, Ordering::Relaxed);
    }

    /// Ends the work if it was cancelled.
    pub fn check(&self) -> Outcome<()> {
        if self.is_cancelled.load(Ordering::Relaxed) { Err(Failure::Cancelled) } else { Ok(()) }
    }
}

/// Runs work on this process's threads, without the interpreter's lock. An interrupt cancels work that looks at its
/// watch; progress over `steps` is shown after two seconds.
///
/// # Errors
/// The work's; the exception of a signal handler (`KeyboardInterrupt`).
pub fn run<T: Send>(
    py: Python<'_>,
    what: &str,
    steps: usize,
    work: impl FnOnce(&Watch) -> Outcome<T> + Send,
) -> Outcome<T> {
    let (watch, pool) = (Watch::default(), pool()?);
    let end = End { is_reached: AtomicBool::new(false), caller: std::thread::current() };
    let begun = Instant::now();
    let mut raised = None;
    let result = std::thread::scope(|scope| {
        let worker = scope.spawn(|| {
            let _end = OnDrop(&end);
            pool.install(|| work(&watch))
        });
        while !end.is_reached.load(Ordering::Acquire) {
            py.detach(|| std::thread::park_timeout(LOOK));
            if raised.is_none()
                && let Err(exception) = look(py, what, begun, watch.done.load(Ordering::Relaxed), steps)
            {
                watch.is_cancelled.store(true, Ordering::Relaxed);
                raised = Some(exception);
            }
        }
        py.detach(|| worker.join())
    });
    if let Some(exception) = raised {
        return Err(exception.into());
    }
    result.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// The end of work, for which its caller waits.
struct End {
    is_reached: AtomicBool,
    caller: Thread,
}

/// Reaches the end when it is dropped, after a panic too.
struct OnDrop<'a>(&'a End);

impl Drop for OnDrop<'_> {
    fn drop(&mut self) {
        self.0.is_reached.store(true, Ordering::Release);
        self.0.caller.unpark();
    }
}

/// Runs short work on this process's threads, without the interpreter's lock.
///
/// # Errors
/// The work's.
pub fn run_short<T: Send>(py: Python<'_>, work: impl FnOnce() -> Outcome<T> + Send) -> Outcome<T> {
    let pool = pool()?;
    py.detach(|| pool.install(work))
}

/// Shows progress and runs the handlers of signals.
fn look(py: Python<'_>, what: &str, begun: Instant, done: usize, steps: usize) -> PyResult<()> {
    if begun.elapsed() > QUIET && steps > 1 {
        let seconds = begun.elapsed().as_secs_f64();
        py.import("dermis._progress")?.call_method1("show", (what, done, steps, seconds))?;
    }
    py.check_signals()
}
