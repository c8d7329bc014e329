//! Frames as ROS 2 messages: the standard messages, their encoding, their definitions, and one message per topic.
//!
//! No ROS installation is needed. The encoding is XCDR1, little-endian, after a header of four bytes: the same on DDS
//! and in recordings.

#[cfg(feature = "ros2")]
pub mod dds;
mod diagnostics;
mod markers;
mod message;
#[cfg(feature = "ros2")]
pub mod robot;
mod schema;
mod topic;

pub use diagnostics::diagnostics;
pub use markers::markers;
pub use message::*;
pub use schema::definition;
pub(crate) use topic::{CONTACT_COLUMNS, ContactColumn};
pub use topic::{Due, Reference, Topic, contacts, frame, image, validity, wrench};

use byteorder::LittleEndian;
use serde::{Serialize, de::DeserializeOwned};
use thiserror::Error;

/// Bytes that are not a message of the requested type.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The four bytes of the header indicate an encoding other than plain CDR, little-endian.
    #[error("the message is not in plain little-endian CDR: it begins with {0:02x?} instead of [00, 01, 00, 00]")]
    Encapsulation(Vec<u8>),
    /// The rest is not such a message.
    #[error("the message is no {type_name}: {source}")]
    Body {
        /// The requested type.
        type_name: &'static str,
        /// What is wrong.
        source: cdr_encoding::Error,
    },
}

/// Plain CDR, little-endian, no options: RTPS 2.5, table 10.3.
const CDR_LE: [u8; 4] = [0, 1, 0, 0];

/// A message type of ROS 2.
pub trait Message: Serialize + DeserializeOwned {
    /// Its name, such as `sensor_msgs/msg/Image`.
    const TYPE: &'static str;
}

/// Encodes a message; replaces the contents of `out`.
pub(crate) fn encode_into<M: Message>(message: &M, out: &mut Vec<u8>) {
    out.clear();
    out.extend_from_slice(&CDR_LE);
    // A vector accepts all bytes, and CDR can represent these messages.
    cdr_encoding::to_writer::<M, LittleEndian, _>(&mut *out, message).expect("memory can be written");
}

/// Encodes a message.
pub fn encode<M: Message>(message: &M) -> Vec<u8> {
    let mut out = Vec::new();
    encode_into(message, &mut out);
    out
}

/// Decodes a message.
///
/// # Errors
/// Another encoding, truncated bytes, a text that is not UTF-8.
pub fn decode<M: Message>(bytes: &[u8]) -> Result<M, DecodeError> {
    let body = bytes
        .strip_prefix(&CDR_LE)
        .ok_or_else(|| DecodeError::Encapsulation(bytes[..bytes.len().min(CDR_LE.len())].to_vec()))?;
    let (message, _) = cdr_encoding::from_bytes::<M, LittleEndian>(body)
        .map_err(|source| DecodeError::Body { type_name: M::TYPE, source })?;
    Ok(message)
}

#[cfg(test)]
mod tests;
