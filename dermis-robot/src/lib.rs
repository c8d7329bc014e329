//! Several skins on the links of one robot: contacts in the robot's frame, wrenches, joint torques, rules.
//!
//! A [`Robot`] is a file: a robot description (URDF), skins with the link that wears each, and rules. A [`RobotState`] takes the
//! frames of the skins' pipelines and joint states, and says what is touched, what is clear and what is unknown. It has no
//! threads, no clock and no input or output but files.
//!
//! ```
//! use dermis::pipeline::Timestamp;
//! use dermis_robot::{Robot, RobotState};
//! use std::sync::Arc;
//!
//! # let folder = tempfile::tempdir()?;
//! # let file = folder.path().join("arm.toml");
//! # std::fs::write(folder.path().join("arm.urdf"), r#"<robot name="arm"><link name="base"/><link name="forearm"/>
//! # <joint name="elbow" type="revolute"><parent link="base"/><child link="forearm"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
//! # <limit velocity="3"/></joint></robot>"#)?;
//! # std::fs::write(&file, "name = 'arm'\ndescription = 'arm.urdf'\n[[skin]]\nname = 'sleeve'\ndesign = 'cylinder30'\n\
//! # link = 'forearm'\nsource = 'emulate'\n[[rule]]\nname = 'stop'\non = ['sleeve']\nwhen = 'touched'\n")?;
//! let robot = Arc::new(Robot::load(&file)?);
//! let mut state = RobotState::new(robot);
//! let now = Timestamp { unix_ns: 1_000_000_000 };
//! state.joints(now, &[("elbow", 0.5)])?;
//! // No frame has come: the rule stops the robot, because the skin is unknown.
//! let events = state.tick(now);
//! assert_eq!(events[0].rule, "stop");
//! assert_eq!(state.snapshot(now).touched, None);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(unreachable_pub)]

mod file;
mod joints;
mod kinematics;
mod pose;
mod seam;
mod sleeve;
mod snapshot;
mod state;
mod urdf;
mod wrench;

pub use file::{JointSource, OnUnknown, Robot, Rule, When, WornSkin};
pub use kinematics::{Kinematics, Posture};
pub use pose::{Pose, Rotation};
pub use seam::SEAM_M;
pub use sleeve::{Sleeve, SleeveOptions};
pub use snapshot::{
    Cause, ContactPart, EventKind, JointTorque, RobotContact, RuleEvent, SkinSnapshot, Snapshot, UnknownReason, Zone,
};
pub use state::{RobotState, SkinFrame};
pub use urdf::{Shape, link_triangles};
pub use wrench::Wrench;
