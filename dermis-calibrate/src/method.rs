//! Calibrations as methods of the registry.

use crate::calibration::Calibration;
use crate::correction::Correction;
use crate::error::CalibrateError;
use crate::fitted::{Fitted, unlike};
use crate::located::Located;
use crate::posterior::Posterior;
use crate::touches::Superposition;
use dermis::contact::{Contact, DOUBT};
use dermis::detect::DetectOptions;
use dermis::forward::Matrix;
use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::image::PixelSpace;
use dermis::method::{Method, MethodError, MethodOptions, MethodSource, Methods, is_path};
use dermis::reconstruct::{Quantity, Reconstruct, ReconstructError, check_difference, check_lengths};
use dermis::skin::Skin;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// The source of calibrations in folders: forward maps, and corrections of other methods.
///
/// ```
/// use dermis::method::{MethodOptions, Methods};
/// use dermis::skin::Skin;
/// use dermis_calibrate::Calibrations;
///
/// let skin = Skin::load("skin16")?;
/// let methods = Methods::linear().with(Calibrations::of(Methods::linear()));
/// // Any other name or folder is left to the other sources.
/// assert!(methods.method(&skin, "./no-such-folder", &MethodOptions::default()).is_err());
/// assert_eq!(methods.method(&skin, "noser", &MethodOptions::default())?.name(), "noser");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Calibrations {
    /// The methods that may be corrected.
    base: Methods,
}

impl Calibrations {
    /// Calibrations, and corrections of some methods.
    pub fn of(base: Methods) -> Self {
        Calibrations { base }
    }
}

impl Fitted {
    /// Reads the calibration in a folder; `None` for any other folder.
    ///
    /// # Errors
    /// A file that is missing, damaged or of another version; a calibration of another design.
    pub fn load(folder: &Path, skin: &Skin) -> Result<Option<Self>, CalibrateError> {
        if Calibration::is_folder(folder) {
            return Ok(Some(Fitted::ForwardMap(Box::new(Calibration::load(folder, skin.design())?))));
        }
        if Correction::is_folder(folder) {
            return Ok(Some(Fitted::Correction(Box::new(Correction::load(folder, skin.design())?))));
        }
        Ok(None)
    }

    /// The method with this name: of a correction, `methods` has the method that it corrects.
    ///
    /// # Errors
    /// Options that it does not have; a corrected method that cannot be prepared.
    pub fn into_method(
        self,
        methods: &Methods,
        skin: &Skin,
        name: &str,
        options: &MethodOptions,
    ) -> Result<Method, MethodError> {
        // A correction is of the method with its default options.
        options.check_not_linear(name)?;
        match self {
            Fitted::ForwardMap(calibration) => {
                if !options.excluded.is_empty() {
                    let message = "uses all channels: leave --leave-out out".into();
                    return Err(MethodError::Option { method: name.into(), message });
                }
                let method = CalibratedMethod::new(skin, *calibration, None);
                Ok(Method::new(name, format!("calibration in {name}"), Arc::new(method)))
            }
            Fitted::Correction(correction) => {
                let base = methods.method(skin, correction.method(), options)?;
                if !correction.is_of(&base) {
                    let message =
                        format!("corrects {}, which has been trained again since: calibrate again", base.name());
                    return Err(MethodError::Option { method: name.into(), message });
                }
                // The end of the label says whether contacts are refined.
                let label = format!("correction in {name} of {}", base.label());
                let base = Arc::clone(base.reconstruct());
                let (is_ready, correction) = (!base.is_adaptable(), Arc::new(*correction));
                let method = CorrectedMethod { skin: skin.clone(), base, correction, is_ready, doubt: None };
                Ok(Method::new(name, label, Arc::new(method)))
            }
        }
    }
}

impl MethodSource for Calibrations {
    /// Calibrations have no names: they are in folders.
    fn names(&self, _: &Skin) -> Result<Vec<String>, MethodError> {
        Ok(Vec::new())
    }

    fn method(&self, skin: &Skin, name: &str, options: &MethodOptions) -> Result<Option<Method>, MethodError> {
        if !is_path(name) {
            return Ok(None);
        }
        let folder = Path::new(name);
        let Some(fitted) = Fitted::load(folder, skin)? else { return Ok(None) };
        let card = serde_json::json!({ "calibration_sha256": Fitted::sha256(folder)? }).to_string();
        Ok(Some(fitted.into_method(&self.base, skin, name, options)?.with_card(card)))
    }
}

