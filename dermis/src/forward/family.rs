//! The models of one skin with other resistances, as a fit needs them.

use super::arc_ends::ArcEnds;
use super::{ForwardModel, near_field, rest_conductivity};
use crate::design::SkinDesign;
use crate::linalg::Matrix;
use crate::mesh::Mesh;

/// The models of designs that differ in the conductance of the sheet and in the contact impedances alone, on one mesh.
/// Each is that of [`ForwardModel::new`]; the setup is shared.
#[derive(Debug)]
pub(crate) struct ModelFamily {
    model: ForwardModel,
    ends: Option<ArcEnds>,
}

impl ModelFamily {
    /// The models of a design.
    ///
    /// # Errors
    /// As [`ForwardModel::new`].
    pub(crate) fn new(design: &SkinDesign, mesh: &Mesh) -> crate::Result<Self> {
        mesh.check_fits(design)?;
        let rest = rest_conductivity(design, mesh);
        let model = ForwardModel::from_parts(mesh, &contact_impedances(design), &design.protocol, &rest)?;
        Ok(ModelFamily { ends: ModelFamily::ends(design, &model)?, model })
    }

    /// The correction at the ends of arcs, if the design asks for it and has arcs.
    pub(super) fn ends(design: &SkinDesign, model: &ForwardModel) -> crate::Result<Option<ArcEnds>> {
        if design.mesh.correct_arc_ends { ArcEnds::new(model) } else { Ok(None) }
    }

    /// The model of a design.
    ///
    /// # Errors
    /// Resistances that are not positive.
    pub(crate) fn model(&self, design: &SkinDesign) -> crate::Result<ForwardModel> {
        let mesh = self.model.mesh();
        let rest = rest_conductivity(design, mesh);
        let model = self.model.with_parameters(&mesh.nodes, &contact_impedances(design), &rest)?;
        let series = near_field::series_resistances(design, mesh, &rest)?;
        let transform = self.ends.as_ref().map(|ends| ends.transform(&model)).transpose()?;
        Ok(model.with_series_resistances(&series)?.with_transform(transform))
    }

    /// The derivatives of the untouched frame of a model of this family by the contact impedances, with the correction at
    /// the ends of arcs: channels x electrodes, in ohm per ohm m (on surfaces) or ohm m^2 (in solids).
    ///
    /// # Errors
    /// A forward problem without a solution.
    pub(crate) fn contact_jacobian(&self, model: &ForwardModel) -> crate::Result<Matrix> {
        match &self.ends {
            Some(ends) => ends.contact_jacobian(model),
            None => Ok(model.contact_jacobian(model.rest_conductivity())?),
        }
    }
}

fn contact_impedances(design: &SkinDesign) -> Vec<f64> {
    design.electrodes.iter().map(|electrode| electrode.contact_impedance).collect()
}
