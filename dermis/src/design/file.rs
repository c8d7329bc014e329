//! The tables and keys of a design file (TOML), before they are checked.

use crate::design::FabricationOptions;
use crate::files::exactly;
#[cfg(feature = "schema")]
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer};
#[cfg(feature = "schema")]
use std::borrow::Cow;
use std::ops::Range;
use std::path::PathBuf;
use toml::Spanned;

/// A value and its place in the file.
#[derive(Debug, Clone)]
pub(super) struct At<T> {
    pub value: T,
    pub span: Range<usize>,
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for At<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let spanned = Spanned::<T>::deserialize(deserializer)?;
        Ok(At { span: spanned.span(), value: spanned.into_inner() })
    }
}

/// A list of fixed length. (Read as an array alone, a longer list would lose what is too much.)
#[derive(Debug, Clone, Copy)]
pub(super) struct Exactly<T>(pub T);

impl<'de, T: Deserialize<'de>, const N: usize> Deserialize<'de> for Exactly<[T; N]> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        exactly(deserializer).map(Exactly)
    }
}

#[cfg(feature = "schema")]
macro_rules! schema_of_inner {
    ($wrapper:ident) => {
        impl<T: JsonSchema> JsonSchema for $wrapper<T> {
            fn schema_name() -> Cow<'static, str> {
                T::schema_name()
            }
            fn schema_id() -> Cow<'static, str> {
                T::schema_id()
            }
            fn inline_schema() -> bool {
                T::inline_schema()
            }
            fn json_schema(generator: &mut SchemaGenerator) -> Schema {
                T::json_schema(generator)
            }
        }
    };
}
#[cfg(feature = "schema")]
schema_of_inner!(At);
#[cfg(feature = "schema")]
schema_of_inner!(Exactly);

/// A skin: its body, its sheet, its electrodes, its protocol and its image. Lengths are in metres, angles in radians.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(title = "Dermis skin design"))]
pub(super) struct DesignFile {
    /// Name for tables and plots; default: the file name.
    pub name: Option<At<String>>,
    /// The body that the skin covers.
    pub body: At<BodyTable>,
    /// The conductive coating.
    pub sheet: At<SheetTable>,
    /// The electrodes.
    pub electrodes: At<ElectrodesTable>,
    /// The order of a frame's values.
    pub protocol: At<ProtocolTable>,
    /// The image to reconstruct; default: a grid of 30 x 30, on a mesh body patches.
    pub image: Option<At<ImageTable>>,
    /// Resolution of the generated mesh; default: chosen from the sizes of the body and the electrodes.
    pub mesh: Option<At<MeshTable>>,
    /// What a workshop makes: base, fabric patches, foam; every key has a default.
    pub fabrication: Option<At<FabricationOptions>>,
}

/// The body that the skin covers.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum BodyTable {
    /// A cylinder's wall, its axis along z from 0 to the length.
    Cylinder {
        /// Length along z, m.
        length_m: At<f64>,
        /// Diameter, m.
        diameter_m: At<f64>,
    },
    /// A flat disk around the origin in the plane z = 0.
    Disk {
        /// Diameter, m.
        diameter_m: At<f64>,
    },
    /// A flat rectangle in the plane z = 0, from the origin to (width, height).
    Rectangle {
        /// Extent along x, m.
        width_m: At<f64>,
        /// Extent along y, m.
        height_m: At<f64>,
    },
    /// A flat body of any outline in the plane z = 0. It is meshed and its image divided as the body of a mesh file, and
    /// positions on it have x_m, y_m and z_m; its electrodes are discs or points.
    Polygon {
        /// Its corners in order, [x, y], m; in either direction.
        corners_m: At<Vec<Exactly<[f64; 2]>>>,
    },
    /// A mesh file: Gmsh .msh, STL, OBJ or PLY.
    Mesh {
        /// The file, relative to the folder of the design.
        path: At<PathBuf>,
        /// Metres per unit of the file: 0.001 for a file in millimetres.
        unit_m: At<f64>,
    },
}

/// The sign of the conductance change under touch.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "snake_case")]
pub(super) enum TouchName {
    /// Pressing raises the conductance, as on the paper's skin.
    ConductanceRises,
    /// Pressing lowers the conductance, as on stretched membranes.
    ConductanceFalls,
}

/// The conductive coating.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct SheetTable {
    /// Sheet resistance of a surface, ohm per square.
    pub sheet_resistance_ohm: Option<At<f64>>,
    /// Conductivity of a volume (a mesh of tetrahedra), S/m; in place of the sheet resistance.
    pub conductivity_s_per_m: Option<At<f64>>,
    /// The sign of the conductance change under touch.
    pub touch: TouchName,
    /// Regions with another conductance; where they overlap, the last one applies.
    #[serde(default)]
    pub regions: Vec<At<RegionTable>>,
}

