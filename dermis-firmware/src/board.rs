//! The board as the device uses it, apart from its front end.

/// The connection to the host has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gone;

/// The connection to the host. No call waits.
pub trait Link {
    /// Whether a host is connected. A line that cannot detect this is always connected.
    fn connected(&mut self) -> bool;

    /// Copies bytes that have arrived and returns their number, 0 if there are none.
    ///
    /// # Errors
    /// The host has disconnected.
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, Gone>;

    /// Takes as many bytes as there is room for and returns their number.
    ///
    /// # Errors
    /// The host has disconnected.
    fn send(&mut self, bytes: &[u8]) -> Result<usize, Gone>;
}

/// Clock, watchdog and sensors of a board.
pub trait System {
    /// Time since power-up, us; it does not decrease.
    fn now_us(&mut self) -> u64;

    /// Restarts the time after which a hardware watchdog resets the board.
    fn feed_watchdog(&mut self) {}

    /// Temperature of the board, 0.01 degrees Celsius; `i16::MIN` if unknown.
    fn temperature_cc(&mut self) -> i16 {
        i16::MIN
    }

    /// Supply voltage, mV; 0 if unknown.
    fn supply_mv(&mut self) -> u16 {
        0
    }
}
