//! Reference meshes and numbers from independent programs (see `data/README.md`).

use dermis::forward::{ForwardModel, Matrix};
use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use dermis::protocol::{Channel, Protocol};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::PathBuf;

/// One reference case: mesh, contact impedances, drives and channels.
pub struct Reference {
    pub folder: PathBuf,
    pub mesh: Mesh,
    pub contact_impedances: Vec<f64>,
    pub protocol: Protocol,
    /// Current of a drive, A, negative if the reference drives in the opposite direction.
    pub current_a: f64,
}

pub fn path(name: &str) -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../data/reference")).join(name)
}

/// Numbers of a CSV file, row by row, a header skipped; `.gz` is unpacked.
pub fn table(path: &std::path::Path) -> Vec<Vec<f64>> {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut text = String::new();
    if path.extension().is_some_and(|extension| extension == "gz") {
        flate2::read::GzDecoder::new(&bytes[..]).read_to_string(&mut text).expect("gzip");
    } else {
        text = String::from_utf8(bytes).expect("UTF-8");
    }
    text.lines()
        .filter(|line| !line.is_empty() && !line.starts_with(|c: char| c.is_ascii_alphabetic()))
        .map(|line| line.split(',').map(|field| field.trim().parse().expect("a number")).collect())
        .collect()
}

impl Reference {
    pub fn disk16() -> Self {
        Self::eidors("disk16", &[0.01; 16], 1.0)
    }

    pub fn sheet25() -> Self {
        Self::eidors("sheet25", &[1e-3; 25], 1e-3)
    }

    /// `currents` of the drives are `-current_a` at electrode k and `+current_a` at the next.
    fn eidors(name: &str, contact_impedances: &[f64], current_a: f64) -> Self {
        let folder = path(name);
        let drives: Vec<[usize; 2]> = table(&folder.join("stim_currents.csv"))
            .iter()
            .map(|row| {
                let find = |sign: f64| row.iter().position(|current| current * sign > 0.0).expect("a driven electrode");
                [find(1.0), find(-1.0)]
            })
            .collect();
        let channels: Vec<Channel> = table(&folder.join("meas.csv"))
            .iter()
            .map(|row| Channel { drive: drives[row[0] as usize], measure: [row[1] as usize, row[2] as usize] })
            .collect();
        let meta: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(folder.join("meta.json")).expect("meta.json")).expect("JSON");
        let mut edges: BTreeMap<usize, Vec<[usize; 2]>> = BTreeMap::new();
        for row in table(&folder.join("electrode_faces.csv")) {
            edges.entry(row[0] as usize).or_default().push([row[1] as usize, row[2] as usize]);
        }
        let electrodes = (0..contact_impedances.len())
            .map(|electrode| match meta["electrodes"][electrode]["nodes"].as_u64() {
                Some(node) => ElectrodePatch::Node(node as usize),
                None => ElectrodePatch::Edges(edges[&electrode].clone()),
            })
            .collect();
        let mesh = flat_mesh(&folder.join("nodes.csv"), &folder.join("elems.csv"), electrodes);
        let protocol = Protocol::new(contact_impedances.len(), channels).expect("a protocol");
        Reference { folder, mesh, contact_impedances: contact_impedances.to_vec(), protocol, current_a }
    }

    pub fn disk30() -> Self {
        let folder = path("disk30_5k");
        let pairs = |name: &str| -> Vec<[usize; 2]> {
            table(&folder.join(name)).iter().map(|row| [row[0] as usize, row[1] as usize]).collect()
        };
        let (drives, measures) = (pairs("inj.csv"), pairs("meas.csv"));
        let channels =
            drives.iter().flat_map(|&drive| measures.iter().map(move |&measure| Channel { drive, measure })).collect();
        let mut electrodes = vec![Vec::new(); 30];
        for row in table(&folder.join("electrode_edges.csv")) {
            electrodes[row[0] as usize].push([row[1] as usize, row[2] as usize]);
        }
        let electrodes = electrodes.into_iter().map(ElectrodePatch::Edges).collect();
        let mesh = flat_mesh(&folder.join("nodes.csv"), &folder.join("tris.csv"), electrodes);
        let protocol = Protocol::new(30, channels).expect("a protocol");
        Reference { folder, mesh, contact_impedances: vec![0.01; 30], protocol, current_a: 1.0 }
    }

    pub fn column(&self, name: &str) -> Vec<f64> {
        table(&self.folder.join(name)).into_iter().map(|row| row[0]).collect()
    }

    pub fn model(&self) -> ForwardModel {
        self.model_with(&self.contact_impedances)
    }

    pub fn model_with(&self, contact_impedances: &[f64]) -> ForwardModel {
        let rest = vec![1.0; self.mesh.cell_count()];
        ForwardModel::from_parts(&self.mesh, contact_impedances, &self.protocol, &rest).expect("a model")
    }

    /// The voltages at a conductivity file, V.
    pub fn voltages(&self, model: &ForwardModel, conductivity: &str) -> Vec<f64> {
        let frame = model.solve(&self.column(conductivity)).expect("a frame");
        frame.iter().map(|value| value * self.current_a).collect()
    }
}

fn flat_mesh(nodes: &std::path::Path, cells: &std::path::Path, electrodes: Vec<ElectrodePatch>) -> Mesh {
    let nodes: Vec<[f64; 3]> = table(nodes).iter().map(|row| [row[0], row[1], 0.0]).collect();
    let cells = table(cells).iter().map(|row| [row[0] as usize, row[1] as usize, row[2] as usize]).collect();
    Mesh { nodes, cells: Cells::Triangles(cells), electrodes, regions: Vec::new() }
}

/// `||a - b|| / ||b||`
pub fn relative_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "lengths");
    let difference: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
    (difference / b.iter().map(|y| y * y).sum::<f64>()).sqrt()
}

pub fn matrix_of(rows: Vec<Vec<f64>>) -> Matrix {
    let (count, columns) = (rows.len(), rows[0].len());
    Matrix { rows: count, columns, values: rows.concat() }
}
