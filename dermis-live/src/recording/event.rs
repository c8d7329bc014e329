//! Events of a recording other than frames.

use dermis::pipeline::Notice;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// An event other than a frame. In JSON: `{"kind": "command", "value": ...}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", content = "value", rename_all = "snake_case")]
pub enum Event {
    /// The hello of a device after a reconnection.
    Hello(#[serde(with = "hex")] Vec<u8>),
    /// A command to the pipeline: a tare, another threshold.
    Command(Value),
    /// A notice for the user.
    Notice(Notice),
}

pub(super) fn from_hex(text: &str) -> Option<Vec<u8>> {
    let (pairs, rest) = text.as_bytes().as_chunks::<2>();
    let digit = |byte: u8| char::from(byte).to_digit(16);
    let byte = |&[high, low]: &[u8; 2]| Some((digit(high)? * 16 + digit(low)?) as u8);
    if rest.is_empty() { pairs.iter().map(byte).collect() } else { None }
}

mod hex {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub(super) fn serialize<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&dermis::text::hexadecimal(bytes))
    }

    pub(super) fn deserialize<'a, D: Deserializer<'a>>(deserializer: D) -> Result<Vec<u8>, D::Error> {
        let text = String::deserialize(deserializer)?;
        super::from_hex(&text).ok_or_else(|| D::Error::custom("no pairs of hexadecimal digits"))
    }
}
