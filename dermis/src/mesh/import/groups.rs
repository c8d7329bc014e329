//! Conversion of the elements and physical groups of a Gmsh file to a mesh with electrodes.

use super::cursor::Problem;
use super::msh::{Element, Gmsh, Kind};
use super::shape::is_flat;
use super::{orient, overlap};
use crate::geom::vector;
use crate::mesh::{Cells, ElectrodePatch, Mesh};
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// A physical group: dimension and tag.
type Group = (usize, i64);

/// The mesh of a Gmsh file. Tetrahedra make a volume, whose triangles are only faces of electrodes; without tetrahedra
/// the triangles make a surface. Nodes and cells are in the order of their tags; nodes of no cell and duplicate
/// elements are dropped. Also returns the number of cells whose corners were reordered.
pub(super) fn mesh(gmsh: &Gmsh, unit_m: f64) -> Result<(Mesh, usize), Problem> {
    let cell_kind = match gmsh.elements.iter().map(|element| element.kind).max() {
        Some(kind @ (Kind::Triangle | Kind::Tetrahedron)) => kind,
        _ => return Err(Problem::new("the file has neither triangles nor tetrahedra")),
    };
    let elements = Elements::new(gmsh);
    let index_of_node = used_nodes(gmsh, elements.of_kind(cell_kind))?;
    let corners = |element: &Element, k: usize| index_of_node[&element.nodes[k]];
    let cells = elements.of_kind(cell_kind);
    let indexed = match cell_kind {
        Kind::Tetrahedron => Cells::Tetrahedra(cells.iter().map(|e| [0, 1, 2, 3].map(|k| corners(e, k))).collect()),
        _ => Cells::Triangles(cells.iter().map(|e| [0, 1, 2].map(|k| corners(e, k))).collect()),
    };
    let mut mesh = Mesh {
        nodes: index_of_node.keys().map(|tag| vector::scale(gmsh.nodes[tag], unit_m)).collect(),
        cells: indexed,
        electrodes: Vec::new(),
        regions: regions(gmsh, &elements, cell_kind),
    };
    check_positions(&mesh)?;
    if let Some(cell) = (0..mesh.cell_count()).find(|&cell| is_flat(&mesh, cell)) {
        let corners: Vec<_> = mesh.cells.corners(cell).iter().map(|&node| mesh.nodes[node]).collect();
        let what = if cell_kind == Kind::Triangle { "area" } else { "volume" };
        return Err(Problem(format!("element {} with the corners {corners:?} m has no {what}", cells[cell].tag)));
    }
    let reordered = order_corners(&mut mesh, cells)?;
    mesh.electrodes = electrodes(gmsh, &elements, cell_kind, &index_of_node, &mesh)?;
    Ok((mesh, reordered))
}

fn check_positions(mesh: &Mesh) -> Result<(), Problem> {
    match mesh.nodes.iter().find(|node| node.iter().any(|x| !x.is_finite())) {
        Some(node) => Err(Problem(format!("a node is at {node:?} m, too far to compute with"))),
        None => Ok(()),
    }
}

/// Gives the cells the corner order of [`Cells`], and returns the number of cells that were changed. The order has no
/// meaning for the shape, and example meshes mix it; cells that overlap are an error.
fn order_corners(mesh: &mut Mesh, elements: &[&Element]) -> Result<usize, Problem> {
    match &mut mesh.cells {
        Cells::Tetrahedra(cells) => {
            let is_negative = |cell: &[usize; 4]| vector::tetrahedron_volume(cell.map(|node| mesh.nodes[node])) < 0.0;
            let negative: Vec<usize> = (0..cells.len()).filter(|&cell| is_negative(&cells[cell])).collect();
            if let Some([one, other]) = overlap::overlapping(&mesh.nodes, cells) {
                let [one, other] = [one, other].map(|cell| elements[cell].tag);
                return Err(Problem(format!(
                    "elements {one} and {other} overlap: they lie on the same side of the face between them; mesh the body anew"
                )));
            }
            negative.iter().for_each(|&cell| cells[cell].swap(2, 3));
            Ok(negative.len())
        }
        Cells::Triangles(cells) => {
            let turned = orient::parts(&mesh.nodes, cells)?.into_iter().flatten().filter(|(_, turn)| *turn);
            Ok(turned.map(|(cell, _)| cells[cell].swap(1, 2)).count())
        }
    }
}