/// A method whose contacts are corrected.
struct CorrectedMethod {
    skin: Skin,
    base: Arc<dyn Reconstruct>,
    correction: Arc<Correction>,
    /// Whether its contacts are those of the labels: a method that refines contacts is first adapted to the untouched skin.
    is_ready: bool,
    /// Why the skin to which it is adapted is not that of the labels.
    doubt: Option<String>,
}

/// What is left of contacts without grounds: none is more probable than not, and their forces are unknown.
fn without_grounds(contacts: &mut [Contact]) {
    for contact in contacts {
        contact.confidence = contact.confidence.min(DOUBT);
        [contact.force_n, contact.force_sd_n] = [f64::NAN; 2];
    }
}

impl Reconstruct for CorrectedMethod {
    fn name(&self) -> String {
        format!("{}, corrected", self.base.name())
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        self.base.pixels()
    }

    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        self.base.reconstruct_into(difference, values)
    }

    fn matrix(&self) -> Option<&Matrix> {
        self.base.matrix()
    }

    fn quantity(&self) -> Quantity {
        self.base.quantity()
    }

    fn correct(&self, difference: &[f64], contacts: &mut Vec<Contact>) {
        self.base.correct(difference, contacts);
        if self.is_ready {
            self.correction.apply(&self.base.pixels().surface, difference, contacts);
        } else {
            // What the labels say is of other contacts.
            contacts.iter_mut().for_each(|contact| [contact.force_n, contact.force_sd_n] = [f64::NAN; 2]);
        }
        if self.doubt.is_some() {
            without_grounds(contacts);
        }
    }

    fn is_adaptable(&self) -> bool {
        self.base.is_adaptable() || self.correction.rest.is_some()
    }

    fn adapted(&self, rest: &Frame, untouched: &[Frame]) -> Result<Option<Arc<dyn Reconstruct>>, ReconstructError> {
        let base = self.base.adapted(rest, untouched)?;
        let doubt = self.correction.rest.as_ref().and_then(|of_labels| unlike(self.skin.design(), of_labels, rest));
        if base.is_none() && doubt.is_none() {
            return Ok(None);
        }
        let is_ready = base.as_ref().map_or(self.is_ready, |base| base.warning().is_none());
        let (base, correction) = (base.unwrap_or_else(|| Arc::clone(&self.base)), Arc::clone(&self.correction));
        Ok(Some(Arc::new(CorrectedMethod { skin: self.skin.clone(), base, correction, is_ready, doubt })))
    }

    fn warning(&self) -> Option<&str> {
        self.doubt.as_deref().or_else(|| self.base.warning())
    }

    fn novelty(&self, difference: &[f64]) -> Option<f64> {
        self.base.novelty(difference)
    }

    fn detection(&self) -> DetectOptions {
        let mut options = self.base.detection();
        if let (Some(forces), Some(relative_sd)) = (&mut options.forces, self.correction.relative_force_sd()) {
            forces.relative_sd = relative_sd;
        }
        options
    }
}

impl From<CalibrateError> for MethodError {
    fn from(error: CalibrateError) -> Self {
        MethodError::Source(Box::new(error))
    }
}

/// A calibration as a method: single frames to positions, without the memory of the press before.
struct CalibratedMethod {
    skin: Skin,
    calibration: Calibration,
    /// For frames that no single press explains.
    superposition: Superposition,
    /// The node of the region nearest to each pixel.
    nodes: Vec<usize>,
    /// Why the skin to which it is adapted is not that of the labels.
    doubt: Option<String>,
    last: Mutex<Option<Arc<Estimate>>>,
}

/// What a calibration states of a frame.
struct Estimate {
    difference: Vec<f64>,
    /// Value of each pixel.
    image: Vec<f64>,
    contacts: Vec<Contact>,
    novelty: Option<f64>,
}

impl CalibratedMethod {
    fn new(skin: &Skin, calibration: Calibration, doubt: Option<String>) -> Self {
        let nodes = &calibration.locator.region().nodes;
        let nearest = |centre: &Point3| {
            let centre = calibration.pose.map_or(*centre, |pose| pose.to_robot(*centre));
            let apart = |node: &usize| distance(nodes[*node], centre);
            (0..nodes.len()).min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("a region has nodes")
        };
        let nodes = skin.pixels().centres_m.iter().map(nearest).collect();
        let superposition = Superposition::new(&calibration);
        CalibratedMethod { skin: skin.clone(), calibration, superposition, nodes, doubt, last: Mutex::new(None) }
    }

