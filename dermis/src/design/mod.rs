//! Skin designs: body, sheet, electrodes, protocol and image.

mod carried;
mod check;
mod check_fabrication;
mod error;
mod fabrication;
mod file;
mod layout;
mod outline;
mod resolve;
mod rewrite;
mod rim;
mod shipped;

pub(crate) use check::LARGEST_BODY_M;
pub use check_fabrication::bores_meet;
pub use error::DesignError;
pub use error::{closest_name, explain_toml_error};
pub use fabrication::{FabricationOptions, closest_bores};
pub use layout::MAX_ELECTRODES;
pub use shipped::FOREARM_STL;

use crate::contact::ConductanceChange;
use crate::files::read_at_most;
use crate::geom::{Chart, Point3, Shape, Surface};
use crate::protocol::Protocol;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A skin, complete and checked.
#[derive(Debug, Clone, PartialEq)]
pub struct SkinDesign {
    /// Name for tables and plots.
    pub name: String,
    /// The body that the skin covers.
    pub body: Body,
    /// The conductive coating.
    pub sheet: Sheet,
    /// The electrodes, in the order of their numbers.
    pub electrodes: Vec<Electrode>,
    /// The order of a frame's values.
    pub protocol: Protocol,
    /// The image to reconstruct.
    pub image: ImageLayout,
    /// Resolution of the generated mesh.
    pub mesh: MeshOptions,
    /// What a workshop makes, if the design states it.
    pub fabrication: Option<FabricationOptions>,
}

impl SkinDesign {
    /// Names of the shipped designs.
    pub const SHIPPED: [&str; 3] = shipped::NAMES;

    /// A design by name (see [`SHIPPED`](Self::SHIPPED)) or by path. A file of that name has priority.
    ///
    /// # Errors
    /// No such file or name; the errors of [`parse`](Self::parse).
    pub fn load(name_or_path: &str) -> Result<Self, DesignError> {
        resolve::load(name_or_path)
    }

    /// As [`load`](Self::load), and checks with [`check_fabrication`](Self::check_fabrication) that a workshop can make the
    /// skin.
    ///
    /// # Errors
    /// Those of both. The error contains the line.
    pub fn load_for_fabrication(name_or_path: &str) -> Result<Self, DesignError> {
        resolve::parse_for_fabrication(&resolve::text_of(name_or_path)?, name_or_path)
    }

    /// The text of a design by name or by path, as [`load`](Self::load) finds it.
    ///
    /// # Errors
    /// No such file or name.
    pub fn text_of(name_or_path: &str) -> Result<String, DesignError> {
        resolve::text_of(name_or_path)
    }

    /// A shipped design; `None` if there is none of that name.
    pub fn shipped(name: &str) -> Option<Self> {
        let text = shipped::text(name)?;
        Some(Self::parse(text, name).expect("shipped designs are valid: a test reads each"))
    }

    /// The text of a shipped design; `None` if there is none of that name.
    pub fn shipped_text(name: &str) -> Option<&'static str> {
        shipped::text(name)
    }

    /// A design from the text of a TOML file. Relative paths in it start from the folder of `name`, its path.
    ///
    /// # Errors
    /// A text that is not TOML; unknown, missing or mistyped keys; sizes that no skin has; electrodes that are outside
    /// the body or overlap; a protocol that does not fit the electrodes. The error contains the line.
    pub fn parse(text: &str, name: &str) -> Result<Self, DesignError> {
        resolve::parse(text, name)
    }

    /// The text of a design file with the conductances of the sheet and its regions and the contact impedances of this
    /// design, to seven digits; all else, comments included, stays as it is.
    ///
    /// # Errors
    /// As [`parse`](Self::parse); a text with another number of electrodes or regions.
    pub fn rewrite(&self, text: &str, name: &str) -> Result<String, DesignError> {
        rewrite::rewrite(self, text, name)
    }

    /// The text of a design file with the files that it names inside: the mesh of its body, its channel table. It describes
    /// the same skin in every folder and on every computer.
    ///
    /// # Errors
    /// As [`parse`](Self::parse); a file that cannot be read.
    pub fn with_files(text: &str, name: &str) -> Result<String, DesignError> {
        resolve::with_files(text, name)
    }

    /// Checks a design that was built or changed by a program, as [`parse`](Self::parse) checks a file.
    ///
    /// # Errors
    /// As [`parse`](Self::parse), without a line.
    pub fn check(&self) -> Result<(), DesignError> {
        check::check(self).map_err(|problem| DesignError::new(problem.message, problem.fix))
    }

    /// Checks that a workshop can make the skin. [`load`](Self::load) and [`parse`](Self::parse) do not: a design that no
    /// workshop can make still describes a skin.
    ///
    /// # Errors
    /// Sizes that cannot be made: a wall thinner than a bore, bores that meet, patches that do not fit. Without a line.
    pub fn check_fabrication(&self) -> Result<(), DesignError> {
        check_fabrication::fabrication(self).map_err(|problem| DesignError::new(problem.message, problem.fix))
    }

    /// Identifies a skin: SHA-256 of the body and the electrodes' positions and shapes (rounded to 0.01 mm). The
    /// material, the contacts, the image and the mesh are not included: an instrument does not depend on them.
    pub fn sha256(&self) -> [u8; 32] {
        let mut text = match &self.body {
            Body::Mesh { unit_m, .. } => format!("mesh {unit_m}\n"),
            body => format!("{body:?}\n"),
        };
        for electrode in &self.electrodes {
            let [x, y, z] = electrode.centre_m.map(|value| (value * 1e5).round() + 0.0);
            text += &format!("{x} {y} {z} {:?}\n", electrode.shape);
        }
        crate::files::sha256((text + &self.protocol.to_csv()).as_bytes())
    }

    /// JSON schema of the design file.
    #[cfg(feature = "schema")]
    pub fn json_schema() -> serde_json::Value {
        schemars::schema_for!(file::DesignFile).to_value()
    }

    /// The contact impedance of each electrode: ohm m2 for discs and faces, ohm m for arcs, unused for points.
    pub fn contact_impedances(&self) -> Vec<f64> {
        self.electrodes.iter().map(|electrode| electrode.contact_impedance).collect()
    }
}

