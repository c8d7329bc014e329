//! `dermis.Robot`: several skins on the links of one robot.

use crate::arrays;
use crate::failure::{Failure, Outcome};
use crate::pipeline::{Frame, Notices, emulator, time};
use crate::worker;
use dermis_calibrate::Calibration;
use dermis_emulate::robot::{RobotDevices, SWING_EVERY};
use dermis_live::robot::{self as live, RobotOptions, RobotOutput};
use dermis_robot::{Kinematics, Pose, Posture, RobotState, WornSkin};
use dermis_sim::twin::TwinOptions;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

#[doc = stub_doc!(Robot)]
#[pyclass(frozen, module = "dermis")]
pub struct Robot {
    robot: Arc<dermis_robot::Robot>,
    state: Mutex<RobotState>,
}

impl Robot {
    fn state(&self) -> MutexGuard<'_, RobotState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn kinematics(&self) -> Outcome<&Kinematics> {
        let fix = "write description = \"robot.urdf\" in its file";
        self.robot.kinematics().ok_or_else(|| Failure::with_hint("the robot has no description", fix))
    }

    /// A value of each skin by its name, in the order of the file.
    fn of_skins<'py, 'a, T: IntoPyObject<'py>>(
        &'a self,
        py: Python<'py>,
        value: impl Fn(&'a WornSkin) -> T,
    ) -> Outcome<Bound<'py, PyDict>> {
        Ok(self.robot.skins().iter().map(|skin| (skin.name.as_str(), value(skin))).into_py_dict(py)?)
    }

    /// The index of a skin.
    fn skin(&self, skin: &str) -> Outcome<usize> {
        self.robot.skin(skin).ok_or_else(|| {
            let names: Vec<&str> = self.robot.skins().iter().map(|skin| skin.name.as_str()).collect();
            Failure::with_hint(format!("the robot has no skin `{skin}`"), &format!("one of {}", names.join(", ")))
        })
    }

    /// The robot at positions by joint, and a link.
    fn at(&self, link: &str, positions: &BTreeMap<String, f64>) -> Outcome<(Posture<'_>, [usize; 2])> {
        let kinematics = self.kinematics()?;
        let unknown = positions.keys().find(|name| kinematics.joint_names().all(|joint| joint != name.as_str()));
        if let Some(name) = unknown {
            return Err(Failure::given(format!("the robot has no joint `{name}` with a position of its own")));
        }
        let link_of =
            |name: &str| kinematics.link(name).ok_or_else(|| Failure::given(format!("the robot has no link `{name}`")));
        let base = link_of(self.robot.base().unwrap_or_default())?;
        let values: Vec<f64> =
            kinematics.joint_names().map(|name| positions.get(name).copied().unwrap_or(f64::NAN)).collect();
        Ok((kinematics.posture(&values), [base, link_of(link)?]))
    }
}

