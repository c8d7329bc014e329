//! Serial line and clock of the board: CMSDK UART 0 and timer 0 (Arm DDI 0479, sections 4.3 and 3.5; addresses in AN386).

use dermis_firmware::{Gone, Link, System};

/// A 32-bit register.
#[derive(Clone, Copy)]
pub struct Register(usize);

impl Register {
    /// Register of a peripheral of this board, or a word of its memory.
    pub const fn at(address: usize) -> Self {
        Register(address)
    }

    pub fn read(self) -> u32 {
        // SAFETY: every address in this program is that of an aligned word of the board, which is always mapped.
        unsafe { (self.0 as *const u32).read_volatile() }
    }

    pub fn write(self, value: u32) {
        // SAFETY: as above; no memory of the program is at these addresses.
        unsafe { (self.0 as *mut u32).write_volatile(value) }
    }
}

const UART_DATA: Register = Register::at(0x4000_4000);
const UART_STATE: Register = Register::at(0x4000_4004);
const UART_CONTROL: Register = Register::at(0x4000_4008);
const UART_DIVIDER: Register = Register::at(0x4000_4010);
const TRANSMITTER_FULL: u32 = 1;
const RECEIVER_FULL: u32 = 2;

/// The serial line. It cannot detect a host.
pub struct Uart;

impl Uart {
    pub fn open() -> Self {
        // The smallest divider; QEMU does not time the line.
        UART_DIVIDER.write(16);
        UART_CONTROL.write(0b11);
        Uart
    }
}

impl Link for Uart {
    fn connected(&mut self) -> bool {
        true
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, Gone> {
        let mut count = 0;
        for place in buffer {
            if UART_STATE.read() & RECEIVER_FULL == 0 {
                break;
            }
            *place = UART_DATA.read() as u8;
            count += 1;
        }
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> Result<usize, Gone> {
        let mut count = 0;
        for byte in bytes {
            if UART_STATE.read() & TRANSMITTER_FULL != 0 {
                break;
            }
            UART_DATA.write(u32::from(*byte));
            count += 1;
        }
        Ok(count)
    }
}

const TIMER_CONTROL: Register = Register::at(0x4000_0000);
const TIMER_VALUE: Register = Register::at(0x4000_0004);
const TIMER_RELOAD: Register = Register::at(0x4000_0008);
/// Ticks of the timer per microsecond: the system clock has 25 MHz.
const TICKS_PER_US: u64 = 25;

/// The clock. It must be read once in 171 s, after which the timer wraps around. It stands still while the serial line is
/// full: QEMU does not time the line, so this happens only while the host's computer is busy, and no frame is lost then.
pub struct Timer {
    last: u32,
    ticks: u64,
}

impl Timer {
    pub fn start() -> Self {
        TIMER_RELOAD.write(u32::MAX);
        TIMER_VALUE.write(u32::MAX);
        TIMER_CONTROL.write(1);
        Timer { last: u32::MAX, ticks: 0 }
    }
}

impl System for Timer {
    fn now_us(&mut self) -> u64 {
        let now = TIMER_VALUE.read();
        if UART_STATE.read() & TRANSMITTER_FULL == 0 {
            // It counts down.
            self.ticks += u64::from(self.last.wrapping_sub(now));
        }
        self.last = now;
        self.ticks / TICKS_PER_US
    }
}
