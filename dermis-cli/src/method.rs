//! The method that makes images, as asked for on the command line.

use crate::console::Progress;
use crate::failure::{Failure, Outcome};
use crate::frames::Differences;
use crate::skin::{Per, Skin};
use clap::{Args, ValueEnum};
use dermis::detect::{Detector, ImageNoise};
use dermis::image::{Image, PixelSpace};
use dermis::reconstruct::{Alpha, Difference, OneStep, OneStepOptions, Prior, Reconstruct};
use rayon::prelude::*;
use std::str::FromStr;
use std::sync::Arc;

/// How images are made.
#[derive(Debug, Clone, Args)]
pub struct MethodArguments {
    /// How images are made.
    #[arg(long, value_enum, default_value_t = MethodName::Noser)]
    method: MethodName,
    /// How strongly the prior counts: a number, `auto`, `noise-figure` or `noise-figure:0.5`, `l-curve`, `gcv`.
    #[arg(long, value_name = "ALPHA")]
    alpha: Option<AlphaChoice>,
    /// Alpha is EIDORS's hyperparameter: the Jacobian against conductivity itself, the prior unscaled. With a number
    /// of its own, or with that of --alpha.
    #[arg(long, value_name = "NUMBER", num_args = 0..=1)]
    alpha_absolute: Option<Option<f64>>,
    /// Exponent of the NOSER prior: 0 is Tikhonov's, 1 the original NOSER.
    #[arg(long, default_value_t = 0.5)]
    noser_exponent: f64,
    /// How the channels are weighed against each other.
    #[arg(long, value_enum, default_value_t = Weighing::Plain)]
    weighing: Weighing,
}

/// A method by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MethodName {
    /// One step, each pixel small by its own sensitivity.
    Noser,
    /// One step, each pixel small.
    Tikhonov,
    /// One step, neighbours alike.
    Laplace,
}

/// How the channels are weighed against each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Weighing {
    /// As they are, ohm.
    Plain,
    /// Divided by the untouched values and weighted by their squares, as EIDORS does.
    Normalised,
    /// Divided by the untouched values, all trusted alike.
    NormalisedEven,
}

/// What `--alpha` says.
#[derive(Debug, Clone, Copy, PartialEq)]
struct AlphaChoice(Alpha);

impl FromStr for AlphaChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let positive = |text: &str| match text.parse::<f64>() {
            Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
            _ => Err(format!("`{text}` is no positive number; give one, or auto, noise-figure:0.5, l-curve, gcv")),
        };
        Ok(AlphaChoice(match text.split_once(':') {
            Some(("noise-figure", value)) => Alpha::NoiseFigure(positive(value)?),
            _ => match text {
                "auto" => Alpha::Auto,
                // The usual choice in comparisons of methods.
                "noise-figure" => Alpha::NoiseFigure(1.0),
                "l-curve" => Alpha::LCurve,
                "gcv" => Alpha::Gcv,
                number => Alpha::Given(positive(number)?),
            },
        }))
    }
}

/// A method ready to make images.
pub struct Method {
    /// The method.
    pub reconstruct: Box<dyn Reconstruct>,
    /// Its alpha, where it has one.
    pub alpha: Option<f64>,
}

impl MethodArguments {
    /// The alpha that the arguments ask for.
    fn alpha(&self) -> Outcome<Alpha> {
        let given = self.alpha.map(|choice| choice.0);
        match (self.alpha_absolute, given) {
            (None, given) => Ok(given.unwrap_or_default()),
            (Some(Some(value)), None) | (Some(None), Some(Alpha::Given(value))) => Ok(Alpha::Absolute(value)),
            (Some(Some(_)), Some(_)) => Err(Failure::given(
                "two alphas are given",
                Some("leave out --alpha, or the number of --alpha-absolute"),
            )),
            (Some(None), _) => {
                let fix = "write --alpha-absolute 0.1, or --alpha 0.1 --alpha-absolute";
                Err(Failure::given("--alpha-absolute needs a number", Some(fix)))
            }
        }
    }

    /// Prepares the method for a skin. Rules that choose alpha from data look at the differences.
    pub fn prepare(&self, skin: &Skin, per: Per, differences: &Differences) -> Outcome<Method> {
        let pixels = skin.pixels(per)?;
        let alpha = self.alpha()?;
        self.one_step(skin, pixels, alpha, differences)
    }

    fn one_step(
        &self,
        skin: &Skin,
        pixels: Arc<PixelSpace>,
        alpha: Alpha,
        differences: &Differences,
    ) -> Outcome<Method> {
        let looks_at_data = matches!(alpha, Alpha::LCurve | Alpha::Gcv);
        let options = OneStepOptions {
            prior: match self.method {
                MethodName::Noser => Prior::Noser { exponent: self.noser_exponent },
                MethodName::Tikhonov => Prior::Tikhonov,
                MethodName::Laplace => Prior::Laplace,
            },
            alpha,
            difference: match self.weighing {
                Weighing::Plain => Difference::Plain,
                Weighing::Normalised => Difference::Normalised,
                Weighing::NormalisedEven => Difference::NormalisedEven,
            },
            touch: skin.design.sheet.touch,
            noise_ohm: differences.noise_ohm(),
            examples: if looks_at_data { differences.frames.clone() } else { Vec::new() },
            ..OneStepOptions::default()
        };
        let method = OneStep::new(&skin.forward, pixels, &options)?;
        Ok(Method { alpha: Some(method.alpha()), reconstruct: Box::new(method) })
    }
}

/// Fewest untouched frames from whose images the noise of a method that is not linear is told: it is then known to a
/// quarter (1 / sqrt(2 n)).
const UNTOUCHED_AT_LEAST: usize = 8;

impl Method {
    /// The detector for its images, told of their noise as far as the untouched frames show it.
    pub fn detector(&self, differences: &Differences) -> Outcome<Detector> {
        let Some(noise_ohm) = differences.noise_ohm() else { return Ok(Detector::default()) };
        if let Some(matrix) = self.reconstruct.matrix() {
            let noise = ImageNoise::from_matrix(matrix, &vec![noise_ohm; matrix.columns]);
            return Ok(Detector::default().with_noise(noise));
        }
        if differences.untouched.len() < UNTOUCHED_AT_LEAST {
            return Ok(Detector::default());
        }
        let noise = ImageNoise::from_untouched(&self.images(&differences.untouched)?);
        Ok(noise.map_or_else(Detector::default, |noise| Detector::default().with_noise(noise)))
    }

    /// The image of every difference, in their order.
    pub fn images(&self, differences: &[dermis::frame::Frame]) -> Outcome<Vec<Image>> {
        let progress = Progress::new("reconstructing", differences.len());
        let image = |difference| {
            let image = self.reconstruct.reconstruct(difference);
            progress.step();
            image
        };
        Ok(differences.par_iter().map(image).collect::<Result<Vec<_>, _>>()?)
    }
}
