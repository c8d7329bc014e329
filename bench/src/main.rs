//! The Dermis part of the comparison with other programs (started by `bench/peers/run.sh`).
//!
//! - `dermis-bench serve CASE FOLDER` writes a problem (mesh, electrodes, channels, conductivities) and our voltages
//!   into the folder as NPY files. Then it reads commands from the standard input, so that it and the other programs
//!   run in turns; it ends at the end of input. The answer to each command is one line of times in seconds: `forward N`
//!   and `jacobian N` with N of them; `batched N` with the time per sample of N batches of eight; `many M N` with the
//!   times of N calls that solve M conductivities each; `forward-on T N` and `batched-on T N` with the time per sample
//!   of T threads, each with its own solver, that solve N samples or batches in parallel.
//! - `dermis-bench training DATA FEW FOLDER` and `dermis-bench inference DATA FOLDER` do the same for networks (started
//!   by `bench/peers/learn.sh`), on datasets of `dermis simulate`: `train N` with the times of N steps of the paper's
//!   network, `infer paper N` and `infer spots N` with those of N frames. FEW contains a single batch to train on.
//! - `dermis-bench cost` prints the time per sample as a function of the mesh size, for each instruction set, as CSV.
//! - `dermis-bench limits` prints the limits of this machine: multiply-adds in registers, numbers streamed through each
//!   level of its memory, as CSV.

use std::error::Error;
use std::path::Path;

mod cost;
mod export;
mod learn;
mod limits;
mod problem;
mod serve;

const USAGE: &str =
    "usage: dermis-bench serve CASE FOLDER | training DATA FEW FOLDER | inference DATA FOLDER | cost | limits
a CASE is cylinder30 or disk30, then -20k for the finer mesh, then -points for point electrodes";

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["serve", case, folder] => serve::serve(case, Path::new(folder)),
        ["training", data, few, folder] => learn::training(Path::new(data), Path::new(few), Path::new(folder)),
        ["inference", data, folder] => learn::inference(Path::new(data), Path::new(folder)),
        ["cost"] => cost::print(),
        ["limits"] => {
            limits::print();
            Ok(())
        }
        _ => Err(USAGE.into()),
    }
}
