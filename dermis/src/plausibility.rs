//! Whether frames can be those of the skin that a design describes: asked before contacts are computed from them.
//!
//! Frames are compared by their [agreement](crate::estimate::agreement) beyond chance.
//!
//! ```
//! use dermis::finding::FindingKind;
//! use dermis::frame::Frame;
//! use dermis::plausibility::Plausibility;
//! use dermis::skin::Skin;
//!
//! let skin = Skin::load("cylinder30")?;
//! let rest = skin.forward().solve(skin.forward().rest_conductivity())?;
//! let check = Plausibility::new(&skin.design().protocol, &rest, &[]);
//! assert!(check.of_baseline(&rest).is_none());
//! let turned = Frame(rest.iter().map(|value| -value).collect());
//! assert_eq!(check.of_baseline(&turned).map(|found| found.kind), Some(FindingKind::SignTurned));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub use crate::estimate::agreement::DOUBTFUL;
use crate::estimate::agreement::{agreement, limited, median_size};
use crate::finding::{Finding, FindingKind, Severity};
use crate::forward::Matrix;
use crate::frame::{Differences, Frame, mean};
use crate::linalg::dot;
use crate::protocol::Protocol;
use crate::skin::Skin;
use crate::stats::upper_median;
use crate::text::ranges;

/// Frames that agree less than this are wrong: it is halfway to chance.
pub const WRONG: f64 = 0.4;
/// Another order or other signs are named if they agree at least this well.
const NAMED: f64 = 0.9;
/// ... and if they leave at most this part of what the given order leaves, and of what they change in the model's own frame.
const FAR_MORE: f64 = 0.25;
/// Agreements are not known better than this.
const ROUNDING: f64 = 1e-9;
/// Sorted values that agree at least this well are the right values in another order.
const SAME_VALUES: f64 = 0.97;
/// The median size of a touched frame over that of its baseline: beyond the first range it may be in other units, beyond the
/// second it is.
const RATIOS: [[f64; 2]; 2] = [[0.5, 2.0], [0.2, 5.0]];
/// With the model's own frame as baseline: the part of the change that is the same in all frames, beyond which contacts are
/// doubtful and wrong, if it is at least this part of the frame; and the fewest frames that can tell.
const COMMON: [f64; 2] = [0.5, 0.9];
const MIN_ERROR: f64 = 0.02;
const MIN_ROWS: usize = 5;
/// With another baseline: the part of a frame beyond which a change that is the same in all frames is looked at, and how much of it
/// so many touches must explain. Of the twins' single presses four explain 0.73 and more, of the difference of two skins 0.07 to 0.65.
const MIN_CHANGE: f64 = 5e-4;
const TOUCHES: usize = 4;
const MIN_EXPLAINED: f64 = 0.67;
/// ... and the largest part of a frame that they may leave unexplained: up to six touches of the twins leave 0.02, another skin 0.07.
const MAX_UNEXPLAINED: f64 = 0.05;
/// Largest size of an untouched frame over that of the model, and of that over it: sheet resistances differ from their designs by
/// less, units by more.
const LARGEST_SCALE: f64 = 30.0;
/// Fewer channels than this without a driven electrode tell nothing; all channels are compared then.
const MIN: usize = 8;
/// ... and so do channels that are balanced in the untouched model, as those of a bridge: their median size is at most this part of that
/// of all. Touches change them by more than they are.
const BALANCED: f64 = 1e-3;

/// Compares frames with the model of a skin.
#[derive(Debug, Clone)]
pub struct Plausibility<'a> {
    protocol: &'a Protocol,
    /// The untouched frame of the model, ohm; of amplitudes where the instrument reports these.
    model: Frame,
    /// All channels that are compared, and those of them without a driven electrode.
    used: Vec<usize>,
    compared: Vec<usize>,
}

