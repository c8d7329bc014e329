//! `dermis evaluate`: detected contacts against true touches.

use crate::console::{Progress, print, print_json, warn};
use crate::failure::{Failure, Outcome};
use crate::frames::FrameArguments;
use crate::method::{DetectArguments, MethodArguments};
use crate::press_report::{PressReport, ReportArguments};
use crate::range::count;
use crate::rows::Rows;
use crate::skin;
use crate::used::Used;
use clap::Args;
use dermis::contact::Contact;
use dermis::frame::{Differences, EvaluatedPress, Frame, Truth, frames_after_last_touch};
use dermis::geom::Point3;
use dermis::geom::vector::{bounding_box, distance};
use dermis::skin::Skin;
use dermis::stats::{ForceErrors, Summary};
use dermis::text::counted;
use dermis_calibrate::{Calibration, Pose, Presses};
use dermis_sim::evaluate::{Aligned, Alignment, Score, matched_presses, score_contacts};
use std::path::{Path, PathBuf};

/// The arguments of `dermis evaluate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    frames: FrameArguments,
    #[command(flatten)]
    method: MethodArguments,
    #[command(flatten)]
    detect: DetectArguments,
    /// True touches, one per row: frame,z_m,theta_rad on a cylinder, frame,x_m,y_m on a flat skin, frame,x_m,y_m,z_m on
    /// a mesh; optionally force_n.
    #[arg(long, value_name = "FILE")]
    truth: PathBuf,
    /// Align with the first N presses and score the others. The truth is then x,y,z (m) without a header, in the frame
    /// of the robot that pressed, one row per frame. The first N presses determine the pose of the skin and select
    /// prior, alpha and outlier cut (for a network the cut alone). Channels that disagree with their reciprocal
    /// channels, or whose polarity the instrument cannot measure, are left out.
    #[arg(
        long,
        value_name = "N",
        value_parser = count(1..=10_000_000usize),
        conflicts_with_all = ["alpha", "alpha_absolute", "noser_exponent", "weighting", "channel_noise", "both_signs"]
    )]
    align: Option<usize>,
    /// Draw the N presses at random, this many times, and report the median error.
    #[arg(long, value_name = "TIMES", requires = "align", value_parser = count(1..=100_000u64))]
    draws: Option<u64>,
    /// Rows to score, as in 2000..2500 (row 2500 not included) [default: all].
    #[arg(long, value_name = "ROWS", conflicts_with = "align")]
    rows: Option<Rows>,
    #[command(flatten)]
    report: ReportArguments,
    /// Print JSON (lengths in m) instead of a table (mm).
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Reconstructs images, detects contacts and scores them.
    pub fn run(self) -> Outcome {
        self.report.check()?;
        let skin = skin::load(&self.design)?;
        let (differences, used) = self.frames.read_complete(&skin, &self.method)?;
        if let Some(folder) = self.method.calibration() {
            return self.calibrated(&skin, folder, &differences, &used);
        }
        let truth = skin::read_truth(&skin, &self.truth, used.count)?;
        let path = self.truth.display();
        match (truth, self.align) {
            (Truth::OnSkin(truth), None) => self.on_skin(&skin, differences, &truth, &used),
            (Truth::Elsewhere { positions_m, .. }, Some(count)) => {
                self.align(&skin, &differences.frames, &used.select(&positions_m), (count, &used))
            }
            (Truth::Elsewhere { .. }, None) => {
                let message = format!("{path} has no header: the coordinate frame of its positions is unknown");
                let fix = "name the columns in the first row, or align with --align N";
                Err(Failure::given(message, Some(fix)))
            }
            (Truth::OnSkin(_), Some(_)) => {
                let message = format!("{path} is in the skin's own coordinate frame: there is nothing to align");
                Err(Failure::given(message, Some("leave --align out")))
            }
        }
    }

    /// Scores a forward map.
    fn calibrated(&self, skin: &Skin, folder: &Path, differences: &Differences, used: &Used) -> Outcome {
        if self.align.is_some() {
            let fix = Some("leave --align out");
            return Err(Failure::given("the pose of a calibrated skin is known", fix));
        }
        // Refuses options that a calibration does not have.
        let method = self.method.prepare(skin, differences)?;
        self.detect.detector(skin, &method, &Differences::default())?;
        let calibration = Calibration::load(folder, skin.design())?;
        let frames = &differences.frames;
        let presses = Presses::read(&self.truth, skin, used.count)?.of_rows(&used.rows);
        let rows = used.chosen(self.rows.as_ref(), "--rows")?;
        let (score, mut presses) = calibration.evaluate(skin, frames, &presses, &rows)?;
        presses.iter_mut().for_each(|press| press.row = used.rows[press.row]);
        let pose = calibration.pose().copied();
        self.report.write(&PressReport { skin, method: method.label(), presses: &presses, pose })?;
        if self.json {
            return print_json(&score);
        }
        print(&format!(
            "{}: calibration in {}\n  presses             {}\n  localisation        {}\n  95 % regions        {:.1} % contain \
             the true position\n  unlike the labels   {}\n{}",
            skin.design().name,
            folder.display(),
            score.presses,
            millimetres(&score.localisation_m),
            100.0 * score.covered,
            counted(score.unlike, "frame"),
            score.force.map_or(String::new(), force_line),
        ))
    }

    /// Scores any other method against touches on the skin.
    fn on_skin(&self, skin: &Skin, differences: Differences, truth: &[Vec<Contact>], used: &Used) -> Outcome {
        self.warn_of_frames_after(truth);
        let truth = used.select(truth);
        let method = self.method.prepare(skin, &differences)?;
        let detector = self.detect.detector(skin, &method, &differences)?;
        let rows = used.chosen(self.rows.as_ref(), "--rows")?;
        let frames: Vec<Frame> = rows.iter().map(|&row| differences.frames[row].clone()).collect();
        let truth: Vec<Vec<Contact>> = rows.iter().map(|&row| truth[row].clone()).collect();
        let found = self.detect.in_each(&method, &detector, &frames, |image, contacts| (image, contacts))?;
        let (images, contacts): (Vec<_>, Vec<_>) = found.into_iter().unzip();
        let score = score_contacts(&images, &contacts, &truth, method.label(), method.alpha())?;
        let surface = skin.design().body.surface();
        let presses: Vec<EvaluatedPress> = (used.rows_of(&rows).into_iter().zip(&truth).zip(&contacts))
            .flat_map(|((row, touches), found)| matched_presses(row, touches, found, &surface))
            .collect();
        self.report.write(&PressReport { skin, method: method.label(), presses: &presses, pose: None })?;
        if self.json { print_json(&score) } else { print(&table(&skin.design().name, &score)) }
    }
}

