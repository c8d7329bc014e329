//! Gmsh .msh files of versions 2.2 and 4.1, ASCII and binary
//! (Geuzaine and Remacle, Gmsh reference manual, "MSH file format").

use super::cursor::{ByteOrder, Cursor, Problem, quote};
use crate::geom::Point3;
use std::collections::BTreeMap;

/// The element types of a skin's mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    Point,
    Line,
    Triangle,
    Tetrahedron,
}

impl Kind {
    fn from_gmsh(number: i64) -> Result<Self, String> {
        match number {
            15 => Ok(Kind::Point),
            1 => Ok(Kind::Line),
            2 => Ok(Kind::Triangle),
            4 => Ok(Kind::Tetrahedron),
            3 | 5 | 6 | 7 => Err(format!(
                "elements of Gmsh's type {number} (quadrangles, hexahedra, prisms or pyramids) are not supported: \
                 mesh with triangles or tetrahedra"
            )),
            8..=93 => Err(format!(
                "elements of Gmsh's type {number} (higher order) are not supported: mesh with linear elements, \
                 `Mesh.ElementOrder = 1`"
            )),
            _ => Err(format!("there is no element of type {number}")),
        }
    }

    pub(super) fn dimension(self) -> usize {
        self as usize
    }

    pub(super) fn corner_count(self) -> usize {
        self as usize + 1
    }
}

/// One element of the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Element {
    pub tag: u64,
    pub kind: Kind,
    /// Tags of its nodes; those beyond its corners are 0.
    pub nodes: [u64; 4],
    /// Its index in [`Gmsh::group_sets`].
    pub group_set: usize,
}

/// The content of a .msh file.
#[derive(Debug, Default)]
pub(super) struct Gmsh {
    /// Positions by tag.
    pub nodes: BTreeMap<u64, Point3>,
    pub elements: Vec<Element>,
    /// Sets of physical tags.
    pub group_sets: Vec<Vec<i64>>,
    /// Names of physical groups by dimension and tag.
    pub names: BTreeMap<(usize, i64), String>,
    /// The set of an entity (dimension and tag) in version 4.1, of a physical tag (dimension 0) in version 2.2.
    set_of: BTreeMap<(i64, i64), usize>,
}

/// The number format of the file.
#[derive(Debug, Clone, Copy)]
enum Coding {
    Text,
    Binary(ByteOrder),
}

/// Numbers of a section, as text or binary.
struct Reader<'a> {
    cursor: Cursor<'a>,
    coding: Coding,
}

impl Reader<'_> {
    fn int(&mut self, what: &str) -> Result<i64, Problem> {
        match self.coding {
            Coding::Text => self.cursor.parse(what),
            Coding::Binary(order) => self.cursor.i32(order, what).map(i64::from),
        }
    }

    fn size(&mut self, what: &str) -> Result<u64, Problem> {
        match self.coding {
            Coding::Text => self.cursor.parse(what),
            Coding::Binary(order) => self.cursor.u64(order, what),
        }
    }

    fn coordinate(&mut self) -> Result<f64, Problem> {
        const WHAT: &str = "a coordinate";
        match self.coding {
            Coding::Text => self.cursor.finite(WHAT),
            Coding::Binary(order) => self.cursor.finite_f64(order, WHAT),
        }
    }

    fn point(&mut self) -> Result<Point3, Problem> {
        Ok([self.coordinate()?, self.coordinate()?, self.coordinate()?])
    }

    /// A count or tag of version 2.2, which writes them as 32-bit integers.
    fn small_size(&mut self, what: &str) -> Result<u64, Problem> {
        let value = self.int(what)?;
        u64::try_from(value).map_err(|_| self.cursor.problem(format!("{what} is {value}")))
    }
}

