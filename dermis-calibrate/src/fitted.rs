//! The calibration that presses give: a forward map, or the correction of a method.

use crate::calibration::{Calibration, Label, LabelFrame, Quality, check, check_positions, flatten};
use crate::correction::{Correction, CorrectionQuality, LENGTH_PART, size_m};
use crate::error::CalibrateError;
use crate::matching::MIN_EVIDENCE;
use crate::pose::Pose;
use crate::strength::UnusedForces;
use dermis::contact::GATE_M;
use dermis::design::SkinDesign;
use dermis::finding::{Finding, FindingKind};
use dermis::frame::{Differences, Frame};
use dermis::geom::Point3;
use dermis::geom::vector::{centroid, distance};
use dermis::method::{MethodOptions, Methods};
use dermis::plausibility::Plausibility;
use dermis::reconstruct::MIN_UNTOUCHED_FRAMES;
use dermis::skin::Skin;
use dermis::text::counted;
use serde::Serialize;
use std::path::Path;

/// Where fewer pixels of a skin than this part are near a label, a calibration is warned of: twenty labels at random places are near
/// half of them.
const MIN_COVERED: f64 = 1.0 / 3.0;

/// A calibration of either kind.
#[derive(Debug, Clone)]
pub enum Fitted {
    /// A forward map.
    ForwardMap(Box<Calibration>),
    /// The correction of a method.
    Correction(Box<Correction>),
}

/// What a calibration has to be better than.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Alternatives {
    /// Mean distance of the labels from the place nearest to all of them: the error of a guess, m.
    pub guess_m: f64,
    /// A method without calibration, and its mean error at the labels, m: those that it does not find count as
    /// [`GATE_M`](dermis::contact::GATE_M).
    pub uncalibrated: Option<(String, f64)>,
}

impl Alternatives {
    /// What to do where a calibration is of no use.
    pub const FIX: &str = "check that the labels belong to the frames, their rows, units and axes (dermis check-frames \
                           --truth), or label more presses";

    /// Those of some labels; `uncalibrated` are the skin's own methods.
    fn of(skin: &Skin, labels: &[Label], frame: LabelFrame, uncalibrated: Vec<(String, f64)>) -> Self {
        let surface = skin.design().body.surface();
        let distance_m = |a: Point3, b: Point3| match frame {
            LabelFrame::Skin => surface.distance_m(a, b),
            LabelFrame::Robot => distance(a, b),
        };
        let mut at_labels: Vec<Point3> = labels.iter().map(|label| label.position_m).collect();
        if frame == LabelFrame::Robot {
            flatten(&mut at_labels);
        }
        let anywhere = match frame {
            LabelFrame::Skin => skin.pixels().centres_m.clone(),
            LabelFrame::Robot => vec![centroid(&at_labels)],
        };
        let mean_m =
            |one: Point3| at_labels.iter().map(|&other| distance_m(one, other)).sum::<f64>() / labels.len() as f64;
        let guess_m = anywhere.into_iter().map(mean_m).fold(f64::INFINITY, f64::min);
        let uncalibrated = uncalibrated.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
        Alternatives { guess_m, uncalibrated }
    }

    /// Why a calibration is of no use, if so.
    pub fn reason(&self, fitted: &Fitted) -> Option<String> {
        if let Fitted::Correction(correction) = fitted {
            let CorrectionQuality { found, elsewhere, .. } = *correction.quality();
            if elsewhere > found {
                return Some(format!(
                    "{elsewhere} of {} have their contacts of {} more than {:.0} mm from their labels",
                    counted(elsewhere + found, "touched frame"),
                    correction.method(),
                    1e3 * GATE_M
                ));
            }
        }
        self.reason_of(fitted.with_misses_m(), fitted.evidence())
    }

    /// The same of a forward map of some quality.
    pub fn reason_of_map(&self, map: &Quality) -> Option<String> {
        self.reason_of(map.mean_error_m, map.evidence)
    }

