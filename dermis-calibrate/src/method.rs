//! Calibrations as methods of the registry.

use crate::calibration::Calibration;
use crate::correction::Correction;
use crate::error::CalibrateError;
use crate::locate::Located;
use dermis::contact::Contact;
use dermis::detect::DetectOptions;
use dermis::forward::Matrix;
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::image::PixelSpace;
use dermis::method::{Method, MethodError, MethodOptions, MethodSource, Methods, is_path};
use dermis::reconstruct::{Quantity, Reconstruct, ReconstructError, check_lengths};
use dermis::skin::Skin;
use std::path::Path;
use std::sync::Arc;

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

    fn forward_map(skin: &Skin, name: &str, options: &MethodOptions) -> Result<Method, MethodError> {
        options.check_not_linear(name)?;
        if !options.excluded.is_empty() {
            let message = "uses all channels: leave --leave-out out".into();
            return Err(MethodError::Option { method: name.into(), message });
        }
        let calibration = Calibration::load(Path::new(name), &skin.design().name)?;
        if calibration.channel_count() != skin.design().protocol.channel_count() {
            let (got, expected) = (skin.design().protocol.channel_count(), calibration.channel_count());
            return Err(CalibrateError::Channels { got, expected }.into());
        }
        let method = CalibratedMethod::new(skin, calibration);
        Ok(Method::new(name, format!("calibration in {name}"), Arc::new(method)))
    }

    fn correction(&self, skin: &Skin, name: &str, options: &MethodOptions) -> Result<Method, MethodError> {
        let correction = Correction::load(Path::new(name), &skin.design().name)?;
        let base = self.base.method(skin, correction.method(), options)?;
        let label = format!("{} with the correction in {name}", base.label());
        let method = CorrectedMethod { base: Arc::clone(base.reconstruct()), correction };
        Ok(Method::new(name, label, Arc::new(method)))
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
        if Calibration::is_folder(Path::new(name)) {
            return Self::forward_map(skin, name, options).map(Some);
        }
        if Correction::is_folder(Path::new(name)) {
            return self.correction(skin, name, options).map(Some);
        }
        Ok(None)
    }
}

/// A method whose contacts are corrected.
struct CorrectedMethod {
    base: Arc<dyn Reconstruct>,
    correction: Correction,
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

    fn correct(&self, difference: &[f64], contacts: &mut [Contact]) {
        self.correction.apply(&self.base.pixels().surface, difference, contacts);
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

/// A calibration as a method: single frames to the position of one press, without the memory of the press before.
struct CalibratedMethod {
    calibration: Calibration,
    pixels: Arc<PixelSpace>,
    /// The node of the region nearest to each pixel.
    nodes: Vec<usize>,
    /// The change of an untouched frame, in units of the channels.
    untouched: Vec<f64>,
}

impl CalibratedMethod {
    fn new(skin: &Skin, calibration: Calibration) -> Self {
        let pixels = Arc::clone(skin.pixels());
        let nodes = &calibration.locator.region().nodes;
        let nearest = |centre: &Point3| {
            let centre = calibration.pose.map_or(*centre, |pose| pose.to_robot(*centre));
            let apart = |node: &usize| distance(nodes[*node], centre);
            (0..nodes.len()).min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("a region has nodes")
        };
        let nodes = pixels.centres_m.iter().map(nearest).collect();
        let untouched = calibration.single(&vec![0.0; calibration.channel_count()]);
        CalibratedMethod { calibration, pixels, nodes, untouched }
    }

    /// Whether a frame is nearer to the untouched one than to any press.
    fn is_untouched(&self, values: &[f64], located: &Located) -> bool {
        self.calibration.locator.whitened_square(values, &self.untouched) <= located.square
    }

    fn contact(&self, located: &Located) -> Contact {
        let position_m = self.calibration.pose.map_or(located.position_m, |pose| {
            let [x, y, _] = pose.to_skin(located.position_m);
            [x, y, 0.0]
        });
        let nearest = || {
            let apart = |pixel: &usize| distance(self.pixels.centres_m[*pixel], position_m);
            let pixel = (0..self.pixels.len()).min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("a skin has pixels");
            self.pixels.normals[pixel]
        };
        let normal = self.pixels.surface.normal(position_m).unwrap_or_else(nearest);
        let confidence = if self.calibration.is_unlike(located) { 0.0 } else { located.confidence };
        Contact { sd_m: located.sd_m(), confidence, ..Contact::truth(position_m, normal, f64::NAN) }
    }
}

impl Reconstruct for CalibratedMethod {
    fn name(&self) -> String {
        "calibration".into()
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        &self.pixels
    }

    /// The posterior density of the position relative to its largest value; zero where the frame is untouched.
    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        check_lengths(difference, self.calibration.channel_count(), values, self.pixels.len())?;
        let frame = self.calibration.single(difference);
        let posterior = self.calibration.locator.posterior(&frame, None, self.calibration.last_number());
        let temperature = self.calibration.locator.temperature;
        if self.is_untouched(&frame, &posterior.located(temperature)) {
            values.fill(0.0);
            return Ok(());
        }
        let density = posterior.relative_density(temperature);
        values.iter_mut().zip(&self.nodes).for_each(|(value, &node)| *value = density[node]);
        Ok(())
    }

    fn quantity(&self) -> Quantity {
        Quantity::Density
    }

    fn contacts(&self, difference: &[f64]) -> Option<Vec<Contact>> {
        let frame = self.calibration.single(difference);
        let located = self.calibration.locator.locate(&frame, None, self.calibration.last_number());
        Some(if self.is_untouched(&frame, &located) { Vec::new() } else { vec![self.contact(&located)] })
    }
}
