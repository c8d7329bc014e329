//! The fit of a forward map to labelled presses, and what cross-validation states of it.

use crate::calibration::{Label, Quality};
use crate::covariance::{Extent, PressInput};
use crate::error::CalibrateError;
use crate::forward_map::{Hyperparameters, Samples, predict_left_out};
use crate::locate::{Locator, Setup};
use crate::located::Located;
use crate::matching::evidence;
use crate::posterior::{Posterior, fit_temperature};
use crate::strength::{ForceLaw, Strength, amplitude_between, ratio_spread, relative_error};
use crate::units::Change;
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::stats::{mean, quantile, sorted};
use faer::Mat;
use rayon::prelude::*;
use std::ops::Range;

/// Unlabelled presses help below this number of labels.
const ENOUGH_LABELS: usize = 300;
/// Unlabelled presses that are used, at most: those next to the labels.
const MAX_UNLABELLED: usize = 300;
/// Rounds in which unlabelled presses are located and then used.
const ROUNDS: usize = 3;
/// Part of the unlabelled presses that is used: those located best.
const USED_PART: f64 = 0.8;
/// Factor on the stated variance of an unlabelled position.
const CAUTION: f64 = 2.0;
/// Smallest standard deviation of an unlabelled position, m.
const MIN_SD_M: f64 = 0.001;
/// Part of the labels that follow an unlabelled frame, above which the positions of these frames are estimated.
const SCATTERED_PART: f64 = 0.1;
/// Rounds in which the amplitudes of labels are estimated, each with the map of the changes scaled by those before.
const AMPLITUDE_ROUNDS: usize = 3;
/// Parts of the labels for cross-validation.
const FOLDS: usize = 5;

/// Fits a locator to labelled rows, in units of the channels, and validates it. Where the labels have forces, the law
/// of the amplitudes is fitted first, and the map to changes of one amplitude.
pub(crate) fn fit_locator(
    measured: &[Vec<f64>],
    labels: &[Label],
    mut setup: Setup,
) -> Result<(Locator, Validation), CalibrateError> {
    let mut values = measured.to_vec();
    // The map of equally strong presses is the first step of its own fit.
    let mut first = None;
    for round in 0..AMPLITUDE_ROUNDS {
        let (amplitudes, hyperparameters) = amplitudes_of(Rows { measured, values: &values }, labels, &setup)?;
        setup.strength = Strength::fit(labels, &amplitudes);
        values = equalised(measured, labels, &amplitudes, &setup);
        if setup.strength.is_none() {
            first = (round == 0).then_some(hyperparameters);
            break;
        }
    }
    let recording = Rows { measured, values: &values };
    let fit = Fit::new(recording, labels, &setup, &[]);
    let (fit, hyperparameters) = fit.train(first, Hyperparameters::estimate)?;
    let mut locator = Locator::new(&fit.samples(), &hyperparameters, &setup)?;
    let validation = fit.cross_validate(&hyperparameters, &mut locator)?;
    Ok((locator, validation))
}

/// The amplitude of each labelled press beside what a map of the others expects.
/// Also returns the hyperparameters of this map.
fn amplitudes_of(
    recording: Rows<'_>,
    labels: &[Label],
    setup: &Setup,
) -> Result<(Vec<f64>, Hyperparameters), CalibrateError> {
    let samples = Fit::new(recording, labels, setup, &[]).samples();
    let hyperparameters = Hyperparameters::estimate(&samples)?;
    let predicted = predict_left_out(&samples, &hyperparameters)?;
    let amplitude = |(index, label): (usize, &Label)| {
        let expected: Vec<f64> = predicted.row(index).iter().copied().collect();
        amplitude_between(&expected, &recording.measured[label.row], &setup.untouched)
    };
    Ok((labels.par_iter().enumerate().map(amplitude).collect(), hyperparameters))
}

/// Rows whose labelled presses are scaled to one amplitude: that of their force where it is known.
fn equalised(measured: &[Vec<f64>], labels: &[Label], amplitudes: &[f64], setup: &Setup) -> Vec<Vec<f64>> {
    let mut values = measured.to_vec();
    let Some(Strength { law, .. }) = setup.strength else { return values };
    for (label, amplitude) in labels.iter().zip(amplitudes) {
        let amplitude = law.map_or(*amplitude, |law| law.amplitude(label.force_n));
        let row = &mut values[label.row];
        *row = Change::of(row, &setup.untouched).amplified(1.0 / amplitude).collect();
    }
    values
}

/// The rows of a recording, in units of the channels.
#[derive(Clone, Copy)]
struct Rows<'a> {
    measured: &'a [Vec<f64>],
    /// With labelled rows scaled to one amplitude.
    values: &'a [Vec<f64>],
}

