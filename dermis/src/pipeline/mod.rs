//! From frames to contacts, frame by frame: baseline, drift, touch detection, electrode health, tracking.
//!
//! The output of a [`Pipeline`] depends only on its frames and commands: it has no input or output of its own, no
//! threads and no clock. The same frames and commands in the same order give the same contacts, to the last bit.
//!
//! Work that takes longer than a frame is given to the caller: a pipeline that [wants it](Pipeline::wants_rebuild) has its
//! method prepared again by a [job](Pipeline::rebuild_job), on any thread.
//!
//! A robot prepares a skin and a pipeline once, and passes each frame to it as it is measured. In this example a
//! simulated press replaces the instrument:
//!
//! ```
//! use dermis::method::{MethodSet, Methods};
//! use dermis::pipeline::{FrameInput, Pipeline, Settings, Timestamp};
//! use dermis::skin::Skin;
//! # use dermis_sim::{noise::Noise, random::sample_rng, touch::{GaussianTouch, touched_conductivity}};
//!
//! let skin = Skin::load("skin16")?;
//! let methods = MethodSet::new(&Methods::linear(), skin.clone(), None)?;
//! let mut pipeline = Pipeline::new(methods.into(), Settings::default())?; // a tare of 100 frames, then contacts
//!
//! # let (design, rest) = (skin.design(), skin.forward().rest_conductivity());
//! # let press = GaussianTouch { centre_m: [0.02, 0.0, 0.0], amplitude: 0.5, width_m: 0.01 };
//! # let pressed = touched_conductivity(skin.mesh(), &design.body.surface(), design.sheet.touch, rest, &[press])?;
//! # let frames = [skin.forward().solve(rest)?, skin.forward().solve(&pressed)?];
//! # let noise = Noise::at_snr_db(70.0, &frames[0], &design.protocol, f64::INFINITY)?;
//! # let (_, drive_of) = design.protocol.drives();
//! # let measure = |index: u64| {
//! #     // The instrument of this skin measures amplitudes.
//! #     let frame = noise.apply(&frames[usize::from(index >= 100)], &drive_of, &mut sample_rng(7, index));
//! #     frame.iter().map(|value| value.abs()).collect::<Vec<f64>>()
//! # };
//! let mut contacts = Vec::new();
//! for index in 0..110 {
//!     let values_ohm = measure(index); // the instrument, pressed from frame 100 on
//!     let measured_at = Timestamp { unix_ns: index * 8_333_333 };
//!     let frame = pipeline.process(FrameInput::new(index, measured_at, values_ohm))?;
//!     contacts = frame.contacts; // position, normal, force, id: see TrackedContact
//! }
//! assert_eq!(contacts.len(), 1);
//! let [x_m, y_m, _] = contacts[0].contact.position_m;
//! assert!((x_m - 0.02).abs() < 0.005 && y_m.abs() < 0.005);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod baseline;
mod cause;
mod common_mode;
mod condition;
mod contact;
mod degradation;
mod drift;
mod electrodes;
mod error;
mod frame;
mod health;
mod instrument;
mod matched_filter;
mod novelty;
mod process;
mod read;
mod rebuild;
mod repeats;
mod reports;
mod settings;
mod state;
mod statistics;
mod tare;
mod timestamp;
mod touch_detector;
mod trial;
mod validity;

pub use contact::TrackedContact;
pub use degradation::{Cost, Degradation, Loss};
pub use drift::{DriftFit, DriftFitJob};
pub use error::PipelineError;
pub use frame::{Counts, FrameInput, Measurement, PipelineFrame};
pub use health::{ElectrodeHealth, ElectrodeState, Health, Notice};
pub use process::GAP_S;
pub use rebuild::{RebuildJob, RebuiltMethod};
pub use settings::{Command, Settings, Zone};
pub use state::State;
pub use timestamp::Timestamp;
pub use validity::{InvalidReason, Validity};

pub use crate::finding::Severity;

