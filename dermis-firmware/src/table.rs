//! Scan tables: the one in use, and the one that arrives in parts.

use crate::instrument::Instrument;
use dermis_wire::{ScanPart, Slot};

/// A slot and its settling time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimedSlot {
    /// The slot.
    pub slot: Slot,
    /// Time from the closing of the switches to the start of the conversion, ns.
    pub wait_ns: u32,
}

impl TimedSlot {
    /// No slot; fills memory.
    pub const NONE: TimedSlot = TimedSlot { slot: Slot { source: 0, sink: 0, measure: None }, wait_ns: 0 };

    /// A slot from its electrodes and its settling time, ns. (Short, for generated tables.)
    pub const fn new(source: u16, sink: u16, measure: Option<[u16; 2]>, wait_ns: u32) -> Self {
        TimedSlot { slot: Slot { source, sink, measure }, wait_ns }
    }
}

/// The newest complete table, and the one that is arriving.
#[derive(Debug)]
pub(crate) struct Tables<'a> {
    complete: &'a mut [TimedSlot],
    length: usize,
    arriving: &'a mut [TimedSlot],
    /// The total of the arriving table, and its slots so far.
    progress: Option<(usize, usize)>,
}

/// Why a part was rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TableFault {
    Empty,
    TooMany { total: usize, most: usize },
    OutOfOrder { first: usize, next: usize },
    NoElectrode { slot: usize },
}

impl<'a> Tables<'a> {
    /// The instrument's own table, as far as it fits, in memory for the largest table, twice.
    pub fn new(memory: [&'a mut [TimedSlot]; 2], instrument: &Instrument<'_>) -> Self {
        let [complete, arriving] = memory;
        let own = instrument.settling.slots;
        // A part of a table would be another table.
        let length = if own.len() <= complete.len() { own.len() } else { 0 };
        complete[..length].copy_from_slice(&own[..length]);
        Tables { complete, length, arriving, progress: None }
    }

    /// The newest complete table.
    pub fn complete(&self) -> &[TimedSlot] {
        &self.complete[..self.length]
    }

    /// Takes a part; whether it completed the table.
    pub fn take(&mut self, part: &ScanPart<'_>, instrument: &Instrument<'_>) -> Result<bool, TableFault> {
        let (total, first) = (usize::from(part.total), usize::from(part.first));
        if total == 0 {
            return Err(TableFault::Empty);
        }
        let progress = self.progress.take();
        let (expected_total, next) = if first == 0 { (total, 0) } else { progress.unwrap_or((total, 0)) };
        let most = self.arriving.len().min(self.complete.len());
        if total > most {
            return Err(TableFault::TooMany { total, most });
        }
        if first != next || total != expected_total || first + part.slots.len() > total {
            return Err(TableFault::OutOfOrder { first, next });
        }
        for (slot, (place, index)) in part.slots.iter().zip(self.arriving[first..].iter_mut().zip(first..)) {
            if !instrument.has(slot) {
                return Err(TableFault::NoElectrode { slot: index });
            }
            *place = TimedSlot { slot, wait_ns: instrument.settling.wait_ns(slot, index) };
        }
        let end = first + part.slots.len();
        if end < total {
            self.progress = Some((total, end));
            return Ok(false);
        }
        core::mem::swap(&mut self.complete, &mut self.arriving);
        self.length = total;
        Ok(true)
    }
}
