//! The problems for the comparison of programs.

use dermis::design::{Body, ImageLayout, SkinDesign};
use dermis::forward::ForwardModel;
use dermis::image::PixelSpace;
use dermis::linalg::LANES;
use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use dermis::protocol::{Channel, Protocol};
use dermis_sim::random::{sample_rng, standard_normal};
use std::collections::HashMap;
use std::error::Error;
use std::path::Path;

/// Number of conductivities per problem: enough that no program gets the same one twice in a row.
const CONDUCTIVITY_COUNT: usize = LANES;
/// Standard deviation of the logarithm of a cell's conductance: values from about half to about twice the rest value.
const LOG_SPREAD: f64 = 0.3;

/// A forward model, its pixels and the conductivities to solve.
pub struct Problem {
    pub model: ForwardModel,
    pub pixels: PixelSpace,
    pub conductivities: Vec<Vec<f64>>,
}

impl Problem {
    pub fn named(case: &str) -> Result<Self, Box<dyn Error>> {
        let without_points = case.strip_suffix("-points");
        let mut skin = match without_points.unwrap_or(case) {
            "disk30" => disk30()?,
            "disk30-20k" => disk30()?.quartered(),
            "cylinder30" => cylinder30(1.0, 1.0)?,
            "cylinder30-20k" => cylinder30(0.475, 1.0)?,
            _ => return Err(format!("no problem is called `{case}`").into()),
        };
        if without_points.is_some() {
            skin.mesh.electrodes = skin.centre_nodes.iter().map(|&node| ElectrodePatch::Node(node)).collect();
        }
        Self::of_skin(&skin)
    }

    /// The shipped skin on a mesh with edges `edges` times as long, which grow `growth` times as fast.
    pub fn cylinder(edges: f64, growth: f64) -> Result<Self, Box<dyn Error>> {
        Self::of_skin(&cylinder30(edges, growth)?)
    }

    /// The conductivities, one in each lane.
    pub fn batch(&self) -> Vec<[f64; LANES]> {
        (0..self.model.mesh().cell_count())
            .map(|cell| std::array::from_fn(|lane| self.conductivities[lane][cell]))
            .collect()
    }

    fn of_skin(skin: &Skin) -> Result<Self, Box<dyn Error>> {
        let model = ForwardModel::from_parts(&skin.mesh, &skin.contact_impedances, &skin.protocol, &skin.rest)?;
        let pixels = PixelSpace::for_design(&skin.imaging, &skin.mesh)?;
        let conductivities = (0..CONDUCTIVITY_COUNT as u64).map(|index| varied(&skin.rest, index)).collect();
        Ok(Problem { model, pixels, conductivities })
    }
}

struct Skin {
    mesh: Mesh,
    contact_impedances: Vec<f64>,
    protocol: Protocol,
    rest: Vec<f64>,
    /// The positions of the point electrodes that replace the area electrodes.
    centre_nodes: Vec<usize>,
    /// A design whose body and image are those of the mesh.
    imaging: SkinDesign,
}

fn varied(rest: &[f64], index: u64) -> Vec<f64> {
    let mut rng = sample_rng(30, index);
    rest.iter().map(|value| value * (LOG_SPREAD * standard_normal(&mut rng)).exp()).collect()
}

impl Skin {
    /// The same with every triangle split into four at the midpoints of its edges.
    fn quartered(mut self) -> Self {
        let Cells::Triangles(triangles) = &self.mesh.cells else { return self };
        let nodes = &mut self.mesh.nodes;
        let mut middles = HashMap::new();
        let mut middle = |a: usize, b: usize| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                nodes.push(std::array::from_fn(|axis| 0.5 * (nodes[a][axis] + nodes[b][axis])));
                nodes.len() - 1
            })
        };
        let mut quarters = Vec::with_capacity(4 * triangles.len());
        for &[a, b, c] in triangles {
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            quarters.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        for patch in &mut self.mesh.electrodes {
            if let ElectrodePatch::Edges(edges) = patch {
                *edges = edges.iter().flat_map(|&[a, b]| [[a, middle(a, b)], [middle(a, b), b]]).collect();
            }
        }
        self.mesh.cells = Cells::Triangles(quarters);
        self.rest = self.rest.iter().flat_map(|&rest| [rest; 4]).collect();
        self
    }
}

