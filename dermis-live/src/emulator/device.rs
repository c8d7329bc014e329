//! The emulated device: frames of a twin at their time, and the conversation about them.

use crate::LiveError;
use crate::emulator::fault::{Fault, TimedFault};
use crate::emulator::script::Script;
use crate::scan::{Role, ScanTable};
use dermis::design::SkinDesign;
use dermis::geom::{Point3, Surface};
use dermis::touch::{sample_rng, standard_normal};
use dermis::twin::{Press, Twin, TwinOptions};
use dermis_wire::{
    Decoder, Fault as WireFault, FaultCode, Frame, FrameFlags, Hello, Readings, Received, ScanPart, Slot, Status,
    ToDevice, ToHost, VERSION, test_reading,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What is emulated.
#[derive(Debug, Clone)]
pub struct EmulatorOptions {
    /// The twin.
    pub twin: TwinOptions,
    /// Its seed, which is the device's number too.
    pub seed: u64,
    /// What touches it.
    pub script: Script,
    /// What goes wrong.
    pub faults: Vec<TimedFault>,
    /// Seconds of the device that pass in one of ours.
    pub speed: f64,
    /// So many frames are made beforehand and sent over and over; none are where it is 0. Touches that come later and faults of
    /// the skin are then not seen.
    pub prerendered: usize,
    /// Frames are sent as fast as the line takes them.
    pub unpaced: bool,
}

/// An emulated device.
pub struct Emulator {
    design: SkinDesign,
    options: EmulatorOptions,
    scan: ScanTable,
    surface: Surface,
    tip_radius_m: f64,
    /// Volts a count, and the highest count.
    volts_per_count: [f64; 3],
    full_scale: i32,
    reading_bytes: u8,
    boot: u32,
    twin: Mutex<Twin>,
    fingers: Mutex<BTreeMap<u32, Press>>,
    frames: Vec<Vec<i32>>,
    /// The number of the next frame, from power-up on; a connection goes on where the last one ended.
    next: Mutex<u64>,
    /// Faults of the skin that have happened.
    happened: Mutex<usize>,
    stopped: AtomicBool,
}

impl std::fmt::Debug for Emulator {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Emulator").field("design", &self.design.name).finish_non_exhaustive()
    }
}

/// Where the emulated device can be reached.
pub enum Port {
    /// Over TCP; one host at a time.
    Tcp(TcpListener),
    /// As a serial port.
    Serial(serial2::SerialPort),
    /// As a pseudo terminal; its other end is held open, so that it outlives its hosts.
    #[cfg(unix)]
    Terminal {
        /// The device's end.
        device: std::fs::File,
        /// The hosts' end.
        _host: std::fs::File,
    },
}

/// Bits of a converter where the twin has none.
const IDEAL_BITS: u32 = 32;
/// Its range, V.
const IDEAL_RANGE_V: f64 = 10.0;
/// A frame that is later than this is not sent.
const MOST_LATE: Duration = Duration::from_millis(250);
/// How often a status is sent, s of ours.
const STATUS_S: f64 = 1.0;

impl Emulator {
    /// Powers a device up.
    ///
    /// # Errors
    /// A twin that does not fit the design, a fault of an electrode that there is not.
    pub fn new(design: &SkinDesign, options: EmulatorOptions) -> Result<Arc<Self>, LiveError> {
        let twin = Twin::new(design, &options.twin, options.seed)?;
        if !(options.speed > 0.0 && options.speed.is_finite()) {
            return Err(LiveError::Given(format!("the speed is {}: it must be positive", options.speed)));
        }
        for TimedFault { fault, .. } in &options.faults {
            if let Fault::Loose { electrode, .. } = fault {
                let count = design.electrodes.len();
                if *electrode >= count {
                    let message =
                        format!("electrode {electrode} cannot come loose: the skin has electrodes 0 to {}", count - 1);
                    return Err(LiveError::Given(message));
                }
            }
        }
        let bits = options.twin.electronics.adc.map_or(IDEAL_BITS, |adc| adc.bits);
        let ideal = [IDEAL_RANGE_V / 2f64.powi(IDEAL_BITS as i32 - 1); 3];
        let mut emulator = Emulator {
            scan: ScanTable::new(&design.protocol)?,
            surface: design.body.surface(),
            tip_radius_m: options.twin.press.tip_radius_m,
            volts_per_count: twin.electronics().volts_per_count().unwrap_or(ideal),
            full_scale: ((1i64 << (bits.clamp(2, 32) - 1)) - 1) as i32,
            reading_bytes: if bits <= 16 { 2 } else { 4 },
            boot: std::process::id() ^ crate::Moment::now().unix_ns as u32,
            twin: Mutex::new(twin),
            fingers: Mutex::default(),
            frames: Vec::new(),
            next: Mutex::new(0),
            happened: Mutex::new(0),
            stopped: AtomicBool::new(false),
            design: design.clone(),
            options,
        };
        for index in 0..emulator.options.prerendered as u64 {
            emulator.frames.push(emulator.take(index)?);
        }
        Ok(Arc::new(emulator))
    }

