//! The forward model of one skin on one mesh.

use super::arc_ends::Transform;
use super::assembly::Assembly;
use super::{ElectrodeNetwork, ForwardError, ModelFamily};
use crate::design::SkinDesign;
use crate::frame::Frame;
use crate::geom::Point3;
use crate::linalg::{Factor, Matrix, NotPositiveDefinite, Symbolic, Workspace};
use crate::mesh::{ElectrodePatch, Mesh};
use crate::protocol::Protocol;
use std::sync::Arc;

/// The forward model of one skin on one mesh, with all data that do not depend on the conductivity.
///
/// Cheap to clone.
#[derive(Debug, Clone)]
pub struct ForwardModel {
    shared: Arc<Shared>,
    series_resistances: Vec<f64>,
    /// Between the electrodes and the mesh: the correction at the ends of arcs.
    transform: Option<Arc<Transform>>,
}

#[derive(Debug)]
struct Shared {
    mesh: Mesh,
    protocol: Protocol,
    contact_impedances: Vec<f64>,
    rest_conductivity: Vec<f64>,
    assembly: Assembly,
    symbolic: Arc<Symbolic>,
}

/// Work memory for repeated solves of one model.
#[derive(Debug, Clone)]
pub struct Solver {
    model: ForwardModel,
    entry_values: Vec<f64>,
    factor: Factor,
    workspace: Workspace,
}

impl ForwardModel {
    /// The model of a design on its mesh.
    ///
    /// # Errors
    /// A mesh without the electrodes or regions of the design, or on which no forward problem can be solved.
    pub fn new(design: &SkinDesign, mesh: &Mesh) -> crate::Result<Self> {
        Self::with_coat(design, mesh, &rest_conductivity(design, mesh))
    }

    /// The model of a design with a non-uniform coating: `rest_conductivity` has a value per cell (S on surfaces, S/m
    /// in volumes), for example [`rest_conductivity`] times a random field.
    ///
    /// # Errors
    /// As [`new`](Self::new); conductivities of the wrong number or not positive.
    pub fn with_coat(design: &SkinDesign, mesh: &Mesh, rest_conductivity: &[f64]) -> crate::Result<Self> {
        mesh.check_fits(design)?;
        let model = Self::from_parts(mesh, &design.contact_impedances(), &design.protocol, rest_conductivity)?;
        let ends = ModelFamily::ends(design, &model)?;
        ModelFamily::corrected(model, design, ends.as_ref())
    }

    /// The model with another correction at the ends of arcs.
    pub(super) fn with_transform(self, transform: Option<Transform>) -> Self {
        ForwardModel { transform: transform.map(Arc::new), ..self }
    }

    /// The same model with a resistance in series with each electrode, ohm.
    ///
    /// [`new`](Self::new) sets the correction of the mesh near each electrode; add a resistance of the wiring to
    /// [`series_resistances`](Self::series_resistances).
    ///
    /// # Errors
    /// A list of the wrong length; a value that is not finite.
    pub fn with_series_resistances(mut self, resistances: &[f64]) -> Result<Self, ForwardError> {
        check_count("series resistances", resistances.len(), self.mesh().electrodes.len())?;
        if let Some(electrode) = resistances.iter().position(|value| !value.is_finite()) {
            return Err(ForwardError::SeriesResistance { electrode, value: resistances[electrode] });
        }
        self.series_resistances = resistances.to_vec();
        Ok(self)
    }

    /// The resistance in series with each electrode, ohm.
    pub fn series_resistances(&self) -> &[f64] {
        &self.series_resistances
    }

