//! Calibrated methods: labels, and scores in the frame of the labels.

use crate::console::{print, print_json};
use crate::failure::{Failure, Outcome};
use crate::press_report::{Estimate, EvaluatedPress};
use crate::rows::Rows;
use crate::skin::place_limits;
use dermis::contact::Contact;
use dermis::frame::{Frame, Truth, read_truth};
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::skin::Skin;
use dermis::stats::Summary;
use dermis::text::{counted, ranges};
use dermis_calibrate::{Calibration, Label, LabelFrame, Located, Pose};
use dermis_sim::evaluate::ForceErrors;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::Path;

/// Measured presses, one per frame.
pub struct Presses {
    /// The press of each frame, m.
    positions_m: Vec<Point3>,
    /// The force of each press, N; `NaN` if it is not known.
    forces_n: Vec<f64>,
    frame: LabelFrame,
}

impl Presses {
    /// Reads the presses of frames.
    pub fn read(path: &Path, skin: &Skin, frame_count: usize) -> Outcome<Self> {
        Ok(match read_truth(path, &place_limits(skin), frame_count)? {
            Truth::Elsewhere { positions_m, forces_n } => Presses { positions_m, forces_n, frame: LabelFrame::Robot },
            Truth::OnSkin(frames) => {
                let one = |(frame, touches): (usize, Vec<Contact>)| match &touches[..] {
                    [touch] => Ok((touch.position_m, touch.force_n)),
                    _ => {
                        let message = format!("{}: frame {frame} has {} touches", path.display(), touches.len());
                        Err(Failure::given(message, Some("give frames with one press each")))
                    }
                };
                let presses = frames.into_iter().enumerate().map(one).collect::<Outcome<Vec<(Point3, f64)>>>()?;
                let (positions_m, forces_n) = presses.into_iter().unzip();
                Presses { positions_m, forces_n, frame: LabelFrame::Skin }
            }
        })
    }

    /// The position of the press of each frame, m.
    pub fn positions_m(&self) -> &[Point3] {
        &self.positions_m
    }

    /// Their coordinate frame.
    pub fn frame(&self) -> LabelFrame {
        self.frame
    }

    /// The presses of some rows, which an option chooses; of all rows without a choice.
    pub fn labels(&self, rows: Option<&Rows>, option: &str) -> Outcome<Vec<Label>> {
        let all: Vec<usize>;
        let rows = match rows {
            Some(rows) => rows
                .of(self.positions_m.len())
                .map_err(|message| Failure::given(message, Some(&format!("choose other {option}"))))?,
            None => {
                all = (0..self.positions_m.len()).collect();
                &all
            }
        };
        let label = |&row: &usize| Label { row, position_m: self.positions_m[row], force_n: self.forces_n[row] };
        Ok(rows.iter().map(label).collect())
    }
}

/// The channels that are late, by the number of rows.
pub fn late_channels(lags: &[i32]) -> String {
    let late: BTreeSet<i32> = lags.iter().copied().filter(|lag| *lag != 0).collect();
    let channels = |lag: i32| (0..lags.len()).filter(|&channel| lags[channel] == lag).collect::<Vec<_>>();
    let texts: Vec<String> = late.iter().map(|&lag| format!("{} by {lag}", ranges(&channels(lag)))).collect();
    if texts.is_empty() { "none".into() } else { texts.join("; ") }
}

/// The score of a calibration.
#[derive(Debug, Serialize)]
struct CalibratedScore {
    presses: usize,
    localisation_m: Summary,
    /// Share of the 95 % regions that contain the true position.
    covered: f64,
    /// Frames that are unlike every labelled one.
    unlike: usize,
    /// Forces against the true ones; `null` if either are not known.
    force: Option<ForceErrors>,
}

/// A calibration with presses to evaluate it.
pub struct CalibratedEvaluation {
    /// The presses and their estimates.
    pub presses: Vec<EvaluatedPress>,
    /// The pose of the skin in the frame of reference of the presses; `None` for positions on the skin.
    pub pose: Option<Pose>,
    score: CalibratedScore,
}

