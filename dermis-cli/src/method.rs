//! The reconstruction method of a command.

use crate::channels::LeaveOutArguments;
use crate::console::{Progress, warn};
use crate::failure::{Failure, Outcome};
use crate::frames::of_each;
use crate::range::number;
use clap::{Args, ValueEnum};
use dermis::contact::Contact;
use dermis::design::SkinDesign;
use dermis::detect::{DetectOptions, Detector};
use dermis::estimate::noise::ChannelNoise;
use dermis::frame::{Differences, Frame, broken_channels, disconnected_electrodes, read_frames_without};
use dermis::image::Image;
use dermis::method::{Method, MethodOptions, Methods, is_path};
use dermis::protocol::Protocol;
use dermis::reconstruct::{Alpha, Difference, Reconstruct};
use dermis::skin::Skin;
use dermis::text::{counted, number_of, ranges};
use dermis_calibrate::Calibration;
use dermis_learn::Model;
use dermis_sim::evaluate::{AlignMethod, AlignOptions, PressEstimates, Screen};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The help of `--method`, the same for every command.
pub const METHOD_HELP: &str = "Reconstruction method: noser, laplace, tikhonov, gauss-newton, tv or greit; a shipped network \
    (spots or paper for cylinder30, shapes for skin16); the folder of a trained network or of a calibration, as in \
    ./my-model; refined: the contacts of the best other method, refined on the skin that the untouched frames identify; or \
    best: the default of the skin (refined for cylinder30, else a shipped network, else a linear method) [default: best]";

/// The reconstruction method and its options.
#[derive(Debug, Clone, Args)]
pub struct MethodArguments {
    #[arg(long, value_name = "NAME|FOLDER", help = METHOD_HELP)]
    method: Option<String>,
    /// Regularization parameter of a linear method: a number, `auto`, `noise-figure`, `noise-figure:VALUE`, `l-curve`
    /// or `gcv`.
    #[arg(long, value_name = "ALPHA")]
    alpha: Option<AlphaChoice>,
    /// Absolute regularization parameter, as EIDORS's hyperparameter: Jacobian of the conductivity itself, prior not
    /// scaled. Takes its own number or that of --alpha.
    #[arg(long, value_name = "NUMBER", num_args = 0..=1, value_parser = number(MIN_ALPHA..=MAX_ALPHA))]
    alpha_absolute: Option<Option<f64>>,
    /// Exponent of the NOSER prior: 0 is Tikhonov's, 1 the original NOSER.
    #[arg(long, value_name = "NUMBER", default_value_t = 0.5, value_parser = number(0.0..=2.0))]
    noser_exponent: f64,
    /// Scaling and weighting of the channels of a linear method.
    #[arg(long, value_enum, default_value_t = Weighting::Plain)]
    weighting: Weighting,
    /// Weight the channels of noser, laplace, tikhonov or gauss-newton by the inverse of their noise variance: a file
    /// of standard deviations, a column per channel (CSV, NPY or NPZ; any unit), or `measured` for those of the
    /// untouched frames.
    #[arg(long, value_name = "FILE|measured")]
    channel_noise: Option<PathBuf>,
    #[command(flatten)]
    leave_out: LeaveOutArguments,
}

/// Range of regularization parameters; those of real skins, scaled or absolute, are within 1e-15 and 1e15.
const MIN_ALPHA: f64 = 1e-60;
const MAX_ALPHA: f64 = 1e60;

/// Changes of the other sign in at most this part of the frames are no hint: presses on a real membrane leave them in 4 %.
const FEW_OTHERS: f64 = 0.1;
/// More than this many times the noise of the untouched frames, in most frames, is worth a warning.
const NOISY: f64 = 2.0;

/// Which contacts are detected.
#[derive(Debug, Clone, Args)]
pub struct DetectArguments {
    /// Detect contacts that raise and contacts that lower the conductance, such as metal and plastic in a tank; each
    /// contact says which it does. Linear methods only.
    #[arg(long)]
    both_signs: bool,
}

impl DetectArguments {
    /// The detector for a method's images, with the noise of the frames.
    pub fn detector(&self, skin: &Skin, method: &Method, differences: &Differences) -> Outcome<Detector> {
        let detector = method.detector_of(differences, &skin.design().protocol)?;
        if !self.both_signs {
            return Ok(detector);
        }
        method.check_both_signs()?;
        Ok(detector.with_both_signs(skin.design().sheet.touch.change()))
    }

