//! Checks of a recording before anyone trains on it: what is wrong with its frames, where, and what to do.
//!
//! Nothing here needs labels. The frames are compared with each other, and with the model of the skin.
//!
//! ```
//! use dermis::finding::FindingKind;
//! use dermis::frame::Frame;
//! use dermis::skin::Skin;
//! use dermis_calibrate::LabelFrame;
//! use dermis_calibrate::checks::{Recording, check_recording};
//!
//! let skin = Skin::load("tank16")?;
//! // An instrument that reads V[m + 1] - V[m], as pyEIT does, where the design says V[m] - V[m + 1].
//! let model = skin.untouched()?;
//! let untouched = vec![Frame(model.iter().map(|value| -value).collect())];
//! let label_frame = LabelFrame::Skin;
//! let recording = Recording { frames: &untouched, untouched: &untouched, positions_m: None, label_frame };
//! let checked = check_recording(&skin, &recording).unwrap();
//! assert_eq!(checked.findings[0].kind, FindingKind::SignTurned);
//! assert!(checked.findings[0].fix.contains("measures_reversed"));
//! # Ok::<(), dermis::Error>(())
//! ```

mod axes;
pub(crate) mod correlation;
mod describe;
mod magnitude;
mod model;
mod order;
mod orders;
mod pairs;
mod signs;
mod time;
mod truth;
mod values;

use crate::calibration::{Label, LabelFrame, check_frames};
use crate::error::CalibrateError;
use crate::lags::{LAGS, LagEvidence, lag_evidence};
use crate::sequence::{Realignment, in_units};
use crate::units::ChannelUnits;
use axes::Labelled;
use correlation::{correlations, in_robust_units, standardised, to_matrix, to_rows};
use dermis::design::Body;
use dermis::finding::{Finding, FindingKind, Severity};
use dermis::frame::{Frame, broken_channels, disconnected_electrodes, mean};
use dermis::geom::Point3;
use dermis::plausibility::Plausibility;
use dermis::protocol::Protocol;
use dermis::skin::Skin;
use dermis::text::counted;
use faer::Mat;
use model::ModelChannels;
use order::{BetterOrder, Matcher, Score};
use orders::Order;
use serde::Serialize;
use signs::TouchFit;

/// Fewest rows whose correlations are compared with the model.
const MIN_ROWS: usize = 40;

/// Fewer channels at driven electrodes are not late by themselves.
const MIN_LATE: usize = 3;

/// A recording to check, in the order of recording.
#[derive(Debug, Clone, Copy)]
pub struct Recording<'a> {
    /// The frames, ohm; differences from the untouched skin where `untouched` is empty.
    pub frames: &'a [Frame],
    /// Untouched frames, ohm.
    pub untouched: &'a [Frame],
    /// The position of the press of each frame, m.
    pub positions_m: Option<&'a [Point3]>,
    /// Their coordinate frame; the axes are checked of positions on the skin.
    pub label_frame: LabelFrame,
}

/// What the checks of a recording found.
#[derive(Debug, Clone, Serialize)]
pub struct Checked {
    /// The findings: faults first, then notes. Empty for a sound recording.
    pub findings: Vec<Finding>,
    /// The number of rows by which each channel of the file is late.
    pub lags: Vec<i32>,
    /// For each channel of the design its column in the file; empty where the order is that of the design.
    pub columns: Vec<usize>,
    /// The figures behind the findings.
    pub figures: Figures,
}

impl Checked {
    /// The findings that are to be mended.
    pub fn faults(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|finding| finding.is_fault())
    }
}

/// Figures of a recording, for pictures. Lists are empty where a figure cannot be computed.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Figures {
    /// Cosine between the untouched frame and that of the model, values compressed by asinh; 0 without one.
    pub untouched_cosine: f64,
    /// Cosine between the correlations of the channels and those of the model.
    pub correlation_cosine: f64,
    /// The untouched frame, ohm, in the order of the design.
    pub untouched: Vec<f64>,
    /// That of the model, ohm.
    pub model_untouched: Vec<f64>,
    /// The lags that were tried, rows.
    pub lags: Vec<i32>,
    /// For each channel of the file the part of its variance that the other channels explain, for each lag.
    pub lag_explained: Vec<Vec<f64>>,
    /// Correlation of each two channels of the design over the rows, with late channels realigned.
    pub correlation: Vec<Vec<f64>>,
    /// The same over simulated touches of the model.
    pub model_correlation: Vec<Vec<f64>>,
    /// Row and mean of the component that drifts most, in its standard deviations.
    pub trend: Vec<[f64; 2]>,
    /// Part of the variance of the median channel that is drift.
    pub drift: f64,
    /// Part of the leading components that the row before explains.
    pub memory: f64,
    /// The shifts of the positions that were tried, rows.
    pub shifts: Vec<i32>,
    /// The part of the frames that the positions explain, for each shift.
    pub shift_explained: Vec<f64>,
}

