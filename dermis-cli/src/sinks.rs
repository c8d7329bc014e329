//! Options for outputs of live skins and robots.

use clap::Args;

/// Where lines of JSON go.
#[derive(Debug, Clone)]
pub enum Lines {
    /// To standard output.
    Standard,
    /// To every program that connects to this address.
    Tcp(String),
}

/// Parses `-` or `tcp:HOST:PORT`.
pub fn lines(text: &str) -> Result<Lines, String> {
    match (text, text.split_once(':')) {
        ("-", _) => Ok(Lines::Standard),
        (_, Some(("tcp", address))) => Ok(Lines::Tcp(address.into())),
        _ => Err(format!("`{text}` is no place for lines of JSON: write --jsonl - or --jsonl tcp:127.0.0.1:PORT")),
    }
}

/// Publishing over DDS.
#[derive(Debug, Args)]
pub struct Ros2Arguments {
    /// Publish over DDS as a ROS 2 node, in the domain ROS_DOMAIN_ID. Needs a program built with `--features
    /// ros2`.
    #[arg(long)]
    pub ros2: bool,
    /// Namespace of the ROS 2 topics, as in /left_arm.
    #[arg(long, value_name = "NAME", default_value = "", hide_default_value = true, requires = "ros2")]
    pub namespace: String,
}

/// What publishes a robot; nothing without ROS 2.
#[cfg(feature = "ros2")]
pub type RobotPublisher = dermis_live::sinks::ros2::robot::RobotPublisher;

/// What publishes a robot: nothing without ROS 2.
#[cfg(not(feature = "ros2"))]
#[derive(Debug)]
pub enum RobotPublisher {}

#[cfg(feature = "ros2")]
impl Ros2Arguments {
    /// Where to publish.
    pub fn options(&self, frame_id: Option<String>) -> dermis_live::sinks::ros2::dds::PublisherOptions {
        dermis_live::sinks::ros2::dds::PublisherOptions { domain: None, namespace: self.namespace.clone(), frame_id }
    }
}

/// The error of a program without ROS 2.
#[cfg(not(feature = "ros2"))]
pub fn without_ros2() -> crate::failure::Failure {
    let fix = "install it with ROS 2: cargo install --locked --path dermis-cli --features ros2";
    crate::failure::Failure::given("--ros2: this program was built without ROS 2", Some(fix))
}