impl<'a> Plausibility<'a> {
    /// For the untouched frame of a model, ohm. Channels that are left out are not compared.
    ///
    /// # Panics
    /// If the frame has another length than the protocol.
    pub fn new(protocol: &'a Protocol, model: &Frame, left_out: &[usize]) -> Self {
        assert_eq!(model.len(), protocol.channel_count(), "a value for each channel");
        let mut model = model.clone();
        protocol.drop_signs(&mut model);
        let used: Vec<usize> = (0..model.len()).filter(|channel| !left_out.contains(channel)).collect();
        // The contacts of driven electrodes are known least.
        let far: Vec<usize> = protocol.undriven().filter(|channel| !left_out.contains(channel)).collect();
        let size = |channels: &[usize]| median_size(channels.iter().map(|&channel| model[channel]));
        let tells = far.len() >= MIN && size(&far) > BALANCED * size(&used);
        Plausibility { protocol, compared: if tells { far } else { used.clone() }, used, model }
    }

    /// What is wrong with frames and their baseline, or with differences from an unknown one.
    ///
    /// # Errors
    /// As [`of_touched`](Self::of_touched).
    pub fn of(&self, differences: &Differences, skin: &Skin) -> crate::Result<Vec<Finding>> {
        let Differences { frames, untouched, baseline, .. } = differences;
        let Some(baseline) = baseline else { return Ok(self.of_differences(frames).into_iter().collect()) };
        let add = |difference: &Frame| Frame(difference.iter().zip(baseline.iter()).map(|(a, b)| a + b).collect());
        let [frames, untouched] = [frames, untouched].map(|frames| frames.iter().map(add).collect::<Vec<Frame>>());
        let untouched = self.of_untouched(&untouched).into_iter();
        let untouched = untouched.chain(self.of_baseline(baseline));
        Ok(untouched.chain(self.of_touched(&frames, &differences.untouched, baseline, skin)?).collect())
    }

    /// What is wrong with an untouched frame, ohm: it agrees with the model of the design in no unit. A finding of
    /// [`Severity::Error`] is certain. `None` if nothing is.
    pub fn of_baseline(&self, baseline: &Frame) -> Option<Finding> {
        let what = "untouched frame";
        if let Some(found) = self.without_values(baseline, what) {
            return Some(found);
        }
        let own = self.agreement(baseline, &self.model);
        // Smooth frames agree even if every value is in the place of the next one; the right order explains far more.
        let late = self.other_order(baseline, own);
        if own >= DOUBTFUL && late.is_none() {
            return None;
        }
        let (found, agreement) = self.other_signs(baseline, &self.model).unwrap_or((FindingKind::UnlikeModel, own));
        let evidence = |better: f64| {
            format!(
                "the {what} agrees with the model of the design by {own:.2} (1: exactly, 0: by chance){}",
                if better > own { format!(", and by {better:.2} {}", words(found)) } else { String::new() }
            )
        };
        if found != FindingKind::UnlikeModel {
            return Some(Finding::new(found, own, evidence(agreement), self.fix(found)));
        }
        if let Some((agreement, text)) = late {
            let evidence = format!("{}, and by {agreement:.2} {text}", evidence(own));
            return Some(Finding::new(FindingKind::Order, own, evidence, ORDER));
        }
        let same = self.same_values(baseline, &self.model);
        let (kind, fix) = match same {
            true => (FindingKind::Order, ORDER),
            false => (
                FindingKind::UnlikeModel,
                "check that the frames are of this design: body, electrodes, protocol, wires",
            ),
        };
        let evidence = evidence(own) + if same { "; its values have the right sizes in another order" } else { "" };
        Some(with_severity(Finding::new(kind, own, evidence, fix), own < WRONG))
    }

    /// What is wrong with frames, ohm, for their baseline: they are not frames of the same skin in the same unit. Of single
    /// frames the rows are named, as a warning.
    pub fn of_frames(&self, frames: &[Frame], baseline: &Frame) -> Option<Finding> {
        let judged: Vec<Judged> = frames.iter().map(|frame| self.judge(frame, baseline)).collect();
        let rows_of =
            |is: &dyn Fn(&Judged) -> bool| (0..judged.len()).filter(|&row| is(&judged[row])).collect::<Vec<_>>();
        let (wrong, doubtful) = (rows_of(&Judged::is_wrong), rows_of(&Judged::is_doubtful));
        let most = |rows: &[usize]| 2 * rows.len() > frames.len();
        let (rows, is_certain) = match (most(&wrong), wrong.is_empty(), most(&doubtful)) {
            (true, ..) => (&wrong, true),
            (false, false, _) => (&wrong, false),
            (_, _, true) => (&doubtful, false),
            _ => return None,
        };
        // The most usual one stands for all.
        let middle = rows[rows.len() / 2];
        let mut found = with_severity(self.unlike_baseline(&frames[middle], baseline, &judged[middle]), is_certain);
        if rows.len() < frames.len() {
            found.rows.clone_from(rows);
        }
        Some(found)
    }

