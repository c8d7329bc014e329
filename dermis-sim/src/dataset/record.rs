//! The record of a dataset, written into its folder at the start.

use crate::dataset::error::DatasetError;
use crate::dataset::file::{Label, Tensor};
use crate::dataset::generator::Generator;
use crate::dataset::recipe::{Recipe, Touch};
use crate::dataset::sample::TOUCH_COLUMNS;
use dermis::design::{DesignError, SkinDesign};
use dermis::linalg::SimdLevel;
use dermis::text::hexadecimal;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Number of samples per file, for any total number: the last file may contain fewer.
pub(crate) const SAMPLES_PER_FILE: u64 = 8192;

/// The version of the format of a dataset's files; other versions are not read.
const FORMAT: &str = "dermis dataset 2";

/// All parameters that determine the bytes of a dataset. It is written as `run.json` when a dataset is started; a run
/// that continues the dataset must have the same record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// "dermis dataset" and the version of the format.
    pub(crate) format: String,
    /// The version of this library.
    pub(crate) version: String,
    /// The instruction set: the values of different ones differ by rounding.
    pub(crate) cpu: SimdLevel,
    /// The design.
    pub design: DesignRecord,
    /// The mesh.
    pub mesh: MeshRecord,
    /// SHA-256 of the protocol as a channel table.
    pub(crate) protocol_sha256: String,
    /// The recipe of the samples.
    pub recipe: Recipe,
    /// Number of samples in each file except the last.
    pub(crate) samples_per_file: u64,
    /// The tensors of each file, in the order of the file.
    pub(crate) tensors: Vec<TensorRecord>,
    /// The pixels of an image.
    pub(crate) pixels: PixelRecord,
}

/// A design with its complete text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DesignRecord {
    /// Its name.
    pub name: String,
    /// SHA-256 of its text.
    pub(crate) sha256: String,
    /// The text of its file.
    pub(crate) text: String,
}

/// The mesh on which the samples were solved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshRecord {
    /// Its fingerprint, [`Mesh::hash`](dermis::mesh::Mesh::hash).
    pub hash: String,
    /// Number of nodes.
    pub(crate) nodes: usize,
    /// Number of cells.
    pub(crate) cells: usize,
}

/// A tensor in the files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TensorRecord {
    /// Its name.
    pub(crate) name: String,
    /// Its rows in a file: `n`, one per sample, or `1`, one for all.
    pub(crate) rows: String,
    /// The shape of a row.
    pub(crate) shape: Vec<usize>,
    /// Its content, with the unit.
    pub(crate) holds: String,
}

/// The pixels of an image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelRecord {
    /// Rows and columns of the grid; none if each cell of the mesh is a pixel.
    pub(crate) grid: Option<[usize; 2]>,
    /// Index in the grid, row-major, of each pixel; none if all of them exist, in order.
    pub(crate) positions: Option<Vec<usize>>,
}

/// The tensors' names.
pub(super) const REST: &str = "rest";
pub(super) const FRAMES: &str = "frames";
pub(super) const IMAGES: &str = "images";
pub(super) const TOUCHES: &str = "touches";

impl Record {
    /// The record of the output of a generator from a design with the file text `design_text`.
    pub fn new(generator: &Generator, design_name: &str, design_text: &str) -> Self {
        let forward = generator.forward();
        let mesh = forward.mesh();
        let space = generator.pixels();
        let full = space.position_in_grid.iter().enumerate().all(|(index, &position)| index == position);
        let complete = full && space.grid.is_none_or(|[rows, columns]| rows * columns == space.len());
        Record {
            format: FORMAT.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            cpu: SimdLevel::best(),
            design: DesignRecord {
                name: design_name.into(),
                sha256: sha256(design_text.as_bytes()),
                text: design_text.into(),
            },
            mesh: MeshRecord { hash: mesh.hash(), nodes: mesh.node_count(), cells: mesh.cell_count() },
            protocol_sha256: forward.protocol().sha256(),
            recipe: generator.recipe().clone(),
            samples_per_file: SAMPLES_PER_FILE,
            tensors: tensor_records(generator),
            pixels: PixelRecord { grid: space.grid, positions: (!complete).then(|| space.position_in_grid.clone()) },
        }
    }