/// The distinct elements of a file, each kind in the order of their tags, and the groups that contain them.
struct Elements<'a> {
    of_kind: [Vec<&'a Element>; 4],
    /// Indices into the elements of the group's dimension.
    of_group: BTreeMap<Group, BTreeSet<usize>>,
}

impl<'a> Elements<'a> {
    fn new(gmsh: &'a Gmsh) -> Self {
        let mut in_order: Vec<&Element> = gmsh.elements.iter().collect();
        in_order.sort_by_key(|element| element.tag);
        let mut elements = Elements { of_kind: Default::default(), of_group: BTreeMap::new() };
        let mut known: HashMap<(usize, [u64; 4]), usize> = HashMap::new();
        for element in in_order {
            let dimension = element.kind.dimension();
            let list = &mut elements.of_kind[dimension];
            let mut key = element.nodes;
            key.sort_unstable();
            // Version 2.2 writes an element of several groups several times.
            let index = *known.entry((dimension, key)).or_insert_with(|| {
                list.push(element);
                list.len() - 1
            });
            for &group in &gmsh.group_sets[element.group_set] {
                elements.of_group.entry((dimension, group)).or_default().insert(index);
            }
        }
        elements
    }

    fn of_kind(&self, kind: Kind) -> &[&'a Element] {
        &self.of_kind[kind.dimension()]
    }
}

/// The index of each node of some cell, by its tag.
fn used_nodes(gmsh: &Gmsh, cells: &[&Element]) -> Result<BTreeMap<u64, usize>, Problem> {
    let mut index_of_node = BTreeMap::new();
    for cell in cells {
        for tag in &cell.nodes[..cell.kind.corner_count()] {
            if !gmsh.nodes.contains_key(tag) {
                return Err(Problem(format!("element {} names node {tag}, which the file does not have", cell.tag)));
            }
            index_of_node.insert(*tag, 0);
        }
    }
    for (index, value) in index_of_node.values_mut().enumerate() {
        *value = index;
    }
    Ok(index_of_node)
}

/// The groups of cells that are not electrodes; those without a name are called by their tag.
fn regions(gmsh: &Gmsh, elements: &Elements<'_>, cell_kind: Kind) -> Vec<(String, Vec<usize>)> {
    let dimension = cell_kind.dimension();
    let named = gmsh.names.keys().copied();
    let groups: BTreeSet<Group> = named.chain(elements.of_group.keys().copied()).collect();
    let mut regions: Vec<(String, Vec<usize>)> = Vec::new();
    for group in groups.into_iter().filter(|group| group.0 == dimension) {
        let name = gmsh.names.get(&group).cloned().unwrap_or_else(|| group.1.to_string());
        if name.starts_with(ELECTRODE) || name == UNGROUPED {
            continue;
        }
        let cells = elements.of_group.get(&group).into_iter().flatten().copied();
        match regions.iter_mut().find(|region| region.0 == name) {
            Some(region) => region.1.extend(cells),
            None => regions.push((name, cells.collect())),
        }
    }
    regions
}

/// Prefix of the names of electrodes' groups.
pub(crate) const ELECTRODE: &str = "electrode_";

/// The group of cells without one, as written by [`save`](crate::mesh::export::save); it is not read as a region.
pub(crate) const UNGROUPED: &str = "ungrouped";