/// Checks a recording.
///
/// # Errors
/// No frame; frames of another number of channels; values that are not finite; positions of another number than the
/// frames; a model that cannot be solved.
pub fn check_recording(skin: &Skin, recording: &Recording<'_>) -> Result<Checked, CalibrateError> {
    validate(recording, &skin.design().protocol)?;
    let mut check = Check::new(skin, recording)?;
    let comparable = check.untouched_signs();
    let designed = Order::of_design(&check.protocol);
    // Late and dead channels would look exchanged: they are found first, in the order of the file.
    let mut evidence = check.late(&check.differences.clone(), &designed);
    check.open_electrodes();
    let order = check.order(comparable);
    let mended = check.mended(&order);
    if !order.changes.is_empty() {
        evidence = check.late(&mended, &order);
    }
    check.aligned(&mended, &order, &evidence, comparable);
    check.of_values();
    let mut checked = check.finish(&order);
    if let Some(baseline) = mean(recording.untouched) {
        let plausible = Plausibility::new(&skin.design().protocol, skin.untouched()?, &[]);
        if let Some(unlike) = plausible.of_frames(recording.frames, &baseline)
            && checked.findings.iter().all(|known| known.kind != unlike.kind)
        {
            checked.findings.insert(0, unlike);
        }
        // What names the cause says more.
        if let Some(unlike) = plausible.of_baseline(&baseline).filter(|_| checked.findings.is_empty()) {
            checked.findings.push(unlike);
        }
    }
    Ok(checked)
}

/// Recording with the late channels moved to their rows: the value of a channel for row `i` is that of row `i + lag`.
/// The rows at the ends lack some channels; their values are predicted from the other channels.
///
/// # Errors
/// Lags of another number than the channels; late channels that the others do not predict.
pub fn realigned(frames: &[Frame], lags: &[i32]) -> Result<Vec<Frame>, CalibrateError> {
    if let Some(frame) = frames.iter().find(|frame| frame.len() != lags.len()) {
        return Err(CalibrateError::Channels { got: frame.len(), expected: lags.len() });
    }
    if frames.is_empty() || lags.iter().all(|lag| *lag == 0) {
        return Ok(frames.to_vec());
    }
    let units = ChannelUnits::of(frames);
    let values = in_units(frames, &units);
    let completed = Realignment::new(lags.to_vec(), &values)?.apply(&values);
    let value = |row: usize, channel: usize| {
        let at = usize::try_from(row as i64 + i64::from(lags[channel])).ok().and_then(|at| frames.get(at));
        at.map_or_else(|| units.invert(channel, completed[row][channel]), |frame| frame[channel])
    };
    Ok((0..frames.len()).map(|row| Frame((0..lags.len()).map(|channel| value(row, channel)).collect())).collect())
}

/// Median force of presses above which they are hardly in newton, N: people and robots touch each other with less (ISO/TS 15066
/// permits 280 N for a moment at a hand), and coats of fabric and foam end at a few ten.
const LARGEST_FORCE_N: f64 = 100.0;

/// Forces of labels that are hardly in newton.
pub fn check_forces(labels: &[Label]) -> Option<Finding> {
    let known: Vec<f64> = labels.iter().map(|label| label.force_n).filter(|force_n| *force_n > 0.0).collect();
    let median_n = dermis::stats::upper_median(&known).filter(|median_n| *median_n > LARGEST_FORCE_N)?;
    let evidence = format!("the median of the forces, N; above {LARGEST_FORCE_N} they are probably in another unit");
    let found =
        Finding::new(FindingKind::Magnitude, median_n, evidence, "give forces in newton: 1 N is 1000 mN or 102 g");
    Some(Finding { severity: Severity::Warning, ..found })
}

