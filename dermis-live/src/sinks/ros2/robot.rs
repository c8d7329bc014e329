//! A robot with several skins as one node of ROS 2.
//!
//! | topic | message | what |
//! |---|---|---|
//! | `/dermis/contacts` | `sensor_msgs/PointCloud2` | contacts of known pose in the frame of the base, with the number of the skin |
//! | `/dermis/wrench/LINK` | `geometry_msgs/WrenchStamped` | the wrench on a link, in its frame; NaN unless complete |
//! | `/dermis/zones` | `std_msgs/String` | whether each skin and the robot are touched, and the rules that hold, as JSON |
//! | `/dermis/events` | `std_msgs/String` | begin, end and another reason of rules, as JSON |
//! | `/dermis/SKIN/...` | | the topics of a skin |
//! | `/tf_static` | `tf2_msgs/TFMessage` | the frame of each skin in that of its link |
//! | `/diagnostics` | `diagnostic_msgs/DiagnosticArray` | `dermis: SKIN`, with the serial number of its device |

use super::dds::{Host, Out, PublishError, PublisherOptions, SkinTopics, latched, quality};
use super::{
    DiagnosticArray, DiagnosticStatus, Header, JointState, KeyValue, PointCloud2, Quaternion, Reference, Text, Time,
    Topic, Transform, TransformArray, TransformStamped, Wrench, WrenchStamped, topic,
};
use crate::LiveFrame;
use dermis::pipeline::{Timestamp, TrackedContact};
use dermis::skin::Skin;
use dermis_robot::{Robot, RuleEvent, SkinSnapshot, Snapshot, Zone};
use std::time::Duration;

/// Interval of diagnostics.
const DIAGNOSED: Duration = Duration::from_secs(1);

/// Publishes a robot: a node `dermis`. Nothing blocks: messages without room are dropped and counted.
pub struct RobotPublisher {
    skins: Vec<SkinTopics>,
    contacts: Out<PointCloud2>,
    wrenches: Vec<(String, Out<WrenchStamped>)>,
    zones: Out<Text>,
    events: Out<Text>,
    diagnostics: Out<DiagnosticArray>,
    _transforms: Out<TransformArray>,
    diagnosed: Option<Timestamp>,
    dropped: u64,
    _host: Host,
}

impl RobotPublisher {
    /// Joins the domain. `skins` are those of the robot, in its order.
    ///
    /// # Errors
    /// Those of [`super::dds::Publisher::new`]; skins or links whose names are the same one in ROS 2.
    pub fn new(robot: &Robot, skins: &[Skin], options: &PublisherOptions) -> Result<Self, PublishError> {
        let mut host = Host::join(options)?;
        let namespace = host.namespace().trim_end_matches('/').to_string();
        let mut topics = Vec::new();
        check_names("skins", robot.skins().iter().map(|worn| worn.name.as_str()))?;
        for (worn, skin) in robot.skins().iter().zip(skins) {
            let name = ros_name(&worn.name);
            let reference =
                Reference { name: format!("dermis {}", worn.name), ..Reference::of(skin, frame_id(robot, &worn.name)) };
            topics.push(SkinTopics::new(reference, &mut host, |topic| topic.of_skin(&namespace, &name))?);
        }
        let mut links: Vec<&str> = robot.skins().iter().map(|worn| worn.link.as_str()).collect();
        links.sort_unstable();
        links.dedup();
        check_names("links", links.iter().copied())?;
        let mut wrenches = Vec::new();
        for link in links {
            let name = format!("{}/{}", Topic::Wrench.absolute(&namespace), ros_name(link));
            wrenches.push((link.to_string(), host.out(name, quality(Topic::Wrench))?));
        }
        let transforms: Out<TransformArray> = host.out("/tf_static".into(), latched())?;
        let named = |topic: Topic| topic.absolute(&namespace);
        let zones = format!("{namespace}/dermis/zones");
        Ok(RobotPublisher {
            skins: topics,
            contacts: host.out(named(Topic::Contacts), quality(Topic::Contacts))?,
            wrenches,
            zones: host.out(zones, quality(Topic::Validity))?,
            events: host.out(named(Topic::Events), quality(Topic::Events))?,
            diagnostics: host.out(named(Topic::Diagnostics), quality(Topic::Diagnostics))?,
            dropped: u64::from(!transforms.send(frames(robot))?),
            // Kept, so that its last message is.
            _transforms: transforms,
            diagnosed: None,
            _host: host,
        })
    }

