//! Options of a digital twin, as in its file.

use super::electronics::{ElectronicsOptions, out_of_range, positive};
use super::faults::FaultOptions;
use super::imperfections::{CoatOptions, DriftOptions, ElectrodeOptions, TemperatureOptions};
use super::{LayerOptions, PatchOptions, TwinError, shipped};
use crate::elementary::powf;
use dermis::design::{Body, DesignError, SkinDesign, TouchEffect};
use dermis::files::{MAX_SETTINGS_BYTES, read_text_at_most};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// A digital twin: the effect of a press, the imperfections and faults of the skin, and the instrument. Units are SI,
/// as in the names. A missing table means that the imperfection is absent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Dermis twin")]
pub struct TwinOptions {
    /// Name for tables and summaries.
    pub name: String,
    /// Edge length of the twin's mesh over that of the design's mesh, which is used for reconstruction.
    pub mesh_scale: f64,
    /// Effect of a press on the skin.
    pub touch: TouchOptions,
    /// The presses of an experiment.
    pub press: PressOptions,
    /// Non-uniformity of the coating.
    pub coat: CoatOptions,
    /// Placement errors of the electrodes.
    pub electrodes: ElectrodeOptions,
    /// Drift during a recording.
    pub drift: Option<DriftOptions>,
    /// Temperature of the skin.
    pub temperature: Option<TemperatureOptions>,
    /// Faults of the skin.
    #[serde(default)]
    pub faults: FaultOptions,
    /// The instrument.
    pub electronics: ElectronicsOptions,
    /// The file that it was read from.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
}

/// A file's name and text, for its errors.
#[derive(Debug, PartialEq)]
pub(super) struct Source {
    name: String,
    text: String,
}

/// Effect of a press on the skin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum TouchOptions {
    /// The paper's training touch: a Gaussian change of the coating's conductance.
    Gaussian(GaussianOptions),
    /// The paper's skin: fabric patches that foam presses onto the coating.
    Patches(PatchOptions),
    /// A continuous piezoresistive layer: the coating conducts better where foam presses on it.
    Layer(LayerOptions),
}

/// The paper's training touch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GaussianOptions {
    /// Relative change of conductance in the centre of a press per newton, 1/N.
    pub amplitude_per_n: f64,
    /// Standard deviation along the surface, m.
    pub width_m: f64,
}

/// The presses of an experiment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PressOptions {
    /// Minimum force, N; forces are log-uniform and independent of the position.
    pub least_force_n: f64,
    /// Maximum force, N.
    pub greatest_force_n: f64,
    /// Radius of the spherical tip, m.
    pub tip_radius_m: f64,
    /// Interval between presses, s; at least one frame.
    pub interval_s: f64,
}

impl TwinOptions {
    /// Names of the shipped twins.
    pub const SHIPPED: [&str; 5] = shipped::NAMES;

    /// A twin by name (see [`SHIPPED`](Self::SHIPPED)) or by the path of its TOML file. A file of that name has
    /// priority.
    ///
    /// # Errors
    /// No such file or name; the errors of [`parse`](Self::parse).
    pub fn load(name_or_path: &str) -> Result<Self, DesignError> {
        if let (false, Some(twin)) = (Path::new(name_or_path).is_file(), Self::shipped(name_or_path)) {
            return Ok(twin);
        }
        let text = read_text_at_most(Path::new(name_or_path), MAX_SETTINGS_BYTES).map_err(|error| {
            let fix = match dermis::design::closest_name(name_or_path, shipped::NAMES.into_iter()) {
                Some(name) => format!("did you mean `{name}`?"),
                None => format!("give the path of a twin's file, or one of {}", shipped::NAMES.join(", ")),
            };
            DesignError::new(format!("cannot read the twin {name_or_path}: {error}"), Some(fix))
        })?;
        Self::parse(&text, name_or_path)
    }

    /// A shipped twin; `None` if there is none of that name.
    pub fn shipped(name: &str) -> Option<Self> {
        let text = shipped::text(name)?;
        Some(Self::parse(text, name).expect("shipped twins are valid: a test reads each"))
    }