/// What is wrong with the positions and forces of labels, by the differences that they are of.
///
/// # Errors
/// A label of a frame that does not exist; as [`check_recording`].
pub fn check_labels(
    skin: &Skin,
    differences: &[Frame],
    labels: &[Label],
    label_frame: LabelFrame,
) -> Result<Vec<Finding>, CalibrateError> {
    use FindingKind::{TruthAxes, TruthShifted, TruthUnrelated};
    if labels.is_empty() {
        return Ok(Vec::new());
    }
    let frame = |label: &Label| {
        let message = || CalibrateError::Label(format!("a label names frame {}, which does not exist", label.row));
        differences.get(label.row).cloned().ok_or_else(message)
    };
    let frames = labels.iter().map(frame).collect::<Result<Vec<Frame>, CalibrateError>>()?;
    let positions_m: Vec<Point3> = labels.iter().map(|label| label.position_m).collect();
    let recording = Recording { frames: &frames, untouched: &[], positions_m: Some(&positions_m), label_frame };
    let mut findings = check_recording(skin, &recording)?.findings;
    findings.retain(|finding| matches!(finding.kind, TruthAxes | TruthShifted | TruthUnrelated));
    for shifted in findings.iter_mut().filter(|finding| finding.kind == TruthShifted) {
        shifted.fix =
            format!("the labels are those of presses {} on: check their order", counted(shifted.lag, "place"));
    }
    findings.extend(check_forces(labels));
    Ok(findings)
}

fn validate(recording: &Recording<'_>, protocol: &Protocol) -> Result<(), CalibrateError> {
    let expected = protocol.channel_count();
    if recording.frames.is_empty() {
        return Err(CalibrateError::Label("the recording has no frame".into()));
    }
    for (what, frames) in [("frame", recording.frames), ("untouched frame", recording.untouched)] {
        check_frames(what, frames, expected)?;
    }
    let (frames, positions) =
        (recording.frames.len(), recording.positions_m.map_or(recording.frames.len(), <[_]>::len));
    if positions != frames {
        let message = format!(
            "{} for {}: one for each frame is needed",
            counted(positions, "position"),
            counted(frames, "frame")
        );
        return Err(CalibrateError::Label(message));
    }
    Ok(())
}

/// A check in progress. Channels are columns of the file unless a comment says otherwise.
struct Check<'a> {
    recording: &'a Recording<'a>,
    body: Body,
    /// The protocol by which signs are judged: of amplitudes where signs are lost.
    protocol: Protocol,
    model: ModelChannels,
    untouched: Option<Vec<f64>>,
    differences: Vec<Frame>,
    columns: Vec<Vec<f64>>,
    constant: Vec<usize>,
    /// Those that use an electrode without connection.
    of_open: Vec<usize>,
    /// Channels of the design at a driven electrode, which tell of its contact and are not judged one by one.
    driven: Vec<bool>,
    dead: Vec<usize>,
    left_out: Vec<usize>,
    lags: Vec<i32>,
    findings: Vec<Finding>,
    figures: Figures,
}

impl<'a> Check<'a> {
    fn new(skin: &Skin, recording: &'a Recording<'a>) -> Result<Self, CalibrateError> {
        let model = ModelChannels::new(skin)?;
        let untouched = mean(recording.untouched);
        let differences = match &untouched {
            Some(untouched) => recording.frames.iter().map(|frame| frame - untouched).collect(),
            None => recording.frames.to_vec(),
        };
        let columns = values::columns(recording.frames);
        let constant = values::constant_channels(&columns);
        Ok(Check {
            recording,
            body: skin.design().body.clone(),
            protocol: skin.design().protocol.clone(),
            figures: Figures { model_untouched: model.untouched.clone(), ..Figures::default() },
            model,
            untouched: untouched.map(|frame| frame.0),
            differences,
            columns,
            dead: constant.clone(),
            constant,
            of_open: Vec::new(),
            driven: order::driven(&skin.design().protocol),
            left_out: Vec::new(),
            lags: Vec::new(),
            findings: Vec::new(),
        })
    }

    /// Signs that are lost as a whole; from then on amplitudes are compared. Returns whether changes can be compared
    /// with the model.
    fn untouched_signs(&mut self) -> bool {
        let found = match &self.untouched {
            Some(untouched) => signs::of_untouched(untouched, &self.model, &self.protocol),
            None => signs::of_differences(&self.columns, &self.model),
        };
        if let Some(finding) = found {
            let lost = finding.kind == FindingKind::SignLost;
            if lost && self.untouched.is_some() {
                self.drop_signs();
            }
            self.findings.push(finding);
            return !lost || self.untouched.is_some();
        }
        true
    }