    /// What is emulated.
    pub fn options(&self) -> &EmulatorOptions {
        &self.options
    }

    /// A finger presses, or presses elsewhere.
    ///
    /// # Errors
    /// A place off the skin, a force that is not positive.
    pub fn press(&self, finger: u32, centre_m: Point3, force_n: f64) -> Result<(), LiveError> {
        let press = Press { centre_m, force_n, tip_radius_m: self.tip_radius_m };
        lock(&self.twin).network(&[press])?;
        lock(&self.fingers).insert(finger, press);
        Ok(())
    }

    /// A finger is lifted.
    pub fn release(&self, finger: u32) {
        lock(&self.fingers).remove(&finger);
    }

    /// What presses at a time of the device, s.
    pub fn presses(&self, time_s: f64) -> Vec<Press> {
        let mut presses = self.options.script.presses(time_s, &self.surface, self.tip_radius_m);
        presses.extend(lock(&self.fingers).values());
        presses
    }

    /// Ends [`serve`](Self::serve).
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// Frames a second at most, in thousandths.
    fn highest_rate_mhz(&self) -> u32 {
        let slots = self.scan.slots().len() as f64;
        let most_hz = match self.frames.is_empty() && !self.options.unpaced {
            true => self.options.twin.electronics.slot_rate_hz / slots,
            // Frames that are made beforehand are sent as fast as is asked.
            false => 1e6,
        };
        (most_hz * 1e3 * (1.0 + 1e-9)) as u32
    }

    /// Counts of frame `index`, in the order of the scan table.
    fn take(&self, index: u64) -> Result<Vec<i32>, LiveError> {
        let time_s = index as f64 / self.options.twin.electronics.frame_rate_hz;
        let presses = self.presses(time_s);
        let readings = lock(&self.twin).readings(&presses, index)?;
        let channels = self.design.protocol.channels();
        let count = |value_v: f64, volts_per_count: f64| {
            (value_v / volts_per_count).round().clamp(-f64::from(self.full_scale) - 1.0, f64::from(self.full_scale))
                as i32
        };
        let [free, driven, reference] = self.volts_per_count;
        let counts = self.scan.roles().iter().map(|role| match *role {
            Role::Current(drive) => count(readings.references_v[drive], reference),
            Role::Channel(channel) => {
                let volts = if channels[channel].touches_driven() { driven } else { free };
                count(readings.values_v[channel], volts)
            }
        });
        Ok(counts.collect())
    }

    /// The packet of its hello while it sends so many thousandths of a frame a second.
    pub fn hello_packet(&self, rate_mhz: u32) -> Vec<u8> {
        let electronics = &self.options.twin.electronics;
        let (twin, seed) = (&self.options.twin.name, self.options.seed);
        let name = format!("dermis {} emulating `{twin}`, seed {seed}", env!("CARGO_PKG_VERSION"));
        let hello = Hello {
            version: VERSION,
            reading_bytes: self.reading_bytes,
            design_sha256: self.design.sha256(),
            electrode_count: self.design.electrodes.len() as u16,
            slot_count: self.scan.slots().len() as u16,
            reference_ohm: electronics.reference_ohm as f32,
            source_v: electronics.source_v as f32,
            volts_per_count: self.volts_per_count.map(|volts| volts as f32),
            full_scale: self.full_scale as u32,
            rate_mhz,
            highest_rate_mhz: self.highest_rate_mhz(),
            baud: 0,
            serial: seed as u32,
            boot: self.boot,
            name: &name,
        };
        packet(&ToHost::Hello(hello), Hello::PACKET_BYTES)
    }

