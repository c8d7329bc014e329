//! The thread that reads the device.

use crate::LiveError;
use crate::device::{Address, Connection, DeviceEvent, DeviceFacts, DeviceOptions, Stream};
use crate::runtime::{Event, LiveHandle, WorkItem};
use dermis::pipeline::{Command, Severity};
use dermis_wire::ToHost;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::Duration;

/// Pause between two attempts to connect again.
const RETRY: Duration = Duration::from_millis(250);

/// What the values of a device depend on: reference resistor, source, volts per count; `None` for an instrument without a hello.
fn stated_scale(facts: &DeviceFacts) -> Option<[f32; 5]> {
    let Ok(ToHost::Hello(hello)) = ToHost::parse(&facts.hello) else { return None };
    let [undriven, driven, reference] = hello.volts_per_count;
    Some([hello.reference_ohm, hello.source_v, undriven, driven, reference])
}

/// Reads the device, and connects again when it is lost.
pub(super) struct DeviceThread {
    shared: Arc<LiveHandle>,
    address: Address,
    options: DeviceOptions,
}

impl DeviceThread {
    pub(super) fn new(shared: Arc<LiveHandle>, address: Address, options: DeviceOptions) -> Self {
        DeviceThread { shared, address, options }
    }

    /// Reads until the skin is stopped or the input has ended. Without a connection, waits for the device first.
    pub(super) fn run(self, connection: Option<Connection>) {
        self.shared.await_begin();
        let mut next = connection.or_else(|| self.connect(None));
        let mut scale = None;
        while let Some(connection) = next {
            let facts = connection.facts();
            self.shared.connected(facts.clone());
            let stated = stated_scale(facts);
            if scale.replace(stated).is_some_and(|before| before != stated) {
                let text = "the device states other scales of its readings than before: a tare begins".to_string();
                self.shared.notice(Severity::Warning, text);
                self.shared.command(Command::Tare);
            }
            // Firmware without a serial number sends 0.
            if let Some(serial) = NonZeroU32::new(facts.serial) {
                self.shared.command(Command::Device { serial });
            }
            let stream = self.listen(connection);
            self.shared.disconnected();
            next = stream.and_then(|stream| self.connect(Some(stream)));
        }
        self.shared.close_work();
    }

    /// Reads until the device is lost (returns its stream), the input has ended or the skin is stopped.
    fn listen(&self, mut connection: Connection) -> Option<Stream> {
        let waits = self.address.is_patient();
        while !self.shared.is_stopped() {
            let result = connection.listen(|event| match event {
                DeviceEvent::Frame(incoming) => {
                    if waits {
                        self.shared.await_room();
                    }
                    self.shared.queue(WorkItem::Frame(incoming));
                }
                DeviceEvent::Notice(notice) => self.shared.device_notice(notice),
                DeviceEvent::Status(_) => {}
            });
            match result {
                Ok(()) => {}
                Err(error @ LiveError::Ended { .. }) => {
                    self.shared.notice(Severity::Info, error.to_string());
                    return None;
                }
                Err(error @ LiveError::Refused { .. }) => {
                    self.shared.fail(error);
                    return None;
                }
                Err(error) => {
                    self.shared.publish(&Event::Lost(error.to_string()));
                    return Some(connection.close());
                }
            }
        }
        connection.close();
        None
    }

    /// Tries to connect until the device answers or the skin is stopped; `stream` is that of a device that was lost.
    fn connect(&self, stream: Option<Stream>) -> Option<Connection> {
        let mut reported = String::new();
        while !self.shared.is_stopped() {
            // Before the first attempt, too: a device may accept connections and end them at once.
            std::thread::sleep(RETRY);
            match Connection::open(&self.address, self.shared.skin(), self.options, stream.clone()) {
                Ok(connection) => {
                    let again = if stream.is_some() { " again" } else { "" };
                    self.shared.notice(Severity::Info, format!("the device is connected{again}"));
                    return Some(connection);
                }
                // A device that was accepted before is waited for: it may be exchanged once more.
                Err(error @ LiveError::Refused { .. }) if stream.is_none() => {
                    self.shared.fail(error);
                    return None;
                }
                Err(error) => {
                    let why = error.to_string();
                    if why != reported {
                        self.shared.notice(Severity::Error, format!("{why} (tried again until it answers)"));
                        reported = why;
                    }
                }
            }
        }
        None
    }
}
