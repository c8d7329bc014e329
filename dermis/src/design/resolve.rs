//! Conversion of the tables of a design file to a skin.

use crate::design::carried::{CarriedFiles, WrongLine};
use crate::design::check::Problem;
use crate::design::error::{DesignError, closest_name, explain_toml_error, value_of_named_key};
use crate::design::file::{
    At, BodyTable, DesignFile, ElectrodesTable, ImageTable, LayoutTable, MeasuresStart, MeshTable, OneOrEach,
    PatternTable, ProtocolTable, ShapeTable, SheetTable, TouchName,
};
use crate::design::layout::{self, Ground};
use crate::design::outline::Outline;
use crate::design::{
    Body, Electrode, ElectrodeShape, ImageLayout, MeshFile, MeshOptions, Region, RegionPlace, Sheet, SheetKind,
    SkinDesign, TouchEffect, shipped,
};
use crate::design::{check, check_fabrication};
use crate::files::{read_at_most, read_text_at_most};
use crate::protocol::{Channel, Driven, Protocol, numbered};
use crate::text::printable;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A place in a design, as the checks name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    Body,
    Sheet,
    Region(usize),
    Electrodes,
    Electrode(usize),
    Shape(usize),
    ContactImpedance,
    Protocol,
    Image,
    Mesh,
    Fabrication(Option<&'static str>),
}

/// A design by name or by path.
pub(super) fn load(name_or_path: &str) -> Result<SkinDesign, DesignError> {
    parse(&text_of(name_or_path)?, name_or_path)
}

/// The text of a design by name or by path.
pub(super) fn text_of(name_or_path: &str) -> Result<String, DesignError> {
    let path = Path::new(name_or_path);
    if let (false, Some(text)) = (path.is_file(), shipped::text(name_or_path)) {
        return Ok(text.to_string());
    }
    read_text_at_most(path, LARGEST_DESIGN + 4 * LARGEST_CARRIED).map_err(|error| {
        let meant = closest_name(name_or_path, shipped::NAMES.into_iter());
        let fix = match meant {
            Some(name) => format!("did you mean `{name}`?"),
            None => format!("give the path of a design file, or one of {}", shipped::NAMES.join(", ")),
        };
        DesignError::new(format!("cannot read the design {name_or_path}: {error}"), Some(fix))
    })
}

/// A design from the text of a TOML file.
pub(super) fn parse(text: &str, name: &str) -> Result<SkinDesign, DesignError> {
    Ok(read(text.strip_prefix('\u{feff}').unwrap_or(text), name)?.1)
}

/// A design from the text of a TOML file that a workshop can make.
pub(super) fn parse_for_fabrication(text: &str, name: &str) -> Result<SkinDesign, DesignError> {
    let (text, files) = split(text.strip_prefix('\u{feff}').unwrap_or(text), name)?;
    let (file, design) = read_with(text, name, &files)?;
    Source { name, text, files: &files }.accept(&file, check_fabrication::fabrication(&design))?;
    Ok(design)
}

/// The tables of a TOML file without a byte-order mark, and the design.
pub(super) fn read(text: &str, name: &str) -> Result<(DesignFile, SkinDesign), DesignError> {
    let (text, files) = split(text, name)?;
    read_with(text, name, &files)
}

/// The text of a design without the files that it carries, and the files.
fn split<'a>(text: &'a str, name: &str) -> Result<(&'a str, CarriedFiles), DesignError> {
    CarriedFiles::split(text).map_err(|WrongLine(line)| {
        let message = format!("{name}: line {line} is not a file that the design carries");
        DesignError::new(message, Some("a name and hexadecimal digits, each in quotation marks, follow [files]".into()))
    })
}