    /// The model of a mesh without a design. `contact_impedances` has one value per electrode (ohm m2 on cells and
    /// faces, ohm m on edges, unused on nodes), `rest_conductivity` one per cell (S on surfaces, S/m in volumes).
    ///
    /// # Errors
    /// Lists of the wrong length, values that are not positive, two point electrodes on one node.
    pub fn from_parts(
        mesh: &Mesh,
        contact_impedances: &[f64],
        protocol: &Protocol,
        rest_conductivity: &[f64],
    ) -> crate::Result<Self> {
        check_count("contact impedances", contact_impedances.len(), mesh.electrodes.len())?;
        check_count("electrodes of the mesh", mesh.electrodes.len(), protocol.electrode_count())?;
        check_contact_impedances(mesh, contact_impedances)?;
        check_conductivity(mesh, rest_conductivity)?;
        let assembly = Assembly::new(mesh, contact_impedances)?;
        let pattern = &assembly.pattern;
        let symbolic = Symbolic::new(pattern.unknown_count, mesh.electrodes.len(), &pattern.entries);
        Ok(ForwardModel {
            series_resistances: vec![0.0; mesh.electrodes.len()],
            transform: None,
            shared: Arc::new(Shared {
                mesh: mesh.clone(),
                protocol: protocol.clone(),
                contact_impedances: contact_impedances.to_vec(),
                rest_conductivity: rest_conductivity.to_vec(),
                assembly,
                symbolic: Arc::new(symbolic),
            }),
        })
    }

    /// Another instance of the same skin: other node positions, contact impedances and coating (S per cell on surfaces,
    /// S/m in volumes). The nodes of the cells and electrodes stay the same, so the expensive setup is reused.
    ///
    /// The series resistances are scaled with the inverse of the conductance of the electrode's own cells, like a near
    /// field. The correction at the ends of arcs is kept.
    ///
    /// # Errors
    /// Lists of the wrong length, values that are not positive; nodes that are not finite, cells without an extent.
    pub fn with_parameters(
        &self,
        nodes_m: &[Point3],
        contact_impedances: &[f64],
        rest_conductivity: &[f64],
    ) -> Result<Self, ForwardError> {
        check_count("nodes", nodes_m.len(), self.mesh().node_count())?;
        check_count("contact impedances", contact_impedances.len(), self.mesh().electrodes.len())?;
        let Mesh { cells, electrodes, regions, .. } = self.mesh();
        let (cells, electrodes, regions) = (cells.clone(), electrodes.clone(), regions.clone());
        let mesh = Mesh { nodes: nodes_m.to_vec(), cells, electrodes, regions };
        check_nodes(&mesh)?;
        check_contact_impedances(&mesh, contact_impedances)?;
        check_conductivity(&mesh, rest_conductivity)?;
        let assembly = self.assembly().moved(self.mesh(), &mesh, contact_impedances);
        let mean = |values: &[f64], cells: &[usize]| cells.iter().map(|&cell| values[cell]).sum::<f64>();
        let series = |(resistance, patch): (&f64, &ElectrodePatch)| match patch {
            ElectrodePatch::Cells(cells) => {
                resistance * mean(self.rest_conductivity(), cells) / mean(rest_conductivity, cells)
            }
            _ => *resistance,
        };
        Ok(ForwardModel {
            series_resistances: self.series_resistances.iter().zip(&mesh.electrodes).map(series).collect(),
            transform: self.transform().map(|transform| Arc::new(transform.with_contacts(contact_impedances))),
            shared: Arc::new(Shared {
                protocol: self.protocol().clone(),
                contact_impedances: contact_impedances.to_vec(),
                rest_conductivity: rest_conductivity.to_vec(),
                assembly,
                symbolic: self.shared.symbolic.clone(),
                mesh,
            }),
        })
    }

    /// The correction at the ends of arcs.
    pub(super) fn transform(&self) -> Option<&Transform> {
        self.transform.as_deref()
    }

    /// Whether both are instances of one skin on one mesh.
    pub(super) fn has_pattern_of(&self, other: &ForwardModel) -> bool {
        Arc::ptr_eq(&self.assembly().pattern, &other.assembly().pattern)
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.shared.mesh
    }

    /// The order of a frame's values.
    pub fn protocol(&self) -> &Protocol {
        &self.shared.protocol
    }

    /// The contact impedance of each electrode.
    pub fn contact_impedances(&self) -> &[f64] {
        &self.shared.contact_impedances
    }

    /// The contact resistance of an electrode, ohm: its contact impedance over its size (m2, or m of an arc). 0 for a
    /// point electrode, which has no contact impedance in the model.
    pub fn contact_resistance_ohm(&self, electrode: usize) -> f64 {
        match self.mesh().electrode_size(electrode) {
            size if size > 0.0 => self.contact_impedances()[electrode] / size,
            _ => 0.0,
        }
    }

