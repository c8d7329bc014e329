//! The regularization parameter alpha, and the rules that choose it without labels.

use crate::image::PixelSpace;
use crate::reconstruct::channels::Channels;
use crate::reconstruct::noise_figure::{self, ByModes};
use crate::reconstruct::one_step::OneStepOptions;
use crate::reconstruct::system::{Modes, System};
use crate::reconstruct::{ReconstructError, check_finite};
use faer::{Mat, Side};
use std::fmt;

/// The regularization parameter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Alpha {
    /// A dimensionless number: the prior is scaled by `trace(J'J) / trace(R)`, with J the derivative with respect to
    /// relative changes.
    Given(f64),
    /// A number in units of the Jacobian with respect to the conductance itself, with an unscaled prior: EIDORS's
    /// hyperparameter.
    Absolute(f64),
    /// Chosen so that the [noise figure](noise_figure::noise_figure) of a small target has this value.
    NoiseFigure(f64),
    /// The corner of the L-curve of the examples: the maximum curvature of `log |y - J x|` over `log sqrt(x'Rx)`
    /// (Hansen and O'Leary 1993, DOI 10.1137/0914086). On real frames it may be far too small; see [`Alpha::Gcv`].
    LCurve,
    /// The minimum of generalised cross-validation of the examples (Golub, Heath and Wahba 1979, DOI
    /// 10.1080/00401706.1979.10489751). It assumes white noise and an exact model. Where the model is wrong, as in real
    /// tanks, it fits the errors of the model: 4 of 18 objects of a real tank are found with NOSER, 18 with
    /// [`Alpha::Auto`] (`docs/decisions/one-step-defaults.md`).
    Gcv,
    /// A rule that needs neither data nor a number: a noise figure of one half. On `cylinder30` its localisation error
    /// is within 0.6 mm of that of the best alpha from 30 to 60 dB, and on real pressed skins within half a millimetre
    /// (`docs/decisions/one-step-defaults.md`). If no alpha has that noise figure, as on skins with few electrodes,
    /// another value is used: see [`AlphaRule`].
    #[default]
    Auto,
}

/// The rule that chose alpha; its text is for tables and notes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AlphaRule {
    /// The number was given.
    Given,
    /// Chosen for this noise figure of a small target.
    NoiseFigure(f64),
    /// [`Alpha::Auto`] could not reach its noise figure, and used this one.
    AttainableNoiseFigure(f64),
    /// The corner of the L-curve of the examples.
    LCurve,
    /// Generalised cross-validation of the examples.
    Gcv,
}

impl fmt::Display for AlphaRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            AlphaRule::Given => f.write_str("given"),
            AlphaRule::NoiseFigure(value) => write!(f, "noise figure {value}"),
            AlphaRule::AttainableNoiseFigure(value) => {
                write!(f, "noise figure {value:.2}, because no alpha gives {AUTO_NOISE_FIGURE} with these channels")
            }
            AlphaRule::LCurve => write!(f, "corner of the L-curve, {OFTEN_TOO_SMALL}"),
            AlphaRule::Gcv => write!(f, "generalised cross-validation, {OFTEN_TOO_SMALL}"),
        }
    }
}

/// The warning of the rules that use data.
const OFTEN_TOO_SMALL: &str = "often far too small on real frames: compare with auto";

/// The target noise figure of [`Alpha::Auto`].
pub(crate) const AUTO_NOISE_FIGURE: f64 = 0.5;
/// If it cannot be reached, [`Alpha::Auto`] uses this multiple of the smallest noise figure: the smallest value itself
/// is the limit of an infinite alpha. This is 3 dB above it.
const OVER_LEAST: f64 = std::f64::consts::SQRT_2;
/// Range of `mu` over the largest eigenvalue of `J R^-1 J'` in which a rule searches: from where rounding errors
/// dominate the small eigenvalues to where images are a thousandth of their size.
const RELATIVE_RANGE: [f64; 2] = [1e-12, 1e3];

/// The alpha of the options, for a problem whose prior is multiplied by `alpha^2 scale`, and the rule that chose it.
pub(crate) fn choose(
    system: &System,
    scale: f64,
    channels: &Channels,
    pixels: &PixelSpace,
    options: &OneStepOptions,
) -> Result<(f64, AlphaRule), ReconstructError> {
    let (mu, rule) = match options.alpha {
        Alpha::Given(alpha) | Alpha::Absolute(alpha) => return Ok((positive("alpha", alpha)?, AlphaRule::Given)),
        Alpha::NoiseFigure(_) | Alpha::Auto => {
            let figure = NoiseFigure::new(system, pixels, &options.target)?;
            let wanted = match options.alpha {
                Alpha::NoiseFigure(value) => Some(value),
                _ => None,
            };
            // From alpha = 0.1 outwards.
            let by_modes = figure.by_modes()?;
            let at = |mu| by_modes.as_ref().map_or_else(|| figure.at(mu), |modes| Ok(modes.at(mu)));
            mu_at_noise_figure(&at, wanted, 0.01 * scale)?
        }
        Alpha::LCurve => (Spectrum::new(system, channels, options)?.corner()?, AlphaRule::LCurve),
        Alpha::Gcv => (Spectrum::new(system, channels, options)?.least_gcv()?, AlphaRule::Gcv),
    };
    Ok(((mu / scale).sqrt(), rule))
}

