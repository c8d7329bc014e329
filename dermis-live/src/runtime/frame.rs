//! A processed frame with what the device sent and when, as every sink receives it.

use dermis::pipeline::{PipelineFrame, Timestamp};

/// A processed frame, with its message and the times on its way.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveFrame {
    /// The frame and its contacts.
    pub result: PipelineFrame,
    /// When its last byte was received.
    pub received_at: Timestamp,
    /// When its contacts were computed.
    pub output_at: Timestamp,
    /// The message of the device ([`dermis_wire::Frame`]): with the session's hello all that a replay needs.
    pub message: Vec<u8>,
}
