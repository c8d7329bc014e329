//! The most sensitive test for a small touch in the voltages.

use crate::estimate::whitening::Whitening;
use crate::forward::Matrix;
use crate::linalg::DistinctColumns;
use crate::pipeline::touch_detector::statistic;
use crate::skin::Skin;
use crate::stats::{rms, upper_median};
use pulp::{Simd, WithSimd};

/// Places of touches that are tried, at most.
const MAX_PLACES: usize = 1000;
/// Lanes of the sums.
const LANES: usize = 16;
/// The quantile that the largest of 1,000 outputs of noise exceeds once in an hour at 120 frames a second:
/// `Q(z) = 1 / (1000 x 432,000)`; neighbouring places are not independent, so that it is rarer.
const QUANTILE: f64 = 5.95;
/// The deviation of an output is measured in the frames of the tare and may be larger by this many of its standard errors, which
/// are this part of it over the root of the number of frames.
const ERRORS: f64 = 2.0;
const MEDIAN_ERROR: f64 = 1.17;
/// The standard deviation of a normal distribution over the median of its absolute values.
const NORMAL_MEDIAN: f64 = 1.4826;
/// With fewer distinct values for each mode of the sheet, as of a few electrodes, a touch is much like drift.
const VALUES_PER_MODE: usize = 3;
/// A touch ends below this fraction of the threshold.
const RELEASE: f64 = 0.6;

/// For each place the best linear test for a small touch there (North, 1963, DOI 10.1109/PROC.1963.2383): the product of a
/// difference with the change by a touch, both whitened by the noise of the channels and by drift. The statistic is the largest
/// over the places, in standard deviations.
///
/// A touch of known form and place is felt at `QUANTILE` deviations of one number, where the sum of all squares of
/// [`TouchDetector`](super::touch_detector::TouchDetector) needs as much of a number whose deviation is `sqrt(2 n)`.
#[derive(Debug, Clone)]
pub(super) struct MatchedFilter {
    /// Of the changes of the channels by touches.
    distinct: DistinctColumns,
    /// Places x distinct channels, zeros behind the last one: unit deviation of each product.
    table: Vec<f32>,
    width: usize,
    whitening: Whitening,
    /// Of the sheet alone, if the channels tell more than that.
    sheet: Option<Whitening>,
    over_noise: Vec<f64>,
    threshold: f64,
}

impl MatchedFilter {
    /// For noise, drift by its modes (modes x channels, ohm), of which the first `of_sheet` are those of the sheet, and the untouched
    /// differences that they were measured in.
    ///
    /// # Errors
    /// A skin whose forward problem cannot be solved.
    pub(super) fn new(
        skin: &Skin,
        modes: &Matrix,
        of_sheet: usize,
        noise_ohm: &[f64],
        untouched: &[Vec<f64>],
    ) -> crate::Result<Self> {
        let jacobian = &skin.linearised()?.jacobian;
        let sign = skin.design().sheet.touch.sign();
        let is_usable = |sd: &f64| sd.is_finite() && *sd > 0.0;
        let over_noise: Vec<f64> = noise_ohm.iter().map(|sd| if is_usable(sd) { 1.0 / sd } else { 0.0 }).collect();
        let by = |modes_used: usize| Whitening::new((0..modes_used).map(|mode| times(modes.row(mode), &over_noise)));
        let whitening = by(modes.rows);
        let places = (0..jacobian.columns).step_by(jacobian.columns.div_ceil(MAX_PLACES));
        let values = places.clone().flat_map(|place| (0..jacobian.rows).map(move |row| sign * jacobian.at(row, place)));
        let changes = Matrix { rows: places.len(), columns: jacobian.rows, values: values.collect() };
        let (distinct, of_distinct) = DistinctColumns::of(&changes);
        let width = of_distinct.columns.next_multiple_of(LANES);
        let mut table = Vec::with_capacity(changes.rows * width);
        for place in 0..changes.rows {
            let mut row = times(changes.row(place), &over_noise);
            whitening.apply(&mut row);
            let norm = crate::linalg::dot(&row, &row).sqrt().max(f64::MIN_POSITIVE);
            table.extend(of_distinct.row(place).iter().map(|value| (value / norm) as f32));
            table.resize(table.len().next_multiple_of(width), 0.0);
        }
        let sheet = (of_distinct.columns >= VALUES_PER_MODE * of_sheet).then(|| by(of_sheet));
        let mut filter =
            MatchedFilter { distinct, table, width, whitening, sheet, over_noise, threshold: f64::INFINITY };
        filter.measure(untouched);
        Ok(filter)
    }

