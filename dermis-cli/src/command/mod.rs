//! The commands: each a module with its arguments and what it does with them.

pub mod benchmark;
mod calibrate;
mod contacts;
mod convert;
mod demo;
mod emulate;
mod evaluate;
mod experiment;
mod export;
mod forward;
mod jacobian;
mod live;
mod mesh;
mod new;
pub mod plot;
mod reconstruct;
mod recover;
mod replay;
mod reproduce;
mod scan_table;
mod schema;
mod simulate;
mod train;

use crate::failure::Outcome;
use clap::Subcommand;

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make the mesh of a design, write it and report on it.
    Mesh(mesh::Arguments),
    /// Solve for the frames of given conductivities.
    Forward(forward::Arguments),
    /// Write the derivative of a frame by the conductivity.
    Jacobian(jacobian::Arguments),
    /// Make images from frames.
    Reconstruct(reconstruct::Arguments),
    /// Find the contacts in frames.
    Contacts(contacts::Arguments),
    /// Score contacts against what truly touched the skin.
    Evaluate(evaluate::Arguments),
    /// Assess a method on twins that it has never seen: localisation, two and four touches, smallest force.
    Benchmark(benchmark::Arguments),
    /// Measure on simulated touches how far a method's contacts lie from what touched.
    Calibrate(calibrate::Arguments),
    /// Press a twin as the paper pressed its skin, and write the frames that its instrument delivers.
    Experiment(experiment::Arguments),
    /// Write a trained network for other programs: an ONNX file.
    Export(export::Arguments),
    /// See it work: the paper's skin pressed 900 times in simulation, or a real tank; writes a report.
    Demo(demo::Arguments),
    /// The paper, reproduced: its figures and pictures on twins, beside what it states; writes a page.
    Reproduce(reproduce::Arguments),
    /// Make a dataset to train on: touches drawn from a seed, frames, images and truth.
    Simulate(simulate::Arguments),
    /// Train a network on datasets.
    Train(train::Arguments),
    /// Read a skin as it is touched: contacts, a page to see them on, recordings, ROS 2.
    Live(live::Arguments),
    /// A device to try without hardware: a twin that speaks the wire protocol.
    Emulate(emulate::Arguments),
    /// Make the contacts of a recording anew.
    Replay(replay::Arguments),
    /// Make a whole recording of what an interrupted one holds.
    Recover(recover::Arguments),
    /// Make tables of a recording: CSV and NPZ.
    Convert(convert::Arguments),
    /// Write what an instrument for a skin reads, in which order.
    ScanTable(scan_table::Arguments),
    /// Write a commented design file to start from.
    New(new::Arguments),
    /// Draw a skin: mesh, electrodes, sensitivity, an image, where touches were found.
    Plot(plot::Arguments),
    /// Print the JSON schema of design files, twin files, scripts of touches or live frames.
    Schema(schema::Arguments),
}

impl Command {
    /// Does it.
    pub fn run(self) -> Outcome {
        match self {
            Command::Mesh(arguments) => arguments.run(),
            Command::Forward(arguments) => arguments.run(),
            Command::Jacobian(arguments) => arguments.run(),
            Command::Reconstruct(arguments) => arguments.run(),
            Command::Contacts(arguments) => arguments.run(),
            Command::Evaluate(arguments) => arguments.run(),
            Command::Benchmark(arguments) => arguments.run(),
            Command::Calibrate(arguments) => arguments.run(),
            Command::Experiment(arguments) => arguments.run(),
            Command::Export(arguments) => arguments.run(),
            Command::Demo(arguments) => arguments.run(),
            Command::Reproduce(arguments) => arguments.run(),
            Command::Simulate(arguments) => arguments.run(),
            Command::Train(arguments) => arguments.run(),
            Command::Live(arguments) => arguments.run(),
            Command::Emulate(arguments) => arguments.run(),
            Command::Replay(arguments) => arguments.run(),
            Command::Recover(arguments) => arguments.run(),
            Command::Convert(arguments) => arguments.run(),
            Command::ScanTable(arguments) => arguments.run(),
            Command::New(arguments) => arguments.run(),
            Command::Plot(arguments) => arguments.run(),
            Command::Schema(arguments) => arguments.run(),
        }
    }
}