    /// The content of the record's file.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let mut text = serde_json::to_string_pretty(self).expect("a record is JSON");
        text.push('\n');
        text.into_bytes()
    }

    /// The record in a folder.
    ///
    /// # Errors
    /// A folder without one; a file that is not a record.
    pub fn read(folder: &Path) -> Result<Self, DatasetError> {
        let path = Self::path(folder);
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Err(DatasetError::NoRecord { path }),
            Err(source) => return Err(DatasetError::Io { path, source }),
        };
        let wrong = |message: String| DatasetError::File { path: path.clone(), message };
        let value: Value = serde_json::from_slice(&bytes).map_err(|error| wrong(format!("no JSON: {error}")))?;
        if value["format"] != FORMAT {
            return Err(wrong(format!("its format is {}, not \"{FORMAT}\"", value["format"])));
        }
        serde_json::from_slice(&bytes).map_err(|error| wrong(format!("no record of a dataset: {error}")))
    }

    /// The path of the record in a folder.
    pub(super) fn path(folder: &Path) -> PathBuf {
        folder.join("run.json")
    }

    /// The dataset's identity: SHA-256 of the record.
    pub(crate) fn identity(&self) -> String {
        sha256(&self.to_bytes())
    }

    /// Refuses a record at `path` that differs from this one.
    pub(super) fn check_same(&self, asked: &Record, path: &Path) -> Result<(), DatasetError> {
        let value = |record: &Record| serde_json::to_value(record).expect("a record is JSON");
        match first_difference("", &value(self), &value(asked)) {
            None => Ok(()),
            Some((field, there, asked)) => {
                Err(DatasetError::Mismatch { path: path.to_path_buf(), field, there, asked })
            }
        }
    }

    /// Refuses a design whose text differs from that of the dataset.
    ///
    /// # Errors
    /// Another text.
    pub fn check_design(&self, folder: &Path, design_text: &str) -> Result<(), DatasetError> {
        let asked = sha256(design_text.as_bytes());
        if asked == self.design.sha256 {
            return Ok(());
        }
        let (path, there) = (Self::path(folder), self.design.sha256.clone());
        Err(DatasetError::Mismatch { path, field: "design.sha256".into(), there, asked })
    }

    /// The table of the design in which it differs from another one, so that its frames are not those of that skin; bodies are
    /// compared by their meshes.
    ///
    /// # Errors
    /// A text that is no design.
    pub fn other_table(&self, design: &SkinDesign) -> Result<Option<&'static str>, DesignError> {
        let own = SkinDesign::parse(&self.design.text, &self.design.name)?;
        // Places of electrodes that are groups of a mesh file are not numbers, and equal no other.
        let tables = |design: &SkinDesign| {
            let SkinDesign { sheet, electrodes, protocol, image, mesh, .. } = design;
            [
                format!("{sheet:?}"),
                format!("{electrodes:?}"),
                format!("{protocol:?}"),
                format!("{image:?}"),
                format!("{mesh:?}"),
            ]
        };
        let names = ["sheet", "electrodes", "protocol", "image", "mesh"];
        let mut pairs = names.into_iter().zip(tables(&own).into_iter().zip(tables(design)));
        Ok(pairs.find(|(_, (own, other))| own != other).map(|(name, _)| name))
    }

    /// Number of files.
    pub fn file_count(&self) -> u64 {
        self.recipe.samples.div_ceil(self.samples_per_file)
    }

    /// Samples of a file.
    pub(super) fn samples_of(&self, file: u64) -> usize {
        let first = file * self.samples_per_file;
        // A file contains few samples.
        self.samples_per_file.min(self.recipe.samples - first) as usize
    }

    /// Names and shapes of a file's tensors.
    pub(super) fn shapes(&self, file: u64) -> Vec<(&str, Vec<usize>)> {
        let shape = |tensor: &TensorRecord| {
            let rows = if tensor.rows == "1" { 1 } else { self.samples_of(file) };
            std::iter::once(rows).chain(tensor.shape.iter().copied()).collect()
        };
        self.tensors.iter().map(|tensor| (tensor.name.as_str(), shape(tensor))).collect()
    }

    /// The required label of a file, without its checksum.
    pub(super) fn label(&self, identity: &str, file: u64) -> Label {
        let first_sample = file * self.samples_per_file;
        Label { dataset: identity.into(), first_sample, sha256: "0".repeat(64) }
    }

    /// Memory for the tensors of a file.
    pub(super) fn tensors(&self, file: u64) -> Vec<Tensor> {
        let tensor = |(name, shape): (&str, Vec<usize>)| Tensor {
            name: name.to_string(),
            values: vec![0.0; shape.iter().product()],
            shape,
        };
        self.shapes(file).into_iter().map(tensor).collect()
    }
}

/// The name of a file.
pub(super) fn file_name(file: u64) -> String {
    format!("samples-{file:05}.safetensors")
}

pub(super) fn sha256(bytes: &[u8]) -> String {
    hexadecimal(&dermis::files::sha256(bytes))
}

fn tensor_records(generator: &Generator) -> Vec<TensorRecord> {
    let record = |name: &str, rows: &str, shape: Vec<usize>, holds: String| TensorRecord {
        name: name.into(),
        rows: rows.into(),
        shape,
        holds,
    };
    let (channels, pixels) = (generator.channel_count(), generator.pixel_count());
    let most = generator.recipe().most_touches();
    let columns = match &generator.recipe().touch {
        Touch::Gaussian(_) => "x_m, y_m, z_m, width_m, amplitude, strength_m2",
        Touch::Patch(_) => "x_m, y_m, z_m, tip_radius_m, force_n, strength_m2",
    };
    let rest_rows = if generator.has_own_rest() { "n" } else { "1" };
    vec![
        record(REST, rest_rows, vec![channels], "the untouched frame of the same skin, ohm".into()),
        record(FRAMES, "n", vec![channels], "the frame while the touches last, ohm".into()),
        record(IMAGES, "n", vec![pixels], "mean relative change of conductance of each pixel, touches positive".into()),
        record(TOUCHES, "n", vec![most, TOUCH_COLUMNS], format!("the touches: {columns}; NaN after the last")),
    ]
}

/// The first place where two values differ, with both values.
fn first_difference(at: &str, there: &Value, asked: &Value) -> Option<(String, String, String)> {
    if there == asked {
        return None;
    }
    if let (Value::Object(left), Value::Object(right)) = (there, asked) {
        let keys: std::collections::BTreeSet<&String> = left.keys().chain(right.keys()).collect();
        let inner = |key: &&String| if at.is_empty() { (*key).clone() } else { format!("{at}.{key}") };
        return keys.iter().find_map(|key| {
            let of = |map: &serde_json::Map<String, Value>| map.get(*key).cloned().unwrap_or(Value::Null);
            first_difference(&inner(key), &of(left), &of(right))
        });
    }
    Some((at.to_string(), there.to_string(), asked.to_string()))
}
