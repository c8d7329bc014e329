//! The firmware of a skin's reader on the Raspberry Pi Pico: four multiplexers of 32 channels and a differential
//! converter of 16 bits on its pins, the host on its USB. `docs/firmware.md` has the parts and the pins.
//!
//! A state machine of the PIO reads slot by slot without the processor; two DMA channels feed it and store its readings.
//! A task of higher priority restarts them between frames, so that neither USB nor the encoding of packets moves a slot.

#![no_std]
#![no_main]

mod front_end;
mod link;
mod reader;
#[path = "../../skins/cylinder30.rs"]
mod skin;
mod supervisor;

use crate::front_end::{FrontEnd, Pins};
use crate::link::UsbLink;
use crate::reader::Reader;
use crate::supervisor::Supervisor;
use dermis_firmware::{Device, Instrument, Memory, TimedSlot};
use embassy_executor::{Executor, InterruptExecutor};
use embassy_rp::clocks::RoscRng;
use embassy_rp::interrupt::{self, InterruptExt, Priority};
use embassy_rp::watchdog::Watchdog;
use embassy_rp::{bind_interrupts, dma, peripherals, pio, usb};
use embassy_time::{Duration, Timer};
use panic_halt as _;
use static_cell::{ConstStaticCell, StaticCell};

bind_interrupts!(struct Interrupts {
    DMA_IRQ_0 => dma::InterruptHandler<peripherals::DMA_CH0>, dma::InterruptHandler<peripherals::DMA_CH1>;
    PIO0_IRQ_0 => pio::InterruptHandler<peripherals::PIO0>;
    USBCTRL_IRQ => usb::InterruptHandler<peripherals::USB>;
});

/// Time between two polls: the processor sleeps meanwhile. A poll passes up to 1,024 bytes to USB.
const REST: Duration = Duration::from_micros(50);

/// Slots of the largest scan table.
const MAX_SLOTS: usize = 1024;

static TABLES: ConstStaticCell<[[TimedSlot; MAX_SLOTS]; 2]> = ConstStaticCell::new([[TimedSlot::NONE; MAX_SLOTS]; 2]);
static TESTED: ConstStaticCell<[i16; MAX_SLOTS]> = ConstStaticCell::new([0; MAX_SLOTS]);
const OUTBOX_BYTES: usize = Memory::outbox_bytes(MAX_SLOTS);
static OUTBOX: ConstStaticCell<[u8; OUTBOX_BYTES]> = ConstStaticCell::new([0; OUTBOX_BYTES]);
static DEVICE: StaticCell<Device<'static>> = StaticCell::new();
static EXECUTOR: StaticCell<Executor> = StaticCell::new();
static SCANNING: InterruptExecutor = InterruptExecutor::new();

#[embassy_rp::interrupt]
unsafe fn SWI_IRQ_0() {
    // SAFETY: this is the interrupt with which the executor was started.
    unsafe { SCANNING.on_interrupt() }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let p = embassy_rp::init(Default::default());
    let pins = Pins {
        address: (
            (p.PIN_0, p.PIN_1, p.PIN_2, p.PIN_3, p.PIN_4),
            (p.PIN_5, p.PIN_6, p.PIN_7, p.PIN_8, p.PIN_9),
            (p.PIN_10, p.PIN_11, p.PIN_12, p.PIN_13, p.PIN_14),
            (p.PIN_15, p.PIN_16, p.PIN_17, p.PIN_18, p.PIN_19),
        ),
        gain: (p.PIN_20, p.PIN_21),
        open: p.PIN_22,
        convert: p.PIN_26,
        clock: p.PIN_27,
        data: p.PIN_28,
    };
    let dma = [dma::Channel::new(p.DMA_CH0, Interrupts), dma::Channel::new(p.DMA_CH1, Interrupts)];
    let front_end = FrontEnd::new(p.PIO0, Interrupts, pins, dma);

    // Slots first, then USB.
    interrupt::SWI_IRQ_0.set_priority(Priority::P1);
    interrupt::DMA_IRQ_0.set_priority(Priority::P1);
    interrupt::USBCTRL_IRQ.set_priority(Priority::P3);
    SCANNING.start(interrupt::SWI_IRQ_0).spawn(front_end::scan(front_end).expect("the pool has one task"));

    let driver = usb::Driver::new(p.USB, Interrupts);
    let supervisor = Supervisor::new(Watchdog::new(p.WATCHDOG));
    EXECUTOR.init(Executor::new()).run(|spawner| {
        link::start(spawner, driver);
        spawner.spawn(run(supervisor).expect("the pool has one task"));
    })
}

/// Polls the device for ever.
#[embassy_executor::task]
async fn run(mut supervisor: Supervisor) {
    let instrument =
        Instrument { name: "dermis pico", serial: supervisor::SERIAL, boot: RoscRng.next_u32(), ..skin::INSTRUMENT };
    let [complete, arriving] = TABLES.take();
    let memory = Memory { tables: [complete, arriving], readings: TESTED.take(), outbox: OUTBOX.take() };
    let device = DEVICE.init(Device::new(instrument, memory));
    let (mut reader, mut link) = (Reader::new(), UsbLink::new());
    loop {
        device.poll(&mut reader, &mut link, &mut supervisor);
        Timer::after(REST).await;
    }
}
