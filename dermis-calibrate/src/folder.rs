//! Calibrations on disk: a folder with `calibration.json` and arrays in NPY files, or with `correction.json`.

use crate::calibration::{Calibration, Quality};
use crate::correction::Correction;
use crate::covariance::{Covariance, Extent, PressInput};
use crate::error::CalibrateError;
use crate::fitted::Fitted;
use crate::forward_map::ForwardMap;
use crate::locate::{Locator, Setup};
use crate::pose::Pose;
use crate::region::Region;
use crate::sequence::Realignment;
use crate::strength::Strength;
use crate::units::ChannelUnits;
use dermis::design::SkinDesign;
use dermis::files::read_text_at_most;
use dermis::frame::{Frame, TableError, read_array, write_array, write_whole};
use dermis::text::counted;
use faer::Mat;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Largest card of a calibration, bytes: labels of hundreds of thousands of presses.
const LARGEST_CARD: u64 = 128 << 20;

/// The file by which a folder is known to be a calibration.
const CARD: &str = "calibration.json";
/// The file by which a folder is known to be the correction of a method.
const CORRECTION: &str = "correction.json";
/// The version of the format.
const VERSION: u32 = 2;

/// The contents of `calibration.json`.
#[derive(Serialize, Deserialize)]
struct Card {
    version: u32,
    design: DesignId,
    pose: Option<Pose>,
    units: ChannelUnits,
    realignment: Realignment,
    covariance: Covariance,
    extent: Extent,
    temperature: f64,
    misfit_limit: f64,
    strength: Option<Strength>,
    quality: Quality,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rest: Option<Frame>,
}

/// Which skin a folder belongs to.
#[derive(Debug, Serialize, Deserialize)]
struct DesignId {
    name: String,
    /// [Checksum](SkinDesign::sha256) of its body, electrodes and channels.
    sha256: String,
}

impl DesignId {
    fn of(design: &SkinDesign) -> Self {
        let sha256 = dermis::text::hexadecimal(&design.sha256());
        DesignId { name: design.name.clone(), sha256 }
    }

    /// Refuses another skin; says in what it differs.
    fn check(&self, design: &SkinDesign) -> Result<(), String> {
        let DesignId { name, sha256 } = DesignId::of(design);
        if self.sha256 == sha256 {
            return Ok(());
        }
        Err(if self.name == name {
            format!(
                "the body, the electrodes or the channels of the design `{name}` have changed since: calibrate again"
            )
        } else {
            format!("it was made for the design `{}`, not for `{name}`", self.name)
        })
    }
}

/// What is read first.
#[derive(Deserialize)]
struct Header {
    version: u32,
}

/// Read next.
#[derive(Deserialize)]
struct Owner {
    design: DesignId,
}

/// The contents of `correction.json`.
#[derive(Serialize, Deserialize)]
struct CorrectionCard {
    version: u32,
    design: DesignId,
    /// What the corrected method computes with beside that; cards of before this was stored have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model_sha256: Option<String>,
    correction: Correction,
}

/// The checksum of what a method computes with: sheet, contacts, mesh and image of a design. A correction is of one model.
fn model_sha256(design: &SkinDesign) -> String {
    let SkinDesign { sheet, image, mesh, .. } = design;
    let text = format!("{sheet:?}\n{image:?}\n{mesh:?}\n{:?}", design.contact_impedances());
    dermis::text::hexadecimal(&dermis::files::sha256(text.as_bytes()))
}

impl Correction {
    /// Whether a folder contains the correction of a method.
    pub(crate) fn is_folder(folder: &Path) -> bool {
        folder.join(CORRECTION).is_file()
    }

    /// Writes the correction for a design to a folder, which is created.
    ///
    /// # Errors
    /// A folder or file that cannot be written.
    pub fn save(&self, folder: &Path, design: &SkinDesign) -> Result<(), CalibrateError> {
        begin(folder)?;
        let (design, model_sha256) = (DesignId::of(design), Some(model_sha256(design)));
        let card = CorrectionCard { version: VERSION, design, model_sha256, correction: self.clone() };
        let text = serde_json::to_string_pretty(&card).expect("a card is JSON");
        Ok(write_whole(&folder.join(CORRECTION), |out| out.write_all(text.as_bytes()))?)
    }

    /// Reads the correction for a design from a folder.
    ///
    /// # Errors
    /// A file that is missing, damaged or of another version; a correction of another design.
    pub fn load(folder: &Path, design: &SkinDesign) -> Result<Self, CalibrateError> {
        let path = folder.join(CORRECTION);
        let CorrectionCard { correction, model_sha256: known, .. } = read_card(&path, design)?;
        if known.is_some_and(|known| known != model_sha256(design)) {
            let message = "the sheet, the contact impedances, the mesh or the image of the design have changed since, so that the method that \
                           it corrects computes otherwise: calibrate again";
            return Err(CalibrateError::File { path, message: message.into() });
        }
        let channels = design.protocol.channel_count();
        if !correction.is_consistent() || correction.rest.as_ref().is_some_and(|rest| rest.len() != channels) {
            return Err(CalibrateError::File {
                path,
                message: "its values do not belong together: calibrate again".into(),
            });
        }
        Ok(correction)
    }
}

