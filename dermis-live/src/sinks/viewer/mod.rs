//! The viewer's server: the page and its WebSocket.
//!
//! The page is in the program; `viewer/README.md` tells what passes between the two.

mod hub;
mod scene;
mod socket;

use crate::LiveError;
use crate::runtime::Control;
use axum::Router;
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use hub::{Board, Hub};
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::sync::Arc;
use std::thread::JoinHandle;

/// Where the viewer is served, and to whom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerOptions {
    /// Host and port; port 0 is any free one.
    pub address: String,
    /// What a page must know, at least eight characters; asked for everywhere but on the loopback, where it may be left out.
    pub token: Option<String>,
}

/// The viewer's server at work.
pub struct Server {
    address: SocketAddr,
    token: Option<String>,
    stop: Option<tokio::sync::oneshot::Sender<()>>,
    threads: Vec<JoinHandle<()>>,
}

/// What the handlers share.
struct ServerState {
    control: Arc<Control>,
    board: Arc<Board>,
    token: Option<String>,
}

impl std::fmt::Debug for Server {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Server").field("address", &self.address).finish_non_exhaustive()
    }
}

/// The page's files: path, type and bytes.
const FILES: [(&str, &str, &[u8]); 3] = [
    ("/", "text/html; charset=utf-8", include_bytes!("../../../../viewer/dist/index.html")),
    ("/viewer.js", "text/javascript; charset=utf-8", include_bytes!("../../../../viewer/dist/viewer.js")),
    ("/viewer.css", "text/css; charset=utf-8", include_bytes!("../../../../viewer/dist/viewer.css")),
];

/// Characters of the shortest token.
const SHORTEST_TOKEN: usize = 8;

/// What the page may load and talk to: its own server.
const POLICY: &str = "default-src 'self'; connect-src 'self' ws: wss:; style-src 'self' 'unsafe-inline'; \
                      img-src 'self' data: blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

impl Server {
    /// Serves the viewer of a live skin from now on.
    ///
    /// # Errors
    /// An address that is in use, is not this machine's, or is open to others without a token; a token that is too short.
    pub fn start(control: Arc<Control>, options: &ServerOptions) -> Result<Self, LiveError> {
        let listener = listen(options)?;
        let failed = |error: std::io::Error| LiveError::Given(format!("cannot serve the viewer: {error}"));
        listener.set_nonblocking(true).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(failed)?;
        let board = Arc::new(Board::new());
        let hub = Hub::new(Arc::clone(&control), Arc::clone(&board));
        let shared = Arc::new(ServerState { control, board, token: options.token.clone() });
        let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
        let serve = move || {
            runtime.block_on(async move {
                let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
                let ended = async {
                    // Who is dropped says stop as well.
                    let _ = stopped.await;
                };
                tokio::select! {
                    _ = axum::serve(listener, router(shared)) => {}
                    () = ended => {}
                }
            });
        };
        let spawn = |name: &str, run: Box<dyn FnOnce() + Send>| {
            std::thread::Builder::new().name(name.into()).spawn(run).map_err(failed)
        };
        let threads =
            vec![spawn("dermis-viewer", Box::new(move || hub.run()))?, spawn("dermis-serve", Box::new(serve))?];
        Ok(Server { address, token: options.token.clone(), stop: Some(stop), threads })
    }

    /// Where it is.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What to open in a browser.
    pub fn url(&self) -> String {
        match &self.token {
            Some(token) => format!("http://{}/?token={}", self.address, escaped(token)),
            None => format!("http://{}/", self.address),
        }
    }

    /// Ends it. The live skin must have been stopped.
    pub fn stop(mut self) {
        drop(self.stop.take());
        for thread in self.threads.drain(..) {
            // A thread that panicked has told so already.
            let _ = thread.join();
        }
    }
}

/// A text as a part of an address (RFC 3986, 2.1).
fn escaped(text: &str) -> String {
    let escaped = |byte: u8| match byte {
        b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    };
    text.bytes().map(escaped).collect()
}