/// Reads a .msh file.
pub(super) fn read(bytes: &[u8]) -> Result<Gmsh, Problem> {
    let mut reader = Reader { cursor: Cursor::new(bytes), coding: Coding::Text };
    let mut gmsh = Gmsh::default();
    let mut version = None;
    while !reader.cursor.at_end() {
        let header = reader.cursor.line().unwrap_or_default().trim_ascii();
        let Some(name) = header.strip_prefix(b"$") else {
            let message = match version {
                None => "a Gmsh file starts with $MeshFormat".to_string(),
                Some(_) => format!("expected the start of a section, not {}", quote(header)),
            };
            return Err(reader.cursor.problem(message));
        };
        let end = [b"$End", name].concat();
        match (name, version) {
            (b"MeshFormat", None) => version = Some(mesh_format(&mut reader)?),
            (b"Comments", None) if reader.cursor.skip_past(&end) => continue,
            (_, None) => return Err(reader.cursor.problem("a Gmsh file starts with $MeshFormat")),
            (b"PhysicalNames", _) => physical_names(&mut reader.cursor, &mut gmsh)?,
            (b"Entities", Some(4)) => entities(&mut reader, &mut gmsh)?,
            (b"Nodes", Some(4)) => nodes_4(&mut reader, &mut gmsh)?,
            (b"Nodes", _) => nodes_2(&mut reader, &mut gmsh)?,
            (b"Elements", Some(4)) => elements_4(&mut reader, &mut gmsh)?,
            (b"Elements", _) => elements_2(&mut reader, &mut gmsh)?,
            (b"PartitionedEntities", _) => {
                return Err(reader.cursor.problem("a partitioned mesh is not supported: save it unpartitioned"));
            }
            _ if reader.cursor.skip_past(&end) => continue,
            _ => return Err(Problem(format!("the file ends within the section {}", quote(header)))),
        }
        let word = reader.cursor.word();
        if word != end {
            let message = format!("expected {} where {} stands: does the count fit?", quote(&end), quote(word));
            return Err(reader.cursor.problem(message));
        }
    }
    if version.is_none() {
        return Err(Problem::new("the file is empty"));
    }
    Ok(gmsh)
}

/// The major version, 2 or 4; also detects the file's encoding.
fn mesh_format(reader: &mut Reader<'_>) -> Result<u8, Problem> {
    let cursor = &mut reader.cursor;
    let version = match cursor.word() {
        b"2.2" | b"2.1" | b"2" => 2,
        b"4.1" => 4,
        other => {
            let message = format!("version {} is not supported: save the mesh as version 4.1 or 2.2", quote(other));
            return Err(cursor.problem(message));
        }
    };
    let binary: u8 = cursor.parse("the file type, 0 or 1")?;
    let size: u8 = cursor.parse("the size of a number")?;
    if size != 8 {
        return Err(cursor.problem(format!("numbers of {size} bytes are not supported, only of 8")));
    }
    cursor.line();
    if binary > 1 {
        return Err(cursor.problem(format!("the file type is {binary}, but only 0 (ASCII) and 1 (binary) exist")));
    }
    if binary == 1 {
        let order = match cursor.take("the byte order")? {
            [1, 0, 0, 0] => ByteOrder::Little,
            [0, 0, 0, 1] => ByteOrder::Big,
            _ => return Err(cursor.problem("the file calls itself binary, but its byte order is not stated")),
        };
        reader.coding = Coding::Binary(order);
    }
    Ok(version)
}

fn physical_names(cursor: &mut Cursor<'_>, gmsh: &mut Gmsh) -> Result<(), Problem> {
    let count: u64 = cursor.parse("the number of physical names")?;
    for _ in 0..count {
        let dimension: usize = cursor.parse("the dimension of a physical group")?;
        let tag: i64 = cursor.parse("the tag of a physical group")?;
        let line = cursor.line().unwrap_or_default().trim_ascii();
        let name = line.strip_prefix(b"\"").and_then(|rest| rest.strip_suffix(b"\""));
        let Some(name) = name.and_then(|name| std::str::from_utf8(name).ok()) else {
            return Err(cursor.problem(format!("{} is not a name in quotes", quote(line))));
        };
        if gmsh.names.insert((dimension, tag), name.to_string()).is_some() {
            return Err(cursor.problem(format!("the physical group {tag} of dimension {dimension} has two names")));
        }
    }
    Ok(())
}

fn entities(reader: &mut Reader<'_>, gmsh: &mut Gmsh) -> Result<(), Problem> {
    let mut counts = [0; 4];
    for count in &mut counts {
        *count = reader.size("the number of entities")?;
    }
    for (dimension, &count) in counts.iter().enumerate() {
        for _ in 0..count {
            let tag = reader.int("the tag of an entity")?;
            for _ in 0..if dimension == 0 { 3 } else { 6 } {
                reader.coordinate()?;
            }
            let mut groups = Vec::new();
            for _ in 0..reader.size("the number of physical groups")? {
                // A minus sign only means that the entity is reversed.
                groups.push(reader.int("the tag of a physical group")?.abs());
            }
            if dimension > 0 {
                for _ in 0..reader.size("the number of bounding entities")? {
                    reader.int("the tag of a bounding entity")?;
                }
            }
            gmsh.add_set(dimension as i64, tag, groups);
        }
    }
    Ok(())
}

fn nodes_2(reader: &mut Reader<'_>, gmsh: &mut Gmsh) -> Result<(), Problem> {
    // The counts are text even in binary files.
    let count: u64 = reader.cursor.parse("the number of nodes")?;
    reader.cursor.line();
    for _ in 0..count {
        let tag = reader.small_size("the tag of a node")?;
        let position = reader.point()?;
        gmsh.add_node(&reader.cursor, tag, position)?;
    }
    Ok(())
}

