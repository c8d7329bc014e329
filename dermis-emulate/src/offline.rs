//! An emulated device and a pipeline without a connection between them: frame by frame, as fast as the machine allows.
//!
//! ```no_run
//! use dermis::design::SkinDesign;
//! use dermis::method::{MethodSet, Methods};
//! use dermis::pipeline::{Pipeline, Settings};
//! use dermis::skin::Skin;
//! use dermis_emulate::emulator::{EmulatorOptions, Script};
//! use dermis_emulate::offline::OfflineSession;
//! use dermis_sim::twin::TwinOptions;
//! use std::sync::Arc;
//!
//! let skin = Skin::load("skin16")?;
//! let twin = TwinOptions::load("lab")?;
//! let script = Script::load("random", skin.design(), &twin, 1)?;
//! let device = EmulatorOptions { twin, seed: 1, script, faults: vec![], speed: 1.0, prerendered: 0, unpaced: true };
//! let methods = Arc::new(MethodSet::new(&Methods::linear(), skin, None)?);
//! let mut session = OfflineSession::new(device, Pipeline::new(methods, Settings::default())?)?;
//! while session.time_s() < 10.0 {
//!     let frame = session.frame()?;
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::EmulateError;
use crate::emulator::{Emulator, EmulatorOptions};
use dermis::pipeline::{Pipeline, PipelineFrame, Timestamp};
use dermis_live::device::{IncomingFrame, Stream};
use dermis_sim::twin::Press;
use dermis_wire::{Decoder, Received, ToHost};
use std::sync::Arc;
use std::time::Duration;

/// Host time of the first frame.
const START: Timestamp = Timestamp { unix_ns: 1_800_000_000_000_000_000 };

/// A device and a pipeline.
#[derive(Debug)]
pub struct OfflineSession {
    /// The device.
    pub emulator: Arc<Emulator>,
    /// Its messages.
    pub stream: Stream,
    /// The pipeline.
    pub pipeline: Pipeline,
    /// Number of the next frame; frames can be left out.
    pub next: u64,
    /// Packets that were damaged.
    pub damaged: u64,
    decoder: Decoder<Vec<u8>>,
    rate_hz: f64,
}

impl OfflineSession {
    /// Powers up a device of the pipeline's skin.
    ///
    /// # Errors
    /// A twin that does not fit the design; a fault of an unknown electrode.
    pub fn new(options: EmulatorOptions, pipeline: Pipeline) -> Result<Self, EmulateError> {
        let rate_hz = options.twin.electronics.frame_rate_hz;
        let emulator = Emulator::new(pipeline.skin().design(), options)?;
        let mut stream = Stream::new(pipeline.skin())?;
        let mut decoder = Decoder::new(vec![0; dermis_wire::packet_bytes(dermis_wire::LONGEST_MESSAGE)]);
        decoder.feed(&emulator.hello_packet((1e3 * rate_hz) as u32), |received| {
            if let Received::Message(message) = received
                && let Ok(ToHost::Hello(hello)) = ToHost::parse(message)
            {
                stream.hello(&hello);
            }
        });
        Ok(OfflineSession { emulator, stream, pipeline, next: 0, damaged: 0, decoder, rate_hz })
    }

    /// The device time of the next frame, s.
    pub fn time_s(&self) -> f64 {
        self.next as f64 / self.rate_hz
    }

    /// The presses at the time of the next frame.
    pub fn presses(&self) -> Vec<Press> {
        self.emulator.presses(self.time_s())
    }

    /// The next frame; `None` if the stream refuses it.
    ///
    /// # Errors
    /// A failure of the twin or of the pipeline.
    pub fn frame(&mut self) -> Result<Option<PipelineFrame>, EmulateError> {
        let packet = self.emulator.frame_packet(self.next)?;
        let incoming = self.receive(&packet, self.next).pop();
        self.next += 1;
        Ok(incoming.map(|incoming| self.pipeline.process(incoming.input)).transpose()?)
    }

    /// The frames in bytes that arrive at the time of frame `index`.
    pub fn receive(&mut self, bytes: &[u8], index: u64) -> Vec<IncomingFrame> {
        let received_at = START.after(Duration::from_secs_f64(index as f64 / self.rate_hz));
        let OfflineSession { stream, decoder, damaged, .. } = self;
        let mut incoming = Vec::new();
        decoder.feed(bytes, |received| match received {
            Received::Message(message) => {
                if let Ok(ToHost::Frame(frame)) = ToHost::parse(message) {
                    incoming.extend(stream.frame(&frame, message, received_at));
                }
            }
            Received::Damaged => *damaged += 1,
        });
        incoming
    }

    /// Prepares the method again if the masked channels have changed. Without enough channels the method stays: the
    /// frames are invalid.
    pub fn rebuild(&mut self) {
        if self.pipeline.wants_rebuild()
            && let Ok(rebuilt) = self.pipeline.rebuild_job().run()
        {
            self.pipeline.install_method(rebuilt);
        }
    }
}
