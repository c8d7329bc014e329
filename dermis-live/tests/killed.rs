//! Kills a recording program (SIGKILL): at most one second is lost, and the rest is always recovered. `DERMIS_KILLS`
//! sets the number of runs.

use crate::synthetic;
use dermis_live::recording::{Recorded, Recorder, Recording, Session, recover};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Environment variable with the file to record into, for the killed process: this same program.
const INTO: &str = "DERMIS_TEST_RECORD_INTO";
const KILLS: u64 = 20;
/// Number of processes that record in parallel.
const AT_ONCE: u64 = 10;

/// Records at 120 frames per second in real time until it is killed.
#[test]
fn records_until_it_is_killed() {
    let Some(path) = std::env::var_os(INTO) else { return };
    let skin = synthetic::SyntheticSkin::shipped("skin16");
    let mut recorder = Recorder::create(Path::new(&path), skin.reference.clone(), &Session::default()).unwrap();
    for index in 0.. {
        let mut frame = skin.frame(index);
        frame.result.measured_at = dermis_live::clock::now();
        recorder.frame(&frame).unwrap();
        std::thread::sleep(Duration::from_secs(1) / synthetic::RATE as u32);
    }
}

/// Lets this program record for a while, kills it, and returns the lost time, s.
fn lost_s(seed: u64, folder: &Path) -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let [path, whole] = ["cut", "whole"].map(|name| folder.join(format!("{seed}-{name}.mcap")));
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "killed::records_until_it_is_killed"])
        .env(INTO, &path)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    while !std::fs::metadata(&path).is_ok_and(|file| file.len() > 0) {
        assert!(child.try_wait().unwrap().is_none(), "the program that records ended");
        std::thread::sleep(Duration::from_millis(5));
    }
    let begun = dermis_live::clock::now();
    std::thread::sleep(Duration::from_millis(random.random_range(100..2_500)));
    let killed = dermis_live::clock::now();
    child.kill().unwrap();
    child.wait().unwrap();
    let recovered = recover(&path, &whole).unwrap();
    assert!(!recovered.was_whole && recovered.damaged.is_empty(), "{recovered:?}");
    let last = Recording::open(&whole).unwrap().filter_map(|item| match item.unwrap() {
        Recorded::Frame { measured_at, .. } => Some(measured_at),
        Recorded::Event { .. } | Recorded::Session(_) => None,
    });
    killed.seconds_since(last.last().unwrap_or(begun))
}

#[test]
fn a_killed_program_loses_a_second_at_most() {
    if std::env::var_os(INTO).is_some() {
        return;
    }
    let kills = std::env::var("DERMIS_KILLS").ok().and_then(|text| text.parse().ok()).unwrap_or(KILLS);
    let folder = tempfile::tempdir().unwrap();
    let mut lost: Vec<f64> = Vec::new();
    for first in (0..kills).step_by(AT_ONCE as usize) {
        let seeds = first..kills.min(first + AT_ONCE);
        std::thread::scope(|scope| {
            let threads: Vec<_> = seeds
                .map(|seed| {
                    scope.spawn({
                        let folder = folder.path();
                        move || lost_s(seed, folder)
                    })
                })
                .collect();
            lost.extend(threads.into_iter().map(|thread| thread.join().unwrap()));
        });
    }
    lost.sort_by(f64::total_cmp);
    let longest = lost[lost.len() - 1];
    println!("killed {kills} times: {:.2} s lost in the middle, {longest:.2} s at most", lost[lost.len() / 2]);
    assert!(longest < 1.0, "{longest} s lost");
}