    /// The packet of frame `index`, at the rate of the twin's instrument: what a host would receive, without a line between.
    ///
    /// # Errors
    /// A twin that fails.
    pub fn frame_packet(&self, index: u64) -> Result<Vec<u8>, LiveError> {
        let rate_hz = self.options.twin.electronics.frame_rate_hz;
        self.fail(index as f64 / rate_hz)?;
        let counts = self.take(index)?;
        let (sequence, time_us) = (index as u32, (index as f64 / rate_hz * 1e6) as u64);
        let narrow: Vec<i16> = counts.iter().map(|&count| count as i16).collect();
        let readings = if self.reading_bytes == 2 { Readings::I16(&narrow) } else { Readings::I32(&counts) };
        let frame = Frame { sequence, time_us, flags: FrameFlags::default(), readings };
        Ok(packet(&ToHost::Frame(frame), Frame::packet_bytes(counts.len(), 4)))
    }

    /// Lets the faults of the skin happen that are due.
    fn fail(&self, time_s: f64) -> Result<(), LiveError> {
        let mut happened = lock(&self.happened);
        let mut due: Vec<&TimedFault> = self.options.faults.iter().collect();
        due.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        while let Some(fault) = due.get(*happened).filter(|fault| fault.at_s <= time_s) {
            if let Fault::Loose { electrode, ohm } = fault.fault {
                lock(&self.twin).loosen(electrode, ohm)?;
            }
            *happened += 1;
        }
        Ok(())
    }

    /// How much a fault that lasts is felt now; 0 where none is.
    fn felt(&self, time_s: f64, of: impl Fn(&Fault) -> Option<(f64, f64)>) -> f64 {
        let felt = |timed: &TimedFault| {
            of(&timed.fault)
                .filter(|(_, for_s)| (timed.at_s..timed.at_s + for_s).contains(&time_s))
                .map(|(value, _)| value)
        };
        self.options.faults.iter().filter_map(felt).fold(0.0, f64::max)
    }

    fn is_unplugged(&self, time_s: f64) -> bool {
        self.felt(time_s, |fault| match fault {
            Fault::Unplug { for_s } => Some((1.0, *for_s)),
            _ => None,
        }) > 0.0
    }

    /// Serves hosts one after another until it is [stopped](Self::stop).
    ///
    /// # Errors
    /// A port that breaks; a twin that fails, which is our fault.
    pub fn serve(&self, port: Port) -> Result<(), LiveError> {
        let broken = |error: std::io::Error| LiveError::Given(format!("the emulated device's port: {error}"));
        match port {
            Port::Serial(mut serial) => {
                serial.set_read_timeout(Duration::from_millis(1)).map_err(broken)?;
                while !self.stopped.load(Ordering::Relaxed) {
                    self.converse(&mut serial)?;
                    std::thread::sleep(Duration::from_millis(20));
                }
                Ok(())
            }
            #[cfg(unix)]
            Port::Terminal { mut device, _host } => {
                while !self.stopped.load(Ordering::Relaxed) {
                    self.converse(&mut device)?;
                    std::thread::sleep(Duration::from_millis(20));
                }
                Ok(())
            }
            Port::Tcp(listener) => {
                listener.set_nonblocking(true).map_err(broken)?;
                while !self.stopped.load(Ordering::Relaxed) {
                    match listener.accept() {
                        Ok((mut stream, _)) => {
                            let ready = stream
                                .set_nonblocking(false)
                                .and_then(|()| stream.set_nodelay(true))
                                .and_then(|()| stream.set_read_timeout(Some(Duration::from_micros(200))))
                                .and_then(|()| stream.set_write_timeout(Some(Duration::from_secs(5))));
                            if ready.is_ok() && !self.is_unplugged(self.now_s()) {
                                self.converse(&mut stream)?;
                            }
                        }
                        Err(error) if error.kind() == ErrorKind::WouldBlock => {
                            self.wait_unplugged();
                            std::thread::sleep(Duration::from_millis(5));
                        }
                        Err(error) => return Err(broken(error)),
                    }
                }
                Ok(())
            }
        }
    }

    fn now_s(&self) -> f64 {
        *lock(&self.next) as f64 / self.options.twin.electronics.frame_rate_hz
    }