    fn reason_of(&self, mean_error_m: f64, evidence: Option<f64>) -> Option<String> {
        let mm = |length_m: f64| format!("{:.1} mm", 1e3 * length_m);
        let located = format!("the calibration locates presses that it has not seen to {}", mm(mean_error_m));
        if mean_error_m > self.guess_m {
            return Some(format!("{located}; always guessing the same place gives {}", mm(self.guess_m)));
        }
        if let Some((name, before_m)) = self.uncalibrated.as_ref().filter(|(_, before_m)| *before_m < mean_error_m) {
            return Some(format!("{located}; {name} without a calibration to {}", mm(*before_m)));
        }
        let evidence = evidence.filter(|&evidence| evidence < MIN_EVIDENCE)?;
        Some(format!(
            "the labels fit their frames hardly better than in a random order: by {evidence:.1} standard deviations, where \
             {MIN_EVIDENCE:.1} are needed"
        ))
    }
}

impl Fitted {
    /// The name of the forward map where methods are selected by name.
    pub const FORWARD_MAP: &str = "forward-map";

    /// Fits the forward map, or the correction of a method by its name; without a choice, whichever locates the labels
    /// better, of the forward map and corrections of the skin's own methods: its contacts, and with enough untouched frames
    /// its refined contacts. Returns what it has to be better than, too: [`Alternatives::reason`] says whether it is.
    ///
    /// # Errors
    /// As [`Calibration::fit`] and [`Correction::fit`]; a correction of labels in a robot's frame; an unknown method.
    pub fn fit(
        methods: &Methods,
        skin: &Skin,
        differences: &Differences,
        labels: &[Label],
        frame: LabelFrame,
        method: Option<&str>,
    ) -> Result<(Self, Alternatives), CalibrateError> {
        let mut tried = None;
        let mut fitted = Self::choose(methods, skin, differences, labels, frame, method, &mut tried)?;
        let rest = differences.baseline.clone();
        match &mut fitted {
            Fitted::ForwardMap(map) => map.rest = rest,
            Fitted::Correction(correction) => correction.rest = rest,
        }
        let uncalibrated = match (frame, tried) {
            (LabelFrame::Robot, _) => Vec::new(),
            (LabelFrame::Skin, Some(tried)) => tried.uncalibrated,
            (LabelFrame::Skin, None) => Tried::new(methods, skin, differences, labels)?.uncalibrated,
        };
        Ok((fitted, Alternatives::of(skin, labels, frame, uncalibrated)))
    }

    /// Fits; `tried` are the corrections of the skin's own methods, if they had to be fitted.
    fn choose(
        methods: &Methods,
        skin: &Skin,
        differences: &Differences,
        labels: &[Label],
        frame: LabelFrame,
        method: Option<&str>,
        tried: &mut Option<Tried>,
    ) -> Result<Self, CalibrateError> {
        let frames = &differences.frames;
        check(frames, &skin.design().protocol, labels)?;
        if frame == LabelFrame::Skin {
            check_positions(skin, labels)?;
        }
        if let Some(name) = method.filter(|name| *name != Self::FORWARD_MAP) {
            if frame == LabelFrame::Robot {
                return Err(CalibrateError::CorrectionFrame { method: name.into() });
            }
            return Ok(Fitted::Correction(Box::new(correct(methods, skin, differences, labels, name)?)));
        }
        let map = Calibration::fit(skin, frames, labels, frame)?;
        let better = match (method, frame) {
            (None, LabelFrame::Skin) => {
                let tried = tried.insert(Tried::new(methods, skin, differences, labels)?);
                tried.better(map.quality()).cloned()
            }
            _ => None,
        };
        Ok(match better {
            Some(correction) => Fitted::Correction(Box::new(correction)),
            None => Fitted::ForwardMap(Box::new(map)),
        })
    }

    /// The best correction of the skin's own methods, where it locates the labels, in the skin's own coordinates, better than a
    /// forward map of this quality; and what either has to be better than.
    ///
    /// # Errors
    /// As [`Correction::fit`].
    pub fn better_correction(
        methods: &Methods,
        skin: &Skin,
        differences: &Differences,
        labels: &[Label],
        map: &Quality,
    ) -> Result<(Option<Correction>, Alternatives), CalibrateError> {
        let tried = Tried::new(methods, skin, differences, labels)?;
        let better = tried.better(map).cloned();
        Ok((better, Alternatives::of(skin, labels, LabelFrame::Skin, tried.uncalibrated)))
    }

    /// The mean error of labels that it had not seen, m.
    pub fn mean_error_m(&self) -> f64 {
        match self {
            Fitted::ForwardMap(map) => map.quality().mean_error_m,
            Fitted::Correction(correction) => correction.quality().mean_error_m,
        }
    }

