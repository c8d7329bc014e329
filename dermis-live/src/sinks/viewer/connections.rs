//! The connections of the viewer's server and their limits: connections that are no page are few and short, so that
//! idle ones cannot use up the descriptors of the program.

use crate::clock;
use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use dermis::pipeline::{Notice, Severity};
use dermis::text::counted;
use std::collections::VecDeque;
use std::io::{ErrorKind, Result};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::Sleep;

/// Most connections that are no page; when another one comes, the oldest is closed. A browser opens six.
pub(super) const MAX_STRANGERS: usize = 64;
/// Most pages at once.
pub(super) const MAX_PAGES: usize = 100;
/// A connection without a complete request in this time is closed.
const FIRST_REQUEST: Duration = Duration::from_secs(5);
/// A connection that is no page is closed after this time: loading the page over a slow line takes less.
const LOADING: Duration = Duration::from_secs(30);
/// Interval of the notices of closed connections.
const REPORT: Duration = Duration::from_secs(10);
/// Pause after a failure to accept, such as too many open files.
const RETRY: Duration = Duration::from_millis(100);

/// The listening socket.
pub(super) struct Connections {
    listener: TcpListener,
    counts: Arc<Counts>,
    notify: Box<dyn Fn(Notice) + Send>,
    reported_at: Option<Instant>,
}

/// The connections of the server.
#[derive(Debug, Default)]
struct Counts {
    /// Connections that are no page, oldest first.
    strangers: Mutex<VecDeque<Arc<State>>>,
    pages: AtomicUsize,
    /// Connections that were closed or refused since the last notice.
    closed: AtomicUsize,
}

/// The state of a connection, shared with the requests on it.
#[derive(Debug, Default)]
struct State {
    /// It has sent a complete request.
    has_asked: AtomicBool,
    is_page: AtomicBool,
    is_closed: AtomicBool,
    waker: Mutex<Option<Waker>>,
}

/// A connection, as the handlers of its requests see it.
#[derive(Debug, Clone)]
pub(super) struct Peer {
    state: Arc<State>,
    counts: Arc<Counts>,
}

/// A page, counted until it is dropped.
pub(super) struct PageSlot {
    counts: Arc<Counts>,
}

/// The stream of a connection, which ends when its time is over.
pub(super) struct Stream {
    stream: TcpStream,
    peer: Peer,
    /// When it is looked at next.
    deadline: Pin<Box<Sleep>>,
    begun: Instant,
}

impl Connections {
    /// Of a server; `notify` receives notices of closed connections.
    pub(super) fn new(listener: TcpListener, notify: Box<dyn Fn(Notice) + Send>) -> Self {
        Connections { listener, counts: Arc::default(), notify, reported_at: None }
    }

    fn report(&mut self) {
        if self.reported_at.is_some_and(|at| at.elapsed() < REPORT) {
            return;
        }
        let closed = self.counts.closed.swap(0, Ordering::Relaxed);
        if closed > 0 {
            self.reported_at = Some(Instant::now());
            let text = format!(
                "{} to the page closed: more than {MAX_STRANGERS} without a page, or more than {MAX_PAGES} pages",
                counted(closed, "connection")
            );
            (self.notify)(Notice { level: Severity::Warning, text, at: clock::now() });
        }
    }
}

impl Listener for Connections {
    type Io = Stream;
    type Addr = Peer;

    async fn accept(&mut self) -> (Stream, Peer) {
        loop {
            self.report();
            let accepted = tokio::time::timeout(REPORT, self.listener.accept()).await;
            match accepted {
                Ok(Ok((stream, _))) => {
                    let peer = Peer { state: Arc::default(), counts: Arc::clone(&self.counts) };
                    self.counts.add(&peer.state);
                    let deadline = Box::pin(tokio::time::sleep(FIRST_REQUEST));
                    return (Stream { stream, peer: peer.clone(), deadline, begun: Instant::now() }, peer);
                }
                Ok(Err(_)) => tokio::time::sleep(RETRY).await,
                Err(_) => {}
            }
        }
    }

    fn local_addr(&self) -> Result<Peer> {
        Ok(Peer { state: Arc::default(), counts: Arc::clone(&self.counts) })
    }
}

impl Connected<IncomingStream<'_, Connections>> for Peer {
    fn connect_info(stream: IncomingStream<'_, Connections>) -> Self {
        stream.remote_addr().clone()
    }
}

impl Counts {
    /// Adds a connection; closes the oldest one that is no page if there are too many.
    fn add(&self, state: &Arc<State>) {
        let mut strangers = lock(&self.strangers);
        strangers.push_back(Arc::clone(state));
        if strangers.len() > MAX_STRANGERS
            && let Some(oldest) = strangers.pop_front()
        {
            self.closed.fetch_add(1, Ordering::Relaxed);
            oldest.close();
        }
    }

    fn remove(&self, state: &Arc<State>) {
        lock(&self.strangers).retain(|other| !Arc::ptr_eq(other, state));
    }
}

impl State {
    fn close(&self) {
        self.is_closed.store(true, Ordering::Relaxed);
        if let Some(waker) = lock(&self.waker).take() {
            waker.wake();
        }
    }
}

impl Peer {
    /// A complete request has come.
    pub(super) fn has_asked(&self) {
        self.state.has_asked.store(true, Ordering::Relaxed);
    }

    /// Makes the connection a page, unless there are too many.
    pub(super) fn become_page(&self) -> Option<PageSlot> {
        let add = |pages| (pages < MAX_PAGES).then_some(pages + 1);
        if self.counts.pages.fetch_update(Ordering::Relaxed, Ordering::Relaxed, add).is_err() {
            self.counts.closed.fetch_add(1, Ordering::Relaxed);
            return None;
        }
        self.state.is_page.store(true, Ordering::Relaxed);
        self.counts.remove(&self.state);
        Some(PageSlot { counts: Arc::clone(&self.counts) })
    }
}

impl Drop for PageSlot {
    fn drop(&mut self) {
        self.counts.pages.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Stream {
    /// Whether its time is over; wakes the task when it will be.
    fn is_over(&mut self, context: &mut Context<'_>) -> bool {
        let state = &self.peer.state;
        if state.is_page.load(Ordering::Relaxed) {
            return false;
        }
        *lock(&state.waker) = Some(context.waker().clone());
        while !state.is_closed.load(Ordering::Relaxed) {
            if self.deadline.as_mut().poll(context).is_pending() {
                return false;
            }
            let left = LOADING.saturating_sub(self.begun.elapsed());
            // Browsers open connections in advance: those that were not needed are no news.
            if !state.has_asked.load(Ordering::Relaxed) || left.is_zero() {
                state.close();
            } else {
                self.deadline.as_mut().reset(tokio::time::Instant::now() + left);
            }
        }
        true
    }

    /// Polls the socket while its time is not over.
    fn poll<T>(
        &mut self,
        context: &mut Context<'_>,
        poll: impl FnOnce(Pin<&mut TcpStream>, &mut Context<'_>) -> Poll<Result<T>>,
    ) -> Poll<Result<T>> {
        if self.is_over(context) {
            return Poll::Ready(Err(ErrorKind::TimedOut.into()));
        }
        poll(Pin::new(&mut self.stream), context)
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.peer.counts.remove(&self.peer.state);
    }
}

impl AsyncRead for Stream {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<Result<()>> {
        self.poll(context, |stream, context| stream.poll_read(context, buffer))
    }
}

impl AsyncWrite for Stream {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<Result<usize>> {
        self.poll(context, |stream, context| stream.poll_write(context, bytes))
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        self.poll(context, |stream, context| stream.poll_flush(context))
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
