//! Frames as ROS 2 messages over DDS, without a ROS installation.

use crate::LiveError;
use crate::clock;
use crate::runtime::{Event, LiveFrame, LiveHandle, Popped};
use crate::sinks::ros2::{
    self as ros, DiagnosticArray, Due, Image, MarkerArray, PointCloud2, Reference, Text, Topic, WrenchStamped,
};
use dermis::pipeline::{Notice, Severity, Validity};
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::qos::{Durability, History, Liveliness, WhenFull};
use ros2_client::{Context, MessageTypeName, Name, Node, NodeName, NodeOptions, QosProfile, WriteError};
use std::net::Ipv4Addr;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use thiserror::Error;

/// The highest domain whose ports are below 65,536: RTPS 2.5, 9.6.2.3.
const HIGHEST_DOMAIN: u16 = 232;

/// Errors of publishing.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PublishError {
    /// A domain that does not exist.
    #[error("ROS domain `{given}`: give a whole number from 0 to {HIGHEST_DOMAIN}, by option or as ROS_DOMAIN_ID")]
    Domain {
        /// The given domain.
        given: String,
    },
    /// A namespace that is not valid in ROS 2.
    #[error(
        "ROS namespace `{given}`: {why}; write it like /left_arm: letters, digits and single underscores between slashes, no digit first"
    )]
    Namespace {
        /// The given namespace.
        given: String,
        /// What is wrong.
        why: String,
    },
    /// The middleware cannot start.
    #[error("ROS 2 (DDS, domain {domain}): {why}; is there a network interface, and are the domain's UDP ports free?")]
    Start {
        /// The domain.
        domain: u16,
        /// Its error.
        why: String,
    },
    /// The middleware has stopped working.
    #[error("ROS 2 (DDS), topic {topic}: {why}")]
    Write {
        /// The topic.
        topic: String,
        /// Its error.
        why: String,
    },
}

/// Where to publish.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PublisherOptions {
    /// The domain; `None` for `ROS_DOMAIN_ID`, or 0 if that is not set.
    pub domain: Option<u16>,
    /// Namespace of node and topics, such as `/left_arm`; empty for none.
    pub namespace: String,
    /// Name of the frame of positions; `None` for [that of the design](dermis::design::SkinDesign::frame_id).
    pub frame_id: Option<String>,
}

impl PublisherOptions {
    /// The selected domain.
    ///
    /// # Errors
    /// A value that is not a number up to 232.
    pub(crate) fn domain(&self) -> Result<u16, PublishError> {
        let given = match self.domain {
            Some(domain) => domain.to_string(),
            None => std::env::var("ROS_DOMAIN_ID").ok().filter(|text| !text.is_empty()).unwrap_or_else(|| "0".into()),
        };
        match given.trim().parse() {
            Ok(domain) if domain <= HIGHEST_DOMAIN => Ok(domain),
            _ => Err(PublishError::Domain { given }),
        }
    }
}

/// Whether `ROS_LOCALHOST_ONLY` restricts ROS 2 to this machine: only the value 1 does, as in ROS itself.
fn is_local_only(variable: Option<&str>) -> bool {
    variable == Some("1")
}

/// A node `dermis` in a domain.
pub(super) struct Host {
    domain: u16,
    namespace: String,
    // The node belongs to the context, and publishers to the node: both must live as long as the publishers.
    node: Node,
    _context: Context,
}

impl Host {
    /// Joins the domain.
    pub(super) fn join(options: &PublisherOptions) -> Result<Self, PublishError> {
        let domain = options.domain()?;
        let start = |why: String| PublishError::Start { domain, why };
        let namespace = if options.namespace.is_empty() { "/" } else { options.namespace.as_str() };
        let name = NodeName::new(namespace, "dermis")
            .map_err(|error| PublishError::Namespace { given: namespace.to_owned(), why: error.to_string() })?;
        let mut participant = DomainParticipantBuilder::new(domain);
        if is_local_only(std::env::var("ROS_LOCALHOST_ONLY").ok().as_deref()) {
            participant = participant.with_only_networks([Ipv4Addr::LOCALHOST]);
        }
        let participant = participant.build().map_err(|error| start(error.to_string()))?;
        let context = Context::from_domain_participant(participant).map_err(|error| start(error.to_string()))?;
        let quiet = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let node = context.new_node(name, quiet).map_err(|error| start(format!("{error:?}")))?;
        Ok(Host { domain, namespace: options.namespace.clone(), node, _context: context })
    }

    /// The namespace of its topics.
    pub(super) fn namespace(&self) -> &str {
        &self.namespace
    }

