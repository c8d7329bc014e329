//! The data needed to continue an interrupted training.

use crate::LearnError;
use crate::options::{Epoch, TrainOptions};
use crate::tensors::{self, Named, Precision};
use crate::training::trainer::State;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;

/// The version of the format.
const FORMAT: &str = "dermis checkpoint 1";
const KEY: &str = "dermis";

/// The metadata of a checkpoint.
#[derive(Serialize, Deserialize)]
struct Label {
    format: String,
    options: TrainOptions,
    #[serde(rename = "plan")]
    architecture: crate::network::Architecture,
    input: crate::input::Input,
    /// Skin, noise and datasets.
    #[serde(default)]
    origin: String,
    steps: u64,
    epochs: Vec<Epoch>,
}

/// Writes a checkpoint, completely or not at all.
pub(crate) fn write(path: &Path, options: &TrainOptions, origin: &str, state: &State) -> Result<(), LearnError> {
    let single = |name: String, shape: Vec<usize>, values| Named { name, shape, values, precision: Precision::Single };
    let mut named = Vec::new();
    let mut moments = state.moments.iter();
    for tensor in state.network.tensors() {
        if tensor.is_learned {
            let [mean, square] = moments.next().expect("every learned tensor has its moments");
            named.push(single(format!("adam.mean.{}", tensor.name), tensor.shape.clone(), mean));
            named.push(single(format!("adam.square.{}", tensor.name), tensor.shape.clone(), square));
        }
        named.push(single(tensor.name, tensor.shape, tensor.values));
    }
    let label = Label {
        format: FORMAT.into(),
        options: options.clone(),
        architecture: state.network.architecture().clone(),
        input: state.input.clone(),
        origin: origin.into(),
        steps: state.steps,
        epochs: state.epochs.clone(),
    };
    let label = serde_json::to_string(&label).expect("a label is JSON");
    tensors::write(path, &named, HashMap::from([(KEY.to_string(), label)]))
}

/// Reads a checkpoint into a state of the same network, options and origin; returns whether there was one.
pub(crate) fn read(path: &Path, options: &TrainOptions, origin: &str, state: &mut State) -> Result<bool, LearnError> {
    let bytes = match std::fs::read(path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(LearnError::io(path, error)),
    };
    let file = tensors::parse(path, &bytes)?;
    let (_, metadata) = safetensors::SafeTensors::read_metadata(&bytes).expect("it was just parsed");
    let text = metadata.metadata().as_ref().and_then(|metadata| metadata.get(KEY));
    let label: Option<Label> = text.and_then(|text| serde_json::from_str(text).ok());
    let fix = "move it away to begin anew";
    let Some(label) = label.filter(|label| label.format == FORMAT) else {
        return Err(LearnError::model(path, format!("no checkpoint of this version; {fix}")));
    };
    // The number of epochs may be increased later.
    if (TrainOptions { epochs: options.epochs, ..label.options } != *options)
        || label.architecture != *state.network.architecture()
    {
        return Err(LearnError::model(path, format!("it is of another network or of other options; {fix}")));
    }
    if label.input != state.input || label.origin != origin {
        return Err(LearnError::model(path, format!("it was trained on other samples, noise or another skin; {fix}")));
    }
    let mut network = state.network.clone();
    let mut moments = state.moments.clone();
    let mut places = moments.iter_mut();
    let shapes: Vec<(String, Vec<usize>, bool)> =
        (state.network.tensors().into_iter()).map(|tensor| (tensor.name, tensor.shape, tensor.is_learned)).collect();
    for ((name, shape, is_learned), values) in shapes.into_iter().zip(network.values_mut()) {
        *values = tensors::values(path, &file, &name, &shape)?;
        if is_learned {
            let [mean, square] = places.next().expect("every learned tensor has its moments");
            *mean = tensors::values(path, &file, &format!("adam.mean.{name}"), &shape)?;
            *square = tensors::values(path, &file, &format!("adam.square.{name}"), &shape)?;
        }
    }
    *state = State { network, input: label.input, moments, steps: label.steps, epochs: label.epochs };
    Ok(true)
}
