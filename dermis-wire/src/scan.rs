//! The scan table: the measurement of each slot of a frame.

use crate::bytes::Reader;
use crate::packet::{NoRoom, Packer};

/// One reading of a frame: the electrodes that are connected to the source, to ground and to the inputs of the
/// amplifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slot {
    /// Electrode connected to the source.
    pub source: u16,
    /// Electrode connected to ground.
    pub sink: u16,
    /// Electrodes connected to the inputs of the amplifier, plus and minus; `None` if both inputs are on the reference
    /// resistor. (65,535 encodes this case in a message, so no electrode has this number.)
    pub measure: Option<[u16; 2]>,
}

impl Slot {
    /// Bytes per slot in a message.
    pub const BYTES: usize = 8;
    /// Code of an input on the reference resistor.
    const REFERENCE: u16 = u16::MAX;

    /// Its bytes: source, sink, plus, minus.
    pub fn to_bytes(self) -> [u8; Self::BYTES] {
        let [plus, minus] = self.measure.unwrap_or([Self::REFERENCE; 2]);
        let mut bytes = [0; Self::BYTES];
        for (place, number) in bytes.chunks_exact_mut(2).zip([self.source, self.sink, plus, minus]) {
            place.copy_from_slice(&number.to_le_bytes());
        }
        bytes
    }

    /// Decodes a slot.
    pub fn from_bytes(bytes: [u8; Self::BYTES]) -> Self {
        let number = |at: usize| u16::from_le_bytes([bytes[2 * at], bytes[2 * at + 1]]);
        let (plus, minus) = (number(2), number(3));
        let measure = ([plus, minus] != [Self::REFERENCE; 2]).then_some([plus, minus]);
        Slot { source: number(0), sink: number(1), measure }
    }
}

/// Consecutive slots: given as values, or as the bytes of a message. Equal slots are equal in either form.
#[derive(Debug, Clone, Copy)]
pub enum Slots<'a> {
    /// Values.
    Given(&'a [Slot]),
    /// In the bytes of a message.
    Bytes(&'a [[u8; Slot::BYTES]]),
}

impl<'a> Slots<'a> {
    /// The number of slots.
    pub fn len(&self) -> usize {
        match self {
            Slots::Given(slots) => slots.len(),
            Slots::Bytes(bytes) => bytes.len(),
        }
    }

    /// Whether there are no slots.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The slots in order.
    pub fn iter(self) -> impl Iterator<Item = Slot> + 'a {
        let (given, bytes) = match self {
            Slots::Given(slots) => (slots, &[][..]),
            Slots::Bytes(bytes) => (&[][..], bytes),
        };
        given.iter().copied().chain(bytes.iter().map(|&bytes| Slot::from_bytes(bytes)))
    }
}

impl PartialEq for Slots<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}

impl Eq for Slots<'_> {}

/// A part of a scan table in a message. The parts start at slot 0 and follow each other without a gap; the part that
/// ends at `total` completes the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScanPart<'a> {
    /// Index of its first slot.
    pub first: u16,
    /// Number of slots of the whole table.
    pub total: u16,
    /// Its slots.
    pub slots: Slots<'a>,
}

impl<'a> ScanPart<'a> {
    /// Maximum number of slots per message, so that a small device needs little memory.
    pub const MAX: usize = 64;

    pub(crate) fn put(&self, packer: &mut Packer<'_>) -> Result<(), NoRoom> {
        if !self.fits() {
            return Err(NoRoom);
        }
        packer.put(&self.first.to_le_bytes())?;
        packer.put(&self.total.to_le_bytes())?;
        packer.put(&(self.slots.len() as u16).to_le_bytes())?;
        self.slots.iter().try_for_each(|slot| packer.put(&slot.to_bytes()))
    }

    pub(crate) fn read(reader: &mut Reader<'a>) -> Option<Self> {
        let (first, total, count) = (reader.u16()?, reader.u16()?, usize::from(reader.u16()?));
        let slots = Slots::Bytes(reader.take(count * Slot::BYTES)?.as_chunks().0);
        reader.end(ScanPart { first, total, slots }).filter(Self::fits)
    }

    /// Whether it has at most `MAX` slots and ends within its table.
    fn fits(&self) -> bool {
        let count = self.slots.len();
        count <= Self::MAX && usize::from(self.first) + count <= usize::from(self.total)
    }
}
