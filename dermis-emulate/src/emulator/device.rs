//! The emulated device: a digital twin, its touches and faults, and the resulting packets.

use crate::EmulateError;
use crate::emulator::fault::{Fault, FaultyReadings, ReadingFault, TimedFault};
use crate::emulator::script::Script;
use crate::emulator::timing::Timing;
use dermis::design::SkinDesign;
use dermis::geom::{Point3, Surface};
use dermis::text::printable;
use dermis_live::device::{Role, ScanTable};
use dermis_live::{LiveError, Pressable};
use dermis_sim::twin::{ContactHistory, Press, Twin, TwinOptions};
use dermis_wire::{Frame, FrameFlags, Hello, NoRoom, Readings, Slot, ToHost, VERSION};
use std::collections::BTreeMap;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Options of the emulator.
#[derive(Debug, Clone)]
pub struct EmulatorOptions {
    /// Options of the twin.
    pub twin: TwinOptions,
    /// Seed of the twin, and serial number of the device.
    pub seed: u64,
    /// The touches.
    pub script: Script,
    /// The faults.
    pub faults: Vec<TimedFault>,
    /// Seconds of device time per second of real time.
    pub speed: f64,
    /// Number of frames that are computed in advance and sent repeatedly; 0 for none. Later touches and faults of the
    /// skin then have no effect.
    pub prerendered: usize,
    /// Send frames as fast as the connection allows.
    pub unpaced: bool,
}

/// An emulated device.
pub struct Emulator {
    design: SkinDesign,
    options: EmulatorOptions,
    scan: ScanTable,
    surface: Surface,
    tip_radius_m: f64,
    /// Volts per count, and the highest count.
    volts_per_count: [f64; 3],
    full_scale: i32,
    reading_bytes: u8,
    boot: u32,
    twin: Mutex<Twin>,
    /// Memory of the twin's contacts of the presses in earlier frames.
    history: Mutex<ContactHistory>,
    fingers: Mutex<BTreeMap<u32, Press>>,
    frames: Vec<Vec<i32>>,
    /// Counts of the first frames of faults that repeat them, by number.
    first: Mutex<BTreeMap<u64, Vec<i32>>>,
    /// The number of the next frame since power-up; a new connection continues the numbers.
    next: Mutex<u64>,
    timing: Mutex<Timing>,
    /// Number of faults of the skin that have been applied.
    happened: Mutex<usize>,
    stopped: AtomicBool,
    /// Whether it has ended by an error or a panic.
    failed: AtomicBool,
    /// Whether the warning about a slow twin was printed.
    said_slow: AtomicBool,
}

impl std::fmt::Debug for Emulator {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Emulator").field("design", &self.design.name).finish_non_exhaustive()
    }
}

/// Most frames that are computed in advance, and most bytes of them.
pub const MAX_PRERENDERED: usize = 1_000_000;
const MAX_PRERENDERED_BYTES: usize = 1 << 29;

/// Most bytes of Green's functions that the twin keeps: those of some hundred places.
const TABLE_BYTES: usize = 64 << 20;

/// Resolution of an ideal converter, bits.
const IDEAL_BITS: u32 = 32;
/// Range of an ideal converter, V.
const IDEAL_RANGE_V: f64 = 10.0;

