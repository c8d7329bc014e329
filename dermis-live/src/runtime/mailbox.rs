//! Queues of limited length that keep the newest items.

use super::Event;
use dermis::frame::Frame;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A queue of limited length between two threads. Putting never blocks: if the queue is full, the oldest item is
/// dropped and counted.
///
/// ```
/// use dermis_live::{Mailbox, Popped};
/// use std::time::Duration;
///
/// let mailbox = Mailbox::new(2);
/// (0..3).for_each(|item| mailbox.put(item));
/// assert_eq!(mailbox.take(Duration::ZERO), Popped::Item(1));
/// assert_eq!(mailbox.dropped(), 1);
/// ```
#[derive(Debug)]
pub struct Mailbox<T> {
    capacity: usize,
    state: Mutex<State<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct State<T> {
    items: VecDeque<T>,
    dropped: u64,
    closed: bool,
}

/// The result of waiting for an item.
#[derive(Debug, PartialEq, Eq)]
pub enum Popped<T> {
    /// The oldest item.
    Item(T),
    /// No item in time.
    TimedOut,
    /// No further items.
    Closed,
}

impl<T> Mailbox<T> {
    /// A queue of at most `capacity` items.
    pub fn new(capacity: usize) -> Self {
        let state = State { items: VecDeque::with_capacity(capacity.min(1024)), dropped: 0, closed: false };
        Mailbox { capacity: capacity.max(1), state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Puts an item in. Never blocks.
    pub fn put(&self, item: T) {
        let mut state = self.lock();
        if state.closed {
            return;
        }
        if state.items.len() == self.capacity {
            state.items.pop_front();
            state.dropped += 1;
        }
        state.items.push_back(item);
        drop(state);
        self.changed.notify_one();
    }

    /// Takes the oldest item; waits for it up to `patience`.
    pub fn take(&self, patience: Duration) -> Popped<T> {
        let until = Instant::now() + patience;
        let mut state = self.lock();
        loop {
            if let Some(item) = state.items.pop_front() {
                return Popped::Item(item);
            }
            if state.closed {
                return Popped::Closed;
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Popped::TimedOut;
            }
            state = self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Ends the queue: further items are ignored, those in it can still be taken.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Number of dropped items.
    pub fn dropped(&self) -> u64 {
        self.lock().dropped
    }

    /// Number of waiting items.
    pub fn len(&self) -> usize {
        self.lock().items.len()
    }

    /// Whether no item waits.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        // A queue is consistent between any two operations.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Mailbox<Event> {
    /// The values of the next frames, ohm: fewer than `count` if none comes for the time `patience`, or the source ends.
    /// `seen` is called with each event.
    pub fn frames(&self, count: usize, patience: Duration, mut seen: impl FnMut(&Event)) -> Vec<Frame> {
        let (mut frames, mut last) = (Vec::new(), Instant::now());
        while frames.len() < count && last.elapsed() < patience {
            match self.take(Duration::from_millis(100)) {
                Popped::Item(event) => {
                    seen(&event);
                    if let Event::Frame(frame) = event {
                        last = Instant::now();
                        frames.push(Frame(frame.result.values_ohm.clone()));
                    }
                }
                Popped::TimedOut => {}
                Popped::Closed => break,
            }
        }
        frames
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_goes_where_it_is_full_and_closing_loses_nothing() {
        let mailbox = Mailbox::new(2);
        (0..5).for_each(|item| mailbox.put(item));
        assert_eq!(mailbox.dropped(), 3);
        mailbox.close();
        mailbox.put(9);
        let patience = Duration::from_millis(1);
        assert_eq!(mailbox.take(patience), Popped::Item(3));
        assert_eq!(mailbox.take(patience), Popped::Item(4));
        assert_eq!(mailbox.take(patience), Popped::Closed);
        assert_eq!(Mailbox::<u8>::new(1).take(patience), Popped::TimedOut);
    }
}