#[pymethods]
impl Robot {
    #[new]
    fn new(path: PathBuf) -> Outcome<Self> {
        let robot = Arc::new(dermis_robot::Robot::load(&path)?);
        Ok(Robot { state: Mutex::new(RobotState::new(Arc::clone(&robot))), robot })
    }

    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        self.robot.name()
    }

    /// The link whose frame is the base; None without a robot description.
    #[getter]
    fn base(&self) -> Option<&str> {
        self.robot.base()
    }

    /// The designs of its skins, by name.
    #[getter]
    fn skins<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyDict>> {
        self.of_skins(py, |skin| skin.design.as_str())
    }

    /// The links that wear its skins, by name of the skin.
    #[getter]
    fn skin_links<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyDict>> {
        self.of_skins(py, |skin| skin.link.as_str())
    }

    /// The methods of its skins, by name; None for the best one of the skin.
    #[getter]
    fn skin_methods<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyDict>> {
        self.of_skins(py, |skin| skin.method.as_deref())
    }

    #[doc = stub_doc!(Robot.origin)]
    fn origin<'py>(&self, py: Python<'py>, skin: &str) -> Outcome<Bound<'py, PyAny>> {
        matrix(py, &self.robot.skins()[self.skin(skin)?].origin)
    }

    /// Its links.
    #[getter]
    fn links(&self) -> Vec<&str> {
        self.robot
            .kinematics()
            .map_or_else(Vec::new, |kinematics| kinematics.links().iter().map(String::as_str).collect())
    }

    /// The joints that have positions, in the order of the columns of Jacobians.
    #[getter]
    fn joint_names(&self) -> Vec<&str> {
        self.robot.kinematics().map_or_else(Vec::new, |kinematics| kinematics.joint_names().collect())
    }

    #[doc = stub_doc!(Robot.joints)]
    #[pyo3(signature = (positions, time_s=None))]
    fn joints(&self, positions: BTreeMap<String, f64>, time_s: Option<f64>) -> Outcome<()> {
        let given: Vec<(&str, f64)> = positions.iter().map(|(name, position)| (name.as_str(), *position)).collect();
        self.state().joints(time(time_s)?, &given).map_err(Failure::given)
    }

    #[doc = stub_doc!(Robot.feed)]
    #[pyo3(signature = (skin, frame, time_s=None))]
    fn feed<'py>(
        &self,
        py: Python<'py>,
        skin: &str,
        frame: &Bound<'_, Frame>,
        time_s: Option<f64>,
    ) -> Outcome<Bound<'py, PyAny>> {
        let index = self.skin(skin)?;
        let design = frame.get().skin().design();
        if design.sha256() != self.robot.skins()[index].design_sha256 {
            let fix = format!("give frames of a pipeline of dermis.Skin.load(robot.skins[\"{skin}\"])");
            return Err(Failure::with_hint(
                format!("the frame is of the skin `{}`, another one than `{skin}`", design.name),
                &fix,
            ));
        }
        let events = self.state().frame(index, frame.get().frame(), time(time_s)?);
        loads(py, &events)
    }

    #[doc = stub_doc!(Robot.tick)]
    #[pyo3(signature = (time_s=None))]
    fn tick<'py>(&self, py: Python<'py>, time_s: Option<f64>) -> Outcome<Bound<'py, PyAny>> {
        let events = self.state().tick(time(time_s)?);
        loads(py, &events)
    }

    #[doc = stub_doc!(Robot.snapshot)]
    #[pyo3(signature = (time_s=None))]
    fn snapshot<'py>(&self, py: Python<'py>, time_s: Option<f64>) -> Outcome<Bound<'py, PyAny>> {
        let snapshot = self.state().snapshot(time(time_s)?);
        loads(py, &snapshot)
    }

    #[doc = stub_doc!(Robot.pose)]
    fn pose<'py>(&self, py: Python<'py>, link: &str, positions: BTreeMap<String, f64>) -> Outcome<Bound<'py, PyAny>> {
        let (posture, [base, link_index]) = self.at(link, &positions)?;
        let pose = posture.pose(base, link_index).ok_or_else(|| unknown_pose(link))?;
        matrix(py, &pose)
    }

    #[doc = stub_doc!(Robot.jacobian)]
    #[pyo3(signature = (link, positions, point_m=None))]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        link: &str,
        positions: BTreeMap<String, f64>,
        point_m: Option<[f64; 3]>,
    ) -> Outcome<Bound<'py, PyAny>> {
        if point_m.is_some_and(|point_m| point_m.iter().any(|value| !value.is_finite())) {
            return Err(Failure::given("`point_m` has to be finite"));
        }
        let (posture, [base, link_index]) = self.at(link, &positions)?;
        let jacobian =
            posture.jacobian(base, link_index, point_m.unwrap_or_default()).ok_or_else(|| unknown_pose(link))?;
        arrays::rows(py, jacobian.values, &[6, jacobian.columns], true)
    }

    #[doc = stub_doc!(Robot.live)]
    #[pyo3(signature = (*, emulate=false, rate_hz=50.0, record=None, share=None, twin="lab", touch="none"))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn live(
        &self,
        py: Python<'_>,
        emulate: bool,
        rate_hz: f64,
        record: Option<PathBuf>,
        share: Option<String>,
        twin: &str,
        touch: &str,
    ) -> Outcome<RobotLive> {
        if !(0.1..=1000.0).contains(&rate_hz) {
            return Err(Failure::given(format!("`rate_hz` is {rate_hz}: give 0.1 to 1000 snapshots a second")));
        }
        let how = RobotOptions { rate_hz, record, share, ..RobotOptions::default() };
        let is_noise_free = TwinOptions::load(twin)?.electronics.snr_db.is_none();
        let live = worker::run(py, "preparing the skins", 1, |_| {
            let mut devices = RobotDevices::new(emulate);
            let live = live::RobotLive::start(&self.robot, &dermis_learn::methods(), &how, |skin| {
                let method = self.robot.skins()[skin].method.as_deref().unwrap_or_default();
                let force_tare = Calibration::is_named(method) || emulate && is_noise_free;
                devices.options(&self.robot, skin, force_tare, |design, serial| {
                    emulator(design, twin, u64::from(serial), touch, 1.0)
                })
            })?;
            Ok::<_, Failure>(Running { live, devices })
        })?;
        let name = self.robot.name().to_string();
        Ok(RobotLive {
            running: Mutex::new(Some(live)),
            notices: Notices::default(),
            name,
            process: std::process::id(),
        })
    }

    fn __repr__(&self) -> String {
        let skins: Vec<&str> = self.robot.skins().iter().map(|skin| skin.name.as_str()).collect();
        format!("<dermis.Robot {}: {}>", self.robot.name(), skins.join(", "))
    }
}

