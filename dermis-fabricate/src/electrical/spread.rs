//! How much readings differ from skin to skin, to first order in what differs.
//!
//! Independent of each other are: the sheet resistance (one factor for the whole coat, with the relative standard
//! deviation `sheet_spread`), the contact impedance of each electrode (`contact_spread`), the reference resistor (evenly
//! distributed within its tolerance), and the resistance of each closed switch. A coat that is uneven is not in it.

use crate::electrical::model::protocol_of;
use crate::error::FabricateError;
use dermis::design::{FabricationOptions, SkinDesign};
use dermis::forward::ForwardModel;
use dermis::mesh::Mesh;
use dermis::protocol::Channel;
use dermis_sim::twin::electronics::ElectronicsOptions;

/// A value and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value {
    /// That of the design.
    pub nominal: f64,
    /// Its standard deviation from skin to skin.
    pub sd: f64,
    /// Whether the instrument loses its sign.
    pub amplitude_only: bool,
}

impl Value {
    /// Standard deviations from the design's value to the limits.
    pub(crate) const LIMIT: f64 = 3.0;

    fn new(nominal: f64, variance: f64) -> Self {
        Value { nominal, sd: variance.sqrt(), amplitude_only: false }
    }

    pub(super) fn without_sign(self) -> Self {
        Value { nominal: self.nominal.abs(), amplitude_only: true, ..self }
    }

    /// Least and greatest value to be expected.
    pub(crate) fn limits(&self) -> [f64; 2] {
        let off = Self::LIMIT * self.sd;
        [self.nominal - off, self.nominal + off].map(|limit| if self.amplitude_only { limit.max(0.0) } else { limit })
    }
}

/// A transfer resistance, and its derivatives by the logarithms of the resistances of the skin. All in ohm.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensitivities {
    /// The transfer resistance.
    pub(crate) ohm: f64,
    /// By the logarithm of the sheet resistance.
    pub(crate) by_sheet: f64,
    /// By the logarithm of the contact impedance of each electrode.
    pub(crate) by_contacts: Vec<f64>,
}

/// A drive's current through the source, the reference resistor, two switches and the skin.
#[derive(Debug, Clone)]
pub struct Loop {
    /// The skin between the driven electrodes.
    skin: Sensitivities,
    source_v: f64,
    reference_ohm: f64,
    loop_ohm: f64,
    switch_sd_ohm: f64,
}

impl Sensitivities {
    /// Those of some channels of a design.
    ///
    /// A transfer resistance is homogeneous of degree one in all resistances of the skin: its derivative by the sheet
    /// resistance is what those by the contact impedances leave (Euler's theorem).
    ///
    /// # Errors
    /// A design without a solution.
    pub(crate) fn of(design: &SkinDesign, mesh: &Mesh, channels: Vec<Channel>) -> Result<Vec<Self>, FabricateError> {
        let asked = SkinDesign { protocol: protocol_of(design, channels), ..design.clone() };
        let model = ForwardModel::new(&asked, mesh)?;
        let at = model.rest_conductivity();
        let frame = model.solve(at).map_err(dermis::Error::from)?;
        let jacobian = model.contact_jacobian(at).map_err(dermis::Error::from)?;
        let of = |(channel, &ohm): (usize, &f64)| {
            let impedances = model.contact_impedances().iter();
            let by_contacts: Vec<f64> =
                impedances.zip(jacobian.row(channel)).map(|(impedance, slope)| impedance * slope).collect();
            Sensitivities { ohm, by_sheet: ohm - by_contacts.iter().sum::<f64>(), by_contacts }
        };
        Ok(frame.0.iter().enumerate().map(of).collect())
    }

    /// The value that an instrument gives: the voltage over the current that it finds with the stated reference resistor.
    pub(crate) fn ohm(&self, options: &FabricationOptions, tolerance: f64) -> Value {
        let skin = self.variance(options);
        Value::new(self.ohm, skin + (self.ohm * uniform_sd(tolerance)).powi(2))
    }

    fn variance(&self, options: &FabricationOptions) -> f64 {
        let contacts: f64 = self.by_contacts.iter().map(|slope| slope * slope).sum();
        (self.by_sheet * options.sheet_spread).powi(2) + contacts * options.contact_spread.powi(2)
    }

    /// The circuit of this resistance between the driven electrodes.
    pub(crate) fn in_loop(&self, electronics: &ElectronicsOptions) -> Loop {
        Loop {
            loop_ohm: electronics.reference_ohm + 2.0 * electronics.on_resistance_ohm + self.ohm,
            skin: self.clone(),
            source_v: electronics.source_v,
            reference_ohm: electronics.reference_ohm,
            switch_sd_ohm: electronics.on_resistance_spread_ohm,
        }
    }
}

impl Loop {
    /// The voltage across a part of the circuit whose resistance is `part`: `v = part I`, `dv = I dpart - v dloop / loop`.
    fn value(
        &self,
        part: &Sensitivities,
        part_by_reference: f64,
        options: &FabricationOptions,
        tolerance: f64,
    ) -> Value {
        let current_a = self.source_v / self.loop_ohm;
        let volt = part.ohm * current_a;
        let slope = |part: f64, of_loop: f64| current_a * part - volt * of_loop / self.loop_ohm;
        let contacts = part.by_contacts.iter().zip(&self.skin.by_contacts);
        let moved = Sensitivities {
            ohm: volt,
            by_sheet: slope(part.by_sheet, self.skin.by_sheet),
            by_contacts: contacts.map(|(&own, &of_loop)| slope(own, of_loop)).collect(),
        };
        let reference = slope(part_by_reference, self.reference_ohm) * uniform_sd(tolerance);
        // Two switches.
        let switches = 2.0 * (slope(0.0, 1.0) * self.switch_sd_ohm).powi(2);
        Value::new(volt, moved.variance(options) + reference.powi(2) + switches)
    }

    /// The voltage of a transfer resistance, V.
    pub(crate) fn voltage(&self, of: &Sensitivities, options: &FabricationOptions, tolerance: f64) -> Value {
        self.value(of, 0.0, options, tolerance)
    }

    /// The voltage across the reference resistor, V.
    pub(crate) fn reference(&self, options: &FabricationOptions, tolerance: f64) -> Value {
        let none = vec![0.0; self.skin.by_contacts.len()];
        let part = Sensitivities { ohm: self.reference_ohm, by_sheet: 0.0, by_contacts: none };
        self.value(&part, self.reference_ohm, options, tolerance)
    }
}

/// Standard deviation of an even distribution within a tolerance.
fn uniform_sd(tolerance: f64) -> f64 {
    tolerance / 3f64.sqrt()
}

#[cfg(test)]
mod tests;