impl Emulator {
    /// Powers up a device.
    ///
    /// # Errors
    /// A twin that does not fit the design; a fault of an unknown electrode.
    pub fn new(design: &SkinDesign, options: EmulatorOptions) -> Result<Arc<Self>, EmulateError> {
        let mut twin = Twin::new(design, &options.twin, options.seed)?;
        twin.limit_table(TABLE_BYTES);
        let options = EmulatorOptions { twin: twin.options().clone(), ..options };
        if !(options.speed > 0.0 && options.speed.is_finite()) {
            return Err(EmulateError::Given(format!("the speed is {}: it must be positive", options.speed)));
        }
        options.faults.iter().try_for_each(|timed| check_fault(design, timed))?;
        let scan = ScanTable::new(&design.protocol)?;
        let most = MAX_PRERENDERED.min(MAX_PRERENDERED_BYTES / (size_of::<i32>() * scan.slots().len().max(1)));
        if options.prerendered > most {
            return Err(EmulateError::Given(format!(
                "{} frames in advance: at most {most} of this skin fit into {} MiB",
                options.prerendered,
                MAX_PRERENDERED_BYTES >> 20
            )));
        }
        let bits = options.twin.electronics.adc.map_or(IDEAL_BITS, |adc| adc.bits);
        let ideal = [IDEAL_RANGE_V / 2f64.powi(IDEAL_BITS as i32 - 1); 3];
        let mut emulator = Emulator {
            scan,
            surface: design.body.surface(),
            tip_radius_m: options.twin.press.tip_radius_m,
            volts_per_count: twin.electronics().volts_per_count().unwrap_or(ideal),
            full_scale: ((1i64 << (bits.clamp(2, 32) - 1)) - 1) as i32,
            reading_bytes: if bits <= 16 { 2 } else { 4 },
            boot: std::process::id() ^ dermis_live::clock::now().unix_ns as u32,
            twin: Mutex::new(twin),
            history: Mutex::default(),
            fingers: Mutex::default(),
            frames: Vec::new(),
            first: Mutex::default(),
            next: Mutex::new(0),
            timing: Mutex::new(Timing::new((options.twin.electronics.frame_rate_hz * 1e3).round() as u32)),
            happened: Mutex::new(0),
            stopped: AtomicBool::new(false),
            failed: AtomicBool::new(false),
            said_slow: AtomicBool::new(false),
            design: design.clone(),
            options,
        };
        for index in 0..emulator.options.prerendered as u64 {
            emulator.frames.push(emulator.take(index)?);
        }
        Ok(Arc::new(emulator))
    }

    /// The options.
    pub(crate) fn options(&self) -> &EmulatorOptions {
        &self.options
    }

    /// The presses at a device time, s.
    pub fn presses(&self, time_s: f64) -> Vec<Press> {
        let mut presses = self.options.script.presses(time_s, &self.surface, self.tip_radius_m);
        presses.extend(lock(&self.fingers).values());
        presses
    }

    /// Ends [`serve`](Self::serve).
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// Whether [`serve`](Self::serve) has ended by an error or a panic.
    pub fn has_failed(&self) -> bool {
        self.failed.load(Ordering::Relaxed)
    }

    pub(super) fn fail_for_good(&self) {
        self.failed.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    /// The slots of its skin, the only ones that it supports.
    pub(super) fn slots(&self) -> &[Slot] {
        self.scan.slots()
    }

    /// The number of the next frame.
    pub(super) fn next_index(&self) -> u64 {
        *lock(&self.next)
    }

    pub(super) fn set_next_index(&self, index: u64) {
        *lock(&self.next) = index;
    }

    /// Warns once, on standard error, that frames were skipped.
    pub(super) fn is_slow(&self, rate_hz: f64) {
        if !self.said_slow.swap(true, Ordering::Relaxed) {
            let _ = writeln!(
                std::io::stderr(),
                "the emulated device leaves frames out: its twin `{}` takes longer than the {:.1} ms that a frame has here; \
                 --speed 0.25 slows the device down, --prerender 480 makes the first 480 frames beforehand",
                printable(&self.options.twin.name),
                1e3 / rate_hz / self.options.speed,
            );
        }
    }

    /// Its rate and clock, which persist across hosts.
    pub(super) fn timing(&self) -> MutexGuard<'_, Timing> {
        lock(&self.timing)
    }

    /// Highest frame rate, thousandths of a hertz.
    pub(super) fn highest_rate_millihertz(&self) -> u32 {
        let slots = self.scan.slots().len() as f64;
        let most_hz = match self.frames.is_empty() && !self.options.unpaced {
            true => self.options.twin.electronics.slot_rate_hz / slots,
            // Precomputed frames are sent at any requested rate.
            false => 1e6,
        };
        (most_hz * 1e3 * (1.0 + 1e-9)) as u32
    }

