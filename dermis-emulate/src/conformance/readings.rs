//! Files of readings, which emulated boards replay.

use dermis_live::LiveError;
use dermis_wire::Slot;

/// The first bytes of a file.
const MAGIC: &[u8; 4] = b"DRD1";

/// The bytes of a file of readings, little-endian: `DRD1`, u16 slots, u16 frames; for each slot u16 source, sink, plus
/// and minus (0xFFFF twice for the reference resistor); for each frame an i16 per slot.
///
/// # Errors
/// More than 65,535 slots or frames; readings of more than 16 bits.
pub fn write_readings(slots: &[Slot], frames: &[Vec<i32>]) -> Result<Vec<u8>, LiveError> {
    let (Ok(slot_count), Ok(frame_count)) = (u16::try_from(slots.len()), u16::try_from(frames.len())) else {
        return Err(LiveError::Given("a file of readings has at most 65,535 slots and 65,535 frames".into()));
    };
    let mut bytes = MAGIC.to_vec();
    bytes.extend(slot_count.to_le_bytes());
    bytes.extend(frame_count.to_le_bytes());
    slots.iter().for_each(|slot| bytes.extend(slot.to_bytes()));
    for &reading in frames.iter().flatten() {
        let Ok(narrow) = i16::try_from(reading) else {
            return Err(LiveError::Given(format!("a reading is {reading}: a file of readings holds 16 bits")));
        };
        bytes.extend(narrow.to_le_bytes());
    }
    Ok(bytes)
}