/// A named region of the sheet with its own conductance.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct RegionTable {
    /// Its name; without a box, the physical group of that name in the mesh file.
    pub name: String,
    /// Sheet resistance in the region, ohm per square.
    pub sheet_resistance_ohm: Option<At<f64>>,
    /// Conductivity in the region, S/m; in place of the sheet resistance.
    pub conductivity_s_per_m: Option<At<f64>>,
    /// Lower corner of a box, m: (z, s = radius * theta) on a cylinder, (x, y) on a flat skin.
    pub low_m: Option<At<Exactly<[f64; 2]>>>,
    /// Upper corner of the box, m.
    pub high_m: Option<At<Exactly<[f64; 2]>>>,
}

/// One number for all, or a list with one for each.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(untagged, expecting = "expected a number, or a list with a number for each electrode")]
pub(super) enum OneOrEach {
    /// The same for every electrode.
    One(f64),
    /// One for each electrode, in the order of their numbers.
    Each(Vec<f64>),
}

/// The electrodes.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct ElectrodesTable {
    /// The shape of each electrode.
    pub shape: At<ShapeTable>,
    /// The positions of the electrodes.
    pub layout: At<LayoutTable>,
    /// Contact impedance of discs and of groups of faces, ohm m2: one number, or one for each electrode.
    pub contact_impedance_ohm_m2: Option<At<OneOrEach>>,
    /// Contact impedance of arcs and of groups of edges, ohm m: one number, or one for each electrode.
    pub contact_impedance_ohm_m: Option<At<OneOrEach>>,
}

/// The shape of an electrode.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ShapeTable {
    /// A disc on the surface, clipped at the edges of the body.
    Disc {
        /// Radius along the surface, m.
        radius_m: f64,
    },
    /// A part of the body's edge, centred at the electrode's position.
    Arc {
        /// Length along the edge, m.
        length_m: f64,
    },
    /// A single point.
    Point,
    /// The physical group `electrode_<n>` of the mesh file, n from 0.
    Group,
}

/// The positions of the electrodes.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum LayoutTable {
    /// Rings around a cylinder. Electrode k of ring r has the number `per_ring * r + k`.
    Rings {
        /// Number of rings.
        rings: At<usize>,
        /// Electrodes on each ring.
        per_ring: At<usize>,
        /// Distance between rings along z, m.
        spacing_m: At<f64>,
        /// z of ring 0, m; default: 0 (the lower rim).
        first_z_m: Option<At<f64>>,
        /// Angle of electrode 0, rad; default: 0.
        first_theta_rad: Option<At<f64>>,
        /// Rotation of rings 1, 3, 5, ... as a fraction of the step between electrodes; default: 0.
        stagger: Option<At<f64>>,
    },
    /// At equal distances along the edge of a disk, a rectangle or a polygon.
    Rim {
        /// Number of electrodes, at equal distances along the edge; on a rectangle or a polygon the first is half a step
        /// from its corner.
        count: Option<At<usize>>,
        /// Number of electrodes on each side of a rectangle or a polygon, in place of `count`.
        per_side: Option<At<usize>>,
        /// Angle of electrode 0 of a disk from +x towards +y, rad; default: 0.
        first_theta_rad: Option<At<f64>>,
        /// Corner of a rectangle where the numbering starts; default: `lower_left` (the origin).
        first_corner: Option<At<Corner>>,
        /// Direction of the numbering, as seen from +z; default: counter-clockwise.
        #[serde(default)]
        direction: Direction,
    },
    /// A grid on a rectangle: row by row from y = 0, each from x = 0.
    Grid {
        /// Rows along y.
        rows: At<usize>,
        /// Columns along x.
        columns: At<usize>,
        /// Distance of the outer electrodes from the edges, m; default: half a step.
        margin_m: Option<At<f64>>,
    },
    /// A list of positions: (z_m, theta_rad) on a cylinder, (x_m, y_m) on a flat skin, (x_m, y_m, z_m) on a mesh; on the
    /// edge of a disk theta_rad alone, on the edge of a disk, a rectangle or a polygon along_edge_m alone. Arcs at most a tenth of their
    /// length from the edge are moved to it, discs at most a tenth of their radius beyond it too, and points at most 0.01 mm
    /// from it: such positions are rounded.
    Positions(Vec<At<PositionTable>>),
    /// The physical groups `electrode_<n>` of the mesh file.
    Groups {
        /// Number of electrodes.
        count: At<usize>,
    },
}

