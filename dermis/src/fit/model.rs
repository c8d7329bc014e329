//! The untouched frame as a function of the unknowns, and its derivatives.

use crate::design::{ElectrodeShape, SkinDesign};
use crate::fit::{Contacts, Quantity, UNDETERMINED_SD, UNREAD_SD};
use crate::forward::{ForwardModel, Matrix, ModelFamily};
use crate::mesh::Mesh;
use std::sync::Arc;

/// Step of the logarithm in the difference quotients of the series resistances.
const STEP: f64 = 1e-4;

/// A design whose resistances are multiplied by `exp` of the unknowns: the first belongs to the sheet, the others to
/// the contact impedances.
pub(super) struct Model<'a> {
    design: &'a SkinDesign,
    family: Arc<ModelFamily>,
    contacts: Contacts,
    /// The electrodes with a contact impedance.
    electrodes: Vec<usize>,
}

impl<'a> Model<'a> {
    pub(super) fn new(design: &'a SkinDesign, mesh: &Mesh, contacts: Contacts) -> crate::Result<Self> {
        let has_contact = |&electrode: &usize| design.electrodes[electrode].shape != ElectrodeShape::Point;
        let has_contact = |electrode: &usize| has_contact(electrode) && mesh.electrode_size(*electrode) > 0.0;
        let electrodes = (0..design.electrodes.len()).filter(has_contact).collect();
        Ok(Model { design, family: Arc::new(ModelFamily::new(design, mesh)?), contacts, electrodes })
    }

    /// The same model with one factor for all contact impedances.
    pub(super) fn with_common(&self) -> Model<'a> {
        Model { contacts: Contacts::Common, electrodes: self.electrodes.clone(), family: self.family.clone(), ..*self }
    }

    /// The largest standard deviation at which each unknown counts as determined by some channels.
    pub(super) fn limits(&self, channels: &[usize]) -> Vec<f64> {
        let mut limits = vec![UNREAD_SD; self.unknowns()];
        // The resistance of the sheet always counts.
        limits[0] = f64::INFINITY;
        for &electrode in &self.electrodes {
            let gains: Vec<f64> = self.design.protocol.contact_gains(electrode).collect();
            let is_read = channels.iter().any(|&channel| gains[channel] != 0.0);
            if let (true, Some(unknown)) = (is_read, self.unknown_of(electrode)) {
                limits[unknown] = UNDETERMINED_SD;
            }
        }
        limits
    }

    pub(super) fn contacts(&self) -> Contacts {
        self.contacts
    }

    /// Number of unknowns.
    pub(super) fn unknowns(&self) -> usize {
        1 + match self.contacts {
            Contacts::Common => self.electrodes.len().min(1),
            Contacts::Each => self.electrodes.len(),
            Contacts::Kept => 0,
        }
    }

    /// The unknown that belongs to an electrode, if it has one.
    fn unknown_of(&self, electrode: usize) -> Option<usize> {
        let index = self.electrodes.binary_search(&electrode).ok()?;
        match self.contacts {
            Contacts::Common => Some(1),
            Contacts::Each => Some(1 + index),
            Contacts::Kept => None,
        }
    }

    /// The quantities with their values in the design.
    pub(super) fn quantities(&self) -> Vec<(Quantity, f64)> {
        let impedance = |electrode: &usize| self.design.electrodes[*electrode].contact_impedance;
        let mean = self.electrodes.iter().map(impedance).sum::<f64>() / self.electrodes.len() as f64;
        let mut list = vec![(Quantity::Resistance, 1.0 / self.design.sheet.conductance)];
        match self.contacts {
            Contacts::Common if !self.electrodes.is_empty() => list.push((Quantity::CommonContact, mean)),
            Contacts::Each => list.extend(self.electrodes.iter().map(|e| (Quantity::Contact(*e), impedance(e)))),
            Contacts::Common | Contacts::Kept => {}
        }
        list
    }

    /// The design at some unknowns.
    pub(super) fn design_at(&self, unknowns: &[f64]) -> SkinDesign {
        let mut design = self.design.clone();
        let conductance = (-unknowns[0]).exp();
        design.sheet.conductance *= conductance;
        design.sheet.regions.iter_mut().for_each(|region| region.conductance *= conductance);
        for (electrode, values) in design.electrodes.iter_mut().enumerate() {
            if let Some(unknown) = self.unknown_of(electrode) {
                values.contact_impedance *= unknowns[unknown].exp();
            }
        }
        design
    }

    /// The untouched frame at some unknowns.
    pub(super) fn frame(&self, unknowns: &[f64]) -> crate::Result<Vec<f64>> {
        let model = self.family.model(&self.design_at(unknowns))?;
        let mut frame = model.solve(model.rest_conductivity())?.0;
        self.design.protocol.drop_signs(&mut frame);
        Ok(frame)
    }

    /// The derivative of the untouched frame at some unknowns, channels x unknowns.
    ///
    /// A frame is homogeneous of degree one in the resistances of the sheet and the contacts together, so by Euler's
    /// theorem its derivative by the logarithm of the former is the frame less its derivatives by those of the latter.
    pub(super) fn derivatives(&self, unknowns: &[f64]) -> crate::Result<Matrix> {
        let design = self.design_at(unknowns);
        let model = self.family.model(&design)?;
        let frame = model.solve(model.rest_conductivity())?.0;
        let contacts = self.family.contact_jacobian(&model)?;
        let series_ohm = self.series_derivatives(&design, &model)?;
        let mut jacobian = Matrix::zeros(frame.len(), self.unknowns());
        for (channel, value) in frame.iter().enumerate() {
            jacobian.row_mut(channel)[0] = *value;
        }
        for &electrode in &self.electrodes {
            let impedance = design.electrodes[electrode].contact_impedance;
            for (channel, gain) in design.protocol.contact_gains(electrode).enumerate() {
                let change = impedance * contacts.at(channel, electrode) + gain * series_ohm[electrode];
                let row = jacobian.row_mut(channel);
                row[0] -= change;
                if let Some(unknown) = self.unknown_of(electrode) {
                    row[unknown] += change;
                }
            }
        }
        if design.protocol.amplitude_only() {
            drop_signs(&frame, &mut jacobian);
        }
        Ok(jacobian)
    }

    /// The derivative of each series resistance by the logarithm of the contact impedances, ohm.
    fn series_derivatives(&self, design: &SkinDesign, model: &ForwardModel) -> crate::Result<Vec<f64>> {
        let series = model.series_resistances();
        if series.iter().all(|&resistance| resistance == 0.0) {
            return Ok(series.to_vec());
        }
        let mut other = design.clone();
        other.electrodes.iter_mut().for_each(|electrode| electrode.contact_impedance *= STEP.exp());
        let other = self.family.model(&other)?;
        Ok(other.series_resistances().iter().zip(series).map(|(above, value)| (above - value) / STEP).collect())
    }
}

/// The derivatives of the amplitudes of a frame: `d|V| = sign(V) dV`.
fn drop_signs(frame: &[f64], jacobian: &mut Matrix) {
    for (channel, _) in frame.iter().enumerate().filter(|(_, value)| **value < 0.0) {
        jacobian.row_mut(channel).iter_mut().for_each(|entry| *entry = -*entry);
    }
}
