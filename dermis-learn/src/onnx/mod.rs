//! Export of a network as an ONNX file, for other programs: <https://onnx.ai>.
//!
//! The input of the graph is differences in ohm, float32, `[frames, channels]`, the output images `[frames, pixels]`;
//! the model's input normalisation is at the start of the graph.

mod graph;
mod protobuf;
#[cfg(test)]
mod tests;

use crate::inference::{Folded, fold};
use crate::input::Input;
use crate::model::Model;
use crate::network::{Network, Refinement};
use crate::options::Target;
use graph::{Attribute, Graph};

/// The end of a slice that goes to the end.
const TO_THE_END: i64 = i64::MAX;

/// The axis of an image's columns, in the layout `[frame, channel, row, column]`.
const COLUMNS: i64 = 3;

impl Model {
    /// The bytes of an ONNX file that computes images of differences like the model: opset 13, one input
    /// `difference_ohm`, one output `image`; the card is stored in its metadata as `card`.
    pub fn to_onnx(&self) -> Vec<u8> {
        let card = self.card();
        let text = serde_json::to_string(card).expect("a card is JSON");
        file(&card.input, self.network(), card.target, card.skin.channels, &[("card", text)])
    }
}

/// An ONNX file with entries in its metadata.
fn file(input: &Input, network: &Network, target: Target, channels: usize, notes: &[(&str, String)]) -> Vec<u8> {
    let mut graph = Graph::default();
    let value = add_input(&mut graph, input, channels, "difference_ohm");
    let (value, size) = if input.scale_free { add_size(&mut graph, input, &value) } else { (value, String::new()) };
    let value = add_network(&mut graph, network, &value);
    let last = if input.scale_free { "shape" } else { "image" };
    match target {
        Target::Conductance => graph.operation("Identity", &[&value], last, &[]),
        Target::Touches { .. } => {
            let size = graph.operation("Abs", &[&value], "root.size", &[]);
            graph.operation("Mul", &[&value, &size], last, &[])
        }
    };
    if input.scale_free {
        graph.operation("Mul", &["shape", &size], "image", &[]);
    }
    graph.into_file("dermis", [("difference_ohm", channels), ("image", network.architecture().outputs())], notes)
}

/// Adds the conversion of the channels before the network: means, normalisation.
///
/// If every input is a mean of `n` channels (or can be written as one, with repeated channels), it is the sum of `n`
/// gathered values, and `1 / n` is included in the factor.
fn add_input(graph: &mut Graph, input: &Input, channels: usize, value: &str) -> String {
    let count = input.channels.iter().fold(1, |count, group| least_common_multiple(count, group.len().max(1)));
    let mut value = value.to_string();
    if count > 1 || !input.channels.iter().flatten().copied().eq(0..channels) {
        let gathered: Vec<String> = (0..count).map(|turn| add_gathered(graph, input, turn, &value)).collect();
        value = gathered[0].clone();
        for (turn, other) in gathered.iter().enumerate().skip(1) {
            value = graph.operation("Add", &[&value, other], &format!("reciprocal.sum.{turn}"), &[]);
        }
    }
    let size = [input.len()];
    let sums: Vec<f32> = input.mean_ohm.iter().map(|mean| mean * count as f32).collect();
    let sums = graph.floats("mean_ohm", &size, &sums);
    let factor = |(group, sd): (&Vec<usize>, &f32)| if group.is_empty() { 0.0 } else { 1.0 / (sd * count as f32) };
    let factors: Vec<f32> = input.channels.iter().zip(&input.sd_ohm).map(factor).collect();
    let factors = graph.floats("factor", &size, &factors);
    let centred = graph.operation("Sub", &[&value, &sums], "centred_ohm", &[]);
    graph.operation("Mul", &[&centred, &factors], "normalised", &[])
}

/// Divides the inputs by their root mean square; returns the names of the result and of the root mean square.
fn add_size(graph: &mut Graph, input: &Input, value: &str) -> (String, String) {
    let square = graph.operation("Mul", &[value, value], "normalised.square", &[]);
    let axes = [("axes", Attribute::Integers(&[1]))];
    let mean = graph.operation("ReduceMean", &[&square], "normalised.mean_square", &axes);
    // The mean is over the inputs that have a channel.
    let there = input.channels.iter().filter(|channels| !channels.is_empty()).count().max(1);
    let share = graph.floats("share_there", &[1], &[input.len() as f32 / there as f32]);
    let mean = graph.operation("Mul", &[&mean, &share], "normalised.mean_square_there", &[]);
    let size = graph.operation("Sqrt", &[&mean], "size", &[]);
    let least = graph.floats("least_size", &[1], &[f32::MIN_POSITIVE]);
    let divisor = graph.operation("Max", &[&size, &least], "size.positive", &[]);
    (graph.operation("Div", &[value, &divisor], "shape.input", &[]), size)
}

/// One channel of each input.
fn add_gathered(graph: &mut Graph, input: &Input, turn: usize, value: &str) -> String {
    // An input without a channel is multiplied by zero: any channel can be used.
    let of = |group: &Vec<usize>| if group.is_empty() { 0 } else { group[turn % group.len()] as i64 };
    let channels: Vec<i64> = input.channels.iter().map(of).collect();
    let name = format!("reciprocal.{turn}");
    let channels = graph.integers(&format!("{name}.channels"), &channels);
    graph.operation("Gather", &[value, &channels], &name, &[("axis", Attribute::Integer(1))])
}

