//! The frames of one device, with faults after each other.

use crate::LiveError;
use crate::campaign::CampaignOptions;
use crate::campaign::draw::{Drawn, end_s};
use crate::campaign::score::{Score, Scorer};
use crate::device::Stream;
use crate::emulator::{Emulator, EmulatorOptions, Script};
use dermis::geom::Surface;
use dermis::method::MethodSet;
use dermis::pipeline::{Pipeline, PipelineFrame, Settings, Timestamp};
use dermis_sim::twin::Press;
use dermis_wire::{Decoder, Received, ToHost};
use std::sync::Arc;
use std::time::Duration;

/// A device and a pipeline, without a connection.
pub(super) struct Session {
    emulator: Arc<Emulator>,
    stream: Stream,
    decoder: Decoder<Vec<u8>>,
    pipeline: Pipeline,
    rate_hz: f64,
    surface: Surface,
    next: u64,
}

/// Host time of the first frame.
const START: Timestamp = Timestamp { unix_ns: 1_800_000_000_000_000_000 };

impl Session {
    /// A device with some faults.
    pub(super) fn new(
        methods: &Arc<MethodSet>,
        options: &CampaignOptions,
        faults: &[Drawn],
        device: u64,
    ) -> Result<Self, LiveError> {
        let design = methods.skin().design();
        let seed = options.seed.wrapping_mul(1000).wrapping_add(device);
        let script = Script::load("random", design, &options.twin, seed)?;
        let faults = faults.iter().flat_map(|drawn| drawn.faults.clone()).collect();
        let twin = options.twin.clone();
        let rate_hz = twin.electronics.frame_rate_hz;
        let emulator = Emulator::new(
            design,
            EmulatorOptions { twin, seed, script, faults, speed: 1.0, prerendered: 0, unpaced: true },
        )?;
        let mut stream = Stream::new(methods.skin())?;
        let mut decoder = Decoder::new(vec![0; dermis_wire::packet_bytes(dermis_wire::LONGEST_MESSAGE)]);
        decoder.feed(&emulator.hello_packet((1e3 * rate_hz) as u32), |received| {
            if let Received::Message(message) = received
                && let Ok(ToHost::Hello(hello)) = ToHost::parse(message)
            {
                stream.hello(&hello);
            }
        });
        let settings = Settings { method: options.method.clone(), ..Settings::default() };
        let pipeline = Pipeline::new(Arc::clone(methods), settings)?;
        Ok(Session { emulator, stream, decoder, pipeline, rate_hz, surface: design.body.surface(), next: 0 })
    }

    /// Runs all faults; returns a score for each.
    pub(super) fn run(mut self, faults: &[Drawn]) -> Result<Vec<Score>, LiveError> {
        let mut scores = Vec::new();
        let mut index = 0;
        while let Some(fault) = faults.get(index) {
            let mut scorer = Scorer::new(fault, self.surface);
            while self.time_s() < end_s(index) {
                let (time_s, presses) = (self.time_s(), self.presses());
                if let Some(frame) = self.frame()? {
                    scorer.take(time_s, &frame, &presses);
                }
            }
            scores.push(scorer.finish());
            index += 1;
        }
        Ok(scores)
    }

    fn time_s(&self) -> f64 {
        self.next as f64 / self.rate_hz
    }

    fn presses(&self) -> Vec<Press> {
        self.emulator.presses(self.time_s())
    }

    /// The next frame; `None` if it is refused.
    fn frame(&mut self) -> Result<Option<PipelineFrame>, LiveError> {
        let packet = self.emulator.frame_packet(self.next)?;
        let received_at = START.after(Duration::from_secs_f64(self.time_s()));
        self.next += 1;
        let Session { stream, decoder, .. } = self;
        let mut incoming = None;
        decoder.feed(&packet, |received| {
            if let Received::Message(message) = received
                && let Ok(ToHost::Frame(frame)) = ToHost::parse(message)
            {
                incoming = stream.frame(&frame, message, received_at);
            }
        });
        let Some(incoming) = incoming else { return Ok(None) };
        let frame = self.pipeline.process(incoming.input)?;
        if self.pipeline.wants_rebuild() {
            // Without enough channels the frames are invalid anyway.
            if let Ok(rebuilt) = self.pipeline.rebuild_job().run() {
                self.pipeline.install_method(rebuilt);
            }
        }
        Ok(Some(frame))
    }
}
