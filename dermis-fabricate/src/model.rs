//! What is to be made: the one model from which every output is written.

use crate::body::BodyMesh;
use crate::electrical::Electrical;
use crate::error::FabricateError;
use crate::outline::Outline;
use crate::patches::{self, Patch};
use crate::solid::{self, Solid};
use dermis::design::{Body, ElectrodeShape, FabricationOptions, SkinDesign, TouchEffect, closest_bores};
use dermis::geom::vector::{centroid, distance};
use dermis::geom::{Chart, Point3};
use dermis::mesh::Mesh;
use std::sync::OnceLock;

/// Thickness of a membrane below a coat, m: a common sheet of rubber, which a finger stretches.
pub(crate) const MEMBRANE_M: f64 = 0.0005;

/// What a workshop makes of a design. Lengths in m, in the frame of the design.
#[derive(Debug, Clone)]
pub struct Fabrication {
    /// The design.
    pub design: SkinDesign,
    /// Sizes of the parts: the design's, or the default.
    pub(crate) options: FabricationOptions,
    /// The electrodes with their bores, in the order of their numbers.
    pub(crate) electrodes: Vec<FabricatedElectrode>,
    /// The surface of a body from a mesh file.
    pub(crate) body_mesh: Option<BodyMesh>,
    /// The chart of the coat, cut open at the seam; `None` for a body from a mesh file.
    pub(crate) chart: Option<Chart>,
    /// The edge of the unrolled coat; `None` for a body from a mesh file.
    pub(crate) coat: Option<Outline>,
    /// The fabric patches.
    pub(crate) patches: Vec<Patch>,
    /// What is made once and used by several outputs.
    base: OnceLock<Solid>,
    electrical: OnceLock<Electrical>,
}

/// An electrode, and the bore below it.
#[derive(Debug, Clone, PartialEq)]
pub struct FabricatedElectrode {
    /// Its number, from 0.
    pub(crate) number: usize,
    /// Its label on drawings and tables: `E0`, `E1`, ...; as many digits as the largest number has.
    pub(crate) label: String,
    /// Its centre on the coat, m.
    pub(crate) centre_m: Point3,
    /// The outward unit normal at its centre.
    pub(crate) normal: Point3,
    /// Its shape.
    pub(crate) shape: ElectrodeShape,
    /// Its bore.
    pub(crate) bore: Bore,
}

/// A round hole through the wall along the normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bore {
    /// The place of its axis on the coat's surface, m.
    pub(crate) centre_m: Point3,
    /// The outward unit normal there: the direction of the axis.
    pub(crate) normal: Point3,
    /// Its diameter, m.
    pub(crate) diameter_m: f64,
    /// Distance from the electrode's centre, m: not 0 where the electrode is too close to the edge of the base.
    pub(crate) moved_m: f64,
}

impl Fabrication {
    /// The parts of a design.
    ///
    /// # Errors
    /// Sizes that cannot be made (see [`SkinDesign::check_fabrication`]); a body file that cannot be read; bores that
    /// meet.
    pub fn new(design: &SkinDesign) -> Result<Self, FabricateError> {
        design.check_fabrication()?;
        let options = design.fabrication_options();
        check_foam(design, &options)?;
        let body_mesh = match &design.body {
            Body::Mesh { file, unit_m } => Some(BodyMesh::load(file, *unit_m)?),
            _ => None,
        };
        let places = match &body_mesh {
            Some(mesh) => on_mesh(design, mesh)?,
            None => on_known_surface(design),
        };
        check_bores(&places, &options)?;
        let digits = design.electrodes.len().saturating_sub(1).to_string().len();
        let electrodes = design.electrodes.iter().zip(places).enumerate();
        let electrodes = electrodes.map(|(number, (electrode, (centre_m, normal, bore)))| FabricatedElectrode {
            number,
            label: format!("E{number:0digits$}"),
            centre_m,
            normal,
            shape: electrode.shape,
            bore,
        });
        let chart = design.body.chart().map(|chart| chart.with_seam(options.seam_theta_rad));
        let coat = chart.as_ref().map(Outline::of_chart);
        Ok(Fabrication {
            design: design.clone(),
            patches: patches::of(&design.body.surface(), chart.as_ref(), body_mesh.as_ref(), &options)?,
            options,
            electrodes: electrodes.collect(),
            body_mesh,
            chart,
            coat,
            base: OnceLock::new(),
            electrical: OnceLock::new(),
        })
    }

    /// Whether the coat lies on a membrane that stretches over foam where it is pressed. Otherwise it lies on the base, below
    /// patches and foam.
    pub(crate) fn has_membrane(&self) -> bool {
        self.design.sheet.touch == TouchEffect::ConductanceFalls
    }