impl Arguments {
    /// Warns about frames after the last true touch. A frame without a touch is valid, but at the end it usually
    /// indicates a counting error.
    fn warn_of_frames_after(&self, truth: &[Vec<Contact>]) {
        let rest = frames_after_last_touch(truth);
        if !rest.is_empty() {
            warn(&format!(
                "{} has its last touch in frame {}, of {}: those after it count as untouched",
                self.truth.display(),
                rest.start as i64 - 1,
                counted(truth.len(), "frame")
            ));
        }
    }

    /// Determines the pose of the skin from the first presses and scores the others.
    fn align(&self, skin: &Skin, differences: &[Frame], presses: &[Point3], (count, used): (usize, &Used)) -> Outcome {
        self.check_size(skin, presses)?;
        let progress = Progress::waiting("reconstructing all presses with every candidate prior, alpha and cut");
        let estimates = self.method.press_estimates(skin, differences)?;
        if let Some(draws) = self.draws {
            let means_m = estimates.align_by_few(presses, count, draws).map_err(dermis_sim::Error::from)?;
            drop(progress);
            return self.print_draws(count, &means_m);
        }
        let align_by: Vec<usize> = (0..count).collect();
        let aligned = estimates.align(presses, &align_by).map_err(dermis_sim::Error::from)?;
        drop(progress);
        let mut evaluated = aligned.evaluated(presses);
        evaluated.iter_mut().for_each(|press| press.row = used.rows[press.row]);
        let (method, pose) = (&aligned.score.method[..], Some(aligned_pose(&aligned.alignment)));
        self.report.write(&PressReport { skin, method, presses: &evaluated, pose })?;
        if self.json {
            return print_json(&aligned);
        }
        print(&(table(&skin.design().name, &aligned.score) + &placement(&aligned)))
    }
}