    /// What is wrong with differences from an untouched frame, ohm.
    pub fn of_differences(&self, differences: &[Frame]) -> Option<Finding> {
        let wrong = differences.iter().map(|difference| self.without_values(difference, "difference"));
        let wrong: Vec<Option<Finding>> = wrong.collect();
        let rows: Vec<usize> = (0..wrong.len()).filter(|&row| wrong[row].is_some()).collect();
        if 2 * rows.len() > differences.len() {
            return wrong.into_iter().flatten().next();
        }
        let is_whole = |difference: &&Frame| {
            self.agreement(difference, &self.model).abs() >= DOUBTFUL && {
                let ratio = self.ratio(difference, &self.model);
                (RATIOS[0][0]..=RATIOS[0][1]).contains(&ratio)
            }
        };
        let whole = differences.iter().filter(is_whole).count();
        if 2 * whole <= differences.len() || differences.is_empty() {
            return None;
        }
        let evidence =
            "the differences agree with the untouched frame of the model, in size too: they are whole frames";
        let fix = "give the untouched frames with --baseline, in Python as `baseline`";
        Some(Finding::new(FindingKind::UnlikeBaseline, whole as f64 / differences.len() as f64, evidence, fix))
    }

    /// What is doubtful about the size of an untouched frame: no coat is so far from its design, so that the values are not in ohm,
    /// and strengths and forces mean nothing.
    pub fn of_size(&self, baseline: &Frame) -> Option<Finding> {
        let ratio = self.ratio(baseline, &self.model);
        if !(ratio.is_finite() && ratio > 0.0) || (1.0 / LARGEST_SCALE..=LARGEST_SCALE).contains(&ratio) {
            return None;
        }
        let evidence = format!("the untouched frame is {ratio:.1e} times as large as that of the model of the design");
        let fix = "give values in ohm, and currents in ampere: strengths and forces depend on it";
        Some(with_severity(Finding::new(FindingKind::Magnitude, ratio, evidence, fix), false))
    }

    /// What is wrong with untouched frames, ohm: some are not like the others, and their mean is that of neither.
    pub fn of_untouched(&self, untouched: &[Frame]) -> Option<Finding> {
        let usual = |channel: usize| {
            let finite = untouched.iter().map(|frame| frame[channel]).filter(|value| value.is_finite());
            upper_median(&finite.collect::<Vec<f64>>()).unwrap_or(f64::NAN)
        };
        let usual = Frame((0..self.model.len()).map(usual).collect());
        let found = self.of_frames(untouched, &usual).filter(|found| !found.rows.is_empty())?;
        let rows = ranges(&found.rows);
        let evidence = format!("the untouched frames are not alike: those of the rows {rows} are unlike the others");
        Some(with_severity(Finding { evidence, fix: "leave them out".into(), ..found }, false))
    }

    /// The mean square of the noise of a frame, from untouched frames or their deviations; 0 for too few.
    fn noise_square(&self, untouched: &[Frame]) -> f64 {
        let Some(rest) = mean(untouched).filter(|_| untouched.len() >= MIN_ROWS) else { return 0.0 };
        let off =
            |frame: &Frame| self.used.iter().map(|&channel| (frame[channel] - rest[channel]).powi(2)).sum::<f64>();
        untouched.iter().map(off).sum::<f64>() / (untouched.len() - 1) as f64
    }