    /// What is kept of the image and the contacts of each difference. Warns if many images show changes of the sign that is not
    /// looked for.
    pub fn in_each<T: Send>(
        &self,
        method: &Method,
        detector: &Detector,
        differences: &[Frame],
        keep: impl Fn(Image, Vec<Contact>) -> T + Sync,
    ) -> Outcome<Vec<T>> {
        // Images of other methods show touches alone.
        let is_asked = !self.both_signs && method.check_both_signs().is_ok();
        let (others, noisy) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let found = of_each(differences, |difference| {
            if detector.noise_ratio(difference) > NOISY {
                noisy.fetch_add(1, Ordering::Relaxed);
            }
            let (image, contacts) = method.reconstruct().image_and_contacts(difference, detector)?;
            if is_asked && detector.shows_other_sign(difference, &image) {
                others.fetch_add(1, Ordering::Relaxed);
            }
            Ok(keep(image, contacts))
        })?;
        let others = others.into_inner();
        if others as f64 > FEW_OTHERS * differences.len() as f64 {
            warn(&format!(
                "in {others} of {} a change of the other sign is more than half as strong as any touch: contacts may be its \
                 side lobes. --both-signs looks for changes of both signs. If nothing but touches changes the skin, check that the \
                 differences are in ohm, not relative, with the signs of the design: `sheet.touch`, `protocol.amplitude_only`",
                counted(differences.len(), "frame")
            ));
        }
        let noisy = noisy.into_inner();
        if 2 * noisy > differences.len() {
            warn(&format!(
                "in {noisy} of {} reciprocal channels differ by more than {NOISY} times the noise of the untouched frames: it has risen, \
                 and deviations and thresholds are those of the frames. Record untouched frames under the same conditions",
                counted(differences.len(), "frame")
            ));
        }
        Ok(found)
    }

    /// Whether each contact says how it changes the conductance.
    pub fn both_signs(&self) -> bool {
        self.both_signs
    }
}

/// The value of `--channel-noise` for the noise of the untouched frames; a file of that name is `./measured`.
const MEASURED: &str = "measured";

/// Scaling and weighting of the channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Weighting {
    /// Differences in ohm, equal weights.
    Plain,
    /// Differences divided by the untouched values, weighted by the squares of these, as in EIDORS.
    Normalised,
    /// Differences divided by the untouched values, equal weights.
    NormalisedEqual,
}

/// The value of `--alpha`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct AlphaChoice(Alpha);

impl FromStr for AlphaChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let positive = |text: &str| {
            let value = number(MIN_ALPHA..=MAX_ALPHA)(text);
            value.map_err(|why| format!("`{text}`: {why}, or auto, noise-figure:0.5, l-curve, gcv"))
        };
        Ok(AlphaChoice(match text.split_once(':') {
            Some(("noise-figure", value)) => Alpha::NoiseFigure(positive(value)?),
            _ => match text {
                "auto" => Alpha::Auto,
                // The usual value in comparisons of methods.
                "noise-figure" => Alpha::NoiseFigure(1.0),
                "l-curve" => Alpha::LCurve,
                "gcv" => Alpha::Gcv,
                number => Alpha::Given(positive(number)?),
            },
        }))
    }
}

impl MethodArguments {
    /// The requested name; empty for the default.
    pub fn name(&self) -> &str {
        self.method.as_deref().filter(|name| !Methods::is_default(name)).unwrap_or_default()
    }

    /// The channels that are left out.
    pub fn left_out(&self, protocol: &Protocol) -> Outcome<Vec<usize>> {
        self.leave_out.of(protocol)
    }

    /// The folder of a calibration, where the method is one.
    pub fn calibration(&self) -> Option<&Path> {
        Some(Path::new(self.name())).filter(|folder| is_path(self.name()) && Calibration::is_folder(folder))
    }

    /// Whether strengths and forces depend on the unit of the frames; what is made of data may have one of its own.
    pub fn depends_on_size(&self) -> bool {
        self.weighting == Weighting::Plain && !is_path(self.name())
    }

    /// Prepares the method for a skin, without the channels that the untouched frames show to be broken, which a warning
    /// names. Rules that choose alpha from data use the differences.
    pub fn prepare(&self, skin: &Skin, differences: &Differences) -> Outcome<Method> {
        let _waiting = Progress::waiting("preparing the method");
        let mut options = self.options(skin, differences)?;
        let mut broken = broken_channels(&differences.untouched);
        broken.retain(|channel| !options.excluded.contains(channel));
        if !broken.is_empty() {
            warn(&left_out_text(skin.design(), &broken));
            options.excluded.extend(broken);
            options.excluded.sort_unstable();
        }
        let method = dermis_learn::methods().method(skin, self.name(), &options)?;
        let method = method.adapted(differences)?;
        if let Some(text) = method.reconstruct().warning() {
            warn(text);
        }
        Ok(method)
    }

    fn options(&self, skin: &Skin, differences: &Differences) -> Outcome<MethodOptions> {
        let alpha = self.alpha()?;
        let looks_at_data = matches!(alpha, Alpha::LCurve | Alpha::Gcv);
        Ok(MethodOptions {
            alpha,
            noser_exponent: self.noser_exponent,
            difference: match self.weighting {
                Weighting::Plain => Difference::Plain,
                Weighting::Normalised => Difference::Normalised,
                Weighting::NormalisedEqual => Difference::NormalisedEven,
            },
            excluded: self.left_out(&skin.design().protocol)?,
            channel_sd: self.channel_sd(skin, differences)?,
            examples: if looks_at_data { differences.frames.clone() } else { Vec::new() },
            baseline: differences.baseline.clone(),
        })
    }

