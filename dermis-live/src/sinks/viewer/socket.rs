//! The WebSocket of one page.

use super::connections::{PageSlot, Peer};
use super::{ServerState, may_talk};
use crate::runtime::{ClientSession, RateLimit};
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{ConnectInfo, Query, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Longest message of a page, bytes.
const LONGEST: usize = 4096;
/// A page that reads nothing for this time is disconnected.
const PATIENCE: Duration = Duration::from_secs(10);

/// Messages of a page that are read at once, and in a second: a finger that moves sends one per drawn frame. Others wait
/// in the connection.
const MESSAGES_AT_ONCE: u32 = 400;
const MESSAGES_A_SECOND: f64 = 400.0;

/// Query parameters of the WebSocket URL.
#[derive(Debug, Deserialize)]
pub(super) struct Asked {
    token: Option<String>,
}

/// A page opens its WebSocket.
pub(super) async fn open(
    State(shared): State<Arc<ServerState>>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    Query(asked): Query<Asked>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    admit(shared.token.as_deref(), &peer, &asked, &headers, upgrade, {
        let shared = Arc::clone(&shared);
        move |socket, slot| Page::new(shared, slot).serve(socket)
    })
}

/// Opens the WebSocket of a page that may talk, unless too many are open.
pub(super) fn admit<F: Future<Output = ()> + Send + 'static>(
    token: Option<&str>,
    peer: &Peer,
    asked: &Asked,
    headers: &HeaderMap,
    upgrade: WebSocketUpgrade,
    serve: impl FnOnce(WebSocket, PageSlot) -> F + Send + 'static,
) -> Response {
    if !may_talk(token, asked.token.as_deref(), headers) {
        return (StatusCode::FORBIDDEN, "this page may not talk to the skin: open the address that dermis printed\n")
            .into_response();
    }
    let Some(slot) = peer.become_page() else {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many pages are open: close some\n").into_response();
    };
    let upgrade = upgrade.max_message_size(LONGEST).max_frame_size(LONGEST);
    upgrade.on_upgrade(move |socket| serve(socket, slot))
}

/// One page.
struct Page {
    shared: Arc<ServerState>,
    session: Arc<Mutex<ClientSession>>,
    paused: bool,
    /// The number of the last frame sent to it, and the frames that it missed because it read slowly.
    last: Option<u64>,
    skipped: u64,
    limit: RateLimit,
    /// Counts the page while it is open.
    _slot: PageSlot,
}

impl Page {
    fn new(shared: Arc<ServerState>, slot: PageSlot) -> Self {
        let session = Arc::new(Mutex::new(ClientSession::new(Arc::clone(&shared.control))));
        let limit = RateLimit::new(MESSAGES_AT_ONCE, MESSAGES_A_SECOND);
        Page { shared, session, paused: false, last: None, skipped: 0, limit, _slot: slot }
    }

    async fn serve(mut self, mut socket: WebSocket) {
        // The connection is broken or closed: nothing can be reported.
        let _ = self.talk(&mut socket).await;
    }

    async fn talk(&mut self, socket: &mut WebSocket) -> Result<(), ()> {
        let board = Arc::clone(&self.shared.board);
        let (mut scenes, mut statuses, mut frames) =
            (board.scene.subscribe(), board.status.subscribe(), board.frame.subscribe());
        let scene = scenes.borrow_and_update().clone();
        send(socket, Message::text(scene.as_str())).await?;
        let status = self.status(&statuses.borrow_and_update());
        send(socket, status).await?;
        frames.mark_unchanged();
        loop {
            tokio::select! {
                changed = scenes.changed() => {
                    changed.map_err(drop)?;
                    let scene = scenes.borrow_and_update().clone();
                    send(socket, Message::text(scene.as_str())).await?;
                }
                changed = statuses.changed() => {
                    changed.map_err(drop)?;
                    let status = self.status(&statuses.borrow_and_update());
                    send(socket, status).await?;
                }
                changed = frames.changed(), if !self.paused => {
                    changed.map_err(drop)?;
                    let (number, bytes) = frames.borrow_and_update().clone();
                    self.skipped += self.last.map_or(0, |last| number.saturating_sub(last + 1));
                    self.last = Some(number);
                    send(socket, Message::Binary(bytes)).await?;
                }
                received = socket.recv() => match received {
                    Some(Ok(Message::Text(text))) => {
                        wait_for(&mut self.limit).await;
                        if let Err(why) = self.execute(text.to_string()).await {
                            let refused = json!({ "type": "refused", "why": why }).to_string();
                            send(socket, Message::text(refused)).await?;
                        }
                    }
                    Some(Ok(Message::Close(_)) | Err(_)) | None => return Ok(()),
                    Some(Ok(_)) => {}
                },
            }
        }
    }

    /// The status with the data of this page.
    fn status(&self, status: &Value) -> Message {
        let mut status = status.clone();
        if self.paused {
            status["paused"] = true.into();
        }
        status["counts"]["skipped"] = self.skipped.into();
        Message::text(status.to_string())
    }

    /// Carries out a request on another thread: ending a recording waits for the disk, and the other pages must not
    /// wait.
    async fn execute(&mut self, text: String) -> Result<(), String> {
        let session = Arc::clone(&self.session);
        let ask = move || {
            let mut session = session.lock().unwrap_or_else(PoisonError::into_inner);
            (session.ask(&text), session.is_paused())
        };
        let asked = tokio::task::spawn_blocking(ask).await;
        let (done, paused) = asked.map_err(|error| format!("the server failed: {error}"))?;
        if paused != self.paused {
            // Frames during the pause do not count as missed.
            (self.paused, self.last) = (paused, None);
        }
        done
    }
}

/// Waits until another message of a page may pass.
pub(super) async fn wait_for(limit: &mut RateLimit) {
    if let Err(wait_s) = limit.passes(Instant::now()) {
        tokio::time::sleep(Duration::from_secs_f64(wait_s)).await;
        // It passes now; this takes it off the limit.
        let _ = limit.passes(Instant::now());
    }
}

pub(super) async fn send(socket: &mut WebSocket, message: Message) -> Result<(), ()> {
    match tokio::time::timeout(PATIENCE, socket.send(message)).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(()),
    }
}
