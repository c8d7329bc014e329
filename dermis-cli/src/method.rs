//! The method that makes images, as asked for on the command line.

use crate::console::Progress;
use crate::failure::{Failure, Outcome};
use crate::frames::Differences;
use crate::skin::{Per, Skin};
use clap::{Args, ValueEnum};
use dermis::detect::{DetectOptions, Detector, ImageNoise};
use dermis::frame::Frame;
use dermis::image::{Image, PixelSpace};
use dermis::reconstruct::{
    Alpha, Difference, GaussNewton, GaussNewtonOptions, Greit, GreitOptions, Linearised, OneStep, OneStepOptions,
    Prior, Reconstruct, TotalVariation, TotalVariationOptions,
};
use dermis_learn::Model;
use dermis_sim::evaluate::{AlignMethod, AlignOptions, PressEstimates, Screen};
use rayon::prelude::*;
use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;

/// How images are made.
#[derive(Debug, Clone, Args)]
pub struct MethodArguments {
    /// How images are made; NOSER without it.
    #[arg(long, value_enum)]
    method: Option<MethodName>,
    /// A trained network in place of a method: `paper` or `best`, which are shipped for the paper's skin, `shapes` for skin16, or the folder of
    /// a model of `dermis train`.
    #[arg(long, value_name = "MODEL", conflicts_with_all = ["method", "alpha", "alpha_absolute", "weighing"])]
    model: Option<String>,
    /// How strongly the prior counts: a number, `auto`, `noise-figure` or `noise-figure:0.5`, `l-curve`, `gcv`.
    #[arg(long, value_name = "ALPHA")]
    alpha: Option<AlphaChoice>,
    /// Alpha is EIDORS's hyperparameter: the Jacobian against conductivity itself, the prior unscaled. With a number
    /// of its own, or with that of --alpha.
    #[arg(long, value_name = "NUMBER", num_args = 0..=1)]
    alpha_absolute: Option<Option<f64>>,
    /// Exponent of the NOSER prior: 0 is Tikhonov's, 1 the original NOSER.
    #[arg(long, value_name = "NUMBER", default_value_t = 0.5)]
    noser_exponent: f64,
    /// How the channels are weighed against each other.
    #[arg(long, value_enum, default_value_t = Weighing::Plain)]
    weighing: Weighing,
    /// Channels to leave out: numbers and ranges, as in 0-23,40.
    #[arg(long, value_name = "CHANNELS", default_value = "", hide_default_value = true)]
    leave_out: Channels,
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
    /// Iterations on the nonlinear model, each pixel small by its own sensitivity.
    GaussNewton,
    /// Even patches with sharp edges (total variation).
    Tv,
    /// Trained to answer small targets as told (Adler et al. 2009).
    Greit,
}

/// Channels by number, as in `0-23,40`.
#[derive(Debug, Clone, Default)]
struct Channels(Vec<usize>);

