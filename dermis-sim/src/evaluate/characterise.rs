//! The errors of a method, measured on simulated touches.

use crate::dataset::{Generator, Recipe};
use crate::evaluate::{CalibrationRun, EvaluateError};
use dermis::contact::REGION_95_SD;
use dermis::detect::{DetectOptions, Forces, Misplacement, PositionSpread, blur_share};
use dermis::method::Method;
use dermis::skin::Skin;
use serde::Serialize;
use std::io::Write;

/// Position errors and forces of a method; serialised to the JSON output of `dermis characterise --json`.
#[derive(Debug, Clone, Serialize)]
pub struct Characteristics {
    /// The method.
    pub method: String,
    /// Its alpha, if it has one.
    pub alpha: Option<f64>,
    /// Number of true touches.
    pub touches: usize,
    /// Number of touches that were detected.
    pub found: usize,
    /// Number of contacts without a touch.
    pub false_positives: usize,
    /// Share of the variance of the targets that the images do not explain.
    pub unexplained: f64,
    /// Factor by which the images are larger than the targets.
    pub gain: f64,
    /// Variance of the targets.
    pub target_variance: f64,
    /// Share of the true positions inside the 95 % regions that the method stated.
    pub covered_before: f64,
    /// Systematic error over the radius of a contact.
    pub blur_share: f64,
    /// Options of detection with the measured spread of positions and the measured forces.
    pub detection: DetectOptions,
    /// The contacts that were matched with a touch.
    #[serde(skip)]
    pub misplacements: Vec<Misplacement>,
}

/// Detects simulated touches by a method, with noise, and measures the errors of their positions and forces. `step` is called
/// after every sample, from several threads.
///
/// ```no_run
/// use dermis::method::{MethodOptions, Methods};
/// use dermis::skin::Skin;
/// use dermis_sim::dataset::{PatchTouches, Recipe, SkinSpread, Skins, Touch};
/// use dermis_sim::evaluate::characterise;
///
/// let skin = Skin::load("cylinder30").unwrap();
/// let method = Methods::linear().method(&skin, "noser", &MethodOptions::default()).unwrap();
/// let (touch, skins) = (Touch::Patch(PatchTouches::usual()), Skins::Random(SkinSpread::usual()));
/// let recipe = Recipe { seed: 3001, samples: 4000, touch, skins };
/// let detection = method.reconstruct().detection();
/// let found = characterise(&skin, &method, detection, &[recipe], || ())?;
/// println!("{} of {} touches", found.found, found.touches);
/// # Ok::<(), dermis_sim::Error>(())
/// ```
///
/// # Errors
/// Recipes that the skin does not allow; as [`CalibrationRun::of`]; too few detected touches.
pub fn characterise(
    skin: &Skin,
    method: &Method,
    mut detection: DetectOptions,
    recipes: &[Recipe],
    step: impl Fn() + Sync,
) -> crate::Result<Characteristics> {
    let mut run = CalibrationRun::default();
    for recipe in recipes {
        let generator = Generator::new(skin.design(), skin.forward(), recipe)?;
        let reconstruct = method.reconstruct().as_ref();
        run = run.with(CalibrationRun::of(reconstruct, &detection, &generator, 0..recipe.samples, &step)?);
    }
    let contacts = run.misplacements;
    let few = || EvaluateError::TooFewFound { found: contacts.len() };
    let blur_share = blur_share(&contacts).ok_or_else(few)?;
    let covered_before = covered(&contacts, |contact| contact.stated_m);
    detection.spread = Some(PositionSpread::fit(&contacts).ok_or_else(few)?);
    // A method that is calibrated on touches without a force keeps its force calibration.
    let single = contacts.iter().filter(|contact| !contact.is_shared);
    detection.forces =
        Forces::fit(single.map(|contact| (contact.force_n, contact.newtons_per_strength))).or(detection.forces);
    Ok(Characteristics {
        method: method.description(),
        alpha: method.alpha(),
        touches: run.touches,
        found: contacts.len(),
        false_positives: run.false_positives,
        unexplained: run.images.unexplained(),
        gain: run.images.gain(),
        target_variance: run.images.target_variance(),
        covered_before,
        blur_share,
        detection,
        misplacements: contacts,
    })
}

/// The share of true positions inside the 95 % regions of given standard deviations.
fn covered(contacts: &[Misplacement], sd_m: impl Fn(&Misplacement) -> f64) -> f64 {
    let inside = contacts.iter().filter(|contact| contact.error_m <= REGION_95_SD * sd_m(contact)).count();
    inside as f64 / contacts.len() as f64
}

impl Characteristics {
    /// The share of some true positions inside the 95 % regions of the measured spread; `NaN` without any.
    pub fn covered(&self, counts: fn(&Misplacement) -> bool) -> f64 {
        let part: Vec<Misplacement> = self.misplacements.iter().copied().filter(counts).collect();
        let sd_m = |contact: &Misplacement| {
            self.detection.spread.as_ref().map_or(f64::NAN, |spread| spread.sd_m(&contact.circumstances))
        };
        covered(&part, sd_m)
    }

    /// Writes the matched contacts with their errors (CSV; m, N).
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write_csv(&self, out: &mut dyn Write) -> std::io::Result<()> {
        writeln!(out, "touches,is_shared,signal,noise_m,radius_m,next_m,stated_m,error_m,newtons_per_strength")?;
        self.misplacements.iter().try_for_each(|contact| {
            let Misplacement { circumstances: c, touches, is_shared, stated_m, error_m, newtons_per_strength, .. } =
                contact;
            let next = if c.next_m.is_finite() { format!("{:?}", c.next_m) } else { String::new() };
            write!(out, "{touches},{},{:?},{:?},{:?},", u8::from(*is_shared), c.signal, c.noise_m, c.radius_m)?;
            writeln!(out, "{next},{stated_m:?},{error_m:?},{newtons_per_strength:?}")
        })
    }
}
