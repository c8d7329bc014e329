//! A device that runs the firmware on this computer, and its hosts.

use crate::EmulateError;
use crate::emulator::Script;
use crate::firmware::ReaderPlan;
use crate::firmware::front_end::TwinFrontEnd;
use dermis::design::SkinDesign;
use dermis::geom::Surface;
use dermis_firmware::{Device, Gone, Link, Memory, SlotScanner, System, TimedSlot};
use dermis_sim::twin::electronics::{SlotReader, Switching};
use dermis_sim::twin::{ContactHistory, Twin, TwinOptions};
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Options of a device that runs the firmware on this computer.
#[derive(Debug, Clone)]
pub struct FirmwareOptions {
    /// Options of the twin; its electronics need a converter of at most 16 bits.
    pub twin: TwinOptions,
    /// Seed of the twin, and serial number of the device.
    pub seed: u64,
    /// The touches.
    pub script: Script,
    /// Errors of the switches and the converter that depend on timing.
    pub switching: Switching,
    /// Seconds of device time per second of real time.
    pub speed: f64,
    /// Frames as fast as the twin computes and the host takes them: the device's time stands still meanwhile.
    pub unpaced: bool,
}

/// A device that runs the firmware.
#[derive(Debug)]
pub struct FirmwareDevice {
    options: FirmwareOptions,
    plan: ReaderPlan,
    volts_per_count: [f64; 3],
    twin: Twin,
    surface: Surface,
    stopped: AtomicBool,
}

/// Most bytes of Green's functions that the twin keeps.
const TABLE_BYTES: usize = 64 << 20;

/// Slots of the largest scan table.
const MAX_SLOTS: usize = 4096;

/// Time between two polls of the device, us.
const REST_US: u64 = 200;

impl FirmwareDevice {
    /// A device of a design.
    ///
    /// # Errors
    /// A twin that does not fit the design, or whose converter the firmware does not support; a speed that is not
    /// positive.
    pub fn new(design: &SkinDesign, options: FirmwareOptions) -> Result<Arc<Self>, EmulateError> {
        if !(options.speed > 0.0 && options.speed.is_finite()) {
            return Err(EmulateError::Given(format!("the speed is {}: it must be positive", options.speed)));
        }
        let mut twin = Twin::new(design, &options.twin, options.seed)?;
        twin.limit_table(TABLE_BYTES);
        let plan = ReaderPlan::new(design, &options.twin, options.switching)?;
        let volts_per_count = twin.electronics().volts_per_count().unwrap_or([f64::NAN; 3]);
        let (surface, stopped) = (design.body.surface(), AtomicBool::new(false));
        Ok(Arc::new(FirmwareDevice { options, plan, volts_per_count, twin, surface, stopped }))
    }

