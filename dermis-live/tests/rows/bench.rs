//! A device and a pipeline without a connection between them, frame by frame, at full speed.

use dermis::design::SkinDesign;
use dermis::geom::{Point3, Surface};
use dermis::method::MethodSet;
use dermis::pipeline::{Pipeline, PipelineFrame, Settings, Timestamp};
use dermis::skin::Skin;
use dermis_live::device::{IncomingFrame, Stream};
use dermis_live::emulator::{Emulator, EmulatorOptions, Place, Script, Stroke};
use dermis_sim::twin::TwinOptions;
use dermis_wire::{Decoder, Received, ToHost};
use std::sync::{Arc, OnceLock};

/// The paper's skin and its methods, prepared once.
pub fn methods() -> Arc<MethodSet> {
    static METHODS: OnceLock<Arc<MethodSet>> = OnceLock::new();
    let prepare = || MethodSet::new(&dermis_learn::methods(), Skin::load("cylinder30").unwrap(), None).unwrap();
    Arc::clone(METHODS.get_or_init(|| Arc::new(prepare())))
}

/// Its surface.
fn surface() -> Surface {
    methods().skin().pixels().surface
}

/// A device and a pipeline, frame by frame.
pub struct Bench {
    pub emulator: Arc<Emulator>,
    pub stream: Stream,
    pub pipeline: Pipeline,
    decoder: Decoder<Vec<u8>>,
    /// Number of the next frame.
    pub next: u64,
    rate_hz: f64,
    /// Packets that the decoder reported as damaged.
    pub damaged: u64,
}

/// Frames of the tare.
pub const TARE: u64 = 100;

impl Bench {
    /// A twin with a touch script, after its tare.
    pub fn new(twin: TwinOptions, seed: u64, touches: Vec<Stroke>, settings: Settings) -> Self {
        Self::faulty(twin, seed, touches, settings, &[])
    }

    /// The same with faults of the device.
    pub fn faulty(twin: TwinOptions, seed: u64, touches: Vec<Stroke>, settings: Settings, faults: &[&str]) -> Self {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let rate_hz = twin.electronics.frame_rate_hz;
        let script = Script { repeat_s: None, touches };
        let faults = faults.iter().map(|fault| fault.parse().unwrap()).collect();
        let options = EmulatorOptions { twin, seed, script, faults, speed: 1.0, prerendered: 0, unpaced: true };
        let emulator = Emulator::new(&design, options).unwrap();
        let pipeline = Pipeline::new(methods(), settings).unwrap();
        let mut decoder = Decoder::new(vec![0; 1 << 16]);
        let mut stream = Stream::new(methods().skin()).unwrap();
        decoder.feed(&emulator.hello_packet((1e3 * rate_hz) as u32), |received| {
            let Received::Message(message) = received else { panic!("a damaged hello") };
            let Ok(ToHost::Hello(hello)) = ToHost::parse(message) else { panic!("no hello") };
            stream.hello(&hello);
        });
        let mut bench = Bench { emulator, stream, pipeline, decoder, next: 0, rate_hz, damaged: 0 };
        (0..TARE).for_each(|_| drop(bench.frame()));
        bench
    }

    /// Processes bytes that arrive when frame `index` is due.
    pub fn hear(&mut self, bytes: &[u8], index: u64) -> Vec<IncomingFrame> {
        let at = Timestamp { unix_ns: 1_800_000_000_000_000_000 + (index as f64 / self.rate_hz * 1e9) as u64 };
        let Bench { stream, decoder, damaged, .. } = self;
        let mut heard = Vec::new();
        decoder.feed(bytes, |received| match received {
            Received::Message(message) => {
                let Ok(ToHost::Frame(frame)) = ToHost::parse(message) else { panic!("no frame") };
                heard.extend(stream.frame(&frame, message, at));
            }
            Received::Damaged => *damaged += 1,
        });
        heard
    }

    /// The next frame.
    pub fn frame(&mut self) -> PipelineFrame {
        let packet = self.emulator.frame_packet(self.next).unwrap();
        let incoming = self.hear(&packet, self.next).pop().expect("every frame is new and whole");
        self.next += 1;
        self.pipeline.process(incoming.input).unwrap()
    }

    /// The device time of the next frame, s.
    pub fn time_s(&self) -> f64 {
        self.next as f64 / self.rate_hz
    }
}

pub fn lab() -> TwinOptions {
    TwinOptions::shipped("lab").unwrap()
}

pub fn place(z_m: f64, theta_deg: f64) -> Place {
    Place::Cylinder { z_m, theta_deg }
}

pub fn stroke(at_s: f64, for_s: f64, from: Place, to: Option<Place>, force_n: f64) -> Stroke {
    Stroke { at_s, for_s, from, to, force_n, ramp_s: 0.02 }
}

pub fn surface_distance(a: Point3, b: Point3) -> f64 {
    surface().distance_m(a, b)
}

/// The position of a stroke at some time.
pub fn along(stroke: &Stroke, time_s: f64) -> Point3 {
    let part = (time_s - stroke.at_s) / stroke.for_s;
    let coordinates = |place: Place| match place {
        Place::Cylinder { z_m, theta_deg } => [z_m, theta_deg],
        Place::Space(_) => panic!("places on the cylinder"),
    };
    let (from, to) = (coordinates(stroke.from), coordinates(stroke.to.unwrap_or(stroke.from)));
    let at = [0, 1].map(|axis| from[axis] + part * (to[axis] - from[axis]));
    surface().at(at[0], at[1].to_radians()).unwrap()
}