impl Fitted {
    /// The checksum of the calibration in a folder, hexadecimal: recordings are replayed with the same one.
    ///
    /// # Errors
    /// A card that cannot be read.
    pub(crate) fn sha256(folder: &Path) -> Result<String, CalibrateError> {
        let path = folder.join(if Calibration::is_folder(folder) { CARD } else { CORRECTION });
        // The card has what cross-validation says of all arrays, to the last digit.
        let card = std::fs::read(&path).map_err(|source| CalibrateError::Io { path, source })?;
        Ok(dermis::text::hexadecimal(&dermis::files::sha256(&card)))
    }

    /// Refuses a folder to [write to](Self::save) that holds a network, as it would be two methods then, or a file of another program
    /// with the name of a calibration.
    ///
    /// # Errors
    /// Such a folder.
    pub fn check_folder(folder: &Path) -> Result<(), CalibrateError> {
        let refused = |path, what: &str| {
            let message = format!("{what}: write the calibration to another folder");
            Err(CalibrateError::File { path, message })
        };
        let path = folder.join(NETWORK);
        if path.exists() {
            return refused(path, "the folder is that of a network");
        }
        let is_other = |path: &PathBuf| {
            let text = read_text_at_most(path, LARGEST_CARD);
            path.exists() && !text.is_ok_and(|text| serde_json::from_str::<Header>(&text).is_ok())
        };
        match [CARD, CORRECTION].map(|name| folder.join(name)).into_iter().find(is_other) {
            Some(path) => refused(path, "it is no calibration of this program, and would be lost"),
            None => Ok(()),
        }
    }
}

/// Creates a folder. One that held a calibration holds none until its card is written again.
fn begin(folder: &Path) -> Result<(), CalibrateError> {
    Fitted::check_folder(folder)?;
    let io = |path: &Path, source| CalibrateError::Io { path: path.to_path_buf(), source };
    std::fs::create_dir_all(folder).map_err(|source| io(folder, source))?;
    for card in [CARD, CORRECTION].map(|name| folder.join(name)) {
        match std::fs::remove_file(&card) {
            Err(source) if source.kind() != std::io::ErrorKind::NotFound => return Err(io(&card, source)),
            _ => {}
        }
    }
    Ok(())
}

/// The file by which a folder is known to be a network.
const NETWORK: &str = "card.json";

/// Reads the card of a design, of this version.
fn read_card<T: DeserializeOwned>(path: &Path, design: &SkinDesign) -> Result<T, CalibrateError> {
    let file = |message: String| CalibrateError::File { path: path.to_path_buf(), message };
    let text = read_text_at_most(path, LARGEST_CARD)
        .map_err(|source| CalibrateError::Io { path: path.to_path_buf(), source })?;
    let header: Header = serde_json::from_str(&text).map_err(|error| file(error.to_string()))?;
    if header.version != VERSION {
        let message = format!("its version is {}, but this program reads {VERSION}: calibrate again", header.version);
        return Err(file(message));
    }
    let owner: Owner = serde_json::from_str(&text).map_err(|error| file(error.to_string()))?;
    owner.design.check(design).map_err(file)?;
    serde_json::from_str(&text).map_err(|error| file(error.to_string()))
}

impl Calibration {
    /// Whether the name of a method is that of a folder with a calibration.
    pub fn is_named(method: &str) -> bool {
        dermis::method::is_path(method) && Self::is_folder(Path::new(method))
    }

    /// Whether a folder contains a calibration.
    pub fn is_folder(folder: &Path) -> bool {
        folder.join(CARD).is_file()
    }

    /// Writes the calibration of a design to a folder, which is created.
    ///
    /// # Errors
    /// A folder or file that cannot be written.
    pub fn save(&self, folder: &Path, design: &SkinDesign) -> Result<(), CalibrateError> {
        begin(folder)?;
        let (map, region) = (self.locator.map(), self.locator.region());
        let write = |name: &str, columns: usize, values: &[f64]| {
            write_array(&folder.join(name), "array", &[values.len() / columns, columns], values)
        };
        let row_major = |matrix: &Mat<f64>| -> Vec<f64> {
            (0..matrix.nrows()).flat_map(|i| (0..matrix.ncols()).map(move |j| (i, j))).map(|at| matrix[at]).collect()
        };
        write("weights.npy", map.value_count(), &row_major(&map.weights))?;
        write("whitening.npy", self.locator.component_count(), &row_major(self.locator.whitening()))?;
        write("mean.npy", 1, &map.mean)?;
        let presses = map.inputs.iter().flat_map(|input| {
            let ([x, y, z], [u, v, w]) = (input.position_m, input.previous_m);
            [x, y, z, u, v, w, input.number]
        });
        write("presses.npy", 7, &presses.collect::<Vec<f64>>())?;
        write("nodes.npy", 3, &region.nodes.concat())?;
        let corners = region.triangles.iter().flatten().map(|&node| node as f64);
        write("triangles.npy", 3, &corners.collect::<Vec<f64>>())?;
        write("variances.npy", 1, self.locator.variances())?;
        let card = Card {
            version: VERSION,
            design: DesignId::of(design),
            pose: self.pose,
            units: self.units.clone(),
            realignment: self.realignment.clone(),
            covariance: map.covariance,
            extent: map.extent,
            temperature: self.locator.temperature,
            misfit_limit: self.misfit_limit,
            strength: self.locator.strength().copied(),
            quality: self.quality,
            rest: self.rest.clone(),
        };
        let text = serde_json::to_string_pretty(&card).expect("a card is JSON");
        // The card is written last: a folder without it is no calibration.
        Ok(write_whole(&folder.join(CARD), |out| out.write_all(text.as_bytes()))?)
    }