pub(crate) fn positive(what: &str, value: f64) -> Result<f64, ReconstructError> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(ReconstructError::Parameter(format!("{what} is {value}: it must be positive and finite")))
    }
}

/// The `mu` of a noise figure, or by the rule of [`Alpha::Auto`] if none is given, searched from `start` outwards.
///
/// # Errors
/// A given noise figure that no `mu` has; a noise figure that cannot be computed.
pub(crate) fn mu_at_noise_figure(
    noise_figure: &impl Fn(f64) -> Result<f64, ReconstructError>,
    wanted: Option<f64>,
    start: f64,
) -> Result<(f64, AlphaRule), ReconstructError> {
    if let Some(wanted) = wanted {
        let wanted = positive("the noise figure", wanted)?;
        return match mu_where(noise_figure, wanted, start)? {
            Search::Found(mu) => Ok((mu, AlphaRule::NoiseFigure(wanted))),
            Search::OutOfReach { nearest, .. } => {
                let message = format!("no alpha gives the noise figure {wanted}: the nearest found is {nearest:.3e}");
                Err(ReconstructError::Parameter(message))
            }
        };
    }
    match mu_where(noise_figure, AUTO_NOISE_FIGURE, start)? {
        Search::Found(mu) => Ok((mu, AlphaRule::NoiseFigure(AUTO_NOISE_FIGURE))),
        Search::OutOfReach { nearest, mu } if nearest < AUTO_NOISE_FIGURE => {
            Ok((mu, AlphaRule::AttainableNoiseFigure(nearest)))
        }
        Search::OutOfReach { nearest: least, mu } => match mu_where(noise_figure, OVER_LEAST * least, start)? {
            Search::Found(mu) => Ok((mu, AlphaRule::AttainableNoiseFigure(OVER_LEAST * least))),
            Search::OutOfReach { .. } => Ok((mu, AlphaRule::AttainableNoiseFigure(least))),
        },
    }
}

/// The result of a search for a noise figure.
enum Search {
    /// The `mu` that has it.
    Found(f64),
    /// No `mu` in the range has it.
    OutOfReach {
        /// The noise figure nearest to it.
        nearest: f64,
        /// The `mu` of that.
        mu: f64,
    },
}

/// The `mu` at which a noise figure is `wanted`, to a relative accuracy of 1e-6, searched from `start` outwards; the
/// noise figure decreases as `mu` increases.
fn mu_where(
    noise_figure: &impl Fn(f64) -> Result<f64, ReconstructError>,
    wanted: f64,
    start: f64,
) -> Result<Search, ReconstructError> {
    let gap = |log_mu: f64| Ok::<f64, ReconstructError>(noise_figure(log_mu.exp())?.ln() - wanted.ln());
    let step = 10.0_f64.ln();
    let (mut low, mut high) = (start.ln(), start.ln());
    let (mut gap_low, mut gap_high) = (gap(low)?, gap(high)?);
    for _ in 0..16 {
        if gap_low >= 0.0 && gap_high <= 0.0 {
            return root(&gap, [low, high], [gap_low, gap_high]).map(|log_mu| Search::Found(log_mu.exp()));
        }
        if gap_low < 0.0 {
            // A smaller mu may be too small for the Jacobian.
            let Ok(next) = gap(low - step) else { break };
            (high, gap_high, low, gap_low) = (low, gap_low, low - step, next);
        } else {
            (low, gap_low, high) = (high, gap_high, high + step);
            gap_high = gap(high)?;
        }
    }
    let (gap, log_mu) = if gap_low < 0.0 { (gap_low, low) } else { (gap_high, high) };
    Ok(Search::OutOfReach { nearest: wanted * gap.exp(), mu: log_mu.exp() })
}