    /// The change from a baseline that all frames have in common, without a baseline that of the frames themselves; `None` for too
    /// few frames.
    fn common_change(&self, frames: &[Frame], baseline: Option<&Frame>) -> Option<Common> {
        let rest = |channel: usize| baseline.map_or(0.0, |baseline| baseline[channel]);
        let change = |frame: &Frame| Frame((0..frame.len()).map(|channel| frame[channel] - rest(channel)).collect());
        let common = change(&mean(frames).filter(|_| frames.len() >= MIN_ROWS)?);
        let square = |frame: &Frame| self.used.iter().map(|&channel| frame[channel].powi(2)).sum::<f64>();
        let all = frames.iter().map(|frame| square(&change(frame))).sum::<f64>() / frames.len() as f64;
        Some(Common { square: square(&common), change: common, all, whole: square(baseline.unwrap_or(&self.model)) })
    }

    /// What is wrong with frames and their baseline, the mean of the untouched frames, ohm: in each of them, or in all of them
    /// alike. For `untouched` their deviations from it are enough.
    ///
    /// # Errors
    /// A skin whose linear model cannot be computed.
    pub fn of_touched(
        &self,
        frames: &[Frame],
        untouched: &[Frame],
        baseline: &Frame,
        skin: &Skin,
    ) -> crate::Result<Option<Finding>> {
        match self.of_frames(frames, baseline) {
            None => self.of_common_change(frames, untouched, baseline, skin),
            found => Ok(found),
        }
    }

