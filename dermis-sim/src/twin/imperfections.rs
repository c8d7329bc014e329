//! Differences between skins of one design: non-uniform coatings, displaced electrodes, contact impedances, drift.

use super::TwinError;
use super::electronics::{not_negative, out_of_range, positive};
use super::field::CorrelatedField;
use crate::elementary::{atan2, exp_m1, hypot, sin_cos, unrolled};
use crate::random::{log_normal, sample_rng, standard_normal};
use dermis::design::{Body, Electrode, ElectrodeShape, SkinDesign};
use dermis::forward::{ElectrodeNetwork, ForwardError};
use dermis::geom::{Point3, Surface};
use dermis::mesh::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Random streams of a skin's imperfections; frames have the streams of their indices, the instrument the last one.
const COAT_STREAM: u64 = u64::MAX - 1;
const PLACE_STREAM: u64 = u64::MAX - 2;
const CONTACT_STREAM: u64 = u64::MAX - 3;
const DRIFT_STREAM: u64 = u64::MAX - 4;

/// Non-uniformity of the coating: log-normal about the design's conductance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoatOptions {
    /// Standard deviation of the conductance over its mean.
    pub rms: f64,
    /// Correlation length along the surface, m: at a distance d the correlation is exp(-d^2 / (2 l^2)).
    pub correlation_m: f64,
}

/// Placement errors of the electrodes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ElectrodeOptions {
    /// Root mean square of their displacements, m. On a rim they are displaced only along it.
    pub displacement_rms_m: f64,
    /// Standard deviation of the contact impedance over the design's, log-normal.
    pub contact_impedance_rms: f64,
}

/// Drift during a recording: `1 + a (1 - exp(-t / tau))`, with an amplitude `a` drawn once for the coating and once for
/// each contact.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DriftOptions {
    /// Standard deviation of the coating's amplitude, relative to its conductance.
    pub conductance_rms: f64,
    /// Standard deviation of a contact's amplitude, relative to its impedance.
    pub contact_rms: f64,
    /// Time constant tau, s.
    pub time_constant_s: f64,
}

/// Temperature of the skin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TemperatureOptions {
    /// Relative change of the coating's conductance per kelvin, 1/K.
    pub coefficient_per_k: f64,
    /// Temperature at the first frame minus that of the design's conductance, K.
    pub change_k: f64,
    /// Heating rate, K/s.
    pub rate_k_per_s: f64,
}

impl CoatOptions {
    pub(crate) fn check(&self) -> Result<(), TwinError> {
        share("coat.rms", self.rms)?;
        positive("coat.correlation_m", self.correlation_m)?;
        if self.correlation_m > 1000.0 {
            let (must, fix) = ("at most 1000".to_string(), "in metres: 40 mm are 0.040");
            return Err(out_of_range("coat.correlation_m", self.correlation_m, must, fix));
        }
        Ok(())
    }

    /// The factor of the coating's conductance in each cell: `exp(q g - q^2 / 2)` of a unit field `g`, with
    /// `q^2 = ln(1 + rms^2)`, so that its mean is 1 and its standard deviation `rms`.
    ///
    /// # Errors
    /// A correlation length far below the cell size of any mesh.
    pub(super) fn draw(&self, surface: Surface, mesh: &Mesh, seed: u64) -> Result<Vec<f64>, TwinError> {
        if self.rms == 0.0 {
            return Ok(vec![1.0; mesh.cell_count()]);
        }
        let mut rng = sample_rng(seed, COAT_STREAM);
        let field = CorrelatedField::new(surface, mesh, self.correlation_m, &mut rng).ok_or_else(|| {
            let (must, fix) = ("not far shorter than the cells of a mesh".to_string(), "in metres: 40 mm are 0.040");
            out_of_range("coat.correlation_m", self.correlation_m, must, fix)
        })?;
        Ok((0..mesh.cell_count()).map(|cell| log_normal(self.rms, field.at(mesh.cell_centre(cell)))).collect())
    }
}

impl ElectrodeOptions {
    pub(crate) fn check(&self) -> Result<(), TwinError> {
        not_negative("electrodes.displacement_rms_m", self.displacement_rms_m)?;
        if self.displacement_rms_m > 0.1 {
            let (must, fix) = ("at most 0.1".to_string(), "in metres: 0.5 mm are 0.0005");
            return Err(out_of_range("electrodes.displacement_rms_m", self.displacement_rms_m, must, fix));
        }
        share("electrodes.contact_impedance_rms", self.contact_impedance_rms)
    }

    /// The design with its displaced electrodes and their contact impedances.
    ///
    /// # Errors
    /// Electrodes that are groups of a mesh file, which cannot be moved; electrodes that overlap after displacement.
    pub(crate) fn draw(&self, design: &SkinDesign, seed: u64) -> crate::Result<SkinDesign> {
        let (mut places, mut contacts) = (sample_rng(seed, PLACE_STREAM), sample_rng(seed, CONTACT_STREAM));
        let mut drawn = design.clone();
        for electrode in &mut drawn.electrodes {
            let step = [standard_normal(&mut places), standard_normal(&mut places), standard_normal(&mut places)];
            if self.displacement_rms_m > 0.0 {
                if electrode.shape == ElectrodeShape::Group {
                    return Err(TwinError::GroupsStay.into());
                }
                electrode.centre_m = displaced(&design.body, electrode, step.map(|s| s * self.displacement_rms_m));
            }
            electrode.contact_impedance *= log_normal(self.contact_impedance_rms, standard_normal(&mut contacts));
        }
        drawn.check()?;
        Ok(drawn)
    }
}