/// The root of a decreasing function between two points (regula falsi, Illinois variant).
fn root(
    function: &impl Fn(f64) -> Result<f64, ReconstructError>,
    mut ends: [f64; 2],
    mut values: [f64; 2],
) -> Result<f64, ReconstructError> {
    for _ in 0..60 {
        if values[0] == values[1] || ends[1] - ends[0] < 1e-12 {
            break;
        }
        let middle = (ends[0] * values[1] - ends[1] * values[0]) / (values[1] - values[0]);
        let value = function(middle)?;
        if value.abs() < 1e-6 {
            return Ok(middle);
        }
        let side = usize::from(value < 0.0);
        (ends[side], values[side]) = (middle, value);
        values[1 - side] *= 0.5;
    }
    Ok(0.5 * (ends[0] + ends[1]))
}

/// The noise figure of a system as a function of `mu`.
struct NoiseFigure<'a> {
    system: &'a System,
    /// The difference caused by the target, in the system's units.
    difference: Vec<f64>,
    areas: &'a [f64],
}

/// Multiply-adds of one matrix above which a search for a noise figure computes the [modes](Modes) first, after which
/// each `mu` costs little: 4.2 s become 0.8 s for 870 channels and 4,096 pixels. Below, the search takes a second at
/// most; it stays as it was because another order of the sums would change the last bits of every default image.
const MODES_FROM: usize = 1_000_000_000;

impl<'a> NoiseFigure<'a> {
    fn new(system: &'a System, pixels: &'a PixelSpace, target: &[usize]) -> Result<Self, ReconstructError> {
        if let Some(&pixel) = target.iter().find(|&&pixel| pixel >= pixels.len()) {
            let message = format!("the target holds pixel {pixel}, but there are {} pixels", pixels.len());
            return Err(ReconstructError::Parameter(message));
        }
        let jacobian = system.jacobian();
        let target = if target.is_empty() { noise_figure::least_seen(jacobian, pixels) } else { target.to_vec() };
        let difference: Vec<f64> =
            (0..jacobian.nrows()).map(|channel| target.iter().map(|&p| jacobian[(channel, p)]).sum()).collect();
        if difference.iter().all(|&value| value == 0.0) {
            return Err(ReconstructError::Singular("no channel sees the target of the noise figure".into()));
        }
        Ok(NoiseFigure { system, difference, areas: &pixels.areas })
    }

    /// The modes, where they are the faster way.
    fn by_modes(&self) -> Result<Option<ByModes<'_>>, ReconstructError> {
        let (channels, pixels) = (self.system.jacobian().nrows(), self.system.jacobian().ncols());
        if pixels <= channels || channels * channels * pixels < MODES_FROM {
            return Ok(None);
        }
        let modes = Modes::new(&*self.system.data_form()?)?;
        Ok(Some(ByModes::new(modes, self.areas, &self.difference)))
    }

    fn at(&self, mu: f64) -> Result<f64, ReconstructError> {
        Ok(noise_figure::of_matrix(self.system.inverse(mu)?.as_ref(), self.areas, &self.difference))
    }
}

/// The eigenvalues of `J R^-1 J'`, and the power of the examples in each eigenvector.
///
/// Images in the null space `N` of the prior are fitted without a penalty, so both are computed in the complement of
/// the range of `T = J N`.
pub(crate) struct Spectrum {
    eigenvalues: Vec<f64>,
    /// Square of the examples' component along each eigenvector, summed over the examples.
    power: Vec<f64>,
    /// Eigenvalues that are zero only because of the projection.
    projected: usize,
    channel_count: usize,
}

impl Spectrum {
    pub(crate) fn new(
        system: &System,
        channels: &Channels,
        options: &OneStepOptions,
    ) -> Result<Self, ReconstructError> {
        let examples = &options.examples;
        if examples.is_empty() {
            let message = "the L-curve and cross-validation look at measured differences: give some as examples";
            return Err(ReconstructError::Parameter(message.into()));
        }
        let form = system.data_form()?;
        let basis = (form.trend.ncols() > 0).then(|| form.trend.qr().compute_thin_Q());
        let project = |matrix: &Mat<f64>| match &basis {
            Some(basis) => matrix - basis * (basis.transpose() * matrix),
            None => matrix.clone(),
        };
        let mut data = Mat::zeros(channels.kept.len(), examples.len());
        for (column, example) in examples.iter().enumerate() {
            if let Some(&channel) = channels.kept.iter().find(|&&channel| channel >= example.len()) {
                return Err(ReconstructError::FrameLength { got: example.len(), expected: channel + 1 });
            }
            check_finite(example)?;
            for (row, (&channel, scale)) in channels.kept.iter().zip(&channels.scale).enumerate() {
                data[(row, column)] = example[channel] * scale;
            }
        }
        let kernel = project(&project(&form.kernel).transpose().to_owned());
        let spectrum = kernel
            .self_adjoint_eigen(Side::Lower)
            .map_err(|error| ReconstructError::Singular(format!("J R^-1 J' has no eigenvalues: {error:?}")))?;
        let components = spectrum.U().transpose() * project(&data);
        Ok(Spectrum {
            eigenvalues: spectrum.S().column_vector().iter().map(|&value| value.max(0.0)).collect(),
            power: (0..components.nrows()).map(|row| components.row(row).squared_norm_l2()).collect(),
            projected: form.trend.ncols(),
            channel_count: channels.kept.len(),
        })
    }

