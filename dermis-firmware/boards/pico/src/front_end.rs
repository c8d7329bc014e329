//! Multiplexers, gain and converter: the program of the PIO, its pins, and the task that keeps it running.

use core::future::pending;
use embassy_futures::join::join;
use embassy_futures::select::select;
use embassy_rp::Peri;
use embassy_rp::dma::Channel as Dma;
use embassy_rp::gpio::Level;
use embassy_rp::interrupt::typelevel::Binding;
use embassy_rp::interrupt::typelevel::PIO0_IRQ_0;
use embassy_rp::peripherals::*;
use embassy_rp::pio::program::pio_asm;
use embassy_rp::pio::{
    Common, Config, Direction, InterruptHandler, Pin, Pio, ShiftConfig, ShiftDirection, StateMachine, StateMachineRx,
};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_time::Instant;

/// The pins, in the order of `docs/firmware.md`. Five pins are a multiplexer's address, the lowest bit first.
pub struct Pins {
    pub address: (Address0, Address1, Address2, Address3),
    pub gain: (Peri<'static, PIN_20>, Peri<'static, PIN_21>),
    /// High: all switches are open.
    pub open: Peri<'static, PIN_22>,
    /// A rising edge starts a conversion.
    pub convert: Peri<'static, PIN_26>,
    pub clock: Peri<'static, PIN_27>,
    pub data: Peri<'static, PIN_28>,
}

type Of<P> = Peri<'static, P>;
type Address0 = (Of<PIN_0>, Of<PIN_1>, Of<PIN_2>, Of<PIN_3>, Of<PIN_4>);
type Address1 = (Of<PIN_5>, Of<PIN_6>, Of<PIN_7>, Of<PIN_8>, Of<PIN_9>);
type Address2 = (Of<PIN_10>, Of<PIN_11>, Of<PIN_12>, Of<PIN_13>, Of<PIN_14>);
type Address3 = (Of<PIN_15>, Of<PIN_16>, Of<PIN_17>, Of<PIN_18>, Of<PIN_19>);

/// Clock cycles of the processor and the PIO per microsecond: 125 MHz.
pub const CYCLES_PER_US: u32 = 125;
/// Cycles of a slot beside its settling: 1 to open, 4 for the addresses, 1 to close, 97 to convert, 4 + 16 * 5 to read.
pub const OVERHEAD_CYCLES: u32 = 187;
/// Settling is this many cycles longer than the number in its word.
pub const WAIT_CYCLES: u32 = 2;

/// Two words of a slot: its pins from pin 0 on, and its settling less `WAIT_CYCLES`.
pub type SlotWords = [u32; 2];

/// A request to read frames.
pub struct Job {
    /// The words of the slots of a frame.
    pub words: &'static mut [u32],
    pub slot_count: usize,
}

/// Readings of one frame.
pub struct Filled {
    pub readings: &'static mut [u16],
    /// Number of the frame since the start.
    pub index: u64,
    /// When the first frame was begun, us.
    pub began_us: u64,
}