/// A corner of a rectangle, as seen from +z with x to the right and y up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "snake_case")]
pub(super) enum Corner {
    /// The origin.
    #[default]
    LowerLeft,
    /// (width, 0).
    LowerRight,
    /// (width, height).
    UpperRight,
    /// (0, height).
    UpperLeft,
}

/// A direction along an edge, as seen from +z.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "snake_case")]
pub(super) enum Direction {
    /// From +x towards +y.
    #[default]
    CounterClockwise,
    /// From +y towards +x.
    Clockwise,
}

/// The position of one electrode.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct PositionTable {
    /// Along x, m.
    pub x_m: Option<f64>,
    /// Along y, m.
    pub y_m: Option<f64>,
    /// Along z, m.
    pub z_m: Option<f64>,
    /// Angle around a cylinder or on the edge of a disk, from +x towards +y, rad.
    pub theta_rad: Option<f64>,
    /// Distance along the edge, counter-clockwise as seen from +z, m: on a disk from theta = 0, on a rectangle from the
    /// origin, on a polygon from its first corner.
    pub along_edge_m: Option<f64>,
    /// The shape of this electrode, if it differs from the others.
    pub shape: Option<ShapeTable>,
}

/// The order of a frame's values.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct ProtocolTable {
    /// The drive and measure pattern.
    pub pattern: At<PatternTable>,
    /// Number of the first electrode in the `table` or the `channels` of the pattern: 1 where these count from 1; default: 0.
    pub first_electrode: Option<At<usize>>,
    /// The instrument reports amplitudes: the signs are lost and are restored from the model.
    #[serde(default)]
    pub amplitude_only: bool,
    /// The start of the measure pairs of a drive.
    #[serde(default)]
    pub measures_start: MeasuresStart,
    /// Read V(m + 1) - V(m) in place of V(m) - V(m + 1).
    #[serde(default)]
    pub measures_reversed: bool,
}

/// The drive and measure pattern.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum PatternTable {
    /// Drive d to d + 1, every adjacent measure except the drive pair itself: L (L - 1) values.
    Adjacent,
    /// Drive d to d + 1, every adjacent measure without a driven electrode: L (L - 3) values.
    AdjacentUndriven,
    /// Drive d to d + L/2, every adjacent measure without a driven electrode: L (L - 4) values.
    Opposite,
    /// Drive d to d + 1 + the number of electrodes skipped, every adjacent measure without a driven electrode.
    Skip(usize),
    /// Drives and measures between electrodes at given distances.
    Distances {
        /// Drive d to d + this number.
        drive: usize,
        /// Measure m against m + this number; default: 1.
        measure: Option<usize>,
        /// Measure at driven electrodes too, except between the two of the drive; default: false.
        #[serde(default)]
        with_driven: bool,
    },
    /// A list with the four electrodes of each value: [drive_source, drive_sink, measure_plus, measure_minus].
    Channels(Vec<Exactly<[usize; 4]>>),
    /// A channel table (CSV: channel,drive_source,drive_sink,measure_plus,measure_minus; or with the columns a, b, m and n of
    /// geophysics) or the scan table of another design, relative to the folder of the design.
    Table(PathBuf),
}

/// The start of the measure pairs of a drive.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "snake_case")]
pub(super) enum MeasuresStart {
    /// At electrode 0.
    #[default]
    ElectrodeZero,
    /// At the electrode where the current enters.
    Drive,
}

/// The image to reconstruct.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum ImageTable {
    /// Rows along z and columns around theta on a cylinder; rows along y and columns along x on a flat skin.
    Grid {
        /// Pixels along z or y.
        rows: At<usize>,
        /// Pixels around theta or along x.
        columns: At<usize>,
    },
    /// A pixel for every cell of the mesh.
    Cells,
    /// Groups of neighbouring cells of a surface, about a sixth of the electrodes' spacing wide: the default of bodies from
    /// mesh files.
    Patches,
}

/// Resolution of the generated mesh.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct MeshTable {
    /// Longest edge, m; edges of a body from a mesh file may be a third longer.
    pub max_edge_m: Option<At<f64>>,
    /// Length of the edges along an electrode's outline, m.
    pub electrode_edge_m: Option<At<f64>>,
    /// Growth of the edge length per distance from the nearest electrode outline.
    pub growth: Option<At<f64>>,
    /// Whether forward models correct the error of the mesh at the ends of arcs.
    pub correct_arc_ends: Option<bool>,
}