    /// Ends [`serve`](Self::serve).
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// The frame that begins at a time since power-up.
    pub(super) fn frame_at(&self, time_us: u64, history: &mut ContactHistory) -> Result<SlotReader<'_>, EmulateError> {
        let time_s = time_us as f64 * 1e-6;
        let index = (time_s * self.options.twin.electronics.frame_rate_hz).round() as u64;
        let presses = self.options.script.presses(time_s, &self.surface, self.options.twin.press.tip_radius_m);
        Ok(self.twin.slot_reader_after(&presses, history, index, self.options.switching)?)
    }

    /// The counts of a reading with one of the three gains.
    pub(super) fn counts(&self, value_v: f64, gain: usize) -> i16 {
        // A conversion to an integer saturates.
        (value_v / self.volts_per_count[gain]).round() as i16
    }

    /// Serves hosts one after another until it is [stopped](Self::stop).
    ///
    /// # Errors
    /// A port failure; a failure of the twin.
    pub fn serve(&self, listener: TcpListener) -> Result<(), EmulateError> {
        let broken = |error: std::io::Error| EmulateError::Given(format!("the port of the firmware's device: {error}"));
        listener.set_nonblocking(true).map_err(broken)?;
        let mut link = TcpLink { listener, stream: None, is_full: false, failure: None };
        let mut clock = Clock::new(&self.options);
        let mut tables = [vec![TimedSlot::NONE; MAX_SLOTS], vec![TimedSlot::NONE; MAX_SLOTS]];
        let (mut slots, mut readings) = (vec![TimedSlot::NONE; MAX_SLOTS], vec![0; MAX_SLOTS]);
        let (mut tested, mut outbox) = (vec![0; MAX_SLOTS], vec![0; Memory::outbox_bytes(MAX_SLOTS)]);
        let [complete, arriving] = &mut tables;
        let memory = Memory { tables: [complete, arriving], readings: &mut tested, outbox: &mut outbox };
        let name = format!("dermis firmware, twin `{}`, seed {}", self.options.twin.name, self.options.seed);
        let boot = std::process::id() ^ dermis_live::clock::now().unix_ns as u32;
        let mut device = Device::new(self.plan.instrument(&name, self.options.seed as u32, boot), memory);
        let mut scanner = SlotScanner::new(TwinFrontEnd::new(self), &mut slots, &mut readings);
        while !self.stopped.load(Ordering::Relaxed) {
            device.poll(&mut scanner, &mut link, &mut clock);
            if let Some(error) = scanner.front_end().failure.take() {
                return Err(error);
            }
            if let Some(error) = link.failure.take() {
                return Err(broken(error));
            }
            clock.pass(device.is_running(), link.is_full);
        }
        Ok(())
    }
}

/// The device's time.
enum Clock {
    /// Real time, faster or slower.
    Real { began: Instant, speed: f64 },
    /// Time that passes between polls alone, us.
    Polled(u64),
}

impl Clock {
    fn new(options: &FirmwareOptions) -> Self {
        match options.unpaced {
            true => Clock::Polled(0),
            false => Clock::Real { began: Instant::now(), speed: options.speed },
        }
    }

    /// Lets the time between two polls pass.
    fn pass(&mut self, is_running: bool, is_line_full: bool) {
        match self {
            Clock::Polled(now_us) if is_running && !is_line_full => *now_us += REST_US,
            _ => std::thread::sleep(Duration::from_micros(REST_US)),
        }
    }
}

impl System for Clock {
    fn now_us(&mut self) -> u64 {
        match self {
            Clock::Real { began, speed } => (began.elapsed().as_secs_f64() * 1e6 * *speed) as u64,
            Clock::Polled(now_us) => *now_us,
        }
    }
}

/// One host at a time over TCP.
struct TcpLink {
    listener: TcpListener,
    stream: Option<TcpStream>,
    /// Whether it took less than it was given.
    is_full: bool,
    failure: Option<std::io::Error>,
}

impl TcpLink {
    /// The result of an operation on the stream; a broken one is closed.
    fn result(&mut self, result: std::io::Result<usize>) -> Result<usize, Gone> {
        match result {
            Ok(count) => Ok(count),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(0),
            Err(_) => {
                (self.stream, self.is_full) = (None, false);
                Err(Gone)
            }
        }
    }
}

impl Link for TcpLink {
    fn connected(&mut self) -> bool {
        if self.stream.is_none() {
            match self.listener.accept() {
                Ok((stream, _)) => {
                    let ready = stream.set_nonblocking(true).and_then(|()| stream.set_nodelay(true));
                    self.stream = ready.is_ok().then_some(stream);
                }
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::ConnectionAborted) => {}
                Err(error) => self.failure = Some(error),
            }
        }
        self.stream.is_some()
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, Gone> {
        let Some(stream) = &mut self.stream else { return Err(Gone) };
        let result = match stream.read(buffer) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            result => result,
        };
        self.result(result)
    }

    fn send(&mut self, bytes: &[u8]) -> Result<usize, Gone> {
        let Some(stream) = &mut self.stream else { return Err(Gone) };
        let result = stream.write(bytes);
        let sent = self.result(result)?;
        self.is_full = sent < bytes.len();
        Ok(sent)
    }
}