/// The state of a fit: what is known of the position of each frame.
struct Fit<'a> {
    recording: Rows<'a>,
    labels: &'a [Label],
    setup: &'a Setup,
    /// Frames that are not used, ascending.
    held_out: &'a [usize],
    /// Position of each frame and its variance per axis, where it is known or estimated.
    positions: Vec<Option<(Point3, f64)>>,
    /// Frames that the map is conditioned on, ascending.
    used: Vec<usize>,
}

impl<'a> Fit<'a> {
    /// Trains on labels, and on unlabelled frames where there are few labels. The frames in `held_out`, ascending, are
    /// not used.
    fn train(
        mut self,
        first: Option<Hyperparameters>,
        estimate: impl Fn(&Samples) -> Result<Hyperparameters, CalibrateError>,
    ) -> Result<(Self, Hyperparameters), CalibrateError> {
        let mut hyperparameters = first.map_or_else(|| estimate(&self.samples()), Ok)?;
        // The amplitude of an unlabelled press is not known.
        if self.labels.len() < ENOUGH_LABELS && self.setup.strength.is_none() {
            for _ in 0..ROUNDS {
                self.use_unlabelled(&Locator::new(&self.samples(), &hyperparameters, self.setup)?);
                hyperparameters = estimate(&self.samples())?;
            }
            return Ok((self, hyperparameters));
        }
        let before = self.unlabelled_before_labels();
        if before.len() as f64 > SCATTERED_PART * self.labels.len() as f64 {
            self.place(&before, &Locator::new(&self.samples(), &hyperparameters, self.setup)?);
            hyperparameters = estimate(&self.samples())?;
        }
        Ok((self, hyperparameters))
    }

    fn new(recording: Rows<'a>, labels: &'a [Label], setup: &'a Setup, held_out: &'a [usize]) -> Self {
        let mut positions = vec![None; recording.values.len()];
        labels.iter().for_each(|label| positions[label.row] = Some((label.position_m, 0.0)));
        let used = labels.iter().map(|label| label.row).collect();
        Fit { recording, labels, setup, held_out, positions, used }
    }

    fn samples(&self) -> Samples {
        let values = self.recording.values;
        let known: Vec<Point3> = self.labels.iter().map(|label| label.position_m).collect();
        let centre_m = Extent::of(&known).centre_m;
        let position = |row: usize| self.positions[row].expect("frames that are used have a position");
        let previous = |row: usize| row.checked_sub(1).and_then(|before| self.positions[before]);
        Samples {
            values: Mat::from_fn(self.used.len(), values[0].len(), |i, j| values[self.used[i]][j]),
            inputs: (self.used.iter())
                .map(|&row| PressInput {
                    position_m: position(row).0,
                    previous_m: previous(row).map_or(centre_m, |(position_m, _)| position_m),
                    number: row as f64,
                })
                .collect(),
            position_variance_m2: self.used.iter().map(|&row| position(row).1).collect(),
        }
    }

    /// Estimates the positions of frames; returns the variance of each per axis.
    fn place(&mut self, rows: &[usize], locator: &Locator) -> Vec<f64> {
        let place = |&row: &usize| {
            let previous_m =
                row.checked_sub(1).and_then(|before| self.positions[before]).map(|(position_m, _)| position_m);
            let located = locator.locate(&self.recording.measured[row], previous_m, row as f64);
            let variance = located.sd_m().powi(2) + MIN_SD_M.powi(2);
            self.positions[row] = Some((located.position_m, CAUTION * variance));
            variance
        };
        rows.iter().map(place).collect()
    }

    /// The unlabelled frames before labelled ones: their presses are in the memory of the skin.
    fn unlabelled_before_labels(&self) -> Vec<usize> {
        let before = self.labels.iter().filter_map(|label| label.row.checked_sub(1));
        before.filter(|row| self.positions[*row].is_none() && self.held_out.binary_search(row).is_err()).collect()
    }

    /// Locates unlabelled frames next to the labels and uses those located best.
    fn use_unlabelled(&mut self, locator: &Locator) {
        let labelled: Vec<usize> = self.labels.iter().map(|label| label.row).collect();
        let rows = self.unlabelled_rows(&labelled);
        let variances = self.place(&rows, locator);
        let mut found: Vec<(usize, f64)> = rows.into_iter().zip(variances).collect();
        found.sort_by(|a, b| a.1.total_cmp(&b.1));
        found.truncate((USED_PART * found.len() as f64) as usize);
        self.used = labelled.into_iter().chain(found.into_iter().map(|(row, _)| row)).collect();
        self.used.sort_unstable();
    }