impl Arguments {
    /// Refuses presses that are spread farther than the skin is large.
    fn check_size(&self, skin: &Skin, presses: &[Point3]) -> Outcome {
        let diagonal_m = |[low, high]: [Point3; 2]| distance(low, high);
        let spread_m = diagonal_m(bounding_box(presses.iter().copied()));
        let skin_m = diagonal_m(bounding_box(skin.mesh().nodes.iter().copied()));
        if spread_m <= MAX_SPREAD * skin_m {
            return Ok(());
        }
        let message = format!(
            "{}: its positions are spread over {spread_m:.3} m, but the skin is {skin_m:.3} m large",
            self.truth.display()
        );
        Err(Failure::given(message, Some("give x, y and z in metres")))
    }

    fn print_draws(&self, count: usize, means_m: &[f64]) -> Outcome {
        let last = means_m.len() - 1;
        let median_m = 0.5 * (means_m[last / 2] + means_m[last - last / 2]);
        let p90_m = means_m[9 * last / 10];
        if self.json {
            return print_json(&serde_json::json!({ "aligned_by": count, "median_m": median_m, "p90_m": p90_m }));
        }
        print(&format!(
            "aligned by {count} presses, drawn {} times: mean error {:.2} mm (median of the draws), {:.2} mm (90th percentile)\n",
            means_m.len(),
            1e3 * median_m,
            1e3 * p90_m
        ))
    }
}

/// Presses are spread over at most this many times the size of the skin: its pose may be known roughly, not its scale.
const MAX_SPREAD: f64 = 3.0;

/// The pose of an alignment, without its scale.
fn aligned_pose(alignment: &Alignment) -> Pose {
    let Alignment { centre_m: [x, y], rotation_rad, mirrored, .. } = *alignment;
    Pose { centre_m: [x, y, 0.0], rotation_rad, mirrored }
}

/// The pose of the skin, as text.
fn placement(aligned: &Aligned) -> String {
    let Alignment { centre_m, rotation_rad, mirrored, scale, residual_m } = aligned.alignment;
    let left_out: Vec<String> = aligned.left_out.iter().map(usize::to_string).collect();
    let left_out = if left_out.is_empty() { "none".to_string() } else { left_out.join(" ") };
    let cut = if aligned.limit_sd.is_finite() { format!("at {} sd", aligned.limit_sd) } else { "nowhere".into() };
    format!(
        "  aligned by          the first {} presses, {:.2} mm off on the mean\n  skin lies at        x {:.2} mm, y {:.2} mm, \
         turned by {:.1} degrees{}, estimates times {scale:.3}\n  values cut          {cut}\n  channels left out   {left_out}\n",
        aligned.aligned_by,
        residual_m * 1000.0,
        centre_m[0] * 1000.0,
        centre_m[1] * 1000.0,
        rotation_rad.to_degrees(),
        if mirrored { ", seen mirrored" } else { "" },
    )
}

/// The score, as text.
fn table(skin: &str, score: &Score) -> String {
    let alpha = score.alpha.map(|alpha| format!(", alpha {alpha:.4}")).unwrap_or_default();
    let spread = if score.sensitivity_spread.is_finite() {
        format!("{:.2} (standard deviation over mean)", score.sensitivity_spread)
    } else {
        "unknown without frames of single touches with forces".to_string()
    };
    let force = score.force.map_or(String::new(), force_line);
    let advice = score.advice().map(|advice| format!("  note                {advice}\n")).unwrap_or_default();
    format!(
        "{skin}: {}{alpha}\n  presses             {}, of which {} missed; {}\n  localisation        {}\n  \
         whole-image (Eq 11) {}\n  sensitivity spread  {spread}\n{force}{advice}",
        score.method,
        score.presses,
        score.misses,
        counted(score.false_positives, "false positive"),
        millimetres(&score.localisation_m),
        millimetres(&score.eq11_m),
    )
}

/// The line of a score that states the errors of forces.
fn force_line(force: ForceErrors) -> String {
    let ForceErrors { error, spread } = force;
    format!("  force               {:.0} % mean error; estimate over truth spreads by {spread:.2}\n", 1e2 * error)
}

/// A summary of distances in mm.
fn millimetres(summary: &Summary) -> String {
    if summary.mean.is_nan() {
        return "no value".into();
    }
    let [mean, sd, median, p95] = [summary.mean, summary.sd, summary.median, summary.p95].map(|value_m| 1e3 * value_m);
    format!("{mean:.2} +- {sd:.2} mm, median {median:.2} mm, 95 % within {p95:.2} mm")
}
