//! Clock, watchdog and serial number.

use dermis_firmware::System;
use embassy_rp::watchdog::Watchdog;
use embassy_time::{Duration, Instant};

/// Time without a poll of the device after which the chip resets.
const PATIENCE: Duration = Duration::from_millis(2000);

/// The serial number: `DERMIS_SERIAL` when the firmware is built, 0 without it.
pub const SERIAL: u32 = match option_env!("DERMIS_SERIAL") {
    None => 0,
    Some(text) => match u32::from_str_radix(text, 10) {
        Ok(serial) => serial,
        Err(_) => panic!("DERMIS_SERIAL must be a whole number below 2^32"),
    },
};

/// Clock and watchdog.
pub struct Supervisor {
    watchdog: Watchdog,
}

impl Supervisor {
    pub fn new(mut watchdog: Watchdog) -> Self {
        watchdog.pause_on_debug(true);
        watchdog.start(PATIENCE);
        Supervisor { watchdog }
    }
}

impl System for Supervisor {
    fn now_us(&mut self) -> u64 {
        Instant::now().as_micros()
    }

    fn feed_watchdog(&mut self) {
        self.watchdog.feed(PATIENCE);
    }
}