/// The shipped skin on a mesh with edges `edges` times as long, which grow `growth` times as fast.
fn cylinder30(edges: f64, growth: f64) -> Result<Skin, Box<dyn Error>> {
    let mut design = SkinDesign::load("cylinder30")?;
    design.mesh.max_edge_m *= edges;
    design.mesh.electrode_edge_m *= edges;
    design.mesh.growth *= growth;
    let mesh = Mesh::generate(&design)?;
    let nearest = |centre: [f64; 3]| {
        let squared = |node: usize| (0..3).map(|axis| (mesh.nodes[node][axis] - centre[axis]).powi(2)).sum::<f64>();
        (0..mesh.node_count()).min_by(|&a, &b| squared(a).total_cmp(&squared(b))).expect("a mesh has nodes")
    };
    Ok(Skin {
        contact_impedances: design.electrodes.iter().map(|electrode| electrode.contact_impedance).collect(),
        protocol: design.protocol.clone(),
        rest: vec![design.sheet.conductance; mesh.cell_count()],
        centre_nodes: design.electrodes.iter().map(|electrode| nearest(electrode.centre_m)).collect(),
        imaging: design,
        mesh,
    })
}

/// The reference disk: `data/reference/disk30_5k`.
fn disk30() -> Result<Skin, Box<dyn Error>> {
    let rows = |name: &str| -> Result<Vec<Vec<f64>>, Box<dyn Error>> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/reference/disk30_5k").join(name);
        let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let numbers = |line: &str| line.split(',').map(|field| field.trim().parse::<f64>()).collect::<Result<_, _>>();
        let is_header = |line: &&str| line.starts_with(|first: char| first.is_ascii_alphabetic());
        Ok(text.lines().filter(|line| !is_header(line)).map(numbers).collect::<Result<_, _>>()?)
    };
    let pairs = |name: &str| -> Result<Vec<[usize; 2]>, Box<dyn Error>> {
        Ok(rows(name)?.iter().map(|row| [row[0] as usize, row[1] as usize]).collect())
    };
    let mut edges = vec![Vec::new(); 30];
    for row in rows("electrode_edges.csv")? {
        edges[row[0] as usize].push([row[1] as usize, row[2] as usize]);
    }
    let triangles: Vec<[usize; 3]> =
        rows("tris.csv")?.iter().map(|row| [row[0] as usize, row[1] as usize, row[2] as usize]).collect();
    let (drives, measures) = (pairs("inj.csv")?, pairs("meas.csv")?);
    let channels =
        drives.iter().flat_map(|&drive| measures.iter().map(move |&measure| Channel { drive, measure })).collect();
    let mut imaging = SkinDesign::load("skin16")?;
    imaging.body = Body::Disk { diameter_m: 2.0 };
    imaging.image = ImageLayout::Grid { rows: 30, columns: 30 };
    Ok(Skin {
        rest: vec![1.0; triangles.len()],
        centre_nodes: rows("electrode_centre_node.csv")?.iter().map(|row| row[0] as usize).collect(),
        contact_impedances: vec![0.01; 30],
        protocol: Protocol::new(30, channels)?,
        mesh: Mesh {
            nodes: rows("nodes.csv")?.iter().map(|row| [row[0], row[1], 0.0]).collect(),
            cells: Cells::Triangles(triangles),
            electrodes: edges.into_iter().map(ElectrodePatch::Edges).collect(),
            regions: Vec::new(),
        },
        imaging,
    })
}