    /// While it is unplugged its time goes on.
    fn wait_unplugged(&self) {
        if self.is_unplugged(self.now_s()) {
            let frame_s = 1.0 / (self.options.twin.electronics.frame_rate_hz * self.options.speed);
            std::thread::sleep(Duration::from_secs_f64(frame_s));
            *lock(&self.next) += 1;
        }
    }

    /// Talks with one host until it goes.
    fn converse(&self, line: &mut dyn Wire) -> Result<(), LiveError> {
        let mut talk = Talk::new(self, line);
        match talk.run() {
            Ok(()) | Err(TalkEnd::Gone) => Ok(()),
            Err(TalkEnd::Failed(error)) => Err(*error),
        }
    }
}

/// The packet of a message that fits into so many bytes.
fn packet(message: &ToHost<'_>, most: usize) -> Vec<u8> {
    let mut packet = vec![0; most];
    let length = message.encode(&mut packet).expect("the packet fits into the bytes that it takes at most");
    packet.truncate(length);
    packet
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Whatever another thread left half done is overwritten by the next frame.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A line as the device sees it: reading does not wait.
trait Wire {
    fn heard(&mut self, buffer: &mut [u8]) -> std::io::Result<usize>;
    fn say(&mut self, bytes: &[u8]) -> std::io::Result<()>;
}

fn nothing_yet(error: std::io::Error) -> std::io::Result<usize> {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => Ok(0),
        _ => Err(error),
    }
}

impl Wire for TcpStream {
    fn heard(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        match self.read(buffer) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => Ok(count),
            Err(error) => nothing_yet(error),
        }
    }

    fn say(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.write_all(bytes)
    }
}

#[cfg(unix)]
impl Wire for std::fs::File {
    fn heard(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        use rustix::event::{PollFd, PollFlags, poll};
        let now = rustix::event::Timespec { tv_sec: 0, tv_nsec: 0 };
        let ready = poll(&mut [PollFd::new(&*self, PollFlags::IN)], Some(&now))?;
        if ready == 0 { Ok(0) } else { self.read(buffer).or_else(nothing_yet) }
    }

    fn say(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.write_all(bytes)
    }
}

impl Wire for serial2::SerialPort {
    fn heard(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        serial2::SerialPort::read(self, buffer).or_else(nothing_yet)
    }

    fn say(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        serial2::SerialPort::write_all(self, bytes)
    }
}

/// Why a conversation ended.
enum TalkEnd {
    /// The host is gone.
    Gone,
    /// The device failed.
    Failed(Box<LiveError>),
}

impl From<std::io::Error> for TalkEnd {
    fn from(_: std::io::Error) -> Self {
        TalkEnd::Gone
    }
}

impl From<LiveError> for TalkEnd {
    fn from(error: LiveError) -> Self {
        TalkEnd::Failed(Box::new(error))
    }
}

/// A conversation with one host.
struct Talk<'a> {
    emulator: &'a Emulator,
    line: &'a mut dyn Wire,
    decoder: Decoder<[u8; ToDevice::PACKET_BYTES]>,
    slots: Vec<Slot>,
    rate_mhz: u32,
    running: bool,
    /// Our time of the first frame after the start, and its number.
    began: (Instant, u64),
    dropped: u32,
    damaged: u32,
    status_at: Instant,
    packet: Vec<u8>,
    rng: ChaCha8Rng,
}

/// The random stream of what happens to bytes.
const BYTES_STREAM: u64 = u64::MAX - 17;

impl<'a> Talk<'a> {
    fn new(emulator: &'a Emulator, line: &'a mut dyn Wire) -> Self {
        let slot_count = emulator.scan.slots().len();
        Talk {
            decoder: Decoder::new([0; ToDevice::PACKET_BYTES]),
            slots: emulator.scan.slots().to_vec(),
            rate_mhz: (emulator.options.twin.electronics.frame_rate_hz * 1e3).round() as u32,
            running: false,
            began: (Instant::now(), 0),
            dropped: 0,
            damaged: 0,
            status_at: Instant::now(),
            packet: vec![0; Frame::packet_bytes(slot_count, 4).max(Hello::PACKET_BYTES).max(WireFault::PACKET_BYTES)],
            rng: sample_rng(emulator.options.seed, BYTES_STREAM),
            emulator,
            line,
        }
    }

