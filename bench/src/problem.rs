//! The problems that the programs are compared on.

use dermis::design::{Body, ImageLayout, SkinDesign};
use dermis::forward::ForwardModel;
use dermis::image::PixelSpace;
use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use dermis::protocol::{Channel, Protocol};
use dermis::touch::{sample_rng, standard_normal};
use std::error::Error;
use std::path::Path;

/// Conductivities per problem: enough that no program sees the same one twice in a row.
const CONDUCTIVITY_COUNT: usize = 8;
/// Standard deviation of the logarithm of a cell's conductance: values from about a half to about twice the rest.
const LOG_SPREAD: f64 = 0.3;

/// A forward model, its pixels and conductivities to solve it at.
pub struct Problem {
    pub model: ForwardModel,
    pub pixels: PixelSpace,
    pub conductivities: Vec<Vec<f64>>,
}

impl Problem {
    pub fn named(case: &str) -> Result<Self, Box<dyn Error>> {
        let (skin, with_points) = match case.strip_suffix("-points") {
            Some(skin) => (skin, true),
            None => (case, false),
        };
        let mut skin = match skin {
            "disk30" => disk30()?,
            "cylinder30" => cylinder30()?,
            _ => return Err(format!("no problem is called `{case}`").into()),
        };
        if with_points {
            skin.mesh.electrodes = skin.centre_nodes.iter().map(|&node| ElectrodePatch::Node(node)).collect();
        }
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
    /// Where the point electrodes go that stand in for the area electrodes.
    centre_nodes: Vec<usize>,
    /// A design whose body and image are those of the mesh.
    imaging: SkinDesign,
}

fn varied(rest: &[f64], index: u64) -> Vec<f64> {
    let mut rng = sample_rng(30, index);
    rest.iter().map(|value| value * (LOG_SPREAD * standard_normal(&mut rng)).exp()).collect()
}

/// The shipped skin on its own mesh.
fn cylinder30() -> Result<Skin, Box<dyn Error>> {
    let design = SkinDesign::load("cylinder30")?;
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