    /// The unlabelled frames nearest to the labels, ascending.
    fn unlabelled_rows(&self, labelled: &[usize]) -> Vec<usize> {
        let is_free = |row: &usize| labelled.binary_search(row).is_err() && self.held_out.binary_search(row).is_err();
        let mut rows: Vec<usize> = (0..self.recording.values.len()).filter(is_free).collect();
        let apart = |row: &usize| {
            let next = labelled.partition_point(|label| label < row);
            let after = labelled.get(next).map_or(usize::MAX, |label| label - row);
            let before = next.checked_sub(1).map_or(usize::MAX, |before| row - labelled[before]);
            after.min(before)
        };
        rows.sort_by_key(apart);
        rows.truncate(MAX_UNLABELLED);
        rows.sort_unstable();
        rows
    }

    /// Locates each label by a map that has not seen it, sets the temperature of the locator so that regions hold, and
    /// the deviation of its forces.
    fn cross_validate(
        &self,
        hyperparameters: &Hyperparameters,
        locator: &mut Locator,
    ) -> Result<Validation, CalibrateError> {
        let folds = folds(self.labels.len());
        let locators: Vec<Locator> = folds
            .par_iter()
            .map(|fold| self.locator_without(fold, hyperparameters))
            .collect::<Result<_, CalibrateError>>()?;
        let measured = self.recording.measured;
        let posterior = |index: usize| {
            let fold = folds.iter().position(|fold| fold.contains(&index)).expect("the folds cover all labels");
            let row = self.labels[index].row;
            // As in use: the press before is only estimated.
            let locator = &locators[fold];
            let located = |before: usize| locator.locate(&measured[before], None, before as f64);
            let previous_m = row.checked_sub(1).map(|before| located(before).position_m);
            locator.posterior(&measured[row], previous_m, row as f64)
        };
        let posteriors: Vec<Posterior<'_>> = (0..self.labels.len()).into_par_iter().map(posterior).collect();
        let truth_m: Vec<Point3> = self.labels.iter().map(|label| label.position_m).collect();
        locator.temperature = fit_temperature(&posteriors, &truth_m);
        let located = posteriors.par_iter().map(|posterior| posterior.located(locator.temperature)).collect();
        let validation = Validation { located, unlabelled: self.used.len() - self.labels.len() };
        if let Some(ratios) = validation.log_force_ratios(self.labels, locator.force_law()) {
            locator.set_force_deviation(&ratios);
        }
        Ok(validation)
    }

    /// A locator that has not seen some labels.
    fn locator_without(
        &self,
        labels: &Range<usize>,
        hyperparameters: &Hyperparameters,
    ) -> Result<Locator, CalibrateError> {
        let held_out: Vec<usize> = self.labels[labels.clone()].iter().map(|label| label.row).collect();
        let kept = [&self.labels[..labels.start], &self.labels[labels.end..]].concat();
        let estimate = |samples: &Samples| Hyperparameters::with_covariance(samples, hyperparameters.covariance);
        let fit = Fit::new(self.recording, &kept, self.setup, &held_out);
        let (fit, hyperparameters) = fit.train(None, estimate)?;
        Locator::new(&fit.samples(), &hyperparameters, self.setup)
    }
}

/// Contiguous parts of some labels.
fn folds(labels: usize) -> Vec<Range<usize>> {
    (0..FOLDS).map(|fold| fold * labels / FOLDS..(fold + 1) * labels / FOLDS).collect()
}

/// Labels located by maps that have not seen them.
pub(crate) struct Validation {
    located: Vec<Located>,
    /// Unlabelled presses that the map uses.
    unlabelled: usize,
}

impl Validation {
    pub(crate) fn quality(&self, labels: &[Label], law: Option<&ForceLaw>) -> Quality {
        let [located_m, labels_m]: [Vec<Point3>; 2] = [
            self.located.iter().map(|located| located.position_m).collect(),
            labels.iter().map(|label| label.position_m).collect(),
        ];
        let errors_m: Vec<f64> = located_m.iter().zip(&labels_m).map(|(a, b)| distance(*a, *b)).collect();
        let ratios = self.log_force_ratios(labels, law);
        Quality {
            labels: labels.len(),
            unlabelled: self.unlabelled,
            mean_error_m: mean(&errors_m),
            evidence: evidence(&located_m, &labels_m, &folds(labels.len())),
            force_error: ratios.as_deref().map(relative_error),
            force_spread: ratios.as_deref().map(ratio_spread),
        }
    }

    /// The logarithms of the estimated over the true forces.
    fn log_force_ratios(&self, labels: &[Label], law: Option<&ForceLaw>) -> Option<Vec<f64>> {
        let law = law?;
        let ratio = |(located, label): (&Located, &Label)| (law.force_n(located.amplitude)[0] / label.force_n).ln();
        Some(self.located.iter().zip(labels).map(ratio).collect())
    }

    /// The misfit that 99 % of the labels do not exceed.
    pub(crate) fn usual_misfit(&self) -> f64 {
        quantile(&sorted(self.located.iter().map(|located| located.misfit)), 0.99)
    }
}
