//! The server of the viewer: the page and its WebSocket.
//!
//! The page is part of the program; `viewer/README.md` describes the messages.

mod connections;
mod hub;
mod robot;
mod scene;
mod socket;

pub use robot::{RobotRequest, RobotServer};

use crate::LiveError;
use crate::runtime::{Control, Event};
use axum::Router;
use axum::extract::{ConnectInfo, Request};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn};
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodRouter, get};
use connections::{Connections, Peer};
use dermis::pipeline::Notice;
use hub::{Board, Hub};
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::sync::Arc;
use std::thread::JoinHandle;

/// Options of the viewer's server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerOptions {
    /// Host and port; port 0 selects a free port.
    pub address: String,
    /// The access token of a page, at least eight characters; required everywhere but on the loopback interface, where
    /// it is optional.
    pub token: Option<String>,
}

/// The running server of the viewer.
pub struct Server {
    address: SocketAddr,
    token: Option<String>,
    stop: Option<tokio::sync::oneshot::Sender<()>>,
    threads: Vec<JoinHandle<()>>,
}

/// State shared by the handlers.
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

/// A file of a page: path, type and bytes.
type PageFile = (&'static str, &'static str, &'static [u8]);

/// The files of the page.
const FILES: [PageFile; 3] = [
    ("/", "text/html; charset=utf-8", include_bytes!("page/index.html")),
    ("/viewer.js", "text/javascript; charset=utf-8", include_bytes!("page/viewer.js")),
    STYLE,
];
/// The style sheet of both pages.
const STYLE: PageFile = ("/viewer.css", "text/css; charset=utf-8", include_bytes!("page/viewer.css"));

/// Length of the shortest token, characters.
const SHORTEST_TOKEN: usize = 8;

/// The content security policy: only the page's own server. Not every browser takes the WebSocket of the same host as
/// `'self'`, so `CONNECT` is replaced by its addresses.
const POLICY: &str = "default-src 'self'; connect-src 'self'CONNECT; style-src 'self' 'unsafe-inline'; \
                      img-src 'self' data: blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

impl Server {
    /// Serves the viewer of a live skin from now on.
    ///
    /// # Errors
    /// An address that is in use, is not of this machine, or is open to others without a token; a token that is too
    /// short.
    pub fn start(control: Arc<Control>, options: &ServerOptions) -> Result<Self, LiveError> {
        let board = Arc::new(Board::new());
        let hub = Hub::new(Arc::clone(&control), Arc::clone(&board));
        let live = Arc::clone(control.shared());
        let shared = Arc::new(ServerState { control, board, token: options.token.clone() });
        let router = router(&FILES, get(socket::open)).with_state(shared);
        let mut server = Self::serve(options, router, move |notice| live.publish(&Event::Notice(notice)))?;
        server.spawn("dermis-viewer", move || hub.run())?;
        Ok(server)
    }

    /// Serves a router from now on; `report` receives notices of closed connections.
    fn serve(
        options: &ServerOptions,
        router: Router,
        report: impl Fn(Notice) + Send + 'static,
    ) -> Result<Self, LiveError> {
        let listener = listen(options)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(failed)?;
        let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
        let serve = move || {
            runtime.block_on(async move {
                let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
                let connections = Connections::new(listener, Box::new(report));
                let service = router.into_make_service_with_connect_info::<Peer>();
                let ended = async {
                    // A dropped sender stops the server too.
                    let _ = stopped.await;
                };
                tokio::select! {
                    _ = axum::serve(connections, service) => {}
                    () = ended => {}
                }
            });
        };
        let mut server = Server { address, token: options.token.clone(), stop: Some(stop), threads: Vec::new() };
        server.spawn("dermis-serve", serve)?;
        Ok(server)
    }

    fn spawn(&mut self, name: &str, run: impl FnOnce() + Send + 'static) -> Result<(), LiveError> {
        self.threads.push(std::thread::Builder::new().name(name.into()).spawn(run).map_err(failed)?);
        Ok(())
    }

    /// The address of the server.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The URL to open in a browser, without the token.
    pub fn url_without_token(&self) -> String {
        format!("http://{}/", self.address)
    }

    /// The URL to open in a browser.
    pub fn url(&self) -> String {
        match &self.token {
            Some(token) => format!("http://{}/?token={}", self.address, escaped(token)),
            None => self.url_without_token(),
        }
    }

    /// Stops the server. The live skin must have been stopped before.
    pub fn stop(mut self) {
        drop(self.stop.take());
        for thread in self.threads.drain(..) {
            // A thread that panicked has printed its message already.
            let _ = thread.join();
        }
    }
}

fn failed(error: std::io::Error) -> LiveError {
    LiveError::Given(format!("cannot serve the viewer: {error}"))
}

/// Percent-encodes a text (RFC 3986, 2.1).
fn escaped(text: &str) -> String {
    let escaped = |byte: u8| match byte {
        b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    };
    text.bytes().map(escaped).collect()
}

/// Opens the listening socket.
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
    if token.as_ref().is_some_and(|token| token.contains(|c: char| c.is_whitespace() || c.is_control())) {
        return Err(LiveError::Given("a token has no spaces and no control characters".into()));
    }
    if token.is_none() && addresses.iter().any(|address| !address.ip().is_loopback()) {
        let message = format!(
            "{address} can be reached from other machines: give a token that pages must know (--token, --token-file or DERMIS_TOKEN)"
        );
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

/// A page with its WebSocket.
fn router<S: Clone + Send + Sync + 'static>(files: &'static [PageFile], socket: MethodRouter<S>) -> Router<S> {
    let mut router = Router::new().route("/live", socket);
    for &(path, kind, bytes) in files {
        router = router.route(path, get(move |headers: HeaderMap| async move { file(kind, bytes, &headers) }));
    }
    router
        .fallback(|| async { (StatusCode::NOT_FOUND, "nothing is here; the viewer is at /\n") })
        .layer(from_fn(count_request))
}

/// Notes that a connection has sent a request.
async fn count_request(ConnectInfo(peer): ConnectInfo<Peer>, request: Request, next: Next) -> Response {
    peer.has_asked();
    next.run(request).await
}

/// The policy for a page of a host.
fn policy(headers: &HeaderMap) -> HeaderValue {
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok());
    let is_host = |host: &&str| host.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-._:[]".contains(&byte));
    let sockets = host.filter(is_host).map_or(String::new(), |host| format!(" ws://{host} wss://{host}"));
    HeaderValue::from_str(&POLICY.replace("CONNECT", &sockets))
        .unwrap_or(HeaderValue::from_static("default-src 'self'"))
}

