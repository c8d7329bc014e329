//! The position of a press from its frame: the inverse of the forward map by its likelihood.

use crate::covariance::PressInput;
use crate::error::CalibrateError;
use crate::forward_map::{ForwardMap, Hyperparameters, Samples};
use crate::located::Located;
use crate::posterior::Posterior;
use crate::region::Region;
use crate::strength::{ForceLaw, Strength};
use crate::units::Change;
use dermis::geom::Point3;
use faer::Mat;

/// What a locator knows before any label: where presses can be, the frame without one, and how responses grow with the
/// force.
#[derive(Debug, Clone)]
pub(crate) struct Setup {
    pub region: Region,
    /// The untouched frame, in units of the channels, with late channels predicted as in single frames.
    pub untouched: Vec<f64>,
    /// `None` where all presses count as equally strong.
    pub strength: Option<Strength>,
}

/// A forward map with its response at every node of a region.
#[derive(Debug, Clone)]
pub(crate) struct Locator {
    setup: Setup,
    /// The map to all channels.
    map: ForwardMap,
    /// Channels x components.
    whitening: Mat<f64>,
    /// The same, row by row.
    whitening_rows: Vec<f64>,
    /// The map to the whitened components.
    white: ForwardMap,
    /// Areas of the triangles, m2.
    areas_m2: Vec<f64>,
    /// Whitened responses at the nodes without the history, nodes x components.
    responses: Vec<f64>,
    /// Change of the responses per unit of the position before along an axis, nodes x components.
    shifts: Vec<(usize, Vec<f64>)>,
    /// Variance of the residuals at the nodes: that of the noise, 1, and that of the map.
    variances: Vec<f64>,
    /// Exponent of the likelihood: below 1 where residuals are less independent than their covariance states.
    pub temperature: f64,
}

impl Locator {
    /// Conditions the map on samples and computes its responses.
    pub(crate) fn new(
        samples: &Samples,
        hyperparameters: &Hyperparameters,
        setup: &Setup,
    ) -> Result<Self, CalibrateError> {
        let (map, factor) = ForwardMap::condition(samples, hyperparameters)?;
        let variances = map.variances(&setup.region.nodes, &factor).into_iter().map(|variance| 1.0 + variance);
        Ok(Self::assemble(setup.clone(), map, hyperparameters.whitening.clone(), variances.collect(), 1.0))
    }

    /// A locator of stored parts; the responses are computed.
    pub(crate) fn assemble(
        setup: Setup,
        map: ForwardMap,
        whitening: Mat<f64>,
        variances: Vec<f64>,
        temperature: f64,
    ) -> Self {
        let region = &setup.region;
        let white = map.whitened(&whitening);
        let (responses, shifts) = white.responses(&region.nodes);
        let areas_m2 = region.triangles.iter().map(|triangle| region.triangle_area_m2(triangle)).collect();
        let whitening_rows =
            (0..whitening.nrows()).flat_map(|i| whitening.row(i).iter().copied().collect::<Vec<f64>>()).collect();
        Locator { setup, map, whitening, whitening_rows, white, areas_m2, responses, shifts, variances, temperature }
    }

    pub(crate) fn map(&self) -> &ForwardMap {
        &self.map
    }

    pub(crate) fn whitening(&self) -> &Mat<f64> {
        &self.whitening
    }

    /// Number of whitened components.
    pub(crate) fn component_count(&self) -> usize {
        self.whitening.ncols()
    }

    pub(crate) fn region(&self) -> &Region {
        &self.setup.region
    }

    pub(crate) fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The amplitudes of presses, where they are not equal.
    pub(crate) fn strength(&self) -> Option<&Strength> {
        self.setup.strength.as_ref()
    }

    /// How they grow with forces, where these are known.
    pub(crate) fn force_law(&self) -> Option<&ForceLaw> {
        self.strength()?.law.as_ref()
    }