    /// A topic with a name and a quality of service.
    fn topic<M: ros::Message>(
        &mut self,
        name: &str,
        qos: &QosProfile,
    ) -> Result<ros2_client::dds::rustdds::Topic, PublishError> {
        let parsed = Name::parse(name)
            .map_err(|error| PublishError::Namespace { given: self.namespace.clone(), why: error.to_string() })?;
        let (package, message) = M::TYPE.split_once("/msg/").expect("every type names its package");
        let topic = self.node.create_topic(&parsed, MessageTypeName::new(package, message), qos);
        topic.map_err(|error| self.failed(&error))
    }

    /// A topic that is published.
    pub(super) fn out<M: ros::Message + 'static>(
        &mut self,
        name: String,
        qos: QosProfile,
    ) -> Result<Out<M>, PublishError> {
        let topic = self.topic::<M>(&name, &qos)?;
        let publisher = self.node.create_publisher(&topic, Some(qos)).map_err(|error| self.failed(&error))?;
        Ok(Out { name, publisher })
    }

    /// A topic that is received, at best effort.
    pub(super) fn receive<M: ros::Message + 'static>(
        &mut self,
        name: &str,
    ) -> Result<ros2_client::Subscription<M>, PublishError> {
        let qos = newest(5).reliability_best_effort();
        let topic = self.topic::<M>(name, &qos)?;
        self.node.create_subscription(&topic, Some(qos)).map_err(|error| self.failed(&error))
    }

    fn failed(&self, error: &ros2_client::CreateError) -> PublishError {
        PublishError::Start { domain: self.domain, why: error.to_string() }
    }
}

/// Publishes frames: a node `dermis` with a publisher for each topic.
///
/// Frames, images, contacts and the wrench use the QoS of sensor data: best effort, the last five kept. Markers and
/// diagnostics are reliable, as RViz and the diagnostic tools require. Contacts, wrench and validity have a deadline and a
/// lease of liveliness. Nothing blocks: a thread of the middleware
/// sends, and messages without room are dropped and counted.
pub struct Publisher {
    skin: SkinTopics,
    _host: Host,
}

impl Publisher {
    /// Joins the domain.
    ///
    /// # Errors
    /// An invalid domain or namespace; a machine without a network; ports that are in use.
    pub fn new(reference: Reference, options: &PublisherOptions) -> Result<Self, PublishError> {
        let mut host = Host::join(options)?;
        let names = |topic: Topic| topic.absolute(&options.namespace);
        Ok(Publisher { skin: SkinTopics::new(reference, &mut host, names)?, _host: host })
    }

    /// Publishes a frame; of a stale one neither image nor values.
    ///
    /// # Errors
    /// A middleware that has stopped working; dropped messages are counted instead.
    pub fn frame(&mut self, frame: &LiveFrame) -> Result<(), PublishError> {
        self.skin.frame(frame)
    }

    /// Messages that were dropped because a reliable peer was too slow.
    pub fn dropped(&self) -> u64 {
        self.skin.dropped
    }
}

/// The topics of a skin.
pub(super) struct SkinTopics {
    reference: Reference,
    due: Due,
    dropped: u64,
    frames: Out<Image>,
    images: Out<Image>,
    contacts: Out<PointCloud2>,
    wrenches: Out<WrenchStamped>,
    markers: Out<MarkerArray>,
    diagnostics: Out<DiagnosticArray>,
    validity: Out<Text>,
}

impl SkinTopics {
    /// Its topics on a node; `name` is the name of each.
    pub(super) fn new(
        reference: Reference,
        host: &mut Host,
        name: impl Fn(Topic) -> String,
    ) -> Result<Self, PublishError> {
        Ok(SkinTopics {
            due: Due::default(),
            dropped: 0,
            frames: host.out(name(Topic::Frame), quality(Topic::Frame))?,
            images: host.out(name(Topic::Image), quality(Topic::Image))?,
            contacts: host.out(name(Topic::Contacts), quality(Topic::Contacts))?,
            wrenches: host.out(name(Topic::Wrench), quality(Topic::Wrench))?,
            markers: host.out(name(Topic::Markers), quality(Topic::Markers))?,
            diagnostics: host.out(name(Topic::Diagnostics), quality(Topic::Diagnostics))?,
            validity: host.out(name(Topic::Validity), quality(Topic::Validity))?,
            reference,
        })
    }

    /// Publishes a frame; of a stale one neither image nor values.
    pub(super) fn frame(&mut self, frame: &LiveFrame) -> Result<(), PublishError> {
        let reference = &self.reference;
        let is_stale = matches!(frame.result.validity, Validity::Stale { .. });
        let mut sent = vec![
            self.validity.send(ros::validity(frame))?,
            self.contacts.send(ros::contacts(reference, frame))?,
            self.wrenches.send(ros::wrench(reference, frame))?,
        ];
        if !is_stale {
            sent.push(self.images.send(ros::image(reference, frame))?);
            sent.push(self.frames.send(ros::frame(reference, frame))?);
        }
        if self.due.markers(frame) {
            sent.push(self.markers.send(ros::markers(reference, frame))?);
        }
        // A stale frame keeps its time: its diagnostics are always due.
        if self.due.diagnostics(frame) || is_stale {
            sent.push(self.diagnostics.send(ros::diagnostics(reference, frame))?);
        }
        self.dropped += sent.iter().filter(|&&sent| !sent).count() as u64;
        Ok(())
    }