/// The body that the skin covers.
#[derive(Debug, Clone, PartialEq)]
pub enum Body {
    /// A cylinder's wall: axis z from 0 to the length.
    Cylinder {
        /// Length along z, m.
        length_m: f64,
        /// Diameter, m.
        diameter_m: f64,
    },
    /// A flat disk around the origin in the plane z = 0.
    Disk {
        /// Diameter, m.
        diameter_m: f64,
    },
    /// A flat rectangle in the plane z = 0: x from 0 to the width, y from 0 to the height.
    Rectangle {
        /// Extent along x, m.
        width_m: f64,
        /// Extent along y, m.
        height_m: f64,
    },
    /// A mesh file: Gmsh `.msh` (with electrode groups, triangles or tetrahedra), STL, OBJ or PLY.
    Mesh {
        /// The file.
        file: MeshFile,
        /// Metres per unit of the file.
        unit_m: f64,
    },
}

/// The mesh file of a body: where it lies, and what it holds if the text of the design carries it.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshFile {
    /// Its path.
    pub path: PathBuf,
    contents: Option<Arc<[u8]>>,
}

impl MeshFile {
    /// What it holds.
    ///
    /// # Errors
    /// A file that cannot be read, or that is larger than `most_bytes`.
    pub fn read(&self, most_bytes: u64) -> std::io::Result<Arc<[u8]>> {
        match &self.contents {
            Some(contents) if contents.len() as u64 > most_bytes => Err(std::io::ErrorKind::FileTooLarge.into()),
            Some(contents) => Ok(Arc::clone(contents)),
            None => Ok(read_at_most(&self.path, most_bytes)?.into()),
        }
    }
}

impl<P: AsRef<Path>> From<P> for MeshFile {
    fn from(path: P) -> Self {
        MeshFile { path: path.as_ref().to_path_buf(), contents: None }
    }
}

impl Body {
    /// The surface on which contacts are located.
    pub fn surface(&self) -> Surface {
        match *self {
            Body::Cylinder { length_m, diameter_m } => Surface::Cylinder { radius_m: diameter_m / 2.0, length_m },
            Body::Disk { .. } | Body::Rectangle { .. } => Surface::Plane,
            Body::Mesh { .. } => Surface::Free,
        }
    }

    /// The chart of the body, with the seam of a cylinder at theta = 0; `None` for a body known only by its mesh.
    pub fn chart(&self) -> Option<Chart> {
        let shape = match *self {
            Body::Cylinder { length_m, diameter_m } => Shape::Wall { radius_m: diameter_m / 2.0, length_m },
            Body::Disk { diameter_m } => Shape::Disk { radius_m: diameter_m / 2.0 },
            Body::Rectangle { width_m, height_m } => Shape::Rectangle { width_m, height_m },
            Body::Mesh { .. } => return None,
        };
        Some(Chart::new(shape))
    }

    /// The distance of a point of the surface from the body's edge, m, negative off the body; `None` for a body known
    /// only by its mesh.
    fn depth_m(&self, point_m: Point3) -> Option<f64> {
        self.chart().map(|chart| chart.depth_m(chart.unroll(point_m)))
    }

