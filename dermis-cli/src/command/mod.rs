//! The commands: one module each, with its arguments.

pub mod benchmark;
mod bound;
pub mod calibrate;
mod characterise;
mod check_build;
mod check_device;
mod check_frames;
mod contacts;
mod convert;
mod demo;
mod emulate;
mod evaluate;
mod experiment;
mod export;
mod fabricate;
mod fault_campaign;
mod fit;
mod forward;
mod jacobian;
mod live;
mod mesh;
mod new;
mod optimise;
pub mod plot;
mod reconstruct;
mod recover;
mod replay;
mod robot;
mod scan_table;
mod schema;
mod shell;
mod simulate;
pub mod train;

use crate::failure::Outcome;
use clap::Subcommand;

/// The command.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Generate the mesh of a design, write it and report its quality.
    Mesh(mesh::Arguments),
    /// Simulate frames of a design: untouched, with touches, or from conductivities.
    Forward(forward::Arguments),
    /// Compute the Jacobian of a frame with respect to conductivity.
    Jacobian(jacobian::Arguments),
    /// Reconstruct images from frames.
    Reconstruct(reconstruct::Arguments),
    /// Find the contacts in recorded or simulated frames (CSV, NPY, NPZ).
    Contacts(contacts::Arguments),
    /// Score detected contacts against true touches.
    Evaluate(evaluate::Arguments),
    /// Benchmark a method on digital twins: localisation, two and four touches, smallest force.
    Benchmark(benchmark::Arguments),
    /// Compute bounds of a design before it is built: position, smallest force, separation of two presses.
    Bound(bound::Arguments),
    /// Search for a better design: places of the electrodes, and which values are read.
    Optimise(optimise::Arguments),
    /// Calibrate a real skin with presses at known places.
    Calibrate(calibrate::Arguments),
    /// Check a built skin by its untouched frame: open electrodes, shorts, exchanged wires, cuts; writes a report.
    CheckBuild(check_build::Arguments),
    /// Check a recording: late, dead or saturated channels, their order, signs, units, drift; writes a page.
    CheckFrames(check_frames::Arguments),
    /// Check a device's answers and frames against the wire protocol.
    CheckDevice(check_device::Arguments),
    /// Fit sheet resistance and contact impedances to frames of the untouched skin.
    Fit(fit::Arguments),
    /// Measure a method on simulated touches: standard deviation of positions, force per strength.
    Characterise(characterise::Arguments),
    /// Simulate the paper's indentation experiment on a digital twin and write its frames.
    Experiment(experiment::Arguments),
    /// Export a trained network to ONNX.
    Export(export::Arguments),
    /// Run a demonstration: 900 simulated presses on the paper's skin, or recordings of a real tank; writes a report.
    Demo(demo::Arguments),
    /// Generate a training dataset: random touches, frames, images and ground truth.
    Simulate(simulate::Arguments),
    /// Train a network.
    Train(train::Arguments),
    /// Read a skin live, real or emulated: contacts, a page in the browser, recordings, ROS 2.
    Live(live::Arguments),
    /// Several skins on one robot: check its file, read them live, list its links.
    Robot(robot::Arguments),
    /// Run a simulated device with the wire protocol.
    Emulate(emulate::Arguments),
    /// Test a method with random faults of a simulated device: false contacts, faults noticed, presses found again.
    FaultCampaign(fault_campaign::Arguments),
    /// Recompute the contacts of a recording.
    Replay(replay::Arguments),
    /// Repair a truncated recording.
    Recover(recover::Arguments),
    /// Convert a recording to CSV and NPZ.
    Convert(convert::Arguments),
    /// Write the scan table of a skin for firmware: CSV, a C header, or settling times in Rust.
    ScanTable(scan_table::Arguments),
    /// Write the files of a workshop: base to print, cut patterns, wiring and expected readings, robot description.
    Fabricate(fabricate::Arguments),
    /// Write a commented design file: a disk, a rectangle, a cylinder, or a body from a mesh file; or the file of a robot.
    New(new::Arguments),
    /// Draw a design, its sensitivity, an image with its contacts, or localisation errors.
    Plot(plot::Arguments),
    /// Print a JSON schema: design files, twin files, touch scripts, live frames or robots.
    Schema(schema::Arguments),
    /// Print a completion script for a shell.
    Completions(shell::CompletionArguments),
    /// Print the manual page, or write those of all commands.
    Man(shell::ManArguments),
}

/// The commands by what they are for, in the order of `dermis --help`.
pub const GROUPS: [(&str, &[&str]); 8] = [
    ("First steps", &["demo", "new", "forward", "contacts", "plot", "live"]),
    ("Design", &["mesh", "bound", "optimise", "schema"]),
    ("Reconstruct and score", &["reconstruct", "evaluate", "benchmark", "characterise", "jacobian"]),
    ("Build", &["fabricate", "scan-table", "check-build", "check-device", "check-frames", "fit"]),
    ("Calibrate", &["calibrate"]),
    ("Live", &["robot", "emulate", "replay", "recover", "convert", "fault-campaign"]),
    ("Simulate and train", &["experiment", "simulate", "train", "export"]),
    ("Shell", &["completions", "man"]),
];

macro_rules! run_each {
    ($command:expr, $($name:ident)*) => {
        match $command {
            $(Command::$name(arguments) => arguments.run(),)*
        }
    };
}

impl Command {
    /// Runs the command.
    pub fn run(self) -> Outcome {
        run_each!(
            self,
            Mesh Forward Jacobian Reconstruct Contacts Evaluate Benchmark Bound Optimise Calibrate CheckBuild
            CheckFrames CheckDevice Fit Characterise Experiment Export Demo Simulate Train Live Robot Emulate
            FaultCampaign Replay Recover Convert ScanTable Fabricate New Plot Schema Completions Man
        )
    }
}