fn electrodes(
    gmsh: &Gmsh,
    elements: &Elements<'_>,
    cell_kind: Kind,
    index_of_node: &BTreeMap<u64, usize>,
    mesh: &Mesh,
) -> Result<Vec<ElectrodePatch>, Problem> {
    let groups = electrode_groups(gmsh)?;
    let sides = Sides::new(mesh);
    let mut patches = Vec::new();
    for (&number, &group) in &groups {
        let name = format!("{ELECTRODE}{number}");
        if number != patches.len() {
            let message = format!(
                "there is a physical group {name}, but none named {ELECTRODE}{}: electrodes are numbered from 0 \
                 without a gap",
                patches.len()
            );
            return Err(Problem(message));
        }
        let members: Vec<usize> = elements.of_group.get(&group).into_iter().flatten().copied().collect();
        if members.is_empty() {
            return Err(Problem(format!("the physical group {name} holds no elements")));
        }
        let list = &elements.of_kind[group.0];
        let corners_of = |&member: &usize| {
            let element = list[member];
            let index = |tag: &u64| index_of_node.get(tag).copied();
            element.nodes[..element.kind.corner_count()]
                .iter()
                .map(index)
                .collect::<Option<Vec<usize>>>()
                .ok_or_else(|| Problem(format!("{name}: element {} touches no {}", element.tag, plural(cell_kind))))
        };
        let side = |corners: Vec<usize>| match sides.contains(&corners) {
            true => Ok(corners),
            false => Err(Problem(format!(
                "{name}: the {} between nodes {} does not belong to any of the mesh's {}",
                if corners.len() == 2 { "line" } else { "triangle" },
                corners.iter().map(|node| format!("{:?}", mesh.nodes[*node])).collect::<Vec<_>>().join(", "),
                plural(cell_kind)
            ))),
        };
        let patch = match (group.0, cell_kind) {
            (0, _) if members.len() > 1 => {
                return Err(Problem(format!("{name} holds {} points: a point electrode is one", members.len())));
            }
            (0, _) => ElectrodePatch::Node(corners_of(&members[0])?[0]),
            (1, Kind::Triangle) => {
                let edges = members.iter().map(|member| side(corners_of(member)?).map(|edge| [edge[0], edge[1]]));
                ElectrodePatch::Edges(edges.collect::<Result<_, _>>()?)
            }
            (2, Kind::Triangle) => ElectrodePatch::Cells(members),
            (2, Kind::Tetrahedron) => {
                let faces = members.iter().map(|member| side(corners_of(member)?).map(|f| [f[0], f[1], f[2]]));
                ElectrodePatch::Faces(faces.collect::<Result<_, _>>()?)
            }
            (dimension, _) => {
                let message = format!(
                    "{name} is a group of {} in a mesh of {}: make it a group of {} or a point",
                    ["points", "lines", "triangles", "tetrahedra"].get(dimension).unwrap_or(&"unknown elements"),
                    plural(cell_kind),
                    if cell_kind == Kind::Triangle { "triangles, of lines" } else { "triangles on its outside" },
                );
                return Err(Problem(message));
            }
        };
        patches.push(patch);
    }
    Ok(patches)
}

/// The group of each electrode by its number.
fn electrode_groups(gmsh: &Gmsh) -> Result<BTreeMap<usize, Group>, Problem> {
    let mut groups = BTreeMap::new();
    for (&group, name) in &gmsh.names {
        let Some(digits) = name.strip_prefix(ELECTRODE) else { continue };
        let Some(number) = digits.parse().ok().filter(|_| digits.bytes().all(|byte| byte.is_ascii_digit())) else {
            let message = format!("the physical group `{}` has no electrode's number after the _", name.escape_debug());
            return Err(Problem(message));
        };
        if groups.insert(number, group).is_some() {
            return Err(Problem(format!("there are two physical groups named {ELECTRODE}{number}")));
        }
    }
    Ok(groups)
}

fn plural(kind: Kind) -> &'static str {
    match kind {
        Kind::Triangle => "triangles",
        _ => "tetrahedra",
    }
}

/// The edges of triangles or the outer faces of tetrahedra.
struct Sides(HashMap<Vec<usize>, usize>);

impl Sides {
    fn new(mesh: &Mesh) -> Self {
        let mut count_of = HashMap::new();
        for cell in 0..mesh.cell_count() {
            let corners = mesh.cells.corners(cell);
            for left_out in 0..corners.len() {
                let mut side: Vec<usize> = (0..corners.len()).filter(|&k| k != left_out).map(|k| corners[k]).collect();
                side.sort_unstable();
                *count_of.entry(side).or_insert(0) += 1;
            }
        }
        Sides(count_of)
    }

    /// Whether an electrode can be there: on any edge of a surface, but only on the outer faces of a volume.
    fn contains(&self, corners: &[usize]) -> bool {
        let mut side = corners.to_vec();
        side.sort_unstable();
        self.0.get(&side).is_some_and(|&count| corners.len() == 2 || count == 1)
    }
}