    /// Sum of `term(eigenvalue, power)`.
    fn sum(&self, term: impl Fn(f64, f64) -> f64) -> f64 {
        self.eigenvalues.iter().zip(&self.power).map(|(&eigenvalue, &power)| term(eigenvalue, power)).sum()
    }

    /// `|y - J x|^2 = sum c^2 mu^2 / (l + mu)^2`, summed over the examples.
    pub(crate) fn misfit(&self, mu: f64) -> f64 {
        self.sum(|l, power| power * (mu / (l + mu)).powi(2))
    }

    /// `x'Rx = sum c^2 l / (l + mu)^2`, summed over the examples.
    pub(crate) fn roughness(&self, mu: f64) -> f64 {
        self.sum(|l, power| power * l / (l + mu).powi(2))
    }

    /// `m |y - J x|^2 / trace(I - H)^2`, with H the map from the data to the part explained by the image.
    pub(crate) fn gcv(&self, mu: f64) -> f64 {
        let trace = self.sum(|l, _| mu / (l + mu)) - self.projected as f64;
        self.channel_count as f64 * self.misfit(mu) / (trace * trace)
    }

    /// The curvature of `log |y - J x|` over `log sqrt(x'Rx)`, positive at the corner.
    ///
    /// With `u = ln mu`, `f = ln misfit / 2` and `g = ln roughness / 2`: `(f' g'' - f'' g') / (f'^2 + g'^2)^(3/2)`.
    pub(crate) fn curvature(&self, mu: f64) -> f64 {
        let (misfit, roughness) = (self.misfit(mu), self.roughness(mu));
        let first = -2.0 * mu * self.sum(|l, power| power * l / (l + mu).powi(3));
        let second = first + 6.0 * mu * mu * self.sum(|l, power| power * l / (l + mu).powi(4));
        // The derivative of the misfit with respect to mu is -mu times that of the roughness.
        let misfit_first = -mu * first;
        let misfit_second = -mu * (first + second);
        let halves = |value: f64, first: f64, second: f64| {
            (0.5 * first / value, 0.5 * (second * value - first * first) / (value * value))
        };
        let (f1, f2) = halves(misfit, misfit_first, misfit_second);
        let (g1, g2) = halves(roughness, first, second);
        (f1 * g2 - f2 * g1) / (f1 * f1 + g1 * g1).powf(1.5)
    }

    /// The `mu` at the corner of the L-curve.
    pub(crate) fn corner(&self) -> Result<f64, ReconstructError> {
        self.maximum(|mu| self.curvature(mu), "the L-curve of the examples has no corner")
    }

    /// The `mu` of the smallest cross-validation error.
    pub(crate) fn least_gcv(&self) -> Result<f64, ReconstructError> {
        self.maximum(|mu| -self.gcv(mu), "generalised cross-validation of the examples has no minimum")
    }

    /// The `mu` at the maximum of a function: a grid in the logarithm, then golden-section search.
    fn maximum(&self, function: impl Fn(f64) -> f64, failure: &str) -> Result<f64, ReconstructError> {
        const STEPS: usize = 340;
        let largest = self.eigenvalues.iter().fold(0.0, |a: f64, &b| a.max(b));
        let [low, high] = RELATIVE_RANGE.map(|factor| (factor * largest).ln());
        let at = |step: usize| low + (high - low) * step as f64 / STEPS as f64;
        let of = |log_mu: f64| function(log_mu.exp());
        let values: Vec<f64> = (0..=STEPS).map(|step| of(at(step))).collect();
        let best =
            (0..=STEPS).filter(|&step| values[step].is_finite()).max_by(|&a, &b| values[a].total_cmp(&values[b]));
        match best {
            Some(best) if best > 0 && best < STEPS => Ok(golden(of, at(best - 1), at(best + 1)).exp()),
            _ => {
                let message = format!("{failure}: choose alpha in another way, or give other examples");
                Err(ReconstructError::Parameter(message))
            }
        }
    }
}

/// The maximum of a unimodal function between two points, by golden-section search.
fn golden(function: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    const SECTION: f64 = 0.618_033_988_749_894_8;
    while high - low > 1e-7 {
        let (left, right) = (high - SECTION * (high - low), low + SECTION * (high - low));
        if function(left) > function(right) { high = right } else { low = left }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests;
