//! Packets that wait for the link to take them.

use crate::board::{Gone, Link};
use dermis_wire::NoRoom;

/// Packets on their way, oldest first.
#[derive(Debug)]
pub(crate) struct Outbox<'a> {
    bytes: &'a mut [u8],
    /// The bytes that are to be sent.
    waiting: core::ops::Range<usize>,
}

impl<'a> Outbox<'a> {
    pub fn new(bytes: &'a mut [u8]) -> Self {
        Outbox { bytes, waiting: 0..0 }
    }

    /// Discards what has not been sent.
    pub fn clear(&mut self) {
        self.waiting = 0..0;
    }

    /// Bytes that can be added.
    pub fn room(&self) -> usize {
        self.bytes.len() - self.waiting.len()
    }

    /// Adds the packet that `encode` writes.
    ///
    /// # Errors
    /// More bytes than there is room for; nothing is added.
    pub fn put(&mut self, encode: impl FnOnce(&mut [u8]) -> Result<usize, NoRoom>) -> Result<(), NoRoom> {
        self.bytes.copy_within(self.waiting.clone(), 0);
        self.waiting = 0..self.waiting.len();
        self.waiting.end += encode(&mut self.bytes[self.waiting.end..])?;
        Ok(())
    }

    /// Passes to the link what it takes.
    pub fn send(&mut self, link: &mut impl Link) -> Result<(), Gone> {
        while !self.waiting.is_empty() {
            let waiting = &self.bytes[self.waiting.clone()];
            let sent = link.send(waiting)?.min(waiting.len());
            if sent == 0 {
                break;
            }
            self.waiting.start += sent;
        }
        Ok(())
    }
}