use crate::detect::{Detector, ImageNoise};
use crate::estimate::reciprocal_pairs::ReciprocalPairs;
use crate::image::Image;
use crate::method::{Method, MethodSet};
use crate::pipeline::common_mode::CommonMode;
use crate::pipeline::drift::{DriftFitter, OF_SHEET, modes_of};
use crate::pipeline::electrodes::ElectrodeTopology;
use crate::pipeline::matched_filter::MatchedFilter;
use crate::pipeline::reports::Reports;
use crate::pipeline::state::Phase;
use crate::skin::Skin;
use crate::track::{TrackOptions, Tracker};
use std::num::NonZeroU32;
use std::sync::Arc;

/// Computes contacts from frames.
#[derive(Debug)]
pub struct Pipeline {
    methods: Arc<MethodSet>,
    fitter: DriftFitter,
    common_mode: CommonMode,
    topology: ElectrodeTopology,
    state: State,
    /// The method in use, without the state's masked channels.
    method: Method,
    /// Channels of parts that are confirmed as bad.
    masked: Vec<bool>,
    /// What the channels cost that the method was prepared without.
    cost: Option<Cost>,
    reports: Reports,
    /// The test for weak touches; `None` during a tare.
    filter: Option<Arc<MatchedFilter>>,
    /// Why the last frames of the tare make no baseline.
    refusal: Option<tare::Refusal>,
    detector: Detector,
    /// The noise of untouched images.
    noise: Option<ImageNoise>,
    /// The method's own threshold.
    noise_factor: f64,
    image: Image,
    health: Arc<Health>,
    notices: Vec<Notice>,
}

impl Pipeline {
    /// A pipeline that starts with a tare.
    ///
    /// # Errors
    /// An unknown method, a setting out of its range.
    pub fn new(methods: Arc<MethodSet>, settings: Settings) -> Result<Self, PipelineError> {
        let phase = Phase::Taring { frames: Vec::new() };
        let (pixels, design) = (methods.skin().pixels(), methods.skin().design());
        let tracker = Tracker::on(pixels, TrackOptions::for_skin(pixels, design.electrodes.len()));
        let state = State {
            settings,
            device_serial: None,
            phase,
            start: None,
            last: None,
            frames: 0,
            method_masked: Vec::new(),
            method_adapted: false,
            tracker,
        };
        Self::resume(methods, state)
    }

    /// A pipeline that continues from a state.
    ///
    /// # Errors
    /// An unknown method, a setting out of its range, a state of another skin.
    pub fn resume(methods: Arc<MethodSet>, mut state: State) -> Result<Self, PipelineError> {
        let skin = methods.skin();
        state.settings.check(skin)?;
        let topology = ElectrodeTopology::of(skin, &state.settings.left_out_electrodes);
        let fitter = DriftFitter::new(skin.clone())?;
        state.restore(&topology);
        state.check(&topology, fitter.modes().rows)?;
        let method = state.settings.method_of(&methods, &state.settings.method)?.clone();
        state.settings.method = method.name().into();
        let masked = match &state.phase {
            Phase::Reading(reading) => reading.marks(&topology).confirmed,
            Phase::Taring { .. } => vec![false; topology.channel_count()],
        };
        let mut pipeline = Pipeline {
            common_mode: CommonMode::of(skin)?,
            masked,
            cost: None,
            reports: Reports::default(),
            filter: None,
            refusal: None,
            image: Image::zeros(skin.pixels()),
            detector: Detector::default(),
            noise: None,
            noise_factor: 0.0,
            health: Arc::default(),
            notices: Vec::new(),
            fitter,
            topology,
            method,
            state,
            methods,
        };
        if let Phase::Reading(reading) = &pipeline.state.phase {
            let noise_ohm = reading.electrodes.noise_ohm();
            pipeline.filter = Some(pipeline.filter_of(&reading.rest_ohm, noise_ohm, &reading.untouched)?);
        }
        let masked = pipeline.state.method_masked.clone();
        let rest_ohm = pipeline.adaptation_ohm().filter(|_| pipeline.state.method_adapted).map(<[f64]>::to_vec);
        match masked.is_empty() && rest_ohm.is_none() {
            true => pipeline.measure_noise()?,
            false => {
                let rebuilt = RebuildJob { masked, rest_ohm, ..pipeline.rebuild_job() }.run()?;
                pipeline.use_method(rebuilt);
            }
        }
        Ok(pipeline)
    }