fn file(kind: &'static str, bytes: &'static [u8], request: &HeaderMap) -> Response {
    let headers: [(HeaderName, HeaderValue); 5] = [
        (header::CONTENT_TYPE, HeaderValue::from_static(kind)),
        (header::CONTENT_SECURITY_POLICY, policy(request)),
        // The address of the page contains the token.
        (header::REFERRER_POLICY, HeaderValue::from_static("no-referrer")),
        (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
        // The page is part of the program: browsers must not show a cached version of another program.
        (header::CACHE_CONTROL, HeaderValue::from_static("no-cache")),
    ];
    (headers, bytes).into_response()
}

/// Whether a page may connect: it has the token, and it was served by this server.
fn may_talk(own_token: Option<&str>, given: Option<&str>, headers: &HeaderMap) -> bool {
    let header = |name| headers.get(name).and_then(|value| value.to_str().ok());
    let (origin, host) = (header(header::ORIGIN), header(header::HOST));
    let known = match (own_token, given) {
        (None, _) => true,
        (Some(token), Some(given)) => same(token.as_bytes(), given.as_bytes()),
        (Some(_), None) => false,
    };
    // A browser sends the origin of its page; other programs send none.
    let own = match (origin, host) {
        (None, _) => true,
        (Some(origin), Some(host)) => origin.split_once("://").is_some_and(|(_, origin)| origin == host),
        (Some(_), None) => false,
    };
    // Without a token, the `Host` header must be `localhost` or a loopback address. A foreign name that resolves to the
    // loopback interface is refused (DNS rebinding).
    known && own && (own_token.is_some() || host.is_some_and(is_loopback))
}

/// Whether a host, with or without a port, is `localhost` or a loopback address; one of IPv6 stands in brackets.
fn is_loopback(host: &str) -> bool {
    let name = host.rsplit_once(':').map_or(host, |(name, port)| if port.contains(']') { host } else { name });
    let inner = name.strip_prefix('[').and_then(|name| name.strip_suffix(']'));
    name == "localhost" || inner.unwrap_or(name).parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// Compares two secrets in a time that does not depend on where they differ.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |differ, (a, b)| differ | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_hosts_are_ours_and_names_that_look_like_them_are_not() {
        for host in ["localhost", "localhost:8080", "127.0.0.1", "127.3.2.1:80", "[::1]", "[::1]:8080"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in
            ["", "[::1]]", "[[::1]", "[::1", "localhost.example", "127.0.0.1.example:80", "10.0.0.1", "[::2]:80"]
        {
            assert!(!is_loopback(host), "{host}");
        }
    }

    #[test]
    fn tokens_come_whole_through_an_address() {
        assert_eq!(escaped("Az09-._~"), "Az09-._~");
        assert_eq!(escaped("a b&c=ö#+%"), "a%20b%26c%3D%C3%B6%23%2B%25");
    }

    #[test]
    fn tokens_are_long_and_without_spaces() {
        let refusal = |token: &str| {
            let options = ServerOptions { address: "127.0.0.1:0".into(), token: Some(token.into()) };
            listen(&options).err().map(|error| error.to_string())
        };
        assert_eq!(refusal("0123456789abcdef"), None);
        assert!(refusal("1234567").unwrap().contains("at least 8"));
        for wrong in ["        ", "12345678 ", "1234\t5678", "12345678\n", "1234\u{1b}5678"] {
            assert!(refusal(wrong).unwrap().contains("no spaces"), "{wrong:?}");
        }
    }

    #[test]
    fn a_page_connects_to_its_own_host_alone() {
        let policy_of = |host: Option<&str>| {
            let mut headers = HeaderMap::new();
            host.map(|host| headers.insert(header::HOST, HeaderValue::from_str(host).unwrap()));
            policy(&headers).to_str().unwrap().to_string()
        };
        let own = policy_of(Some("skin.example:8420"));
        assert!(own.contains("connect-src 'self' ws://skin.example:8420 wss://skin.example:8420;"), "{own}");
        for other in [policy_of(None), policy_of(Some("a; connect-src *"))] {
            assert!(other.contains("connect-src 'self';") && !other.contains('*'), "{other}");
        }
    }
}