    /// The counts of frame `index`, with the faults of its readings.
    pub(super) fn counts(&self, index: u64) -> Result<Vec<i32>, EmulateError> {
        let rate_hz = self.options.twin.electronics.frame_rate_hz;
        let time_s = index as f64 / rate_hz;
        let mut counts = self.sound_counts(index)?;
        for timed in &self.options.faults {
            let Fault::Readings { fault, for_s } = timed.fault else { continue };
            if !timed.lasts(for_s, time_s) {
                continue;
            }
            let first = match fault.needs_first() {
                true => self.first_counts((timed.at_s * rate_hz).ceil() as u64)?,
                false => Vec::new(),
            };
            let (counts, roles) = (&mut counts, self.scan.roles());
            let (full_scale, seed) = (self.full_scale, self.options.seed);
            fault.apply(&mut FaultyReadings { counts, roles, full_scale, seed, index }, &first);
        }
        Ok(counts)
    }

    /// The counts of the first frame of a fault, computed once.
    fn first_counts(&self, index: u64) -> Result<Vec<i32>, EmulateError> {
        if let Some(counts) = lock(&self.first).get(&index) {
            return Ok(counts.clone());
        }
        let counts = self.sound_counts(index)?;
        lock(&self.first).insert(index, counts.clone());
        Ok(counts)
    }

    /// The counts of frame `index`, computed now or in advance.
    fn sound_counts(&self, index: u64) -> Result<Vec<i32>, EmulateError> {
        match self.frames.len() as u64 {
            0 => self.take(index),
            count => Ok(self.frames[(index % count) as usize].clone()),
        }
    }

    /// Measures frame `index`: its counts, in the order of the scan table.
    fn take(&self, index: u64) -> Result<Vec<i32>, EmulateError> {
        let time_s = index as f64 / self.options.twin.electronics.frame_rate_hz;
        let presses = self.presses(time_s);
        let readings = lock(&self.twin).readings_after(&presses, &mut lock(&self.history), index)?;
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

    /// The packet of its hello at a frame rate, in thousandths of a hertz.
    pub fn hello_packet(&self, rate_millihertz: u32) -> Vec<u8> {
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
            rate_millihertz,
            highest_rate_millihertz: self.highest_rate_millihertz(),
            baud: 0,
            serial: seed as u32,
            boot: self.boot,
            name: &name,
        };
        packet(&ToHost::Hello(hello), Hello::PACKET_BYTES)
    }

    /// The packet of frame `index` at the rate of the twin's instrument, as a host would receive it without a
    /// connection.
    ///
    /// # Errors
    /// A failure of the twin.
    pub fn frame_packet(&self, index: u64) -> Result<Vec<u8>, EmulateError> {
        let rate_hz = self.options.twin.electronics.frame_rate_hz;
        self.fail(index as f64 / rate_hz)?;
        let counts = self.counts(index)?;
        let mut packet = vec![0; Frame::packet_bytes(counts.len(), 4)];
        let length = self.write_frame(
            (index as u32, self.clock_us(index as f64 / rate_hz, index as f64 / rate_hz * 1e6)),
            &counts,
            FrameFlags::default(),
            &mut packet,
        );
        packet.truncate(length.expect("the packet fits into the bytes that it takes at most"));
        Ok(packet)
    }

    /// Writes the packet of a frame with a number and a time into `out` and returns its length.
    pub(super) fn write_frame(
        &self,
        (sequence, time_us): (u32, u64),
        counts: &[i32],
        mut flags: FrameFlags,
        out: &mut [u8],
    ) -> Result<usize, NoRoom> {
        let full = self.full_scale;
        if counts.iter().any(|&count| count >= full || count < -full) && !flags.has(FrameFlags::TEST) {
            flags = flags.and(FrameFlags::SATURATED);
        }
        let narrow: Vec<i16>;
        let readings = if self.reading_bytes == 2 {
            narrow = counts.iter().map(|&count| count as i16).collect();
            Readings::I16(&narrow)
        } else {
            Readings::I32(counts)
        };
        ToHost::Frame(Frame { sequence, time_us, flags, readings }).encode(out)
    }