impl CalibratedEvaluation {
    /// Locates the presses of a recording and compares some of them with the truth. The recording is the one of the
    /// labels, or begins as it does: rows have the same numbers.
    pub fn new(skin: &Skin, folder: &Path, frames: &[Frame], truth: &Path, rows: Option<&Rows>) -> Outcome<Self> {
        let calibration = Calibration::load(folder, skin.design())?;
        let presses = Presses::read(truth, skin, frames.len())?;
        check_frame(&calibration, &presses, truth)?;
        let labels = presses.labels(rows, "--rows")?;
        let located = calibration.locate(frames, 0)?;
        let presses: Vec<EvaluatedPress> =
            labels.iter().map(|label| evaluated(skin, &calibration, label, &located[label.row])).collect();
        let errors_m: Vec<f64> =
            presses.iter().filter_map(|press| press.estimate.as_ref()).map(|estimate| estimate.error_m).collect();
        let count = |is: &dyn Fn(&Label) -> bool| labels.iter().filter(|label| is(label)).count();
        let score = CalibratedScore {
            presses: labels.len(),
            localisation_m: Summary::of(&errors_m),
            covered: count(&|label| located[label.row].region_contains(label.position_m)) as f64 / labels.len() as f64,
            unlike: count(&|label| calibration.is_unlike(&located[label.row])),
            force: ForceErrors::of(&force_ratios(&presses)),
        };
        Ok(CalibratedEvaluation { presses, pose: calibration.pose().copied(), score })
    }

    /// Prints the score.
    pub fn print(&self, skin: &Skin, folder: &Path, json: bool) -> Outcome {
        if json {
            return print_json(&self.score);
        }
        print(&format!(
            "{}: calibration in {}\n  presses             {}\n  localisation        {}\n  95 % regions        {:.1} % contain \
             the true position\n  unlike the labels   {}\n{}",
            skin.design().name,
            folder.display(),
            self.score.presses,
            millimetres(&self.score.localisation_m),
            100.0 * self.score.covered,
            counted(self.score.unlike, "frame"),
            self.score.force.map_or(String::new(), force_line),
        ))
    }
}

/// The ratios of estimated and true forces, where both are known.
fn force_ratios(presses: &[EvaluatedPress]) -> Vec<f64> {
    let ratio = |press: &EvaluatedPress| Some(press.estimate.as_ref()?.contact.force_n / press.truth.force_n);
    presses.iter().filter_map(ratio).filter(|ratio| ratio.is_finite()).collect()
}

/// The line of a score that states the errors of forces.
pub fn force_line(force: ForceErrors) -> String {
    let ForceErrors { error, spread } = force;
    format!("  force               {:.0} % mean error; estimate over truth spreads by {spread:.2}\n", 1e2 * error)
}

/// A summary of distances in mm.
pub fn millimetres(summary: &Summary) -> String {
    if summary.mean.is_nan() {
        return "no value".into();
    }
    let [mean, sd, median, p95] = [summary.mean, summary.sd, summary.median, summary.p95].map(|value_m| 1e3 * value_m);
    format!("{mean:.2} +- {sd:.2} mm, median {median:.2} mm, 95 % within {p95:.2} mm")
}

/// Refuses presses in another frame of reference than the labels.
fn check_frame(calibration: &Calibration, presses: &Presses, truth: &Path) -> Outcome {
    let is_robot = calibration.pose().is_some();
    if is_robot == (presses.frame() == LabelFrame::Robot) {
        return Ok(());
    }
    let frame = |robot: bool| if robot { "a robot's frame" } else { "the skin's own frame" };
    let message =
        format!("the calibration is in {}, but {} is in {}", frame(is_robot), truth.display(), frame(!is_robot));
    Err(Failure::given(message, Some("give a truth in the same coordinates as the labels")))
}

/// A press with its estimate.
fn evaluated(skin: &Skin, calibration: &Calibration, label: &Label, located: &Located) -> EvaluatedPress {
    let normal = |position_m: Point3| skin.design().body.surface().normal(position_m).unwrap_or(located.normal);
    let at = |position_m: Point3, force_n: f64| Contact::truth(position_m, normal(position_m), force_n);
    let [force_n, force_sd_n] = calibration.force_n(located);
    let (sd_m, confidence) = (located.sd_m(), located.confidence);
    let contact = Contact { sd_m, confidence, force_sd_n, ..at(located.position_m, force_n) };
    let estimate = Estimate {
        misfit: located.misfit,
        unlike: Some(calibration.is_unlike(located)),
        ..Estimate::new(contact, distance(located.position_m, label.position_m))
    };
    EvaluatedPress { row: label.row, truth: at(label.position_m, label.force_n), estimate: Some(estimate) }
}