/// Opens the port.
fn listen(options: &ServerOptions) -> Result<TcpListener, LiveError> {
    let ServerOptions { address, token } = options;
    let addresses: Vec<SocketAddr> = match address.to_socket_addrs() {
        Ok(addresses) => addresses.collect(),
        Err(error) => {
            let fix = "write HOST:PORT, as in 127.0.0.1:8420";
            return Err(LiveError::Given(format!("`{address}` is no address to serve at: {error}; {fix}")));
        }
    };
    if let Some(length) = token.as_ref().map(|token| token.chars().count()).filter(|length| *length < SHORTEST_TOKEN) {
        let message = format!(
            "a token of {length} characters can be guessed: give at least {SHORTEST_TOKEN}, as `openssl rand -hex 16` prints them"
        );
        return Err(LiveError::Given(message));
    }
    if token.is_none() && addresses.iter().any(|address| !address.ip().is_loopback()) {
        let message = format!("{address} can be reached from other machines: give a --token that pages must know");
        return Err(LiveError::Given(message));
    }
    TcpListener::bind(addresses.as_slice()).map_err(|error| {
        let fix = match error.kind() {
            std::io::ErrorKind::AddrInUse => "another program listens there: take another port, or 0 for any",
            std::io::ErrorKind::AddrNotAvailable => "that is no address of this machine",
            std::io::ErrorKind::PermissionDenied => "ports below 1024 need privileges: take a higher one",
            _ => "take another address",
        };
        LiveError::Given(format!("cannot serve the viewer at {address}: {error}; {fix}"))
    })
}

fn router(shared: Arc<ServerState>) -> Router {
    let mut router = Router::new().route("/live", get(socket::open));
    for (path, kind, bytes) in FILES {
        router = router.route(path, get(move || async move { file(kind, bytes) }));
    }
    router.fallback(|| async { (StatusCode::NOT_FOUND, "nothing is here; the viewer is at /\n") }).with_state(shared)
}

fn file(kind: &'static str, bytes: &'static [u8]) -> Response {
    let headers: [(HeaderName, HeaderValue); 4] = [
        (header::CONTENT_TYPE, HeaderValue::from_static(kind)),
        (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY)),
        (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
        // The page is part of the program: another version of it must not come out of a browser's memory.
        (header::CACHE_CONTROL, HeaderValue::from_static("no-cache")),
    ];
    (headers, bytes).into_response()
}

/// Whether a page may talk: it knows the token, and it is this server's own.
fn may_talk(shared: &ServerState, token: Option<&str>, origin: Option<&str>, host: Option<&str>) -> bool {
    let known = match (&shared.token, token) {
        (None, _) => true,
        (Some(token), Some(given)) => same(token.as_bytes(), given.as_bytes()),
        (Some(_), None) => false,
    };
    // A browser says whose page it is; a program says nothing.
    let own = match (origin, host) {
        (None, _) => true,
        (Some(origin), Some(host)) => origin.split_once("://").is_some_and(|(_, origin)| origin == host),
        (Some(_), None) => false,
    };
    known && own && host_is_ours(shared, host)
}

/// Without a token the page must have been asked for by an address of this machine: a name that someone else has pointed at the
/// loopback is not one.
fn host_is_ours(shared: &ServerState, host: Option<&str>) -> bool {
    if shared.token.is_some() {
        return true;
    }
    let Some(host) = host else { return false };
    let name = host.rsplit_once(':').map_or(host, |(name, port)| if port.contains(']') { host } else { name });
    let name = name.trim_start_matches('[').trim_end_matches(']');
    name == "localhost" || name.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// Whether two secrets are the same, in a time that does not tell where they differ.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |differ, (a, b)| differ | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_come_whole_through_an_address() {
        assert_eq!(escaped("Az09-._~"), "Az09-._~");
        assert_eq!(escaped("a b&c=ö#+%"), "a%20b%26c%3D%C3%B6%23%2B%25");
    }
}