    /// The text of a shipped twin; `None` if there is none of that name.
    pub fn shipped_text(name: &str) -> Option<&'static str> {
        shipped::text(name)
    }

    /// A twin from the text of its TOML file; errors contain the file name `name`.
    ///
    /// # Errors
    /// A text that is not TOML; unknown, missing or mistyped keys; invalid values. The error contains the line.
    pub fn parse(text: &str, name: &str) -> Result<Self, DesignError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let source = Source { name: name.to_string(), text: text.to_string() };
        let mut twin: TwinOptions = toml::from_str(text).map_err(|error| {
            let (message, fix) = dermis::design::explain_toml_error(error.message());
            source.error(message, fix, error.span())
        })?;
        twin.check().map_err(|error| source.locate(error))?;
        twin.source = Some(Arc::new(source));
        Ok(twin)
    }

    /// Refuses values that are invalid for any skin.
    ///
    /// # Errors
    /// The wrong field, its value and the fix.
    pub fn check(&self) -> Result<(), TwinError> {
        if !(0.05..=4.0).contains(&self.mesh_scale) {
            let fix = "0.6 makes edges that much shorter than the design's";
            return Err(out_of_range("mesh_scale", self.mesh_scale, "0.05 to 4".into(), fix));
        }
        match &self.touch {
            TouchOptions::Gaussian(gaussian) => gaussian.check()?,
            TouchOptions::Patches(patches) => patches.check()?,
            TouchOptions::Layer(layer) => layer.check()?,
        }
        self.press.check()?;
        self.coat.check()?;
        self.electrodes.check()?;
        self.drift.map_or(Ok(()), |drift| drift.check())?;
        self.temperature.map_or(Ok(()), |temperature| temperature.check())?;
        self.faults.check_ranges()?;
        self.electronics.check_ranges()
    }

    /// This twin adapted to a design, as [`Twin::new`](super::Twin::new) describes: it alone decides of what a twin is
    /// made.
    pub(super) fn made_of(mut self, design: &SkinDesign) -> Self {
        let charted = !matches!(design.body, Body::Mesh { .. });
        let rises = design.sheet.touch == TouchEffect::ConductanceRises;
        let needs_both = match self.touch {
            TouchOptions::Gaussian(_) => None,
            TouchOptions::Patches(_) => Some(" without patches"),
            TouchOptions::Layer(_) => Some(" without a layer"),
        };
        if let (Some(without), false) = (needs_both, charted && rises) {
            let amplitude_per_n = if rises { 0.5 } else { 0.1 };
            self.touch = TouchOptions::Gaussian(GaussianOptions { amplitude_per_n, width_m: 0.008 });
            self.name += without;
        }
        self
    }

    /// The same without manufacturing errors and faults: even coat, electrodes in their places, the design's own mesh.
    #[must_use]
    pub fn as_designed(&self) -> Self {
        TwinOptions {
            mesh_scale: 1.0,
            coat: CoatOptions { rms: 0.0, ..self.coat },
            electrodes: ElectrodeOptions { displacement_rms_m: 0.0, contact_impedance_rms: 0.0 },
            faults: FaultOptions::default(),
            ..self.clone()
        }
    }

    /// An error of this twin with its place in the file, if it was read from one.
    pub(super) fn locate(&self, error: TwinError) -> crate::Error {
        match &self.source {
            Some(source) => source.locate(error).into(),
            None => error.into(),
        }
    }

    /// JSON schema of a twin's file.
    pub fn json_schema() -> serde_json::Value {
        schemars::schema_for!(TwinOptions).to_value()
    }
}

impl GaussianOptions {
    fn check(&self) -> Result<(), TwinError> {
        positive("touch.gaussian.amplitude_per_n", self.amplitude_per_n)?;
        positive("touch.gaussian.width_m", self.width_m)
    }
}

impl PressOptions {
    fn check(&self) -> Result<(), TwinError> {
        positive("press.least_force_n", self.least_force_n)?;
        positive("press.greatest_force_n", self.greatest_force_n)?;
        positive("press.tip_radius_m", self.tip_radius_m)?;
        positive("press.interval_s", self.interval_s)?;
        if self.greatest_force_n < self.least_force_n {
            let must = format!("at least least_force_n, {}", self.least_force_n);
            return Err(out_of_range("press.greatest_force_n", self.greatest_force_n, must, "exchange the two"));
        }
        Ok(())
    }

    /// The force at a fraction of the range, from 0 to 1: log-uniform for a uniform fraction.
    pub fn force_n(&self, share: f64) -> f64 {
        self.least_force_n * powf(self.greatest_force_n / self.least_force_n, share)
    }
}

impl Source {
    fn error(&self, message: String, fix: Option<String>, span: Option<std::ops::Range<usize>>) -> DesignError {
        DesignError { message, fix, source_text: Some((self.name.clone(), self.text.clone())), span }
    }

    /// An error with the place of its field in the file.
    fn locate(&self, error: TwinError) -> DesignError {
        let span = error.field().and_then(|field| self.span_of(field));
        match error {
            TwinError::OutOfRange { field, value, must, fix } => {
                self.error(format!("`{field}` is {value}: it must be {must}"), Some(fix), span)
            }
            error => self.error(error.to_string(), None, span),
        }
    }
}

/// The possible parent tables of fields that are named without their tables.
const TABLES: [&str; 6] =
    ["", "touch.patches.", "touch.patches.foam.", "touch.patches.contact.", "touch.layer.", "touch.layer.foam."];

impl Source {
    /// The byte range of a field's value, or of the innermost existing table on the way to it.
    fn span_of(&self, field: &str) -> Option<std::ops::Range<usize>> {
        let document = toml::de::DeTable::parse(&self.text).ok()?;
        let found = TABLES.map(|table| deepest(document.get_ref(), &format!("{table}{field}")));
        let whole = found.iter().find(|(_, is_whole)| *is_whole);
        whole.or(found.first()).and_then(|(span, _)| span.clone())
    }
}

/// The place of the innermost existing part of a path, and whether it is the whole path.
fn deepest(document: &toml::de::DeTable<'_>, path: &str) -> (Option<std::ops::Range<usize>>, bool) {
    let (mut table, mut span) = (document, None);
    for key in path.split('.') {
        let Some((_, value)) = table.iter().find(|(name, _)| name.get_ref() == key) else { return (span, false) };
        span = Some(value.span());
        match value.get_ref() {
            toml::de::DeValue::Table(inner) => table = inner,
            _ => return (span, path.ends_with(key)),
        }
    }
    (span, true)
}