    /// The frame's single press, and its touches: none where one of them is no better than the untouched frame, several
    /// where no single press explains the frame.
    fn touches(&self, difference: &[f64]) -> (Located, Vec<(Located, Posterior<'_>)>) {
        let Calibration { locator, .. } = &self.calibration;
        let values = self.calibration.single(difference);
        let posterior = locator.posterior(&values, None, self.calibration.last_number());
        let single = posterior.located(locator.temperature);
        let touches = if self.calibration.is_unlike(&single) {
            let posteriors = self.superposition.posteriors(&self.calibration, &values).into_iter();
            posteriors.map(|posterior| (posterior.located(locator.temperature), posterior)).collect()
        } else {
            vec![(single, posterior)]
        };
        let is_untouched = touches.iter().any(|(_, posterior)| posterior.is_untouched());
        (single, if is_untouched { Vec::new() } else { touches })
    }

    /// What the last frame states; a pipeline asks for its image, its contacts and its novelty one after the other.
    fn estimate(&self, difference: &[f64]) -> Arc<Estimate> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(estimate) = last.as_ref().filter(|estimate| estimate.difference == difference) {
            return Arc::clone(estimate);
        }
        drop(last);
        let estimate = Arc::new(self.compute(difference));
        last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        *last = Some(Arc::clone(&estimate));
        estimate
    }

    fn compute(&self, difference: &[f64]) -> Estimate {
        let temperature = self.calibration.locator.temperature;
        let (single, touches) = self.touches(difference);
        let mut image = vec![0.0_f64; self.pixels().len()];
        for (_, posterior) in &touches {
            let density = posterior.relative_density(temperature);
            image.iter_mut().zip(&self.nodes).for_each(|(value, &node)| *value = value.max(density[node]));
        }
        let mut contacts: Vec<Contact> = touches.iter().map(|(located, _)| self.contact(located)).collect();
        if self.doubt.is_some() {
            without_grounds(&mut contacts);
        }
        Estimate {
            difference: difference.to_vec(),
            image,
            contacts,
            // Several touches would explain what is the ageing of the skin.
            novelty: (touches.len() == 1).then(|| self.calibration.novelty(single.misfit)),
        }
    }

    fn contact(&self, located: &Located) -> Contact {
        let position_m = self.calibration.pose.map_or(located.position_m, |pose| {
            let [x, y, _] = pose.to_skin(located.position_m);
            [x, y, 0.0]
        });
        let normal = self.pixels().normal(position_m);
        let confidence = if self.calibration.is_unlike(located) { 0.0 } else { located.confidence };
        let [force_n, force_sd_n] = self.calibration.force_n(located);
        Contact { sd_m: located.sd_m(), confidence, force_sd_n, ..Contact::truth(position_m, normal, force_n) }
    }
}

impl Reconstruct for CalibratedMethod {
    fn name(&self) -> String {
        "calibration".into()
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        self.skin.pixels()
    }

    fn is_adaptable(&self) -> bool {
        self.calibration.rest.is_some()
    }

    fn adapted(&self, rest: &Frame, _: &[Frame]) -> Result<Option<Arc<dyn Reconstruct>>, ReconstructError> {
        let of_labels = self.calibration.rest.as_ref();
        let doubt = of_labels.and_then(|of_labels| unlike(self.skin.design(), of_labels, rest));
        let adapted = |doubt| Arc::new(CalibratedMethod::new(&self.skin, self.calibration.clone(), Some(doubt)));
        Ok(doubt.map(adapted).map(|method| method as Arc<dyn Reconstruct>))
    }

    fn warning(&self) -> Option<&str> {
        self.doubt.as_deref()
    }

    /// The posterior density of the position relative to its largest value; zero where the frame is untouched.
    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        check_lengths(difference, self.calibration.channel_count(), values, self.pixels().len())?;
        values.copy_from_slice(&self.estimate(difference).image);
        Ok(())
    }

    fn quantity(&self) -> Quantity {
        Quantity::Density
    }

    fn contacts(&self, difference: &[f64]) -> Result<Option<Vec<Contact>>, ReconstructError> {
        check_difference(difference, self.calibration.channel_count())?;
        Ok(Some(self.estimate(difference).contacts.clone()))
    }

    fn novelty(&self, difference: &[f64]) -> Option<f64> {
        check_difference(difference, self.calibration.channel_count()).ok()?;
        self.estimate(difference).novelty
    }
}