    /// Publishes a frame of a skin, by its index.
    ///
    /// # Errors
    /// A middleware that has stopped working.
    pub fn frame(&mut self, skin: usize, frame: &LiveFrame) -> Result<(), PublishError> {
        self.skins[skin].frame(frame)
    }

    /// Publishes an event.
    ///
    /// # Errors
    /// A middleware that has stopped working.
    pub fn event(&mut self, event: &RuleEvent) -> Result<(), PublishError> {
        self.dropped += u64::from(!self.events.send(json(event))?);
        Ok(())
    }

    /// Publishes what is known of the robot.
    ///
    /// # Errors
    /// A middleware that has stopped working.
    pub fn snapshot(&mut self, robot: &Robot, snapshot: &Snapshot) -> Result<(), PublishError> {
        let mut sent = vec![self.contacts.send(contacts(robot, snapshot))?, self.zones.send(zones(snapshot))?];
        for (link, out) in &self.wrenches {
            if let Some(wrench) = snapshot.wrenches.iter().find(|wrench| wrench.link == *link) {
                sent.push(out.send(wrench_stamped(wrench, snapshot.at))?);
            }
        }
        if self.diagnosed.is_none_or(|at| snapshot.at.seconds_since(at) >= DIAGNOSED.as_secs_f64()) {
            self.diagnosed = Some(snapshot.at);
            sent.push(self.diagnostics.send(diagnostics(snapshot))?);
        }
        self.dropped += sent.iter().filter(|&&sent| !sent).count() as u64;
        Ok(())
    }

    /// Messages that were dropped because a reliable peer was too slow.
    pub fn dropped(&self) -> u64 {
        self.dropped + self.skins.iter().map(SkinTopics::dropped).sum::<u64>()
    }
}

/// Receives joint states.
pub(crate) struct JointStates {
    states: ros2_client::Subscription<JointState>,
    _host: Host,
}

impl JointStates {
    pub(crate) fn subscribe(topic: &str) -> Result<Self, PublishError> {
        let mut host = Host::join(&PublisherOptions::default())?;
        Ok(JointStates { states: host.receive(topic)?, _host: host })
    }

    /// The next message, with its time of measurement if it has one; `None` if there is none yet.
    pub(crate) fn take(&self) -> Result<Option<(Option<Timestamp>, JointState)>, String> {
        let message = self.states.take().map_err(|error| error.to_string())?;
        Ok(message.map(|(message, _)| {
            let Time { sec, nanosec } = message.header.stamp;
            let unix_ns = u64::try_from(sec).unwrap_or_default() * 1_000_000_000 + u64::from(nanosec);
            ((unix_ns > 0).then_some(Timestamp { unix_ns }), message)
        }))
    }
}

/// A name as ROS 2 allows it: letters, digits and single underscores between them, no digit first.
fn ros_name(name: &str) -> String {
    let words = name.split(|character: char| !character.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    let name = words.collect::<Vec<_>>().join("_");
    match name.chars().next() {
        Some(first) if first.is_ascii_alphabetic() => name,
        Some(_) => format!("n_{name}"),
        None => "n".into(),
    }
}

/// Refuses names that are the same one in ROS 2.
fn check_names<'a>(what: &str, names: impl Iterator<Item = &'a str>) -> Result<(), PublishError> {
    let mut known: Vec<String> = Vec::new();
    for given in names.map(ros_name) {
        if known.contains(&given) {
            let why = format!("two {what} of the robot have this name in ROS 2: rename one of them");
            return Err(PublishError::Namespace { given, why });
        }
        known.push(given);
    }
    Ok(())
}

