//! A processed frame with what the device sent and when, as every sink receives it.

use crate::clock;
use dermis::pipeline::{PipelineFrame, Timestamp, Validity};

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

impl LiveFrame {
    /// The same frame some time after it: stale, without contacts and image.
    pub(super) fn stale(&self, age_s: f64) -> Self {
        let mut stale = LiveFrame { output_at: clock::now(), message: Vec::new(), ..self.clone() };
        let PipelineFrame { validity, touched, contacts, image, .. } = &mut stale.result;
        (*validity, *touched) = (Validity::Stale { age_s }, None);
        contacts.clear();
        image.fill(0.0);
        stale
    }
}