    /// Messages that were dropped.
    pub(super) fn dropped(&self) -> u64 {
        self.dropped
    }
}

/// A topic that is published.
pub(super) struct Out<M: ros::Message> {
    name: String,
    publisher: ros2_client::Publisher<M>,
}

impl<M: ros::Message + 'static> Out<M> {
    /// Sends a message; returns whether there was room for it.
    pub(super) fn send(&self, message: M) -> Result<bool, PublishError> {
        match self.publisher.publish(message) {
            Ok(()) => Ok(true),
            Err(WriteError::WouldBlock { .. }) => Ok(false),
            Err(error) => Err(PublishError::Write { topic: self.name.clone(), why: error.to_string() }),
        }
    }
}

/// Longest interval between two messages of the topics that are sent with every frame and, five times a second, while
/// frames are stale. At less than 20 frames per second the time until a frame is stale exceeds it.
const DEADLINE: Duration = Duration::from_millis(250);

/// Quality of service: sensor data (REP 2003), or reliable. Subscribers of contacts, wrench and validity can request a
/// deadline and a lease of liveliness, and learn from the middleware that this program, its machine or the network has
/// failed.
pub(super) fn quality(topic: Topic) -> QosProfile {
    match topic {
        Topic::Markers | Topic::Diagnostics | Topic::Events => newest(10).reliability_reliable(WhenFull::Fail),
        Topic::Contacts | Topic::Wrench | Topic::Validity => newest(5)
            .reliability_best_effort()
            .deadline(Some(DEADLINE))
            .liveliness(Liveliness::ManualByTopic)
            .liveliness_lease(Some(DEADLINE)),
        _ => newest(5).reliability_best_effort(),
    }
    .durability(Durability::Volatile)
}

/// The last messages are kept.
fn newest(depth: usize) -> QosProfile {
    QosProfile { history: History::KeepLast { depth }, ..QosProfile::publisher_default() }
}

/// The last message is kept for those that come later.
pub(super) fn latched() -> QosProfile {
    newest(1).reliability_reliable(WhenFull::Fail).durability(Durability::TransientLocal)
}

/// Events that can wait for the network.
const WAITING: usize = 64;
/// The name of this sink in reports of dropped events.
const ROS2: &str = "ROS 2";

/// Publishes over DDS until the skin is no longer read.
///
/// # Errors
/// A domain that cannot be joined.
pub fn publish(shared: &Arc<LiveHandle>, options: &PublisherOptions) -> Result<JoinHandle<()>, LiveError> {
    let skin = shared.skin();
    let frame_id = options.frame_id.clone().unwrap_or_else(|| skin.design().frame_id());
    let reference = Reference::of(skin, frame_id);
    let given = |error: PublishError| LiveError::Given(error.to_string());
    let mut publisher = Publisher::new(reference, options).map_err(given)?;
    let shared = Arc::clone(shared);
    let mailbox = shared.subscribe_as(ROS2, WAITING);
    let run = move || {
        let mut reported = 0;
        loop {
            match mailbox.take(Duration::from_secs(1)) {
                Popped::Item(Event::Frame(frame) | Event::Stale(frame)) => {
                    shared.add_dropped(ROS2, publisher.dropped() - reported);
                    reported = publisher.dropped();
                    if let Err(error) = publisher.frame(&frame) {
                        let text = format!("publishing has ended: {error}; contacts go on");
                        shared.publish(&Event::Notice(Notice { level: Severity::Error, text, at: clock::now() }));
                        shared.unsubscribe(&mailbox);
                        return;
                    }
                }
                Popped::Item(_) | Popped::TimedOut => {}
                Popped::Closed => return,
            }
        }
    };
    let thread = std::thread::Builder::new().name("dermis-ros2".into()).spawn(run);
    thread.map_err(|error| LiveError::Given(format!("no thread for publishing: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    #[test]
    fn domains_and_namespaces_that_there_are_not_are_named() {
        let given = |domain, namespace: &str| PublisherOptions { domain, namespace: namespace.into(), frame_id: None };
        let (reference, _) = synthetic::pressed();
        let error = Publisher::new(reference.clone(), &given(Some(233), "")).err().expect("refused");
        assert!(matches!(&error, PublishError::Domain { given } if given == "233"), "{error}");
        for namespace in ["arm", "/left arm", "/arm/", "/9", "/a__b"] {
            let error = Publisher::new(reference.clone(), &given(Some(77), namespace)).err().expect("refused");
            assert!(matches!(&error, PublishError::Namespace { .. }), "{namespace}: {error}");
        }
    }
}