    /// Reads the calibration of a design from a folder.
    ///
    /// # Errors
    /// Files that are missing, damaged or of another version; a calibration of another design.
    pub fn load(folder: &Path, design: &SkinDesign) -> Result<Self, CalibrateError> {
        let path = folder.join(CARD);
        let file = |message: String| CalibrateError::File { path: path.clone(), message };
        let card: Card = read_card(&path, design)?;
        let channels = card.units.channel_count();
        let read = |name: &str, columns: usize| read_columns(&folder.join(name), columns);
        let inputs: Vec<PressInput> = read("presses.npy", 7)?
            .chunks_exact(7)
            .map(|row| PressInput {
                position_m: [row[0], row[1], row[2]],
                previous_m: [row[3], row[4], row[5]],
                number: row[6],
            })
            .collect();
        let mean = read("mean.npy", 1)?;
        let weights = read("weights.npy", channels)?;
        let (whitening, components) = read_matrix(&folder.join("whitening.npy"))?;
        let nodes = read("nodes.npy", 3)?.chunks_exact(3).map(|row| [row[0], row[1], row[2]]).collect();
        let triangles = read("triangles.npy", 3)?;
        if triangles.iter().any(|node| *node < 0.0 || node.fract() != 0.0) {
            return Err(file("triangles.npy holds no indices of nodes: calibrate again".into()));
        }
        let triangles =
            triangles.chunks_exact(3).map(|row| [row[0], row[1], row[2]].map(|node| node as usize)).collect();
        let region = Region { nodes, triangles };
        let variances = read("variances.npy", 1)?;
        let fits = weights.len() == inputs.len() * channels
            && mean.len() == channels
            && components > 0
            && whitening.len() == channels * components
            && card.strength.is_none_or(|strength| strength.is_consistent())
            && card.covariance.is_consistent()
            && region.is_consistent()
            && variances.len() == region.nodes.len()
            && variances.iter().all(|variance| *variance > 1e-30)
            && !inputs.is_empty()
            && (1e-6..=1e6).contains(&card.temperature)
            && card.misfit_limit > 0.0
            && card.extent.radius_m > 0.0
            && channels == design.protocol.channel_count()
            && card.units.is_consistent()
            && card.realignment.fits(channels)
            && card.rest.as_ref().is_none_or(|rest| rest.len() == channels);
        if !fits {
            return Err(file("its arrays do not belong together: calibrate again".into()));
        }
        let matrix = |values: &[f64], columns: usize| {
            Mat::from_fn(values.len() / columns, columns, |i, j| values[i * columns + j])
        };
        let weights = matrix(&weights, channels);
        let map = ForwardMap { covariance: card.covariance, extent: card.extent, inputs, mean, weights };
        let setup =
            Setup { region, untouched: card.realignment.complete(card.units.untouched()), strength: card.strength };
        let locator = Locator::assemble(setup, map, matrix(&whitening, components), variances, card.temperature);
        Ok(Calibration {
            units: card.units,
            realignment: card.realignment,
            locator,
            misfit_limit: card.misfit_limit,
            quality: card.quality,
            pose: card.pose,
            rest: card.rest,
        })
    }
}

/// The values of an array with a number of columns, row-major.
fn read_columns(path: &Path, columns: usize) -> Result<Vec<f64>, CalibrateError> {
    let (values, got) = read_matrix(path)?;
    if got != columns {
        let message = format!("it has {}, but it must have {columns}", counted(got, "column"));
        return Err(CalibrateError::File { path: path.to_path_buf(), message });
    }
    Ok(values)
}

/// The values of a matrix, row-major, and its number of columns.
fn read_matrix(path: &Path) -> Result<(Vec<f64>, usize), CalibrateError> {
    let (shape, values) = read_array(path, "array")?;
    let file = |message: String| CalibrateError::File { path: path.to_path_buf(), message };
    if shape.len() != 2 {
        return Err(file(format!("its shape is {shape:?}, but it must have rows and columns")));
    }
    // Squares of sums of products of such values are finite.
    const LARGEST: f64 = 1e30;
    if let Some(value) = values.iter().find(|value| value.is_nan() || value.abs() > LARGEST) {
        return Err(file(format!("it has the value {value:e}, which is not of a calibration: calibrate again")));
    }
    Ok((values, shape[1]))
}

impl From<TableError> for CalibrateError {
    fn from(error: TableError) -> Self {
        CalibrateError::Table(error)
    }
}