/// The text with the files that it names.
pub(super) fn with_files(text: &str, name: &str) -> Result<String, DesignError> {
    let (text, mut files) = split(text.strip_prefix('\u{feff}').unwrap_or(text), name)?;
    let (file, _) = read_with(text, name, &files)?;
    let source = Source { name, text, files: &files };
    let mesh = match &file.body.value {
        BodyTable::Mesh { path, .. } => Some(&path.value),
        _ => None,
    };
    let table = match &file.protocol.value.pattern.value {
        PatternTable::Table(path) => Some(path),
        _ => None,
    };
    // A larger file stays where it is.
    let is_small =
        |path: &&PathBuf| std::fs::metadata(source.beside(path)).map_or(true, |file| file.len() <= LARGEST_CARRIED);
    let is_missing = |path: &&PathBuf| files.get(path).is_none();
    let named: Vec<_> = mesh.into_iter().chain(table).filter(is_missing).filter(is_small).collect();
    let read = |path: &&PathBuf| {
        let place = source.beside(path);
        let failed = |error| DesignError::new(format!("cannot read {}: {error}", place.display()), None);
        Ok((path.to_path_buf(), read_at_most(&place, LARGEST_CARRIED).map_err(failed)?))
    };
    let contents = named.iter().map(read).collect::<Result<Vec<_>, DesignError>>()?;
    contents.into_iter().for_each(|(path, contents)| files.insert(&path, contents));
    Ok(files.join(text))
}

fn read_with(text: &str, name: &str, files: &CarriedFiles) -> Result<(DesignFile, SkinDesign), DesignError> {
    if text.len() as u64 > LARGEST_DESIGN {
        let message = format!("the design {name} is larger than {} MiB, the most that is read", LARGEST_DESIGN >> 20);
        return Err(DesignError::new(message, None));
    }
    let source = Source { name, text, files };
    let file: DesignFile = toml::from_str(text).map_err(|error| {
        let (message, fix) = explain_toml_error(error.message());
        source.fail(error.span(), message, fix)
    })?;
    let design = source.resolve(&file)?;
    source.accept(&file, check::check(&design).and_then(|()| check_fabrication::multiplexers(&design)))?;
    Ok((file, design))
}

/// The byte range of a place in the file.
fn locate(text: &str, file: &DesignFile, place: Place) -> Range<usize> {
    let electrodes = &file.electrodes.value;
    match place {
        Place::Body => file.body.span.clone(),
        Place::Sheet => {
            let sheet = &file.sheet.value;
            let value = sheet.sheet_resistance_ohm.as_ref().or(sheet.conductivity_s_per_m.as_ref());
            value.map_or(file.sheet.span.clone(), |value| value.span.clone())
        }
        Place::Region(index) => file.sheet.value.regions[index].span.clone(),
        Place::Electrodes => electrodes.layout.span.clone(),
        Place::Electrode(index) | Place::Shape(index) => match (&electrodes.layout.value, place) {
            (LayoutTable::Positions(list), _) => list[index].span.clone(),
            (_, Place::Shape(_)) => electrodes.shape.span.clone(),
            _ => electrodes.layout.span.clone(),
        },
        Place::ContactImpedance => {
            let value = electrodes.contact_impedance_ohm_m2.as_ref().or(electrodes.contact_impedance_ohm_m.as_ref());
            value.map_or(file.electrodes.span.clone(), |value| value.span.clone())
        }
        Place::Protocol => file.protocol.value.pattern.span.clone(),
        Place::Image => file.image.as_ref().map_or(file.body.span.clone(), |image| image.span.clone()),
        Place::Mesh => file.mesh.as_ref().map_or(file.body.span.clone(), |mesh| mesh.span.clone()),
        Place::Fabrication(key) => file.fabrication.as_ref().map_or(file.body.span.clone(), |table| {
            key.and_then(|key| key_span(text, table.span.start, key)).unwrap_or(table.span.clone())
        }),
    }
}

/// Largest text of a design, bytes: a list of the most electrodes has a tenth of a MiB, and each byte of a list takes up to
/// a hundred bytes of memory.
const LARGEST_DESIGN: u64 = 4 << 20;