impl FromStr for Channels {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.trim().parse::<usize>().map_err(|_| format!("`{text}` is no channel's number"));
        let mut channels = Vec::new();
        for part in text.split(',').filter(|part| !part.trim().is_empty()) {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let (first, last) = (number(first)?, number(last)?);
            // A protocol of the most electrodes a skin may have has about a million channels.
            if last < first || last - first > 2_000_000 {
                return Err(format!("`{part}` is no range of channels"));
            }
            channels.extend(first..=last);
        }
        Ok(Channels(channels))
    }
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

    /// What the linear method, or the network that is asked for, finds for presses whose places are known in another frame.
    pub fn press_estimates(&self, skin: &Skin, differences: &[Frame]) -> Outcome<PressEstimates> {
        let pixels = skin.pixels(Per::Pixel)?;
        self.check_left_out(skin)?;
        let left_out = self.leave_out.0.clone();
        let options = AlignOptions { left_out, ..AlignOptions::new(skin.design.sheet.touch) };
        let Some(name) = &self.model else {
            return Ok(PressEstimates::new(&skin.forward, &pixels, differences, &options)?);
        };
        let model = Model::named(name, &skin.forward, Arc::clone(&pixels))?;
        let screens = vec![Screen::Disagreeing, Screen::PolarityBlind];
        let options = AlignOptions { detector: Detector::new(model.detection()), screens, ..options };
        PressEstimates::by(
            &skin.forward,
            &pixels,
            differences,
            &options,
            |cut, left_out| -> Outcome<Vec<AlignMethod>> {
                Ok(vec![(Box::new(model.without(left_out)?.matched(cut)), None)])
            },
        )
    }

    /// Refuses channels that are not there.
    fn check_left_out(&self, skin: &Skin) -> Outcome {
        let channel_count = skin.design.protocol.channel_count();
        if let Some(&beyond) = self.leave_out.0.iter().find(|&&channel| channel >= channel_count) {
            let message =
                format!("channel {beyond} is to be left out, but the channels are 0 to {}", channel_count - 1);
            return Err(Failure::given(message, None));
        }
        Ok(())
    }

    /// Prepares the method for a skin. Rules that choose alpha from data look at the differences.
    pub fn prepare(&self, skin: &Skin, per: Per, differences: &Differences) -> Outcome<Method> {
        self.check_left_out(skin)?;
        let pixels = skin.pixels(per)?;
        let alpha = self.alpha()?;
        let _waiting = Progress::waiting("preparing");
        if let Some(name) = &self.model {
            let model = Model::named(name, &skin.forward, pixels)?.without(&self.leave_out.0)?;
            return Ok(Method { alpha: None, reconstruct: Box::new(model) });
        }
        match self.method.unwrap_or(MethodName::Noser) {
            MethodName::Noser => {
                self.one_step(Prior::Noser { exponent: self.noser_exponent }, skin, pixels, differences)
            }
            MethodName::Tikhonov => self.one_step(Prior::Tikhonov, skin, pixels, differences),
            MethodName::Laplace => self.one_step(Prior::Laplace, skin, pixels, differences),
            MethodName::GaussNewton => self.gauss_newton(skin, pixels, differences),
            MethodName::Tv => self.total_variation(alpha, skin, pixels),
            MethodName::Greit => self.greit(alpha, skin, pixels),
        }
    }

    /// Writes how contacts are found into the card of the model that is asked for.
    pub fn keep_detection(&self, skin: &Skin, detection: DetectOptions) -> Outcome {
        let Some(name) = &self.model else { return Ok(()) };
        let folder = Path::new(name);
        let model = Model::load(folder, &skin.forward, skin.pixels(Per::Pixel)?)?.with_detection(detection);
        Ok(model.save_card(folder)?)
    }

    fn one_step_options(&self, prior: Prior, skin: &Skin, differences: &Differences) -> Outcome<OneStepOptions> {
        let alpha = self.alpha()?;
        let looks_at_data = matches!(alpha, Alpha::LCurve | Alpha::Gcv);
        Ok(OneStepOptions {
            prior,
            alpha,
            difference: match self.weighing {
                Weighing::Plain => Difference::Plain,
                Weighing::Normalised => Difference::Normalised,
                Weighing::NormalisedEven => Difference::NormalisedEven,
            },
            excluded: self.leave_out.0.clone(),
            touch: skin.design.sheet.touch,
            examples: if looks_at_data { differences.frames.clone() } else { Vec::new() },
            ..OneStepOptions::default()
        })
    }

    fn one_step(
        &self,
        prior: Prior,
        skin: &Skin,
        pixels: Arc<PixelSpace>,
        differences: &Differences,
    ) -> Outcome<Method> {
        let options = self.one_step_options(prior, skin, differences)?;
        let method = OneStep::new(&skin.forward, pixels, &options)?;
        Ok(Method { alpha: Some(method.alpha()), reconstruct: Box::new(method) })
    }

    fn gauss_newton(&self, skin: &Skin, pixels: Arc<PixelSpace>, differences: &Differences) -> Outcome<Method> {
        let prior = Prior::Noser { exponent: self.noser_exponent };
        let linear = self.one_step_options(prior, skin, differences)?;
        let options = GaussNewtonOptions { linear, ..GaussNewtonOptions::default() };
        let method = GaussNewton::new(&skin.forward, pixels, &options)?;
        Ok(Method { alpha: Some(method.alpha()), reconstruct: Box::new(method) })
    }

    fn total_variation(&self, alpha: Alpha, skin: &Skin, pixels: Arc<PixelSpace>) -> Outcome<Method> {
        self.needs_plain_weighing("total variation")?;
        let mut options = TotalVariationOptions {
            excluded: self.leave_out.0.clone(),
            touch: skin.design.sheet.touch,
            ..TotalVariationOptions::default()
        };
        match alpha {
            Alpha::Auto => {}
            Alpha::Given(value) => options.alpha = value,
            _ => {
                let fix = "its alpha is a part of the weight from which on an image stays even: try 0.03";
                return Err(Failure::given("total variation knows no rule for alpha", Some(fix)));
            }
        }
        let model = Linearised::new(&skin.forward, &pixels)?;
        let method = TotalVariation::from_linearised(&model, pixels, &options)?;
        Ok(Method { alpha: Some(options.alpha), reconstruct: Box::new(method) })
    }

    fn greit(&self, alpha: Alpha, skin: &Skin, pixels: Arc<PixelSpace>) -> Outcome<Method> {
        self.needs_plain_weighing("GREIT")?;
        let mut options = GreitOptions {
            excluded: self.leave_out.0.clone(),
            touch: skin.design.sheet.touch,
            ..GreitOptions::default()
        };
        match alpha {
            Alpha::Auto => {}
            Alpha::NoiseFigure(value) => options.noise_figure = value,
            _ => {
                let fix = "write --alpha noise-figure:0.5";
                return Err(Failure::given("GREIT is weighed by its noise figure alone", Some(fix)));
            }
        }
        let method = Greit::new(&skin.forward, pixels, &options)?;
        Ok(Method { alpha: None, reconstruct: Box::new(method) })
    }

    fn needs_plain_weighing(&self, method: &str) -> Outcome {
        if self.weighing == Weighing::Plain {
            return Ok(());
        }
        Err(Failure::given(format!("{method} takes differences as they are: leave out --weighing"), None))
    }
}

/// A method ready to make images.
pub struct Method {
    /// The method.
    pub reconstruct: Box<dyn Reconstruct>,
    /// Its alpha, where it has one.
    pub alpha: Option<f64>,
}

/// Fewest untouched frames from whose images the noise of a method that is not linear is told: it is then known to a
/// quarter (1 / sqrt(2 n)).
const UNTOUCHED_AT_LEAST: usize = 8;

impl Method {
    /// The detector for its images, told of their noise as far as the untouched frames show it.
    pub fn detector(&self, differences: &Differences) -> Outcome<Detector> {
        let detector = Detector::new(self.reconstruct.detection());
        let Some(noise_ohm) = differences.noise_ohm() else { return Ok(detector) };
        if let Some(matrix) = self.reconstruct.matrix() {
            let noise = ImageNoise::from_matrix(matrix, &vec![noise_ohm; matrix.columns]);
            return Ok(detector.with_noise(noise));
        }
        if differences.untouched.len() < UNTOUCHED_AT_LEAST {
            return Ok(detector);
        }
        let noise = ImageNoise::from_untouched(&self.images(&differences.untouched)?);
        Ok(match noise {
            Some(noise) => detector.with_noise(noise),
            None => detector,
        })
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