    /// The same of all labels, where those that a corrected method does not find count as the gate, m.
    fn with_misses_m(&self) -> f64 {
        match self {
            Fitted::ForwardMap(map) => map.quality().mean_error_m,
            Fitted::Correction(correction) => correction.with_misses_m(),
        }
    }

    /// Why an untouched frame, ohm, is not that of the labels: what is calibrated by them says nothing of the frames that belong
    /// to it. `None` where it is, and for a calibration by differences alone.
    pub fn doubt_of(&self, design: &SkinDesign, rest: &Frame) -> Option<String> {
        let known = match self {
            Fitted::ForwardMap(map) => &map.rest,
            Fitted::Correction(correction) => &correction.rest,
        };
        unlike(design, known.as_ref()?, rest)
    }

    /// By how many standard deviations the labels fit their own frames better than in a random order.
    pub fn evidence(&self) -> Option<f64> {
        match self {
            Fitted::ForwardMap(map) => map.quality().evidence,
            Fitted::Correction(correction) => correction.quality().evidence,
        }
    }

    /// What speaks against the places of labels on a skin, or limits what they say, without refuting them.
    pub fn doubts(&self, skin: &Skin, labels: &[Label]) -> Vec<String> {
        self.common_shift().into_iter().chain(self.uncovered(skin, labels)).collect()
    }

    /// Of a correction, a shift of all labels alike that is larger than the errors it leaves.
    fn common_shift(&self) -> Option<String> {
        let Fitted::Correction(correction) = self else { return None };
        let CorrectionQuality { common_shift_m, mean_error_before_m, mean_error_m, .. } = *correction.quality();
        let is_most = |shift_m: &f64| *shift_m > mean_error_m && *shift_m > 0.5 * mean_error_before_m;
        let shift_m = common_shift_m.filter(is_most)?;
        Some(format!(
            "the labels lie on average {:.1} mm in one direction from the contacts of {}, and the calibration shifts these by \
             that: check the origin of the labels and the place of the electrodes",
            1e3 * shift_m,
            correction.method()
        ))
    }

    /// Labels that lie in a small part of a skin, or on a line.
    fn uncovered(&self, skin: &Skin, labels: &[Label]) -> Option<String> {
        let pose = match self {
            Fitted::ForwardMap(map) => map.pose(),
            Fitted::Correction(_) => None,
        };
        let part = covered(skin, labels, pose);
        (part < MIN_COVERED).then(|| {
            format!(
                "{:.0} % of the skin lie within {:.0} mm of a label: of the rest the calibration knows nothing, and its errors \
                 are not those of the labels. Press all over the skin",
                1e2 * part,
                1e3 * LENGTH_PART * size_m(skin.pixels())
            )
        })
    }

    /// Writes it to a folder, which is created.
    ///
    /// # Errors
    /// A folder or file that cannot be written.
    pub fn save(&self, folder: &Path, design: &SkinDesign) -> Result<(), CalibrateError> {
        match self {
            Fitted::ForwardMap(map) => map.save(folder, design),
            Fitted::Correction(correction) => correction.save(folder, design),
        }
    }

    /// Why the forces of its labels are not used; `None` where they are, or where none is known.
    pub fn unused_forces(&self, labels: &[Label]) -> Option<UnusedForces> {
        match self {
            Fitted::ForwardMap(map) => map.unused_forces(labels),
            Fitted::Correction(correction) => correction.unused_forces(labels),
        }
    }
}

/// The part of a skin that lies near a label, with its pose in the frame of the labels if that is a robot's.
fn covered(skin: &Skin, labels: &[Label], pose: Option<&Pose>) -> f64 {
    let (pixels, near_m) = (skin.pixels(), LENGTH_PART * size_m(skin.pixels()));
    // How deep a robot presses is no place on the skin.
    let apart_m = |a: Point3, b: Point3| match pose {
        Some(_) => (a[0] - b[0]).hypot(a[1] - b[1]),
        None => distance(a, b),
    };
    let is_near = |place_m: &&Point3| {
        let place_m = pose.map_or(**place_m, |pose| pose.to_robot(**place_m));
        labels.iter().any(|label| apart_m(label.position_m, place_m) <= near_m)
    };
    pixels.centres_m.iter().filter(is_near).count() as f64 / pixels.len() as f64
}

