//! The thread that reads the device.

use crate::device::{Address, Device, DeviceEvent, DeviceOptions, Stream};
use crate::runtime::{Event, LiveHandle, WorkItem};
use dermis::pipeline::Severity;
use std::sync::Arc;
use std::time::Duration;

/// Pause between two attempts to connect again.
const RETRY: Duration = Duration::from_millis(250);

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

    /// Reads until the skin is stopped.
    pub(super) fn run(self, device: Device) {
        let mut next = Some(device);
        while let Some(device) = next {
            self.shared.connected(device.facts().clone());
            let stream = self.listen(device);
            self.shared.disconnected();
            next = self.reconnect(stream);
        }
        self.shared.close_work();
    }

    /// Reads until the device is lost or the skin is stopped.
    fn listen(&self, mut device: Device) -> Stream {
        while !self.shared.is_stopped() {
            let result = device.listen(|event| match event {
                DeviceEvent::Frame(incoming) => self.shared.queue(WorkItem::Frame(incoming)),
                DeviceEvent::Notice(notice) => self.shared.publish(&Event::Notice(notice)),
                DeviceEvent::Status(_) => {}
            });
            if let Err(error) = result {
                self.shared.publish(&Event::Lost(error.to_string()));
                return device.into_stream();
            }
        }
        // A device that is gone needs no stop.
        let _ = device.send(&dermis_wire::ToDevice::Stop);
        device.into_stream()
    }

    fn reconnect(&self, stream: Stream) -> Option<Device> {
        let mut reported = String::new();
        while !self.shared.is_stopped() {
            match Device::connect(&self.address, self.shared.skin(), self.options, Some(stream.clone())) {
                Ok(device) => {
                    self.shared.notice(Severity::Info, "the device is connected again".into());
                    return Some(device);
                }
                Err(error) => {
                    let why = error.to_string();
                    if why != reported {
                        self.shared.notice(Severity::Error, why.clone());
                        reported = why;
                    }
                    std::thread::sleep(RETRY);
                }
            }
        }
        None
    }
}
