//! Our half of the comparison with other programs (`bench/peers/run.sh` drives it).
//!
//! - `dermis-bench serve CASE FOLDER` writes a problem (mesh, electrodes, channels, conductivities) and our voltages into
//!   the folder as NPY files. Then it waits for commands on the standard input, so that the other programs and this one
//!   can take turns in one run; the end of input ends it. Each answers with one line of times in seconds:
//!   `forward N` and `jacobian N` with N of them; `batched N` with the time per sample of N batches of eight;
//!   `forward-on T N` and `batched-on T N` with the time per sample of T threads, each with a solver of its own, that
//!   solve N samples or batches side by side.
//! - `dermis-bench training DATA FEW FOLDER` and `dermis-bench inference DATA FOLDER` do the same for networks
//!   (`bench/peers/learn.sh` drives them), on datasets of `dermis simulate`: `train N` with the times of N steps of the
//!   paper's network, `infer paper N` and `infer best N` with those of N frames. FEW holds a single batch to train on.
//! - `dermis-bench cost` prints how the time per sample grows with the mesh, for each instruction set, as CSV.
//! - `dermis-bench limits` prints what this machine can do at best: multiply-adds in registers, numbers streamed through
//!   each level of its memory, as CSV.

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