/// Largest file that a design carries, bytes: a million triangles of a binary STL file. A text holds two, with two digits for each byte.
const LARGEST_CARRIED: u64 = 50 << 20;

/// Longest name of a design, bytes.
const LONGEST_NAME: usize = 200;

/// The file's name and text, for its errors.
pub(super) struct Source<'a> {
    name: &'a str,
    text: &'a str,
    files: &'a CarriedFiles,
}

impl Source<'_> {
    /// An error at a place of the file.
    pub(super) fn fail(
        &self,
        span: Option<Range<usize>>,
        message: impl Into<String>,
        fix: Option<String>,
    ) -> DesignError {
        let message = message.into();
        let span = span.map(|span| value_of_named_key(self.text, &span, &message).unwrap_or(span));
        DesignError { message, fix, source_text: Some((self.name.to_string(), self.text.to_string())), span }
    }

    /// What a check found, with its place in the file.
    fn accept(&self, file: &DesignFile, checked: Result<(), Problem>) -> Result<(), DesignError> {
        checked.map_err(|problem| self.fail(Some(locate(self.text, file, problem.place)), problem.message, problem.fix))
    }

    /// A file named in the design, relative to the folder of the design.
    fn beside(&self, path: &Path) -> PathBuf {
        Path::new(self.name).parent().unwrap_or(Path::new("")).join(path)
    }

    fn resolve(&self, file: &DesignFile) -> Result<SkinDesign, DesignError> {
        let outline = self.outline(&file.body.value)?;
        let body = self.body(&file.body.value, outline.as_ref());
        check::body(&body).map_err(|p| self.fail(Some(file.body.span.clone()), p.message, p.fix))?;
        let electrodes = self.electrodes(&Ground { body: &body, outline: outline.as_ref() }, &file.electrodes)?;
        let image = match file.image.as_ref().map(|image| &image.value) {
            Some(ImageTable::Cells) => ImageLayout::Cells,
            Some(ImageTable::Grid { rows, columns }) => ImageLayout::Grid { rows: rows.value, columns: columns.value },
            Some(ImageTable::Patches) => ImageLayout::Patches,
            None if matches!(body, Body::Mesh { .. }) => ImageLayout::Patches,
            None => ImageLayout::Grid { rows: 30, columns: 30 },
        };
        Ok(SkinDesign {
            name: self.design_name(file.name.as_ref())?,
            sheet: self.sheet(&file.sheet)?,
            protocol: self.protocol(&file.protocol.value, electrodes.len())?,
            mesh: mesh_options(&body, &electrodes, file.mesh.as_ref().map(|mesh| &mesh.value)),
            fabrication: file.fabrication.as_ref().map(|table| table.value.clone()),
            body,
            electrodes,
            image,
        })
    }

    /// The name of the design: its own, which every table and terminal shows, or that of the file.
    fn design_name(&self, given: Option<&At<String>>) -> Result<String, DesignError> {
        let Some(At { value, span }) = given else { return Ok(printable(&self.stem()).into_owned()) };
        if value.trim().is_empty() || value.len() > LONGEST_NAME || printable(value) != *value {
            let message = format!("`name` must have 1 to {LONGEST_NAME} bytes, without control characters");
            return Err(self.fail(Some(span.clone()), message, None));
        }
        Ok(value.clone())
    }

    fn stem(&self) -> String {
        Path::new(self.name).file_stem().map_or(self.name.to_string(), |stem| stem.to_string_lossy().into_owned())
    }

    /// The outline of a polygon.
    fn outline(&self, table: &BodyTable) -> Result<Option<Outline>, DesignError> {
        let BodyTable::Polygon { corners_m } = table else { return Ok(None) };
        let wrong = |(message, fix): (String, &str)| {
            self.fail(Some(corners_m.span.clone()), format!("corners_m: {message}"), Some(fix.to_string()))
        };
        Outline::new(&corners_m.value.iter().map(|corner| corner.0).collect::<Vec<_>>()).map(Some).map_err(wrong)
    }

    fn body(&self, table: &BodyTable, outline: Option<&Outline>) -> Body {
        match table {
            BodyTable::Cylinder { length_m, diameter_m } => {
                Body::Cylinder { length_m: length_m.value, diameter_m: diameter_m.value }
            }
            BodyTable::Disk { diameter_m } => Body::Disk { diameter_m: diameter_m.value },
            BodyTable::Rectangle { width_m, height_m } => {
                Body::Rectangle { width_m: width_m.value, height_m: height_m.value }
            }
            BodyTable::Polygon { .. } => {
                let contents = outline.map(|outline| outline.to_obj().into_bytes().into());
                Body::Mesh { file: MeshFile { path: "polygon.obj".into(), contents }, unit_m: 1.0 }
            }
            BodyTable::Mesh { path, unit_m } => {
                let contents = self.files.get(&path.value);
                Body::Mesh { file: MeshFile { path: self.beside(&path.value), contents }, unit_m: unit_m.value }
            }
        }
    }

    fn sheet(&self, table: &At<SheetTable>) -> Result<Sheet, DesignError> {
        let sheet = &table.value;
        let (kind, conductance) =
            self.conductance(&sheet.sheet_resistance_ohm, &sheet.conductivity_s_per_m, &table.span, "the sheet")?;
        let mut regions = Vec::with_capacity(sheet.regions.len());
        for At { value: region, span } in &sheet.regions {
            let what = format!("region `{}`", region.name);
            let (region_kind, conductance) =
                self.conductance(&region.sheet_resistance_ohm, &region.conductivity_s_per_m, span, &what)?;
            if region_kind != kind {
                let message = format!("{what} and the sheet state different quantities");
                return Err(self.fail(Some(span.clone()), message, Some("give both the same key".into())));
            }
            let place = match (&region.low_m, &region.high_m) {
                (Some(low), Some(high)) => RegionPlace::Box { low_m: low.value.0, high_m: high.value.0 },
                (None, None) => RegionPlace::Group,
                _ => {
                    let message = format!("{what} has only one corner of its box");
                    return Err(self.fail(Some(span.clone()), message, Some("give `low_m` and `high_m`".into())));
                }
            };
            regions.push(Region { name: region.name.clone(), conductance, place });
        }
        let touch = match sheet.touch {
            TouchName::ConductanceRises => TouchEffect::ConductanceRises,
            TouchName::ConductanceFalls => TouchEffect::ConductanceFalls,
        };
        Ok(Sheet { kind, conductance, regions, touch })
    }

    /// The conductance of a sheet or a region from the one of the two keys that is given.
    fn conductance(
        &self,
        resistance_ohm: &Option<At<f64>>,
        conductivity_s_per_m: &Option<At<f64>>,
        span: &Range<usize>,
        what: &str,
    ) -> Result<(SheetKind, f64), DesignError> {
        let (value, key) = match (resistance_ohm, conductivity_s_per_m) {
            (Some(value), None) => (value, "sheet_resistance_ohm"),
            (None, Some(value)) => (value, "conductivity_s_per_m"),
            (given, _) => {
                let count = if given.is_some() { "both" } else { "neither" };
                let message = format!(
                    "{what} needs `sheet_resistance_ohm` (a surface) or `conductivity_s_per_m` (a volume), not {count}"
                );
                return Err(self.fail(Some(span.clone()), message, None));
            }
        };
        if !(value.value > 0.0 && value.value.is_finite()) {
            let message = format!("{key} of {what} is {}: it must be positive and finite", value.value);
            return Err(self.fail(Some(value.span.clone()), message, None));
        }
        if resistance_ohm.is_some() {
            Ok((SheetKind::Surface, 1.0 / value.value))
        } else {
            Ok((SheetKind::Volume, value.value))
        }
    }

    fn electrodes(&self, ground: &Ground<'_>, table: &At<ElectrodesTable>) -> Result<Vec<Electrode>, DesignError> {
        let electrodes = &table.value;
        let places = layout::places(self, ground, electrodes)?;
        let mut list = Vec::with_capacity(places.len());
        for (index, (centre_m, shape)) in places.iter().copied().enumerate() {
            let contact_impedance = self.contact_impedance(index, places.len(), shape, table)?;
            list.push(Electrode { centre_m, shape, contact_impedance });
        }
        Ok(list)
    }

    fn contact_impedance(
        &self,
        index: usize,
        count: usize,
        shape: ElectrodeShape,
        table: &At<ElectrodesTable>,
    ) -> Result<f64, DesignError> {
        let per_area = table.value.contact_impedance_ohm_m2.as_ref();
        let per_length = table.value.contact_impedance_ohm_m.as_ref();
        let (given, needed) = match shape {
            ElectrodeShape::Point => return Ok(0.0),
            ElectrodeShape::Disc { .. } => (per_area, "contact_impedance_ohm_m2"),
            ElectrodeShape::Arc { .. } => (per_length, "contact_impedance_ohm_m"),
            // Faces or edges: this is known only from the mesh file.
            ElectrodeShape::Group => (per_area.or(per_length), "contact_impedance_ohm_m2"),
        };
        let Some(given) = given else {
            let other = per_area.or(per_length).map_or(table.span.clone(), |other| other.span.clone());
            let message = format!("electrode {index} needs `{needed}`");
            return Err(self.fail(
                Some(other),
                message,
                Some(
                    "a contact impedance has the unit of its electrode: \
                ohm m2 on an area, ohm m on an edge"
                        .into(),
                ),
            ));
        };
        match &given.value {
            OneOrEach::One(value) => Ok(*value),
            OneOrEach::Each(values) if values.len() == count => Ok(values[index]),
            OneOrEach::Each(values) => {
                let message = format!("`{needed}` has {} values for {count} electrodes", values.len());
                Err(self.fail(Some(given.span.clone()), message, Some("give one number, or one each".into())))
            }
        }
    }

    fn protocol(&self, table: &ProtocolTable, electrode_count: usize) -> Result<Protocol, DesignError> {
        let fail = |error: crate::protocol::ProtocolError| {
            self.fail(Some(table.pattern.span.clone()), error.to_string(), None)
        };
        let counts = matches!(table.pattern.value, PatternTable::Table(_) | PatternTable::Channels(_));
        if let Some(first) = table.first_electrode.as_ref().filter(|_| !counts) {
            let fix = "leave `first_electrode` out: electrodes of the design are numbered from 0".to_string();
            let message = "`first_electrode` belongs to a pattern with a `table` or `channels`";
            return Err(self.fail(Some(first.span.clone()), message, Some(fix)));
        }
        let first = table.first_electrode.as_ref().map(|at| at.value);
        let protocol = match &table.pattern.value {
            PatternTable::Adjacent => Protocol::adjacent(electrode_count),
            PatternTable::AdjacentUndriven => Protocol::adjacent_undriven(electrode_count),
            PatternTable::Opposite => Protocol::opposite(electrode_count),
            PatternTable::Skip(skip) => Protocol::skip(electrode_count, *skip),
            PatternTable::Table(path) => match self.files.get(path) {
                Some(table) => {
                    let (text, path) = (String::from_utf8_lossy(&table), path.to_string_lossy());
                    Protocol::parse_csv_numbered(&text, &path, electrode_count, first)
                }
                None => Protocol::load_numbered(&self.beside(path), electrode_count, first),
            },
            &PatternTable::Distances { drive, measure, with_driven } => {
                let driven = if with_driven { Driven::NotItsPair } else { Driven::LeftOut };
                Protocol::distances(electrode_count, [drive, measure.unwrap_or(1)], driven)
            }
            PatternTable::Channels(rows) => {
                let rows: Vec<_> = rows.iter().map(|row| row.0).enumerate().collect();
                let channels = numbered(&rows, electrode_count, first.unwrap_or(0)).map_err(|(index, message)| {
                    self.fail(
                        Some(table.pattern.span.clone()),
                        format!("channel {index} of `channels`, its row {}, {message}", index + 1),
                        None,
                    )
                })?;
                Protocol::new(electrode_count, channels)
            }
        }
        .map_err(fail)?;
        let mut channels = protocol.channels().to_vec();
        if table.measures_start == MeasuresStart::Drive {
            let turn = |c: &Channel| (c.measure[0] + electrode_count - c.drive[0]) % electrode_count;
            for drive in channels.chunk_by_mut(|a, b| a.drive == b.drive) {
                drive.sort_by_key(turn);
            }
        }
        if table.measures_reversed {
            channels.iter_mut().for_each(|channel| channel.measure.reverse());
        }
        let protocol = Protocol::new(electrode_count, channels).map_err(fail)?;
        Ok(protocol.with_amplitude_only(table.amplitude_only))
    }
}