    /// Whether something is wrong with all frames, and not with single ones, by what was found.
    pub fn is_doubtful<'f>(found: impl IntoIterator<Item = &'f Finding>) -> bool {
        found.into_iter().any(|found| found.rows.is_empty())
    }

    /// What is wrong with frames and their baseline: the change is the same in all frames, and no touch explains it, as where the
    /// baseline is of another skin or day, or exchanged with the frames.
    fn of_common_change(
        &self,
        frames: &[Frame],
        untouched: &[Frame],
        baseline: &Frame,
        skin: &Skin,
    ) -> crate::Result<Option<Finding>> {
        let [of_frames, of_untouched] = [frames, untouched].map(|frames| self.noise_square(frames));
        let [of_mean, of_rest] = [frames.len(), untouched.len()].map(|count| 1.0 / count.max(1) as f64);
        // Touches are no noise: of frames and untouched ones those tell the noise of a frame that vary less.
        let noise = of_frames.min(of_untouched);
        let Some(common) = self.common_change(frames, Some(baseline)) else { return Ok(None) };
        let of_change = [noise * of_mean + of_untouched * of_rest, noise * (of_mean + of_rest)];
        for (of_change, is_exchanged) in of_change.into_iter().zip([false, true]) {
            let Some([share, part]) = common.beyond_noise(noise, of_change) else { continue };
            if share < COMMON[1] || part < MIN_CHANGE {
                continue;
            }
            let (jacobian, sign) = (&skin.linearised()?.jacobian, skin.design().sheet.touch.sign());
            let signal = 1.0 - of_change / common.square;
            let [explained, turned] = [sign, -sign].map(|sign| self.explained(&common.change, jacobian, sign) / signal);
            let is_touch = explained >= MIN_EXPLAINED && part * (1.0 - explained).max(0.0).sqrt() <= MAX_UNEXPLAINED;
            if is_touch || is_exchanged && turned < MIN_EXPLAINED {
                continue;
            }
            let evidence = format!(
                "all frames differ from the untouched one by the same {:.1} %, of which touches explain {:.0} %",
                100.0 * part,
                100.0 * explained.clamp(0.0, 1.0)
            );
            let fix = match turned >= MIN_EXPLAINED {
                true => {
                    "exchange the frames and the untouched ones if they are exchanged; else the skin has changed since: give \
                     untouched frames taken just before"
                }
                false => "give untouched frames of the same skin, taken just before",
            };
            let found = Finding::new(FindingKind::UnlikeBaseline, explained, evidence, fix);
            return Ok(Some(with_severity(found, false)));
        }
        Ok(None)
    }

    /// The part of a change that some small touches explain: matching pursuit (Mallat and Zhang 1993, DOI 10.1109/78.258082) with
    /// the changes that single pixels make, of one sign.
    fn explained(&self, change: &Frame, jacobian: &Matrix, sign: f64) -> f64 {
        let mut left = vec![0.0; change.len()];
        self.used.iter().for_each(|&channel| left[channel] = change[channel]);
        let square = |values: &[f64]| dot(values, values);
        let (all, mut norms) = (square(&left), vec![0.0; jacobian.columns]);
        for &channel in &self.used {
            norms.iter_mut().zip(jacobian.row(channel)).for_each(|(norm, value)| *norm += value * value);
        }
        for _ in 0..TOUCHES {
            let mut products = vec![0.0; jacobian.columns];
            for &channel in &self.used {
                let value = sign * left[channel];
                products.iter_mut().zip(jacobian.row(channel)).for_each(|(sum, change)| *sum += value * change);
            }
            let gain = |pixel: usize| if norms[pixel] > 0.0 { products[pixel] / norms[pixel].sqrt() } else { 0.0 };
            let Some(best) = (0..products.len()).max_by(|&a, &b| gain(a).total_cmp(&gain(b))) else { break };
            if gain(best) <= 0.0 {
                break;
            }
            let size = sign * products[best] / norms[best];
            self.used.iter().for_each(|&channel| left[channel] -= size * jacobian.at(channel, best));
        }
        1.0 - square(&left) / all
    }

    /// What is wrong with frames less the untouched frame of the model, ohm: most of their change is the same in all of them, so
    /// that it is the model's error and no touch.
    pub fn of_model_differences(&self, differences: &[Frame]) -> Option<Finding> {
        let [share, part] = self.common_change(differences, None)?.beyond_noise(0.0, 0.0)?;
        if share < COMMON[0] || part < MIN_ERROR {
            return None;
        }
        let evidence = format!(
            "all frames differ from the untouched frame of the model by the same {:.1} %, {:.0} % of their change: that is the \
             model's error, no touch",
            100.0 * part,
            100.0 * share
        );
        let fix = "give untouched frames with --baseline, or fit the design to some first: `dermis fit`";
        Some(with_severity(Finding::new(FindingKind::UnlikeModel, share, evidence, fix), share >= COMMON[1]))
    }

    /// How much two frames agree beyond chance.
    pub fn agreement(&self, a: &Frame, b: &Frame) -> f64 {
        agreement(self.values(a), self.values(b))
    }

    /// The compared values.
    fn values(&self, frame: &Frame) -> impl Iterator<Item = f64> {
        self.compared.iter().map(|&channel| frame[channel])
    }

    /// The size of a frame over that of another one.
    fn ratio(&self, frame: &Frame, other: &Frame) -> f64 {
        median_size(self.compared.iter().map(|&channel| frame[channel]))
            / median_size(self.compared.iter().map(|&channel| other[channel]))
    }

    fn judge(&self, frame: &Frame, baseline: &Frame) -> Judged {
        Judged { agreement: self.agreement(frame, baseline), ratio: self.ratio(frame, baseline) }
    }

    /// A frame without a usable value.
    fn without_values(&self, frame: &Frame, what: &str) -> Option<Finding> {
        let values = || self.used.iter().map(|&channel| frame[channel]);
        if self.used.is_empty() {
            let fix = "leave fewer channels and electrodes out";
            return Some(Finding::new(FindingKind::Dead, 0.0, "no channel is left: all are left out", fix));
        }
        if values().all(|value| value == 0.0) {
            let evidence = format!("every value of the {what} is 0");
            let fix = "check that the instrument measures: its source, its gain, its cable";
            return Some(Finding::new(FindingKind::Dead, 0.0, evidence, fix));
        }
        if let Some(&channel) = self.used.iter().find(|&&channel| !frame[channel].is_finite()) {
            let evidence = format!("channel {channel} of the {what} is {}: it must be finite", frame[channel]);
            let fix = "leave the channel or the frame out";
            return Some(Finding::new(FindingKind::OutlierValue, f64::NAN, evidence, fix).at_channels(vec![channel]));
        }
        let square: f64 = values().map(|value| value * value).sum();
        (!square.is_finite()).then(|| {
            let largest = values().map(f64::abs).fold(0.0, f64::max);
            let evidence = format!("the {what} has values of {largest:e}");
            Finding::new(FindingKind::Magnitude, largest, evidence, "give resistances in ohm")
        })
    }

    /// Other signs with which a frame agrees with another one.
    fn other_signs(&self, frame: &Frame, with: &Frame) -> Option<(FindingKind, f64)> {
        let sized = |frame: &Frame| Frame(frame.iter().map(|value| value.abs()).collect());
        let turned = Frame(frame.iter().map(|value| -value).collect());
        let has_one_sign = |frame: &Frame| {
            let negative = self.compared.iter().filter(|&&channel| frame[channel] < 0.0).count();
            negative == 0 || negative == self.compared.len()
        };
        let of_turned = self.agreement(&turned, with);
        let of_sizes = self.agreement(&sized(frame), &sized(with));
        if of_turned >= NAMED {
            return Some((FindingKind::SignTurned, of_turned));
        }
        let kind = match (has_one_sign(frame), has_one_sign(with)) {
            (true, false) => FindingKind::SignLost,
            (false, true) => FindingKind::SignPresent,
            _ => return None,
        };
        (of_sizes >= NAMED).then_some((kind, of_sizes))
    }

    /// A simple other order that explains far more of an untouched frame than the given one, which agrees with the model by
    /// `own`, in words: values or whole drives late. A symmetry of the skin is no other order: it hardly changes the model's
    /// own frame.
    fn other_order(&self, baseline: &Frame, own: f64) -> Option<(f64, String)> {
        let count = baseline.len();
        let (drives, drive_of) = self.protocol.drives();
        let block = count / drives.len().max(1);
        let is_even = drive_of.iter().enumerate().all(|(channel, &drive)| channel / block.max(1) == drive);
        let rolled = |by: usize| (0..count).map(|channel| (channel + by) % count).collect::<Vec<usize>>();
        let values = [(1, "one value earlier"), (count - 1, "one value later")];
        let of_values = values.map(|(by, text)| (rolled(by), text.to_string()));
        let of_drives = (1..drives.len()).filter(|_| is_even).map(|drive| {
            let text = format!("with the drives in turn from drive {drive} on");
            (rolled(drive * block), text)
        });
        let reverse = ((0..count).rev().collect(), "in reverse".to_string());
        let all = of_values.into_iter().chain(of_drives).chain([reverse]).filter_map(|(order, text)| {
            let agreement = |frame: &Frame| {
                let ordered = Frame(order.iter().map(|&channel| frame[channel]).collect());
                self.agreement(&ordered, &self.model)
            };
            let better = Some(agreement(baseline)).filter(|better| *better >= NAMED)?;
            let least_left = (1.0 - own).min(1.0 - agreement(&self.model));
            (1.0 - better + ROUNDING <= FAR_MORE * least_left).then_some((better, text))
        });
        all.max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Whether a frame has the values of another one, in any order.
    fn same_values(&self, frame: &Frame, other: &Frame) -> bool {
        let sorted = |frame: &Frame| {
            let mut values = limited(self.used.iter().map(|&channel| frame[channel]));
            values.sort_by(f64::total_cmp);
            values.into_iter()
        };
        agreement(sorted(frame), sorted(other)) >= SAME_VALUES
    }

    /// Why a frame does not fit its baseline.
    fn unlike_baseline(&self, frame: &Frame, baseline: &Frame, Judged { agreement, ratio }: &Judged) -> Finding {
        if let Some(found) = self.without_values(frame, "frame") {
            return found;
        }
        let evidence = format!("a frame agrees with its baseline by {agreement:.2} (1: exactly, 0: by chance)");
        if *agreement >= DOUBTFUL {
            let evidence = format!("{evidence}, but its values are {ratio:.3} times as large");
            let fix = match (ratio.log10() / 3.0).round() {
                0.0 => "give both in ohm, with the same gain and the same current".to_string(),
                power => format!(
                    "give both in ohm: the frames are probably in units of {} of the baseline's",
                    if power > 0.0 { "a thousandth" } else { "a thousand" }
                ),
            };
            return Finding::new(FindingKind::Magnitude, *ratio, evidence, fix);
        }
        if let Some((kind, better)) = self.other_signs(frame, baseline) {
            let evidence = format!("{evidence}, and by {better:.2} {}", words(kind));
            return Finding::new(
                kind,
                *agreement,
                evidence,
                "give both with the signs of the design, or both as amplitudes",
            );
        }
        if (RATIOS[0][0]..=RATIOS[0][1]).contains(ratio) && self.same_values(frame, baseline) {
            let evidence = format!("{evidence}; it has the same values in another order");
            return Finding::new(FindingKind::Order, *agreement, evidence, "give both in the order of the protocol");
        }
        let fix = match *ratio < RATIOS[0][0] {
            true => "if they are differences from the untouched skin, give --difference in place of --baseline",
            false => "give untouched frames of the same skin and instrument as the baseline",
        };
        Finding::new(FindingKind::UnlikeBaseline, *agreement, evidence, fix)
    }

    /// What to do about signs.
    fn fix(&self, kind: FindingKind) -> &'static str {
        match kind {
            FindingKind::SignTurned => {
                "exchange plus and minus of the measured pairs, or the sense of the drives; for amplitudes set \
                 protocol.amplitude_only = true"
            }
            FindingKind::SignLost => "record signed values, or set protocol.amplitude_only = true",
            _ => "set protocol.amplitude_only = false: the instrument records signs",
        }
    }
}