    /// Whether a point of the unbounded surface is on the body; always true on a body known only by its mesh.
    pub fn holds(&self, point_m: Point3) -> bool {
        self.depth_m(point_m).is_none_or(|depth_m| depth_m >= 0.0)
    }

    /// The distance from a point of the surface to the body's edge, m; `None` for a body known only by its mesh.
    pub fn edge_distance_m(&self, point_m: Point3) -> Option<f64> {
        self.depth_m(point_m).map(f64::abs)
    }
}

/// The sign of the conductance change under touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TouchEffect {
    /// Pressing raises the conductance, as on the paper's skin.
    ConductanceRises,
    /// Pressing lowers the conductance, as on stretched membranes.
    ConductanceFalls,
}

impl TouchEffect {
    /// +1 if a touch raises the conductance, -1 if it lowers it.
    pub fn sign(self) -> f64 {
        match self {
            TouchEffect::ConductanceRises => 1.0,
            TouchEffect::ConductanceFalls => -1.0,
        }
    }

    /// The change under touch.
    pub fn change(self) -> ConductanceChange {
        match self {
            TouchEffect::ConductanceRises => ConductanceChange::Rises,
            TouchEffect::ConductanceFalls => ConductanceChange::Falls,
        }
    }
}

/// Whether the conductor is a coating or fills the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SheetKind {
    /// A coating on a surface (triangles), given by its sheet conductance.
    Surface,
    /// A volume (tetrahedra), given by its conductivity.
    Volume,
}

/// The conductive coating.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// Whether it is a coating or fills the body.
    pub kind: SheetKind,
    /// Untouched conductance: sheet conductance in S for a surface, conductivity in S/m for a volume.
    pub conductance: f64,
    /// Regions with another conductance.
    pub regions: Vec<Region>,
    /// The sign of the conductance change under touch.
    pub touch: TouchEffect,
}

/// A named region of the sheet with its own conductance.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Its name.
    pub name: String,
    /// Untouched conductance in the region, as in [`Sheet::conductance`].
    pub conductance: f64,
    /// The cells that belong to it.
    pub place: RegionPlace,
}

/// The cells that belong to a region.
#[derive(Debug, Clone, PartialEq)]
pub enum RegionPlace {
    /// The cells whose centre is inside a box given by opposite corners, m: (z, s = radius * theta) on a cylinder, (x,
    /// y) on a flat skin.
    Box {
        /// Lower corner.
        low_m: [f64; 2],
        /// Upper corner.
        high_m: [f64; 2],
    },
    /// The physical group of that name in a mesh file.
    Group,
}

/// One electrode.
#[derive(Debug, Clone, PartialEq)]
pub struct Electrode {
    /// Its centre on the surface, m; `NaN` for a group, whose position is only in the mesh file.
    pub centre_m: Point3,
    /// Its shape.
    pub shape: ElectrodeShape,
    /// Contact impedance: ohm m2 for discs and faces, ohm m for arcs, unused for points.
    pub contact_impedance: f64,
}

/// The shape of an electrode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ElectrodeShape {
    /// A disc on the surface, clipped at the edges of the body.
    Disc {
        /// Radius along the surface, m.
        radius_m: f64,
    },
    /// A part of the body's edge.
    Arc {
        /// Length along the edge, m.
        length_m: f64,
    },
    /// A single point.
    Point,
    /// The physical group `electrode_<n>` of the mesh file.
    Group,
}

/// The image to reconstruct.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageLayout {
    /// A grid of pixels: rows along z and columns around theta on a cylinder; rows along y and columns along x on a
    /// flat skin (pixels outside a disk are masked).
    Grid {
        /// Pixels along z or y.
        rows: usize,
        /// Pixels around theta or along x.
        columns: usize,
    },
    /// A pixel for every cell of the mesh.
    Cells,
    /// Groups of neighbouring cells, about a sixth of the electrodes' spacing wide; cells where they are no finer.
    Patches,
}

/// Resolution and accuracy of the mesh. Lengths in m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshOptions {
    /// Longest edge allowed.
    pub max_edge_m: f64,
    /// Length of the edges along an electrode's outline.
    pub electrode_edge_m: f64,
    /// Growth of the edge length per distance from the nearest electrode outline.
    pub growth: f64,
    /// Whether forward models correct the error of the mesh at the ends of arcs (`docs/theory.md`); without, their values
    /// are those of plain linear elements.
    pub correct_arc_ends: bool,
}

impl MeshOptions {
    /// The same grading with every edge length multiplied by `factor`. The growth with distance is multiplied too.
    pub fn scaled(self, factor: f64) -> Self {
        MeshOptions {
            max_edge_m: self.max_edge_m * factor,
            electrode_edge_m: self.electrode_edge_m * factor,
            growth: self.growth * factor,
            ..self
        }
    }
}

#[cfg(test)]
mod tests;
