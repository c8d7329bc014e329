//! The devices of a robot, of which some or all are simulated.

use crate::EmulateError;
use crate::emulator::Emulator;
use dermis::design::SkinDesign;
use dermis::pipeline::Settings;
use dermis_live::device::Address;
use dermis_live::robot::RobotLive;
use dermis_live::{LiveError, LiveOptions, clock};
use dermis_robot::{JointSource, Robot};
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Interval of simulated joint states.
pub const SWING_EVERY: Duration = Duration::from_millis(10);
/// Amplitude, rad or m, and period, s, of simulated joints: slow enough for any robot.
const SWING: [f64; 2] = [0.1, 6.0];

/// The devices of a robot. Simulated ones end with it.
pub struct RobotDevices {
    emulators: Vec<Arc<Emulator>>,
    is_simulated: bool,
    swings: bool,
    begun: Instant,
    swung: Option<Instant>,
}

impl RobotDevices {
    /// Devices, all of which are simulated or only those whose source is `emulate`.
    pub fn new(is_simulated: bool) -> Self {
        RobotDevices { emulators: Vec::new(), is_simulated, swings: is_simulated, begun: Instant::now(), swung: None }
    }

    /// How a skin is read, by index; `None` if another program reads it. `emulator` makes its simulated device for a serial number:
    /// that of the file, or the skin's place from 1. `force_tare` is [that of the settings](Settings::force_tare).
    ///
    /// # Errors
    /// A source that is no address, those of `emulator`.
    pub fn options<E: From<LiveError> + From<EmulateError>>(
        &mut self,
        robot: &Robot,
        skin: usize,
        force_tare: bool,
        emulator: impl FnOnce(&SkinDesign, u32) -> Result<Arc<Emulator>, E>,
    ) -> Result<Option<LiveOptions>, E> {
        let worn = &robot.skins()[skin];
        let address = if self.is_simulated || worn.source == "emulate" {
            let design = SkinDesign::load(&worn.design).map_err(|error| LiveError::from(dermis::Error::from(error)))?;
            let emulator = emulator(&design, worn.serial.unwrap_or(skin as u32 + 1))?;
            let address = emulator.serve_locally()?;
            self.emulators.push(emulator);
            address
        } else if worn.part().is_some() {
            return Ok(None);
        } else {
            Address::parse(&worn.source)?
        };
        let method = worn.method.clone().unwrap_or_default();
        let settings = Settings { method, force_tare, ..Settings::default() };
        Ok(Some(LiveOptions { waits: true, ..LiveOptions::new(address, settings) }))
    }

    /// The joints are moved by the program from now on.
    pub fn stop_swinging(&mut self) {
        self.swings = false;
    }

    /// Moves simulated joints: each swings about 0, a little slower than the one before. Joints whose states come from elsewhere, and
    /// those of a robot with real devices, are not simulated. To be called every [`SWING_EVERY`].
    pub fn swing(&mut self, live: &mut RobotLive) {
        let robot = Arc::clone(live.state().robot());
        let is_due = self.swung.is_none_or(|at| at.elapsed() >= SWING_EVERY);
        let Some(kinematics) = robot.kinematics() else { return };
        if !self.swings || *robot.joint_source() != JointSource::None || !is_due {
            return;
        }
        self.swung = Some(Instant::now());
        let time_s = self.begun.elapsed().as_secs_f64();
        let [amplitude, period_s] = SWING;
        let position = |joint: usize| amplitude * (TAU * time_s / (period_s + joint as f64)).sin();
        let positions: Vec<(&str, f64)> =
            kinematics.joint_names().enumerate().map(|(joint, name)| (name, position(joint))).collect();
        // The positions are of this robot, and the clock may only be set back.
        let _ = live.joints(clock::now(), &positions);
    }
}

impl Drop for RobotDevices {
    fn drop(&mut self) {
        self.emulators.iter().for_each(|emulator| emulator.stop());
    }
}
