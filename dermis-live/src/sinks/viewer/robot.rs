//! The page of a robot: its links, its skins and what is known of them.

use super::connections::{PageSlot, Peer};
use super::socket::{Asked, admit, send, wait_for};
use super::{PageFile, STYLE, Server, ServerOptions, router};
use crate::LiveError;
use crate::runtime::RateLimit;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{ConnectInfo, Query, State};
use axum::http::HeaderMap;
use axum::response::Response;
use axum::routing::get;
use dermis::geom::Point3;
use dermis::geom::vector::{add, cross, norm, normalize, scale, sub};
use dermis::mesh::Cells;
use dermis::pipeline::Notice;
use dermis::skin::Skin;
use dermis_robot::{Pose, Robot, Shape, Snapshot, Zone, link_triangles};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Files of the page.
const FILES: [PageFile; 4] = [
    ("/", "text/html; charset=utf-8", include_bytes!("page/robot.html")),
    ("/robot.js", "text/javascript; charset=utf-8", include_bytes!("page/robot.js")),
    ("/robot.css", "text/css; charset=utf-8", include_bytes!("page/robot.css")),
    STYLE,
];
/// Interval of what pages show.
const SHOWN: Duration = Duration::from_millis(50);
/// Notices shown on pages.
const MESSAGES: usize = 8;
/// Commands that can wait; more are refused.
const COMMANDS: usize = 64;
/// Messages of a page that are read at once, and in a second.
const MESSAGES_AT_ONCE: u32 = 20;
const MESSAGES_A_SECOND: f64 = 20.0;
/// A link of more triangles is drawn by every second, third, ... one: a page that draws slowly shows nothing in time.
const MAX_TRIANGLES: usize = 20_000;

/// Radius of a rod over its length.
const ROD: f64 = 0.03;

/// What a page asks for.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum RobotRequest {
    /// A new tare of a skin, or of all.
    Tare {
        /// The skin.
        skin: Option<String>,
    },
}

/// The server of the page of a robot.
#[derive(Debug)]
pub struct RobotServer {
    server: Server,
    board: Arc<Board>,
    requests: Receiver<RobotRequest>,
    messages: Arc<Mutex<VecDeque<Notice>>>,
    shown: Option<Instant>,
}

/// What pages are sent.
#[derive(Debug)]
struct Board {
    scene: String,
    status: watch::Sender<Arc<String>>,
    requests: SyncSender<RobotRequest>,
    skins: Vec<String>,
    token: Option<String>,
}

impl RobotServer {
    /// Serves the page of a robot from now on.
    ///
    /// # Errors
    /// As [`Server::start`]; a skin or a robot description that cannot be read.
    pub fn start(robot: &Robot, options: &ServerOptions) -> Result<Self, LiveError> {
        let (sender, requests) = sync_channel(COMMANDS);
        let board = Arc::new(Board {
            scene: scene(robot)?.to_string(),
            status: watch::Sender::new(Arc::default()),
            requests: sender,
            skins: robot.skins().iter().map(|skin| skin.name.clone()).collect(),
            token: options.token.clone(),
        });
        let router = router(&FILES, get(open)).with_state(Arc::clone(&board));
        let messages = Arc::new(Mutex::new(VecDeque::new()));
        let kept = Arc::clone(&messages);
        let server = Server::serve(options, router, move |notice| keep(&kept, notice))?;
        Ok(RobotServer { server, board, requests, messages, shown: None })
    }

    /// The server.
    pub fn server(&self) -> &Server {
        &self.server
    }

    /// Shows what is known of the robot, with the pose of each link in the frame of the base; without poses it is drawn with all
    /// joints at zero. Pages are sent 20 snapshots a second at most.
    pub fn show(&mut self, robot: &Robot, snapshot: &Snapshot, poses: Option<&[Option<Pose>]>) {
        if self.board.status.receiver_count() == 0 || self.shown.is_some_and(|at| at.elapsed() < SHOWN) {
            return;
        }
        self.shown = Some(Instant::now());
        let reasons = snapshot.skins.iter().filter_map(|skin| match skin.zone {
            Zone::Unknown { reason } => Some((skin.skin.clone(), Value::from(reason.text()))),
            Zone::Clear | Zone::Touched => None,
        });
        let messages = self.messages.lock().unwrap_or_else(PoisonError::into_inner);
        let messages: Vec<Value> = messages
            .iter()
            .map(|notice| json!({ "level": notice.level, "text": notice.text, "at_s": notice.at.seconds() }))
            .collect();
        let status = json!({
            "type": "status",
            "snapshot": snapshot,
            "poses": of_links(robot, poses),
            "posed": poses.is_some(),
            "reasons": reasons.collect::<Map<String, Value>>(),
            "messages": messages,
        });
        self.board.status.send_replace(Arc::new(status.to_string()));
    }

    /// Shows a message.
    pub fn say(&self, notice: Notice) {
        keep(&self.messages, notice);
    }

    /// What pages have asked for since the last call.
    pub fn requests(&self) -> impl Iterator<Item = RobotRequest> {
        self.requests.try_iter()
    }

    /// Stops the server.
    pub fn stop(self) {
        self.server.stop();
    }
}

fn keep(messages: &Mutex<VecDeque<Notice>>, notice: Notice) {
    let mut messages = messages.lock().unwrap_or_else(PoisonError::into_inner);
    if messages.len() == MESSAGES {
        messages.pop_front();
    }
    messages.push_back(notice);
}