/// Why an untouched frame is not that of the labels of a calibration, if so.
pub(crate) fn unlike(design: &SkinDesign, of_labels: &Frame, rest: &Frame) -> Option<String> {
    let check = Plausibility::new(&design.protocol, of_labels, &[]);
    let Finding { kind, value, .. } = check.of_frames(std::slice::from_ref(rest), of_labels)?;
    Some(match kind {
        FindingKind::Magnitude => format!(
            "the untouched frame is {value:.3} times as large as that of the calibration: give values in the same unit, with the \
             same current and gain, or calibrate again"
        ),
        _ => format!(
            "the untouched frame agrees with that of the calibration by {value:.2} (1: exactly, 0: by chance): give frames of \
             the same skin, in the same order and with the same signs, or calibrate again"
        ),
    })
}

/// The skin's own methods at the labels: its contacts, and its refined contacts where they can be refined.
struct Tried {
    corrections: Vec<Correction>,
    /// Those that cannot be corrected, too, with their mean errors.
    uncalibrated: Vec<(String, f64)>,
    /// The part of the skin that the labels describe; 1 unless a calibration is [warned of](MIN_COVERED).
    covered: f64,
}

impl Tried {
    fn new(
        methods: &Methods,
        skin: &Skin,
        differences: &Differences,
        labels: &[Label],
    ) -> Result<Self, CalibrateError> {
        let mut names = vec![methods.unrefined_name(skin)?];
        if methods.default_name(skin)? == Methods::REFINED && can_be_refined(differences) {
            names.push(Methods::REFINED.into());
        }
        let covered = Some(covered(skin, labels, None)).filter(|part| *part < MIN_COVERED).unwrap_or(1.0);
        let mut tried = Tried { corrections: Vec::new(), uncalibrated: Vec::new(), covered };
        for name in names {
            let error_m = match correct(methods, skin, differences, labels, &name) {
                Err(CalibrateError::NotRefined { .. }) => continue,
                Err(CalibrateError::TooFewFound { uncalibrated_m, .. }) => uncalibrated_m,
                fitted => {
                    let fitted = fitted?;
                    let [error_m, _] = fitted.quality().with_misses_m.unwrap_or_default();
                    tried.corrections.push(fitted);
                    error_m
                }
            };
            tried.uncalibrated.push((name, error_m));
        }
        Ok(tried)
    }

    /// The best correction, where it locates the labels better than a forward map of this quality.
    fn better(&self, map: &Quality) -> Option<&Correction> {
        // Elsewhere a correction is the method that it corrects, and a forward map nothing.
        let everywhere_m =
            |labelled_m: f64, elsewhere_m: f64| self.covered * labelled_m + (1.0 - self.covered) * elsewhere_m;
        let error_m = |correction: &&Correction| {
            let [before_m, _] = correction.quality().with_misses_m.unwrap_or_default();
            everywhere_m(correction.with_misses_m(), before_m)
        };
        let best = self.corrections.iter().min_by(|a, b| error_m(a).total_cmp(&error_m(b)));
        best.filter(|correction| error_m(correction) < everywhere_m(map.mean_error_m, GATE_M))
    }
}

fn can_be_refined(differences: &Differences) -> bool {
    differences.baseline.is_some() && differences.untouched.len() >= MIN_UNTOUCHED_FRAMES
}

/// Corrects a method by the labels.
fn correct(
    methods: &Methods,
    skin: &Skin,
    differences: &Differences,
    labels: &[Label],
    name: &str,
) -> Result<Correction, CalibrateError> {
    let (mut method, protocol) = (methods.method(skin, name, &MethodOptions::default())?, &skin.design().protocol);
    let mut detector = method.detector(&[], protocol).map_err(dermis::Error::from)?;
    if method.reconstruct().is_adaptable() {
        let cannot = |why: String| CalibrateError::NotRefined { why };
        if !can_be_refined(differences) {
            return Err(cannot(format!("that takes at least {MIN_UNTOUCHED_FRAMES} untouched frames")));
        }
        method = method.adapted(differences).map_err(|error| cannot(error.to_string()))?;
        if let Some(why) = method.reconstruct().warning() {
            return Err(cannot(why.into()));
        }
        detector = method.detector_of(differences, protocol).map_err(dermis::Error::from)?;
    }
    Correction::fit(skin.pixels(), &method, &detector, &differences.frames, labels)
}