/// The frame of a skin: its name, which must not be that of a link.
fn frame_id(robot: &Robot, skin: &str) -> String {
    let is_link = robot.kinematics().is_some_and(|kinematics| kinematics.link(skin).is_some());
    if is_link || robot.skins().iter().any(|worn| worn.link == skin) { format!("{skin}_skin") } else { skin.into() }
}

/// The frame of each skin in that of its link.
fn frames(robot: &Robot) -> TransformArray {
    let frame = |worn: &dermis_robot::WornSkin| {
        let [x, y, z, w] = worn.origin.quaternion();
        TransformStamped {
            header: Header { stamp: Time::default(), frame_id: worn.link.clone() },
            child_frame_id: frame_id(robot, &worn.name),
            transform: Transform { translation: worn.origin.translation_m.into(), rotation: Quaternion { x, y, z, w } },
        }
    };
    TransformArray { transforms: robot.skins().iter().map(frame).collect() }
}

/// The contacts whose poses are known, in the frame of the base. The field `skin` is the place of the skin in the robot's file.
fn contacts(robot: &Robot, snapshot: &Snapshot) -> PointCloud2 {
    let known: Vec<(TrackedContact, [u32; 1])> = snapshot
        .contacts
        .iter()
        .filter_map(|contact| Some((contact.in_base()?, [robot.skin(&contact.skin)? as u32])))
        .collect();
    let frame_id = snapshot.base.clone().unwrap_or_default();
    let header = Header { stamp: snapshot.at.into(), frame_id };
    topic::cloud(header, known.iter().map(|(contact, skin)| (contact, *skin)), ["skin"])
}

fn wrench_stamped(wrench: &dermis_robot::Wrench, at: Timestamp) -> WrenchStamped {
    let known = |vector: [f64; 3]| if wrench.complete { vector } else { [f64::NAN; 3] };
    WrenchStamped {
        header: Header { stamp: at.into(), frame_id: wrench.link.clone() },
        wrench: Wrench { force: known(wrench.force_n).into(), torque: known(wrench.torque_n_m).into() },
    }
}

fn zones(snapshot: &Snapshot) -> Text {
    let Snapshot { at, touched, complete, skins, rules, .. } = snapshot;
    json(&serde_json::json!({ "at": at, "touched": touched, "complete": complete, "skins": skins, "rules": rules }))
}

fn json(value: &impl serde::Serialize) -> Text {
    Text { data: serde_json::to_string(value).expect("it is JSON") }
}

/// A status for each skin: an error while it is unknown.
fn diagnostics(snapshot: &Snapshot) -> DiagnosticArray {
    const OK: u8 = 0;
    const ERROR: u8 = 2;
    let number = |number: Option<f64>| number.map_or_else(|| "unknown".into(), |number| format!("{number:.3}"));
    let status = |skin: &SkinSnapshot| {
        let (level, message) = match skin.zone {
            Zone::Clear => (OK, "clear"),
            Zone::Touched => (OK, "touched"),
            Zone::Unknown { reason } => (ERROR, reason.text()),
        };
        let value = |key: &str, value: String| KeyValue { key: key.into(), value };
        DiagnosticStatus {
            level,
            name: format!("dermis: {}", skin.skin),
            message: message.into(),
            hardware_id: skin.device_serial.map_or_else(|| "none".into(), |serial| serial.to_string()),
            values: vec![
                value("link", skin.link.clone()),
                value("age (s)", number(skin.age_s)),
                value("frames per second", number(skin.rate_hz)),
            ],
        }
    };
    let header = Header { stamp: snapshot.at.into(), frame_id: snapshot.base.clone().unwrap_or_default() };
    DiagnosticArray { header, status: snapshot.skins.iter().map(status).collect() }
}

#[cfg(test)]
mod tests {
    use super::ros_name;

    #[test]
    fn names_are_those_that_ros_allows() {
        for (name, expected) in
            [("left_arm", "left_arm"), ("left.arm-2", "left_arm_2"), ("a__b_", "a_b"), ("2nd", "n_2nd"), ("é", "n")]
        {
            assert_eq!(ros_name(name), expected);
        }
    }
}