    /// Conductivity of the untouched skin, a value per cell.
    pub fn rest_conductivity(&self) -> &[f64] {
        &self.shared.rest_conductivity
    }

    /// The symbolic factorisation of the system, electrodes last.
    pub fn symbolic(&self) -> &Symbolic {
        &self.shared.symbolic
    }

    pub(super) fn assembly(&self) -> &Assembly {
        &self.shared.assembly
    }

    /// The unknown of each node in the system.
    pub(super) fn unknown_of_node(&self) -> &[usize] {
        &self.shared.assembly.pattern.unknown_of_node
    }

    /// The network of the mesh with the model's corrections: at the ends of arcs, and series resistances.
    pub(super) fn with_own_series(&self, bare: ElectrodeNetwork) -> Result<ElectrodeNetwork, ForwardError> {
        let network = match &self.transform {
            None => bare,
            Some(transform) => bare.transformed(transform)?,
        };
        match self.series_resistances.iter().all(|&resistance| resistance == 0.0) {
            true => Ok(network),
            false => network.with_series(&self.series_resistances),
        }
    }

    /// Work memory for repeated solves.
    pub fn solver(&self) -> Solver {
        Solver {
            entry_values: vec![0.0; self.shared.symbolic.entry_count()],
            factor: self.shared.symbolic.empty_factor(),
            workspace: self.shared.symbolic.workspace(),
            model: self.clone(),
        }
    }

    /// The frame of a skin with the given conductivity per cell, ohm.
    ///
    /// # Errors
    /// A conductivity of the wrong length, or one that is not positive and finite.
    pub fn solve(&self, conductivity: &[f64]) -> Result<Frame, ForwardError> {
        Ok(self.network(conductivity)?.frame(self.protocol()))
    }

    /// The network between the electrodes at a conductivity per cell.
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    pub fn network(&self, conductivity: &[f64]) -> Result<ElectrodeNetwork, ForwardError> {
        self.solver().network(conductivity)
    }

    /// The potentials of all nodes, nodes x electrodes, V: column `k` is for 1 A that enters at electrode `k` and
    /// leaves through all electrodes in equal parts. The difference of two columns is the field of a drive.
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    pub fn potentials(&self, conductivity: &[f64]) -> Result<Matrix, ForwardError> {
        self.solver().potentials(conductivity)
    }
}

impl Solver {
    /// The model in use.
    pub fn model(&self) -> &ForwardModel {
        &self.model
    }

    /// Continues with another instance of the same skin, from [`ForwardModel::with_parameters`].
    ///
    /// # Panics
    /// If the model is of another mesh.
    pub fn set_model(&mut self, model: &ForwardModel) {
        assert!(self.model.has_pattern_of(model), "a model of another mesh");
        self.model = model.clone();
    }

    /// The frame of a skin with the given conductivity per cell, written to the caller's memory, ohm.
    ///
    /// # Errors
    /// A conductivity of the wrong length, or one that is not positive and finite.
    ///
    /// # Panics
    /// If the length of `values` differs from the protocol.
    pub fn solve_into(&mut self, conductivity: &[f64], values: &mut [f64]) -> Result<(), ForwardError> {
        assert_eq!(values.len(), self.model.protocol().channel_count(), "a value per channel");
        let network = self.network(conductivity)?;
        network.frame_into(self.model.protocol(), values);
        Ok(())
    }

    /// The network between the electrodes at a conductivity per cell.
    ///
    /// # Errors
    /// As [`solve_into`](Self::solve_into).
    pub fn network(&mut self, conductivity: &[f64]) -> Result<ElectrodeNetwork, ForwardError> {
        let bare = self.bare_network(conductivity)?;
        self.model.with_own_series(bare)
    }

    /// The network of the mesh, without series resistances.
    fn bare_network(&mut self, conductivity: &[f64]) -> Result<ElectrodeNetwork, ForwardError> {
        let shared = &self.model.shared;
        check_conductivity(&shared.mesh, conductivity)?;
        shared.assembly.values_into(conductivity, &mut self.entry_values);
        shared
            .symbolic
            .factor_into(&self.entry_values, &mut self.factor, &mut self.workspace)
            .map_err(|error| self.name_singular(error))?;
        ElectrodeNetwork::new(self.factor.schur().clone())
    }