    fn run(&mut self) -> Result<(), TalkEnd> {
        self.greet()?;
        let mut buffer = [0; 4096];
        while !self.emulator.stopped.load(Ordering::Relaxed) {
            let count = if self.running { self.peek(&mut buffer)? } else { self.line.heard(&mut buffer)? };
            if count > 0 {
                self.answer(&buffer[..count])?;
            }
            if self.running {
                self.send_due()?;
            } else {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        Ok(())
    }

    /// Commands while frames are sent are looked for a hundred times a second only: reading costs a wait.
    fn peek(&mut self, buffer: &mut [u8]) -> Result<usize, TalkEnd> {
        let every = (f64::from(self.rate_mhz) * 1e-5).ceil() as u64;
        let next = *lock(&self.emulator.next);
        if next.is_multiple_of(every.max(1)) { Ok(self.line.heard(buffer)?) } else { Ok(0) }
    }

    fn greet(&mut self) -> Result<(), TalkEnd> {
        let packet = self.emulator.hello_packet(self.rate_mhz);
        Ok(self.line.say(&packet)?)
    }

    fn say(&mut self, message: &ToHost<'_>) -> Result<(), TalkEnd> {
        let length = message.encode(&mut self.packet).map_err(|error| std::io::Error::other(error.to_string()))?;
        Ok(self.line.say(&self.packet[..length])?)
    }

    fn answer(&mut self, bytes: &[u8]) -> Result<(), TalkEnd> {
        let mut messages: Vec<Option<Vec<u8>>> = Vec::new();
        self.decoder.feed(bytes, |received| {
            messages.push(match received {
                Received::Message(message) => Some(message.to_vec()),
                Received::Damaged => None,
            });
        });
        for message in messages {
            match message.as_deref().map(ToDevice::parse) {
                None => self.damaged += 1,
                Some(Err(_)) => self.refuse(FaultCode::UnknownMessage, "this message is unknown")?,
                Some(Ok(command)) => self.obey(&command)?,
            }
        }
        Ok(())
    }

    fn refuse(&mut self, code: FaultCode, text: &str) -> Result<(), TalkEnd> {
        self.say(&ToHost::Fault(WireFault { code, text }))
    }

    fn obey(&mut self, command: &ToDevice<'_>) -> Result<(), TalkEnd> {
        match command {
            ToDevice::Identify => self.greet()?,
            ToDevice::Stop => self.running = false,
            ToDevice::Start => self.start()?,
            ToDevice::Scan(part) => self.scan(part),
            ToDevice::Rate(rate_mhz) => {
                let most = self.emulator.highest_rate_mhz();
                if (1..=most).contains(rate_mhz) {
                    self.rate_mhz = *rate_mhz;
                    self.begin();
                } else {
                    self.refuse(FaultCode::Rate, &format!("at most {} frames a second", f64::from(most) * 1e-3))?;
                }
            }
            ToDevice::SelfTest => {
                let readings: Vec<i16> = (0..self.slots.len()).map(|slot| test_reading(slot as u16)).collect();
                let (sequence, time_us) = self.stamp(*lock(&self.emulator.next));
                let readings = Readings::I16(&readings);
                self.say(&ToHost::Frame(Frame { sequence, time_us, flags: FrameFlags::TEST, readings }))?;
                self.status()?;
            }
        }
        Ok(())
    }

    fn start(&mut self) -> Result<(), TalkEnd> {
        if self.slots != self.emulator.scan.slots() {
            return self.refuse(FaultCode::ScanTable, "this device reads the scan table of its own skin alone");
        }
        self.running = true;
        self.begin();
        Ok(())
    }

    fn begin(&mut self) {
        self.began = (Instant::now(), *lock(&self.emulator.next));
    }

    fn scan(&mut self, part: &ScanPart<'_>) {
        self.slots.resize(usize::from(part.total), Slot { source: 0, sink: 0, measure: None });
        let places = self.slots.iter_mut().skip(usize::from(part.first));
        places.zip(part.slots.iter()).for_each(|(place, slot)| *place = slot);
    }

    /// The number on the wire and the device's time of a frame.
    fn stamp(&self, index: u64) -> (u32, u64) {
        let rate_hz = f64::from(self.rate_mhz) * 1e-3;
        (index as u32, (index as f64 / rate_hz * 1e6) as u64)
    }

    /// Waits for the next frame's time and sends it.
    fn send_due(&mut self) -> Result<(), TalkEnd> {
        let emulator = self.emulator;
        let index = *lock(&emulator.next);
        let frame_s = 1e3 / f64::from(self.rate_mhz) / emulator.options.speed;
        let mut flags = FrameFlags::default();
        if !emulator.options.unpaced {
            let due = self.began.0 + Duration::from_secs_f64((index - self.began.1) as f64 * frame_s);
            match due.checked_duration_since(Instant::now()) {
                Some(wait) => std::thread::sleep(wait),
                None if due.elapsed() > MOST_LATE => {
                    // It cannot keep up: what is late is left out, as an instrument does whose line is too slow.
                    let skipped = (due.elapsed().as_secs_f64() / frame_s) as u64;
                    self.dropped = self.dropped.wrapping_add(skipped as u32);
                    *lock(&emulator.next) += skipped;
                    flags = FrameFlags::OVERRUN;
                }
                None => {}
            }
        }
        let index = if flags == FrameFlags::OVERRUN { *lock(&emulator.next) } else { index };
        let time_s = index as f64 / emulator.options.twin.electronics.frame_rate_hz;
        emulator.fail(time_s)?;
        if emulator.is_unplugged(time_s) {
            return Err(TalkEnd::Gone);
        }
        let counts = match emulator.frames.len() as u64 {
            0 => emulator.take(index)?,
            count => emulator.frames[(index % count) as usize].clone(),
        };
        self.send_frame(index, time_s, counts, flags)?;
        *lock(&emulator.next) = index + 1;
        if self.status_at.elapsed().as_secs_f64() > STATUS_S {
            self.status_at = Instant::now();
            self.status()?;
        }
        Ok(())
    }

    fn send_frame(
        &mut self,
        index: u64,
        time_s: f64,
        mut counts: Vec<i32>,
        mut flags: FrameFlags,
    ) -> Result<(), TalkEnd> {
        let emulator = self.emulator;
        let noise = emulator.felt(time_s, |fault| match fault {
            Fault::Noise { times, for_s } => Some((*times, *for_s)),
            _ => None,
        });
        let full = emulator.full_scale;
        if noise > 0.0 {
            // About a count is the noise of the usual converter.
            let rng = &mut self.rng;
            counts.iter_mut().for_each(|count| {
                let noisy = f64::from(*count) + noise * standard_normal(rng);
                *count = noisy.round().clamp(-f64::from(full) - 1.0, f64::from(full)) as i32;
            });
        }
        if counts.iter().any(|&count| count >= full || count < -full) {
            flags = flags.and(FrameFlags::SATURATED);
        }
        let (sequence, time_us) = self.stamp(index);
        let narrow: Vec<i16>;
        let readings = if emulator.reading_bytes == 2 {
            narrow = counts.iter().map(|&count| count as i16).collect();
            Readings::I16(&narrow)
        } else {
            Readings::I32(&counts)
        };
        let message = ToHost::Frame(Frame { sequence, time_us, flags, readings });
        let length = message.encode(&mut self.packet).map_err(|error| std::io::Error::other(error.to_string()))?;
        let share = emulator.felt(time_s, |fault| match fault {
            Fault::Bytes { share, for_s } => Some((*share, *for_s)),
            _ => None,
        });
        if share > 0.0 && self.rng.random::<f64>() < share {
            let hurt = damaged(&self.packet[..length], &mut self.rng);
            return Ok(self.line.say(&hurt)?);
        }
        Ok(self.line.say(&self.packet[..length])?)
    }

    fn status(&mut self) -> Result<(), TalkEnd> {
        let (frames, time_us) = self.stamp(*lock(&self.emulator.next));
        self.say(&ToHost::Status(Status {
            uptime_ms: (time_us / 1000) as u32,
            frames,
            dropped: self.dropped,
            damaged: self.damaged,
            temperature_cc: 2500,
            supply_mv: 5000,
        }))
    }
}

/// A packet after an accident: a byte changed, cut short, doubled, or noise before it.
fn damaged(packet: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = packet.to_vec();
    let inside = 1 + rng.random_range(0..packet.len() - 2);
    match rng.random_range(0..4) {
        0 => bytes[inside] ^= 1 << rng.random_range(0..8),
        1 => bytes.truncate(inside),
        2 => bytes.extend_from_slice(packet),
        _ => {
            let noise: Vec<u8> = (0..rng.random_range(1..40)).map(|_| rng.random()).collect();
            bytes.splice(0..0, noise);
        }
    }
    bytes
}