    /// Sets the deviation of forces from the logarithms of estimated over true ones.
    pub(crate) fn set_force_deviation(&mut self, log_ratios: &[f64]) {
        if let Some(law) = self.setup.strength.as_mut().and_then(|strength| strength.law.as_mut()) {
            law.set_deviation(log_ratios);
        }
    }

    pub(crate) fn areas_m2(&self) -> &[f64] {
        &self.areas_m2
    }

    pub(crate) fn variances(&self) -> &[f64] {
        &self.variances
    }

    /// Locates the press of a frame, in units of the channels.
    pub(crate) fn locate(&self, values: &[f64], previous_m: Option<Point3>, number: f64) -> Located {
        self.posterior(values, previous_m, number).located(self.temperature)
    }

    /// The squared whitened difference of a frame from the untouched one.
    pub(crate) fn untouched_square(&self, values: &[f64]) -> f64 {
        let difference: Vec<f64> = values.iter().zip(&self.setup.untouched).map(|(a, b)| a - b).collect();
        self.whiten(&difference).iter().map(|value| value * value).sum()
    }

    /// The whitened components of a frame, in units of the channels.
    pub(crate) fn whiten(&self, values: &[f64]) -> Vec<f64> {
        let mut whitened = vec![0.0; self.component_count()];
        for (value, weights) in values.iter().zip(self.whitening_rows.chunks_exact(whitened.len())) {
            whitened.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
        }
        whitened
    }

    /// What a whitened frame holds besides its press: what the press before left, and drift.
    pub(crate) fn history(&self, previous_m: Option<Point3>, number: f64) -> Vec<f64> {
        let at_centre = self.white.at_centre(number);
        self.white.history(&PressInput { previous_m: previous_m.unwrap_or(at_centre.previous_m), ..at_centre })
    }

    /// The posterior of the position of a press. Where responses depend on the force, that of the amplitude which is
    /// most likely.
    pub(crate) fn posterior(&self, values: &[f64], previous_m: Option<Point3>, number: f64) -> Posterior<'_> {
        let history = self.history(previous_m, number);
        let relative = self.map.extent.relative(previous_m.unwrap_or(self.map.extent.centre_m));
        let of = |values: &[f64], amplitude: f64| {
            let target = self.whiten(values).iter().zip(&history).map(|(value, history)| value - history).collect();
            self.posterior_of(target, relative, amplitude, self.untouched_square(values))
        };
        let Some(strength) = &self.setup.strength else { return of(values, 1.0) };
        let change = Change::of(values, &self.setup.untouched);
        let at = |amplitude: f64| of(&change.amplified(1.0 / amplitude).collect::<Vec<f64>>(), amplitude);
        let components = self.component_count() as f64;
        // The noise is that of the scaled frame: the density of the measured one is divided by the factor of each
        // component.
        let log_evidence = |amplitude: f64| at(amplitude).log_evidence() - components * amplitude.ln();
        at(strength.most_likely_amplitude(log_evidence))
    }

    /// The posterior of a whitened frame without its history, scaled to the labelled presses' amplitude.
    fn posterior_of(&self, target: Vec<f64>, relative: Point3, amplitude: f64, untouched_square: f64) -> Posterior<'_> {
        let squares = (0..self.region().nodes.len())
            .map(|node| self.residual(&target, relative, node).iter().map(|value| value * value).sum())
            .collect();
        let residual = move |node: usize| self.residual(&target, relative, node);
        Posterior::new(self, amplitude, residual, squares, untouched_square)
    }

    fn residual(&self, target: &[f64], relative: Point3, node: usize) -> Vec<f64> {
        let row = node * target.len()..(node + 1) * target.len();
        let mut residual: Vec<f64> =
            target.iter().zip(&self.responses[row.clone()]).map(|(value, response)| value - response).collect();
        for (axis, table) in &self.shifts {
            residual.iter_mut().zip(&table[row.clone()]).for_each(|(value, shift)| *value -= relative[*axis] * shift);
        }
        residual
    }
}
