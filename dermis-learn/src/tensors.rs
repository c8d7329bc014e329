//! Files of tensors, in the safetensors format.

use crate::LearnError;
use dermis::frame::write_whole;
use half::f16;
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use std::collections::HashMap;
use std::path::Path;

/// The storage precision of values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// Four bytes each.
    Single,
    /// Two bytes each, rounded to nearest.
    Half,
}

/// A tensor to write.
pub(crate) struct Named<'a> {
    pub name: String,
    pub shape: Vec<usize>,
    pub values: &'a [f32],
    pub precision: Precision,
}

/// Writes tensors and a text under each key of the metadata, completely or not at all.
pub(crate) fn write(path: &Path, tensors: &[Named<'_>], metadata: HashMap<String, String>) -> Result<(), LearnError> {
    let bytes = to_bytes(tensors, metadata);
    write_whole(path, |out| out.write_all(&bytes)).map_err(|error| LearnError::Dermis(error.into()))
}

/// A file of tensors.
pub(crate) fn to_bytes(tensors: &[Named<'_>], metadata: HashMap<String, String>) -> Vec<u8> {
    let bytes: Vec<Vec<u8>> = (tensors.iter())
        .map(|tensor| match tensor.precision {
            Precision::Single => tensor.values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Precision::Half => tensor.values.iter().flat_map(|&value| f16::from_f32(value).to_le_bytes()).collect(),
        })
        .collect();
    let views = tensors.iter().zip(&bytes).map(|(tensor, bytes)| {
        let dtype = match tensor.precision {
            Precision::Single => Dtype::F32,
            Precision::Half => Dtype::F16,
        };
        let view = TensorView::new(dtype, tensor.shape.clone(), bytes).expect("as many bytes as the shape has");
        (tensor.name.clone(), view)
    });
    let metadata = Some(metadata).filter(|metadata| !metadata.is_empty());
    safetensors::serialize(views, metadata).expect("views of whole tensors")
}

/// The values of a required tensor of a given shape.
pub(crate) fn values(path: &Path, file: &SafeTensors<'_>, name: &str, shape: &[usize]) -> Result<Vec<f32>, LearnError> {
    let wrong = |what: String| LearnError::model(path, what);
    let tensor = file.tensor(name).map_err(|_| wrong(format!("the tensor `{name}` is missing")))?;
    if tensor.shape() != shape {
        return Err(wrong(format!("the tensor `{name}` is {:?}, not {shape:?}", tensor.shape())));
    }
    let values: Vec<f32> = match tensor.dtype() {
        Dtype::F32 => tensor.data().chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect(),
        Dtype::F16 => tensor.data().chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32()).collect(),
        other => return Err(wrong(format!("the tensor `{name}` holds {other:?}, not F32 or F16"))),
    };
    match values.iter().position(|value| !value.is_finite()) {
        Some(at) => Err(wrong(format!("the tensor `{name}` has a value that is not finite, at {at}"))),
        None => Ok(values),
    }
}

/// Reads a file's header; a truncated file or one of another format is an error.
pub(crate) fn parse<'a>(path: &Path, bytes: &'a [u8]) -> Result<SafeTensors<'a>, LearnError> {
    SafeTensors::deserialize(bytes)
        .map_err(|error| LearnError::model(path, format!("damaged, cut off or no safetensors file ({error})")))
}