/// A robot whose skins are read, and the simulated ones of its devices.
struct Running {
    live: live::RobotLive,
    devices: RobotDevices,
}

#[doc = stub_doc!(RobotLive)]
#[pyclass(frozen, module = "dermis")]
pub struct RobotLive {
    running: Mutex<Option<Running>>,
    notices: Notices,
    name: String,
    /// The process that has its threads: a forked child has none.
    process: u32,
}

impl RobotLive {
    /// Works with it, unless it has stopped.
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Running) -> T + Send) -> Outcome<Option<T>> {
        if self.process != std::process::id() {
            return Err(Failure::with_hint("this robot is read by another process", "open one in this process"));
        }
        Ok(py.detach(|| {
            let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
            running.as_mut().map(work)
        }))
    }
}

#[pymethods]
impl RobotLive {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__<'py>(&self, py: Python<'py>) -> Outcome<Option<Bound<'py, PyAny>>> {
        loop {
            py.check_signals()?;
            let next = self.with(py, |running| {
                running.devices.swing(&mut running.live);
                running.live.next(SWING_EVERY)
            })?;
            match next {
                None => return Ok(None),
                Some(Some(RobotOutput::Notice { skin, notice })) => {
                    let whose = skin.map(|skin| format!("{skin}: ")).unwrap_or_default();
                    self.notices.add(format!("{whose}{}", notice.text));
                }
                Some(None | Some(RobotOutput::Frame(..))) => {}
                Some(Some(output)) => return Ok(Some(loads(py, &output)?)),
            }
        }
    }

    #[doc = stub_doc!(RobotLive.joints)]
    #[pyo3(signature = (positions, time_s=None))]
    fn joints(&self, py: Python<'_>, positions: BTreeMap<String, f64>, time_s: Option<f64>) -> Outcome<()> {
        let given: Vec<(&str, f64)> = positions.iter().map(|(name, position)| (name.as_str(), *position)).collect();
        let at = time(time_s)?;
        let taken = self.with(py, |running| {
            running.devices.stop_swinging();
            running.live.joints(at, &given)
        })?;
        taken.unwrap_or(Ok(())).map_err(Failure::given)
    }

    #[doc = stub_doc!(RobotLive.tare)]
    #[pyo3(signature = (skin=None))]
    fn tare(&self, py: Python<'_>, skin: Option<&str>) -> Outcome<()> {
        let known = self.with(py, |running| {
            let is_known = skin.is_none_or(|skin| running.live.state().robot().skin(skin).is_some());
            running.live.tare(skin);
            is_known
        })?;
        match (known, skin) {
            (Some(false), Some(skin)) => Err(Failure::given(format!("the robot has no skin `{skin}`"))),
            _ => Ok(()),
        }
    }

    /// The messages since the last call: faults, skins that came back, swapped cables.
    fn notices(&self) -> Vec<String> {
        self.notices.take()
    }

    #[doc = stub_doc!(RobotLive.stop)]
    fn stop(&self, py: Python<'_>) -> Outcome<()> {
        if self.process != std::process::id() {
            return Ok(());
        }
        // Another thread may be waiting for the next item with the lock.
        let incomplete = py.detach(|| {
            let running = self.running.lock().unwrap_or_else(PoisonError::into_inner).take();
            running.and_then(|running| running.live.stop())
        });
        incomplete.map_or(Ok(()), |why| Err(Failure::given(format!("the recording is not complete: {why}"))))
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, pyo3::types::PyTuple>) -> Outcome<()> {
        self.stop(py)
    }

    fn __repr__(&self) -> String {
        format!("<dermis.RobotLive {}>", self.name)
    }
}

impl Drop for RobotLive {
    fn drop(&mut self) {
        let running = self.running.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        if self.process == std::process::id() {
            // Other threads of the interpreter go on while those of the skins end.
            Python::attach(|py| py.detach(|| running.map(|running| running.live.stop())));
        } else {
            // Threads that do not exist here cannot be joined.
            std::mem::forget(running);
        }
    }
}

/// A pose, (4, 4), m.
fn matrix<'py>(py: Python<'py>, pose: &Pose) -> Outcome<Bound<'py, PyAny>> {
    let row = |row: usize| pose.rotation[row].into_iter().chain([pose.translation_m[row]]);
    let values: Vec<f64> = (0..3).flat_map(row).chain([0.0, 0.0, 0.0, 1.0]).collect();
    arrays::rows(py, values, &[4, 4], true)
}

fn unknown_pose(link: &str) -> Failure {
    let fix = "give the position of every joint between the base and the link";
    Failure::with_hint(format!("the pose of `{link}` is unknown"), fix)
}

fn loads<'py>(py: Python<'py>, value: &impl Serialize) -> Outcome<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).map_err(Failure::given)?;
    Ok(py.import("json")?.call_method1("loads", (text,))?)
}
