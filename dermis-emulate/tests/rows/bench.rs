//! A device and a pipeline without a connection between them, frame by frame, at full speed.

use dermis::geom::{Point3, Surface};
use dermis::method::{MethodSet, Methods};
use dermis::pipeline::{Pipeline, PipelineFrame, Settings};
use dermis::skin::Skin;
use dermis_emulate::emulator::{EmulatorOptions, Place, Script, Stroke};
use dermis_emulate::offline::OfflineSession;
use dermis_sim::twin::TwinOptions;
use std::ops::{Deref, DerefMut};
use std::sync::{Arc, OnceLock};

/// The paper's skin and its methods, prepared once.
pub fn methods() -> Arc<MethodSet> {
    static METHODS: OnceLock<Arc<MethodSet>> = OnceLock::new();
    let skin = || Skin::load("cylinder30").unwrap();
    let prepare = || MethodSet::new(&dermis_learn::methods(), skin(), Some(Methods::REFINED)).unwrap();
    Arc::clone(METHODS.get_or_init(|| Arc::new(prepare())))
}

/// Its surface.
fn surface() -> Surface {
    methods().skin().pixels().surface
}

/// A session that receives every frame.
pub struct Bench(OfflineSession);

/// Frames of the tare.
pub const TARE: u64 = 100;

impl Bench {
    /// A twin with a touch script, after its tare.
    pub fn new(twin: TwinOptions, seed: u64, touches: Vec<Stroke>, settings: Settings) -> Self {
        Self::faulty(twin, seed, touches, settings, &[])
    }

    /// The same with faults of the device.
    pub fn faulty(twin: TwinOptions, seed: u64, touches: Vec<Stroke>, settings: Settings, faults: &[&str]) -> Self {
        let mut bench = Self::before_the_tare(twin, seed, touches, settings, faults);
        (0..TARE).for_each(|_| drop(bench.frame()));
        bench
    }

    /// The same before its tare.
    pub fn before_the_tare(
        twin: TwinOptions,
        seed: u64,
        touches: Vec<Stroke>,
        settings: Settings,
        faults: &[&str],
    ) -> Self {
        let script = Script { repeat_s: None, touches };
        let faults = faults.iter().map(|fault| fault.parse().unwrap()).collect();
        let options = EmulatorOptions { twin, seed, script, faults, speed: 1.0, prerendered: 0, unpaced: true };
        Bench(OfflineSession::new(options, Pipeline::new(methods(), settings).unwrap()).unwrap())
    }

    /// The next frame.
    pub fn frame(&mut self) -> PipelineFrame {
        self.changed(|_| ())
    }

    /// The next frame with other values, ohm.
    pub fn changed(&mut self, change: impl FnOnce(&mut Vec<f64>)) -> PipelineFrame {
        let index = self.next;
        let packet = self.emulator.frame_packet(index).unwrap();
        let mut incoming = self.receive(&packet, index).pop().expect("every frame is new and whole");
        self.next += 1;
        change(&mut incoming.input.measurement.values_ohm);
        self.pipeline.process(incoming.input).unwrap()
    }
}

impl Deref for Bench {
    type Target = OfflineSession;

    fn deref(&self) -> &OfflineSession {
        &self.0
    }
}

impl DerefMut for Bench {
    fn deref_mut(&mut self) -> &mut OfflineSession {
        &mut self.0
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