    /// Measures the deviation of each product: noise of channels that is not independent is in few directions.
    fn measure(&mut self, untouched: &[Vec<f64>]) {
        let products: Vec<Vec<f32>> =
            untouched.iter().map(|difference| self.products(&self.whitened(difference))).collect();
        // By the median: some of them may be touched.
        let deviation = |place: usize| {
            let sizes: Vec<f64> = products.iter().map(|products| f64::from(products[place].abs())).collect();
            NORMAL_MEDIAN * upper_median(&sizes).unwrap_or(0.0)
        };
        let sd: Vec<f64> = (0..self.table.len() / self.width).map(deviation).collect();
        let usual = rms(sd.iter().copied());
        let freedom = untouched.len().max(2) as f64 - 1.0;
        for (row, sd) in self.table.chunks_exact_mut(self.width).zip(&sd) {
            // Not far below the usual one: that is chance.
            let factor = sd.max(0.5 * usual).recip().min(1.0) as f32;
            row.iter_mut().for_each(|value| *value *= factor);
        }
        self.threshold = QUANTILE * (1.0 + ERRORS * MEDIAN_ERROR / freedom.sqrt());
    }

    /// A difference over its noise, without drift.
    pub(super) fn whitened(&self, difference: &[f64]) -> Vec<f64> {
        let mut values = times(difference, &self.over_noise);
        self.whitening.apply(&mut values);
        values
    }

    /// The statistic of the [touch detector](super::touch_detector::TouchDetector) for a difference, ohm, with drift of the sheet and
    /// without it, whichever is smaller: a single bad reading is bounded in the first, and in all values of the second.
    pub(super) fn statistic(&self, difference: &[f64], noise_ohm: &[f64], masked: &[bool]) -> f64 {
        let with_drift = statistic(difference, noise_ohm, masked);
        let Some(sheet) = &self.sheet else { return with_drift };
        let mut values = times(difference, &self.over_noise);
        sheet.apply(&mut values);
        for (value, over_noise) in values.iter_mut().zip(&self.over_noise).filter(|(_, over_noise)| **over_noise > 0.0)
        {
            *value /= over_noise;
        }
        with_drift.min(statistic(&values, noise_ohm, masked))
    }

    /// The product of a whitened difference with each place.
    fn products(&self, whitened: &[f64]) -> Vec<f32> {
        let mut values = whitened.to_vec();
        // Both factors of a product are whitened: that of the touches here.
        self.whitening.apply_transposed(&mut values);
        let values = self.distinct.sums(&times(&values, &self.over_noise));
        let mut values: Vec<f32> = values.into_iter().map(|value| value as f32).collect();
        values.resize(self.width, 0.0);
        let mut products = vec![0.0; self.table.len() / self.width];
        pulp::Arch::new().dispatch(Products { table: &self.table, values: &values, products: &mut products });
        products
    }

    /// The largest output of a whitened difference for a touch, and that for the end of one.
    pub(super) fn outputs(&self, whitened: &[f64]) -> [f64; 2] {
        let products = self.products(whitened);
        [1.0, -1.0]
            .map(|sign: f32| f64::from(products.iter().map(|product| sign * product).fold(f32::NEG_INFINITY, f32::max)))
    }

    /// Whether an output is more than noise; `was_touched` if that of the frame before was.
    pub(super) fn exceeds(&self, output: f64, was_touched: bool) -> bool {
        output > self.threshold * if was_touched { RELEASE } else { 1.0 }
    }
}

/// Values times factors.
fn times(values: &[f64], factors: &[f64]) -> Vec<f64> {
    values.iter().zip(factors).map(|(value, factor)| value * factor).collect()
}