/// What to do about another order.
const ORDER: &str = "`dermis check-frames` looks for the order; state it in the design as protocol.pattern = { table = \"channels.csv\" }";

/// A change that all frames have in common.
struct Common {
    change: Frame,
    /// Its square, the mean square of all change, and the square of the baseline.
    square: f64,
    all: f64,
    whole: f64,
}

impl Common {
    /// The part of all change that it is, and its size over that of the baseline, both without noise, whose mean squares are those
    /// of a frame and of the change; `None` where it cannot be told from noise.
    fn beyond_noise(&self, of_frame: f64, of_change: f64) -> Option<[f64; 2]> {
        let own = self.square - of_change;
        let parts = [own / (self.all - of_frame).max(own), (own / self.whole).sqrt()];
        (own > of_change && parts.iter().all(|part| part.is_finite())).then_some(parts)
    }
}

/// How well a frame fits its baseline.
struct Judged {
    agreement: f64,
    ratio: f64,
}

impl Judged {
    fn is_beyond(&self, least: f64, [low, high]: [f64; 2]) -> bool {
        // Not a number, of frames without a size, is beyond.
        !(self.agreement >= least && self.ratio >= low && self.ratio <= high)
    }

    fn is_wrong(&self) -> bool {
        self.is_beyond(WRONG, RATIOS[1])
    }