    /// Height of the coat over the outer side of the base, m: that of foam and membrane.
    pub(crate) fn coat_height_m(&self) -> f64 {
        if self.has_membrane() { self.options.foam_thickness_m + MEMBRANE_M } else { 0.0 }
    }

    /// The base; made at the first call.
    ///
    /// # Errors
    /// As [`solid::base`].
    pub(crate) fn base(&self) -> Result<&Solid, FabricateError> {
        made_once(&self.base, || solid::base(self))
    }

    /// The electrical model; made at the first call.
    ///
    /// # Errors
    /// As [`Electrical::new`].
    pub(crate) fn electrical(&self) -> Result<&Electrical, FabricateError> {
        let centres_m = || self.electrodes.iter().map(|one| one.centre_m).collect::<Vec<_>>();
        made_once(&self.electrical, || Electrical::new(&self.design, &centres_m()))
    }
}

fn made_once<T>(cell: &OnceLock<T>, make: impl FnOnce() -> Result<T, FabricateError>) -> Result<&T, FabricateError> {
    match cell.get() {
        Some(made) => Ok(made),
        None => make().map(|made| cell.get_or_init(|| made)),
    }
}

/// Centre, normal and bore of each electrode.
type Places = Vec<(Point3, Point3, Bore)>;

fn on_known_surface(design: &SkinDesign) -> Places {
    let bores = design.bores().expect("only a mesh file has no known surface");
    let surface = design.body.surface();
    let place = |(electrode, (centre_m, normal)): (&dermis::design::Electrode, (Point3, Point3))| {
        let moved_m = distance(electrode.centre_m, centre_m);
        let own = surface.normal(electrode.centre_m).expect("a known surface");
        (electrode.centre_m, own, bore(design, centre_m, normal, moved_m))
    };
    design.electrodes.iter().zip(bores).map(place).collect()
}

/// The electrodes on the surface of a file: their centres are brought onto it, groups are at the mean of their nodes, and
/// bores are moved away from the edges.
fn on_mesh(design: &SkinDesign, mesh: &BodyMesh) -> Result<Places, FabricateError> {
    let grouped = design.electrodes.iter().any(|electrode| electrode.shape == ElectrodeShape::Group);
    let meshed = grouped.then(|| Mesh::generate(design)).transpose()?;
    let edge_m = design.fabrication_options().edge_m();
    let place = |(number, electrode): (usize, &dermis::design::Electrode)| {
        let wanted_m = meshed.as_ref().map_or(electrode.centre_m, |meshed| {
            let nodes: Vec<Point3> =
                meshed.electrode_nodes(number).into_iter().map(|node| meshed.nodes[node]).collect();
            centroid(&nodes)
        });
        let (centre_m, own) = mesh.nearest(wanted_m);
        let (bore_m, normal) = mesh.away_from_edges(centre_m, edge_m).ok_or_else(|| {
            let message = format!("there is no place for the bore of electrode {number}: every edge is too near");
            FabricateError::part(message, "make `bore_m` smaller, or move the electrode")
        })?;
        Ok((centre_m, own, bore(design, bore_m, normal, distance(bore_m, centre_m))))
    };
    design.electrodes.iter().enumerate().map(place).collect()
}

fn bore(design: &SkinDesign, centre_m: Point3, normal: Point3, moved_m: f64) -> Bore {
    Bore { centre_m, normal, diameter_m: design.fabrication_options().bore_m, moved_m }
}

/// A membrane stretches only over what gives way.
fn check_foam(design: &SkinDesign, options: &FabricationOptions) -> Result<(), FabricateError> {
    match design.sheet.touch == TouchEffect::ConductanceFalls && options.foam_thickness_m == 0.0 {
        true => Err(FabricateError::part(
            "`foam_thickness_m` is 0 and the coat conducts less where it is pressed: without foam below its membrane nothing \
             stretches",
            "give `foam_thickness_m`, for example 0.002, or leave it out",
        )),
        false => Ok(()),
    }
}

fn check_bores(places: &Places, options: &FabricationOptions) -> Result<(), FabricateError> {
    let bores: Vec<(Point3, Point3)> = places.iter().map(|(_, _, bore)| (bore.centre_m, bore.normal)).collect();
    match closest_bores(&bores, options) {
        Some((i, j, land_m)) if land_m < FabricationOptions::MIN_LAND_M => {
            let message = dermis::design::bores_meet(i, j, land_m);
            Err(FabricateError::part(message, "make the bores smaller or move the electrodes apart"))
        }
        _ => Ok(()),
    }
}
