//! The transcript of a conversation: the messages of the device, with the fields that are its own set to zero.

use dermis::text::hexadecimal;
use dermis_wire::{Frame, Hello, Status, ToHost};

/// Messages in the order of the conversation, a line each.
#[derive(Debug, Default)]
pub(super) struct Transcript {
    text: String,
    /// Number of the first frame of the conversation.
    first: Option<u32>,
}

/// Room for a message: frames are the longest.
const ROOM: usize = dermis_wire::packet_bytes(dermis_wire::LONGEST_MESSAGE);

impl Transcript {
    /// Adds a message of a step. `configured` is whether slots and rate are what the host has set.
    pub(super) fn add(&mut self, step: &str, message: &ToHost<'_>, configured: bool) {
        let message = match *message {
            ToHost::Hello(hello) => ToHost::Hello(Hello {
                slot_count: if configured { hello.slot_count } else { 0 },
                rate_millihertz: if configured { hello.rate_millihertz } else { 0 },
                highest_rate_millihertz: 0,
                baud: 0,
                serial: 0,
                boot: 0,
                name: "",
                ..hello
            }),
            ToHost::Status(_) => ToHost::Status(Status::default()),
            ToHost::Fault(fault) => ToHost::Fault(dermis_wire::Fault { text: "", ..fault }),
            ToHost::Frame(frame) => {
                let first = *self.first.get_or_insert(frame.sequence);
                ToHost::Frame(Frame { sequence: frame.sequence.wrapping_sub(first), time_us: 0, ..frame })
            }
        };
        let mut packet = vec![0; ROOM];
        let length = message.encode(&mut packet).expect("the packet fits into the bytes that it takes at most");
        self.text += &format!("{step}: {}\n", hexadecimal(&packet[..length]));
    }

    /// The lines.
    pub(super) fn into_text(self) -> String {
        self.text
    }
}