type Queue<T, const N: usize> = Channel<CriticalSectionRawMutex, T, N>;
/// Buffers: one is filled, one is being taken, one waits.
pub const BUFFERS: usize = 3;
pub static JOBS: Queue<Job, 1> = Channel::new();
pub static DONE: Queue<Job, 1> = Channel::new();
pub static EMPTY: Queue<&'static mut [u16], BUFFERS> = Channel::new();
pub static FILLED: Queue<Filled, BUFFERS> = Channel::new();
pub static STOP: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// The state machine that reads slots.
pub struct FrontEnd {
    _common: Common<'static, PIO0>,
    machine: StateMachine<'static, PIO0, 0>,
    config: Config<'static, PIO0>,
    dma: [Dma<'static>; 2],
    open: Pin<'static, PIO0>,
}

impl FrontEnd {
    pub fn new(
        pio: Peri<'static, PIO0>,
        interrupt: impl Binding<PIO0_IRQ_0, InterruptHandler<PIO0>>,
        pins: Pins,
        dma: [Dma<'static>; 2],
    ) -> Self {
        let Pio { mut common, sm0: mut machine, .. } = Pio::new(pio, interrupt);
        let mut config = Config::default();
        let program = pio_asm!(
            ".side_set 2", // bit 0 starts a conversion, bit 1 is the converter's clock
            ".wrap_target",
            "    set pins, 1      side 0",     // open all switches
            "    out pins, 32     side 0 [3]", // addresses and gain, 40 ns after the opening until the closing
            "    set pins, 0      side 0",     // close those of the slot
            "    out x, 32        side 0",
            "settle:",
            "    jmp x-- settle   side 0",
            "    set y, 11        side 1", // convert: 97 cycles, 776 ns
            "convert:",
            "    jmp y-- convert  side 1 [7]",
            "    set y, 15        side 0 [3]", // the highest bit appears
            "read:",
            "    in pins, 1       side 2", // sampled 4 cycles after the falling edge, two of them for synchronisation
            "    jmp y-- read     side 0 [3]",
            ".wrap",
        );
        let loaded = common.load_program(&program.program);
        let (p, g) = (pins.address, pins.gain);
        let outputs = [
            common.make_pio_pin(p.0.0),
            common.make_pio_pin(p.0.1),
            common.make_pio_pin(p.0.2),
            common.make_pio_pin(p.0.3),
            common.make_pio_pin(p.0.4),
            common.make_pio_pin(p.1.0),
            common.make_pio_pin(p.1.1),
            common.make_pio_pin(p.1.2),
            common.make_pio_pin(p.1.3),
            common.make_pio_pin(p.1.4),
            common.make_pio_pin(p.2.0),
            common.make_pio_pin(p.2.1),
            common.make_pio_pin(p.2.2),
            common.make_pio_pin(p.2.3),
            common.make_pio_pin(p.2.4),
            common.make_pio_pin(p.3.0),
            common.make_pio_pin(p.3.1),
            common.make_pio_pin(p.3.2),
            common.make_pio_pin(p.3.3),
            common.make_pio_pin(p.3.4),
            common.make_pio_pin(g.0),
            common.make_pio_pin(g.1),
        ];
        let open = common.make_pio_pin(pins.open);
        let side = [common.make_pio_pin(pins.convert), common.make_pio_pin(pins.clock)];
        let data = common.make_pio_pin(pins.data);
        let outputs = outputs.each_ref();
        let side = side.each_ref();
        config.use_program(&loaded, &side);
        config.set_out_pins(&outputs);
        config.set_set_pins(&[&open]);
        config.set_in_pins(&[&data]);
        config.shift_out = ShiftConfig { auto_fill: true, threshold: 32, direction: ShiftDirection::Right };
        config.shift_in = ShiftConfig { auto_fill: true, threshold: 16, direction: ShiftDirection::Left };
        machine.restart();
        machine.set_config(&config);
        machine.set_pins(Level::Low, &outputs);
        machine.set_pins(Level::Low, &side);
        machine.set_pins(Level::High, &[&open]);
        machine.set_pin_dirs(Direction::Out, &outputs);
        machine.set_pin_dirs(Direction::Out, &side);
        machine.set_pin_dirs(Direction::Out, &[&open]);
        machine.set_pin_dirs(Direction::In, &[&data]);
        FrontEnd { _common: common, machine, config, dma, open }
    }

    /// Reads frames of a job until it is dropped. Neither transfer is late as long as it is restarted within the slots
    /// that the queues of the state machine hold: two for the words, four for the readings.
    async fn read(&mut self, job: &Job, buffer: &mut Option<&'static mut [u16]>) {
        let began_us = Instant::now().as_micros();
        self.machine.set_enable(true);
        let [to, from] = &mut self.dma;
        let (rx, tx) = self.machine.rx_tx();
        let words = &job.words[..2 * job.slot_count];
        let feed = async {
            loop {
                tx.dma_push(to, words, false).await;
            }
        };
        join(feed, store(rx, from, job.slot_count, buffer, began_us)).await;
    }

    /// Opens all switches and forgets what the state machine had begun.
    fn stop(&mut self) {
        self.machine.set_enable(false);
        self.machine.clear_fifos();
        self.machine.restart();
        self.machine.set_config(&self.config);
        self.machine.set_pins(Level::High, &[&self.open]);
    }
}

/// Stores frames of readings. Without an empty buffer a frame is read into the same one again: it is lost, and its
/// number is missing.
async fn store(
    rx: &mut StateMachineRx<'static, PIO0, 0>,
    dma: &mut Dma<'static>,
    slot_count: usize,
    buffer: &mut Option<&'static mut [u16]>,
    began_us: u64,
) {
    for index in 0.. {
        if buffer.is_none() {
            *buffer = EMPTY.try_receive().ok();
        }
        let Some(readings) = buffer.as_mut() else { return pending().await };
        rx.dma_pull(dma, &mut readings[..slot_count], false).await;
        // The last buffer stays: the next frame has to go somewhere.
        if let (Ok(next), Some(readings)) = (EMPTY.try_receive(), buffer.take()) {
            *buffer = Some(next);
            let _ = FILLED.try_send(Filled { readings, index, began_us });
        }
    }
}

/// Reads frames of one job after the other.
#[embassy_executor::task]
pub async fn scan(mut front_end: FrontEnd) {
    let mut buffer = None;
    loop {
        let job = JOBS.receive().await;
        STOP.reset();
        select(front_end.read(&job, &mut buffer), STOP.wait()).await;
        front_end.stop();
        DONE.send(job).await;
    }
}