/// The mesh sizes of the file; missing ones are computed from the sizes of the body and its electrodes.
fn mesh_options(body: &Body, electrodes: &[Electrode], table: Option<&MeshTable>) -> MeshOptions {
    let given = |pick: fn(&MeshTable) -> Option<&At<f64>>| table.and_then(pick).map(|at| at.value);
    let max_edge_m = given(|t| t.max_edge_m.as_ref()).unwrap_or_else(|| default_edge_m(body));
    let size_m = electrodes.iter().filter_map(|electrode| match electrode.shape {
        ElectrodeShape::Disc { radius_m } => Some(radius_m),
        ElectrodeShape::Arc { length_m } => Some(length_m),
        ElectrodeShape::Point | ElectrodeShape::Group => None,
    });
    let smallest_m = size_m.fold(f64::INFINITY, f64::min);
    MeshOptions {
        max_edge_m,
        // Five edges per radius resolve the current crowding at a disc's outline on the paper's skin.
        electrode_edge_m: given(|t| t.electrode_edge_m.as_ref())
            .unwrap_or_else(|| (smallest_m / 5.0).min(max_edge_m / 4.0)),
        growth: given(|t| t.growth.as_ref()).unwrap_or(0.3),
        correct_arc_ends: table.and_then(|t| t.correct_arc_ends).unwrap_or(true),
    }
}