    /// [`ForwardModel::potentials`] with this work memory.
    ///
    /// # Errors
    /// As [`solve_into`](Self::solve_into).
    pub fn potentials(&mut self, conductivity: &[f64]) -> Result<Matrix, ForwardError> {
        Ok(self.fields(conductivity)?.0)
    }

    /// The potentials of all nodes and of all electrodes on the mesh, without the series resistances; columns as in
    /// [`potentials`](Self::potentials).
    pub(super) fn fields(&mut self, conductivity: &[f64]) -> Result<(Matrix, Matrix), ForwardError> {
        let network = self.bare_network(conductivity)?;
        let shared = &self.model.shared;
        let electrode_count = shared.mesh.electrodes.len();
        let mut unknowns = Matrix::zeros(shared.assembly.pattern.unknown_count, electrode_count);
        let interior = (shared.assembly.pattern.unknown_count - electrode_count) * electrode_count;
        unknowns.values[interior..].copy_from_slice(&network.transfer_impedance.values);
        self.factor.extend_homogeneous(&shared.symbolic, &mut unknowns);
        let mut potentials = Matrix::zeros(shared.mesh.node_count(), electrode_count);
        for (node, &unknown) in self.model.unknown_of_node().iter().enumerate() {
            potentials.row_mut(node).copy_from_slice(unknowns.row(unknown));
        }
        match self.model.transform() {
            None => Ok((potentials, network.transfer_impedance)),
            Some(transform) => {
                let currents = transform.matrix.transposed();
                Ok((potentials.times(&currents), network.transfer_impedance.times(&currents)))
            }
        }
    }

    fn name_singular(&self, error: NotPositiveDefinite) -> ForwardError {
        let node = self.model.unknown_of_node().iter().position(|&unknown| unknown == error.unknown);
        ForwardError::Singular { place: node.map_or("an electrode".into(), |node| format!("node {node}")) }
    }
}

/// The untouched conductance of each cell in the design: that of the region that contains its centre, or that of the
/// sheet (S on surfaces, S/m in volumes).
pub fn rest_conductivity(design: &SkinDesign, mesh: &Mesh) -> Vec<f64> {
    let mut values = vec![design.sheet.conductance; mesh.cell_count()];
    for region in &design.sheet.regions {
        mesh.cells_of(design, region).into_iter().for_each(|cell| values[cell] = region.conductance);
    }
    values
}

pub(super) fn check_count(what: &'static str, got: usize, expected: usize) -> Result<(), ForwardError> {
    if got == expected { Ok(()) } else { Err(ForwardError::Count { what, got, expected }) }
}

/// Refuses nodes that are not finite, and cells without an extent.
fn check_nodes(mesh: &Mesh) -> Result<(), ForwardError> {
    if let Some(node) = mesh.nodes.iter().position(|node| node.iter().any(|value| !value.is_finite())) {
        return Err(ForwardError::Node { node });
    }
    match (0..mesh.cell_count()).find(|&cell| mesh.cell_measure(cell) <= 0.0) {
        Some(cell) => Err(ForwardError::Cell { cell }),
        None => Ok(()),
    }
}

pub(super) fn check_conductivity(mesh: &Mesh, conductivity: &[f64]) -> Result<(), ForwardError> {
    check_count("conductivities", conductivity.len(), mesh.cell_count())?;
    match conductivity.iter().position(|value| !(value.is_finite() && *value > 0.0)) {
        Some(cell) => Err(ForwardError::Conductivity { cell, value: conductivity[cell] }),
        None => Ok(()),
    }
}

fn check_contact_impedances(mesh: &Mesh, contact_impedances: &[f64]) -> Result<(), ForwardError> {
    let bad = |(electrode, value): (usize, &f64)| {
        let is_point = matches!(mesh.electrodes[electrode], ElectrodePatch::Node(_));
        !(is_point || value.is_finite() && *value > 0.0)
    };
    match contact_impedances.iter().enumerate().position(bad) {
        Some(electrode) => Err(ForwardError::ContactImpedance { electrode, value: contact_impedances[electrode] }),
        None => Ok(()),
    }
}
