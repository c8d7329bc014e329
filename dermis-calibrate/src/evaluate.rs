//! Measured presses, and the score of a calibration against them.

use crate::{CalibrateError, Calibration, Label, LabelFrame, Located};
use dermis::contact::Contact;
use dermis::frame::{EvaluatedPress, Frame, PressEstimate, Truth, read_truth};
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::skin::Skin;
use dermis::stats::{ForceErrors, Summary};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Measured presses, one per frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Presses {
    path: PathBuf,
    positions_m: Vec<Point3>,
    forces_n: Vec<f64>,
    frame: LabelFrame,
}

impl Presses {
    /// Reads the presses of some frames from a file: [`read_truth`].
    ///
    /// # Errors
    /// As [`read_truth`]; a frame without exactly one press.
    pub fn read(path: &Path, skin: &Skin, frame_count: usize) -> Result<Self, CalibrateError> {
        let limits = skin.place_limits();
        let path = path.to_path_buf();
        match read_truth(&path, &limits, frame_count).map_err(CalibrateError::Table)? {
            Truth::Elsewhere { positions_m, forces_n } => {
                Ok(Presses { path, positions_m, forces_n, frame: LabelFrame::Robot })
            }
            Truth::OnSkin(frames) => {
                let one = |(frame, touches): (usize, Vec<Contact>)| match &touches[..] {
                    [touch] => Ok((touch.position_m, touch.force_n)),
                    _ => Err(CalibrateError::NotOnePress { path: path.clone(), frame, touches: touches.len() }),
                };
                let presses: Result<Vec<_>, _> = frames.into_iter().enumerate().map(one).collect();
                let (positions_m, forces_n) = presses?.into_iter().unzip();
                Ok(Presses { path, positions_m, forces_n, frame: LabelFrame::Skin })
            }
        }
    }

    /// The position of the press of each frame, m.
    pub fn positions_m(&self) -> &[Point3] {
        &self.positions_m
    }

    /// Their coordinate frame.
    pub fn frame(&self) -> LabelFrame {
        self.frame
    }

    /// Only the presses of some rows, in their order: those of frames that are used.
    ///
    /// # Panics
    /// A row that does not exist.
    #[must_use]
    pub fn of_rows(mut self, rows: &[usize]) -> Self {
        self.positions_m = rows.iter().map(|&row| self.positions_m[row]).collect();
        self.forces_n = rows.iter().map(|&row| self.forces_n[row]).collect();
        self
    }

    /// The presses of some rows.
    ///
    /// # Panics
    /// A row that does not exist.
    pub fn labels(&self, rows: &[usize]) -> Vec<Label> {
        let label = |&row: &usize| Label { row, position_m: self.positions_m[row], force_n: self.forces_n[row] };
        rows.iter().map(label).collect()
    }
}

/// The score of a calibration.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CalibrationScore {
    /// Number of presses.
    pub presses: usize,
    /// Distances between the presses and their estimates, m.
    pub localisation_m: Summary,
    /// Share of the 95 % regions that contain the true position.
    pub covered: f64,
    /// Frames that are unlike every labelled one.
    pub unlike: usize,
    /// Forces against the true ones; `None` (in JSON `null`) if either are not known.
    pub force: Option<ForceErrors>,
}

impl Calibration {
    /// Locates the presses of a recording, and compares those of some rows with the truth. The recording is the one of the
    /// labels, or begins as it does: rows have the same numbers.
    ///
    /// ```no_run
    /// use dermis::frame::Frame;
    /// use dermis::skin::Skin;
    /// use dermis_calibrate::{CalibrateError, Calibration, Presses};
    ///
    /// fn mean_error_m(skin: &Skin, differences: &[Frame]) -> Result<f64, CalibrateError> {
    ///     let calibration = Calibration::load("my-skin".as_ref(), skin.design())?;
    ///     let presses = Presses::read("truth.csv".as_ref(), skin, differences.len())?;
    ///     let (score, _) = calibration.evaluate(skin, differences, &presses, &[2000, 2001, 2002])?;
    ///     Ok(score.localisation_m.mean)
    /// }
    /// ```
    ///
    /// # Errors
    /// Presses in another frame of reference than the labels; as [`Calibration::locate`].
    pub fn evaluate(
        &self,
        skin: &Skin,
        frames: &[Frame],
        presses: &Presses,
        rows: &[usize],
    ) -> Result<(CalibrationScore, Vec<EvaluatedPress>), CalibrateError> {
        let is_robot = self.pose().is_some();
        if is_robot != (presses.frame == LabelFrame::Robot) {
            return Err(CalibrateError::OtherFrame { path: presses.path.clone(), is_robot });
        }
        let mut labels = presses.labels(rows);
        let located = self.locate(frames, 0)?;
        if is_robot {
            // How deep the robot pressed is no position on the skin.
            labels.iter_mut().for_each(|label| label.position_m[2] = located[label.row].position_m[2]);
        }
        let evaluated: Vec<EvaluatedPress> =
            labels.iter().map(|label| self.evaluated(skin, label, &located[label.row])).collect();
        let pairs = || evaluated.iter().filter_map(|press| Some((&press.truth, press.estimate.as_ref()?)));
        let errors_m: Vec<f64> = pairs().map(|(_, estimate)| estimate.error_m).collect();
        let ratios = pairs().map(|(truth, estimate)| estimate.contact.force_n / truth.force_n);
        let count = |is: &dyn Fn(&Label) -> bool| labels.iter().filter(|label| is(label)).count();
        let score = CalibrationScore {
            presses: labels.len(),
            localisation_m: Summary::of(&errors_m),
            covered: count(&|label| located[label.row].region_contains(label.position_m)) as f64 / labels.len() as f64,
            unlike: count(&|label| self.is_unlike(&located[label.row])),
            force: ForceErrors::of(&ratios.filter(|ratio| ratio.is_finite()).collect::<Vec<f64>>()),
        };
        Ok((score, evaluated))
    }

    /// A press with its estimate.
    fn evaluated(&self, skin: &Skin, label: &Label, located: &Located) -> EvaluatedPress {
        let normal = |position_m: Point3| skin.design().body.surface().normal(position_m).unwrap_or(located.normal);
        let at = |position_m: Point3, force_n: f64| Contact::truth(position_m, normal(position_m), force_n);
        let [force_n, force_sd_n] = self.force_n(located);
        let (sd_m, confidence) = (located.sd_m(), located.confidence);
        let contact = Contact { sd_m, confidence, force_sd_n, ..at(located.position_m, force_n) };
        let estimate = PressEstimate {
            misfit: located.misfit,
            unlike: Some(self.is_unlike(located)),
            ..PressEstimate::new(contact, distance(located.position_m, label.position_m))
        };
        EvaluatedPress { row: label.row, truth: at(label.position_m, label.force_n), estimate: Some(estimate) }
    }
}