    fn drop_signs(&mut self) {
        self.model.drop_signs();
        self.protocol = self.protocol.clone().with_amplitude_only(true);
        self.figures.model_untouched = self.model.untouched.clone();
    }

    /// The order of the channels that fits best.
    fn order(&mut self, comparable: bool) -> Order {
        let measured = self.correlation_of_file().filter(|_| comparable);
        let (untouched, dead) = (self.untouched.clone(), self.dead.clone());
        let search = |model: &ModelChannels, protocol: &Protocol| {
            Matcher::new(protocol, model, untouched.as_deref(), measured.as_ref(), &dead).search(model)
        };
        let (own, mut better) = search(&self.model, &self.protocol);
        (self.figures.untouched_cosine, self.figures.correlation_cosine) = (own.untouched, own.changes);
        let mut found = Vec::new();
        if let Some(finding) = self.lost_in_changes(own, better.as_ref(), measured.as_ref()) {
            found.push(finding);
            self.drop_signs();
            better = search(&self.model, &self.protocol).1;
        }
        let score = better.as_ref().map_or(own, |better| better.score);
        if let Some(BetterOrder { order, score }) = &better {
            found.push(describe::order(order, *score, own, &self.protocol));
        } else if self.untouched.is_some() && own.untouched.abs() < describe::UNLIKE {
            found.push(describe::unlike(own));
        }
        let mut order = better.map_or_else(|| Order::of_design(&self.protocol), |better| better.order);
        if let Some(finding) = self.all_turned(score, &order).filter(|_| comparable) {
            order.signs.iter_mut().for_each(|sign| *sign = -*sign);
            found.push(finding);
        }
        self.findings.extend(found);
        order
    }

    /// Correlations of the channels over the rows, in the order of the file; `None` for few rows.
    fn correlation_of_file(&self) -> Option<Mat<f64>> {
        let enough = self.differences.len() >= MIN_ROWS;
        let aligned = || realigned(&self.differences, &self.lags).unwrap_or_else(|_| self.differences.clone());
        enough.then(|| correlations(&standardised(&in_robust_units(&aligned()))))
    }

    /// Signs that are lost, by the changes alone: amplitudes fit the model clearly better.
    fn lost_in_changes(
        &self,
        own: Score,
        better: Option<&BetterOrder>,
        measured: Option<&Mat<f64>>,
    ) -> Option<Finding> {
        if self.protocol.amplitude_only() || self.untouched.is_some() {
            return None;
        }
        let mut model = self.model.clone();
        model.drop_signs();
        let protocol = self.protocol.clone().with_amplitude_only(true);
        let lost = Matcher::new(&protocol, &model, None, measured, &self.dead).score(&Order::of_design(&protocol));
        let known = better.map_or(own.changes, |better| better.score.changes);
        describe::lost(lost.changes, known)
    }

    /// All signs turned: by the untouched frame, or by single touches of the model.
    fn all_turned(&self, score: Score, order: &Order) -> Option<Finding> {
        if self.protocol.amplitude_only() && self.untouched.is_some() {
            return None;
        }
        if score.untouched < -describe::UNLIKE {
            return Some(describe::turned_untouched(score.untouched, &self.protocol));
        }
        let differences: Vec<Vec<f64>> = self.differences.iter().map(|frame| order.apply(frame)).collect();
        let fit = TouchFit::new(&to_matrix(&differences), &self.model);
        let enough = differences.len() >= values::MIN_ROWS && fit.is_turned();
        enough.then(|| describe::turned_changes(fit.opposite, self.untouched.is_some(), &self.protocol))
    }

    /// The differences in the order of the design, rows x channels.
    fn mended(&self, order: &Order) -> Vec<Frame> {
        self.differences.iter().map(|frame| Frame(order.apply(frame))).collect()
    }

    /// Electrodes without connection: the values of their drives are dead, or scatter far more than others.
    fn open_electrodes(&mut self) {
        let broken = broken_channels(self.recording.untouched);
        let is_usable = |channel: usize| !self.dead.contains(&channel) && !broken.contains(&channel);
        let open = disconnected_electrodes(&self.protocol, is_usable);
        let channels = self.protocol.channels();
        let uses = |channel: &usize| open.iter().any(|&electrode| channels[*channel].uses(electrode));
        self.of_open = (0..channels.len()).filter(uses).collect();
        self.dead.extend(&self.of_open);
        self.dead.sort_unstable();
        self.dead.dedup();
        self.findings.extend(open.into_iter().map(describe::open));
    }