    /// The standard deviation of the noise of each channel; empty where none is asked for.
    fn channel_sd(&self, skin: &Skin, differences: &Differences) -> Outcome<Vec<f64>> {
        match &self.channel_noise {
            None => Ok(Vec::new()),
            Some(path) if path.as_os_str() == MEASURED => {
                let noise = ChannelNoise::of_differences(differences, &skin.design().protocol).ok_or_else(|| {
                    let message = "--channel-noise measured needs untouched frames";
                    Failure::given(
                        message,
                        Some("give a file of standard deviations where a command has no --baseline"),
                    )
                })?;
                Ok(noise.sd_ohm().to_vec())
            }
            Some(path) => {
                let protocol = &skin.design().protocol;
                let rows = read_frames_without(path, protocol, &self.left_out(protocol)?)?;
                match &rows[..] {
                    [Frame(values)] => Ok(values.clone()),
                    _ => Err(Failure::given(
                        format!("{}: {} of standard deviations", path.display(), counted(rows.len(), "row")),
                        Some("give one row, with a value for each channel"),
                    )),
                }
            }
        }
    }

    /// The requested alpha.
    fn alpha(&self) -> Outcome<Alpha> {
        let given = self.alpha.map(|choice| choice.0);
        match (self.alpha_absolute, given) {
            (None, given) => Ok(given.unwrap_or_default()),
            (Some(Some(value)), None) | (Some(None), Some(Alpha::Given(value))) => Ok(Alpha::Absolute(value)),
            (Some(Some(_)), Some(_)) => Err(Failure::given(
                "two values of alpha are given",
                Some("leave out --alpha, or the number of --alpha-absolute"),
            )),
            (Some(None), _) => {
                let fix = "write --alpha-absolute 0.1, or --alpha 0.1 --alpha-absolute";
                Err(Failure::given("--alpha-absolute needs a number", Some(fix)))
            }
        }
    }

    /// Position estimates of presses whose true positions are known in another coordinate frame: by several linear
    /// methods to select from, or by the requested network.
    pub fn press_estimates(&self, skin: &Skin, differences: &[Frame]) -> Outcome<PressEstimates> {
        let left_out = self.left_out(&skin.design().protocol)?;
        let options = AlignOptions { left_out, ..AlignOptions::new(skin.design().sheet.touch) };
        if self.name().is_empty() {
            return Ok(PressEstimates::new(skin.forward(), skin.pixels(), differences, &options)?);
        }
        if Methods::LINEAR.contains(&self.name()) {
            let message =
                format!("--align chooses among linear methods by itself: --method {} has no part in it", self.name());
            return Err(Failure::given(message, Some("leave --method out, or name a network")));
        }
        let model = Model::named(self.name(), skin)?;
        let screens = vec![Screen::Disagreeing, Screen::PolarityBlind];
        let options = AlignOptions { detector: Detector::new(model.detection()), screens, ..options };
        PressEstimates::by(
            skin.forward(),
            skin.pixels(),
            differences,
            &options,
            |cut, left_out| -> Outcome<Vec<AlignMethod>> {
                Ok(vec![(Box::new(model.without(left_out)?.matched(cut)), None)])
            },
        )
    }

    /// Saves the detection options to the card of the model in a folder.
    pub fn keep_detection(&self, skin: &Skin, detection: DetectOptions) -> Outcome {
        let folder = Path::new(self.name());
        Ok(Model::named(self.name(), skin)?.with_detection(detection).save_card(folder)?)
    }

    /// Rejects anything but the folder of a network.
    pub fn check_is_folder(&self, option: &str) -> Outcome {
        if is_path(self.name()) {
            return Ok(());
        }
        let fix = "give the folder with --method, as in --method ./my-model";
        Err(Failure::given(format!("{option} needs the folder of a network"), Some(fix)))
    }
}

/// What is left out, and which electrodes explain it.
fn left_out_text(design: &SkinDesign, broken: &[usize]) -> String {
    let protocol = &design.protocol;
    let electrodes = disconnected_electrodes(protocol, |channel| broken.binary_search(&channel).is_err());
    let reason = if electrodes.is_empty() {
        String::new()
    } else {
        format!("; no current flows through {} {}", number_of(electrodes.len(), "electrode"), ranges(&electrodes))
    };
    format!(
        "{} of {} scatter in the untouched frames far more than the others and are left out ({}){reason}",
        counted(broken.len(), "channel"),
        protocol.channel_count(),
        ranges(broken),
    )
}
