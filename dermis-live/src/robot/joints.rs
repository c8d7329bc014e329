//! Joint states from elsewhere: datagrams of JSON, or a topic of ROS 2.

use super::Incoming;
use super::part::StoppedThread;
use crate::{LiveError, clock, runtime};
use dermis::pipeline::Timestamp;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::net::UdpSocket;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
#[cfg(feature = "ros2")]
use std::time::Duration;
use std::time::Instant;

/// Longest datagram of joint states, bytes: that of UDP.
const DATAGRAM: usize = 1 << 16;

/// Joint states as a datagram of JSON, with the names of `sensor_msgs/JointState`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct JointStates {
    /// When they were measured, seconds since 1970; without it, when they arrived.
    stamp_s: Option<f64>,
    pub(super) name: Vec<String>,
    pub(super) position: Vec<f64>,
    /// What else `sensor_msgs/JointState` has, but for its header: a time that is not read would be believed to be.
    #[serde(rename = "velocity", default)]
    _velocity: IgnoredAny,
    #[serde(rename = "effort", default)]
    _effort: IgnoredAny,
}

/// A socket for joint states.
pub(super) fn bind(address: &str) -> Result<UdpSocket, LiveError> {
    let failed = |error: std::io::Error| {
        let fix = "write joints = \"udp:HOST:PORT\" with an address of this machine and a free port";
        LiveError::Given(format!("cannot receive joint states at {address}: {error}; {fix}"))
    };
    let socket = UdpSocket::bind(address).map_err(failed)?;
    socket.set_read_timeout(Some(runtime::POLL)).map_err(failed)?;
    Ok(socket)
}

/// When something came last.
pub(super) type Arrival = Arc<Mutex<Option<Instant>>>;

pub(super) fn lock_arrival(arrival: &Arrival) -> MutexGuard<'_, Option<Instant>> {
    arrival.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Receives joint states, without those that came before.
pub(super) fn listen(
    socket: UdpSocket,
    incoming: &Arc<runtime::Mailbox<Incoming>>,
    arrival: &Arrival,
) -> StoppedThread {
    let (incoming, arrival) = (Arc::clone(incoming), Arc::clone(arrival));
    let run = move |stopped: &AtomicBool| {
        let mut datagram = vec![0; DATAGRAM];
        if socket.set_nonblocking(true).is_ok() {
            while socket.recv(&mut datagram).is_ok() {}
        }
        // A socket that does not block would be asked without end.
        if socket.set_nonblocking(false).is_err() {
            return;
        }
        while !stopped.load(Ordering::Relaxed) {
            if let Ok(length) = socket.recv(&mut datagram) {
                *lock_arrival(&arrival) = Some(Instant::now());
                incoming.put(joint_states(&datagram[..length], clock::now()));
            }
        }
    };
    StoppedThread::spawn("dermis-joints", run)
}

/// Subscribes to joint states of ROS 2.
#[cfg(feature = "ros2")]
pub(super) fn subscribe(
    topic: &str,
    incoming: &Arc<runtime::Mailbox<Incoming>>,
    arrival: &Arrival,
) -> Result<StoppedThread, LiveError> {
    /// Interval of looks: the messages have their times.
    const LOOK: Duration = Duration::from_millis(2);
    let states = crate::sinks::ros2::robot::JointStates::subscribe(topic)
        .map_err(|error| LiveError::Given(format!("cannot receive joint states: {error}")))?;
    let (incoming, arrival) = (Arc::clone(incoming), Arc::clone(arrival));
    let run = move |stopped: &AtomicBool| {
        while !stopped.load(Ordering::Relaxed) {
            match states.take() {
                Ok(Some((stamp, state))) => {
                    *lock_arrival(&arrival) = Some(Instant::now());
                    let states = JointStates {
                        stamp_s: None,
                        name: state.name,
                        position: state.position,
                        _velocity: IgnoredAny,
                        _effort: IgnoredAny,
                    };
                    incoming.put(states.taken(stamp, clock::now()));
                }
                Ok(None) => std::thread::sleep(LOOK),
                Err(error) => {
                    incoming.put(Incoming::Wrong(format!("joint states that cannot be read: {error}")));
                    std::thread::sleep(LOOK);
                }
            }
        }
    };
    Ok(StoppedThread::spawn("dermis-joints", run))
}

#[cfg(not(feature = "ros2"))]
pub(super) fn subscribe(
    topic: &str,
    _: &Arc<runtime::Mailbox<Incoming>>,
    _: &Arrival,
) -> Result<StoppedThread, LiveError> {
    let fix = "build it with ROS 2 (`--features ros2`), or take joints = \"udp:HOST:PORT\"";
    Err(LiveError::Given(format!("joint states of {topic}: this program was built without ROS 2; {fix}")))
}

impl JointStates {
    /// As they come in.
    fn taken(self, stamp: Option<Timestamp>, arrived: Timestamp) -> Incoming {
        if self.name.len() == self.position.len() {
            return Incoming::Joints {
                arrived,
                at: stamp.unwrap_or(arrived),
                states: self,
                is_stamped: stamp.is_some(),
            };
        }
        let (names, positions) = (self.name.len(), self.position.len());
        Incoming::Wrong(format!("joint states with {names} names and {positions} positions: give one for each"))
    }
}

/// Joint states in a datagram that arrived at a time.
fn joint_states(datagram: &[u8], arrived: Timestamp) -> Incoming {
    const SHAPE: &str = r#"send {"stamp_s": 1764200000.5, "name": ["elbow"], "position": [0.1]}"#;
    let states: JointStates = match serde_json::from_slice(datagram) {
        Ok(states) => states,
        Err(error) => return Incoming::Wrong(format!("joint states that cannot be read: {error}; {SHAPE}")),
    };
    let stamp = match states.stamp_s {
        None => None,
        Some(seconds) if (0.0..1e10).contains(&seconds) => Some(Timestamp { unix_ns: (seconds * 1e9).round() as u64 }),
        Some(seconds) => {
            let text = format!("joint states of the time {seconds}: `stamp_s` is in seconds since 1970");
            return Incoming::Wrong(text);
        }
    };
    states.taken(stamp, arrived)
}