fn nodes_4(reader: &mut Reader<'_>, gmsh: &mut Gmsh) -> Result<(), Problem> {
    let block_count = reader.size("the number of blocks of nodes")?;
    for what in ["the number of nodes", "the smallest tag of a node", "the largest tag of a node"] {
        reader.size(what)?;
    }
    for _ in 0..block_count {
        let dimension = reader.int("the dimension of an entity")?;
        reader.int("the tag of an entity")?;
        let parameter_count = if reader.int("0 or 1 for parametric nodes")? == 1 { dimension } else { 0 };
        let mut tags = Vec::new();
        for _ in 0..reader.size("the number of nodes in a block")? {
            tags.push(reader.size("the tag of a node")?);
        }
        for tag in tags {
            let position = reader.point()?;
            for _ in 0..parameter_count.min(3) {
                reader.coordinate()?;
            }
            gmsh.add_node(&reader.cursor, tag, position)?;
        }
    }
    Ok(())
}

fn elements_2(reader: &mut Reader<'_>, gmsh: &mut Gmsh) -> Result<(), Problem> {
    let count: u64 = reader.cursor.parse("the number of elements")?;
    reader.cursor.line();
    let mut read = 0;
    while read < count {
        // Binary files have one header for several elements of one type, text files one for each.
        let (first_tag, number, block, tag_count);
        match reader.coding {
            Coding::Text => {
                first_tag = Some(reader.small_size("the tag of an element")?);
                number = reader.int("the type of an element")?;
                block = 1;
                tag_count = reader.small_size("the number of an element's tags")?;
            }
            Coding::Binary(_) => {
                first_tag = None;
                number = reader.int("the type of an element")?;
                block = reader.small_size("the number of elements in a block")?;
                tag_count = reader.small_size("the number of an element's tags")?;
            }
        }
        let kind = Kind::from_gmsh(number).map_err(|message| reader.cursor.problem(message))?;
        for _ in 0..block {
            let tag = match first_tag {
                Some(tag) => tag,
                None => reader.small_size("the tag of an element")?,
            };
            let mut group = 0;
            for k in 0..tag_count {
                let value = reader.int("the tag of a physical group")?;
                if k == 0 {
                    group = value.abs();
                }
            }
            let mut nodes = [0; 4];
            for node in &mut nodes[..kind.corner_count()] {
                *node = reader.small_size("the tag of a node")?;
            }
            let group_set = gmsh.set_of_group(group);
            gmsh.elements.push(Element { tag, kind, nodes, group_set });
        }
        read += block;
    }
    Ok(())
}

fn elements_4(reader: &mut Reader<'_>, gmsh: &mut Gmsh) -> Result<(), Problem> {
    let block_count = reader.size("the number of blocks of elements")?;
    for what in ["the number of elements", "the smallest tag of an element", "the largest tag of an element"] {
        reader.size(what)?;
    }
    for _ in 0..block_count {
        let dimension = reader.int("the dimension of an entity")?;
        let entity = reader.int("the tag of an entity")?;
        let number = reader.int("the type of an element")?;
        let kind = Kind::from_gmsh(number).map_err(|message| reader.cursor.problem(message))?;
        let group_set = match gmsh.set_of.get(&(dimension, entity)) {
            Some(&set) => set,
            None => gmsh.add_set(dimension, entity, Vec::new()),
        };
        for _ in 0..reader.size("the number of elements in a block")? {
            let tag = reader.size("the tag of an element")?;
            let mut nodes = [0; 4];
            for node in &mut nodes[..kind.corner_count()] {
                *node = reader.size("the tag of a node")?;
            }
            gmsh.elements.push(Element { tag, kind, nodes, group_set });
        }
    }
    Ok(())
}

impl Gmsh {
    fn add_node(&mut self, cursor: &Cursor<'_>, tag: u64, position: Point3) -> Result<(), Problem> {
        match self.nodes.insert(tag, position) {
            None => Ok(()),
            Some(_) => Err(cursor.problem(format!("node {tag} stands in the file twice"))),
        }
    }

    fn add_set(&mut self, dimension: i64, tag: i64, groups: Vec<i64>) -> usize {
        self.group_sets.push(groups);
        self.set_of.insert((dimension, tag), self.group_sets.len() - 1);
        self.group_sets.len() - 1
    }

    /// The set of a single physical tag of version 2.2, where 0 means none.
    fn set_of_group(&mut self, group: i64) -> usize {
        match self.set_of.get(&(0, group)) {
            Some(&set) => set,
            None => self.add_set(0, group, if group == 0 { Vec::new() } else { vec![group] }),
        }
    }
}