/// Where a key is given in the table that begins at a place in the text.
fn key_span(text: &str, from: usize, key: &str) -> Option<Range<usize>> {
    let mut start = from;
    for line in text[from..].split_inclusive('\n') {
        if start > from && line.trim_start().starts_with('[') {
            break;
        }
        // What follows a hash is a comment: no value of the table is a text.
        let told = line.split('#').next().unwrap_or_default();
        let is_key = |at: usize| {
            let before = told[..at].trim_end();
            (before.is_empty() || before.ends_with(['{', ','])) && told[at + key.len()..].trim_start().starts_with('=')
        };
        if let Some(at) = told.match_indices(key).map(|(at, _)| at).find(|&at| is_key(at)) {
            return Some(start + at..start + at + key.len());
        }
        start += line.len();
    }
    None
}

/// A fiftieth of the side of a square with the body's area: 6 mm on the paper's skin.
fn default_edge_m(body: &Body) -> f64 {
    // The mesh of a file keeps its own edges.
    body.chart().map_or(f64::INFINITY, |chart| chart.area_m2().sqrt() / 50.0)
}

impl From<ShapeTable> for ElectrodeShape {
    fn from(table: ShapeTable) -> Self {
        match table {
            ShapeTable::Disc { radius_m } => ElectrodeShape::Disc { radius_m },
            ShapeTable::Arc { length_m } => ElectrodeShape::Arc { length_m },
            ShapeTable::Point => ElectrodeShape::Point,
            ShapeTable::Group => ElectrodeShape::Group,
        }
    }
}
