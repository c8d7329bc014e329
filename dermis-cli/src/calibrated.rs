//! Calibrated methods: labels, and scores in the frame of the labels.

use crate::console::{print, print_json};
use crate::failure::{Failure, Outcome};
use crate::rows::Rows;
use crate::skin::place_limits;
use dermis::frame::{Frame, Truth, read_truth, write_whole};
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::skin::Skin;
use dermis::stats::Summary;
use dermis_calibrate::{Calibration, Label, LabelFrame, Located};
use serde::Serialize;
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
            Truth::Elsewhere(positions_m) => {
                let forces_n = vec![f64::NAN; positions_m.len()];
                Presses { positions_m, forces_n, frame: LabelFrame::Robot }
            }
            Truth::OnSkin(frames) => {
                let one = |(frame, touches): (usize, Vec<dermis::contact::Contact>)| match &touches[..] {
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

    /// The presses of some rows; of all rows without a choice.
    pub fn labels(&self, rows: Option<&Rows>) -> Outcome<Vec<Label>> {
        let all: Vec<usize>;
        let rows = match rows {
            Some(rows) => {
                rows.of(self.positions_m.len()).map_err(|message| Failure::given(message, Some("choose other rows")))?
            }
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
    let mut ranges: Vec<(usize, usize, i32)> = Vec::new();
    for (channel, &lag) in lags.iter().enumerate().filter(|(_, lag)| **lag != 0) {
        match ranges.last_mut() {
            Some((_, last, same)) if *last + 1 == channel && *same == lag => *last = channel,
            _ => ranges.push((channel, channel, lag)),
        }
    }
    if ranges.is_empty() {
        return "none".into();
    }
    let one = |&(first, last, lag): &(usize, usize, i32)| match first == last {
        true => format!("{first} by {lag}"),
        false => format!("{first}-{last} by {lag}"),
    };
    ranges.iter().map(one).collect::<Vec<_>>().join(", ")
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
}

/// Locates the presses of a recording and compares some of them with the truth. The recording is the one of the labels, or
/// begins as it does: rows have the same numbers.
pub fn evaluate(
    skin: &Skin,
    folder: &Path,
    frames: &[Frame],
    truth: &Path,
    rows: Option<&Rows>,
    report: Option<&Path>,
    json: bool,
) -> Outcome {
    let calibration = Calibration::load(folder, skin.design())?;
    let presses = Presses::read(truth, skin, frames.len())?;
    let is_robot = calibration.pose().is_some();
    if is_robot != (presses.frame() == LabelFrame::Robot) {
        let frame = |robot: bool| if robot { "a robot's frame" } else { "the skin's own frame" };
        let message =
            format!("the calibration is in {}, but {} is in {}", frame(is_robot), truth.display(), frame(!is_robot));
        return Err(Failure::given(message, Some("give a truth in the same coordinates as the labels")));
    }
    let labels = presses.labels(rows)?;
    let located = calibration.locate(frames, 0)?;
    let errors_m: Vec<f64> =
        labels.iter().map(|label| distance(located[label.row].position_m, label.position_m)).collect();
    if let Some(path) = report {
        write_report(path, &labels, &located, &calibration)?;
    }
    let score = CalibratedScore {
        presses: labels.len(),
        localisation_m: Summary::of(&errors_m),
        covered: labels.iter().filter(|label| located[label.row].region_contains(label.position_m)).count() as f64
            / labels.len() as f64,
        unlike: labels.iter().filter(|label| calibration.is_unlike(&located[label.row])).count(),
    };
    if json {
        return print_json(&score);
    }
    let Summary { mean, sd, median, p95, .. } = score.localisation_m;
    let [mean, sd, median, p95] = [mean, sd, median, p95].map(|value_m| 1e3 * value_m);
    print(&format!(
        "{}: calibration in {}\n  presses             {}\n  localisation        {mean:.2} +- {sd:.2} mm, median {median:.2} mm, 95 % within \
         {p95:.2} mm\n  95 % regions        {:.1} % contain the true position\n  unlike the labels   {} frames\n",
        skin.design().name,
        folder.display(),
        score.presses,
        100.0 * score.covered,
        score.unlike,
    ))
}

/// A row for each press: truth, estimate, error, standard deviation.
fn write_report(path: &Path, labels: &[Label], located: &[Located], calibration: &Calibration) -> Outcome {
    Ok(write_whole(path, |out| {
        writeln!(out, "frame,true_x_m,true_y_m,true_z_m,x_m,y_m,z_m,error_m,sd_m,confidence,misfit,unlike")?;
        for Label { row, position_m: [x, y, z], .. } in labels {
            let found = &located[*row];
            let [u, v, w] = found.position_m;
            let error_m = distance(found.position_m, [*x, *y, *z]);
            let unlike = u8::from(calibration.is_unlike(found));
            writeln!(
                out,
                "{row},{x:?},{y:?},{z:?},{u:?},{v:?},{w:?},{error_m:?},{:?},{:?},{:?},{unlike}",
                found.sd_m(),
                found.confidence,
                found.misfit
            )?;
        }
        Ok(())
    })?)
}