    fn is_doubtful(&self) -> bool {
        self.is_beyond(DOUBTFUL, RATIOS[0])
    }
}

fn with_severity(finding: Finding, is_certain: bool) -> Finding {
    Finding { severity: if is_certain { Severity::Error } else { Severity::Warning }, ..finding }
}

/// With which signs frames agree.
fn words(kind: FindingKind) -> &'static str {
    match kind {
        FindingKind::SignTurned => "with all signs turned",
        _ => "without signs",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skin::Skin;
    use dermis_sim::random::{sample_rng, standard_normal};
    use rand::RngExt;
    use rand::seq::SliceRandom;

    const NAMES: [&str; 3] = ["cylinder30", "tank16", "skin16"];

    fn untouched(skin: &Skin) -> Frame {
        let mut frame = skin.forward().solve(skin.forward().rest_conductivity()).expect("a solution");
        skin.design().protocol.drop_signs(&mut frame);
        frame
    }

    fn of(frame: &Frame, value: impl Fn(usize, f64) -> f64) -> Frame {
        Frame(frame.iter().enumerate().map(|(channel, &v)| value(channel, v)).collect())
    }

    #[test]
    fn sound_frames_of_uneven_skins_are_not_doubted() {
        for name in NAMES {
            let skin = Skin::load(name).expect("a shipped design");
            let protocol = &skin.design().protocol;
            let rest = untouched(&skin);
            let check = Plausibility::new(protocol, &rest, &[]);
            // The model's own frame, in any unit: a symmetry of the skin is no other order.
            for gain in [1.0, 1e-3, 1.0 / 3.0] {
                assert_eq!(check.of_baseline(&of(&rest, |_, value| gain * value)), None, "{name}");
            }
            for seed in 0..20 {
                let mut rng = sample_rng(1, seed);
                // Any gain; values off by 3 %; a channel that is wrong.
                let gain = 10f64.powf(3.0 * standard_normal(&mut rng));
                let mut baseline = of(&rest, |_, value| gain * value);
                baseline.iter_mut().for_each(|value| *value *= 1.0 + 0.03 * standard_normal(&mut rng));
                baseline[3] *= 1e3;
                assert_eq!(check.of_baseline(&baseline), None, "{name}");
                let touched = of(&baseline, |channel, value| value * if channel % 3 == 0 { 0.7 } else { 1.01 });
                assert_eq!(check.of_frames(std::slice::from_ref(&touched), &baseline), None, "{name}");
                let difference = of(&touched, |channel, value| value - baseline[channel]);
                assert_eq!(check.of_differences(&[difference]), None, "{name}");
            }
        }
    }

    #[test]
    fn wrong_frames_are_named() {
        for name in NAMES {
            let skin = Skin::load(name).expect("a shipped design");
            let protocol = &skin.design().protocol;
            let rest = untouched(&skin);
            let check = Plausibility::new(protocol, &rest, &[]);
            let mut rng = sample_rng(2, 0);
            let noise = Frame((0..rest.len()).map(|_| standard_normal(&mut rng)).collect());
            let mut numbers: Vec<usize> = (0..rest.len()).collect();
            numbers.shuffle(&mut rng);
            let shuffled = of(&rest, |channel, _| rest[numbers[channel]]);
            let certain = |found: Option<Finding>| found.filter(Finding::is_fault).map(|found| found.kind);
            let (turned, zeros) = (of(&rest, |_, value| -value), of(&rest, |_, _| 0.0));
            assert_eq!(certain(check.of_baseline(&zeros)), Some(FindingKind::Dead), "{name}");
            assert_eq!(certain(check.of_baseline(&shuffled)), Some(FindingKind::Order), "{name}");
            assert!(certain(check.of_baseline(&noise)).is_some(), "{name}");
            assert_eq!(certain(check.of_baseline(&turned)), Some(FindingKind::SignTurned), "{name}");
            let huge = of(&rest, |_, _| 1e308);
            for (frame, kind) in [
                (&zeros, FindingKind::Dead),
                (&shuffled, FindingKind::Order),
                (&turned, FindingKind::SignTurned),
                (&huge, FindingKind::Magnitude),
                (&of(&rest, |_, value| 1e-3 * value), FindingKind::Magnitude),
                (&of(&rest, |_, value| 0.1 * value), FindingKind::Magnitude),
                (&of(&noise, |_, value| 0.01 * value), FindingKind::UnlikeBaseline),
            ] {
                assert_eq!(certain(check.of_frames(std::slice::from_ref(frame), &rest)), Some(kind), "{name}");
                // A single one among sound ones is named with its row.
                let found = check.of_frames(&[rest.clone(), frame.clone(), rest.clone()], &rest).expect("a finding");
                assert_eq!((found.severity, found.rows), (Severity::Warning, vec![1]), "{name}");
            }
            assert_eq!(certain(check.of_differences(&[zeros])), Some(FindingKind::Dead));
            assert_eq!(check.of_differences(&[rest]).map(|found| found.kind), Some(FindingKind::UnlikeBaseline));
        }
    }

    #[test]
    fn a_value_that_is_late_and_rolled_drives_are_orders() {
        let skin = Skin::load("cylinder30").expect("a shipped design");
        let rest = untouched(&skin);
        let check = Plausibility::new(&skin.design().protocol, &rest, &[]);
        let mut rng = sample_rng(3, 0);
        let uneven: Vec<f64> = rest.iter().map(|value| value * (1.0 + 0.1 * rng.random::<f64>())).collect();
        for by in [1, 29, 58, 869] {
            let late = of(&rest, |channel, _| uneven[(channel + by) % rest.len()]);
            let found = check.of_baseline(&late).expect("a finding");
            assert_eq!((found.kind, found.severity), (FindingKind::Order, Severity::Error), "{by}: {}", found.evidence);
        }
    }
}