    /// The complete state, to be stored; [`resume`](Self::resume) continues from it.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The skin.
    pub fn skin(&self) -> &Skin {
        self.methods.skin()
    }

    /// The methods that can be selected.
    pub fn methods(&self) -> &Arc<MethodSet> {
        &self.methods
    }

    /// The method in use.
    pub fn method(&self) -> &Method {
        &self.method
    }

    /// Removes and returns the notices since the last call.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        std::mem::take(&mut self.notices)
    }

    /// The channels masked now: those of electrodes, drives and channels that are confirmed as bad.
    pub fn masked_channels(&self) -> Vec<usize> {
        marked(&self.masked)
    }

    /// Whether the method should be [prepared again](Command::Rebuild): the masked channels have changed, or a tare has
    /// ended and the method [depends on it](crate::reconstruct::Reconstruct::is_adaptable). Until then the frames are
    /// processed with the method as it is.
    pub fn wants_rebuild(&self) -> bool {
        let is_due = self.adaptation_ohm().is_some() && !self.state.method_adapted;
        is_due || self.state.method_masked != self.masked_channels()
    }

    /// The job of [`Command::Rebuild`], to be run outside the pipeline; pass its result to
    /// [`install_method`](Self::install_method). Where the masked channels have changed, the method is first prepared without
    /// them, which is quick, and [wanted](Self::wants_rebuild) once more to be adapted to the tare.
    pub fn rebuild_job(&self) -> RebuildJob {
        let masked = self.masked_channels();
        let is_quick = self.state.method_masked != masked;
        RebuildJob {
            methods: Arc::clone(&self.methods),
            name: self.method.name().into(),
            untouched: self.state.phase.untouched().to_vec(),
            rest_ohm: self.adaptation_ohm().filter(|_| !is_quick).map(<[f64]>::to_vec),
            masked,
            noise_ohm: self.state.phase.noise_ohm().to_vec(),
        }
    }

    /// Uses a method that was prepared again, unless the method, the masked channels or the tare have changed since;
    /// returns whether it is used.
    pub fn install_method(&mut self, rebuilt: RebuiltMethod) -> bool {
        let is_wanted = rebuilt.masked == self.masked_channels()
            && rebuilt.method.name() == self.method.name()
            && (rebuilt.rest_ohm.is_none() || rebuilt.rest_ohm.as_deref() == self.adaptation_ohm());
        if is_wanted {
            self.use_method(rebuilt);
        }
        is_wanted
    }

    /// The mean of the tare's frames, ohm, if the method depends on it.
    fn adaptation_ohm(&self) -> Option<&[f64]> {
        self.state.phase.rest_ohm().filter(|_| self.method.reconstruct().is_adaptable())
    }

    fn use_method(&mut self, rebuilt: RebuiltMethod) {
        self.method = rebuilt.method;
        self.state.method_masked = rebuilt.masked;
        self.state.method_adapted = rebuilt.rest_ohm.is_some();
        self.noise = rebuilt.noise;
        self.cost = rebuilt.cost;
        self.prepare_detector();
    }

    /// A computation that will be needed half a second later, to be run outside the pipeline; pass its result to
    /// [`install_drift_fit`](Self::install_drift_fit). If the result is not there in time, the pipeline computes it
    /// itself.
    pub fn drift_fit_job(&mut self) -> Option<DriftFitJob> {
        self.fitter.job()
    }

    /// Takes the result of a [`DriftFitJob`]. It saves time and does not change the contacts.
    pub fn install_drift_fit(&mut self, fit: DriftFit) {
        self.fitter.install(fit);
    }

    /// Executes a command.
    ///
    /// # Errors
    /// An unknown method, a setting out of its range.
    pub fn command(&mut self, command: &Command) -> Result<(), PipelineError> {
        match command {
            Command::Tare => self.begin_tare(),
            Command::Device { serial } => self.use_device(*serial),
            Command::Threshold { value } => self.set(Settings { threshold: *value, ..self.state.settings.clone() })?,
            Command::Zones { zones } => self.set(Settings { zones: zones.clone(), ..self.state.settings.clone() })?,
            Command::Method { name } => {
                self.method = self.state.settings.method_of(&self.methods, name)?.clone();
                self.forget_preparation();
                self.state.settings.method = self.method.name().into();
                self.measure_noise()?;
            }
            Command::Rebuild => drop(self.install_method(self.rebuild_job().run()?)),
        }
        Ok(())
    }

    /// Begins to measure the baseline.
    fn begin_tare(&mut self) {
        self.state.tracker.clear();
        self.state.phase = Phase::Taring { frames: Vec::new() };
    }

    /// The baseline of another device is not used.
    fn use_device(&mut self, serial: NonZeroU32) {
        let before = self.state.device_serial.replace(serial);
        let Some(before) = before.filter(|before| *before != serial) else { return };
        let text = format!(
            "the device is number {serial}, the baseline is of number {before}: it is not used, and the skin is tared again. \
             Leave it untouched until then"
        );
        self.notice(Severity::Warning, text, self.state.last.unwrap_or(Timestamp { unix_ns: 0 }));
        self.begin_tare();
    }

    fn set(&mut self, settings: Settings) -> Result<(), PipelineError> {
        settings.check(self.skin())?;
        self.state.settings = settings;
        self.prepare_detector();
        Ok(())
    }

    /// Prepares the detector for the method, the thresholds and the noise.
    fn prepare_detector(&mut self) {
        let mut options = self.method.reconstruct().detection();
        self.noise_factor = options.noise_factor;
        options.noise_factor *= self.state.settings.lowest_threshold() * TrackOptions::default().release_fraction;
        let mut detector = Detector::new(options);
        if self.state.settings.both_signs {
            detector = detector.with_both_signs(self.skin().design().sheet.touch.change());
        }
        if let Phase::Reading(reading) = &self.state.phase {
            let protocol = &self.methods.skin().design().protocol;
            let pairs = ReciprocalPairs::new(protocol, reading.electrodes.noise_ohm());
            detector = detector.with_reciprocal_pairs(pairs.with_rest(&reading.rest_ohm));
        }
        self.detector = match &self.noise {
            Some(noise) => detector.with_noise(noise.clone()),
            None => detector,
        };
    }

    /// The test for weak touches, from the mean of a tare, its noise and its differences from the mean.
    fn filter_of(
        &self,
        rest_ohm: &[f64],
        noise_ohm: &[f64],
        untouched: &[Vec<f64>],
    ) -> Result<Arc<MatchedFilter>, PipelineError> {
        let modes = modes_of(self.fitter.modes(), rest_ohm);
        // Of a skin that is unlike its model only the drift of all values alike is known.
        let of_sheet = if self.state.settings.force_tare { 1 } else { OF_SHEET };
        Ok(Arc::new(MatchedFilter::new(self.methods.skin(), &modes, of_sheet, noise_ohm, untouched)?))
    }

    /// Measures the noise of the method's images, from the frames of the tare.
    fn measure_noise(&mut self) -> Result<(), PipelineError> {
        let (untouched, masked) = (self.state.phase.untouched(), &self.state.method_masked);
        let protocol = &self.methods.skin().design().protocol;
        self.noise = rebuild::noise_without(&self.method, untouched, masked, protocol)?;
        self.prepare_detector();
        Ok(())
    }

    /// The method in use is one for all channels and of no tare.
    fn forget_preparation(&mut self) {
        self.state.method_masked.clear();
        self.state.method_adapted = false;
        self.cost = None;
    }
}

/// The indices of marked channels.
fn marked(channels: &[bool]) -> Vec<usize> {
    (0..channels.len()).filter(|&channel| channels[channel]).collect()
}