/// The poses by link: three columns of the rotation, then the translation.
fn of_links(robot: &Robot, poses: Option<&[Option<Pose>]>) -> Map<String, Value> {
    let Some(kinematics) = robot.kinematics() else {
        // Without a description each skin is drawn in the frame of its link, all in one place.
        let links = robot.skins().iter().map(|skin| (skin.link.clone(), numbers(&Pose::IDENTITY)));
        return links.collect();
    };
    let zero;
    let poses = match poses {
        Some(poses) => poses,
        None => {
            zero = robot.poses(&vec![0.0; kinematics.joint_names().len()]);
            &zero
        }
    };
    let value = |pose: &Option<Pose>| pose.as_ref().map_or(Value::Null, numbers);
    kinematics.links().iter().cloned().zip(poses.iter().map(value)).collect()
}

fn numbers(pose: &Pose) -> Value {
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| pose.vector(axis));
    axes.into_iter().chain([pose.point([0.0; 3])]).flatten().collect()
}

/// The message `scene`: the triangles of the links and of the skins, in the frames of their links.
fn scene(robot: &Robot) -> Result<Value, LiveError> {
    let mut parts = Vec::new();
    let part = |link: &str, skin: Option<&str>, triangles: &[[Point3; 3]]| {
        let step = triangles.len().div_ceil(MAX_TRIANGLES).max(1);
        // To a hundredth of a millimetre.
        let corners = triangles.iter().step_by(step).flatten().flatten();
        let corners: Vec<f64> = corners.map(|value| (value * 1e5).round() / 1e5).collect();
        json!({ "link": link, "skin": skin, "corners_m": corners })
    };
    if let (Some(kinematics), Some(description)) = (robot.kinematics(), robot.description()) {
        for (index, link) in kinematics.links().iter().enumerate() {
            // One without a shape that can be read is drawn as rods to the links that it carries.
            let of_shape = |shape| link_triangles(description, link, shape).ok().map(|(triangles, _)| triangles);
            let triangles = of_shape(Shape::Visual)
                .or_else(|| of_shape(Shape::Collision))
                .unwrap_or_else(|| kinematics.joint_origins(index).flat_map(rod).collect());
            if !triangles.is_empty() {
                parts.push(part(link, None, &triangles));
            }
        }
    }
    for worn in robot.skins() {
        let skin = Skin::load(&worn.design)?;
        let mesh = skin.mesh();
        let Cells::Triangles(cells) = &mesh.cells else { continue };
        let triangles: Vec<[Point3; 3]> =
            cells.iter().map(|cell| cell.map(|node| worn.origin.point(mesh.nodes[node]))).collect();
        parts.push(part(&worn.link, Some(&worn.name), &triangles));
    }
    Ok(json!({ "type": "scene", "robot": robot.name(), "base": robot.base(), "parts": parts }))
}

/// A rod of triangles from the origin to a point.
fn rod(to: Point3) -> Vec<[Point3; 3]> {
    let length_m = norm(to);
    if length_m == 0.0 {
        return Vec::new();
    }
    let flattest = (0..3).min_by(|a, b| to[*a].abs().total_cmp(&to[*b].abs())).unwrap_or(0);
    let mut axis = [0.0; 3];
    axis[flattest] = 1.0;
    let radius_m = (ROD * length_m).clamp(0.002, 0.01);
    let u = scale(normalize(cross(to, axis)), radius_m);
    let v = scale(normalize(cross(to, u)), radius_m);
    let corners = [add(u, v), sub(u, v), scale(add(u, v), -1.0), sub(v, u)];
    let side = |corner: usize| {
        let (a, b) = (corners[corner], corners[(corner + 1) % 4]);
        [[a, b, add(b, to)], [a, add(b, to), add(a, to)]]
    };
    (0..4).flat_map(side).collect()
}

/// A page opens its WebSocket.
async fn open(
    State(board): State<Arc<Board>>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    Query(asked): Query<Asked>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    let shared = Arc::clone(&board);
    admit(board.token.as_deref(), &peer, &asked, &headers, upgrade, move |socket, slot| serve(shared, socket, slot))
}

async fn serve(board: Arc<Board>, mut socket: WebSocket, _slot: PageSlot) {
    // The connection is broken or closed: nothing can be reported.
    let _ = talk(&board, &mut socket).await;
}

async fn talk(board: &Board, socket: &mut WebSocket) -> Result<(), ()> {
    let mut statuses = board.status.subscribe();
    let mut limit = RateLimit::new(MESSAGES_AT_ONCE, MESSAGES_A_SECOND);
    send(socket, Message::text(board.scene.as_str())).await?;
    statuses.mark_unchanged();
    loop {
        tokio::select! {
            changed = statuses.changed() => {
                changed.map_err(drop)?;
                let status = statuses.borrow_and_update().clone();
                send(socket, Message::text(status.as_str())).await?;
            }
            received = socket.recv() => match received {
                Some(Ok(Message::Text(text))) => {
                    wait_for(&mut limit).await;
                    if let Err(why) = board.take(&text) {
                        send(socket, Message::text(json!({ "type": "refused", "why": why }).to_string())).await?;
                    }
                }
                Some(Ok(Message::Close(_)) | Err(_)) | None => return Ok(()),
                Some(Ok(_)) => {}
            },
        }
    }
}

impl Board {
    /// Takes a command of a page.
    fn take(&self, text: &str) -> Result<(), String> {
        let command: RobotRequest = serde_json::from_str(text).map_err(|error| format!("no command: {error}"))?;
        let RobotRequest::Tare { skin } = &command;
        if let Some(skin) = skin.as_ref().filter(|skin| !self.skins.contains(skin)) {
            return Err(format!("the robot has no skin `{skin}`"));
        }
        self.requests.try_send(command).map_err(|_| "too many commands wait".into())
    }
}