/// The position of an electrode after a step whose components each have the given root mean square, m.
fn displaced(body: &Body, electrode: &Electrode, step_m: [f64; 3]) -> Point3 {
    // The distance has two components; along a rim only one.
    let [x, y, z] = electrode.centre_m;
    let half = step_m.map(|s| s * 0.5f64.sqrt());
    let chart = unrolled(&body.surface());
    match *body {
        Body::Cylinder { length_m, .. } if z == 0.0 || z == length_m => chart.walk([x, y, z], [step_m[0], 0.0]),
        Body::Cylinder { length_m, .. } => {
            let [x, y, z] = chart.walk([x, y, z], [half[0], half[1]]);
            [x, y, z.clamp(0.0, length_m)]
        }
        Body::Disk { diameter_m } => {
            let (radius_m, from_centre_m) = (0.5 * diameter_m, hypot(x, y));
            let on_rim = (from_centre_m - radius_m).abs() <= 1e-9 * diameter_m;
            if on_rim {
                let (sine, cosine) = sin_cos(atan2(y, x) + step_m[0] / radius_m);
                return [radius_m * cosine, radius_m * sine, 0.0];
            }
            let (x, y) = (x + half[0], y + half[1]);
            let back = (radius_m / hypot(x, y)).min(1.0);
            [x * back, y * back, 0.0]
        }
        Body::Rectangle { width_m, height_m } => {
            let edge = |p: f64, size: f64| p == 0.0 || p == size;
            let (on_x, on_y) = (edge(x, width_m), edge(y, height_m));
            let [dx, dy] = match (on_x, on_y) {
                (true, true) => [0.0, 0.0],
                (true, false) => [0.0, step_m[0]],
                (false, true) => [step_m[0], 0.0],
                (false, false) => [half[0], half[1]],
            };
            [(x + dx).clamp(0.0, width_m), (y + dy).clamp(0.0, height_m), 0.0]
        }
        // Moved back onto the body when its mesh is generated, which removes the component across it.
        Body::Mesh { .. } => [x + half[0], y + half[1], z + half[2]],
    }
}

/// The change of a skin's conductance and contacts with time.
///
/// The coating, the fabric and the mean contact change together, which divides the transfer impedance by one factor;
/// the additional change of a contact is in series with its electrode.
#[derive(Debug, Clone)]
pub(super) struct Drift {
    options: Option<DriftOptions>,
    temperature: Option<TemperatureOptions>,
    conductance: f64,
    /// Amplitude of each contact times its resistance, ohm.
    contact_ohm: Vec<f64>,
}

impl Drift {
    /// The drift of a skin with the given contact resistances, ohm.
    pub(super) fn draw(
        options: Option<DriftOptions>,
        temperature: Option<TemperatureOptions>,
        contacts_ohm: &[f64],
        seed: u64,
    ) -> Self {
        let mut rng = sample_rng(seed, DRIFT_STREAM);
        let (coat_rms, contact_rms) = options.map_or((0.0, 0.0), |drift| (drift.conductance_rms, drift.contact_rms));
        let conductance = coat_rms * standard_normal(&mut rng);
        let contact_ohm = contacts_ohm.iter().map(|ohm| ohm * contact_rms * standard_normal(&mut rng)).collect();
        Drift { options, temperature, conductance, contact_ohm }
    }

    /// The network at a time.
    pub(super) fn at(&self, network: ElectrodeNetwork, time_s: f64) -> Result<ElectrodeNetwork, ForwardError> {
        if self.options.is_none() && self.temperature.is_none() {
            return Ok(network);
        }
        let grown = self.options.map_or(0.0, |drift| -exp_m1(-time_s / drift.time_constant_s));
        let warmth = self.temperature.map_or(0.0, |t| t.coefficient_per_k * (t.change_k + t.rate_k_per_s * time_s));
        // A linear law can become negative; a conductance cannot.
        let factor = ((1.0 + self.conductance * grown) * (1.0 + warmth)).max(1e-3);
        let series: Vec<f64> = self.contact_ohm.iter().map(|ohm| ohm * grown).collect();
        network.scaled(factor).with_series(&series)
    }
}

impl DriftOptions {
    pub(super) fn check(&self) -> Result<(), TwinError> {
        share("drift.conductance_rms", self.conductance_rms)?;
        share("drift.contact_rms", self.contact_rms)?;
        positive("drift.time_constant_s", self.time_constant_s)
    }
}

impl TemperatureOptions {
    pub(super) fn check(&self) -> Result<(), TwinError> {
        for (field, value) in [
            ("temperature.coefficient_per_k", self.coefficient_per_k),
            ("temperature.change_k", self.change_k),
            ("temperature.rate_k_per_s", self.rate_k_per_s),
        ] {
            if !value.is_finite() {
                return Err(out_of_range(field, value, "finite".into(), "leave the table [temperature] out"));
            }
        }
        if (self.coefficient_per_k * self.change_k).abs() >= 0.5 {
            let must = format!("less than {} for a change of half the conductance", 0.5 / self.coefficient_per_k.abs());
            let fix = "a linear coefficient holds for small changes alone";
            return Err(out_of_range("temperature.change_k", self.change_k, must, fix));
        }
        Ok(())
    }
}

/// A relative standard deviation.
fn share(field: &'static str, value: f64) -> Result<(), TwinError> {
    if (0.0..=1.0).contains(&value) {
        return Ok(());
    }
    Err(out_of_range(field, value, "0 to 1".into(), "a share, not per cent: 10 % is 0.10"))
}
