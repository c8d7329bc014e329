//! The host on USB: a serial port of class CDC ACM, between two pipes that the device polls.

use crate::supervisor::SERIAL;
use core::sync::atomic::{AtomicBool, Ordering};
use dermis_firmware::{Gone, Link};
use embassy_executor::Spawner;
use embassy_rp::peripherals::USB;
use embassy_rp::usb::Driver;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_usb::class::cdc_acm::{CdcAcmClass, ControlChanged, Receiver, Sender, State};
use embassy_usb::{Builder, Config, UsbDevice};
use static_cell::{ConstStaticCell, StaticCell};

type UsbDriver = Driver<'static, USB>;

/// Bytes of a packet of a full-speed bulk endpoint.
const PACKET_BYTES: usize = 64;

static TO_HOST: Pipe<CriticalSectionRawMutex, 1024> = Pipe::new();
static FROM_HOST: Pipe<CriticalSectionRawMutex, 256> = Pipe::new();
/// Whether a program has opened the port.
static OPENED: AtomicBool = AtomicBool::new(false);

/// The host, as the device polls it.
pub struct UsbLink {
    was_open: bool,
}

impl UsbLink {
    pub fn new() -> Self {
        UsbLink { was_open: false }
    }
}

impl Link for UsbLink {
    fn connected(&mut self) -> bool {
        let is_open = OPENED.load(Ordering::Acquire);
        if is_open != self.was_open {
            // What is left is for, or from, a host that has gone.
            TO_HOST.clear();
            self.was_open = is_open;
        }
        is_open
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, Gone> {
        Ok(FROM_HOST.try_read(buffer).unwrap_or(0))
    }

    fn send(&mut self, bytes: &[u8]) -> Result<usize, Gone> {
        Ok(TO_HOST.try_write(bytes).unwrap_or(0))
    }
}

static STATE: StaticCell<State<'static>> = StaticCell::new();
static DESCRIPTORS: ConstStaticCell<[[u8; 256]; 2]> = ConstStaticCell::new([[0; 256]; 2]);
static CONTROL: ConstStaticCell<[u8; PACKET_BYTES]> = ConstStaticCell::new([0; PACKET_BYTES]);

/// Starts the tasks of the port.
pub fn start(spawner: Spawner, driver: UsbDriver) {
    // Vendor and product of the sample programs of the chip's vendor (pico-sdk, `usb_common`): a serial port of a Pico.
    let mut config = Config::new(0x2E8A, 0x000A);
    config.manufacturer = Some("dermis");
    config.product = Some(if SERIAL == 0 { "skin reader" } else { "skin reader, numbered" });
    config.max_packet_size_0 = PACKET_BYTES as u8;
    let [configuration, device] = DESCRIPTORS.take();
    let mut builder = Builder::new(driver, config, configuration, device, &mut [], CONTROL.take());
    let class = CdcAcmClass::new(&mut builder, STATE.init(State::new()), PACKET_BYTES as u16);
    let (sender, receiver, control) = class.split_with_control();
    let one = "the pool has one task";
    spawner.spawn(device_task(builder.build()).expect(one));
    spawner.spawn(send(sender).expect(one));
    spawner.spawn(receive(receiver).expect(one));
    spawner.spawn(watch(control).expect(one));
}

#[embassy_executor::task]
async fn device_task(mut device: UsbDevice<'static, UsbDriver>) {
    device.run().await;
}

#[embassy_executor::task]
async fn send(mut sender: Sender<'static, UsbDriver>) {
    let mut packet = [0; PACKET_BYTES];
    loop {
        let count = TO_HOST.read(&mut packet).await;
        let mut sent = sender.write_packet(&packet[..count]).await;
        // A transfer ends with a packet that is not full.
        if sent.is_ok() && count == PACKET_BYTES && TO_HOST.is_empty() {
            sent = sender.write_packet(&[]).await;
        }
        if sent.is_err() {
            OPENED.store(false, Ordering::Release);
            sender.wait_connection().await;
        }
    }
}

#[embassy_executor::task]
async fn receive(mut receiver: Receiver<'static, UsbDriver>) {
    let mut packet = [0; PACKET_BYTES];
    loop {
        receiver.wait_connection().await;
        FROM_HOST.clear();
        while let Ok(count) = receiver.read_packet(&mut packet).await {
            FROM_HOST.write_all(&packet[..count]).await;
        }
        OPENED.store(false, Ordering::Release);
    }
}

/// A program that opens the port sets DTR, and one that closes it or ends clears it.
#[embassy_executor::task]
async fn watch(control: ControlChanged<'static>) {
    loop {
        control.control_changed().await;
        OPENED.store(control.dtr(), Ordering::Release);
    }
}