    /// Late channels, and channels that are noise.
    fn late(&mut self, mended: &[Frame], order: &Order) -> LagEvidence {
        let mut evidence = lag_evidence(&to_rows(&in_robust_units(mended)), &self.protocol);
        let dead_in_design: Vec<usize> =
            (0..order.columns.len()).filter(|c| self.dead.contains(&order.columns[*c])).collect();
        dead_in_design.iter().for_each(|&channel| evidence.lags[channel] = 0);
        for lag in LAGS.filter(|lag| *lag != 0) {
            let late: Vec<usize> = (0..evidence.lags.len()).filter(|&channel| evidence.lags[channel] == lag).collect();
            if late.len() < MIN_LATE {
                late.iter().filter(|&&channel| self.driven[channel]).for_each(|&channel| evidence.lags[channel] = 0);
            }
        }
        self.lags = vec![0; order.columns.len()];
        order.columns.iter().zip(&evidence.lags).for_each(|(&column, &lag)| self.lags[column] = lag);
        self.figures.lags = LAGS.collect();
        self.figures.lag_explained = vec![Vec::new(); order.columns.len()];
        for (column, explained) in order.columns.iter().zip(&evidence.explained) {
            self.figures.lag_explained[*column] = explained.clone();
        }
        let noise = describe::noise_only(&evidence, mended, &self.model);
        let noise = noise.into_iter().filter(|&channel| !self.driven[channel]).map(|channel| order.columns[channel]);
        self.dead = noise.chain(self.constant.clone()).chain(self.of_open.clone()).collect();
        self.dead.sort_unstable();
        self.dead.dedup();
        self.findings.retain(|finding| finding.kind != FindingKind::Late);
        let late: Vec<Finding> =
            LAGS.filter(|lag| *lag != 0).filter_map(|lag| describe::late(lag, &self.lags, &self.figures)).collect();
        self.findings.extend(late);
        evidence
    }

    /// Everything that needs the channels in their rows: noise, single signs, pairs, drift, memory, truth.
    fn aligned(&mut self, mended: &[Frame], order: &Order, evidence: &LagEvidence, comparable: bool) {
        let aligned = realigned(mended, &evidence.lags).unwrap_or_else(|_| mended.to_vec());
        let values = standardised(&in_robust_units(&aligned));
        let correlation = correlations(&values);
        let column =
            |channels: Vec<usize>| channels.into_iter().map(|channel| order.columns[channel]).collect::<Vec<_>>();
        let turned = if comparable { self.turned(&correlation, order) } else { Vec::new() };
        let late = self.lags.iter().enumerate().filter(|(_, lag)| **lag != 0).map(|(column, _)| column);
        self.left_out = self.dead.iter().copied().chain(column(turned)).chain(late).collect();
        self.pairs(&aligned, order);
        self.over_time(&values, &time::leading_components(&values, &correlation));
        self.axes(&values, order);
        self.figures.correlation = to_rows(&correlation);
        self.figures.model_correlation = to_rows(&self.model.correlation);
    }

    /// Drift, memory, and the truth against the frames.
    fn over_time(&mut self, values: &Mat<f64>, components: &Mat<f64>) {
        let mut by_truth = None;
        if let Some(positions_m) = self.recording.positions_m {
            self.figures.shift_explained = truth::explained(components, positions_m);
            self.figures.shifts = truth::SHIFTS.collect();
            let shifted = truth::shifted(&self.figures.shift_explained);
            self.findings.extend(shifted.or_else(|| truth::shifted_in_noise(values, positions_m)));
            by_truth = truth::memory(components, positions_m);
        }
        if let Some(course) = time::course(values, components) {
            self.figures.drift = dermis::stats::upper_median(&course.drift).unwrap_or(0.0);
            self.figures.memory = by_truth.unwrap_or(course.memory);
            self.findings.extend(time::notes(self.figures.drift, self.figures.memory, by_truth.is_some()));
            self.figures.trend = course.trend;
        }
    }

