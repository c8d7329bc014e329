//! Graphs of operations in the Open Neural Network Exchange format.
//!
//! Field numbers: `onnx.proto` of the format, <https://github.com/onnx/onnx/blob/main/onnx/onnx.proto>.

use crate::onnx::protobuf::Message;

/// The operator set version of the file: old, so that many programs can read it, and the first one whose definitions of
/// the operators used here have not changed since.
pub(super) const OPERATOR_SET: i64 = 13;

/// The format version released with that operator set (ONNX 1.8, November 2020).
const FORMAT_VERSION: i64 = 7;

const FLOAT: i64 = 1;
const INT64: i64 = 7;

/// An attribute of an operation.
#[derive(Debug, Clone, Copy)]
pub(super) enum Attribute<'a> {
    /// An integer.
    Integer(i64),
    /// Several integers.
    Integers(&'a [i64]),
}

/// A graph that is being built; values are identified by name.
#[derive(Debug, Default)]
pub(super) struct Graph {
    body: Message,
    node_count: usize,
}

impl Graph {
    /// Adds a constant of floats and returns its name.
    ///
    /// # Panics
    /// If the shape does not match the number of values.
    pub(super) fn floats(&mut self, name: &str, shape: &[usize], values: &[f32]) -> String {
        assert_eq!(shape.iter().product::<usize>(), values.len(), "the shape of {name}");
        self.constant(name, shape, FLOAT, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())
    }

    /// Adds a constant list of integers and returns its name.
    pub(super) fn integers(&mut self, name: &str, values: &[i64]) -> String {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.constant(name, &[values.len()], INT64, &bytes)
    }

    fn constant(&mut self, name: &str, shape: &[usize], kind: i64, bytes: &[u8]) -> String {
        let sizes = shape.iter().fold(Message::default(), |tensor, &size| tensor.integer(1, size as i64));
        let tensor = sizes.integer(2, kind).text(8, name).bytes(9, bytes);
        self.body = std::mem::take(&mut self.body).message(5, &tensor);
        name.into()
    }

    /// Adds an operation and returns its output's name.
    pub(super) fn operation(
        &mut self,
        kind: &str,
        inputs: &[&str],
        output: &str,
        attributes: &[(&str, Attribute<'_>)],
    ) -> String {
        let node = inputs.iter().fold(Message::default(), |node, input| node.text(1, input)).text(2, output);
        let node = node.text(3, &format!("{kind}_{}", self.node_count)).text(4, kind);
        let node = attributes.iter().fold(node, |node, (name, value)| node.message(5, &attribute(name, *value)));
        self.body = std::mem::take(&mut self.body).message(1, &node);
        self.node_count += 1;
        output.into()
    }

    /// The file: the graph from one input of `[frames, inputs]` to one output of `[frames, outputs]`.
    pub(super) fn into_file(self, name: &str, ends: [(&str, usize); 2], notes: &[(&str, String)]) -> Vec<u8> {
        let [(input, inputs), (output, outputs)] = ends;
        let graph = self.body.text(2, name).message(11, &value(input, inputs)).message(12, &value(output, outputs));
        let operators = Message::default().text(1, "").integer(2, OPERATOR_SET);
        let file = Message::default()
            .integer(1, FORMAT_VERSION)
            .text(2, "dermis")
            .text(3, env!("CARGO_PKG_VERSION"))
            .message(7, &graph)
            .message(8, &operators);
        let note = |file: Message, (key, text): &(&str, String)| {
            file.message(14, &Message::default().text(1, key).text(2, text))
        };
        notes.iter().fold(file, note).into_bytes()
    }
}

fn attribute(name: &str, value: Attribute<'_>) -> Message {
    let named = Message::default().text(1, name);
    match value {
        Attribute::Integer(value) => named.integer(3, value).integer(20, 2),
        Attribute::Integers(values) => {
            values.iter().fold(named, |named, &value| named.integer(8, value)).integer(20, 7)
        }
    }
}

/// The type of an input or output: floats, one row per frame.
fn value(name: &str, size: usize) -> Message {
    let frames = Message::default().text(2, "frames");
    let size = Message::default().integer(1, size as i64);
    let shape = Message::default().message(1, &frames).message(1, &size);
    let tensor = Message::default().integer(1, FLOAT).message(2, &shape);
    Message::default().text(1, name).message(2, &Message::default().message(1, &tensor))
}