struct Products<'a> {
    table: &'a [f32],
    values: &'a [f32],
    products: &'a mut [f32],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let values = self.values.as_chunks::<LANES>().0;
        for (row, product) in self.table.chunks_exact(self.values.len()).zip(self.products) {
            let mut sums = [0.0f32; LANES];
            for (row, value) in row.as_chunks::<LANES>().0.iter().zip(values) {
                (0..LANES).for_each(|lane| sums[lane] += row[lane] * value[lane]);
            }
            *product = sums.iter().sum();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::drift::{DriftFitter, OF_SHEET};
    use crate::pipeline::touch_detector::TouchDetector;
    use dermis_sim::random::{sample_rng, standard_normal};

    #[test]
    fn weak_touches_are_felt_and_noise_and_drift_are_not() {
        let skin = Skin::load("cylinder30").unwrap();
        let fitter = DriftFitter::new(skin.clone()).unwrap();
        let linear = skin.linearised().unwrap();
        let count = linear.rest_frame.len();
        let sd_ohm = vec![1e-3 * skin.design().protocol.undriven_rms(&linear.rest_frame); count];
        let mut rng = sample_rng(4, 0);
        // Half of the noise of each drive is common, as that of its current.
        let mut noise = || -> Vec<f64> {
            let common: Vec<f64> = (0..30).map(|_| standard_normal(&mut rng)).collect();
            let value =
                |channel: usize| sd_ohm[channel] * (common[channel / 29] + standard_normal(&mut rng)) / 2f64.sqrt();
            (0..count).map(value).collect()
        };
        let untouched: Vec<Vec<f64>> = (0..100).map(|_| noise()).collect();
        let filter = MatchedFilter::new(&skin, fitter.modes(), OF_SHEET, &sd_ohm, &untouched).unwrap();
        let feels = |difference: &[f64]| filter.exceeds(filter.outputs(&filter.whitened(difference))[0], false);
        assert!((0..5000).all(|_| !feels(&noise())));
        let plus = |noise: Vec<f64>, of: &dyn Fn(usize) -> f64| -> Vec<f64> {
            noise.into_iter().enumerate().map(|(channel, value)| value + of(channel)).collect()
        };
        let mut felt = 0;
        for pixel in (5..900).step_by(61) {
            let square: f64 = (0..count).map(|c| (linear.jacobian.at(c, pixel) / sd_ohm[c]).powi(2)).sum();
            // Of 25 deviations: the sum of squares changes by 25^2 of 870 +- 42, where common noise scatters it more.
            let strength = 25.0 / square.sqrt();
            let mut touched = |sign: f64| {
                let difference = noise();
                plus(difference, &|channel| sign * strength * linear.jacobian.at(channel, pixel))
            };
            felt += i32::from(feels(&touched(1.0)));
            assert!(!feels(&touched(-0.3)), "pixel {pixel}");
        }
        // At an electrode a touch is much like a change of the contact.
        assert!(felt >= 13, "{felt} of 15");
        let statistic = |difference: &[f64]| filter.statistic(difference, &sd_ohm, &vec![false; count]);
        let untouched: Vec<f64> = untouched.iter().map(|difference| statistic(difference)).collect();
        let detector = TouchDetector::new(&untouched);
        let exceeds = |difference: &[f64]| detector.exceeds(statistic(difference));
        for part in [0.003, 0.02] {
            let drifted = plus(noise(), &|channel| part * linear.rest_frame[channel]);
            assert!(!feels(&drifted) && !exceeds(&drifted), "{part}");
        }
        // A bad reading, and a touch of 60 deviations.
        assert!(!exceeds(&plus(noise(), &|channel| if channel == 7 { 1000.0 * sd_ohm[7] } else { 0.0 })));
        let square: f64 = (0..count).map(|c| (linear.jacobian.at(c, 400) / sd_ohm[c]).powi(2)).sum();
        assert!(exceeds(&plus(noise(), &|channel| 60.0 / square.sqrt() * linear.jacobian.at(channel, 400))));
    }
}