fn least_common_multiple(a: usize, b: usize) -> usize {
    let (mut divisor, mut rest) = (a, b);
    while rest != 0 {
        (divisor, rest) = (rest, divisor % rest);
    }
    a / divisor * b
}

/// Adds the layers of a network with the input `value`, batch normalisations folded in; returns the name of its output.
fn add_network(graph: &mut Graph, network: &Network, value: &str) -> String {
    let mut value = value.to_string();
    for (index, Folded { dense, relu }) in fold(network).iter().enumerate() {
        let name = format!("trunk.{index}");
        let weight = graph.floats(&format!("{name}.weight"), &[dense.inputs, dense.outputs], &dense.weight);
        let bias = graph.floats(&format!("{name}.bias"), &[dense.outputs], &dense.bias);
        let sum = graph.operation("Gemm", &[&value, &weight, &bias], &format!("{name}.sum"), &[]);
        value = add_relu(graph, *relu, &sum);
    }
    match &network.refinement {
        Some(refinement) => add_refinement(graph, refinement, &value),
        None => value,
    }
}

fn add_relu(graph: &mut Graph, is_wanted: bool, value: &str) -> String {
    match is_wanted {
        true => graph.operation("Relu", &[value], &format!("{value}.relu"), &[]),
        false => value.into(),
    }
}

/// The refinement of an image with the flat input layout `[frame, row, column, channel]`.
///
/// With periodic columns the image is extended once, by a column on either side for each convolution, and each
/// convolution removes one: the same as periodic padding before each, without extending the intermediate images.
fn add_refinement(graph: &mut Graph, refinement: &Refinement, value: &str) -> String {
    let shape = &refinement.shape;
    let sizes = [shape.rows, shape.columns, refinement.channels_in()].map(|size| size as i64);
    let shape_name = graph.integers("picture.shape", &[0, sizes[0], sizes[1], sizes[2]]);
    let picture = graph.operation("Reshape", &[value, &shape_name], "picture.channels_last", &[]);
    let order = [("perm", Attribute::Integers(&[0, 3, 1, 2]))];
    let picture = graph.operation("Transpose", &[&picture], "picture", &order);
    let first = add_slice(graph, &picture, "first_channel", 1, [0, 1]);
    let mut value = match shape.is_ring {
        true => add_neighbours(graph, &picture, refinement.convolutions.len(), shape.columns),
        false => picture,
    };
    let beside = i64::from(!shape.is_ring);
    let attributes =
        [("kernel_shape", Attribute::Integers(&[3, 3])), ("pads", Attribute::Integers(&[1, beside, 1, beside]))];
    for (index, one) in refinement.convolutions.iter().enumerate() {
        let (name, [from, to]) = (format!("refinement.{index}"), one.channels);
        let weight =
            graph.floats(&format!("{name}.weight"), &[to, from, 3, 3], &channels_first(&one.weight, one.channels));
        let bias = graph.floats(&format!("{name}.bias"), &[to], &one.bias);
        value = graph.operation("Conv", &[&value, &weight, &bias], &format!("{name}.sum"), &attributes);
        value = add_relu(graph, index + 1 < refinement.convolutions.len(), &value);
    }
    let sum = graph.operation("Add", &[&value, &first], "refined", &[]);
    graph.operation("Flatten", &[&sum], "refined.flat", &[])
}

/// Extends a periodic image by a number of columns on either side.
fn add_neighbours(graph: &mut Graph, picture: &str, count: usize, columns: usize) -> String {
    let (mut value, mut left, mut round) = (picture.to_string(), count, 0);
    while left > 0 {
        // Extended by all its columns, a periodic image is repeated three times, and can be extended again in the same
        // way.
        let step = left.min(columns) as i64;
        let before = add_slice(graph, &value, &format!("ring.{round}.before"), COLUMNS, [-step, TO_THE_END]);
        let behind = add_slice(graph, &value, &format!("ring.{round}.behind"), COLUMNS, [0, step]);
        let axis = [("axis", Attribute::Integer(COLUMNS))];
        value = graph.operation("Concat", &[&before, &value, &behind], &format!("ring.{round}"), &axis);
        (left, round) = (left - step as usize, round + 1);
    }
    value
}

fn add_slice(graph: &mut Graph, value: &str, name: &str, axis: i64, [from, to]: [i64; 2]) -> String {
    let bounds = [("from", from), ("to", to), ("axis", axis)];
    let [from, to, axis] = bounds.map(|(part, number)| graph.integers(&format!("{name}.{part}"), &[number]));
    graph.operation("Slice", &[value, &from, &to, &axis], name, &[])
}

/// Converts weights `[row][column][input][output]` to `[output][input][row][column]`.
fn channels_first(weight: &[f32], [from, to]: [usize; 2]) -> Vec<f32> {
    let taps = weight.len() / (from * to);
    let mut turned = Vec::with_capacity(weight.len());
    for output in 0..to {
        for input in 0..from {
            turned.extend((0..taps).map(|tap| weight[(tap * from + input) * to + output]));
        }
    }
    turned
}