    /// Applies the faults of the skin that are due.
    pub(super) fn fail(&self, time_s: f64) -> Result<(), EmulateError> {
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

    /// The strength of a lasting fault at this time; 0 without one.
    pub(super) fn felt(&self, time_s: f64, of: impl Fn(&Fault) -> Option<(f64, f64)>) -> f64 {
        let felt = |timed: &TimedFault| {
            of(&timed.fault)
                .filter(|(_, for_s)| (timed.at_s..timed.at_s + for_s).contains(&time_s))
                .map(|(value, _)| value)
        };
        self.options.faults.iter().filter_map(felt).fold(0.0, f64::max)
    }

    /// The device time of the next frame, s.
    pub(super) fn now_s(&self) -> f64 {
        self.next_index() as f64 / self.options.twin.electronics.frame_rate_hz
    }

    pub(super) fn is_unplugged(&self, time_s: f64) -> bool {
        self.lasts(time_s, |fault| match fault {
            Fault::Unplug { for_s } => Some(*for_s),
            _ => None,
        })
    }

    /// Whether no frames are sent now.
    pub(super) fn is_silent(&self, time_s: f64) -> bool {
        self.lasts(time_s, |fault| match fault {
            Fault::Silent { for_s } => Some(*for_s),
            _ => None,
        })
    }

    fn lasts(&self, time_s: f64, of: impl Fn(&Fault) -> Option<f64>) -> bool {
        self.felt(time_s, |fault| of(fault).map(|for_s| (1.0, for_s))) > 0.0
    }

    /// The time on the device's clock, us, with the faults of the clock.
    pub(super) fn clock_us(&self, time_s: f64, time_us: f64) -> u64 {
        let mut clock_us = time_us;
        for timed in self.options.faults.iter().filter(|timed| timed.at_s <= time_s) {
            match timed.fault {
                Fault::ClockSet { by_s } => clock_us += 1e6 * by_s,
                Fault::ClockStop { for_s } => clock_us -= 1e6 * (time_s - timed.at_s).min(for_s),
                _ => {}
            }
        }
        clock_us.max(0.0) as u64
    }
}

impl Pressable for Emulator {
    fn press(&self, finger: u32, centre_m: Point3, force_n: f64) -> Result<(), LiveError> {
        let press = Press { centre_m, force_n, tip_radius_m: self.tip_radius_m };
        lock(&self.twin).network(&[press]).map_err(|error| LiveError::Given(error.to_string()))?;
        lock(&self.fingers).insert(finger, press);
        Ok(())
    }

    fn release(&self, finger: u32) {
        lock(&self.fingers).remove(&finger);
    }
}

/// Refuses a fault of an electrode, drive or channel that the design does not have.
fn check_fault(design: &SkinDesign, timed: &TimedFault) -> Result<(), EmulateError> {
    let (what, number, count) = match timed.fault {
        Fault::Loose { electrode, .. } => ("electrode", electrode, design.electrodes.len()),
        Fault::Readings { fault: ReadingFault::Reference(drive, _), .. } => {
            ("drive", drive, design.protocol.drives().0.len())
        }
        Fault::Readings { fault: ReadingFault::Stuck(channel) | ReadingFault::Saturated(channel), .. } => {
            ("channel", channel, design.protocol.channel_count())
        }
        _ => return Ok(()),
    };
    match number < count {
        true => Ok(()),
        false => {
            Err(EmulateError::Given(format!("{what} {number} of a fault: the skin has {what}s 0 to {}", count - 1)))
        }
    }
}

/// The packet of a message, of at most `most` bytes.
fn packet(message: &ToHost<'_>, most: usize) -> Vec<u8> {
    let mut packet = vec![0; most];
    let length = message.encode(&mut packet).expect("the packet fits into the bytes that it takes at most");
    packet.truncate(length);
    packet
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A partial update by another thread is overwritten by the next frame.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