    /// Positions with other axes than those of the skin, of other rows, or of other frames, by the model. Those whose rows are known
    /// to be others already are not judged.
    fn axes(&mut self, values: &Mat<f64>, order: &Order) {
        let shifted = self.findings.iter().any(|finding| finding.kind == FindingKind::TruthShifted);
        let Some(positions_m) = self.recording.positions_m else { return };
        if shifted || self.recording.label_frame != LabelFrame::Skin {
            return;
        }
        let is_sound = |channel: &usize| !self.left_out.contains(&order.columns[*channel]);
        let channels: Vec<usize> = (0..order.columns.len()).filter(is_sound).collect();
        let labelled = Labelled { values, positions_m, channels: &channels };
        let own = (-truth::SHIFTS.start()) as usize;
        let is_explained = self.figures.shift_explained.get(own).is_some_and(|explained| *explained >= truth::MIN);
        self.findings.extend(axes::other_places(&labelled, &self.model, &self.body, is_explained));
    }

    /// Channels of the design whose sign is turned, where not all are.
    fn turned(&mut self, correlation: &Mat<f64>, order: &Order) -> Vec<usize> {
        let dead: Vec<usize> = (0..order.columns.len()).filter(|c| self.dead.contains(&order.columns[*c])).collect();
        let untouched = self.untouched.as_ref().filter(|_| !self.protocol.amplitude_only());
        let (mut channels, worst) = match untouched {
            Some(frame) => (signs::turned_untouched(&order.apply(frame), &self.model, &self.protocol, &dead), -1.0),
            None if self.differences.len() >= MIN_ROWS => {
                let turned = signs::turned_correlations(correlation, &self.model, &self.protocol, &dead);
                (turned.channels, turned.worst)
            }
            None => (Vec::new(), 0.0),
        };
        channels.retain(|channel| !dead.contains(channel) && !self.driven[*channel]);
        let unlike = self.findings.iter().any(|finding| finding.kind == FindingKind::UnlikeModel);
        if channels.is_empty() || unlike {
            return Vec::new();
        }
        let columns = channels.iter().map(|&channel| order.columns[channel]).collect();
        self.findings.push(describe::turned(columns, worst));
        channels
    }

    /// Channels that disagree with those of the same quantity, or that record one sign.
    fn pairs(&mut self, aligned: &[Frame], order: &Order) {
        let left_out: Vec<usize> =
            (0..order.columns.len()).filter(|c| self.left_out.contains(&order.columns[*c])).collect();
        let untouched = self.untouched.as_ref().map(|frame| order.apply(frame));
        let rows: Vec<Vec<f64>> = aligned.iter().map(|frame| frame.0.clone()).collect();
        let found = pairs::disagreeing(untouched.as_deref(), &to_matrix(&rows), &self.protocol, &left_out);
        let signed = ModelChannels::signed_untouched(&self.model);
        let blind = pairs::one_sign(aligned, &self.protocol, &signed);
        for mut finding in found.into_iter().chain(blind) {
            finding.channels = finding.channels.iter().map(|&channel| order.columns[channel]).collect();
            finding.channels.sort_unstable();
            self.findings.push(finding);
        }
        self.figures.untouched = untouched.unwrap_or_default();
    }

    /// What the values alone show.
    fn of_values(&mut self) {
        let is_explained = |channel: &usize| self.of_open.contains(channel);
        let dead: Vec<usize> = self.dead.iter().copied().filter(|channel| !is_explained(channel)).collect();
        let constant = self.constant.iter().filter(|channel| !is_explained(channel)).count();
        self.findings.extend(values::dead(dead, constant, describe::NOISE));
        self.findings.extend(values::saturated(&self.columns, self.recording.untouched, &self.dead));
        self.findings.extend(values::outliers(&self.columns, &self.dead));
        let magnitude = match &self.untouched {
            Some(untouched) => magnitude::of_untouched(untouched, &self.model.untouched),
            None => {
                let rows: Vec<Vec<f64>> = self.differences.iter().map(|frame| frame.0.clone()).collect();
                magnitude::of_changes(&to_matrix(&rows), &self.model.untouched)
            }
        };
        self.findings.extend(magnitude);
    }

    fn finish(mut self, order: &Order) -> Checked {
        self.findings.sort_by_key(|finding| (!finding.is_fault(), finding.kind, finding.lag));
        let columns = if order.changes.is_empty() { Vec::new() } else { order.columns.clone() };
        Checked { findings: self.findings, lags: self.lags, columns, figures: self.figures }
    }
}
